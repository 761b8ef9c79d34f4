// The picture: what the camera sees, through glass by its exit rays. A ray is looked up in an environment: SPT §4, "this information in
// turn can either be used to look up an environment map or to retrace the refracted view-rays".
#import fathom::uniforms::{frame, world_at}
#import fathom::screen
#import fathom::shading::{SKY_SHARE, display, lambert, to_light}

struct Compose {
    size_px: vec2<f32>,
    exposure: f32,
}

@group(1) @binding(0) var<uniform> settings: Compose;
@group(1) @binding(1) var albedo_texels: texture_2d<f32>;
@group(1) @binding(2) var normal_texels: texture_2d<f32>;
@group(1) @binding(3) var depths: texture_depth_2d;
@group(1) @binding(4) var positions: texture_2d<f32>;
@group(1) @binding(5) var directions: texture_2d<f32>;

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
    let place = (uv * 0.5 + 0.5) * TILES;
    let tile = floor(place);
    let odd = fract((tile.x + tile.y) * 0.5) > 0.25;
    let inside = abs(place - tile - 0.5);
    let shade = select(select(0.35, 1.0, odd), 0.1, max(inside.x, inside.y) > 0.5 - 0.5 * JOINT);
    return lambert(color * shade, vec3(frame.light_irradiance));
}

@vertex
fn vertex(@builtin(vertex_index) index: u32) -> @builtin(position) vec4<f32> {
    return screen::corner(index);
}

@fragment
fn fragment(@builtin(position) pixel: vec4<f32>) -> @location(0) vec4<f32> {
    let texel = vec2<i32>(pixel.xy);
    let exit = textureLoad(positions, texel, 0);
    let z = textureLoad(depths, texel, 0);
    let place_m = world_at(pixel.xy / settings.size_px, z);
    let sight = normalize(place_m - frame.camera_position_m);
    let hides = z < 1.0 && distance(place_m, frame.camera_position_m) < distance(exit.xyz, frame.camera_position_m);
    if exit.w > 0.0 && !hides {
        return display(environment(textureLoad(directions, texel, 0).xyz), settings.exposure);
    }
    if z >= 1.0 {
        return display(environment(sight), settings.exposure);
    }
    let normal = textureLoad(normal_texels, texel, 0).xyz;
    let irradiance = frame.light_irradiance * (SKY_SHARE + saturate(dot(normal, to_light(place_m))));
    return display(lambert(textureLoad(albedo_texels, texel, 0).xyz, vec3(irradiance)), settings.exposure);
}
