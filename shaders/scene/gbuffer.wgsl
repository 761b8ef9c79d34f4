// Albedo, normal, specular coefficient and depth from the camera in one multi-target pass: UW §3.2, VAO §6.
#import fathom::uniforms::{frame}
#import fathom::surface::{Material, SceneVertex, Varying, albedo, projected}

@group(1) @binding(0) var<storage, read> materials: array<Material>;

struct Targets {
    @location(0) albedo: vec4<f32>,
    // The specular coefficient in w.
    @location(1) normal: vec4<f32>,
}

@vertex
fn vertex(in: SceneVertex) -> Varying {
    return projected(in, frame.camera_view_projection);
}

@fragment
fn fragment(in: Varying) -> Targets {
    let normal = normalize(in.normal);
    let material = materials[in.material];
    return Targets(vec4(albedo(material, in.position_m, normal), 1.0), vec4(normal, material.specular));
}
