//! Bars that fill a box: the farther apart, the more empty space a ray crosses.

use glam::DVec3;

use super::{Args, Dice, Generator, generator, param};
use crate::Mesh;
use crate::shapes::{bar, merged};

pub const GENERATORS: &[Generator] =
    &[generator("thicket", "bars between random places of a box on the floor", thicket)
        .with(&[param("count", 400.0, 1.0, 5000.0, "number of bars")])];

/// Of the box, and edge of a bar's square section, metres. Bars keep away from its sides for their edges at any slant.
const SIZE: DVec3 = DVec3::new(2.0, 1.6, 2.0);
const THICKNESS: f64 = 0.02;

fn thicket(a: &Args) -> Mesh {
    let room = SIZE - 2.0 * THICKNESS;
    let mut dice = Dice::new(1);
    let mut place = || {
        let mut along = |side: f64| dice.between(-0.5, 0.5) * side;
        let [x, y, z] = room.to_array().map(&mut along);
        DVec3::new(x, y + 0.5 * SIZE.y, z)
    };
    merged((0..a.count("count")).map(|_| {
        let (from, to) = (place(), place());
        bar(from, to, THICKNESS)
    }))
}
