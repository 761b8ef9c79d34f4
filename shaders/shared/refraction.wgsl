// Where lines of sight leave glass: what the stages `refraction/*` share. Host twin: src/stages/refraction/mod.rs.
#define_import_path fathom::refraction

// The ray of a pixel behind glass.
struct Exit {
    // In w how far from the camera the line of sight enters the glass; 0: the pixel shows none.
    @location(0) position_m: vec4<f32>,
    // Unit. In w 1 where it is still inside, totally reflected.
    @location(1) direction: vec4<f32>,
}

const NO_EXIT: Exit = Exit(vec4<f32>(0.0), vec4<f32>(0.0));
