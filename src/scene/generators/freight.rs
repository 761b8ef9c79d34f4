//! A crate of planks.

use fathom_base::settings;
use glam::DVec3;

use crate::Mesh;
use crate::shapes::{bar, cuboid, merged, moved};

settings! {
    pub struct PlankCrate {
        /// Extent in x.
        width_m: f64 = 1.0 => 0.01 ..= 100.0, "m";
        /// Extent in y.
        height_m: f64 = 1.0 => 0.01 ..= 100.0, "m";
        /// Extent in z.
        depth_m: f64 = 1.0 => 0.01 ..= 100.0, "m";
        /// Planks of a side.
        planks: u32 = 5 => 1 ..= 20, "1";
    }
}

/// Share of a plank's place that is gap.
const GAP: f64 = 0.06;

pub fn plank_crate(a: &PlankCrate) -> Mesh {
    let size = DVec3::new(a.width_m, a.height_m, a.depth_m);
    let t = 0.09 * size.min_element();
    let sides = (0..3).map(|axis| planks(size - 0.8 * t, axis, a.planks, 0.35 * t));
    let edges = (0..3).map(|axis| battens(size, axis, t));
    let mut mesh = merged(sides.chain(edges));
    for s in [-1.0, 1.0] {
        let (x, y, z) = (0.5 * size.x - t, 0.5 * size.y - t, s * (0.5 * size.z - 0.3 * t));
        mesh.append(&bar([-x, -y, z], [x, y, z], 0.5 * t));
        let (x, z) = (s * (0.5 * size.x - 0.3 * t), 0.5 * size.z - t);
        mesh.append(&bar([x, -y, -z], [x, y, z], 0.5 * t));
    }
    moved(mesh, 0.0, 0.5 * size.y, 0.0)
}

/// The two sides across `axis` of a box about the origin, planks spread along the next axis.
fn planks(size: DVec3, axis: usize, count: u32, thick: f64) -> Mesh {
    let along = (axis + 1) % 3;
    let place = size[along] / f64::from(count);
    merged([-1.0, 1.0].into_iter().flat_map(|side| {
        (0..count).map(move |i| {
            let mut half = 0.5 * size - thick;
            half[axis] = 0.5 * thick;
            half[along] = 0.5 * place * (1.0 - GAP);
            let mut middle = DVec3::ZERO;
            middle[axis] = side * 0.5 * (size[axis] - thick);
            middle[along] = (f64::from(i) + 0.5) * place - 0.5 * size[along];
            cuboid(middle - half, middle + half)
        })
    }))
}

/// The four edges along `axis` of a box about the origin; those along y reach the corners.
fn battens(size: DVec3, axis: usize, thick: f64) -> Mesh {
    let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
    let corners = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)];
    merged(corners.map(|(su, sv)| {
        let mut half = DVec3::splat(0.5 * thick);
        half[axis] = 0.5 * size[axis] - if axis == 1 { 0.0 } else { thick };
        let mut middle = DVec3::ZERO;
        middle[u] = su * 0.5 * (size[u] - thick);
        middle[v] = sv * 0.5 * (size[v] - thick);
        cuboid(middle - half, middle + half)
    }))
}
