// defs: TEST=1, WATER=0
// The picture: what the camera sees, through glass by its exit rays. SPT §4: these "can either be used to look up an environment map or to
// retrace the refracted view-rays. If a layered depth image of the surrounding scene exists, intersections between the exiting ray and the
// scene can be detected as well". That of one layer is the G-buffer: a ray that meets what the camera does not see shows the environment.
#import fathom::uniforms::{frame}
#import fathom::picture::{depths, display, lambert, normal_at, seen_at}
#import fathom::screen_ray::{Walk, distance_at, to_pixel, segment}
#import fathom::shading::{SKY_SHARE, to_light}
#import fathom::shading
#import fathom::surface_plane::{plane_at}
#import fathom::transfer::{FIRST, NO_HIT, Transfer}

@group(1) @binding(4) var positions: texture_2d<f32>;
@group(1) @binding(5) var directions: texture_2d<f32>;
@group(1) @binding(6) var<uniform> walk: Walk;

// A step of a ray reaches this far beyond its pixel, in pixels.
const OVERLAP: f32 = 0.5;
// Rays start so much before a surface, as glass that stands on a surface touches it. Share of the distance to the far plane in device depth.
const CONTACT: f32 = 1e-4;

// Tiles of a side of the environment's cube.
const TILES: f32 = 12.0;
// Share of a tile's side taken by its joint.
const JOINT: f32 = 0.05;

// Radiance from infinitely far away: the inside of a cube with tiled sides, each of a colour of its own, in the light's irradiance.
fn environment(direction: vec3<f32>) -> vec3<f32> {
    let size = abs(direction);
    var uv = direction.xz / size.y;
    var color = select(vec3(0.55, 0.42, 0.3), vec3(0.75, 0.8, 0.85), direction.y > 0.0);
    if size.x > size.y && size.x > size.z {
        uv = direction.yz / size.x;
        color = select(vec3(0.65, 0.2, 0.16), vec3(0.2, 0.5, 0.25), direction.x > 0.0);
    } else if size.z > size.y {
        uv = direction.xy / size.z;
        color = select(vec3(0.8, 0.6, 0.25), vec3(0.25, 0.35, 0.6), direction.z > 0.0);
    }
    let tiles = (uv * 0.5 + 0.5) * TILES;
    let tile = floor(tiles);
    let odd = fract((tile.x + tile.y) * 0.5) > 0.25;
    let inside = abs(tiles - tile - 0.5);
    let shade = select(select(0.35, 1.0, odd), 0.1, max(inside.x, inside.y) > 0.5 - 0.5 * JOINT);
    return shading::lambert(color * shade, vec3(frame.light_irradiance));
}

// The pixel that shows what a ray meets first within a distance; negative where the camera sees nothing there.
fn seen_along(position_m: vec3<f32>, direction: vec3<f32>, far_m: f32) -> vec2<i32> {
    let seg = segment(walk, Transfer(position_m, FIRST, direction, 0.0));
    let start = vec3(to_pixel(walk, seg.near), seg.near.z / seg.near.w);
    let end = vec3(to_pixel(walk, seg.far), seg.far.z / seg.far.w);
    for (var number = 0.0; number < seg.steps; number += 1.0) {
        let texel = vec2<i32>(clamp(mix(start.xy, end.xy, (number + 0.5) / seg.steps), vec2(0.0), walk.size_px - 1.0));
        let plane = plane_at(depths, texel);
        if plane.z >= 1.0 {
            continue;
        }
        // Device depth is linear along the ray on the screen, and on the plane.
        let shares = clamp((number + vec2(-OVERLAP, 1.0 + OVERLAP)) / seg.steps, vec2(0.0), vec2(1.0));
        let before = mix(start, end, shares.x) - vec3(vec2<f32>(texel) + 0.5, plane.z);
        let behind = mix(start, end, shares.y) - vec3(vec2<f32>(texel) + 0.5, plane.z);
        let before_z = before.z - dot(plane.slope, before.xy) - CONTACT * (1.0 - plane.z);
        let behind_z = behind.z - dot(plane.slope, behind.xy);
        let at = mix(shares.x, shares.y, saturate(before_z / (before_z - behind_z)));
        if before_z <= 0.0 && behind_z > 0.0 {
            return select(vec2(-1), texel, distance_at(seg, at) <= far_m);
        }
    }
    return vec2(-1);
}

// The picture of what the camera sees at a pixel.
fn shown(texel: vec2<i32>) -> vec4<f32> {
    let seen = seen_at(vec2<f32>(texel) + 0.5);
    let irradiance = frame.light_irradiance * (SKY_SHARE + saturate(dot(normal_at(texel), to_light(seen.position_m))));
    return display(lambert(texel, vec3(irradiance)));
}

@fragment
fn fragment(@builtin(position) pixel: vec4<f32>) -> @location(0) vec4<f32> {
    let at = seen_at(pixel.xy);
    let exit = textureLoad(positions, at.texel, 0);
    let from_camera_m = at.position_m - frame.camera_position_m;
    let sight = normalize(from_camera_m);
    let has_glass = exit.w > 0.0 && (at.z >= 1.0 || exit.w < length(from_camera_m));
    var seen = select(vec2(-1), at.texel, at.z < 1.0);
    var direction = sight;
    if has_glass {
        direction = textureLoad(directions, at.texel, 0).xyz;
        let entry_m = frame.camera_position_m + exit.w * sight;
        let inside_m = distance(entry_m, exit.xyz);
        // The path through the glass is taken as straight, as it is between two surfaces; then comes the path behind it.
        seen = vec2(-1);
        if inside_m > 0.0 {
            seen = seen_along(entry_m, (exit.xyz - entry_m) / inside_m, inside_m);
        }
        if seen.x < 0 {
            seen = seen_along(exit.xyz, direction, NO_HIT);
        }
    }
    if seen.x >= 0 {
        return shown(seen);
    }
    return display(environment(direction));
}
