// defs: CONSERVING=0, FRESNEL=0, SURFACE=0, WATER=0, STEP=0
// A square of regulated size for each photon, added up: UW §3.3. Either by compute shaders in the three steps of `main`, or by the
// rasterizer as in the paper: `depth_vertex` and `depth_fragment` bring the depth, `vertex` and `fragment` draw.
// SURFACE 0: a splat faces the camera and lies over all that is behind it, as in UW; 1: it lies in the plane of its photon's
// surface, and pixels of other surfaces are left out.
#import fathom::dispatch
#import fathom::photon::{Photon}
#import fathom::screen
#import fathom::splat::{Splat, Square, square}
#if SURFACE == 1
#import fathom::uniforms::{device_depth_at, frame, view_depth_m}
#endif

@group(1) @binding(0) var<uniform> settings: Splat;
@group(1) @binding(1) var<storage, read> photons: array<Photon>;
@group(1) @binding(2) var scene_depth: texture_depth_2d;
// The lower 32 bits of each pixel's sum, then the upper ones of each.
@group(1) @binding(3) var<storage, read_write> sums: array<atomic<u32>>;
// The camera's depth at each pixel.
@group(1) @binding(4) var<storage, read_write> depths: array<f32>;
@group(1) @binding(5) var image: texture_storage_2d<r32float, write>;

// Rows of pixels of an invocation. Host twin: `ROWS` in src/stages/caustics/splat.rs.
const ROWS: u32 = 8u;
// Rows of a splat that an invocation adds: a larger one is shared by several, along z of the dispatch, as adapters end long loops.
// Host twin: `SPLAT_ROWS`.
const SPLAT_ROWS: u32 = 32u;
const UPPER: f32 = 4294967296.0;
// The largest f32 below 2³².
const MOST_STEPS: f32 = 4294967040.0;

#if STEP == 1
fn add(pixel: u32, pixels: u32, steps: u32) {
    let before = atomicAdd(&sums[pixel], steps);
    if before > 0xffffffffu - steps {
        atomicAdd(&sums[pixels + pixel], 1u);
    }
}

// Whether nothing hides a splat in a pixel: `from_center` pixels from its middle, where the camera sees the depth `seen`.
fn lies_in(splat: Square, from_center: vec2<f32>, seen: f32) -> bool {
#if SURFACE == 1
    let rise = dot(splat.slope, from_center);
    // view(seen) − view(plane) ≤ bias, where view(z) = n f / (f − z (f − n)), multiplied by both denominators.
    let range = frame.z_far_m - frame.z_near_m;
    let over_seen = frame.z_far_m - seen * range;
    let over_plane = frame.z_far_m - clamp(splat.photon_z + rise, 0.0, 1.0) * range;
    let product = frame.z_near_m * frame.z_far_m;
    let near = product * over_plane <= over_seen * (product + settings.depth_bias_m * over_plane);
    return near && clamp(splat.depth + rise, 0.0, 1.0) <= seen;
#else
    return splat.depth <= seen;
#endif
}

// Adds a photon to the pixels whose middles lie in its square, upper and left edge included, and which nothing hides.
@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let index = dispatch::place(id, groups);
    if index >= settings.photons {
        return;
    }
    let splat = square(settings, photons[index], scene_depth);
    let size = vec2<u32>(settings.size_px);
    let center_px = (splat.center * vec2(0.5, -0.5) + 0.5) * settings.size_px - 0.5;
    let half_px = 0.5 * splat.side_px;
    let first = vec2<u32>(clamp(ceil(center_px - half_px), vec2(0.0), settings.size_px));
    let end = vec2<u32>(clamp(ceil(center_px + half_px), vec2(0.0), settings.size_px));
    let steps = u32(min(round(splat.intensity * settings.steps), MOST_STEPS));
    let first_row = first.y + SPLAT_ROWS * id.z;
    for (var y = first_row; y < min(first_row + SPLAT_ROWS, end.y); y++) {
        let row = y * size.x;
        for (var pixel = row + first.x; pixel < row + end.x; pixel++) {
            let from_center = vec2(f32(pixel - row), f32(y)) - center_px;
            if lies_in(splat, from_center, depths[pixel]) {
                add(pixel, size.x * size.y, steps);
            }
        }
    }
}
#else
// Step 0 clears the sums and brings the camera's depth to the size of this buffer. Step 2 turns the sums into the picture.
@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let size = vec2<u32>(settings.size_px);
    if id.x >= size.x {
        return;
    }
    let end = min((id.y + 1u) * ROWS, size.y);
    for (var y = id.y * ROWS; y < end; y++) {
        let lower = y * size.x + id.x;
        let upper = size.x * size.y + lower;
#if STEP == 0
        atomicStore(&sums[lower], 0u);
        atomicStore(&sums[upper], 0u);
        depths[lower] = screen::depth_at(scene_depth, vec2(f32(id.x), f32(y)) + 0.5, settings.size_px);
#else
        let steps = f32(atomicLoad(&sums[upper])) * UPPER + f32(atomicLoad(&sums[lower]));
        textureStore(image, vec2(id.x, y), vec4(steps / settings.steps));
#endif
    }
}
#endif

struct Varying {
    @builtin(position) clip: vec4<f32>,
    @location(0) @interpolate(flat) intensity: f32,
#if SURFACE == 1
    // Device depth beyond which what is seen is not the photon's surface.
    @location(1) last_z: f32,
#endif
}

// Outside the clip volume: drawn by no rasterizer.
const NOWHERE: vec4<f32> = vec4<f32>(2.0, 2.0, 2.0, 1.0);

@vertex
fn vertex(@builtin(vertex_index) vertex: u32, @builtin(instance_index) instance: u32) -> Varying {
    var drawn: Varying;
    drawn.clip = NOWHERE;
    let index = instance * settings.photons_per_instance + vertex / 4u;
    if index >= settings.photons {
        return drawn;
    }
    let splat = square(settings, photons[index], scene_depth);
    if splat.side_px == 0.0 {
        return drawn;
    }
    let corner = vec2(f32(vertex & 1u), f32((vertex >> 1u) & 1u)) - 0.5;
    let place = splat.center + corner * splat.side_px * 2.0 / settings.size_px;
    var depth = splat.depth;
#if SURFACE == 1
    let rise = dot(splat.slope, corner * vec2(1.0, -1.0) * splat.side_px);
    depth = clamp(depth + rise, 0.0, 1.0);
    let plane_m = view_depth_m(clamp(splat.photon_z + rise, 0.0, 1.0));
    drawn.last_z = device_depth_at(plane_m + settings.depth_bias_m);
#endif
    drawn.clip = vec4(place, depth, 1.0);
    drawn.intensity = splat.intensity;
    return drawn;
}

@fragment
fn fragment(in: Varying) -> @location(0) vec4<f32> {
#if SURFACE == 1
    let seen = screen::depth_at(scene_depth, in.clip.xy, settings.size_px);
    return vec4(select(in.intensity, 0.0, seen > in.last_z));
#else
    return vec4(in.intensity);
#endif
}

// The camera's depth brought to the size of this buffer, for the rasterizer's own depth test.
@vertex
fn depth_vertex(@builtin(vertex_index) index: u32) -> @builtin(position) vec4<f32> {
    return screen::corner(index);
}

@fragment
fn depth_fragment(@builtin(position) pixel: vec4<f32>) -> @builtin(frag_depth) f32 {
    return screen::depth_at(scene_depth, pixel.xy, settings.size_px);
}
