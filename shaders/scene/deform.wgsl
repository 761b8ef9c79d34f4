// Moves vertices and their normals from rest to where they are at this moment.
// defs: MOTION=0
//
// Motions: 0 spin, 1 twist, 2 wave.
#import fathom::dispatch::{GROUP, invocation_index}
#import fathom::math::{TAU}

struct Deform {
    vertices: u32,
    // Cycles since time 0, their whole part left out.
    cycles: f32,
    // Share of an object's height, or turns.
    amplitude: f32,
}

struct Pivot {
    // Middle of the object's foot.
    foot_m: vec3<f32>,
    height_m: f32,
}

@group(0) @binding(0) var<uniform> deform: Deform;
@group(0) @binding(1) var<storage, read> pivots: array<Pivot>;
// Seven words a vertex: position, normal, object.
@group(0) @binding(2) var<storage, read> rest: array<u32>;
@group(0) @binding(3) var<storage, read_write> vertices: array<u32>;

struct Corner {
    // From the pivot's foot.
    position_m: vec3<f32>,
    normal: vec3<f32>,
}

// A right-handed rotation about y: from x towards −z.
fn rotated(v: vec3<f32>, angle: f32) -> vec3<f32> {
    let c = cos(angle);
    let s = sin(angle);
    return vec3(c * v.x + s * v.z, v.y, c * v.z - s * v.x);
}

#if MOTION == 0
fn moved(at: Corner, height_m: f32, per_height: f32) -> Corner {
    let angle = TAU * deform.cycles;
    return Corner(rotated(at.position_m, angle), rotated(at.normal, angle));
}
#else if MOTION == 1
// The normal is that of the map's inverse transpose: it stays across to tangents that lean with the twist.
fn moved(at: Corner, height_m: f32, per_height: f32) -> Corner {
    let lean = TAU * deform.amplitude * sin(TAU * deform.cycles) * per_height;
    let position = rotated(at.position_m, lean * at.position_m.y);
    var normal = rotated(at.normal, lean * at.position_m.y);
    normal.y -= lean * dot(vec2(position.z, -position.x), normal.xz);
    return Corner(position, normalize(normal));
}
#else
// One wave over the object's height, moving up. The normal leans against the slope of the displacement along the surface;
// the surface's own curvature is left out (Blinn, Simulation of Wrinkled Surfaces, 1978).
fn moved(at: Corner, height_m: f32, per_height: f32) -> Corner {
    let phase = TAU * (at.position_m.y * per_height - deform.cycles);
    let slope = TAU * deform.amplitude * height_m * per_height * cos(phase);
    let along = vec3(0.0, 1.0, 0.0) - at.normal.y * at.normal;
    let position = at.position_m + deform.amplitude * height_m * sin(phase) * at.normal;
    return Corner(position, normalize(at.normal - slope * along));
}
#endif

fn float3(first: u32) -> vec3<f32> {
    return bitcast<vec3<f32>>(vec3(rest[first], rest[first + 1u], rest[first + 2u]));
}

fn store(first: u32, value: vec3<f32>) {
    let words = bitcast<vec3<u32>>(value);
    vertices[first] = words.x;
    vertices[first + 1u] = words.y;
    vertices[first + 2u] = words.z;
}

@compute @workgroup_size(GROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let number = invocation_index(id, groups);
    if number >= deform.vertices {
        return;
    }
    let first = 7u * number;
    let pivot = pivots[rest[first + 6u]];
    // Flat objects have no height for a motion to grow with: they spin alone.
    let per_height = select(0.0, 1.0 / pivot.height_m, pivot.height_m > 0.0);
    let now = moved(Corner(float3(first) - pivot.foot_m, float3(first + 3u)), pivot.height_m, per_height);
    store(first, now.position_m + pivot.foot_m);
    store(first + 3u, now.normal);
}
