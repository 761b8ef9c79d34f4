//! Where a frame's photons land, against exact refraction and ray casting.

use std::collections::BTreeMap;

use super::{GridSettings, Underwater};
use crate::off_frustum::Frustum;
use crate::settings::Animation;
use crate::{Errors, Judge, JudgeError, even_step, judged_view, share};
use fathom_record::ErrorFigure;
use fathom_reference::photons::{Landing, PhotonGrid as ExactGrid, land_all};
use fathom_reference::quantities::quantile;
use fathom_stages::photon::{self, Fate, Photon, Photons};

/// At most this many photons of a grid are compared with the reference: enough for a 99th percentile.
const MAX_PHOTONS: usize = 10_000;

/// Photons held against exact ones.
#[derive(Default)]
struct Found {
    /// Of those that land by both: distance from where they land exactly, metres.
    errors_m: Vec<f64>,
    /// Land exactly, lost on the GPU.
    missed: usize,
    /// Land on the GPU, not exactly.
    false_hits: usize,
}

impl Found {
    fn add(&mut self, photon: &Photon, exact: &Landing) {
        match (photon.has_landed(), exact.landed()) {
            (true, Some(landed)) => {
                self.errors_m.push(photon.hit().distance(landed.hit.position));
            }
            (false, Some(_)) => self.missed += 1,
            (true, None) => self.false_hits += 1,
            (false, None) => {}
        }
    }
}

impl Underwater {
    /// Errors of the last frame's photons, of both grids: `caustics_photon_error_median_m`, `…_photon_error_p99_m`,
    /// `…_photon_miss_rate`, `…_photon_false_hit_rate` and `…_unconverged_rate`, `godrays_…` likewise; the quantity
    /// `…_photon_leak_rate` as pipeline `photon_tracing` has it. Of large grids an even selection is compared.
    pub(super) fn landing_errors(&self, judge: &mut Judge<'_>) -> Result<Errors, JudgeError> {
        let scene = judge.scene;
        let view = judged_view(&self.view, scene);
        let frame = view.light_frame();
        let tracer = judge.references.geometry.tracer(scene, &Animation::default());
        let (mut errors, mut quantities) = (Vec::new(), BTreeMap::new());
        let frustum = Frustum::new(&view, scene.solid_bounds().tank_scale());
        for (name, stage, settings, photons) in self.grids() {
            let GridSettings { grid: cells, offset, jitter, .. } = settings;
            let grid = ExactGrid { cells, side: settings.side(), offset, jitter };
            let step = even_step(grid.count() as usize, MAX_PHOTONS);
            let photons = photons.read(judge.gpu)?;
            let tolerance_m = settings.tolerance_m as f32;
            let unconverged = photons.iter().filter(
                |p| matches!(p.fate(), Fate::Landed { residual_m } if residual_m > tolerance_m),
            );
            let unconverged_rate = unconverged.count() as f64 / photons.len() as f64;
            let judged: Vec<Photon> = photons.into_iter().step_by(step).collect();
            let content = judge.question("landings", &(&frame, &view.water, grid, step));
            let land = |_: &mut _| land_all(&frame, &view.water, &tracer, grid, step);
            let landings = judge.references.answer(content, land);
            let mut found = Found::default();
            judged.iter().zip(&*landings).for_each(|(photon, exact)| found.add(photon, exact));
            let exact = landings.iter().map(|exact| exact.landed());
            let pairs = judged.iter().zip(exact).filter_map(|(p, exact)| Some((p, exact?)));
            let kept_out =
                pairs.filter(|(_, at)| frustum.is_hidden_entry(&tracer, &at.hit, at.direction));
            let leaks: Vec<bool> =
                kept_out.map(|(p, at)| frustum.is_leak(p, at.hit.position)).collect();
            let leaked = leaks.iter().filter(|leaks| **leaks).count();
            quantities.insert(format!("{name}_photon_leak_rate"), share(leaked, leaks.len()));
            let figures = [
                ("photon_error_median_m", quantile(&mut found.errors_m, 0.5), "m"),
                ("photon_error_p99_m", quantile(&mut found.errors_m, 0.99), "m"),
                ("photon_miss_rate", share(found.missed, found.missed + found.errors_m.len()), "1"),
                ("photon_false_hit_rate", share(found.false_hits, judged.len()), "1"),
                ("unconverged_rate", unconverged_rate, "1"),
            ];
            errors.extend(figures.map(|(figure, value, unit)| {
                ErrorFigure::new(format!("{name}_{figure}"), value, unit, stage)
            }));
        }
        Ok(Errors { errors, quantities, ..Errors::default() })
    }

    /// Both photon grids: name, stage that traces it, settings, photons.
    pub(super) fn grids(&self) -> [(&'static str, &'static str, GridSettings, &Photons); 2] {
        let caustics = (self.params.caustics.grid_settings(), &self.caustics.photons);
        let godrays = (self.params.godrays.grid_settings(), &self.godrays.photons);
        [
            ("caustics", photon::CAUSTICS.name, caustics.0, caustics.1),
            ("godrays", photon::GODRAYS.name, godrays.0, godrays.1),
        ]
    }
}
