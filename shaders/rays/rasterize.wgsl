// defs: TEST=1, WATER=0
// A line for each photon into its own row, as many pixels long as the ray on the screen; each fragment tests a step of the ray against all
// layers: SPT §2.1.
#import fathom::screen::{NOT_DRAWN}
#import fathom::screen_ray::{Segment, Walk, hit, segment}
#import fathom::transfer::{NO_HIT, Transfer}

@group(1) @binding(0) var<uniform> walk: Walk;
@group(1) @binding(1) var<storage, read> transfers: array<Transfer>;
@group(1) @binding(2) var depths: texture_2d_array<f32>;
@group(1) @binding(3) var surfaces: texture_2d_array<u32>;

struct Varying {
    @builtin(position) clip: vec4<f32>,
    @location(0) @interpolate(flat) near: vec4<f32>,
    @location(1) @interpolate(flat) far: vec4<f32>,
    // Its ends along the ray, its steps, and the photon's number as bits.
    @location(2) @interpolate(flat) ends: vec3<f32>,
    @location(3) @interpolate(flat) photon: u32,
}

// Lines begin and end so far within a pixel: by the diamond-exit rule they draw just the pixels that they should.
const INSET_PX: f32 = 0.25;

@vertex
fn vertex(@builtin(vertex_index) end: u32, @builtin(instance_index) photon: u32) -> Varying {
    let seg = segment(walk, transfers[photon]);
    let x_px = select(0.0, seg.steps, end == 1u) + INSET_PX;
    let y_px = f32(photon % walk.rows) + 0.5;
    let ndc = vec2(x_px / f32(walk.max_steps), y_px / f32(walk.rows)) * vec2(2.0, -2.0) + vec2(-1.0, 1.0);
    // A ray out of view has no line.
    let clip = select(NOT_DRAWN, vec4(ndc, 0.0, 1.0), seg.steps > 0.0);
    return Varying(clip, seg.near, seg.far, vec3(seg.from_m, seg.to_m, seg.steps), photon);
}

@fragment
fn fragment(in: Varying) -> @location(0) vec4<f32> {
    let number = floor(in.clip.x);
    if number >= in.ends.z {
        discard;
    }
    let seg = Segment(in.near, in.far, in.ends.x, in.ends.y, in.ends.z);
    let at_m = hit(walk, depths, surfaces, transfers[in.photon], seg, number).at_m;
    if at_m >= NO_HIT {
        discard;
    }
    return vec4(at_m);
}
