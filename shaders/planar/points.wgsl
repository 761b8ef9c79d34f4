// defs: FRESNEL=0, WATER=0
// Each photon meets the first inner face of the pool, and is a point of one texel in the illumination map: SPT §1.1, Fig. 2.
#import fathom::uniforms::{frame}
#import fathom::photon::{angular_weight, transmittance}
#import fathom::pool::{FACES, NONE, Pool, meet, face_uv, texel_area_m2}
#import fathom::screen::{NOT_DRAWN}
#import fathom::shading::{to_light}
#import fathom::transfer::{NEVER, Transfer}

struct Points {
    // Flux of a photon in the middle of the light's frustum, W.
    photon_w: f32,
}

@group(1) @binding(0) var<uniform> settings: Points;
@group(1) @binding(1) var<uniform> pool: Pool;
@group(1) @binding(2) var<storage, read> transfers: array<Transfer>;

struct Varying {
    @builtin(position) clip: vec4<f32>,
    // What the photon brings to its texel, W/m².
    @location(0) @interpolate(flat) irradiance: f32,
}

const NOWHERE: Varying = Varying(NOT_DRAWN, 0.0);

// Flux of a photon after so much water, W.
fn flux_w(photon: Transfer, at_m: f32) -> f32 {
    let path_m = photon.path_m + at_m;
    var flux = settings.photon_w * angular_weight(photon.position_m) * exp(-frame.attenuation_per_m * path_m);
#if FRESNEL == 1
    flux *= transmittance(-to_light(photon.position_m), photon.direction);
#endif
    return flux;
}

@vertex
fn vertex(@builtin(vertex_index) index: u32) -> Varying {
    let photon = transfers[index];
    if photon.state == NEVER {
        return NOWHERE;
    }
    let met = meet(pool, photon.position_m, photon.direction);
    if met.face == NONE {
        return NOWHERE;
    }
    let hit_m = photon.position_m + met.at_m * photon.direction;
    let texels = f32(pool.texels);
    let texel = clamp(floor(face_uv(pool, met.face, hit_m) * texels), vec2(0.0), vec2(texels - 1.0));
    // The middle of the texel: no rasterizer's rounding sends the point elsewhere.
    let middle = (texel + vec2(f32(met.face) * texels, 0.0) + 0.5) / (texels * vec2(f32(FACES), 1.0));
    let clip = vec4(middle * vec2(2.0, -2.0) + vec2(-1.0, 1.0), 0.0, 1.0);
    return Varying(clip, flux_w(photon, met.at_m) / texel_area_m2(pool, met.face));
}

@fragment
fn fragment(in: Varying) -> @location(0) vec4<f32> {
    return vec4(in.irradiance);
}
