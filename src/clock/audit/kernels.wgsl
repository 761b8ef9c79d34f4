// Kernels whose run times are proportional to `work.iterations`. Host twins of the constants: kernels.rs.
const GROUP_SIZE = 64u;
const QUADS_PER_EDGE = 32u;
const VERTEX_SHARE = 10u;

struct Work {
    iterations: u32,
}

@group(0) @binding(0) var<uniform> work: Work;
@group(0) @binding(1) var<storage, read_write> results: array<f32>;

// `iterations` dependent steps of the logistic map. Its chaos keeps a compiler from finding a
// closed form, and the result must be written somewhere, or the loop is dropped.
fn logistic(seed: f32, iterations: u32) -> f32 {
    var x = fract(seed * 0.61803399) * 0.9 + 0.05;
    for (var i = 0u; i < iterations; i++) {
        x = 3.99 * x * (1.0 - x);
    }
    return x;
}

@compute @workgroup_size(GROUP_SIZE)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x < arrayLength(&results) {
        results[id.x] = logistic(f32(id.x), work.iterations);
    }
}

// A grid of quads over the whole target, with work in the vertex and in the fragment stage: a driver may run the vertices of a
// pass before it writes the pass's begin.
struct Corner {
    @builtin(position) position: vec4<f32>,
    @location(0) @interpolate(flat, either) shade: f32,
}

@vertex
fn vertex(@builtin(vertex_index) index: u32) -> Corner {
    let quad = index / 6u;
    // Corners 0 1 2, 2 1 3 of the unit square.
    let corner = array<u32, 6>(0u, 1u, 2u, 2u, 1u, 3u)[index % 6u];
    let cell = vec2<u32>(quad % QUADS_PER_EDGE, quad / QUADS_PER_EDGE);
    let place = vec2<f32>(cell + vec2<u32>(corner & 1u, corner >> 1u)) / f32(QUADS_PER_EDGE);
    let shade = logistic(f32(index), work.iterations * VERTEX_SHARE);
    return Corner(vec4<f32>(place * 2.0 - 1.0, 0.0, 1.0), shade);
}

@fragment
fn fragment(corner: Corner) -> @location(0) vec4<f32> {
    let value = logistic(corner.position.x + 0.37 * corner.position.y, work.iterations);
    return vec4<f32>(value, corner.shade, value, 1.0);
}
