//! Gradient noise (Perlin, *Improving noise*, 2002): tile-periodic in the plane with analytic derivatives, and in space.

use std::sync::LazyLock;

use glam::{DVec2, DVec3};

/// Lattice cells per tile of the first octave; the second has twice as many.
pub const NOISE_CELLS: u32 = 8;

/// Bound of the slope of [`tile_noise`], per tile: that of an octave is at most 2.93 per lattice cell (over all gradients and
/// places), and both octaves together have that of 8 + 16 / 2 cells, over 1.5.
pub const TILE_NOISE_SLOPE: f64 = 2.93 * (NOISE_CELLS + NOISE_CELLS) as f64 / 1.5;

/// Value and derivatives by u and v, in tile units, of two octaves (weights 1 and 1/2).
///
/// The gradients have length √2, so an octave never leaves [−1, 1]; the sum is divided by 1.5 and
/// never leaves it either, which lets a tracer bound the water by its amplitude.
pub fn tile_noise(u: f64, v: f64, seed: u32) -> (f64, DVec2) {
    let (coarse, coarse_d) = octave(u, v, NOISE_CELLS, seed);
    let (fine, fine_d) = octave(u, v, 2 * NOISE_CELLS, seed ^ 0x9e37_79b9);
    ((coarse + 0.5 * fine) / 1.5, (coarse_d + 0.5 * fine_d) / 1.5)
}

/// One octave with `cells` × `cells` lattice cells per unit tile.
fn octave(u: f64, v: f64, cells: u32, seed: u32) -> (f64, DVec2) {
    let scale = f64::from(cells);
    let (x, y) = ((u - u.floor()) * scale, (v - v.floor()) * scale);
    let (ix, iy) = (x.floor(), y.floor());
    let (fx, fy) = (x - ix, y - iy);
    let corner = |dx: u32, dy: u32| {
        let wrap = |i: f64, d: u32| (i as u32 + d) % cells;
        let g = gradient(wrap(ix, dx), wrap(iy, dy), seed);
        let offset = DVec2::new(fx - f64::from(dx), fy - f64::from(dy));
        (g.dot(offset), g)
    };
    let ((a, ga), (b, gb), (c, gc), (d, gd)) =
        (corner(0, 0), corner(1, 0), corner(0, 1), corner(1, 1));
    let ((sx, dsx), (sy, dsy)) = (fade(fx), fade(fy));
    // n = a + sx (b − a) + sy (c − a) + sx sy (a − b − c + d)
    let twist = a - b - c + d;
    let value = a + sx * (b - a) + sy * (c - a) + sx * sy * twist;
    let slope = ga
        + sx * (gb - ga)
        + sy * (gc - ga)
        + sx * sy * (ga - gb - gc + gd)
        + DVec2::new(dsx * (b - a + sy * twist), dsy * (c - a + sx * twist));
    (value, slope * scale)
}

/// Noise in space with a lattice cell of 1, −1 … 1; zero at lattice points.
pub fn space_noise(p: DVec3, seed: u32) -> f64 {
    let cell = p.floor();
    let f = p - cell;
    let corner = |k: u32| {
        let offset = DVec3::new((k & 1).into(), (k >> 1 & 1).into(), (k >> 2).into());
        // Wraps around after 2³² cells.
        let [x, y, z] = (cell + offset).to_array().map(|i| i as i64 as u32);
        edge_dot(hash(x, y, hash(z, seed, 0)), f - offset)
    };
    let [(sx, _), (sy, _), (sz, _)] = f.to_array().map(fade);
    let mix = |a: f64, b: f64, t: f64| a + t * (b - a);
    let face = |k: u32| {
        let low = mix(corner(k), corner(k + 1), sx);
        mix(low, mix(corner(k + 2), corner(k + 3), sx), sy)
    };
    mix(face(0), face(4), sz).clamp(-1.0, 1.0)
}

/// Octaves of [`space_noise`], each of half the amplitude and twice the frequency of the one before, divided by the sum of
/// the amplitudes: −1 … 1.
pub fn fractal_noise(p: DVec3, octaves: u32, seed: u32) -> f64 {
    let sum: f64 = (0..octaves)
        .map(|k| {
            let frequency = f64::from(1u32 << k);
            space_noise(p * frequency, seed.wrapping_add(k)) / frequency
        })
        .sum();
    sum / (2.0 - 2.0 / f64::from(1u32 << octaves))
}

/// The offset along one of Perlin's twelve directions from the middle of a cube to its edges.
fn edge_dot(hash: u32, d: DVec3) -> f64 {
    let (u, v) = match (hash >> 28) % 3 {
        0 => (d.x, d.y),
        1 => (d.y, d.z),
        _ => (d.z, d.x),
    };
    let sign = |bit: u32, value: f64| if hash >> bit & 1 == 0 { value } else { -value };
    sign(27, u) + sign(26, v)
}

/// Quintic fade 6t⁵ − 15t⁴ + 10t³ and its derivative.
fn fade(t: f64) -> (f64, f64) {
    let value = t * t * t * (t * (t * 6.0 - 15.0) + 10.0);
    let slope = 30.0 * t * t * (t - 1.0) * (t - 1.0);
    (value, slope)
}

/// One of eight directions of length √2, chosen by a hash in place of Perlin's permutation table.
fn gradient(ix: u32, iy: u32, seed: u32) -> DVec2 {
    use std::f64::consts::{FRAC_PI_4, SQRT_2};
    static DIRECTIONS: LazyLock<[DVec2; 8]> = LazyLock::new(|| {
        std::array::from_fn(|eighth| DVec2::from_angle(eighth as f64 * FRAC_PI_4) * SQRT_2)
    });
    DIRECTIONS[(hash(ix, iy, seed) >> 29) as usize]
}

/// Mixes the lattice point and the seed.
fn hash(ix: u32, iy: u32, seed: u32) -> u32 {
    [ix, iy, seed].into_iter().fold(0x2545_f491, |state, word| pcg(state ^ word))
}

/// PCG-RXS-M-XS-32 as a hash (O'Neill 2014; Jarzynski and Olano, JCGT 9(3), 2020).
pub fn pcg(v: u32) -> u32 {
    let state = v.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
    let word = ((state >> ((state >> 28) + 4)) ^ state).wrapping_mul(277_803_737);
    (word >> 22) ^ word
}

#[cfg(test)]
mod tests {
    use super::*;

    fn samples() -> impl Iterator<Item = (f64, f64)> {
        (0..2000).map(|i| {
            let i = f64::from(i);
            ((i * 0.618_034).fract() * 3.0 - 1.0, (i * 0.414_214).fract() * 3.0 - 1.0)
        })
    }

    #[test]
    fn derivatives_match_differences() {
        let h = 1e-6;
        for (u, v) in samples() {
            let (_, d) = tile_noise(u, v, 7);
            let du = (tile_noise(u + h, v, 7).0 - tile_noise(u - h, v, 7).0) / (2.0 * h);
            let dv = (tile_noise(u, v + h, 7).0 - tile_noise(u, v - h, 7).0) / (2.0 * h);
            assert!((d - DVec2::new(du, dv)).length() < 1e-5, "at {u}, {v}");
        }
    }

    #[test]
    fn repeats_after_one_tile_and_stays_bounded() {
        let mut largest = 0.0f64;
        for (u, v) in samples() {
            let (n, d) = tile_noise(u, v, 3);
            let (m, e) = tile_noise(u + 1.0, v - 2.0, 3);
            assert!((n - m).abs() < 1e-9 && (d - e).length() < 1e-6);
            largest = largest.max(n.abs());
        }
        assert!(largest <= 1.0 && largest > 0.3, "{largest}");
        assert_ne!(tile_noise(0.31, 0.77, 1), tile_noise(0.31, 0.77, 2), "seeds differ");
    }

    #[test]
    fn noise_in_space_is_bounded_continuous_and_zero_on_the_lattice() {
        let mut largest = 0.0f64;
        for i in 0..2000 {
            let i = f64::from(i);
            let p = DVec3::new(i * 0.618_034, i * 0.414_214 - 300.0, i * 0.259_921);
            let n = space_noise(p, 3);
            largest = largest.max(n.abs());
            assert!((n - space_noise(p + 1e-9, 3)).abs() < 1e-7);
            assert!(space_noise(p.floor(), 3).abs() < 1e-12);
            assert!(fractal_noise(p, 5, 3).abs() <= 1.0);
        }
        assert!(largest <= 1.0 && largest > 0.7, "{largest}");
        let edge = DVec3::new(2.0, 0.4, 0.7);
        let step = DVec3::X * 1e-9;
        assert!((space_noise(edge - step, 1) - space_noise(edge + step, 1)).abs() < 1e-7);
    }
}
