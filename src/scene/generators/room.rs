//! A room and its furniture.

use fathom_base::settings;
use glam::{DMat4, DVec3};

use super::Dice;
use crate::Mesh;
use crate::shapes::{at_corners, bar, block, cuboid, displaced_sphere, lathe, merged, moved};

settings! {
    pub struct Interior {
        /// Outer extent in x.
        width_m: f64 = 4.0 => 0.1 ..= 1000.0, "m";
        /// Outer extent in y.
        height_m: f64 = 3.23 => 0.1 ..= 1000.0, "m";
        /// Outer extent in z.
        depth_m: f64 = 3.326 => 0.1 ..= 1000.0, "m";
        /// Share of the wall that the window is wide.
        window: f64 = 0.6 => 0.0 ..= 0.95, "1";
        /// Share of the height below the window.
        sill: f64 = 0.3 => 0.0 ..= 1.0, "1";
    }
    pub struct Sofa {
        /// Extent in x.
        width_m: f64 = 1.8 => 0.2 ..= 100.0, "m";
    }
}

/// Six sides, the one at −x in four parts around the window.
pub fn interior(a: &Interior) -> Mesh {
    let (width, height, depth) = (a.width_m, a.height_m, a.depth_m);
    let t = 0.1f64.min(0.2 * width.min(height).min(depth));
    let (x, z) = (0.5 * width, 0.5 * depth);
    let mut mesh = merged([
        cuboid([-x, 0.0, -z], [x, t, z]),
        cuboid([-x, height - t, -z], [x, height, z]),
        cuboid([-x, t, -z], [x, height - t, t - z]),
        cuboid([-x, t, z - t], [x, height - t, z]),
        cuboid([x - t, t, t - z], [x, height - t, z - t]),
    ]);
    let half = a.window * (z - t);
    let inner = height - 2.0 * t;
    let low = t + a.sill * inner;
    let high = (height - t - 0.15 * inner).max(low);
    let (near, far) = (t - z, z - t);
    let parts = [
        [[t, near], [low, far]],
        [[high, near], [height - t, far]],
        [[low, near], [high, -half]],
        [[low, half], [high, far]],
    ];
    for [[y0, z0], [y1, z1]] in parts {
        if y0 < y1 && z0 < z1 {
            mesh.append(&cuboid([-x, y0, z0], [t - x, y1, z1]));
        }
    }
    mesh
}

pub fn table(size: DVec3) -> Mesh {
    let top = 0.05 * size.y;
    let leg = 0.06 * size.x.min(size.z);
    let board = moved(block(size.x, top, size.z), 0.0, size.y - top, 0.0);
    let frame = block(size.x - 4.0 * leg, 0.1 * size.y, size.z - 4.0 * leg);
    let frame = moved(frame, 0.0, size.y - top - 0.1 * size.y, 0.0);
    let (x, z) = (0.5 * size.x - 1.5 * leg, 0.5 * size.z - 1.5 * leg);
    merged([board, frame, at_corners(&block(leg, size.y - top, leg), x, z)])
}

pub fn chair() -> Mesh {
    let h = 0.95;
    let (side, seat, thick) = (0.45 * h, 0.47 * h, 0.045 * h);
    let mut mesh = table(DVec3::new(side, seat, side));
    let (x, z) = (0.5 * side - 0.6 * thick, 0.6 * thick - 0.5 * side);
    for sx in [-1.0, 1.0] {
        let (foot, head) = (DVec3::new(sx * x, seat, z), DVec3::new(sx * x, h, z - 0.05 * h));
        mesh.append(&bar(foot, head, thick));
    }
    for i in 0..3 {
        let t = 0.4 + 0.25 * f64::from(i);
        let slat = block(2.0 * x, 0.1 * h, 0.4 * thick);
        mesh.append(&moved(slat, 0.0, seat + t * (h - seat), z - 0.05 * h * t));
    }
    mesh
}

pub fn bookcase() -> Mesh {
    let (width, height, depth, levels) = (1.0, 2.0, 0.3, 5);
    let t = 0.04;
    let mut dice = Dice::new(1);
    let back = moved(block(width, height, 0.5 * t), 0.0, 0.0, 0.25 * t - 0.5 * depth);
    let sides =
        [-1.0, 1.0].map(|s| moved(block(t, height, depth), s * 0.5 * (width - t), 0.0, 0.0));
    let mut mesh = merged([back].into_iter().chain(sides));
    let step = (height - t) / f64::from(levels);
    for i in 0..=levels {
        let board = block(width - 2.0 * t, t, depth);
        mesh.append(&moved(board, 0.0, f64::from(i) * step, 0.0));
    }
    let inner = width - 2.2 * t;
    for i in 0..levels {
        let mut x = -0.5 * inner;
        let full = dice.between(0.5, 0.95) * inner;
        loop {
            let thick = inner * dice.between(0.025, 0.07);
            if x + thick > full - 0.5 * inner {
                break;
            }
            let tall = (step - t) * dice.between(0.6, 0.9);
            let book = block(0.94 * thick, tall, depth * dice.between(0.55, 0.75));
            mesh.append(&moved(book, x + 0.5 * thick, f64::from(i) * step + t, -0.06 * depth));
            x += thick;
        }
    }
    mesh
}

/// A block with rounded edges, standing on y = 0: a superellipsoid of fourth power.
fn cushion(size: DVec3) -> Mesh {
    let mesh = displaced_sphere(14, |d| {
        let power = |v: f64| v.signum() * v.abs().powf(0.5);
        DVec3::new(power(d.x), power(d.y), power(d.z)) * 0.5 * size
    });
    moved(mesh, 0.0, 0.5 * size.y, 0.0)
}

pub fn sofa(&Sofa { width_m: width }: &Sofa) -> Mesh {
    let (depth, arm) = (0.85, 0.09 * width);
    let inner = width - 2.0 * arm;
    let each = inner / 3.0;
    let mut mesh = merged([
        moved(block(width - 0.04, 0.22, depth - 0.04), 0.0, 0.06, 0.0),
        moved(cushion(DVec3::new(width, 0.5, 0.22)), 0.0, 0.28, 0.11 - 0.5 * depth),
    ]);
    for s in [-1.0, 1.0] {
        let rest = cushion(DVec3::new(arm, 0.5, depth));
        mesh.append(&moved(rest, s * 0.5 * (width - arm), 0.06, 0.0));
    }
    for i in 0..3 {
        let x = (f64::from(i) + 0.5) * each - 0.5 * inner;
        let seat = cushion(DVec3::new(0.98 * each, 0.18, depth - 0.2));
        mesh.append(&moved(seat, x, 0.26, 0.1));
        let lean = DMat4::from_rotation_x(-0.2);
        let back = cushion(DVec3::new(0.96 * each, 0.42, 0.16)).transformed(&lean);
        mesh.append(&moved(back, x, 0.4, 0.34 - 0.5 * depth));
    }
    mesh.append(&at_corners(&block(0.05, 0.07, 0.05), 0.5 * width - 0.1, 0.5 * depth - 0.1));
    mesh
}

/// Foot and pole in one piece, the shade a thin open cone beside them.
pub fn lamp() -> Mesh {
    let h = 1.6;
    let (foot, pole) = (0.1 * h, 0.009 * h);
    let stand = [
        (0.0, 0.0),
        (foot, 0.0),
        (foot, 0.0),
        (foot, 0.012 * h),
        (foot, 0.012 * h),
        (pole, 0.02 * h),
        (pole, 0.02 * h),
        (pole, 0.9 * h),
        (pole, 0.9 * h),
        (0.0, 0.9 * h),
    ];
    let (wide, narrow, t) = (0.16 * h, 0.09 * h, 0.006 * h);
    let (low, high) = (0.78 * h, h);
    let shade = [
        (wide - t, low),
        (wide, low),
        (wide, low),
        (narrow, high),
        (narrow, high),
        (narrow - t, high),
        (narrow - t, high),
        (wide - t, low),
    ];
    merged([lathe(&stand, 32), lathe(&shade, 32)])
}
