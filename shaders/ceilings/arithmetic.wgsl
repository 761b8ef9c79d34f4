// defs: GROUP_SIZE=64
// Chains of multiply-adds whose result is a whole number: `factor` and `addend` are 1, which the compiler cannot know.
struct Work {
    turns: u32,
    factor: f32,
    addend: f32,
}

@group(0) @binding(0) var<uniform> work: Work;
@group(0) @binding(1) var<storage, read_write> results: array<f32>;

fn step(x: vec4<f32>) -> vec4<f32> {
    return fma(x, vec4<f32>(work.factor), vec4<f32>(work.addend));
}

// 64 multiply-adds a turn, in eight independent chains: more would not stay in the registers of a CPU.
fn chains() -> f32 {
    var a = vec4<f32>(0.0);
    var b = vec4<f32>(1.0);
    for (var turn = 0u; turn < work.turns; turn++) {
        a = step(a); b = step(b);
        a = step(a); b = step(b);
        a = step(a); b = step(b);
        a = step(a); b = step(b);
        a = step(a); b = step(b);
        a = step(a); b = step(b);
        a = step(a); b = step(b);
        a = step(a); b = step(b);
    }
    return dot(a, vec4<f32>(1.0)) + dot(b, vec4<f32>(1.0));
}

@compute @workgroup_size(#{GROUP_SIZE})
fn compute(@builtin(global_invocation_id) id: vec3<u32>) {
    results[id.x] = chains();
}

@vertex
fn vertex(@builtin(vertex_index) index: u32) -> @builtin(position) vec4<f32> {
    return vec4<f32>(vec2<f32>(vec2<u32>(index & 1u, index >> 1u)) * 4.0 - 1.0, 0.0, 1.0);
}

@fragment
fn fragment() -> @location(0) vec4<f32> {
    return vec4<f32>(chains());
}
