// defs: CONSERVING=0, FRESNEL=0, SURFACE=0, WATER=0, STEP=0
// A square of regulated size for each photon, added up: UW §3.3. Either by compute shaders in the three steps of `main`, or by the
// rasterizer as in the paper: `depth_vertex` and `depth_fragment` bring the depth, `vertex` and `fragment` draw.
// SURFACE 0: a splat faces the camera and lies over all that is behind it, as in UW; 1: it lies in the plane of its photon's
// surface, and pixels of other surfaces are left out.
#import fathom::dispatch
#import fathom::photon::{Photon}
#import fathom::screen
#import fathom::splat::{Splat, square}
#if SURFACE == 1
#import fathom::splat::{in_surface}
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

#if STEP == 1
// Adds `lower` + 2³² · `upper` steps to the sum of a pixel.
fn add(pixel: u32, pixels: u32, lower: u32, upper: u32) {
    let before = atomicAdd(&sums[pixel], lower);
    let carried = upper + select(0u, 1u, before > 0xffffffffu - lower);
    if carried > 0u {
        atomicAdd(&sums[pixels + pixel], carried);
    }
}

// Adds a photon to the pixels of its square in which nothing hides it.
@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let index = dispatch::invocation_index(id, groups);
    if index >= settings.photons {
        return;
    }
    let splat = square(settings, photons[index], scene_depth);
    let size = vec2<u32>(settings.size_px);
    let first = vec2<u32>(splat.first);
    let end = vec2<u32>(splat.end);
    let steps = round(splat.intensity * settings.steps);
    let upper = floor(steps / UPPER);
    let lower = steps - upper * UPPER;
    let first_row = first.y + SPLAT_ROWS * id.z;
    for (var y = first_row; y < min(first_row + SPLAT_ROWS, end.y); y++) {
        let row = y * size.x;
        for (var pixel = row + first.x; pixel < row + end.x; pixel++) {
#if SURFACE == 1
            let from_center = vec2(f32(pixel - row), f32(y)) - splat.center_px;
            let seen = in_surface(settings, vec2(splat.depth, splat.photon_z), splat.slope, from_center, depths[pixel]);
#else
            let seen = splat.depth <= depths[pixel];
#endif
            if seen {
                add(pixel, size.x * size.y, u32(lower), u32(upper));
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
#if SURFACE == 1
    // What a pixel gets, and device depths of splat and photon. Flat: what is clamped or not linear on the screen must not be interpolated
    // between the corners.
    @location(0) @interpolate(flat) intensity: vec3<f32>,
    // Place of the splat's middle, and the change of device depth per pixel on its surface.
    @location(1) @interpolate(flat) plane: vec4<f32>,
#else
    @location(0) @interpolate(flat) intensity: f32,
#endif
}

@vertex
fn vertex(@builtin(vertex_index) vertex: u32, @builtin(instance_index) instance: u32) -> Varying {
    var drawn: Varying;
    drawn.clip = screen::NOT_DRAWN;
    let index = instance * settings.photons_per_instance + vertex / 4u;
    if index >= settings.photons {
        return drawn;
    }
    let splat = square(settings, photons[index], scene_depth);
    if any(splat.first >= splat.end) {
        return drawn;
    }
    // The quad covers whole pixels: rasterizers move corners by up to 1/32 of a pixel, and must not decide about a pixel by that.
    let corner = select(splat.first, splat.end, vec2((vertex & 1u) != 0u, (vertex & 2u) != 0u));
    let position = (corner / settings.size_px * 2.0 - 1.0) * vec2(1.0, -1.0);
    var depth = splat.depth;
#if SURFACE == 1
    // The nearest of the pixels' depths: what is behind it in none is left out early, and the fragment decides about the others.
    let ahead = splat.slope * (splat.first - splat.center_px);
    let behind = splat.slope * (splat.end - 1.0 - splat.center_px);
    let nearest = min(ahead, behind);
    depth = max(depth + nearest.x + nearest.y, 0.0);
    drawn.plane = vec4(splat.center_px, splat.slope);
    drawn.intensity = vec3(splat.intensity, splat.depth, splat.photon_z);
#else
    drawn.intensity = splat.intensity;
#endif
    drawn.clip = vec4(position, depth, 1.0);
    return drawn;
}

@fragment
fn fragment(in: Varying) -> @location(0) vec4<f32> {
#if SURFACE == 1
    let seen = screen::depth_at(scene_depth, in.clip.xy, settings.size_px);
    let from_center = in.clip.xy - 0.5 - in.plane.xy;
    let lit = in_surface(settings, in.intensity.yz, in.plane.zw, from_center, seen);
    return vec4(select(0.0, in.intensity.x, lit));
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
