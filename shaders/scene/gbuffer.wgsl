// Albedo, normal, specular coefficient and depth from the camera in one multi-target pass: UW §3.2, VAO §6.
#import fathom::host::{MaterialUniforms}
#import fathom::uniforms::{frame}
#import fathom::surface::{SceneVertex, albedo}

@group(1) @binding(0) var<storage, read> materials: array<MaterialUniforms>;

struct Varying {
    @builtin(position) clip: vec4<f32>,
    @location(0) position_m: vec3<f32>,
    @location(1) normal: vec3<f32>,
    @location(2) @interpolate(flat) material: u32,
}

struct GBufferTargets {
    @location(0) albedo: vec4<f32>,
    // The specular coefficient in w.
    @location(1) normal: vec4<f32>,
}

@vertex
fn vertex(in: SceneVertex) -> Varying {
    let clip = frame.camera_view_projection * vec4(in.position_m, 1.0);
    return Varying(clip, in.position_m, in.normal, in.material);
}

@fragment
fn fragment(in: Varying) -> GBufferTargets {
    let normal = normalize(in.normal);
    let material = materials[in.material];
    return GBufferTargets(vec4(albedo(material, in.position_m, normal), 1.0), vec4(normal, material.specular));
}
