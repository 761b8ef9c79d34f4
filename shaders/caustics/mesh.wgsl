// defs: FRESNEL=0, SIDE=2, WATER=0
// The light's grid as triangles whose corners are photons: a caustic mesh. The light that enters through a triangle of the water's surface
// lands in the triangle of its refracted corners, so that irradiance is flux over area (Nishita and Nakamae 1994, "Method of Displaying
// Optical Effects within Water using Accumulation Buffer"; Wallace 2010, "WebGL Water").
#import fathom::uniforms::{frame, view_depth_m}
#import fathom::photon::{Photon}
#import fathom::screen
#if FRESNEL == 1
#import fathom::photon::{entered}
#endif

struct Mesh {
    // Pixels of the caustics buffer.
    size_px: vec2<f32>,
    // Cells per side of the light's grid, of SIDE² photons each.
    grid: u32,
    // Irradiance at normal incidence of a directional light, W/m²; radiant intensity of a point light, W/sr.
    strength: f32,
    // A pixel is lit when what it shows lies this near to the triangle, along the view.
    depth_bias_m: f32,
    // Longest edge of a drawn triangle over its longest edge on the water's surface.
    most_stretch: f32,
}

@group(1) @binding(0) var<uniform> settings: Mesh;
@group(1) @binding(1) var<storage, read> photons: array<Photon>;
@group(1) @binding(2) var scene_depth: texture_depth_2d;

struct Varying {
    @builtin(position) clip: vec4<f32>,
    // Distance along the view.
    @location(0) view_m: f32,
    // Share of a photon's energy that is left.
    @location(1) left: f32,
    // W/m² without attenuation.
    @location(2) @interpolate(flat) irradiance: f32,
}

// Outside the clip volume: drawn by no rasterizer.
const NOWHERE: Varying = Varying(vec4<f32>(2.0, 2.0, 2.0, 1.0), 0.0, 0.0, 0.0);
const VERTICES: u32 = 6u;
// A constant: integer divisions by what is known only at run time took most of this shader on lavapipe.
const SIDE: u32 = #{SIDE}u;

// The photon at a place of the light's grid, where photons are stored cell by cell.
fn photon_at(place: vec2<u32>) -> Photon {
    let cell = place / SIDE;
    let sub = place % SIDE;
    return photons[((cell.y * settings.grid + cell.x) * SIDE + sub.y) * SIDE + sub.x];
}

// Places in a square of four photons of the corners of its two triangles.
fn corner(k: u32) -> vec2<u32> {
    let second = vec2(k == 1u || k == 3u || k == 5u, k == 2u || k == 3u || k == 4u);
    return vec2<u32>(second);
}

// Flux through a triangle of the water's surface, W. Negative where photons that are strewn over more than their own cells turn the
// triangle over: what neighbours bring twice is then taken away.
fn flux(a: vec3<f32>, ab: vec3<f32>, ac: vec3<f32>) -> f32 {
    if frame.light_is_point == 0u {
        return -0.5 * settings.strength * dot(cross(ab, ac), frame.light_forward);
    }
    // Solid angle of a triangle (van Oosterom and Strackee 1983, Eq. 8), its volume from differences of places.
    let p = a - frame.light_position_m;
    let q = p + ab;
    let r = p + ac;
    let lengths = vec3(length(p), length(q), length(r));
    let over = lengths.x * lengths.y * lengths.z + dot(p, q) * lengths.z + dot(p, r) * lengths.y + dot(q, r) * lengths.x;
    return -2.0 * settings.strength * atan2(dot(p, cross(ab, ac)), over);
}

fn longest(a: vec3<f32>, b: vec3<f32>, c: vec3<f32>) -> f32 {
    return max(max(distance(a, b), distance(b, c)), distance(c, a));
}

@vertex
fn vertex(@builtin(vertex_index) vertex: u32, @builtin(instance_index) row: u32) -> Varying {
    let k = vertex % VERTICES;
    let first = vec2(vertex / VERTICES, row);
    let start = k / 3u * 3u;
    let a = photon_at(first + corner(start));
    let b = photon_at(first + corner(start + 1u));
    let c = photon_at(first + corner(start + 2u));
    if min(min(a.residual_m, b.residual_m), c.residual_m) < 0.0 {
        return NOWHERE;
    }
    let area_m2 = 0.5 * length(cross(b.hit_m - a.hit_m, c.hit_m - a.hit_m));
    let before_m = longest(a.entry_m, b.entry_m, c.entry_m);
    if area_m2 == 0.0 || longest(a.hit_m, b.hit_m, c.hit_m) > settings.most_stretch * before_m {
        return NOWHERE;
    }
    var own = a;
    if k % 3u == 1u {
        own = b;
    } else if k % 3u == 2u {
        own = c;
    }
    let clip = frame.camera_view_projection * vec4(own.hit_m, 1.0);
    var left = exp(-frame.attenuation_per_m * own.distance_m);
#if FRESNEL == 1
    left *= entered(own);
#endif
    let brought = flux(a.entry_m, b.entry_m - a.entry_m, c.entry_m - a.entry_m);
    return Varying(clip, clip.w, left, brought / area_m2);
}

@fragment
fn fragment(in: Varying) -> @location(0) vec4<f32> {
    let seen_m = view_depth_m(screen::depth_at(scene_depth, in.clip.xy, settings.size_px));
    return vec4(select(in.irradiance * in.left, 0.0, abs(seen_m - in.view_m) > settings.depth_bias_m));
}
