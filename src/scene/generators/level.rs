//! A game level of few triangles: walls, doorways, windows, pillars, a platform with stairs.

use itertools::Itertools;

use crate::Mesh;
use crate::shapes::{cuboid, cylinder, merged, moved};

/// Edge of a square of the plan and height of the walls, metres, and sides of a pillar.
const CELL: f64 = 1.5;
const HEIGHT: f64 = 3.2;
const PILLAR_SIDES: usize = 8;

/// Seen from above, x to the right and z downward: `#` wall, `d` doorway, `w` window, `p` pillar, `c` crate, `=` platform,
/// `b` platform with parapet, `1` to `4` stairs up to it, `.` floor.
const PLAN: [&str; 14] = [
    "##################",
    "#......#=========#",
    "#.cc...#=======p=#",
    "#.c....d=========#",
    "#......#bb1=bbbbb#",
    "#......#..2......#",
    "###d####..3..p...w",
    "#.........4......#",
    "#.p..p..p........w",
    "#............p...#",
    "#.p..p..p.....cc.w",
    "#..............c.#",
    "#................#",
    "##ww##ww##########",
];

/// Height of the platform as a share of the walls'.
const PLATFORM: f64 = 0.4;

/// Height of a parapet above the platform, of a window's sill and its lintel, of a doorway's lintel and of a crate, as shares
/// of the walls'.
const PARAPET: f64 = 0.25;
const SILL: f64 = 0.3;
const WINDOW_LINTEL: f64 = 0.75;
const DOOR_LINTEL: f64 = 0.7;
const CRATE: f64 = 0.35;

pub fn level() -> Mesh {
    let (cell, height) = (CELL, HEIGHT);
    let (columns, rows) = (PLAN[0].len() as f64, PLAN.len() as f64);
    let place = |x: f64, z: f64| ((x - 0.5 * columns) * cell, (z - 0.5 * rows) * cell);
    let (x, z) = place(columns, rows);
    let slab = 0.1 * height;
    let mut mesh = cuboid([-x, -slab, -z], [x, 0.0, z]);
    for (row, line) in PLAN.iter().enumerate() {
        for (kind, start, end) in runs(line) {
            let (x0, z0) = place(start as f64, row as f64);
            let (x1, z1) = place(end as f64, row as f64 + 1.0);
            for [low, high] in blocks(kind) {
                mesh.append(&cuboid([x0, low * height, z0], [x1, high * height, z1]));
            }
            if kind == 'p' {
                let base = if line.contains('=') { PLATFORM * height } else { 0.0 };
                mesh.append(&pillars(start, end, base, |i| place(i, row as f64 + 0.5)));
            }
        }
    }
    mesh
}

/// Runs of the same letter: the letter, its first place, and the one after its last.
fn runs(line: &str) -> Vec<(char, usize, usize)> {
    let mut end = 0;
    let run = |(length, kind)| {
        end += length;
        (kind, end - length, end)
    };
    line.chars().dedup_with_count().map(run).collect()
}

/// The solid parts over a square of the plan, from and to which share of the walls' height.
fn blocks(kind: char) -> Vec<[f64; 2]> {
    match kind {
        '#' => vec![[0.0, 1.0]],
        'd' => vec![[DOOR_LINTEL, 1.0]],
        'w' => vec![[0.0, SILL], [WINDOW_LINTEL, 1.0]],
        'c' => vec![[0.0, CRATE]],
        '=' => vec![[0.0, PLATFORM]],
        'b' => vec![[0.0, PLATFORM + PARAPET]],
        '1'..='4' => {
            let below = f64::from(kind as u32 - '0' as u32);
            vec![[0.0, PLATFORM * (1.0 - below / 5.0)]]
        }
        _ => Vec::new(),
    }
}

/// Pillars of a run, each with a foot and a head; what they stand on fills their square.
fn pillars(start: usize, end: usize, base: f64, place: impl Fn(f64) -> (f64, f64)) -> Mesh {
    let (cell, height, sides) = (CELL, HEIGHT, PILLAR_SIDES);
    let half = 0.35 * cell;
    let thick = 0.06 * height;
    merged((start..end).flat_map(|i| {
        let (x, z) = place(i as f64 + 0.5);
        let plate = |y: f64| cuboid([x - half, y, z - half], [x + half, y + thick, z + half]);
        let shaft = cylinder(0.22 * cell, height - base - 2.0 * thick, sides);
        let ground = (base > 0.0).then(|| {
            let square = 0.5 * cell;
            cuboid([x - square, 0.0, z - square], [x + square, base, z + square])
        });
        let pillar = [plate(base), plate(height - thick), moved(shaft, x, base + thick, z)];
        pillar.into_iter().chain(ground)
    }))
}
