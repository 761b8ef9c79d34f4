//! The photon grid in the light's screen space and the exact landing point of each photon (UW §3.3).

use glam::DVec3;
use rayon::prelude::*;

use super::filter::pcg;
use super::optics::{fresnel_transmittance, refract};
use super::rays::{Hit, Tracer};
use super::surface::{Entry, enter};
use fathom_scene::{LightFrame, Water};

/// A ray that starts on a surface ignores hits nearer than this share of the scene.
const SELF_HIT: f64 = 1e-10;

/// A square grid of photons over the light's normalised device coordinates.
///
/// `cells`² cells, each subdivided into `side`² finer ones with a photon each. Photon `((j·cells + i)·side + sj)·side + si` is
/// sub-point (si, sj) of cell (i, j).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PhotonGrid {
    pub cells: u32,
    pub side: u32,
    /// Where photons sit in their finer cells: 0…1, the centre is 0.5.
    pub offset: [f64; 2],
    /// Each photon is strewn over this share of its finer cell, about the place that the offset gives; what leaves the finer
    /// cell on one side comes in on the other.
    pub jitter: f64,
}

impl PhotonGrid {
    /// Photons at the centres of the finer cells.
    pub fn new(cells: u32, side: u32) -> PhotonGrid {
        PhotonGrid { cells, side, offset: [0.5, 0.5], jitter: 0.0 }
    }

    pub fn count(&self) -> u64 {
        (u64::from(self.cells) * u64::from(self.side)).pow(2)
    }

    /// Normalised device coordinates of a photon by its index in memory.
    pub fn ndc(&self, index: u64) -> [f64; 2] {
        let (cells, side) = (u64::from(self.cells), u64::from(self.side));
        let (cell, sub) = (index / (side * side), index % (side * side));
        let fine = [(cell % cells) * side + sub % side, (cell / cells) * side + sub / side];
        let strewn = strewn(fine.map(|k| k as u32));
        [0, 1].map(|axis| {
            let mut share = self.offset[axis];
            if self.jitter > 0.0 {
                share = (share + self.jitter * (strewn[axis] - 0.5)).rem_euclid(1.0);
            }
            let place = fine[axis] as f64 + share;
            2.0 * place / (cells * side) as f64 - 1.0
        })
    }
}

/// Two repeatable numbers in [0, 1) for a finer cell: the halves of 32 well mixed bits.
fn strewn([x, y]: [u32; 2]) -> [f64; 2] {
    let bits = pcg(pcg(x).wrapping_add(y));
    [bits >> 16, bits & 0xffff].map(|half| f64::from(half) / 65_536.0)
}

/// A photon that entered the water and met a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Landed {
    pub entry: Entry,
    /// Unit direction after refraction.
    pub direction: DVec3,
    /// Its distance is that from the entry (the paper's d_fromSurface).
    pub hit: Hit,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Landing {
    Landed(Landed),
    /// Geometry above the water stops the photon.
    Blocked,
    /// The photon passes beside the water's surface.
    MissesWater,
    /// The photon enters the water and meets nothing.
    Leaves {
        entry: Entry,
        direction: DVec3,
    },
}

impl Landing {
    pub fn landed(&self) -> Option<&Landed> {
        match self {
            Landing::Landed(landed) => Some(landed),
            _ => None,
        }
    }
}

/// Normalised device coordinates of a photon of a plain grid of columns and rows, each at the place `offset` of its cell.
pub fn place_in_grid(number: u32, [columns, rows]: [u32; 2], offset: [f64; 2]) -> [f64; 2] {
    let ndc =
        |k: u32, axis: usize, n: u32| 2.0 * (f64::from(k) + offset[axis]) / f64::from(n) - 1.0;
    [ndc(number % columns, 0, columns), ndc(number / columns, 1, rows)]
}

/// Follows the photon at a place of the grid: air, refraction at the surface, water.
pub fn land(frame: &LightFrame, water: &Water, tracer: &Tracer, place: [f64; 2]) -> Landing {
    let (origin, incident) = frame.photon_ray(place);
    land_ray(water, tracer, origin, incident)
}

/// Follows a photon from any place in the air in a unit direction.
pub fn land_ray(water: &Water, tracer: &Tracer, origin: DVec3, incident: DVec3) -> Landing {
    let Some(entry) = enter(water, origin, incident, f64::MAX) else {
        return Landing::MissesWater;
    };
    if tracer.cast(origin, incident, 0.0, entry.distance_m).is_some() {
        return Landing::Blocked;
    }
    // From air into water nothing is reflected totally; an index below 1 can, and then nothing enters.
    let Some(direction) = refract(incident, entry.normal, 1.0, water.refractive_index) else {
        return Landing::MissesWater;
    };
    match tracer.cast(entry.position, direction, SELF_HIT * tracer.size_m, f64::MAX) {
        Some(hit) => Landing::Landed(Landed { entry, direction, hit }),
        None => Landing::Leaves { entry, direction },
    }
}

/// Share of an unpolarised photon's energy that enters the water with it: Fresnel's, or all of it where that is left aside. Both
/// directions have unit length.
pub fn entering(water: &Water, normal: DVec3, incident: DVec3) -> f64 {
    if !water.fresnel {
        return 1.0;
    }
    fresnel_transmittance(incident.dot(normal).abs(), 1.0, water.refractive_index)
}

/// Landing of every `step`th photon of a grid, in memory order, on all cores.
pub fn land_all(
    frame: &LightFrame,
    water: &Water,
    tracer: &Tracer,
    grid: PhotonGrid,
    step: usize,
) -> Vec<Landing> {
    let count = grid.count() as usize;
    (0..count.div_ceil(step.max(1)))
        .into_par_iter()
        .map(|i| land(frame, water, tracer, grid.ndc((i * step) as u64)))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use fathom_scene::{Bounds, Camera, Light, LightKind, Mesh, Object, Scene};
    use itertools::iproduct;

    const DEPTH_M: f64 = 4.0;

    /// A horizontal square about (x, z) = (0, 0).
    fn square(half: f64, y: f64) -> Object {
        let middle = DVec3::Y * y;
        Object::new("square", Mesh::parallelogram(middle, DVec3::Z * half, DVec3::X * half))
    }

    fn flat_water(half: f64) -> Water {
        Water { amplitude_m: 0.0, half_size_m: [half, half], ..Water::default() }
    }

    fn frame(kind: LightKind) -> LightFrame {
        let camera = Camera::new([0.0, -1.0, 5.0], [0.0, -3.0, 0.0], 60.0, [0.1, 12.0]);
        let light = Light {
            kind,
            direction: [0.4, -1.0, 0.2],
            position_m: [1.0, 8.0, -0.5],
            ..Light::default()
        };
        let bounds =
            Bounds { min: DVec3::new(-6.0, -DEPTH_M, -6.0), max: DVec3::new(6.0, 1.0, 6.0) };
        light.frame(&camera, 1.0, &bounds, &Water::default())
    }

    #[test]
    fn memory_order_walks_cells_then_sub_points() {
        let grid = PhotonGrid::new(3, 2);
        assert_eq!(grid.count(), 36);
        let at = |x: f64| 2.0 * (x + 0.5) / 6.0 - 1.0;
        assert_eq!(grid.ndc(0), [at(0.0), at(0.0)]);
        assert_eq!(grid.ndc(1), [at(1.0), at(0.0)]);
        assert_eq!(grid.ndc(2), [at(0.0), at(1.0)]);
        assert_eq!(grid.ndc(4), [at(2.0), at(0.0)]);
        assert_eq!(grid.ndc(35), [at(5.0), at(5.0)]);
        let corner = PhotonGrid { offset: [0.0, 1.0], ..grid };
        assert_eq!(corner.ndc(0), [-1.0, at(0.5)]);
    }

    #[test]
    fn strewn_photons_fill_their_shares_evenly_and_never_leave_them() {
        let (grid, cells) = (PhotonGrid::new(40, 2), 40.0 * 2.0);
        let whole = PhotonGrid { jitter: 1.0, ..grid };
        let share = |ndc: [f64; 2]| ndc.map(|at| ((at + 1.0) / 2.0 * cells).fract());
        let mut bins = [[0u32; 4]; 2];
        for index in 0..grid.count() {
            let (regular, strewn) = (grid.ndc(index), whole.ndc(index));
            for axis in [0, 1] {
                assert!((regular[axis] - strewn[axis]).abs() <= 1.0 / cells + 1e-12);
                bins[axis][(share(strewn)[axis] * 4.0) as usize] += 1;
            }
        }
        let expected = grid.count() as f64 / 4.0;
        assert!(
            bins.iter().flatten().all(|n| (f64::from(*n) / expected - 1.0).abs() < 0.1),
            "{bins:?}"
        );
        let moved = PhotonGrid { offset: [0.9, 0.2], ..whole };
        let turned = |a: f64, b: f64| (a - b).rem_euclid(1.0);
        for index in 0..20 {
            let (a, b) = (share(moved.ndc(index)), share(whole.ndc(index)));
            assert!((turned(a[0], b[0]) - 0.4).abs() < 1e-9, "all are moved by as much");
            assert!((turned(a[1], b[1]) - 0.7).abs() < 1e-9);
        }
    }

    /// Of the photons of the whole frustum that land in view, the share that starts beyond the grid made so many times as wide.
    fn left_out(name: &str, set: impl Fn(&mut Light), width: f64) -> f64 {
        let mut scene = Scene::load(name).unwrap();
        set(&mut scene.light);
        let tracer = Tracer::new(&scene.objects);
        let (camera, light) = (&scene.camera, &scene.light);
        let whole = light.frame(camera, 1.2, &scene.bounds, &scene.water);
        let fitted = light.photon_frame(camera, 1.2, &scene.bounds, &scene.water);
        let (place, view) = (fitted.photon_grid.inverse(), camera.view_projection(1.2));
        let landings = land_all(&whole, &scene.water, &tracer, PhotonGrid::new(90, 1), 1);
        let in_view = landings.iter().filter_map(Landing::landed).filter(|landed| {
            let clip = view * landed.hit.position.extend(1.0);
            let across = clip.truncate().truncate().abs().max_element();
            across < clip.w && (0.0..clip.w).contains(&clip.z)
        });
        let in_view: Vec<_> = in_view.collect();
        assert!(in_view.len() > 400, "{name}: {}", in_view.len());
        let beyond = in_view.iter().filter(|landed| {
            let at = place.project_point3(landed.entry.position).truncate();
            at.abs().max_element() > width
        });
        beyond.count() as f64 / in_view.len() as f64
    }

    #[test]
    fn the_grid_leaves_out_no_photon_that_lands_in_view() {
        for name in ["tank", "port", "storage", "diving_pool", "dolphin", "plane"] {
            let (none, some) = (left_out(name, |_| (), 1.0), left_out(name, |_| (), 0.5));
            assert!(none < 2e-3 && some > 0.03, "{name}: {none} {some}");
        }
        // At grazing light, and from near points.
        for (name, degrees) in iproduct!(["tank", "dolphin"], [60.0, 75.0]) {
            let slanted = |light: &mut Light| {
                let (sine, cosine) = f64::to_radians(degrees).sin_cos();
                light.direction = [0.8 * sine, -cosine, 0.6 * sine];
            };
            assert!(left_out(name, slanted, 1.0) < 2e-3, "{name} {degrees}°");
        }
        for (name, position_m) in [("tank", [-6.0, 2.0, 4.0]), ("dolphin", [3.0, 8.0, 2.0])] {
            let point = |light: &mut Light| {
                (light.kind, light.position_m) = (LightKind::Point, position_m);
            };
            assert!(left_out(name, point, 1.0) < 2e-3, "{name} {position_m:?}");
        }
    }

    #[test]
    fn flat_water_over_a_plane_has_the_closed_form() {
        let tracer = Tracer::new(&[square(60.0, -DEPTH_M)]);
        let water = flat_water(50.0);
        for kind in [LightKind::Directional, LightKind::Point] {
            let frame = frame(kind);
            for ndc in [[0.0, 0.0], [0.7, -0.4], [-0.99, 0.99]] {
                let landing = land(&frame, &water, &tracer, ndc);
                let landed = landing.landed().expect("nothing is in the way");
                let (origin, i) = frame.photon_ray(ndc);
                let entry = origin - i * (origin.y / i.y);
                let sin_t = i.x.hypot(i.z) / 1.33;
                let shift = DEPTH_M * sin_t / (1.0 - sin_t * sin_t).sqrt();
                let along = DVec3::new(i.x, 0.0, i.z).normalize();
                let expected = entry + along * shift - DVec3::Y * DEPTH_M;
                assert!((landed.hit.position - expected).length() < 1e-9);
                let slant = DEPTH_M / (1.0 - sin_t * sin_t).sqrt();
                assert!((landed.hit.distance_m - slant).abs() < 1e-9);
            }
        }
    }

    #[test]
    fn steps_pick_every_nth_photon() {
        let tracer = Tracer::new(&[square(60.0, -4.0)]);
        let (frame, water) = (frame(LightKind::Directional), flat_water(50.0));
        let grid = PhotonGrid::new(3, 2);
        let all = land_all(&frame, &water, &tracer, grid, 1);
        let some = land_all(&frame, &water, &tracer, grid, 5);
        assert_eq!((all.len(), some.len()), (36, 8));
        assert!(some.iter().zip(all.iter().step_by(5)).all(|(a, b)| a == b));
    }

    #[test]
    fn each_way_to_be_lost_has_its_reason() {
        let frame = frame(LightKind::Directional);
        let at = |objects: &[Object], half| {
            let tracer = Tracer::new(objects);
            land(&frame, &flat_water(half), &tracer, [0.9, 0.9])
        };
        let floor = || square(60.0, -4.0);
        assert!(matches!(at(&[floor()], 50.0), Landing::Landed(_)));
        assert_eq!(at(&[floor(), square(60.0, 0.5)], 50.0), Landing::Blocked);
        assert_eq!(at(&[floor()], 0.01), Landing::MissesWater);
        assert!(matches!(at(&[], 50.0), Landing::Leaves { .. }));
    }
}
