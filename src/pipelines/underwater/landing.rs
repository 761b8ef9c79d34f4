//! Where a frame's photons land, against exact refraction and ray casting.

use std::collections::BTreeMap;

use super::{GridSettings, Underwater};
use crate::off_frustum::Frustum;
use crate::settings::Animation;
use crate::{Errors, Judge, JudgeError, Rates, even_step, judged_view};
use fathom_record::ErrorFigure;
use fathom_reference::photons::{PhotonGrid as ExactGrid, land_all};
use fathom_reference::quantities::quantile;
use fathom_stages::photon::{Fate, Photon, Photons};
use fathom_stages::{caustics, godrays};

/// At most this many photons of a grid are compared with the reference: enough for a 99th percentile.
const MAX_PHOTONS: usize = 10_000;

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
            let (mut errors_m, mut rates) = (Vec::new(), Rates::default());
            for (photon, exact) in judged.iter().zip(&*landings) {
                let (found, exact) = (photon.has_landed(), exact.landed());
                rates.count("photon_false_hit_rate", [found && exact.is_none()]);
                let Some(exact) = exact else { continue };
                rates.count("photon_miss_rate", [!found]);
                errors_m.extend(found.then(|| photon.hit().distance(exact.hit.position)));
                if frustum.is_hidden_entry(&tracer, &exact.hit, exact.direction) {
                    rates.count("photon_leak_rate", [frustum.is_leak(photon, exact.hit.position)]);
                }
            }
            quantities.insert(format!("{name}_photon_leak_rate"), rates.rate("photon_leak_rate"));
            let [misses, false_hits] = ["photon_miss_rate", "photon_false_hit_rate"];
            let figures = [
                ("photon_error_median_m", quantile(&mut errors_m, 0.5), "m"),
                ("photon_error_p99_m", quantile(&mut errors_m, 0.99), "m"),
                (misses, rates.rate(misses), "1"),
                (false_hits, rates.rate(false_hits), "1"),
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
            ("caustics", caustics::trace::INFO.name, caustics.0, caustics.1),
            ("godrays", godrays::trace::INFO.name, godrays.0, godrays.1),
        ]
    }
}
