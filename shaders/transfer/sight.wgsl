// defs: TEST=3, WATER=0
// Lines of sight behind the first surface of glass: SPT §4, "visible object points along with their normals are rendered into the transfer
// map". Beside them the depths of the first two layers in one texel, so that a step of a ray takes one look-up. The camera is not in glass.
#import fathom::uniforms::{frame, world_at}
#import fathom::layers::{surface_at}
#import fathom::optics
#import fathom::transfer::{FIRST, NEVER, Transfer}

struct Sight {
    size_px: vec2<f32>,
    // The rectangle of pixels that may show glass.
    first: vec2<u32>,
    count: vec2<u32>,
}

@group(1) @binding(0) var<uniform> settings: Sight;
@group(1) @binding(1) var depths: texture_2d_array<f32>;
@group(1) @binding(2) var surfaces: texture_2d_array<u32>;
@group(1) @binding(3) var<storage, read_write> transfers: array<Transfer>;
@group(1) @binding(4) var pairs: texture_storage_2d<rg32float, write>;

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if any(vec2<f32>(id.xy) >= settings.size_px) {
        return;
    }
    let z = textureLoad(depths, id.xy, 0, 0).x;
    textureStore(pairs, id.xy, vec4(z, textureLoad(depths, id.xy, 1, 0).x, 0.0, 0.0));
    let at = id.xy - settings.first;
    if any(id.xy < settings.first) || any(at >= settings.count) {
        return;
    }
    let surface = surface_at(surfaces, vec2<i32>(id.xy), 0u);
    let position_m = world_at((vec2<f32>(id.xy) + 0.5) / settings.size_px, z);
    let sight = normalize(position_m - frame.camera_position_m);
    let shown = z < 1.0 && dot(sight, surface.geometric_normal) < 0.0;
    let inside = optics::refracted(sight, surface.shading_normal, 1.0 / optics::refractive_index(surface.optics));
    transfers[at.x + at.y * settings.count.x] = Transfer(position_m, select(NEVER, FIRST, shown), inside, 0.0);
}
