//! The photon grid in the light's screen space and the exact landing point of each photon (UW §3.3).

use glam::DVec3;
use rayon::prelude::*;

use super::ReferenceError;
use super::optics::refract;
use super::rays::{Hit, Tracer};
use super::surface::{Entry, enter};
use crate::scene::{LightFrame, Water};

/// A ray that starts on a surface ignores hits nearer than this, metres.
const SELF_HIT_M: f64 = 1e-9;

/// A square grid of photons over the light's normalised device coordinates.
///
/// `cells`² cells, each subdivided into `side`² photons that sit at the cell centres of the finer
/// grid. Photon `((j·cells + i)·side + sj)·side + si` is sub-point (si, sj) of cell (i, j).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PhotonGrid {
    cells: u32,
    side: u32,
}

impl PhotonGrid {
    /// `subdivision` photons per cell: a perfect square (1, 4, 9, 16, …).
    pub fn new(cells: u32, subdivision: u32) -> Result<PhotonGrid, ReferenceError> {
        let side = subdivision.isqrt();
        if side == 0 || side * side != subdivision {
            return Err(ReferenceError::Subdivision(subdivision));
        }
        Ok(PhotonGrid { cells, side })
    }

    /// Photons in the grid.
    pub fn count(&self) -> u64 {
        (u64::from(self.cells) * u64::from(self.side)).pow(2)
    }

    /// Normalised device coordinates of a photon by its index in memory.
    pub fn ndc(&self, index: u64) -> [f64; 2] {
        let (cells, side) = (u64::from(self.cells), u64::from(self.side));
        let (cell, sub) = (index / (side * side), index % (side * side));
        let fine = [
            (cell % cells) * side + sub % side,
            (cell / cells) * side + sub / side,
        ];
        fine.map(|i| 2.0 * (i as f64 + 0.5) / (cells * side) as f64 - 1.0)
    }
}

/// A photon that entered the water and met a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Landed {
    pub entry: Entry,
    /// Unit direction after refraction.
    pub direction: DVec3,
    pub hit: Hit,
    /// From entry to hit, metres (the paper's d_fromSurface).
    pub distance_m: f64,
}

/// What became of a photon.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Landing {
    Landed(Landed),
    /// Geometry above the water stops the photon.
    Blocked,
    /// The photon passes beside the water's surface.
    MissesWater,
    /// The photon enters the water and meets nothing.
    Leaves { entry: Entry, direction: DVec3 },
}

impl Landing {
    pub fn landed(&self) -> Option<&Landed> {
        match self {
            Landing::Landed(landed) => Some(landed),
            _ => None,
        }
    }
}

/// Follows the photon through point `ndc` of the light's screen: air, refraction at the surface, water.
pub fn land(frame: &LightFrame, water: &Water, tracer: &Tracer, ndc: [f64; 2]) -> Landing {
    let (origin, incident) = frame.ray(ndc[0], ndc[1]);
    let Some(entry) = enter(water, origin, incident, f64::MAX) else {
        return Landing::MissesWater;
    };
    if tracer
        .cast(origin, incident, 0.0, entry.distance_m)
        .is_some()
    {
        return Landing::Blocked;
    }
    // From air into water nothing is reflected totally; an index below 1 can, and then nothing enters.
    let Some(direction) = refract(incident, entry.normal, 1.0, water.refractive_index) else {
        return Landing::MissesWater;
    };
    match tracer.cast(entry.position, direction, SELF_HIT_M, f64::MAX) {
        Some(hit) => Landing::Landed(Landed {
            entry,
            direction,
            hit,
            distance_m: hit.distance_m,
        }),
        None => Landing::Leaves { entry, direction },
    }
}

/// Landing of every photon of a grid, in memory order, on all cores.
pub fn land_all(
    frame: &LightFrame,
    water: &Water,
    tracer: &Tracer,
    grid: PhotonGrid,
) -> Vec<Landing> {
    (0..grid.count())
        .into_par_iter()
        .map(|i| land(frame, water, tracer, grid.ndc(i)))
        .collect()
}
