// defs: CONSERVING=0, FRESNEL=0, WATER=0
// A square of regulated size for each photon, added up: UW §3.3.
#import fathom::frame::{frame}
#import fathom::photon::{Photon, angular_weight, entered}
#import fathom::screen

struct Splat {
    // Pixels of the caustics buffer.
    size_px: vec2<f32>,
    // s = size_a_px + size_b_px_m / distance to the viewer (UW §3.3).
    size_a_px: f32,
    size_b_px_m: f32,
    // I_photon: flux of a photon, W.
    photon_w: f32,
    // Splats are tested this much nearer to the camera than their photon, so that the surface they lie on does not hide them.
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
}

// Outside the clip volume: drawn by no rasterizer.
const NOWHERE: vec4<f32> = vec4<f32>(2.0, 2.0, 2.0, 1.0);

@vertex
fn vertex(@builtin(vertex_index) vertex: u32, @builtin(instance_index) instance: u32) -> Varying {
    let index = instance * settings.photons_per_instance + vertex / 4u;
    if index >= settings.photons {
        return Varying(NOWHERE, 0.0);
    }
    let photon = photons[index];
    let clip = frame.camera_view_projection * vec4(photon.hit_m, 1.0);
    if photon.residual_m < 0.0 || clip.w < frame.z_near_m {
        return Varying(NOWHERE, 0.0);
    }
    let to_viewer = frame.camera_position_m - photon.hit_m;
    let viewer_distance = length(to_viewer);
    let side_px = settings.size_a_px + settings.size_b_px_m / viewer_distance;
    let corner = vec2(f32(vertex & 1u), f32((vertex >> 1u) & 1u)) - 0.5;
    let center = clip.xy / clip.w + corner * side_px * 2.0 / settings.size_px;

    let nearer = photon.hit_m + to_viewer * (settings.depth_bias_m / viewer_distance);
    let biased = frame.camera_view_projection * vec4(nearer, 1.0);
    let depth = max(biased.z / max(biased.w, frame.z_near_m), 0.0);

    var intensity = settings.photon_w * exp(-frame.attenuation_per_m * photon.distance_m);
#if FRESNEL == 1
    intensity *= entered(photon);
#endif
#if CONSERVING == 1
    intensity *= angular_weight(photon.entry_m) / (side_px * side_px);
#endif
    return Varying(vec4(center, depth, 1.0), intensity);
}

@fragment
fn fragment(in: Varying) -> @location(0) vec4<f32> {
    return vec4(in.intensity);
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
