//! Parts of the small port.

use std::f64::consts::{PI, TAU};

use fathom_base::settings;
use glam::{DMat4, DVec3, EulerRot};

use super::Dice;
use crate::Mesh;
use crate::noise::tile_noise;
use crate::shapes::{
    block, cuboid, cylinder, displaced_sphere, lathe, merged, moved, sheet, smooth_profile, tube,
};

settings! {
    pub struct SeaBed {
        /// Extent in x.
        width_m: f64 = 30.0 => 0.1 ..= 1000.0, "m";
        /// Extent in z.
        depth_m: f64 = 26.0 => 0.1 ..= 1000.0, "m";
        /// Height of the bumps.
        bump_m: f64 = 0.35 => 0.0 ..= 20.0, "m";
        /// Rise from the front to the back.
        rise_m: f64 = 0.6 => -20.0 ..= 20.0, "m";
        /// Quads along each side.
        cells: u32 = 96 => 1 ..= 200, "1";
        /// Seed of the random numbers.
        seed: u32 = 1 => 0 ..= 4_294_967_295u32, "1";
    }
    pub struct Quay {
        /// Extent in x.
        length_m: f64 = 30.0 => 0.5 ..= 1000.0, "m";
        /// Extent in z, behind z = 0.
        depth_m: f64 = 4.0 => 0.2 ..= 1000.0, "m";
        /// Height of its top above the water.
        height_m: f64 = 1.1 => 0.05 ..= 100.0, "m";
        /// Seed of the random numbers.
        seed: u32 = 1 => 0 ..= 4_294_967_295u32, "1";
    }
    pub struct Pier {
        /// Extent in z.
        length_m: f64 = 10.0 => 0.5 ..= 1000.0, "m";
        /// Extent in x.
        width_m: f64 = 2.2 => 0.2 ..= 100.0, "m";
        /// Height of the deck above the water.
        height_m: f64 = 0.75 => -10.0 ..= 100.0, "m";
        /// Seed of the random numbers.
        seed: u32 = 1 => 0 ..= 4_294_967_295u32, "1";
    }
    pub struct Stones {
        /// Number of stones.
        count: u32 = 40 => 1 ..= 200, "1";
        /// Extent in x.
        width_m: f64 = 10.0 => 0.1 ..= 1000.0, "m";
        /// Extent in z.
        depth_m: f64 = 3.0 => 0.1 ..= 1000.0, "m";
        /// Largest radius.
        size_m: f64 = 0.45 => 0.01 ..= 100.0, "m";
        /// Seed of the random numbers.
        seed: u32 = 1 => 0 ..= 4_294_967_295u32, "1";
    }
    pub struct Hull {
        /// Length.
        length_m: f64 = 4.6 => 0.2 ..= 200.0, "m";
        /// Width.
        beam_m: f64 = 1.7 => 0.1 ..= 100.0, "m";
    }
    pub struct Rope {
        /// The point's x.
        to_x_m: f64 = 2.0 => -1000.0 ..= 1000.0, "m";
        /// The point's y.
        to_y_m: f64 = 0.0 => -1000.0 ..= 1000.0, "m";
        /// The point's z.
        to_z_m: f64 = 0.0 => -1000.0 ..= 1000.0, "m";
        /// How far its middle hangs below the straight line.
        sag_m: f64 = 0.4 => 0.0 ..= 100.0, "m";
    }
}

pub fn sea_bed(a: &SeaBed) -> Mesh {
    sheet((a.cells as usize, a.cells as usize), |u, v| {
        let (x, z) = ((u - 0.5) * a.width_m, (0.5 - v) * a.depth_m);
        let (swell, _) = tile_noise(x / 40.0, z / 40.0, a.seed);
        let (ripple, _) = tile_noise(x / 9.0, z / 9.0, a.seed ^ 5);
        let slope = v * v * (3.0 - 2.0 * v);
        DVec3::new(x, a.bump_m * (1.6 * swell + 0.25 * ripple) + a.rise_m * slope, z)
    })
}

/// A core with courses of blocks before it, each a little out of line, and coping stones on top.
pub fn quay(a: &Quay, floor_depth_m: f64) -> Mesh {
    let (length, depth, top) = (a.length_m, a.depth_m, floor_depth_m + a.height_m);
    let mut dice = Dice::new(a.seed);
    let coping = 0.18f64.min(0.3 * top);
    let half = 0.5 * length;
    let mut mesh = cuboid([-half, -1.0, -depth], [half, top - coping, -0.12]);
    let courses = ((top / 0.55).ceil() as usize).clamp(1, 40);
    let course = (top - coping) / courses as f64;
    let blocks = ((length / (2.2 * course)).ceil() as usize).clamp(1, 60);
    let step = length / blocks as f64;
    for row in 0..courses {
        let shift = if row % 2 == 0 { 0.0 } else { 0.5 * step };
        for i in 0..=blocks {
            let left = (i as f64 * step - shift - half).max(-half);
            let right = ((i + 1) as f64 * step - shift - half).min(half);
            if right - left > 0.05 * step {
                let y = row as f64 * course;
                let face = dice.between(-0.035, 0.035);
                let (low, high) = (DVec3::new(left, y, -0.3), DVec3::new(right, y + course, face));
                mesh.append(&cuboid(low + 0.008, high - DVec3::new(0.008, 0.008, 0.0)));
            }
        }
    }
    let stones = ((length / 1.4).ceil() as usize).clamp(1, 200);
    let step = length / stones as f64;
    for i in 0..stones {
        let left = i as f64 * step - half;
        let low = DVec3::new(left + 0.01, top - coping, -depth);
        let high = DVec3::new(left + step - 0.01, top + dice.between(-0.012, 0.012), 0.1);
        mesh.append(&cuboid(low, high));
    }
    mesh
}

pub fn pier(a: &Pier, floor_depth_m: f64) -> Mesh {
    let (length, width) = (a.length_m, a.width_m);
    let deck = (floor_depth_m + a.height_m).max(0.3);
    let mut dice = Dice::new(a.seed);
    let half = 0.5 * length;
    let planks = ((length / 0.2).round() as usize).clamp(1, 400);
    let step = length / planks as f64;
    let mut mesh = merged((0..planks).map(|i| {
        let z = i as f64 * step - half;
        let (left, right) = (dice.between(-0.05, 0.05), dice.between(-0.05, 0.05));
        cuboid(
            [-0.5 * width + left, deck - 0.05, z + 0.06 * step],
            [0.5 * width + right, deck + dice.between(-0.006, 0.006), z + 0.94 * step],
        )
    }));
    let side = 0.5 * width - 0.2 * width.min(0.8);
    for x in [-side, side] {
        let beam = block(0.16, 0.2, length);
        mesh.append(&moved(beam, x, deck - 0.25, 0.0));
    }
    let rows = ((length / 2.0).round() as usize).clamp(1, 100);
    for row in 0..=rows {
        let z = (row as f64 / rows as f64 - 0.5) * (length - 0.4);
        for x in [-side, side] {
            let mut tilt = || dice.between(-0.02, 0.02);
            let lean = DMat4::from_euler(EulerRot::XYZ, tilt(), 0.0, tilt());
            let height = deck + dice.between(0.05, 0.5);
            let pile = pile(0.13, height + 0.6).transformed(&lean);
            mesh.append(&moved(pile, x * 1.12, -0.6, z));
        }
        let tie = block(2.0 * side, 0.14, 0.1);
        mesh.append(&moved(tie, 0.0, deck - 0.45, z + 0.16));
    }
    mesh
}

/// A trunk that is a little thicker at its foot, with a bevelled head.
fn pile(radius: f64, height: f64) -> Mesh {
    let r = radius;
    lathe(
        &[
            (0.0, 0.0),
            (1.15 * r, 0.0),
            (1.15 * r, 0.0),
            (1.05 * r, 0.4 * height),
            (r, height - 0.05),
            (r, height - 0.05),
            (0.75 * r, height),
            (0.75 * r, height),
            (0.0, height),
        ],
        20,
    )
}

pub fn stones(a: &Stones) -> Mesh {
    let mut dice = Dice::new(a.seed);
    merged((0..a.count).map(|i| {
        let place = (dice.between(-0.5, 0.5) * a.width_m, dice.between(-0.5, 0.5) * a.depth_m);
        let radius = a.size_m * dice.between(0.25, 1.0).powf(1.5);
        stone(&mut dice, radius, a.seed ^ i, place)
    }))
}

/// A flattened ball with facets and bumps, half sunk into the ground.
fn stone(dice: &mut Dice, radius: f64, seed: u32, (x, z): (f64, f64)) -> Mesh {
    let shape =
        DVec3::new(dice.between(0.8, 1.3), dice.between(0.55, 0.85), dice.between(0.8, 1.2));
    let mesh = displaced_sphere(9, |d| {
        let p = d * 0.09 + 0.4;
        let bumps = tile_noise(p.x, p.y + p.z, seed).0 + tile_noise(p.z, p.x - p.y, !seed).0;
        d * shape * radius * (1.0 + 0.45 * bumps)
    });
    let yaw = dice.between(0.0, TAU);
    let mut tilt = || dice.between(-0.3, 0.3);
    let rotation = DMat4::from_euler(EulerRot::YXZ, yaw, tilt(), tilt());
    moved(mesh.transformed(&rotation), x, 0.25 * radius, z)
}

/// Outside, inside and gunwale of the planking, and thwarts.
pub fn hull(&Hull { length_m: length, beam_m: beam }: &Hull) -> Mesh {
    let (draught, freeboard) = (0.35, 0.5);
    let thickness = 0.03 * beam;
    // u runs along the boat from the bow, v from the left gunwale over the keel to the right one.
    let skin = |inset: f64| {
        move |u: f64, v: f64| {
            let z = (u - 0.5) * length;
            // The bow comes to a point, the stern is a narrow transom.
            let fullness = (1.0 - (1.0 - (u / 0.55).min(1.0)).powi(2)).sqrt()
                * (1.0 - 0.35 * ((u - 0.55) / 0.45).max(0.0).powi(2));
            let sheer = 1.0 + 0.35 * (2.0 * u - 1.1).powi(2);
            let side = (v - 0.5) * 2.0;
            let angle = side * 0.5 * PI;
            let half = (0.5 * beam * fullness - inset).max(0.0);
            let rocker = 1.0 - 0.7 * (1.0 - u).powi(6);
            let keel = -draught * rocker + inset;
            let top = freeboard * sheer;
            let rise = 1.0 - angle.cos().abs().powf(1.3);
            DVec3::new(half * angle.sin(), keel + (top - keel) * rise, z)
        }
    };
    let (outer, inner) = (skin(0.0), skin(thickness));
    let outside = sheet((28, 20), outer).inverted();
    let inside = sheet((28, 20), inner);
    let gunwales = [0.0, 1.0].map(|v: f64| {
        let strip = sheet((28, 1), |u, w| outer(u, v).lerp(inner(u, v), w));
        if v == 1.0 { strip.inverted() } else { strip }
    });
    let transom = sheet((28, 1), |v, w| outer(1.0, v).lerp(inner(1.0, v), w));
    let plate = |depth: f64| {
        sheet((28, 1), |v, w| {
            let p = outer(1.0, v);
            p.lerp(DVec3::new(0.0, p.y, p.z), w) - DVec3::Z * depth
        })
    };
    let lid = sheet((1, 1), |side, w| {
        outer(1.0, 0.0).lerp(outer(1.0, 1.0), side) - DVec3::Z * (w * thickness)
    });
    let thwarts = [0.3, 0.55, 0.8].map(|u: f64| {
        let half = inner(u, 0.78).x;
        moved(block(2.0 * half, 0.04, 0.22), 0.0, 0.35 * freeboard, (u - 0.5) * length)
    });
    let sides = [outside, inside, transom, plate(0.0), plate(thickness).inverted(), lid];
    merged(sides.into_iter().chain(gunwales).chain(thwarts))
}

pub fn bollard() -> Mesh {
    let h = 0.55;
    let profile = smooth_profile(
        &[
            (0.3, 0.0),
            (0.3, 0.06),
            (0.2, 0.12),
            (0.17, 0.4),
            (0.19, 0.6),
            (0.32, 0.72),
            (0.34, 0.82),
            (0.26, 0.95),
            (0.0, 1.0),
        ],
        3,
    );
    let scaled: Vec<(f64, f64)> = profile.iter().map(|&(r, y)| (r * h, y * h)).collect();
    merged([lathe(&scaled, 24), cylinder(0.4 * h, 0.04 * h, 24)])
}

pub fn rope(a: &Rope) -> Mesh {
    let end = DVec3::new(a.to_x_m, a.to_y_m, a.to_z_m);
    let path: Vec<DVec3> = (0..=32)
        .map(|i| {
            let t = f64::from(i) / 32.0;
            end * t - DVec3::Y * (4.0 * a.sag_m * t * (1.0 - t))
        })
        .collect();
    tube(&path, &vec![0.025; path.len()], 8, false)
}
