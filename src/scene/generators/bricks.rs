//! Toy bricks with studs, and what is built of them.
//!
//! All proportions are those of the common toy brick: pitch of the studs 8 mm, height of a brick
//! 9.6 mm and of a plate 3.2 mm, studs 4.8 mm wide and 1.7 mm high. Lengths below are in pitches.

use std::f64::consts::TAU;

use glam::DMat4;

use super::{Args, Dice, Generator, SEED, generator, param};
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

const LONGEST: usize = 4;

/// Distance of the studs, metres.
const PITCH_M: f64 = 0.1;
/// Sides of a stud, where a scene does not say.
const SEGMENTS: usize = 12;

pub const GENERATORS: &[Generator] = &[
    generator("brick", "a toy brick with studs, or a plate with a low height", single).with(&[
        param("columns", 4.0, 1.0, 64.0, "studs along x"),
        param("rows", 2.0, 1.0, 64.0, "studs along z"),
        param("plates", 3.0, 1.0, 30.0, "height; a brick is 3 plates high"),
        param("segments", SEGMENTS as f64, 3.0, 48.0, "sides of a stud"),
    ]),
    generator("brick_wall", "a wall of toy bricks along x, two studs thick, with an opening", wall)
        .with(&[
            param("columns", 16.0, 1.0, 64.0, "studs along x"),
            param("courses", 8.0, 1.0, 40.0, "bricks on top of each other"),
            param("first", 6.0, 0.0, 64.0, "studs left of the opening"),
            param("opening", 4.0, 0.0, 64.0, "studs across the opening"),
            param("sill", 2.0, 0.0, 40.0, "courses below the opening"),
            param("lintel", 2.0, 1.0, 40.0, "courses above the opening"),
        ]),
    generator("brick_roof", "a stepped gable roof of toy bricks, its ridge along x", roof).with(&[
        param("columns", 18.0, 1.0, 64.0, "studs along x"),
        param("rows", 14.0, 2.0, 64.0, "studs along z at the eaves"),
    ]),
    generator("loose_bricks", "toy bricks strewn over a rectangle, some upon others", loose).with(
        &[
            param("count", 12.0, 1.0, 200.0, "number of bricks"),
            param("width", 12.0, 1.0, 200.0, "extent in x, pitches"),
            param("depth", 6.0, 1.0, 200.0, "extent in z, pitches"),
            SEED,
        ],
    ),
];

/// A brick from the origin along +x and +z, `height` high, with or without studs.
fn brick([columns, rows]: [usize; 2], height: f64, segments: usize, studs: bool) -> Mesh {
    let (x, z) = (columns as f64, rows as f64);
    let mut mesh = cuboid([GAP, 0.0, GAP], [x - GAP, height, z - GAP]);
    let stud = cylinder(STUD_RADIUS, STUD_HEIGHT + ROOT, segments);
    let places = if studs { columns * rows } else { 0 };
    for i in 0..places {
        let (column, row) = ((i % columns) as f64, (i / columns) as f64);
        mesh.append(&moved(stud.clone(), column + 0.5, height - ROOT, row + 0.5));
    }
    mesh
}

/// From pitches to metres, the middle in x and z on the axis.
fn placed(mesh: Mesh, columns: usize, rows: usize) -> Mesh {
    let centred = moved(mesh, -0.5 * columns as f64, 0.0, -0.5 * rows as f64);
    scaled(centred, PITCH_M)
}

fn single(a: &Args) -> Mesh {
    let size = [a.count("columns"), a.count("rows")];
    let height = a.get("plates").round() * PLATE;
    let mesh = brick(size, height, a.count("segments"), true);
    placed(mesh, size[0], size[1])
}

/// A course of bricks from `start` to `end`, the first one shifted in every other course.
fn course(start: usize, end: usize, odd: bool, studs: bool) -> Mesh {
    let mut mesh = Mesh::default();
    let (mut at, mut longest) = (start, if odd { LONGEST / 2 } else { LONGEST });
    while at < end {
        let length = longest.min(end - at);
        let one = brick([length, 2], BRICK, SEGMENTS, studs);
        mesh.append(&moved(one, at as f64, 0.0, 0.0));
        at += length;
        longest = LONGEST;
    }
    mesh
}

fn wall(a: &Args) -> Mesh {
    let (columns, courses) = (a.count("columns"), a.count("courses"));
    let left = a.count("first").min(columns);
    let right = (left + a.count("opening")).min(columns);
    let open = a.count("sill")..courses.saturating_sub(a.count("lintel"));
    let mut mesh = Mesh::default();
    for i in 0..courses {
        let studs = i + 1 == courses;
        let lay = |start, end| course(start, end, i % 2 == 1, studs);
        let bricks = if open.contains(&i) {
            merged([lay(0, left), lay(right, columns)])
        } else {
            lay(0, columns)
        };
        mesh.append(&moved(bricks, 0.0, i as f64 * BRICK, 0.0));
    }
    placed(mesh, columns, 2)
}

/// Courses of two rows each, one row further in from one to the next, until they meet.
fn roof(a: &Args) -> Mesh {
    let (columns, rows) = (a.count("columns"), a.count("rows"));
    let mut mesh = Mesh::default();
    for i in 0..rows.div_ceil(2) {
        let y = i as f64 * BRICK;
        let (near, far) = (i, rows - i);
        let strips =
            if far - near <= 4 { vec![(near, far - near)] } else { vec![(near, 2), (far - 2, 2)] };
        for (row, width) in strips {
            let strip = brick([columns, width], BRICK, SEGMENTS, true);
            mesh.append(&moved(strip, 0.0, y, row as f64));
        }
    }
    placed(mesh, columns, rows)
}

fn loose(a: &Args) -> Mesh {
    let mut dice = a.rng();
    let (width, depth) = (a.get("width"), a.get("depth"));
    let mut mesh = Mesh::default();
    for _ in 0..a.count("count") {
        let (x, z) = (dice.between(-0.5, 0.5) * width, dice.between(-0.5, 0.5) * depth);
        let turn = dice.between(0.0, TAU);
        let second = dice.between(0.0, 1.0) > 0.7;
        let mut pile = random_brick(&mut dice);
        if second {
            let turned = DMat4::from_rotation_y(dice.between(0.2, 1.2));
            let upper = random_brick(&mut dice).transformed(&turned);
            pile.append(&moved(upper, 0.0, BRICK + STUD_HEIGHT, 0.0));
        }
        let pile = pile.transformed(&DMat4::from_rotation_y(turn));
        mesh.append(&moved(pile, x, 0.0, z));
    }
    placed(mesh, 0, 0)
}

/// About the y axis, with one to four columns and one or two rows.
fn random_brick(dice: &mut Dice) -> Mesh {
    let size = [dice.between(1.0, 4.99) as usize, dice.between(1.0, 2.99) as usize];
    let mesh = brick(size, BRICK, SEGMENTS, true);
    moved(mesh, -0.5 * size[0] as f64, 0.0, -0.5 * size[1] as f64)
}
