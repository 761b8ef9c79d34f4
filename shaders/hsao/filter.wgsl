// Joint bilateral filter and up-scaling of the ambient-occlusion buffer: VAO §6.
#import fathom::host::{BilateralUniforms}
#import fathom::bilateral::{filtered}

@group(1) @binding(0) var<storage, read> settings: BilateralUniforms;
@group(1) @binding(1) var source: texture_2d<f32>;
@group(1) @binding(2) var depth: texture_depth_2d;
@group(1) @binding(3) var normals: texture_2d<f32>;

@fragment
fn fragment(@builtin(position) pixel: vec4<f32>) -> @location(0) vec4<f32> {
    return vec4(filtered(source, depth, normals, settings, pixel.xy));
}
