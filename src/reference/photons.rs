//! The photon grid in the light's screen space and the exact landing point of each photon (UW §3.3).

use glam::DVec3;
use rayon::prelude::*;

use super::optics::{fresnel_transmittance, refract};
use super::rays::{Hit, Tracer};
use super::surface::{Entry, enter};
use fathom_scene::{LightFrame, Water, pcg};

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
        let strewn = random_jitter(fine.map(|k| k as u32));
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
fn random_jitter([x, y]: [u32; 2]) -> [f64; 2] {
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
pub fn entering_share(water: &Water, normal: DVec3, incident: DVec3) -> f64 {
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
