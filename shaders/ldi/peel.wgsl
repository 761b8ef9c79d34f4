// defs: FIRST=1
// One layer of the layered depth image: the nearest surface behind the layer before. Everitt, Interactive Order-Independent
// Transparency, 2001, as SPT §2.2 uses it. The depths that the pass tests are the layer's: no shader writes them, so hardware may
// reject fragments before they are shaded. A fragment's `position.z` is the depth that is tested and kept of it;
// `verify` would find a layer twice where it were not.
#import fathom::uniforms::{frame}
#import fathom::surface::{Material}
#import fathom::surface_texel::{packed}

@group(1) @binding(0) var<storage, read> materials: array<Material>;
// Seven words a vertex: position, normal, material.
@group(1) @binding(1) var<storage, read> vertices: array<u32>;
@group(1) @binding(2) var<storage, read> indices: array<u32>;
#if FIRST == 0
@group(1) @binding(3) var before: texture_depth_2d;
#endif

struct Varying {
    @builtin(position) @invariant clip: vec4<f32>,
    @location(0) shading_normal: vec3<f32>,
    @location(1) @interpolate(flat) geometric_normal: vec3<f32>,
    @location(2) @interpolate(flat) optics: f32,
    @location(3) from_camera_m: vec3<f32>,
}

struct Corner {
    position_m: vec3<f32>,
    normal: vec3<f32>,
    material: u32,
}

fn corner(number: u32) -> Corner {
    let first = 7u * indices[number];
    let position = vec3(vertices[first], vertices[first + 1u], vertices[first + 2u]);
    let normal = vec3(vertices[first + 3u], vertices[first + 4u], vertices[first + 5u]);
    return Corner(bitcast<vec3<f32>>(position), bitcast<vec3<f32>>(normal), vertices[first + 6u]);
}

// Drawn without an index buffer: a vertex that triangles share does not know theirs. Interpolated normals would do for none of the tests
// that rays make: those of a box with eight corners point along its diagonals.
@vertex
fn vertex(@builtin(vertex_index) number: u32) -> Varying {
    let first = number - number % 3u;
    let corners = array(corner(first), corner(first + 1u), corner(first + 2u));
    let origin = corners[0].position_m;
    let plane = normalize(cross(corners[1].position_m - origin, corners[2].position_m - origin));
    let outwards = corners[0].normal + corners[1].normal + corners[2].normal;
    let own = corners[number - first];
    let clip = frame.camera_view_projection * vec4(own.position_m, 1.0);
    let geometric = select(plane, -plane, dot(plane, outwards) < 0.0);
    let from_camera_m = own.position_m - frame.camera_position_m;
    return Varying(clip, own.normal, geometric, materials[own.material].optics, from_camera_m);
}

@fragment
fn fragment(in: Varying) -> @location(0) vec4<u32> {
#if FIRST == 0
    if in.clip.z <= textureLoad(before, vec2<i32>(in.clip.xy), 0) {
        discard;
    }
#endif
    return packed(in.shading_normal, in.optics, in.geometric_normal, in.from_camera_m);
}
