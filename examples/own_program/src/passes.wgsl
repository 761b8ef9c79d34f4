// Ripples of a few drops, blurred along rows, and drawn.
const EDGE = 256u;

struct Settings {
    taps: u32,
}

@group(0) @binding(0) var<uniform> settings: Settings;
@group(0) @binding(1) var<storage, read_write> heights: array<f32>;
@group(0) @binding(2) var<storage, read_write> blurred: array<f32>;

@compute @workgroup_size(8, 8)
fn ripple(@builtin(global_invocation_id) id: vec3<u32>) {
    var height = 0.0;
    for (var drop = 0u; drop < 16u; drop++) {
        let place = vec2<f32>(f32(drop * 97u % EDGE), f32(drop * 57u % EDGE));
        let distance = length(vec2<f32>(id.xy) - place);
        height += sin(distance * 0.3) / (1.0 + distance);
    }
    heights[id.y * EDGE + id.x] = height;
}

@compute @workgroup_size(8, 8)
fn blur(@builtin(global_invocation_id) id: vec3<u32>) {
    var sum = 0.0;
    for (var tap = 0u; tap < settings.taps; tap++) {
        sum += heights[id.y * EDGE + (id.x + tap) % EDGE];
    }
    blurred[id.y * EDGE + id.x] = sum / f32(settings.taps);
}

@vertex
fn corner(@builtin(vertex_index) index: u32) -> @builtin(position) vec4<f32> {
    return vec4<f32>(vec2<f32>(vec2<u32>(index & 1u, index >> 1u)) * 4.0 - 1.0, 0.0, 1.0);
}

@group(0) @binding(3) var<storage, read> drawn: array<f32>;

@fragment
fn shade(@builtin(position) position: vec4<f32>) -> @location(0) vec4<f32> {
    let pixel = vec2<u32>(position.xy);
    let height = drawn[pixel.y * EDGE + pixel.x];
    return vec4<f32>(vec3<f32>(0.5 + 0.5 * height), 1.0);
}
