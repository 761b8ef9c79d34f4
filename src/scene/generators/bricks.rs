//! Toy bricks with studs, and what is built of them.
//!
//! All proportions are those of the common toy brick: pitch of the studs 8 mm, height of a brick
//! 9.6 mm and of a plate 3.2 mm, studs 4.8 mm wide and 1.7 mm high. Lengths below are in pitches.

use std::f64::consts::TAU;

use fathom_base::settings;
use glam::DMat4;

use super::Dice;
use crate::Mesh;
use crate::shapes::{cuboid, cylinder, merged, moved, scaled};

const BRICK: f64 = 1.2;
const PLATE: f64 = 0.4;
const STUD_RADIUS: f64 = 0.3;
const STUD_HEIGHT: f64 = 0.2125;

/// What a brick is smaller than its place, on each side: 0.1 mm.
const GAP: f64 = 0.0125;

/// How far a stud reaches into its brick, so that no faces fall together.
const ROOT: f64 = 0.05;

const LONGEST: u32 = 4;

/// Distance of the studs, metres.
const PITCH_M: f64 = 0.1;
/// Sides of a stud, where a scene does not say.
const SEGMENTS: u32 = 12;

settings! {
    pub struct Brick {
        /// Studs along x.
        columns: u32 = 4 => 1 ..= 64, "1";
        /// Studs along z.
        rows: u32 = 2 => 1 ..= 64, "1";
        /// Height; a brick is 3 plates high.
        plates: u32 = 3 => 1 ..= 30, "1";
        /// Sides of a stud.
        segments: u32 = SEGMENTS => 3 ..= 48, "1";
    }
    pub struct BrickWall {
        /// Studs along x.
        columns: u32 = 16 => 1 ..= 64, "1";
        /// Bricks on top of each other.
        courses: u32 = 8 => 1 ..= 40, "1";
        /// Studs left of the opening.
        first: u32 = 6 => 0 ..= 64, "1";
        /// Studs across the opening.
        opening: u32 = 4 => 0 ..= 64, "1";
        /// Courses below the opening.
        sill: u32 = 2 => 0 ..= 40, "1";
        /// Courses above the opening.
        lintel: u32 = 2 => 1 ..= 40, "1";
    }
    pub struct BrickRoof {
        /// Studs along x.
        columns: u32 = 18 => 1 ..= 64, "1";
        /// Studs along z at the eaves.
        rows: u32 = 14 => 2 ..= 64, "1";
    }
    pub struct LooseBricks {
        /// Number of bricks.
        count: u32 = 12 => 1 ..= 200, "1";
        /// Extent in x, pitches.
        width: f64 = 12.0 => 1.0 ..= 200.0, "1";
        /// Extent in z, pitches.
        depth: f64 = 6.0 => 1.0 ..= 200.0, "1";
        /// Seed of the random numbers.
        seed: u32 = 1 => 0 ..= 4_294_967_295u32, "1";
    }
}

/// A brick from the origin along +x and +z, `height` high, with or without studs.
fn studded([columns, rows]: [u32; 2], height: f64, segments: u32, studs: bool) -> Mesh {
    let [x, z] = [columns, rows].map(f64::from);
    let mut mesh = cuboid([GAP, 0.0, GAP], [x - GAP, height, z - GAP]);
    let stud = cylinder(STUD_RADIUS, STUD_HEIGHT + ROOT, segments as usize);
    let places = if studs { columns * rows } else { 0 };
    for i in 0..places {
        let [column, row] = [i % columns, i / columns].map(f64::from);
        mesh.append(&moved(stud.clone(), column + 0.5, height - ROOT, row + 0.5));
    }
    mesh
}

/// From pitches to metres, the middle in x and z on the axis.
fn placed(mesh: Mesh, columns: u32, rows: u32) -> Mesh {
    let centred = moved(mesh, -0.5 * f64::from(columns), 0.0, -0.5 * f64::from(rows));
    scaled(centred, PITCH_M)
}

pub fn brick(a: &Brick) -> Mesh {
    let mesh = studded([a.columns, a.rows], f64::from(a.plates) * PLATE, a.segments, true);
    placed(mesh, a.columns, a.rows)
}

/// A course of bricks from `start` to `end`, the first one shifted in every other course.
fn course(start: u32, end: u32, odd: bool, studs: bool) -> Mesh {
    let mut mesh = Mesh::default();
    let (mut at, mut longest) = (start, if odd { LONGEST / 2 } else { LONGEST });
    while at < end {
        let length = longest.min(end - at);
        let one = studded([length, 2], BRICK, SEGMENTS, studs);
        mesh.append(&moved(one, f64::from(at), 0.0, 0.0));
        at += length;
        longest = LONGEST;
    }
    mesh
}

pub fn brick_wall(a: &BrickWall) -> Mesh {
    let left = a.first.min(a.columns);
    let right = (left + a.opening).min(a.columns);
    let open = a.sill..a.courses.saturating_sub(a.lintel);
    let mut mesh = Mesh::default();
    for i in 0..a.courses {
        let studs = i + 1 == a.courses;
        let lay = |start, end| course(start, end, i % 2 == 1, studs);
        let bricks = if open.contains(&i) {
            merged([lay(0, left), lay(right, a.columns)])
        } else {
            lay(0, a.columns)
        };
        mesh.append(&moved(bricks, 0.0, f64::from(i) * BRICK, 0.0));
    }
    placed(mesh, a.columns, 2)
}

/// Courses of two rows each, one row further in from one to the next, until they meet.
pub fn brick_roof(a: &BrickRoof) -> Mesh {
    let mut mesh = Mesh::default();
    for i in 0..a.rows.div_ceil(2) {
        let y = f64::from(i) * BRICK;
        let (near, far) = (i, a.rows - i);
        let strips =
            if far - near <= 4 { vec![(near, far - near)] } else { vec![(near, 2), (far - 2, 2)] };
        for (row, width) in strips {
            let strip = studded([a.columns, width], BRICK, SEGMENTS, true);
            mesh.append(&moved(strip, 0.0, y, f64::from(row)));
        }
    }
    placed(mesh, a.columns, a.rows)
}

pub fn loose_bricks(a: &LooseBricks) -> Mesh {
    let mut dice = Dice::new(a.seed);
    let mut mesh = Mesh::default();
    for _ in 0..a.count {
        let (x, z) = (dice.between(-0.5, 0.5) * a.width, dice.between(-0.5, 0.5) * a.depth);
        let angle = dice.between(0.0, TAU);
        let second = dice.between(0.0, 1.0) > 0.7;
        let mut pile = random_brick(&mut dice);
        if second {
            let rotation = DMat4::from_rotation_y(dice.between(0.2, 1.2));
            let upper = random_brick(&mut dice).transformed(&rotation);
            pile.append(&moved(upper, 0.0, BRICK + STUD_HEIGHT, 0.0));
        }
        let pile = pile.transformed(&DMat4::from_rotation_y(angle));
        mesh.append(&moved(pile, x, 0.0, z));
    }
    placed(mesh, 0, 0)
}

/// About the y axis, with one to four columns and one or two rows.
fn random_brick(dice: &mut Dice) -> Mesh {
    let size = [dice.between(1.0, 4.99) as u32, dice.between(1.0, 2.99) as u32];
    let mesh = studded(size, BRICK, SEGMENTS, true);
    moved(mesh, -0.5 * f64::from(size[0]), 0.0, -0.5 * f64::from(size[1]))
}
