// Triangles against voxels by separating axes, a triangle an invocation: Akenine-Möller, Fast 3D Triangle-Box Overlap
// Testing, 2001, in the order of Schwarz and Seidel, Fast Parallel Surface and Solid Voxelization on GPUs, 2010, §3.
// Host twin: src/stages/voxel/triangles.rs.
//
// Axes are swizzled so that w is the one nearest to the triangle's normal. The triangle's box is walked in columns
// along w: the triangle's projection along w is tested once for the column, its plane bounds the voxels of the column,
// and each of these is tested in the two other projections.
//
// Defs: ALPHA 1 stores the largest alpha beside the bits. STEP is the dispatch: 0 empties the queue, 1 takes the small triangles and leaves
// the others in the queue, 2 takes those.
#define_import_path fathom::triangles

#import fathom::voxels::{Grid, index_of, to_cells}
#import fathom::surface::{Material}
#import fathom::dispatch::{GROUP, invocation_index}

struct Batch {
    first_index: u32,
    triangles: u32,
    // Columns above which a triangle is large, and above which it is huge.
    small_columns: u32,
    large_columns: u32,
}

@group(0) @binding(0) var<uniform> grid: Grid;
@group(0) @binding(1) var<uniform> batch: Batch;
// Seven words a vertex: position, normal, material.
@group(0) @binding(2) var<storage, read> vertices: array<u32>;
@group(0) @binding(3) var<storage, read> indices: array<u32>;
@group(0) @binding(4) var<storage, read_write> bits: array<atomic<u32>>;
// How many triangles are large and how many huge; then the large ones from the front, the huge ones from the back.
@group(0) @binding(5) var<storage, read_write> queue: array<atomic<u32>>;
#if ALPHA == 1
@group(0) @binding(6) var<storage, read> materials: array<Material>;
// 0 … 255 for each voxel.
@group(0) @binding(7) var<storage, read_write> alphas: array<atomic<u32>>;
#endif

// An axis within a plane of projection: where the triangle, grown by a voxel's extent along it, lies.
struct Axis {
    along: vec2<f32>,
    low: f32,
    high: f32,
}

struct Triangle {
    // Which axis is w: 0 z, 1 x, 2 y.
    main_axis: u32,
    // First voxel of the box in swizzled coordinates. All else is measured from it.
    base: vec3<i32>,
    // Last voxel of the box.
    last: vec3<i32>,
    normal: vec3<f32>,
    // The plane, grown by a voxel's extent along the normal.
    low: f32,
    high: f32,
    uv: array<Axis, 3>,
    vw: array<Axis, 3>,
    wu: array<Axis, 3>,
    alpha: u32,
}

fn swizzled(v: vec3<f32>, main_axis: u32) -> vec3<f32> {
    return select(select(v.xyz, v.yzx, main_axis == 1u), v.zxy, main_axis == 2u);
}

fn swizzled_back(v: vec3<i32>, main_axis: u32) -> vec3<i32> {
    return select(select(v.xyz, v.zxy, main_axis == 1u), v.yzx, main_axis == 2u);
}

fn corner(number: u32) -> vec3<f32> {
    let first = 7u * indices[batch.first_index + number];
    let position = vec3(vertices[first], vertices[first + 1u], vertices[first + 2u]);
    return to_cells(grid, bitcast<vec3<f32>>(position));
}

// Half of a voxel's extent along an axis that need not have unit length.
fn extent3(along: vec3<f32>) -> f32 {
    let size = abs(along);
    return 0.5 * (size.x + size.y + size.z);
}

// Rounding of a place along an axis, relative to the sum of its terms' sizes: four units of the last place. A voxel that a
// triangle only touches counts, whichever way its corners were rounded; without this a plane through the diagonals of voxels has
// gaps.
const ROUNDING: f32 = 4.8e-7;
// Largest allowance for rounding, share of a voxel's extent: below the band that `verify` leaves undecided.
const MAX_ROUNDING: f32 = 1e-4;

// Half of a voxel's extent along an axis, and the rounding of the corners' places along it.
fn grown3(along: vec3<f32>, a: vec3<f32>, b: vec3<f32>, c: vec3<f32>) -> f32 {
    let extent = extent3(along);
    let rounding = ROUNDING * dot(abs(along), max(abs(a), max(abs(b), abs(c))));
    return extent + min(rounding, MAX_ROUNDING * extent);
}

fn grown2(along: vec2<f32>, a: vec2<f32>, b: vec2<f32>, c: vec2<f32>) -> f32 {
    return grown3(vec3(along, 0.0), vec3(a, 0.0), vec3(b, 0.0), vec3(c, 0.0));
}

// The axis across an edge. All three corners are projected, so that rounding of the edge costs no voxel.
fn across(edge: vec2<f32>, a: vec2<f32>, b: vec2<f32>, c: vec2<f32>) -> Axis {
    let along = vec2(-edge.y, edge.x);
    let projections = vec3(dot(along, a), dot(along, b), dot(along, c));
    let grown = grown2(along, a, b, c);
    let low = min(projections.x, min(projections.y, projections.z)) - grown;
    return Axis(along, low, max(projections.x, max(projections.y, projections.z)) + grown);
}

fn projected(a: vec2<f32>, b: vec2<f32>, c: vec2<f32>) -> array<Axis, 3> {
    return array(across(b - a, a, b, c), across(c - b, a, b, c), across(a - c, a, b, c));
}

fn overlaps(axes: array<Axis, 3>, center: vec2<f32>) -> bool {
    let projections = vec3(dot(axes[0].along, center), dot(axes[1].along, center), dot(axes[2].along, center));
    let low = vec3(axes[0].low, axes[1].low, axes[2].low);
    let high = vec3(axes[0].high, axes[1].high, axes[2].high);
    return all(projections >= low) && all(projections <= high);
}

fn triangle(number: u32) -> Triangle {
    var a = corner(3u * number);
    var b = corner(3u * number + 1u);
    var c = corner(3u * number + 2u);
    var normal = cross(b - a, c - a);
    let size = abs(normal);
    let main_axis = select(select(2u, 0u, size.z >= size.y), select(1u, 0u, size.z >= size.x), size.x >= size.y);
    a = swizzled(a, main_axis);
    b = swizzled(b, main_axis);
    c = swizzled(c, main_axis);
    normal = swizzled(normal, main_axis);
    let cells = vec3<i32>(swizzled(vec3<f32>(grid.cells), main_axis));

    // A voxel is closed: one that the box only touches counts. Far corners are held near the grid, so that they fit integers.
    let far = vec3<f32>(cells) + 2.0;
    let low = clamp(min(a, min(b, c)), vec3(-2.0), far);
    let high = clamp(max(a, max(b, c)), vec3(-2.0), far);
    let first = max(vec3<i32>(ceil(low)) - 1, vec3(0));
    let last = min(vec3<i32>(floor(high)), cells - 1);
    let origin = vec3<f32>(first);
    a -= origin;
    b -= origin;
    c -= origin;

    let projections = vec3(dot(normal, a), dot(normal, b), dot(normal, c));
    let grown = grown3(normal, a, b, c);
    var found: Triangle;
    found.main_axis = main_axis;
    found.base = first;
    found.last = last - first;
    found.normal = normal;
    found.low = min(projections.x, min(projections.y, projections.z)) - grown;
    found.high = max(projections.x, max(projections.y, projections.z)) + grown;
    found.uv = projected(a.xy, b.xy, c.xy);
    found.vw = projected(a.yz, b.yz, c.yz);
    found.wu = projected(a.zx, b.zx, c.zx);
    found.alpha = 255u;
#if ALPHA == 1
    let material = materials[vertices[7u * indices[batch.first_index + 3u * number] + 6u]];
    found.alpha = u32(255.0 * material.alpha + 0.5);
#endif
    return found;
}

fn columns(t: Triangle) -> u32 {
    let count = max(t.last + 1, vec3(0));
    return select(0u, u32(count.x) * u32(count.y), count.z > 0);
}

fn put(t: Triangle, voxel: vec3<i32>) {
    let index = index_of(grid, vec3<u32>(swizzled_back(t.base + voxel, t.main_axis)));
#if ALPHA == 1
    if t.alpha == 0u {
        return;
    }
    atomicMax(&alphas[index], t.alpha);
#endif
    atomicOr(&bits[index >> 5u], 1u << (index & 31u));
}

// Sets the voxels of one column.
fn fill(t: Triangle, u: i32, v: i32) {
    let center = vec2<f32>(vec2(u, v)) + 0.5;
    if !overlaps(t.uv, center) {
        return;
    }
    var first = 0;
    var last = t.last.z;
    if t.normal.z != 0.0 {
        let ends = (vec2(t.low, t.high) - dot(t.normal.xy, center)) / t.normal.z - 0.5;
        let near = clamp(min(ends.x, ends.y), -1.0, f32(last) + 1.0);
        let far = clamp(max(ends.x, ends.y), -1.0, f32(last) + 1.0);
        first = max(i32(ceil(near)), 0);
        last = min(i32(floor(far)), last);
    }
    for (var w = first; w <= last; w++) {
        let height = f32(w) + 0.5;
        if overlaps(t.vw, vec2(center.y, height)) && overlaps(t.wu, vec2(height, center.x)) {
            put(t, vec3(u, v, w));
        }
    }
}

#if STEP == 0
fn run(id: vec3<u32>, group: vec3<u32>, groups: vec3<u32>, own: u32) {
    if own < 2u {
        atomicStore(&queue[own], 0u);
    }
}
#else if STEP == 1
fn leave(number: u32, is_huge: bool) {
    if is_huge {
        let slot = batch.triangles + 1u - atomicAdd(&queue[1], 1u);
        atomicStore(&queue[slot], number);
    } else {
        let slot = 2u + atomicAdd(&queue[0], 1u);
        atomicStore(&queue[slot], number);
    }
}

// Small triangles, one an invocation; the others go to the queue.
fn run(id: vec3<u32>, group: vec3<u32>, groups: vec3<u32>, own: u32) {
    let number = invocation_index(id, groups);
    if number >= batch.triangles {
        return;
    }
    let t = triangle(number);
    let count = columns(t);
    if count > batch.small_columns {
        leave(number, count > batch.large_columns);
        return;
    }
    var column = vec2(0, 0);
    for (var i = 0u; i < count; i++) {
        fill(t, column.x, column.y);
        column.x++;
        if column.x > t.last.x {
            column = vec2(0, column.y + 1);
        }
    }
}
#else
// Every `step`-th column of a triangle.
fn fill_share(number: u32, first: u32, step: u32) {
    let t = triangle(number);
    let count = columns(t);
    let width = u32(t.last.x + 1);
    for (var k = first; k < count; k += step) {
        fill(t, i32(k % width), i32(k / width));
    }
}

// A workgroup for each large triangle, and all workgroups of a layer of the dispatch for each huge one. There are several layers where
// one would exceed the iterations that adapters allow an invocation.
fn run(id: vec3<u32>, group: vec3<u32>, groups: vec3<u32>, own: u32) {
    let large = atomicLoad(&queue[0]);
    for (var i = group.x + groups.x * group.z; i < large; i += groups.x * groups.z) {
        fill_share(atomicLoad(&queue[2u + i]), own, GROUP);
    }
    let huge = atomicLoad(&queue[1]);
    for (var i = group.z; i < huge; i += groups.z) {
        fill_share(atomicLoad(&queue[batch.triangles + 1u - i]), own + GROUP * group.x, GROUP * groups.x);
    }
}
#endif
