// The square that a photon covers in the caustics buffer: UW §3.3.
#define_import_path fathom::splat

#import fathom::frame::{frame}
#import fathom::photon::{Photon, angular_weight, entered}

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
    // Steps of a fixed-point sum in a unit of intensity.
    steps: f32,
    photons: u32,
    // Photons that one instance of the rasterizer's index pattern draws.
    photons_per_instance: u32,
}

struct Square {
    // In canonical screen space.
    center: vec2<f32>,
    // 0 for a photon that adds nothing.
    side_px: f32,
    // As the camera's depth buffer has it.
    depth: f32,
    // What each pixel gets.
    intensity: f32,
}

const NOTHING: Square = Square(vec2<f32>(0.0), 0.0, 0.0, 0.0);

fn square(settings: Splat, photon: Photon) -> Square {
    let clip = frame.camera_view_projection * vec4(photon.hit_m, 1.0);
    if photon.residual_m < 0.0 || clip.w < frame.z_near_m {
        return NOTHING;
    }
    let to_viewer = frame.camera_position_m - photon.hit_m;
    let viewer_distance = length(to_viewer);
    let side_px = settings.size_a_px + settings.size_b_px_m / viewer_distance;

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
    return Square(clip.xy / clip.w, side_px, depth, intensity);
}
