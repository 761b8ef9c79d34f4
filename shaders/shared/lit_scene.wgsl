// The scene lit without photons, cut at the resting water: what the reflection and refraction passes draw.
#define_import_path fathom::lit_scene

#import fathom::shading
#import fathom::uniforms::{frame}
#import fathom::surface::{Material, albedo}

// Geometry is kept this far past the water plane, so that waves do not open gaps, as a share of half the water's side: 10 cm in scene tank.
const OVERLAP: f32 = 0.02;

// `side` +1 keeps what lies above the water, −1 what lies below.
fn kept(position_m: vec3<f32>, side: f32) -> bool {
    return position_m.y * side >= -OVERLAP * frame.water_half_size_m.x;
}

fn radiance(material: Material, position_m: vec3<f32>, normal: vec3<f32>) -> vec3<f32> {
    let color = albedo(material, position_m, normal);
    let irradiance = shading::ambient(-position_m.y, normal) + shading::direct(position_m, normal);
    return shading::lambert(color, vec3(irradiance));
}
