// Light that does not come by photons: sky, sun above the water, ambient, and the water's own colour (fog).
#define_import_path fathom::shading

#import fathom::math::{PI}
#import fathom::uniforms::{frame}

// Share of the light's irradiance that arrives from the sky; a clear sky gives 10 to 20 %.
const SKY_SHARE: f32 = 0.15;
// In-scattered colour of clear, deep water, relative to the ambient radiance; tuned on scene tank.
const WATER_COLOR: vec3<f32> = vec3<f32>(0.004, 0.05, 0.075);
// Colour of light that has come through water, relative to that of the light; tuned on scene tank.
const WATER_TINT: vec3<f32> = vec3<f32>(0.75, 0.95, 1.0);
// Colour of light scattered in the water, relative to that of the light; tuned on scene tank.
const SHAFT_TINT: vec3<f32> = vec3<f32>(0.5, 0.85, 1.0);
const SKY_ZENITH: vec3<f32> = vec3<f32>(0.14, 0.30, 0.70);
const SKY_HORIZON: vec3<f32> = vec3<f32>(0.45, 0.60, 0.80);

fn to_light(position_m: vec3<f32>) -> vec3<f32> {
    if frame.light_is_point != 0u {
        return normalize(frame.light_position_m - position_m);
    }
    return -frame.light_forward;
}

fn sky(direction: vec3<f32>) -> vec3<f32> {
    let up = saturate(direction.y);
    let sun = pow(saturate(dot(direction, -frame.light_forward)), 600.0) * 20.0;
    return frame.light_irradiance / PI * (mix(SKY_HORIZON, SKY_ZENITH, sqrt(up)) * 0.5 + sun);
}

// Irradiance from the sky at a depth under water (0 above it).
fn ambient(depth_m: f32, normal: vec3<f32>) -> f32 {
    let facing = 0.6 + 0.4 * normal.y;
    return SKY_SHARE * frame.light_irradiance * facing * exp(-frame.attenuation_per_m * max(depth_m, 0.0));
}

// Irradiance straight from the light, above the water only: below it, photons bring it.
fn direct(position_m: vec3<f32>, normal: vec3<f32>) -> f32 {
    if position_m.y < 0.0 {
        return 0.0;
    }
    return frame.light_irradiance * saturate(dot(normal, to_light(position_m)));
}

// Length under water of the segment from the camera to p.
fn water_path_m(p: vec3<f32>) -> f32 {
    let camera = frame.camera_position_m;
    let whole = distance(camera, p);
    let below_camera = max(-camera.y, 0.0);
    let below_p = max(-p.y, 0.0);
    if camera.y <= 0.0 && p.y <= 0.0 {
        return whole;
    }
    return whole * (below_camera + below_p) / max(abs(camera.y - p.y), 1e-6 * whole);
}

// Radiance after `path_m` of water: Beer attenuation, and the water's own colour in its place.
fn fog(radiance: vec3<f32>, path_m: f32) -> vec3<f32> {
    let t = exp(-frame.attenuation_per_m * path_m);
    return radiance * t + WATER_COLOR * (frame.light_irradiance / PI) * (1.0 - t);
}

fn lambert(albedo: vec3<f32>, irradiance: vec3<f32>) -> vec3<f32> {
    return albedo / PI * irradiance;
}

// Radiance of shafts of light, from what a pixel of their buffer holds and the radiance for a unit of it.
fn shafts(sum: f32, scale: f32) -> vec3<f32> {
    return scale * sum * SHAFT_TINT;
}

// Unpolarised Fresnel reflectance of a dielectric; `eta` = n_outside / n_inside of the arriving ray's side.
fn fresnel(cos_i: f32, eta: f32) -> f32 {
    let sin2_t = eta * eta * (1.0 - cos_i * cos_i);
    if sin2_t >= 1.0 {
        return 1.0;
    }
    let cos_t = sqrt(1.0 - sin2_t);
    let s = (eta * cos_i - cos_t) / (eta * cos_i + cos_t);
    let p = (cos_i - eta * cos_t) / (cos_i + eta * cos_t);
    return 0.5 * (s * s + p * p);
}

// Display value of a radiance: exponential tone curve, gamma 2.2.
fn display(radiance: vec3<f32>, exposure: f32) -> vec4<f32> {
    return vec4(pow(1.0 - exp(-radiance * exposure), vec3(1.0 / 2.2)), 1.0);
}
