//! Single shapes.

use std::f64::consts::TAU;

use fathom_base::settings;
use glam::DVec3;

use crate::Mesh;
use crate::noise::tile_noise;
use crate::shapes::{self, grounded, moved};

settings! {
    pub struct Plane {
        /// Extent in x.
        width_m: f64 = 20.0 => 0.01 ..= 10_000.0, "m";
        /// Extent in z.
        depth_m: f64 = 20.0 => 0.01 ..= 10_000.0, "m";
    }
    pub struct Corner {
        /// Edge of each plane.
        size_m: f64 = 4.0 => 0.01 ..= 10_000.0, "m";
    }
    pub struct Block {
        /// Extent in x.
        width_m: f64 = 1.0 => 0.001 ..= 1000.0, "m";
        /// Extent in y.
        height_m: f64 = 1.0 => 0.001 ..= 1000.0, "m";
        /// Extent in z.
        depth_m: f64 = 1.0 => 0.001 ..= 1000.0, "m";
    }
    pub struct Cylinder {
        /// Radius.
        radius_m: f64 = 0.5 => 0.001 ..= 1000.0, "m";
        /// Height.
        height_m: f64 = 1.0 => 0.001 ..= 1000.0, "m";
        /// Sides.
        segments: u32 = 48 => 3 ..= 200, "1";
    }
    pub struct Sphere {
        /// Radius.
        radius_m: f64 = 0.5 => 0.001 ..= 1000.0, "m";
        /// Rings from pole to pole.
        rows: u32 = 32 => 3 ..= 100, "1";
    }
    pub struct Torus {
        /// Radius of the ring's middle.
        radius_m: f64 = 0.7 => 0.001 ..= 1000.0, "m";
        /// Radius of its tube.
        tube_m: f64 = 0.22 => 0.001 ..= 1000.0, "m";
        /// Quads around the ring.
        segments: u32 = 72 => 3 ..= 200, "1";
        /// Quads around the tube.
        sides: u32 = 32 => 3 ..= 100, "1";
    }
    pub struct Blob {
        /// Rings from pole to pole.
        rows: u32 = 40 => 3 ..= 160, "1";
    }
    pub struct Knot {
        /// Outer radius.
        radius_m: f64 = 1.0 => 0.001 ..= 1000.0, "m";
        /// Quads along the tube.
        segments: u32 = 200 => 24 ..= 700, "1";
        /// Quads around the tube.
        sides: u32 = 28 => 3 ..= 160, "1";
    }
}

pub fn plane(a: &Plane) -> Mesh {
    shapes::sheet((1, 1), |u, v| DVec3::new((u - 0.5) * a.width_m, 0.0, (0.5 - v) * a.depth_m))
}

pub fn corner(a: &Corner) -> Mesh {
    let axes = DVec3::AXES.map(|axis| axis * a.size_m);
    shapes::merged((0..3).map(|i| {
        let (u, v) = (axes[(i + 1) % 3], axes[(i + 2) % 3]);
        shapes::quad([DVec3::ZERO, u, u + v, v])
    }))
}

pub fn block(a: &Block) -> Mesh {
    shapes::block(a.width_m, a.height_m, a.depth_m)
}

pub fn cylinder(a: &Cylinder) -> Mesh {
    shapes::cylinder(a.radius_m, a.height_m, a.segments as usize)
}

pub fn sphere(a: &Sphere) -> Mesh {
    moved(shapes::sphere(a.radius_m, a.rows as usize), 0.0, a.radius_m, 0.0)
}

pub fn torus(a: &Torus) -> Mesh {
    let mesh = shapes::torus(a.radius_m, a.tube_m, a.segments as usize, a.sides as usize);
    moved(mesh, 0.0, a.tube_m, 0.0)
}

/// Three slices of the noise, one per axis, bend the ball.
pub fn blob(a: &Blob) -> Mesh {
    let (radius, bump) = (0.75, 0.35);
    grounded(shapes::displaced_sphere(a.rows as usize, |d| {
        let p = d * 0.12 + 0.37;
        let bumps =
            tile_noise(p.x, p.y, 1).0 + tile_noise(p.y, p.z, 0).0 + tile_noise(p.z, p.x, 3).0;
        d * radius * (1.0 + bump * bumps.clamp(-1.0, 1.0))
    }))
}

/// A trefoil, standing upright.
pub fn knot(a: &Knot) -> Mesh {
    let (scale, n) = (a.radius_m / 3.8, a.segments as usize);
    let path: Vec<DVec3> = (0..n)
        .map(|i| {
            let t = TAU * i as f64 / n as f64;
            let (ring, lift) = (2.0 + (3.0 * t).cos(), (3.0 * t).sin());
            DVec3::new(ring * (2.0 * t).cos(), ring * (2.0 * t).sin(), lift) * scale
        })
        .collect();
    grounded(shapes::tube(&path, &vec![0.7 * scale; n], a.sides as usize, true))
}
