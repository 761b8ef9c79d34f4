// defs: TEST=1, WATER=0
// The same rays, a workgroup each: its invocations take neighbouring steps, and the nearest hit among them ends the ray.
#import fathom::photon::{Photon}
#import fathom::screen_ray::{Walk, hit, segment}
#import fathom::transfer::{ENDED, NO_HIT, Transfer, landed}

@group(1) @binding(0) var<uniform> walk: Walk;
@group(1) @binding(1) var<storage, read> transfers: array<Transfer>;
@group(1) @binding(2) var depths: texture_2d_array<f32>;
@group(1) @binding(3) var surfaces: texture_2d_array<u32>;
@group(1) @binding(4) var<storage, read_write> photons: array<Photon>;

const LANES: u32 = 32u;
const NONE: u32 = 0xffffffffu;

// The lowest step that hit.
var<workgroup> nearest: atomic<u32>;
// The same, once all have looked.
var<workgroup> found: u32;

@compute @workgroup_size(LANES)
fn main(
    @builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32
) {
    let photon = group.x + group.y * groups.x;
    if photon >= walk.photons {
        return;
    }
    let ray = transfers[photon];
    if ray.state == ENDED {
        return;
    }
    let seg = segment(walk, ray);
    if lane == 0u {
        atomicStore(&nearest, NONE);
    }
    var at_m = NO_HIT;
    var number = lane;
    var first = NONE;
    let rounds = (u32(seg.steps) + LANES - 1u) / LANES;
    for (var round = 0u; round < rounds; round++) {
        workgroupBarrier();
        number = round * LANES + lane;
        if f32(number) < seg.steps {
            at_m = hit(walk, depths, surfaces, ray, seg, f32(number)).at_m;
            if at_m < NO_HIT {
                atomicMin(&nearest, number);
            }
        }
        workgroupBarrier();
        if lane == 0u {
            found = atomicLoad(&nearest);
        }
        first = workgroupUniformLoad(&found);
        if first != NONE {
            break;
        }
    }
    if first == NONE {
        if lane == 0u {
            photons[photon] = landed(ray, NO_HIT);
        }
    } else if first == number && at_m < NO_HIT {
        photons[photon] = landed(ray, at_m);
    }
}
