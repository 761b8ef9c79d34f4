// Normal and optics of a surface in 64 bits: the normal folded onto an octahedron, 20 bits along each axis (Cigolle et al., A Survey of
// Efficient Representations for Independent Unit Vectors, 2014, §3), and the upper 24 bits of the optics' float. A direction is off by
// 3e-6 at most, a refractive index by 1e-5. 16-bit floats in as many bytes turn a reflected ray by up to 1e-3.
#define_import_path fathom::surface_texel

// Steps from the middle to a corner of the octahedron: 0 and ±1 are exact.
const STEPS: f32 = 524287.0;
const MIDDLE: i32 = 524288;

fn signs(v: vec2<f32>) -> vec2<f32> {
    return select(vec2(-1.0), vec2(1.0), v >= vec2(0.0));
}

// The lower half folded over the upper one, or back.
fn folded(v: vec2<f32>) -> vec2<f32> {
    return (1.0 - abs(v.yx)) * signs(v);
}

fn packed(normal: vec3<f32>, optics: f32) -> vec2<u32> {
    let n = normal / (abs(normal.x) + abs(normal.y) + abs(normal.z));
    let place = select(folded(n.xy), n.xy, n.z >= 0.0);
    let steps = vec2<u32>(vec2<i32>(round(place * STEPS)) + MIDDLE);
    let kept = (bitcast<u32>(optics) + 0x80u) & 0xffffff00u;
    return vec2(steps.x | (steps.y << 20u), (steps.y >> 12u) | kept);
}

// The four channels of a texel of 16-bit integers.
fn channels(words: vec2<u32>) -> vec4<u32> {
    return vec4(words.x & 0xffffu, words.x >> 16u, words.y & 0xffffu, words.y >> 16u);
}

// Unit normal, and what becomes of light there in w.
fn unpacked(texel: vec4<u32>) -> vec4<f32> {
    let words = texel.xz | (texel.yw << vec2(16u));
    let steps = vec2(words.x & 0xfffffu, (words.x >> 20u) | ((words.y & 0xffu) << 12u));
    let place = vec2<f32>(vec2<i32>(steps) - MIDDLE) / STEPS;
    let z = 1.0 - abs(place.x) - abs(place.y);
    let normal = vec3(select(folded(place), place, z >= 0.0), z);
    return vec4(normalize(normal), bitcast<f32>(words.y & 0xffffff00u));
}
