//! Bars that fill a box: the farther apart, the more empty space a ray crosses.

use fathom_base::settings;
use glam::DVec3;

use super::Dice;
use crate::Mesh;
use crate::shapes::{bar, merged};

settings! {
    pub struct Thicket {
        /// Number of bars.
        count: u32 = 400 => 1 ..= 5000, "1";
    }
}

/// Of the box, and edge of a bar's square section, metres. Bars keep away from its sides for their edges at any slant.
const SIZE: DVec3 = DVec3::new(2.0, 1.6, 2.0);
const THICKNESS: f64 = 0.02;

pub fn thicket(a: &Thicket) -> Mesh {
    let room = SIZE - 2.0 * THICKNESS;
    let mut dice = Dice::new(1);
    let mut place = || {
        let mut along = |side: f64| dice.between(-0.5, 0.5) * side;
        let [x, y, z] = room.to_array().map(&mut along);
        DVec3::new(x, y + 0.5 * SIZE.y, z)
    };
    merged((0..a.count).map(|_| {
        let (from, to) = (place(), place());
        bar(from, to, THICKNESS)
    }))
}
