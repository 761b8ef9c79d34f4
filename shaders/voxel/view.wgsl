// Full voxels as cubes, seen from the camera. VAO Fig. 2.
#import fathom::uniforms::{focal_lengths, frame}
#import fathom::screen::{corner}
#import fathom::voxels::{Grid, index_of, to_cells}

@group(1) @binding(0) var<uniform> grid: Grid;
@group(1) @binding(1) var<storage, read> bits: array<u32>;

// Reflectance of a cube, and of its edges.
const CUBE: vec3<f32> = vec3<f32>(0.74, 0.72, 0.68);
const EDGE: vec3<f32> = vec3<f32>(0.42, 0.40, 0.37);
// Width of the edges, voxels.
const EDGE_WIDTH: f32 = 0.05;
// Edges fade out where voxels are fewer pixels than the first number, and are plain from the second on.
const EDGE_PX: vec2<f32> = vec2<f32>(4.0, 12.0);
// Light from all around, as a share of the light's own.
const AMBIENT: f32 = 0.3;
const GAMMA: f32 = 2.2;

struct Varying {
    @builtin(position) clip: vec4<f32>,
    @location(0) ndc: vec2<f32>,
}

struct Seen {
    @location(0) color: vec4<f32>,
    @builtin(frag_depth) depth: f32,
}

struct Hit {
    found: bool,
    // Voxels along the ray.
    distance: f32,
    // Axis of the side that was met.
    axis: u32,
}

@vertex
fn vertex(@builtin(vertex_index) index: u32) -> Varying {
    let clip = corner(index);
    return Varying(clip, clip.xy);
}

fn is_full(cell: vec3<i32>) -> bool {
    let index = index_of(grid, vec3<u32>(cell));
    return (bits[index >> 5u] >> (index & 31u) & 1u) == 1u;
}

fn smallest(v: vec3<f32>) -> u32 {
    return select(select(2u, 1u, v.y <= v.z), 0u, v.x <= min(v.y, v.z));
}

// Walks the voxels along a ray, both in voxels: Amanatides and Woo, A Fast Voxel Traversal Algorithm, 1987.
fn walk(origin: vec3<f32>, direction: vec3<f32>) -> Hit {
    let n = vec3<f32>(grid.cells);
    // A ray along a plane of voxels crosses none of its kind.
    let safe = select(direction, vec3(1e-12), abs(direction) < vec3(1e-12));
    let enter = min((vec3(0.0) - origin) / safe, (n - origin) / safe);
    let leave = max((vec3(0.0) - origin) / safe, (n - origin) / safe);
    var at = max(max(enter.x, max(enter.y, enter.z)), 0.0);
    if at >= min(leave.x, min(leave.y, leave.z)) {
        return Hit(false, 0.0, 0u);
    }
    var axis = smallest(-enter);
    let forward = vec3<i32>(sign(safe));
    let last = vec3<i32>(grid.cells) - 1;
    var cell = clamp(vec3<i32>(floor(origin + safe * at)), vec3(0), last);
    var next = (vec3<f32>(cell + max(forward, vec3(0))) - origin) / safe;
    for (var i = 0u; i < grid.cells.x + grid.cells.y + grid.cells.z; i++) {
        if is_full(cell) {
            return Hit(true, at, axis);
        }
        axis = smallest(next);
        at = next[axis];
        cell[axis] += forward[axis];
        next[axis] += abs(1.0 / safe[axis]);
        if cell[axis] < 0 || cell[axis] > last[axis] {
            break;
        }
    }
    return Hit(false, 0.0, 0u);
}

// How plain the edges of voxels are at a point; `pixel` is the side of a pixel in the clip square.
fn plainness(clip_w: f32, pixel: f32) -> f32 {
    let voxel_px = grid.voxel_m * focal_lengths().y / (clip_w * pixel);
    return saturate((voxel_px - EDGE_PX.x) / (EDGE_PX.y - EDGE_PX.x));
}

@fragment
fn fragment(in: Varying) -> Seen {
    let pixel = fwidth(in.ndc.y);
    let world = frame.camera_inverse * vec4(in.ndc, 0.0, 1.0);
    let near = to_cells(grid, world.xyz / world.w);
    let direction = normalize(world.xyz / world.w - frame.camera_position_m);
    let hit = walk(near, direction);
    if !hit.found {
        discard;
    }
    let met = near + direction * hit.distance;
    let clip = frame.camera_view_projection * vec4(grid.origin_m + grid.voxel_m * met, 1.0);
    var normal = vec3(0.0);
    normal[hit.axis] = -sign(direction[hit.axis]);
    // The coordinate along the normal is at a voxel's side: it is no edge of the face.
    var within = abs(fract(met) - 0.5);
    within[hit.axis] = 0.0;
    let is_edge = max(within.x, max(within.y, within.z)) > 0.5 - EDGE_WIDTH;
    let edge = select(0.0, plainness(clip.w, pixel), is_edge);
    let facing = max(dot(normal, -frame.light_forward), 0.0);
    let color = mix(CUBE, EDGE, edge) * (AMBIENT + (1.0 - AMBIENT) * facing);
    return Seen(vec4(pow(color, vec3(1.0 / GAMMA)), 1.0), clip.z / clip.w);
}
