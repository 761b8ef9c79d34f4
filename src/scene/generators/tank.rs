//! Parts of the water tank.

use std::f64::consts::TAU;

use fathom_base::settings;
use glam::DVec3;

use crate::Mesh;
use crate::shapes::{
    block, cuboid, displaced_sphere, lathe, merged, moved, quad, scaled, smooth_path,
    smooth_profile, tube, turned,
};

settings! {
    pub struct Basin {
        /// Inner extent in x.
        width_m: f64 = 10.0 => 0.1 ..= 1000.0, "m";
        /// Inner extent in z.
        depth_m: f64 = 12.0 => 0.1 ..= 1000.0, "m";
        /// Height of the rim above the water.
        rim_m: f64 = 0.4 => 0.0 ..= 100.0, "m";
        /// Thickness of the walls.
        wall_m: f64 = 0.4 => 0.01 ..= 100.0, "m";
    }
    pub struct Column {
        /// Radius of the shaft.
        radius_m: f64 = 0.35 => 0.01 ..= 100.0, "m";
        /// Overall height.
        height_m: f64 = 2.6 => 0.1 ..= 100.0, "m";
    }
    pub struct Steps {
        /// Extent in x.
        width_m: f64 = 3.0 => 0.1 ..= 100.0, "m";
        /// Height of one step.
        rise_m: f64 = 0.25 => 0.01 ..= 10.0, "m";
        /// Depth of one step.
        run_m: f64 = 0.35 => 0.01 ..= 10.0, "m";
        /// Number of steps.
        count: u32 = 6 => 1 ..= 100, "1";
    }
    pub struct Statue {
        /// Overall height.
        height_m: f64 = 2.2 => 0.1 ..= 100.0, "m";
    }
}

/// Inner walls and floor, top of the rim, and outer walls.
pub fn basin(a: &Basin, floor_depth_m: f64) -> Mesh {
    let (x, z, wall) = (0.5 * a.width_m, 0.5 * a.depth_m, a.wall_m);
    let top = floor_depth_m + a.rim_m;
    let inside = cuboid([-x, 0.0, -z], [x, top, z]).inverted();
    let (ox, oz) = (x + wall, z + wall);
    let outside = cuboid([-ox, -wall, -oz], [ox, top, oz]);
    let corner = |x: f64, z: f64| DVec3::new(x, top, z);
    let rim = [
        quad([corner(-ox, oz), corner(ox, oz), corner(x, z), corner(-x, z)]),
        quad([corner(ox, oz), corner(ox, -oz), corner(x, -z), corner(x, z)]),
        quad([corner(ox, -oz), corner(-ox, -oz), corner(-x, -z), corner(x, -z)]),
        quad([corner(-ox, -oz), corner(-ox, oz), corner(-x, z), corner(-x, -z)]),
    ];
    merged([without_lid(inside, top), without_lid(outside, top)].into_iter().chain(rim))
}

/// The mesh without its triangles in the plane y = `top`.
fn without_lid(mut mesh: Mesh, top: f64) -> Mesh {
    let kept = (0..mesh.triangle_count())
        .filter(|&t| mesh.triangle(t).iter().any(|p| (p.y - top).abs() > 1e-4));
    mesh.indices = kept.flat_map(|t| mesh.indices[3 * t..3 * t + 3].to_vec()).collect();
    mesh
}

pub fn column(&Column { radius_m: r, height_m: h }: &Column) -> Mesh {
    let foot = (0.16 * h).min(0.9 * r);
    let (low, high) = (foot, h - foot);
    let shaft: Vec<(f64, f64)> = (0..=20)
        .map(|i| {
            let t = f64::from(i) / 20.0;
            // Entasis: the shaft swells a little at a third of its height.
            (r * (1.0 - 0.12 * t + 0.05 * (TAU * 0.5 * t).sin()), low + (high - low) * t)
        })
        .collect();
    let grooves = |angle: f64, _: f64| 1.0 - 0.05 * (0.5 + 0.5 * (16.0 * angle).cos());
    let ring = [(1.35, 0.35), (1.4, 0.5), (1.15, 0.7), (1.25, 0.85), (1.0, 1.0)];
    let mut base = smooth_profile(&ring.map(|(k, y)| (k * r, y * foot)), 4);
    // Closed inwards, under the grooves.
    base.extend([(r, foot), (0.7 * r, foot)]);
    let capital: Vec<(f64, f64)> = base.iter().rev().map(|&(r, y)| (0.95 * r, h - y)).collect();
    merged([
        block(2.9 * r, 0.35 * foot, 2.9 * r),
        lathe(&base, 48),
        turned(&shaft, 96, grooves),
        lathe(&capital, 48),
        moved(block(2.8 * r, 0.35 * foot, 2.8 * r), 0.0, h - 0.35 * foot, 0.0),
    ])
}

pub fn steps(a: &Steps) -> Mesh {
    let (x, rise, run) = (0.5 * a.width_m, a.rise_m, a.run_m);
    merged((0..a.count).map(|i| {
        let (front, back) = (-f64::from(i) * run, -f64::from(a.count) * run);
        let (bottom, top) = (f64::from(i) * rise, f64::from(i + 1) * rise);
        cuboid([-x, bottom, back], [x, top, front])
    }))
}

/// A figure of unit height on its pedestal, scaled.
pub fn statue(a: &Statue) -> Mesh {
    let pedestal = [
        block(0.34, 0.05, 0.34),
        cuboid([-0.14, 0.05, -0.14], [0.14, 0.2, 0.14]),
        cuboid([-0.16, 0.2, -0.16], [0.16, 0.23, 0.16]),
    ];
    let robe = smooth_profile(
        &[
            (0.0, 0.23),
            (0.125, 0.23),
            (0.115, 0.3),
            (0.1, 0.45),
            (0.085, 0.58),
            (0.072, 0.64),
            (0.095, 0.74),
            (0.1, 0.8),
            (0.06, 0.845),
            (0.028, 0.86),
            (0.026, 0.89),
        ],
        7,
    );
    let body = turned(&robe, 72, |angle, y| {
        // Folds of the robe deepen towards the hem; the chest is flatter than wide.
        let depth = 0.11 * ((0.66 - y) / 0.43).clamp(0.0, 1.0);
        let folds = 1.0 + depth * (9.0 * angle + 14.0 * y).sin();
        let chest = 1.0 - 0.3 * ((y - 0.6) / 0.2).clamp(0.0, 1.0) * angle.sin().powi(2);
        folds * chest
    });
    let head = displaced_sphere(24, |d| {
        let nose = 0.012 * (-((d - DVec3::new(0.0, -0.1, 0.99)).length_squared()) / 0.03).exp();
        d * DVec3::new(0.042, 0.056, 0.05) + DVec3::new(0.0, 0.935, nose + 0.006)
    });
    let arm = |knots: &[DVec3]| {
        let path = smooth_path(knots, 7);
        let n = path.len() as f64;
        let radii: Vec<f64> = (0..path.len()).map(|i| 0.03 - 0.013 * i as f64 / n).collect();
        tube(&path, &radii, 20, false)
    };
    let raised =
        [(-0.085, 0.795, 0.0), (-0.15, 0.77, 0.03), (-0.185, 0.85, 0.07), (-0.17, 0.97, 0.1)];
    let lowered = [(0.085, 0.795, 0.0), (0.135, 0.7, 0.0), (0.13, 0.6, 0.06), (0.07, 0.58, 0.11)];
    let arms = [raised, lowered].map(|knots| arm(&knots.map(|(x, y, z)| DVec3::new(x, y, z))));
    let figure = merged(pedestal.into_iter().chain([body, head]).chain(arms));
    scaled(figure, a.height_m)
}
