//! Bars that fill a box: the farther apart, the more empty space a ray crosses.

use glam::DVec3;

use super::{Args, Generator, SEED, generator, param};
use crate::Mesh;
use crate::shapes::{bar, merged};

pub const GENERATORS: &[Generator] =
    &[generator("thicket", "bars between random places of a box on the floor", thicket).with(&[
        param("count", 400.0, 1.0, 5000.0, "number of bars"),
        param("thickness_m", 0.02, 0.001, 10.0, "edge of a bar's square section"),
        param("width_m", 2.0, 0.1, 1000.0, "extent in x"),
        param("height_m", 1.6, 0.1, 1000.0, "extent in y"),
        param("depth_m", 2.0, 0.1, 1000.0, "extent in z"),
        SEED,
    ])];

fn thicket(a: &Args) -> Mesh {
    let size = DVec3::new(a.get("width_m"), a.get("height_m"), a.get("depth_m"));
    let thickness = a.get("thickness_m");
    // Room for a bar's edges at any slant.
    let room = (size - 2.0 * thickness).max(0.1 * size);
    let mut dice = a.rng();
    let mut place = || {
        let mut along = |side: f64| dice.between(-0.5, 0.5) * side;
        let [x, y, z] = room.to_array().map(&mut along);
        DVec3::new(x, y + 0.5 * size.y, z)
    };
    merged((0..a.count("count")).map(|_| {
        let (from, to) = (place(), place());
        bar(from, to, thickness)
    }))
}
