// defs: FACING=0, WATER=0
// A sprite for each photon that has landed, in the receiver's tangent plane: SPT §3.1, Eq. 1. FACING 1 puts it in the screen's plane, as
// point sprites lie: SPT Fig. 6, left.
#import fathom::uniforms::{focal_lengths, frame, world_at}
#import fathom::layers::{surface_near, texel_of}
#import fathom::photon::{Photon, has_landed}
#import fathom::screen::{NOT_DRAWN}

struct Sprites {
    size_px: vec2<f32>,
    // s of Eq. 1.
    radius_m: f32,
    // A pixel is lit when what it shows lies this near to the sprite's plane, along its line of sight.
    visible_m: f32,
    // Irradiance of a photon for each metre of s − r, W/m³.
    rise_w_m3: f32,
    photons_per_instance: u32,
    photons: u32,
    layers: u32,
    // Photons of a weight.
    per_ray: u32,
}

@group(1) @binding(0) var<uniform> settings: Sprites;
@group(1) @binding(1) var<storage, read> photons: array<Photon>;
@group(1) @binding(2) var depths: texture_2d_array<f32>;
@group(1) @binding(3) var surfaces: texture_2d_array<u32>;
// Of what one cannot see through.
@group(1) @binding(4) var seen: texture_depth_2d;
// Of each photon, as `transfer/map` gives them.
@group(1) @binding(5) var<storage, read> weights: array<f32>;

struct Varying {
    @builtin(position) clip: vec4<f32>,
    @location(0) @interpolate(flat) center_m: vec3<f32>,
    @location(1) @interpolate(flat) normal: vec3<f32>,
    @location(2) @interpolate(flat) rise_w_m3: f32,
}

const NOWHERE: Varying = Varying(NOT_DRAWN, vec3<f32>(0.0), vec3<f32>(0.0), 0.0);
// Sight along a plane meets it nowhere.
const MIN_COSINE: f32 = 1e-4;

#if FACING == 1
// Against the camera's axis, which is the projection's last row.
fn normal_at(ndc: vec2<f32>, depth_m: f32) -> vec3<f32> {
    let projection = frame.camera_view_projection;
    return -vec3(projection[0].w, projection[1].w, projection[2].w);
}
#else
fn normal_at(ndc: vec2<f32>, depth_m: f32) -> vec3<f32> {
    let texel = texel_of(ndc, settings.size_px);
    return surface_near(depths, surfaces, settings.layers, texel, depth_m).geometric_normal;
}
#endif

@vertex
fn vertex(@builtin(vertex_index) vertex: u32, @builtin(instance_index) instance: u32) -> Varying {
    let index = instance * settings.photons_per_instance + vertex / 4u;
    if index >= settings.photons {
        return NOWHERE;
    }
    let photon = photons[index];
    let clip = frame.camera_view_projection * vec4(photon.hit_m, 1.0);
    if !has_landed(photon) || clip.w <= frame.z_near_m {
        return NOWHERE;
    }
    let ndc = clip.xy / clip.w;
    if any(abs(ndc) > vec2(1.0)) {
        return NOWHERE;
    }
    let normal = normal_at(ndc, clip.w);
    // A ball about the hit on the screen.
    let aside = distance(photon.hit_m, frame.camera_position_m) / clip.w;
    let reach = focal_lengths() * settings.radius_m * aside / max(clip.w - settings.radius_m, frame.z_near_m);
    let corner = vec2(f32(vertex & 1u), f32((vertex >> 1u) & 1u)) * 2.0 - 1.0;
    let position = vec4((ndc + corner * reach) * clip.w, clip.zw);
    let transmitted = weights[index / settings.per_ray] * exp(-frame.attenuation_per_m * photon.distance_m);
    return Varying(position, photon.hit_m, normal, settings.rise_w_m3 * transmitted);
}

@fragment
fn fragment(in: Varying) -> @location(0) vec4<f32> {
    let uv = in.clip.xy / settings.size_px;
    let z = textureLoad(seen, vec2<i32>(in.clip.xy), 0);
    if z >= 1.0 {
        discard;
    }
    let seen_m = world_at(uv, z);
    let sight = normalize(seen_m - frame.camera_position_m);
    let across = dot(sight, in.normal);
    if abs(across) < MIN_COSINE {
        discard;
    }
    let far_m = dot(in.center_m - frame.camera_position_m, in.normal) / across;
    let from_center_m = distance(frame.camera_position_m + far_m * sight, in.center_m);
    let off_m = abs(far_m - distance(seen_m, frame.camera_position_m));
    if from_center_m >= settings.radius_m || off_m > settings.visible_m {
        discard;
    }
    return vec4(in.rise_w_m3 * (settings.radius_m - from_center_m));
}
