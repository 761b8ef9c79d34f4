// defs: LAST=0, WATER=0
// The first hit of each row: SPT §2.1, a horizontal reduction in steps that each halve the width. LAST 1 makes a photon of what is left, or
// several of a row that has not been halved: SPT Fig. 3.
#import fathom::host::{Photon, TileUniforms, Transfer}
#import fathom::transfer::{ENDED, NO_HIT, landed}

@group(0) @binding(0) var hits: texture_2d<f32>;
#if LAST == 0
@group(0) @binding(1) var halved: texture_storage_2d<r32float, write>;

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if any(id.xy >= textureDimensions(halved)) {
        return;
    }
    let left = vec2<i32>(2 * i32(id.x), i32(id.y));
    var first = textureLoad(hits, left, 0).x;
    if first >= NO_HIT && left.x + 1 < i32(textureDimensions(hits).x) {
        first = textureLoad(hits, left + vec2(1, 0), 0).x;
    }
    textureStore(halved, vec2<i32>(id.xy), vec4(first));
}
#else
@group(0) @binding(1) var<uniform> tile: TileUniforms;
@group(0) @binding(2) var<storage, read> transfers: array<Transfer>;
@group(0) @binding(3) var<storage, read_write> photons: array<Photon>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let photon = tile.first + id.x;
    if id.x >= textureDimensions(hits).y || photon >= tile.photons {
        return;
    }
    let ray = transfers[photon];
    if ray.state == ENDED {
        return;
    }
    var number = 0;
    var before_m = NO_HIT;
    for (var i = 0u; i < tile.max_hits; i++) {
        var at_m = NO_HIT;
        for (; number < i32(textureDimensions(hits).x) && at_m >= NO_HIT; number++) {
            let step_m = textureLoad(hits, vec2(number, i32(id.x)), 0).x;
            // Hits of adjacent steps are one intersection.
            at_m = select(NO_HIT, step_m, before_m >= NO_HIT);
            before_m = step_m;
        }
        photons[photon * tile.max_hits + i] = landed(ray, at_m);
    }
}
#endif
