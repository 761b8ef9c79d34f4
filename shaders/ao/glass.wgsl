// Transparent objects over the composed picture, by their opacities: VAO §5.2.2, Fig. 6.
//
// Objects are drawn back to front, each first by the faces that point away from the camera (instance 0), then by those that face it (1).
// Light is that of `ao/compose` without shadow and occlusion.
#import fathom::uniforms::{frame}
#import fathom::math::{PI}
#import fathom::shading
#import fathom::surface::{Material, SceneVertex, albedo}

struct Glass {
    exposure: f32,
    // Irradiance of the ambient light over that of the direct light.
    ambient: f32,
}

@group(1) @binding(0) var<storage, read> materials: array<Material>;
@group(1) @binding(1) var<uniform> settings: Glass;

struct Varying {
    @builtin(position) clip: vec4<f32>,
    @location(0) position_m: vec3<f32>,
    @location(1) normal: vec3<f32>,
    @location(2) @interpolate(flat) material: u32,
    @location(3) @interpolate(flat) here: u32,
}

@vertex
fn vertex(in: SceneVertex, @builtin(instance_index) instance: u32) -> Varying {
    let clip = frame.camera_view_projection * vec4(in.position_m, 1.0);
    return Varying(clip, in.position_m, in.normal, in.material, instance);
}

@fragment
fn fragment(in: Varying) -> @location(0) vec4<f32> {
    let to_viewer = frame.camera_position_m - in.position_m;
    let normal = normalize(in.normal);
    let facing = dot(normal, to_viewer) >= 0.0;
    if facing != (in.here == 1u) {
        discard;
    }
    let material = materials[in.material];
    let seen = select(-normal, normal, facing);
    let lit = settings.ambient + saturate(dot(seen, shading::to_light(in.position_m)));
    let color = albedo(material, in.position_m, normal) / PI * lit * frame.light_irradiance;
    return vec4(shading::display(color, settings.exposure).xyz, material.alpha);
}
