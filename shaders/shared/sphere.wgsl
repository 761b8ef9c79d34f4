// Directions over a hemisphere and over the sphere from a point set that each caller shifts: unbiased for every shift drawn
// evenly, and well spread for each.
#define_import_path fathom::sphere

const TAU: f32 = 6.28318531;
// Kronecker sequence with the powers of the plastic number's inverse (Roberts, "The Unreasonable Effectiveness of
// Quasirandom Sequences", 2018): directions spread over two dimensions, and the third is free for a jitter.
const PLASTIC: vec2<f32> = vec2<f32>(0.75487767, 0.56984029);

// A well mixed integer (Jarzynski and Olano, "Hash Functions for GPU Rendering", JCGT 9(3), 2020).
fn pcg(seed: u32) -> u32 {
    let state = seed * 747796405u + 2891336453u;
    let word = ((state >> ((state >> 28u) + 4u)) ^ state) * 277803737u;
    return (word >> 22u) ^ word;
}

// Three numbers in 0…1 of a seed.
fn shift_of(seed: u32) -> vec3<f32> {
    let x = pcg(seed);
    let y = pcg(x);
    return vec3(unit(x), unit(y), unit(pcg(y)));
}

fn unit(word: u32) -> f32 {
    return f32(word >> 8u) / 16777216.0;
}

// Point k of `count` in the unit cube, shifted on the torus.
fn shifted_point(k: u32, count: u32, shift: vec3<f32>) -> vec3<f32> {
    let place = vec3((f32(k) + 0.5) / f32(count), fract(f32(k) * PLASTIC));
    return fract(place + shift);
}

// Direction around a unit normal with density cos θ / π: Malley's method, and the basis of Duff et al. (JCGT 6(1), 2017).
fn cosine_direction(normal: vec3<f32>, u: vec2<f32>) -> vec3<f32> {
    let side = select(-1.0, 1.0, normal.z >= 0.0);
    let a = -1.0 / (side + normal.z);
    let b = normal.x * normal.y * a;
    let tangent = vec3(1.0 + side * normal.x * normal.x * a, side * b, -side * normal.x);
    let bitangent = vec3(b, side + normal.y * normal.y * a, -normal.y);
    let disc = sqrt(u.x) * vec2(cos(TAU * u.y), sin(TAU * u.y));
    return disc.x * tangent + disc.y * bitangent + sqrt(1.0 - u.x) * normal;
}

// Direction with density 1 / 4π.
fn sphere_direction(u: vec2<f32>) -> vec3<f32> {
    let z = 1.0 - 2.0 * u.x;
    let radius = sqrt(max(1.0 - z * z, 0.0));
    return vec3(radius * cos(TAU * u.y), radius * sin(TAU * u.y), z);
}
