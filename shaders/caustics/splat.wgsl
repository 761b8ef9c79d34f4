// defs: CONSERVING=0, FRESNEL=0, SURFACE=0, WATER=0
// A square of regulated size for each photon, added up: UW §3.3. SURFACE 0: a splat faces the camera and lies over all that is
// behind it, as in UW; 1: it lies in the plane of its photon's surface, and pixels of other surfaces are left out.
#import fathom::frame::{frame}
#import fathom::photon::{Photon, angular_weight, entered}
#import fathom::screen
#if SURFACE == 1
#import fathom::frame::{device_depth_at, view_depth_m}
#import fathom::surface_plane::{depth_texel, plane_at}
#endif

struct Splat {
    // Pixels of the caustics buffer.
    size_px: vec2<f32>,
    // s = size_a_px + size_b_px_m / distance to the viewer (UW §3.3).
    size_a_px: f32,
    size_b_px_m: f32,
    // I_photon: flux of a photon, W.
    photon_w: f32,
    // Splats are tested this much nearer to the camera than their photon, so that the surface they lie on does not hide them.
    // SURFACE 1: pixels whose surface is this much farther than the splat are left out too.
    depth_bias_m: f32,
    // Photons that one instance of the index pattern draws.
    photons_per_instance: u32,
    photons: u32,
}

@group(1) @binding(0) var<uniform> settings: Splat;
@group(1) @binding(1) var<storage, read> photons: array<Photon>;
@group(1) @binding(2) var scene_depth: texture_depth_2d;

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

fn nowhere() -> Varying {
    var hidden: Varying;
    hidden.clip = NOWHERE;
    return hidden;
}

#if SURFACE == 1
// Change of device depth per pixel of this buffer, to the right and downwards, of the surface behind a place of the buffer; 0 where
// something else than the photon's surface is seen there.
fn surface_slope(place_px: vec2<f32>, view_m: f32) -> vec2<f32> {
    let texels = vec2<f32>(textureDimensions(scene_depth));
    let texel = clamp(depth_texel(scene_depth, place_px, settings.size_px), vec2(0), vec2<i32>(texels) - 1);
    let plane = plane_at(scene_depth, texel);
    if abs(view_depth_m(plane.z) - view_m) > settings.depth_bias_m {
        return vec2(0.0);
    }
    return plane.slope * texels / settings.size_px;
}
#endif

@vertex
fn vertex(@builtin(vertex_index) vertex: u32, @builtin(instance_index) instance: u32) -> Varying {
    let index = instance * settings.photons_per_instance + vertex / 4u;
    if index >= settings.photons {
        return nowhere();
    }
    let photon = photons[index];
    let clip = frame.camera_view_projection * vec4(photon.hit_m, 1.0);
    if photon.residual_m < 0.0 || clip.w < frame.z_near_m {
        return nowhere();
    }
    let to_viewer = frame.camera_position_m - photon.hit_m;
    let viewer_distance = length(to_viewer);
    let side_px = settings.size_a_px + settings.size_b_px_m / viewer_distance;
    let corner = vec2(f32(vertex & 1u), f32((vertex >> 1u) & 1u)) - 0.5;
    let center = clip.xy / clip.w + corner * side_px * 2.0 / settings.size_px;

    let nearer = photon.hit_m + to_viewer * (settings.depth_bias_m / viewer_distance);
    let biased = frame.camera_view_projection * vec4(nearer, 1.0);
    var depth = max(biased.z / max(biased.w, frame.z_near_m), 0.0);
#if SURFACE == 1
    let place_px = (clip.xy / clip.w * vec2(0.5, -0.5) + 0.5) * settings.size_px;
    let rise = dot(surface_slope(place_px, clip.w), corner * vec2(1.0, -1.0) * side_px);
    depth = clamp(depth + rise, 0.0, 1.0);
    let plane_m = view_depth_m(clamp(clip.z / clip.w + rise, 0.0, 1.0));
    let last_z = device_depth_at(plane_m + settings.depth_bias_m);
#endif

    var intensity = settings.photon_w * exp(-frame.attenuation_per_m * photon.distance_m);
#if FRESNEL == 1
    intensity *= entered(photon);
#endif
#if CONSERVING == 1
    intensity *= angular_weight(photon.entry_m) / (side_px * side_px);
#endif
    var drawn: Varying;
    drawn.clip = vec4(center, depth, 1.0);
    drawn.intensity = intensity;
#if SURFACE == 1
    drawn.last_z = last_z;
#endif
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
