// defs: WATER=0
// A ray from each pixel's surface back to the light: SPT §5, "for every pixel being covered by the receiver, a photon is traced
// backward to the light source". Triangles that face away from the light have none, and where receivers are asked for, other objects.
#import fathom::uniforms::{frame, world_at}
#import fathom::layers::{surface_at}
#import fathom::optics::{is_receiver}
#import fathom::shading::{to_light}
#import fathom::transfer::{FIRST, NEVER, Transfer}

struct Shadow {
    size_px: vec2<f32>,
    receivers_only: u32,
}

@group(1) @binding(0) var<uniform> settings: Shadow;
@group(1) @binding(1) var depths: texture_2d_array<f32>;
@group(1) @binding(2) var surfaces: texture_2d_array<u32>;
@group(1) @binding(3) var<storage, read_write> transfers: array<Transfer>;

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let size = vec2<u32>(settings.size_px);
    if any(id.xy >= size) {
        return;
    }
    let texel = vec2<i32>(id.xy);
    let z = textureLoad(depths, texel, 0, 0).x;
    let position_m = world_at((vec2<f32>(id.xy) + 0.5) / settings.size_px, z);
    let direction = to_light(position_m);
    let surface = surface_at(surfaces, texel, 0u);
    let is_asked = settings.receivers_only == 0u || is_receiver(surface.optics);
    let lit = z < 1.0 && is_asked && dot(surface.geometric_normal, direction) > 0.0;
    transfers[id.x + id.y * size.x] = Transfer(position_m, select(NEVER, FIRST, lit), direction, 0.0);
}
