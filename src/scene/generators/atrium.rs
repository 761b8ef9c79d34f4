//! A courtyard with arcades, the stand-in for the Sponza atrium.

use std::f64::consts::PI;

use glam::DVec3;

use crate::Mesh;
use crate::shapes::{cuboid, merged, moved, sheet, smooth_solid};

/// Arches along each side.
const BAYS: u32 = 9;

/// 34 m × 15 m around a court of 5.5 m, each storey 5 m high.
pub fn arcade() -> Mesh {
    let (x, z, court, storey, wall) = (17.0, 7.5, 2.75, 5.0, 0.4);
    let top = 2.0 * storey + 1.0;
    let mut mesh = merged([
        cuboid([-x, -wall, -z], [x, 0.0, z]),
        cuboid([-x, 0.0, -z], [-x + wall, top, z]),
        cuboid([x - wall, 0.0, -z], [x, top, z]),
        cuboid([-x + wall, 0.0, -z], [x - wall, top, -z + wall]),
        cuboid([-x + wall, 0.0, z - wall], [x - wall, top, z]),
    ]);
    for side in [-1.0, 1.0] {
        for floor in 0..2 {
            let y = f64::from(floor) * storey;
            mesh.append(&moved(row(x - wall, storey), 0.0, y, side * court));
            let (near, far): (f64, f64) = (side * (court - 0.5), side * (z - wall));
            mesh.append(&cuboid(
                [-x + wall, y + storey - 0.25, near.min(far)],
                [x - wall, y + storey, near.max(far)],
            ));
        }
    }
    mesh
}

/// A row of columns and the arches between them, `storey` high.
fn row(half: f64, storey: f64) -> Mesh {
    let step = 2.0 * half / f64::from(BAYS);
    let radius = (0.12 * step).min(0.32);
    let spring = (storey - 0.3 - 0.5 * step).max(0.45 * storey);
    let post = column(radius, spring);
    let columns = (0..=BAYS).map(|i| moved(post.clone(), f64::from(i) * step - half, 0.0, 0.0));
    let arches = (0..BAYS).map(|i| {
        let middle = (f64::from(i) + 0.5) * step - half;
        moved(arch(step, storey - 0.25 - spring, radius), middle, spring, 0.0)
    });
    merged(columns.chain(arches))
}

fn column(radius: f64, height: f64) -> Mesh {
    let (r, h) = (radius, height);
    let knots = [
        (1.5 * r, 0.0),
        (1.55 * r, 0.03 * h),
        (1.3 * r, 0.06 * h),
        (r, 0.09 * h),
        (1.02 * r, 0.4 * h),
        (0.88 * r, 0.88 * h),
        (1.1 * r, 0.93 * h),
        (1.45 * r, 0.97 * h),
        (1.5 * r, h),
    ];
    smooth_solid(&knots, 4, 24)
}

/// The wall above one opening of a row, cut out by a half ellipse: two faces and the soffit.
fn arch(step: f64, height: f64, radius: f64) -> Mesh {
    let (half, thick) = (0.5 * step, 0.9 * radius);
    let inner = half - radius;
    // Along the lower edge: a tenth on the left post, the arch, a tenth on the right post.
    let low = |u: f64| {
        let side = if u < 0.5 { -1.0 } else { 1.0 };
        let from_end = 10.0 * u.min(1.0 - u);
        if from_end < 1.0 {
            return DVec3::new(side * (half - radius * from_end), 0.0, 0.0);
        }
        let angle = PI * (1.0 - (u - 0.1) / 0.8);
        DVec3::new(inner * angle.cos(), 0.85 * height * angle.sin(), 0.0)
    };
    let face = |z: f64| sheet((30, 2), |u, v| low(u).lerp(low(u).with_y(height), v) + DVec3::Z * z);
    let soffit = sheet((30, 1), |u, v| low(u) + DVec3::Z * thick * (2.0 * v - 1.0));
    merged([face(thick), face(-thick).inverted(), soffit])
}
