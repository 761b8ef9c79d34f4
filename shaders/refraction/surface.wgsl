// defs: SHAFTS=0, TEST=1, WATER=0
// The picture with the water's surface: lines of sight are refracted and reflected there, and followed in screen space through what the
// camera sees without the water: SPT §4, Fig. 10 and 13. "This is an approximation that can only simulate the refraction of light from
// underwater objects that are visible to the viewer in the absence of the water surface."
#import fathom::uniforms::{frame, world_at}
#import fathom::layers::{texel_of}
#import fathom::photon::{MIN_COMPONENT, Ray, above_water, entry_between, nearest_of_step}
#import fathom::screen_ray::{Walk, hit, segment}
#import fathom::shading::{display, fog, fresnel, shafts, sky, water_path_m}
#import fathom::transfer::{FIRST, NO_HIT, Transfer}
#import fathom::water

struct Surface {
    size_px: vec2<f32>,
    exposure: f32,
    // Radiance of a shaft for each W in its pixel, 1/(m² sr).
    shaft_scale: f32,
    // Largest slope of the water's surface.
    steepest: f32,
    // Most steps of a line of sight towards it.
    searches: u32,
}

@group(1) @binding(0) var<uniform> settings: Surface;
@group(1) @binding(1) var<uniform> walk: Walk;
@group(1) @binding(2) var depths: texture_2d_array<f32>;
@group(1) @binding(3) var surfaces: texture_2d_array<u32>;
@group(1) @binding(4) var scene_depth: texture_depth_2d;
// Radiance of what the camera sees, without water before it.
@group(1) @binding(5) var radiances: texture_2d<f32>;
#if SHAFTS == 1
// W.
@group(1) @binding(6) var shaft_texels: texture_2d<f32>;
#endif

// Rounding of distances to the slab that holds the surface: flat water's has no height.
const ROOM: f32 = 1e-4;

// Distance at which a line of sight meets the surface within `far_m`, or NO_HIT. A step is as long as no slope is steep enough to meet it, or a
// share of the shortest wave (`frame.water_step_m`); of such a step the place nearest to the surface is looked at too. The last step goes to
// the end.
fn meets_m(sight: vec3<f32>, far_m: f32) -> f32 {
    let ray = Ray(frame.camera_position_m, sight);
    let rise = select(sight.y, MIN_COMPONENT, abs(sight.y) < MIN_COMPONENT);
    let ends = (vec2(frame.water_bound_m, -frame.water_bound_m) - ray.origin_m.y) / rise;
    let end = clamp(max(ends.x, ends.y) * (1.0 + ROOM), 0.0, far_m);
    let level = max(length(sight.xz), MIN_COMPONENT);
    let steepness = abs(sight.y) + level * settings.steepest;
    var before = above_water(ray, clamp(min(ends.x, ends.y) * (1.0 - ROOM), 0.0, far_m));
    let side = select(-1.0, 1.0, before.height_m > 0.0);
    for (var i = 1u; i <= settings.searches && before.t < end; i++) {
        let step_m = max(frame.water_step_m / level, side * before.height_m / steepness);
        let after = above_water(ray, select(min(before.t + step_m, end), end, i == settings.searches));
        let behind = nearest_of_step(ray, before, after, side);
        if side * behind.height_m <= 0.0 {
            let entry_m = entry_between(ray, before, behind, side).position_m;
            return select(NO_HIT, distance(entry_m, ray.origin_m), water::inside(entry_m.xz));
        }
        before = after;
    }
    return NO_HIT;
}

// Radiance that comes along a ray from the surface. Where a ray under water meets nothing that the camera sees, `straight` takes its
// place: what lies behind the surface without refraction.
fn along(position_m: vec3<f32>, direction: vec3<f32>, straight: vec3<f32>) -> vec3<f32> {
    let ray = Transfer(position_m, FIRST, direction, 0.0);
    let seg = segment(walk, ray);
    var at_m = NO_HIT;
    for (var number = 0.0; number < seg.steps && at_m >= NO_HIT; number += 1.0) {
        at_m = hit(walk, depths, surfaces, ray, seg, number).at_m;
    }
    let under_water = direction.y < 0.0;
    if at_m >= NO_HIT {
        if under_water {
            return straight;
        }
        return sky(direction);
    }
    let clip = frame.camera_view_projection * vec4(position_m + at_m * direction, 1.0);
    let found = textureLoad(radiances, texel_of(clip.xy / clip.w, settings.size_px), 0).xyz;
    if under_water {
        return fog(found, at_m);
    }
    return found;
}

// Radiance of the surface where a line of sight meets it, `behind_m` before what has the radiance `dry`.
fn at_surface(sight: vec3<f32>, at_m: f32, dry: vec3<f32>, behind_m: f32) -> vec3<f32> {
    let straight = fog(dry, behind_m);
    let position_m = frame.camera_position_m + at_m * sight;
    let upwards = water::normal(water::surface(position_m.xz).yz);
    let from_below = dot(sight, upwards) > 0.0;
    let normal = select(upwards, -upwards, from_below);
    let eta = select(1.0 / frame.refractive_index, frame.refractive_index, from_below);
    let reflected = fresnel(-dot(sight, normal), eta);
    var radiance = reflected * along(position_m, reflect(sight, normal), straight);
    if reflected < 1.0 {
        radiance += (1.0 - reflected) * along(position_m, normalize(refract(sight, normal, eta)), straight);
    }
    if from_below {
        return fog(radiance, at_m);
    }
    return radiance;
}

@fragment
fn fragment(@builtin(position) pixel: vec4<f32>) -> @location(0) vec4<f32> {
    let texel = vec2<i32>(pixel.xy);
    let z = textureLoad(scene_depth, texel, 0);
    let position_m = world_at(pixel.xy / settings.size_px, z);
    let far_m = distance(position_m, frame.camera_position_m);
    let sight = (position_m - frame.camera_position_m) / far_m;
    let at_m = meets_m(sight, far_m);
    var radiance = select(vec3(0.0), textureLoad(radiances, texel, 0).xyz, z < 1.0);
    if at_m < NO_HIT {
        radiance = at_surface(sight, at_m, radiance, select(frame.z_far_m, far_m - at_m, z < 1.0));
    } else if z < 1.0 {
        radiance = fog(radiance, water_path_m(position_m));
    } else if frame.camera_under_water != 0u {
        radiance = fog(vec3(0.0), frame.z_far_m);
    } else {
        radiance = sky(sight);
    }
#if SHAFTS == 1
    radiance += shafts(textureLoad(shaft_texels, texel, 0).x, settings.shaft_scale);
#endif
    return display(radiance, settings.exposure);
}
