// A surface of a layer in 128 bits. Normals are folded onto an octahedron (Cigolle et al., A Survey of Efficient Representations for
// Independent Unit Vectors, 2014, §3), the shading normal with 20 bits along each axis, the geometric normal with 16. Beside the first are
// the upper 24 bits of the optics' float. A shading normal is off by 3e-6 at most, a refractive index by 1e-5; 16-bit floats turn a
// reflected ray by up to 1e-3. The plane is kept by its distance: depth from a rasterizer, which moves corners by up to 1/32 of a pixel,
// puts a floor at a grazing angle off by centimetres.
#define_import_path fathom::surface_texel

struct Surface {
    // Unit normal interpolated between the vertices: for shading, and for how light is reflected and refracted.
    shading_normal: vec3<f32>,
    // What becomes of light there: `fathom::optics`.
    optics: f32,
    // Unit normal of the triangle, on the side of its vertices' normals: for where light meets it, and from which side.
    geometric_normal: vec3<f32>,
    // Distance of the triangle's plane from the camera along that normal.
    plane_m: f32,
}

// The middle of 20 and of 16 bits. One step less leads to a corner of the octahedron: 0 and ±1 are exact.
const FINE: i32 = 524288;
const COARSE: i32 = 32768;

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

fn unfolded_normal(v: vec2<f32>) -> vec3<f32> {
    let z = 1.0 - abs(v.x) - abs(v.y);
    return normalize(vec3(select(folded(v), v, z >= 0.0), z));
}

fn unfolded_steps(steps: vec2<u32>, middle: i32) -> vec3<f32> {
    return unfolded_normal(vec2<f32>(vec2<i32>(steps) - middle) / f32(middle - 1));
}

fn steps_of(normal: vec3<f32>, middle: i32) -> vec2<u32> {
    return vec2<u32>(vec2<i32>(round(folded_normal(normal) * f32(middle - 1))) + middle);
}

// `from_camera_m` leads from the camera to a place on the triangle.
fn packed(shading_normal: vec3<f32>, optics: f32, geometric_normal: vec3<f32>, from_camera_m: vec3<f32>) -> vec4<u32> {
    let shading = steps_of(shading_normal, FINE);
    let kept = (bitcast<u32>(optics) + 0x80u) & 0xffffff00u;
    let geometric = steps_of(geometric_normal, COARSE);
    let plane_m = dot(unfolded_steps(geometric, COARSE), from_camera_m);
    return vec4(
        shading.x | (shading.y << 20u), (shading.y >> 12u) | kept, geometric.x | (geometric.y << 16u), bitcast<u32>(plane_m)
    );
}

fn unpacked(texel: vec4<u32>) -> Surface {
    let shading = vec2(texel.x & 0xfffffu, (texel.x >> 20u) | ((texel.y & 0xffu) << 12u));
    let geometric = unfolded_steps(vec2(texel.z & 0xffffu, texel.z >> 16u), COARSE);
    return Surface(
        unfolded_steps(shading, FINE), bitcast<f32>(texel.y & 0xffffff00u), geometric, bitcast<f32>(texel.w)
    );
}
