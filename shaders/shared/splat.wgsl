// The square that a photon covers in the caustics buffer: UW §3.3.
#define_import_path fathom::splat

#import fathom::uniforms::{frame}
#import fathom::photon::{Photon, angular_weight, entered, has_landed}
#import fathom::screen::{to_pixels}
#if SURFACE == 1
#import fathom::uniforms::{view_depth_m}
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
    // Steps of a fixed-point sum in a unit of intensity.
    steps: f32,
    photons: u32,
    // Photons that one instance of the rasterizer's index pattern draws.
    photons_per_instance: u32,
}

struct Square {
    // In pixels of the buffer, whose middles have whole numbers.
    center_px: vec2<f32>,
    // Pixels of the buffer whose middles lie in the square, upper and left edge included: from the first one to the one before the end.
    // None for a photon that adds nothing.
    first: vec2<f32>,
    end: vec2<f32>,
    // As the camera's depth buffer has it.
    depth: f32,
    // What each pixel gets.
    intensity: f32,
    // Device depth of the photon, and its change per pixel, to the right and downwards, on the photon's surface.
    photon_z: f32,
    slope: vec2<f32>,
}

#if SURFACE == 1
// Change of device depth per pixel of the surface behind a place of the buffer; 0 where something else than the photon's surface is
// seen there. Beyond the picture the surface at its border goes on.
fn surface_slope(settings: Splat, scene_depth: texture_depth_2d, position_px: vec2<f32>, view_m: f32) -> vec2<f32> {
    let texels = vec2<f32>(textureDimensions(scene_depth));
    let texel = clamp(depth_texel(scene_depth, position_px, settings.size_px), vec2(0), vec2<i32>(texels) - 1);
    let plane = plane_at(scene_depth, texel);
    let texel_px = texels / settings.size_px;
    let beyond = (position_px - clamp(position_px, vec2(0.0), settings.size_px)) * texel_px;
    if abs(view_depth_m(plane.z + dot(plane.slope, beyond)) - view_m) > settings.depth_bias_m {
        return vec2(0.0);
    }
    return plane.slope * texel_px;
}
#endif

fn square(settings: Splat, photon: Photon, scene_depth: texture_depth_2d) -> Square {
    var splat: Square;
    let clip = frame.camera_view_projection * vec4(photon.hit_m, 1.0);
    if !has_landed(photon) || clip.w < frame.z_near_m {
        return splat;
    }
    let to_viewer = frame.camera_position_m - photon.hit_m;
    let viewer_distance = length(to_viewer);
    let side_px = settings.size_a_px + settings.size_b_px_m / viewer_distance;
    let position_px = to_pixels(clip.xy / clip.w, settings.size_px);
    splat.center_px = position_px - 0.5;
    splat.first = clamp(ceil(splat.center_px - 0.5 * side_px), vec2(0.0), settings.size_px);
    splat.end = clamp(ceil(splat.center_px + 0.5 * side_px), vec2(0.0), settings.size_px);

    let nearer = photon.hit_m + to_viewer * (settings.depth_bias_m / viewer_distance);
    let biased = frame.camera_view_projection * vec4(nearer, 1.0);
    splat.depth = max(biased.z / max(biased.w, frame.z_near_m), 0.0);

    var intensity = settings.photon_w * exp(-frame.attenuation_per_m * photon.distance_m);
#if FRESNEL == 1
    intensity *= entered(photon);
#endif
#if CONSERVING == 1
    intensity *= angular_weight(photon.entry_m) / (side_px * side_px);
#endif
    splat.intensity = intensity;
#if SURFACE == 1
    splat.photon_z = clip.z / clip.w;
    splat.slope = surface_slope(settings, scene_depth, position_px, clip.w);
#endif
    return splat;
}

#if SURFACE == 1
// Whether a splat's plane is seen in a pixel: `from_center` pixels from its middle, where the camera sees the depth `seen`. `planes` has the
// device depths of splat and photon in the middle.
fn in_surface(settings: Splat, planes: vec2<f32>, slope: vec2<f32>, from_center: vec2<f32>, seen: f32) -> bool {
    let rise = dot(slope, from_center);
    // view(seen) − view(plane) ≤ bias, where view(z) = n f / (f − z (f − n)), multiplied by both denominators.
    let range = frame.z_far_m - frame.z_near_m;
    let over_seen = frame.z_far_m - seen * range;
    let over_plane = frame.z_far_m - clamp(planes.y + rise, 0.0, 1.0) * range;
    let product = frame.z_near_m * frame.z_far_m;
    let near = product * over_plane <= over_seen * (product + settings.depth_bias_m * over_plane);
    return near && planes.x + rise <= seen;
}
#endif
