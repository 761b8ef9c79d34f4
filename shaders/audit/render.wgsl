// defs: QUADS_PER_EDGE=32, VERTEX_SHARE=10
// A grid of quads over the whole target, with work proportional to `work.iterations` in the vertex and
// in the fragment stage: a driver may run the vertices of a pass before it writes the pass's begin.
#import fathom::busy_work::logistic

struct Work {
    iterations: u32,
}

struct Corner {
    @builtin(position) position: vec4<f32>,
    @location(0) @interpolate(flat, either) shade: f32,
}

@group(0) @binding(0) var<uniform> work: Work;

@vertex
fn vertex(@builtin(vertex_index) index: u32) -> Corner {
    let quad = index / 6u;
    // Corners 0 1 2, 2 1 3 of the unit square.
    let corner = array<u32, 6>(0u, 1u, 2u, 2u, 1u, 3u)[index % 6u];
    let cell = vec2<u32>(quad % #{QUADS_PER_EDGE}u, quad / #{QUADS_PER_EDGE}u);
    let place = vec2<f32>(cell + vec2<u32>(corner & 1u, corner >> 1u)) / #{QUADS_PER_EDGE}.0;
    let shade = logistic(f32(index), work.iterations * #{VERTEX_SHARE}u);
    return Corner(vec4<f32>(place * 2.0 - 1.0, 0.0, 1.0), shade);
}

@fragment
fn fragment(corner: Corner) -> @location(0) vec4<f32> {
    let value = logistic(corner.position.x + 0.37 * corner.position.y, work.iterations);
    return vec4<f32>(value, corner.shade, value, 1.0);
}
