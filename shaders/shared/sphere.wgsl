// Directions over a hemisphere and over the sphere from a point set that each caller shifts: unbiased for every shift drawn
// evenly, and well spread for each.
#define_import_path fathom::sphere

#import fathom::math::{TAU}
#import fathom::random::{pcg, unit}

// Kronecker sequence with the powers of the plastic number's inverse (Roberts, "The Unreasonable Effectiveness of
// Quasirandom Sequences", 2018): directions spread over two dimensions, and the third is free for a jitter.
const PLASTIC: vec2<f32> = vec2<f32>(0.75487767, 0.56984029);

// Three numbers in 0…1 of a seed.
fn shift_of(seed: u32) -> vec3<f32> {
    let x = pcg(seed);
    let y = pcg(x);
    return vec3(unit(x), unit(y), unit(pcg(y)));
}

// Point k of `count` in the unit cube, shifted on the torus.
fn shifted_point(k: u32, count: u32, shift: vec3<f32>) -> vec3<f32> {
    let point = vec3((f32(k) + 0.5) / f32(count), fract(f32(k) * PLASTIC));
    return fract(point + shift);
}

// Rotation that brings +z to a unit vector (Duff et al., "Building an Orthonormal Basis, Revisited", JCGT 6(1), 2017).
fn tangent_frame(n: vec3<f32>) -> mat3x3<f32> {
    let side = select(-1.0, 1.0, n.z >= 0.0);
    let a = -1.0 / (side + n.z);
    let b = n.x * n.y * a;
    return mat3x3(vec3(1.0 + side * n.x * n.x * a, side * b, -side * n.x), vec3(b, side + n.y * n.y * a, -n.y), n);
}

// Direction around +z with density cos θ / π: Malley's method, a point of the disc lifted.
fn cosine_direction(u: vec2<f32>) -> vec3<f32> {
    let radius = sqrt(u.x);
    return vec3(radius * cos(TAU * u.y), radius * sin(TAU * u.y), sqrt(1.0 - u.x));
}

// Direction around +z with density 1 / 2π.
fn hemisphere_direction(u: vec2<f32>) -> vec3<f32> {
    let radius = sqrt(u.x * (2.0 - u.x));
    return vec3(radius * cos(TAU * u.y), radius * sin(TAU * u.y), 1.0 - u.x);
}

// Direction with density 1 / 4π.
fn sphere_direction(u: vec2<f32>) -> vec3<f32> {
    let z = 1.0 - 2.0 * u.x;
    let radius = sqrt(max(1.0 - z * z, 0.0));
    return vec3(radius * cos(TAU * u.y), radius * sin(TAU * u.y), z);
}
