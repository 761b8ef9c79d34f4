// The water surface. WATER = 0: UW §4.1, a cosine (circular or along x) with a share of Perlin noise read off a texture;
// 1: a list of waves.
#define_import_path fathom::water

#import fathom::math::{TAU}
#import fathom::uniforms::{frame, water_texels}

#if WATER == 0
// (n, ∂n/∂u, ∂n/∂v) at a place in tile units, bilinear, periodic.
fn noise(uv: vec2<f32>) -> vec3<f32> {
    let size = vec2<i32>(textureDimensions(water_texels));
    let texel = fract(uv) * vec2<f32>(size) - 0.5;
    let base = floor(texel);
    let f = texel - base;
    let low = (vec2<i32>(base) + size) % size;
    let high = (low + 1) % size;
    let a = textureLoad(water_texels, low, 0).xyz;
    let b = textureLoad(water_texels, vec2<i32>(high.x, low.y), 0).xyz;
    let c = textureLoad(water_texels, vec2<i32>(low.x, high.y), 0).xyz;
    let d = textureLoad(water_texels, high, 0).xyz;
    return mix(mix(a, b, f.x), mix(c, d, f.x), f.y);
}

// (height, ∂h/∂x, ∂h/∂z) in metres and slopes.
fn surface(xz: vec2<f32>) -> vec3<f32> {
    let from_center = xz - frame.water_center_m;
    var r = from_center.x;
    var outward = vec2<f32>(1.0, 0.0);
    if frame.water_model == 0u {
        r = length(from_center);
        outward = select(vec2(0.0), from_center / r, r > 0.0);
    }
    let angle = frame.wavenumber_per_m * r - frame.phase;
    let wave = 1.0 - frame.noise_share;
    var h = vec3<f32>(wave * cos(angle), -wave * frame.wavenumber_per_m * sin(angle) * outward);
    if frame.noise_share > 0.0 {
        let n = noise(xz / frame.noise_tile_m + vec2<f32>(frame.noise_scroll, 0.0));
        h += frame.noise_share * vec3<f32>(n.x, n.yz / frame.noise_tile_m);
    }
    return frame.water_amplitude_m * h;
}
#else
// The same angle within ±π, where every adapter's sine is at its best.
fn wrapped(angle: f32) -> f32 {
    return angle - TAU * round(angle / TAU);
}

// (height, ∂h/∂x, ∂h/∂z) in metres and slopes.
fn surface(xz: vec2<f32>) -> vec3<f32> {
    var h = vec3(0.0);
    let count = textureDimensions(water_texels).x;
    for (var i = 0u; i < count; i++) {
        let wave = textureLoad(water_texels, vec2(i, 0u), 0);
        let angle = wrapped(dot(wave.xy, xz) + wave.w);
        h += wave.z * vec3(cos(angle), -sin(angle) * wave.xy);
    }
    return h;
}
#endif

fn normal(slope: vec2<f32>) -> vec3<f32> {
    return normalize(vec3<f32>(-slope.x, 1.0, -slope.y));
}

fn inside(xz: vec2<f32>) -> bool {
    return all(abs(xz - frame.water_center_m) <= frame.water_half_size_m);
}

// Vertex of a grid of cells² quads (6 vertices a cell) over the water rectangle, on the surface.
fn grid_vertex(index: u32, cells: u32) -> vec3<f32> {
    let cell = index / 6u;
    var corners = array<vec2<u32>, 6>(
        vec2(0u, 0u), vec2(0u, 1u), vec2(1u, 0u), vec2(1u, 0u), vec2(0u, 1u), vec2(1u, 1u));
    let corner = vec2<u32>(cell % cells, cell / cells) + corners[index % 6u];
    let unit = vec2<f32>(corner) / f32(cells) * 2.0 - 1.0;
    let xz = frame.water_center_m + unit * frame.water_half_size_m;
    return vec3<f32>(xz.x, surface(xz).x, xz.y);
}
