//! A diving platform at the edge of a pool.

use fathom_base::settings;
use glam::DVec3;

use crate::Mesh;
use crate::shapes::{bar, cuboid, merged, smooth_path, tube};

settings! {
    pub struct DivingPlatform {
        /// Height of the platform above its foot.
        height_m: f64 = 3.0 => 0.3 ..= 20.0, "m";
    }
}

/// Height of the rails, and width of a springboard and of the ladder, metres (FINA Facilities Rules, FR 5).
const RAIL_HEIGHT: f64 = 1.0;
const BOARD_WIDTH: f64 = 0.5;
/// Extent of the platform behind the pool's edge and along it, how far the board stands out over the water, and distance of the
/// ladder's rungs, metres.
const LENGTH: f64 = 2.4;
const WIDTH: f64 = 1.6;
const BOARD_END: f64 = 1.8;
const RUNG: f64 = 0.3;
/// Radius of rails, edge of the posts, thickness of platform and board, metres. Tuned by eye.
const RAIL_RADIUS: f64 = 0.03;
const POST: f64 = 0.16;
const SLAB: f64 = 0.14;
const BOARD: f64 = 0.07;

pub fn platform(a: &DivingPlatform) -> Mesh {
    merged([a.scaffold(), a.slab_and_board(), a.ladder(), a.rails()])
}

impl DivingPlatform {
    /// Four posts, joined by crossed bars behind and by level ones at half the height.
    fn scaffold(&self) -> Mesh {
        let (low, high) = (0.0, self.height_m - SLAB);
        let (front, back) = (-POST, POST - LENGTH);
        let side = 0.5 * WIDTH - POST;
        let foot = |x: f64, z: f64| DVec3::new(x, low, z);
        let corners = [foot(front, side), foot(front, -side), foot(back, -side), foot(back, side)];
        let up = DVec3::Y * (high - low);
        let posts = corners.map(|foot| bar(foot, foot + up, POST));
        let beams = [0, 1, 2, 3]
            .map(|i| bar(corners[i] + 0.5 * up, corners[(i + 1) % 4] + 0.5 * up, 0.5 * POST));
        let braces = [(0, 3), (3, 0), (1, 2), (2, 1)]
            .map(|(i, j)| bar(corners[i], corners[j] + up, 0.35 * POST));
        merged(posts.into_iter().chain(beams).chain(braces))
    }

    fn slab_and_board(&self) -> Mesh {
        let (top, half) = (self.height_m, 0.5 * WIDTH);
        let slab = cuboid([-LENGTH, top - SLAB, -half], [0.0, top, half]);
        let across = 0.5 * BOARD_WIDTH;
        let board = cuboid([-0.8 * LENGTH, top, -across], [BOARD_END, top + BOARD, across]);
        merged([slab, board])
    }

    /// Two stringers that lean against the back and end as handles above the platform.
    fn ladder(&self) -> Mesh {
        let half = 0.5 * BOARD_WIDTH;
        let back = -LENGTH - 2.0 * RAIL_RADIUS;
        let foot = DVec3::new(back - 0.2 * self.height_m, 0.0, 0.0);
        let head = DVec3::new(back, self.height_m, 0.0);
        let count = (self.height_m / RUNG).floor().max(1.0) as usize;
        let rungs = (1..=count).map(|i| {
            let middle = foot.lerp(head, (i as f64 * RUNG / self.height_m).min(1.0));
            let aside = DVec3::Z * half;
            rail(&[middle - aside, middle + aside], 0.7 * RAIL_RADIUS)
        });
        let stringers = [-half, half].map(|z| {
            let aside = DVec3::Z * z;
            let handle = DVec3::new(0.25 * LENGTH, 0.7 * RAIL_HEIGHT, 0.0);
            let landing = DVec3::new(0.25 * LENGTH, 0.0, 0.0);
            let knots = [foot, head, head + 0.8 * handle, head + landing];
            rail(&smooth_path(&knots.map(|p| p + aside), 6), RAIL_RADIUS)
        });
        merged(rungs.chain(stringers))
    }

    /// A rail and one at half its height on both sides, with three posts each.
    fn rails(&self) -> Mesh {
        let (front, back) = (-0.1 * LENGTH, -0.95 * LENGTH);
        let side = 0.5 * WIDTH - 2.0 * RAIL_RADIUS;
        let place = |t: f64, height: f64, z: f64| {
            DVec3::new(front + t * (back - front), self.height_m + height, z)
        };
        let parts = [-side, side].into_iter().flat_map(move |z| {
            let level = [1.0, 0.5].map(|share| {
                let height = share * RAIL_HEIGHT;
                rail(&[place(0.0, height, z), place(1.0, height, z)], RAIL_RADIUS)
            });
            let posts = [0.0, 0.5, 1.0]
                .map(|t| rail(&[place(t, 0.0, z), place(t, RAIL_HEIGHT, z)], RAIL_RADIUS));
            level.into_iter().chain(posts)
        });
        merged(parts)
    }
}

/// A round bar along a path.
fn rail(path: &[DVec3], radius: f64) -> Mesh {
    tube(path, &vec![radius; path.len()], 8, false)
}
