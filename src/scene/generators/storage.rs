//! Parts of the flooded storage area.

use std::f64::consts::{FRAC_PI_2, TAU};

use glam::{DMat4, DVec3};

use super::{Args, Dice, Generator, SEED, generator, param};
use crate::Mesh;
use crate::shapes::{bar, block, cuboid, cylinder, lathe, merged, moved, tube};

pub const GENERATORS: &[Generator] = &[
    generator("hall", "a hall with floor, walls, and a roof of slabs with gaps between them", hall)
        .with(&[
            param("width_m", 12.0, 0.5, 1000.0, "inner extent in x"),
            param("depth_m", 16.0, 0.5, 1000.0, "inner extent in z"),
            param("height_m", 2.4, 0.1, 100.0, "height of the roof above the water"),
            param("slabs", 5.0, 0.0, 100.0, "number of roof slabs, along z"),
            param("cover", 0.45, 0.0, 0.9, "share of the roof that the slabs cover"),
        ]),
    generator("trusses", "roof trusses across x", trusses).with(&[
        param("width_m", 12.0, 0.5, 1000.0, "extent in x"),
        param("depth_m", 16.0, 0.5, 1000.0, "extent in z over which they are spread"),
        param("height_m", 1.7, -100.0, 100.0, "height of their lower edge above the water"),
        param("rise_m", 0.6, 0.05, 20.0, "height of a truss"),
        param("count", 5.0, 1.0, 100.0, "number of trusses"),
    ]),
    generator("crates", "stacks of wooden crates in rows over a rectangle", crates).with(&[
        param("width_m", 4.0, 0.1, 1000.0, "extent in x"),
        param("depth_m", 4.0, 0.1, 1000.0, "extent in z"),
        param("size_m", 0.9, 0.05, 20.0, "edge of the largest crate"),
        param("stack", 3.0, 1.0, 10.0, "crates in the highest stack"),
        param("gaps", 0.3, 0.0, 1.0, "share of places left empty"),
        SEED,
    ]),
    generator("barrels", "barrels strewn over a rectangle, some fallen", barrels).with(&[
        param("count", 8.0, 1.0, 60.0, "number of barrels"),
        param("width_m", 4.0, 0.1, 1000.0, "extent in x"),
        param("depth_m", 4.0, 0.1, 1000.0, "extent in z"),
        param("fallen", 0.35, 0.0, 1.0, "share of barrels that lie on their side"),
        SEED,
    ]),
    generator("shelves", "a rack of shelves along x with boxes on it, open towards +z", shelves)
        .with(&[
            param("width_m", 5.0, 0.2, 200.0, "extent in x"),
            param("height_m", 2.6, 0.2, 50.0, "height"),
            param("bays", 3.0, 1.0, 40.0, "number of bays"),
            SEED,
        ]),
    generator("pipe", "a pipe along x with flanges, bent down to the floor at both ends", pipe)
        .with(&[
            param("length_m", 8.0, 0.5, 500.0, "extent in x"),
            param("height_m", 2.0, 0.1, 100.0, "height of its middle above the floor"),
            param("radius_m", 0.14, 0.005, 10.0, "radius"),
        ]),
];

fn hall(a: &Args) -> Mesh {
    let (x, z) = (0.5 * a.get("width_m"), 0.5 * a.get("depth_m"));
    let (wall, top) = (0.3, a.floor_depth_m + a.get("height_m"));
    let (ox, oz) = (x + wall, z + wall);
    let mut mesh = merged([
        cuboid([-ox, -wall, -oz], [ox, 0.0, oz]),
        cuboid([-ox, 0.0, -oz], [-x, top, oz]),
        cuboid([x, 0.0, -oz], [ox, top, oz]),
        cuboid([-x, 0.0, -oz], [x, top, -z]),
        cuboid([-x, 0.0, z], [x, top, oz]),
    ]);
    let slabs = a.count("slabs");
    let bay = 2.0 * oz / slabs.max(1) as f64;
    for i in 0..slabs {
        let middle = (i as f64 + 0.5) * bay - oz;
        let half = 0.5 * bay * a.get("cover");
        if half > 0.0 {
            mesh.append(&cuboid([-ox, top, middle - half], [ox, top + 0.5 * wall, middle + half]));
        }
    }
    mesh
}

fn trusses(a: &Args) -> Mesh {
    let (width, depth, rise) = (a.get("width_m"), a.get("depth_m"), a.get("rise_m"));
    let low = a.floor_depth_m + a.get("height_m");
    let (count, bays) = (a.count("count"), 8usize);
    let thick = 0.14 * rise.min(1.0);
    merged((0..count).flat_map(|i| {
        let z = ((i as f64 + 0.5) / count as f64 - 0.5) * depth;
        let at = |k: f64, y: f64| DVec3::new((k / bays as f64 - 0.5) * width, low + y, z);
        let ends = bays as f64;
        let chords =
            [bar(at(0.0, 0.0), at(ends, 0.0), thick), bar(at(0.0, rise), at(ends, rise), thick)];
        let webs = (0..bays).flat_map(move |bay| {
            let (k, next) = (bay as f64, bay as f64 + 1.0);
            let rising = bay.is_multiple_of(2);
            let (from, to) = if rising { (0.0, rise) } else { (rise, 0.0) };
            let diagonal = bar(at(k, from), at(next, to), 0.7 * thick);
            [diagonal, bar(at(next, 0.0), at(next, rise), 0.6 * thick)]
        });
        chords.into_iter().chain(webs).collect::<Vec<_>>()
    }))
}

/// A crate of this size standing on y = 0: panels, a frame of battens, a diagonal on each side.
fn wooden_crate(size: DVec3) -> Mesh {
    let t = 0.1 * size.min_element();
    let (h, top) = (0.5 * size, size.y);
    let mut mesh = cuboid(
        [-h.x + 0.75 * t, 0.75 * t, -h.z + 0.75 * t],
        [h.x - 0.75 * t, top - 0.75 * t, h.z - 0.75 * t],
    );
    for (sx, sz) in [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)] {
        let post = block(t, top, t);
        mesh.append(&moved(post, sx * (h.x - 0.5 * t), 0.0, sz * (h.z - 0.5 * t)));
    }
    for y in [0.0, top - t] {
        for s in [-1.0, 1.0] {
            let (along_x, along_z) = (block(size.x - 2.0 * t, t, t), block(t, t, size.z - 2.0 * t));
            mesh.append(&moved(along_x, 0.0, y, s * (h.z - 0.5 * t)));
            mesh.append(&moved(along_z, s * (h.x - 0.5 * t), y, 0.0));
        }
    }
    for s in [-1.0, 1.0] {
        let (x, z) = (h.x - t, s * (h.z - 0.3 * t));
        mesh.append(&bar([-x, t, z], [x, top - t, z], 0.6 * t));
        let (x, z) = (s * (h.x - 0.3 * t), h.z - t);
        mesh.append(&bar([x, t, -z], [x, top - t, z], 0.6 * t));
    }
    mesh
}

fn crates(a: &Args) -> Mesh {
    let (width, depth, size) = (a.get("width_m"), a.get("depth_m"), a.get("size_m"));
    let mut dice = a.rng();
    let along = |extent: f64| ((extent / (1.15 * size)) as usize).clamp(1, 8);
    let (columns, rows) = (along(width), along(depth));
    let mut mesh = Mesh::default();
    for i in 0..columns * rows {
        let place = |k: usize, n: usize, extent: f64| ((k as f64 + 0.5) / n as f64 - 0.5) * extent;
        let (x, z) = (place(i % columns, columns, width), place(i / columns, rows, depth));
        let empty = dice.between(0.0, 1.0) < a.get("gaps") && i > 0;
        let stack = if empty { 0 } else { dice.between(1.0, a.get("stack") + 0.99) as usize };
        mesh.append(&stacked(&mut dice, stack, size, (x, z)));
    }
    mesh
}

/// Crates upon each other, each turned and shifted a little.
fn stacked(dice: &mut Dice, count: usize, size: f64, (x, z): (f64, f64)) -> Mesh {
    let mut y = 0.0;
    let mut mesh = Mesh::default();
    for _ in 0..count {
        let edge = size * dice.between(0.75, 1.0);
        let shape = DVec3::new(edge, edge * dice.between(0.7, 1.0), edge);
        let turn = DMat4::from_rotation_y(dice.between(-0.18, 0.18));
        let shift = (0.06 * size * dice.between(-1.0, 1.0), 0.06 * size * dice.between(-1.0, 1.0));
        let one = wooden_crate(shape).transformed(&turn);
        mesh.append(&moved(one, x + shift.0, y, z + shift.1));
        y += shape.y;
    }
    mesh
}

/// A steel drum with two rolling hoops and a sunk lid.
fn barrel(height: f64) -> Mesh {
    let (h, r) = (height, 0.32 * height);
    let hoop = |y: f64| {
        [
            (r, y - 0.035 * h),
            (1.045 * r, y - 0.012 * h),
            (1.045 * r, y + 0.012 * h),
            (r, y + 0.035 * h),
        ]
    };
    let edge = |y: f64| [(1.03 * r, y - 0.015 * h), (1.03 * r, y + 0.015 * h)];
    let mut profile =
        vec![(0.0, 0.02 * h), (0.95 * r, 0.02 * h), (0.95 * r, 0.02 * h), (0.95 * r, 0.0)];
    profile.extend(edge(0.015 * h));
    profile.extend([(r, 0.05 * h), (r, 0.05 * h)]);
    profile.extend(hoop(0.34 * h));
    profile.extend(hoop(0.66 * h));
    profile.extend([(r, 0.95 * h), (r, 0.95 * h)]);
    profile.extend(edge(0.985 * h));
    profile.extend([(0.95 * r, h), (0.95 * r, 0.98 * h), (0.95 * r, 0.98 * h), (0.0, 0.98 * h)]);
    merged([lathe(&profile, 40), moved(cylinder(0.1 * r, 0.025 * h, 12), 0.55 * r, 0.97 * h, 0.0)])
}

fn barrels(a: &Args) -> Mesh {
    let (width, depth, h) = (a.get("width_m"), a.get("depth_m"), 0.95);
    let mut dice = a.rng();
    let mut places: Vec<(f64, f64)> = Vec::new();
    let mut mesh = Mesh::default();
    for _ in 0..a.count("count") {
        // The freest of a few random places.
        let mut room = f64::NEG_INFINITY;
        let mut best = (0.0, 0.0);
        for _ in 0..24 {
            let p = (dice.between(-0.5, 0.5) * width, dice.between(-0.5, 0.5) * depth);
            let nearest = places.iter().map(|q| (p.0 - q.0).hypot(p.1 - q.1)).fold(1e9, f64::min);
            if nearest > room {
                (room, best) = (nearest, p);
            }
        }
        places.push(best);
        let turn = DMat4::from_rotation_y(dice.between(0.0, TAU));
        let fallen = dice.between(0.0, 1.0) < a.get("fallen");
        let one = if fallen {
            let lying = DMat4::from_rotation_z(FRAC_PI_2);
            moved(barrel(h).transformed(&lying), 0.5 * h, 0.335 * h, 0.0)
        } else {
            barrel(h)
        };
        mesh.append(&moved(one.transformed(&turn), best.0, 0.0, best.1));
    }
    mesh
}

fn shelves(a: &Args) -> Mesh {
    let (width, height, depth) = (a.get("width_m"), a.get("height_m"), 0.7);
    let (levels, bays) = (4, a.count("bays"));
    let mut dice = a.rng();
    let bay = width / bays as f64;
    let gap = height / f64::from(levels);
    let mut mesh = Mesh::default();
    for i in 0..=bays {
        for z in [-0.5 * depth, 0.5 * depth] {
            mesh.append(&moved(block(0.06, height, 0.06), i as f64 * bay - 0.5 * width, 0.0, z));
        }
    }
    for level in 0..levels {
        let y = (f64::from(level) + 0.35) * gap;
        mesh.append(&moved(block(width, 0.05, depth), 0.0, y, 0.0));
        for i in 0..bays {
            let place = (i as f64 * bay - 0.5 * width, y + 0.05);
            mesh.append(&goods(&mut dice, place, bay, 0.6 * gap, depth));
        }
    }
    mesh
}

/// Boxes side by side on one bay of a shelf, up to `height`.
fn goods(dice: &mut Dice, (left, y): (f64, f64), bay: f64, height: f64, depth: f64) -> Mesh {
    let mut mesh = Mesh::default();
    let mut x = 0.08 * bay;
    for _ in 0..6 {
        let width = bay * dice.between(0.16, 0.34);
        if x + width > 0.94 * bay {
            break;
        }
        if dice.between(0.0, 1.0) > 0.3 {
            let size =
                DVec3::new(width, height * dice.between(0.4, 1.0), depth * dice.between(0.5, 0.85));
            mesh.append(&moved(wooden_crate(size), left + x + 0.5 * width, y, 0.0));
        }
        x += 1.08 * width;
    }
    mesh
}

fn pipe(a: &Args) -> Mesh {
    let (half, y, r) = (0.5 * a.get("length_m"), a.get("height_m"), a.get("radius_m"));
    let bend = (3.0 * r).min(0.5 * y).min(0.5 * half);
    // A quarter circle at either end, from the upright to the level part.
    let turn = |side: f64, i: i32| {
        let (sin, cos) = (FRAC_PI_2 * f64::from(i) / 10.0).sin_cos();
        let x = side * (half - bend * (1.0 - cos));
        DVec3::new(x, y - bend * (1.0 - sin), 0.0)
    };
    let mut path = vec![DVec3::new(-half, 0.0, 0.0)];
    path.extend((0..=10).map(|i| turn(-1.0, i)));
    path.extend((0..=10).rev().map(|i| turn(1.0, i)));
    path.push(DVec3::new(half, 0.0, 0.0));
    let flange = |x: f64| {
        let across = DMat4::from_rotation_z(FRAC_PI_2);
        moved(cylinder(1.5 * r, 0.5 * r, 24).transformed(&across), x, y, 0.0)
    };
    let main = tube(&path, &vec![r; path.len()], 32, false);
    merged([main, flange(-0.4 * half), flange(0.0), flange(0.4 * half)])
}
