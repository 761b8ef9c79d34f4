//! Parts of the flooded storage area.

use std::f64::consts::{FRAC_PI_2, TAU};

use fathom_base::settings;
use glam::{DMat4, DVec3};

use super::Dice;
use crate::Mesh;
use crate::shapes::{at_corners, bar, block, cuboid, cylinder, lathe, merged, moved, tube};

settings! {
    pub struct Hall {
        /// Inner extent in x.
        width_m: f64 = 12.0 => 0.5 ..= 1000.0, "m";
        /// Inner extent in z.
        depth_m: f64 = 16.0 => 0.5 ..= 1000.0, "m";
        /// Height of the roof above the water.
        height_m: f64 = 2.4 => 0.1 ..= 100.0, "m";
        /// Number of roof slabs, along z.
        slabs: u32 = 5 => 0 ..= 100, "1";
        /// Share of the roof that the slabs cover.
        cover: f64 = 0.45 => 0.0 ..= 0.9, "1";
    }
    pub struct Trusses {
        /// Extent in x.
        width_m: f64 = 12.0 => 0.5 ..= 1000.0, "m";
        /// Extent in z over which they are spread.
        depth_m: f64 = 16.0 => 0.5 ..= 1000.0, "m";
        /// Height of their lower edge above the water.
        height_m: f64 = 1.7 => -100.0 ..= 100.0, "m";
        /// Height of a truss.
        rise_m: f64 = 0.6 => 0.05 ..= 20.0, "m";
        /// Number of trusses.
        count: u32 = 5 => 1 ..= 100, "1";
    }
    pub struct Crates {
        /// Extent in x.
        width_m: f64 = 4.0 => 0.1 ..= 1000.0, "m";
        /// Extent in z.
        depth_m: f64 = 4.0 => 0.1 ..= 1000.0, "m";
        /// Edge of the largest crate.
        size_m: f64 = 0.9 => 0.05 ..= 20.0, "m";
        /// Crates in the highest stack.
        stack: u32 = 3 => 1 ..= 10, "1";
        /// Share of places left empty.
        gaps: f64 = 0.3 => 0.0 ..= 1.0, "1";
        /// Seed of the random numbers.
        seed: u32 = 1 => 0 ..= 4_294_967_295u32, "1";
    }
    pub struct Barrels {
        /// Number of barrels.
        count: u32 = 8 => 1 ..= 60, "1";
        /// Extent in x.
        width_m: f64 = 4.0 => 0.1 ..= 1000.0, "m";
        /// Extent in z.
        depth_m: f64 = 4.0 => 0.1 ..= 1000.0, "m";
        /// Share of barrels that lie on their side.
        fallen: f64 = 0.35 => 0.0 ..= 1.0, "1";
        /// Seed of the random numbers.
        seed: u32 = 1 => 0 ..= 4_294_967_295u32, "1";
    }
    pub struct Shelves {
        /// Extent in x.
        width_m: f64 = 5.0 => 0.2 ..= 200.0, "m";
        /// Height.
        height_m: f64 = 2.6 => 0.2 ..= 50.0, "m";
        /// Number of bays.
        bays: u32 = 3 => 1 ..= 40, "1";
        /// Seed of the random numbers.
        seed: u32 = 1 => 0 ..= 4_294_967_295u32, "1";
    }
    pub struct Pipe {
        /// Extent in x.
        length_m: f64 = 8.0 => 0.5 ..= 500.0, "m";
        /// Height of its middle above the floor.
        height_m: f64 = 2.0 => 0.1 ..= 100.0, "m";
        /// Radius.
        radius_m: f64 = 0.14 => 0.005 ..= 10.0, "m";
    }
}

pub fn hall(a: &Hall, floor_depth_m: f64) -> Mesh {
    let (x, z) = (0.5 * a.width_m, 0.5 * a.depth_m);
    let (wall, top) = (0.3, floor_depth_m + a.height_m);
    let (ox, oz) = (x + wall, z + wall);
    let mut mesh = merged([
        cuboid([-ox, -wall, -oz], [ox, 0.0, oz]),
        cuboid([-ox, 0.0, -oz], [-x, top, oz]),
        cuboid([x, 0.0, -oz], [ox, top, oz]),
        cuboid([-x, 0.0, -oz], [x, top, -z]),
        cuboid([-x, 0.0, z], [x, top, oz]),
    ]);
    let bay = 2.0 * oz / f64::from(a.slabs.max(1));
    for i in 0..a.slabs {
        let middle = (f64::from(i) + 0.5) * bay - oz;
        let half = 0.5 * bay * a.cover;
        if half > 0.0 {
            mesh.append(&cuboid([-ox, top, middle - half], [ox, top + 0.5 * wall, middle + half]));
        }
    }
    mesh
}

pub fn trusses(a: &Trusses, floor_depth_m: f64) -> Mesh {
    let (low, rise, bays) = (floor_depth_m + a.height_m, a.rise_m, 8usize);
    let thick = 0.14 * rise.min(1.0);
    merged((0..a.count).flat_map(|i| {
        let z = ((f64::from(i) + 0.5) / f64::from(a.count) - 0.5) * a.depth_m;
        let at = |k: f64, y: f64| DVec3::new((k / bays as f64 - 0.5) * a.width_m, low + y, z);
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
    mesh.append(&at_corners(&block(t, top, t), h.x - 0.5 * t, h.z - 0.5 * t));
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

pub fn crates(a: &Crates) -> Mesh {
    let mut dice = Dice::new(a.seed);
    let along = |extent: f64| ((extent / (1.15 * a.size_m)) as usize).clamp(1, 8);
    let (columns, rows) = (along(a.width_m), along(a.depth_m));
    let mut mesh = Mesh::default();
    for i in 0..columns * rows {
        let place = |k: usize, n: usize, extent: f64| ((k as f64 + 0.5) / n as f64 - 0.5) * extent;
        let (x, z) = (place(i % columns, columns, a.width_m), place(i / columns, rows, a.depth_m));
        let empty = dice.between(0.0, 1.0) < a.gaps && i > 0;
        let stack = if empty { 0 } else { dice.between(1.0, f64::from(a.stack) + 0.99) as usize };
        mesh.append(&stacked(&mut dice, stack, a.size_m, (x, z)));
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
        let rotation = DMat4::from_rotation_y(dice.between(-0.18, 0.18));
        let shift = (0.06 * size * dice.between(-1.0, 1.0), 0.06 * size * dice.between(-1.0, 1.0));
        let one = wooden_crate(shape).transformed(&rotation);
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

pub fn barrels(a: &Barrels) -> Mesh {
    let (h, mut dice) = (0.95, Dice::new(a.seed));
    let mut places: Vec<(f64, f64)> = Vec::new();
    let mut mesh = Mesh::default();
    for _ in 0..a.count {
        // The freest of a few random places.
        let mut room = f64::NEG_INFINITY;
        let mut best = (0.0, 0.0);
        for _ in 0..24 {
            let p = (dice.between(-0.5, 0.5) * a.width_m, dice.between(-0.5, 0.5) * a.depth_m);
            let nearest = places.iter().map(|q| (p.0 - q.0).hypot(p.1 - q.1)).fold(1e9, f64::min);
            if nearest > room {
                (room, best) = (nearest, p);
            }
        }
        places.push(best);
        let rotation = DMat4::from_rotation_y(dice.between(0.0, TAU));
        let fallen = dice.between(0.0, 1.0) < a.fallen;
        let one = if fallen {
            let lying = DMat4::from_rotation_z(FRAC_PI_2);
            moved(barrel(h).transformed(&lying), 0.5 * h, 0.335 * h, 0.0)
        } else {
            barrel(h)
        };
        mesh.append(&moved(one.transformed(&rotation), best.0, 0.0, best.1));
    }
    mesh
}

pub fn shelves(a: &Shelves) -> Mesh {
    let (width, height, depth) = (a.width_m, a.height_m, 0.7);
    let (levels, mut dice) = (4, Dice::new(a.seed));
    let (bay, gap) = (width / f64::from(a.bays), height / f64::from(levels));
    let mut mesh = Mesh::default();
    for i in 0..=a.bays {
        let x = f64::from(i) * bay - 0.5 * width;
        for z in [-0.5 * depth, 0.5 * depth] {
            mesh.append(&moved(block(0.06, height, 0.06), x, 0.0, z));
        }
    }
    for level in 0..levels {
        let y = (f64::from(level) + 0.35) * gap;
        mesh.append(&moved(block(width, 0.05, depth), 0.0, y, 0.0));
        for i in 0..a.bays {
            let place = (f64::from(i) * bay - 0.5 * width, y + 0.05);
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

pub fn pipe(a: &Pipe) -> Mesh {
    let (half, y, r) = (0.5 * a.length_m, a.height_m, a.radius_m);
    let bend = (3.0 * r).min(0.5 * y).min(0.5 * half);
    // A quarter circle at either end, from the upright to the level part.
    let elbow = |side: f64, i: i32| {
        let (sin, cos) = (FRAC_PI_2 * f64::from(i) / 10.0).sin_cos();
        let x = side * (half - bend * (1.0 - cos));
        DVec3::new(x, y - bend * (1.0 - sin), 0.0)
    };
    let mut path = vec![DVec3::new(-half, 0.0, 0.0)];
    path.extend((0..=10).map(|i| elbow(-1.0, i)));
    path.extend((0..=10).rev().map(|i| elbow(1.0, i)));
    path.push(DVec3::new(half, 0.0, 0.0));
    let flange = |x: f64| {
        let across = DMat4::from_rotation_z(FRAC_PI_2);
        moved(cylinder(1.5 * r, 0.5 * r, 24).transformed(&across), x, y, 0.0)
    };
    let main = tube(&path, &vec![r; path.len()], 32, false);
    merged([main, flange(-0.4 * half), flange(0.0), flange(0.4 * half)])
}
