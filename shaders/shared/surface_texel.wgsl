// A surface of a layer in 128 bits. Its shading normal is folded onto an octahedron, 20 bits along each axis (Cigolle et al., A Survey of
// Efficient Representations for Independent Unit Vectors, 2014, §3), with the upper 24 bits of the optics' float: a direction is off by
// 3e-6 at most, a refractive index by 1e-5. 16-bit floats turn a reflected ray by up to 1e-3. The geometric normal is folded likewise and
// keeps its two 32-bit floats: crossings lie many pixels from the texel's middle where a surface is seen at a grazing angle.
#define_import_path fathom::surface_texel

struct Surface {
    // Unit normal interpolated between the vertices: for shading, and for how light is reflected and refracted.
    shading_normal: vec3<f32>,
    // What becomes of light there: `fathom::optics`.
    optics: f32,
    // Unit normal of the triangle, on the side of its vertices' normals: for where light meets it, and from which side.
    geometric_normal: vec3<f32>,
}

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

// Where a direction lies on the octahedron.
fn folded_normal(normal: vec3<f32>) -> vec2<f32> {
    let n = normal / (abs(normal.x) + abs(normal.y) + abs(normal.z));
    return select(folded(n.xy), n.xy, n.z >= 0.0);
}

fn unfolded_normal(place: vec2<f32>) -> vec3<f32> {
    let z = 1.0 - abs(place.x) - abs(place.y);
    return normalize(vec3(select(folded(place), place, z >= 0.0), z));
}

fn packed(surface: Surface) -> vec4<u32> {
    let steps = vec2<u32>(vec2<i32>(round(folded_normal(surface.shading_normal) * STEPS)) + MIDDLE);
    let optics = (bitcast<u32>(surface.optics) + 0x80u) & 0xffffff00u;
    let geometric = bitcast<vec2<u32>>(folded_normal(surface.geometric_normal));
    return vec4(steps.x | (steps.y << 20u), (steps.y >> 12u) | optics, geometric);
}

fn unpacked(texel: vec4<u32>) -> Surface {
    let steps = vec2(texel.x & 0xfffffu, (texel.x >> 20u) | ((texel.y & 0xffu) << 12u));
    let shading = unfolded_normal(vec2<f32>(vec2<i32>(steps) - MIDDLE) / STEPS);
    let geometric = unfolded_normal(bitcast<vec2<f32>>(texel.zw));
    return Surface(shading, bitcast<f32>(texel.y & 0xffffff00u), geometric);
}
