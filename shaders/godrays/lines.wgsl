// defs: CONSERVING=0, FRESNEL=0, WATER=0
// A wide line from water entry to hit for each photon, added up: UW §3.4.
#import fathom::uniforms::{frame}
#import fathom::math::{PI}
#import fathom::photon::{Photon, angular_weight, entered, has_landed}
#import fathom::screen
#import fathom::shading::{water_path_m}

struct Lines {
    // Pixels of the godray buffer.
    size_px: vec2<f32>,
    // Its sides in squares of a pixel's area: lines are as wide in all directions, whatever the shape of pixels.
    square_px: vec2<f32>,
    width_px: f32,
    // Schlick's k: −1 backward … 1 forward scattering.
    phase_k: f32,
    // I_photon: flux of a photon, W.
    photon_w: f32,
    // Photons that one instance of the index pattern draws.
    photons_per_instance: u32,
    photons: u32,
}

@group(1) @binding(0) var<uniform> settings: Lines;
@group(1) @binding(1) var<storage, read> photons: array<Photon>;
@group(1) @binding(2) var scene_depth: texture_depth_2d;

struct Varying {
    @builtin(position) clip: vec4<f32>,
    @location(0) position_m: vec3<f32>,
    // Distance from the water surface along the ray.
    @location(1) distance_m: f32,
    @location(2) @interpolate(flat) direction: vec3<f32>,
    // I_photon with the rule's factors that are the same along the line, W.
    @location(3) @interpolate(flat) photon_w: f32,
}

const NOWHERE: Varying = Varying(screen::NOT_DRAWN, vec3<f32>(0.0), 0.0, vec3<f32>(0.0), 0.0);

@vertex
fn vertex(@builtin(vertex_index) vertex: u32, @builtin(instance_index) instance: u32) -> Varying {
    let index = instance * settings.photons_per_instance + vertex / 4u;
    if index >= settings.photons {
        return NOWHERE;
    }
    let photon = photons[index];
    if !has_landed(photon) || photon.distance_m <= 0.0 {
        return NOWHERE;
    }
    let start = frame.camera_view_projection * vec4(photon.entry_m, 1.0);
    let end = frame.camera_view_projection * vec4(photon.hit_m, 1.0);
    if max(start.w, end.w) <= frame.z_near_m {
        return NOWHERE;
    }
    // The part in front of the near plane, as shares of the segment.
    let crossing = (frame.z_near_m - start.w) / (end.w - start.w);
    let first = select(0.0, crossing, start.w < frame.z_near_m);
    let last = select(1.0, crossing, end.w < frame.z_near_m);

    let a = mix(start, end, first);
    let b = mix(start, end, last);
    let along_px = (b.xy / b.w - a.xy / a.w) * 0.5 * settings.square_px;
    let length_px = length(along_px);
    let along = select(vec2(0.0, 1.0), along_px / length_px, length_px > 1e-6);
    let across = vec2(-along.y, along.x) * settings.width_px / settings.square_px;
    let at_end = (vertex & 1u) != 0u;
    let share = select(first, last, at_end);
    var clip = select(a, b, at_end);
    clip = vec4(clip.xy + across * clip.w * select(-1.0, 1.0, (vertex & 2u) != 0u), clip.zw);
    let direction = (photon.hit_m - photon.entry_m) / photon.distance_m;
    var photon_w = settings.photon_w;
#if FRESNEL == 1
    photon_w *= entered(photon);
#endif
#if CONSERVING == 1
    photon_w *= angular_weight(photon.entry_m) / settings.width_px;
#endif
    return Varying(clip, mix(photon.entry_m, photon.hit_m, share), share * photon.distance_m, direction, photon_w);
}

// Schlick's form of the Henyey-Greenstein phase function; `cosine` of the scattering angle, 1 forward.
fn phase(cosine: f32) -> f32 {
    let k = settings.phase_k;
    let d = 1.0 - k * cosine;
    return (1.0 - k * k) / (4.0 * PI * d * d);
}

@fragment
fn fragment(in: Varying) -> @location(0) vec4<f32> {
    let to_viewer = frame.camera_position_m - in.position_m;
    let viewer_distance = length(to_viewer);
    let scattering = phase(dot(in.direction, to_viewer) / viewer_distance);
    // The paper's formula is for a viewer in the water; to one above it only a part of the path leads through water.
    let wet_m = select(viewer_distance, water_path_m(in.position_m), frame.camera_position_m.y > 0.0);
    return vec4(in.photon_w * scattering * exp(-frame.attenuation_per_m * (wet_m + in.distance_m)));
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
