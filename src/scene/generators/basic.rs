//! Single shapes.

use std::f64::consts::TAU;

use glam::DVec3;

use super::{Args, Generator, generator, param};
use crate::Mesh;
use crate::noise::tile_noise;
use crate::shapes::{self, grounded, moved};

pub const GENERATORS: &[Generator] =
    &[
        generator("plane", "a level rectangle that faces up", plane).with(&[
            param("width_m", 20.0, 0.01, 10_000.0, "extent in x"),
            param("depth_m", 20.0, 0.01, 10_000.0, "extent in z"),
        ]),
        generator(
            "corner",
            "three square planes that meet at right angles in the origin and face +x, +y and +z",
            corner,
        )
        .with(&[param("size_m", 4.0, 0.01, 10_000.0, "edge of each plane")]),
        generator("box", "a box standing on the floor", |a| {
            shapes::block(a.get("width_m"), a.get("height_m"), a.get("depth_m"))
        })
        .with(&[
            param("width_m", 1.0, 0.001, 1000.0, "extent in x"),
            param("height_m", 1.0, 0.001, 1000.0, "extent in y"),
            param("depth_m", 1.0, 0.001, 1000.0, "extent in z"),
        ]),
        generator("cylinder", "a round bar standing on the floor", |a| {
            shapes::cylinder(a.get("radius_m"), a.get("height_m"), a.count("segments"))
        })
        .with(&[
            param("radius_m", 0.5, 0.001, 1000.0, "radius"),
            param("height_m", 1.0, 0.001, 1000.0, "height"),
            param("segments", 48.0, 3.0, 200.0, "sides"),
        ]),
        generator("sphere", "a ball that touches the floor", |a| {
            let radius = a.get("radius_m");
            moved(shapes::sphere(radius, a.count("rows")), 0.0, radius, 0.0)
        })
        .with(&[
            param("radius_m", 0.5, 0.001, 1000.0, "radius"),
            param("rows", 32.0, 3.0, 100.0, "rings from pole to pole"),
        ]),
        generator("torus", "a ring lying on the floor", |a| {
            let tube = a.get("tube_m");
            let mesh =
                shapes::torus(a.get("radius_m"), tube, a.count("segments"), a.count("sides"));
            moved(mesh, 0.0, tube, 0.0)
        })
        .with(&[
            param("radius_m", 0.7, 0.001, 1000.0, "radius of the ring's middle"),
            param("tube_m", 0.22, 0.001, 1000.0, "radius of its tube"),
            param("segments", 72.0, 3.0, 200.0, "quads around the ring"),
            param("sides", 32.0, 3.0, 100.0, "quads around the tube"),
        ]),
        generator("blob", "a ball with bumps, a stand-in for scanned objects", blob)
            .with(&[param("rows", 40.0, 3.0, 160.0, "rings from pole to pole")]),
        generator("knot", "a knotted tube, a stand-in for scanned objects", knot).with(&[
            param("radius_m", 1.0, 0.001, 1000.0, "outer radius"),
            param("segments", 200.0, 24.0, 700.0, "quads along the tube"),
            param("sides", 28.0, 3.0, 160.0, "quads around the tube"),
        ]),
    ];

fn plane(a: &Args) -> Mesh {
    let (width, depth) = (a.get("width_m"), a.get("depth_m"));
    shapes::sheet((1, 1), |u, v| DVec3::new((u - 0.5) * width, 0.0, (0.5 - v) * depth))
}

fn corner(a: &Args) -> Mesh {
    let axes = DVec3::AXES.map(|axis| axis * a.get("size_m"));
    shapes::merged((0..3).map(|i| {
        let (u, v) = (axes[(i + 1) % 3], axes[(i + 2) % 3]);
        shapes::quad([DVec3::ZERO, u, u + v, v])
    }))
}

/// Three slices of the noise, one per axis, bend the ball.
fn blob(a: &Args) -> Mesh {
    let (radius, bump) = (0.75, 0.35);
    grounded(shapes::displaced_sphere(a.count("rows"), |d| {
        let p = d * 0.12 + 0.37;
        let bumps =
            tile_noise(p.x, p.y, 1).0 + tile_noise(p.y, p.z, 0).0 + tile_noise(p.z, p.x, 3).0;
        d * radius * (1.0 + bump * bumps.clamp(-1.0, 1.0))
    }))
}

/// A trefoil, standing upright.
fn knot(a: &Args) -> Mesh {
    let (radius, n) = (a.get("radius_m"), a.count("segments"));
    let scale = radius / 3.8;
    let path: Vec<DVec3> = (0..n)
        .map(|i| {
            let t = TAU * i as f64 / n as f64;
            let (ring, lift) = (2.0 + (3.0 * t).cos(), (3.0 * t).sin());
            DVec3::new(ring * (2.0 * t).cos(), ring * (2.0 * t).sin(), lift) * scale
        })
        .collect();
    grounded(shapes::tube(&path, &vec![0.7 * scale; n], a.count("sides"), true))
}
