// What the camera sees, as `scene/gbuffer` leaves it: the pictures from which stages compose theirs.
#define_import_path fathom::seen

@group(1) @binding(1) var albedo_texels: texture_2d<f32>;
@group(1) @binding(2) var normal_texels: texture_2d<f32>;
@group(1) @binding(3) var depths: texture_depth_2d;
