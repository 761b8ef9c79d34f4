// Water surface as the light sees it first, UW §3 step 2b: photons that land elsewhere never enter the water.
// defs: WATER=0
#import fathom::host::{MaskUniforms}
#import fathom::uniforms::{frame}
#import fathom::water

@group(1) @binding(0) var<uniform> settings: MaskUniforms;

@vertex
fn vertex(@builtin(vertex_index) index: u32) -> @builtin(position) vec4<f32> {
    return frame.light_view_projection * vec4(water::grid_vertex(index, settings.cells), 1.0);
}

@fragment
fn fragment() -> @location(0) vec4<f32> {
    return vec4(1.0);
}
