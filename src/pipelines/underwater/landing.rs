//! Where a frame's photons land, against exact refraction and ray casting.

use super::{GridSettings, Underwater};
use crate::off_frustum::Frustum;
use crate::settings::Animation;
use crate::{Errors, Judge, Judging, Rates, even_step, judged_view};
use fathom_gpu::{Gpu, GpuError};
use fathom_record::ErrorFigure;
use fathom_reference::photons::{PhotonGrid as ExactGrid, land_all};
use fathom_reference::quantities::quantile;
use fathom_stages::photon::{Fate, Photon, Photons};
use fathom_stages::uniforms::View;
use fathom_stages::{caustics, godrays};

/// At most this many photons of a grid are compared with the reference: enough for a 99th percentile.
const MAX_PHOTONS: usize = 10_000;

impl Underwater {
    /// Errors of the last frame's photons, of both grids: `caustics_photon_error_median_m`, `…_photon_error_p99_m`,
    /// `…_photon_miss_rate`, `…_photon_false_hit_rate` and `…_unconverged_rate`, `godrays_…` likewise; the quantity
    /// `…_photon_leak_rate` as pipeline `photon_tracing` has it. Of large grids an even selection is compared.
    pub(super) fn landing_errors(&self, gpu: &Gpu) -> Result<Judging, GpuError> {
        let read = |(name, stage, settings, photons): (_, _, _, &Photons)| {
            Ok(LandedGrid { name, stage, settings, photons: photons.read(gpu)? })
        };
        let grids: Vec<_> = self.grids().into_iter().map(read).collect::<Result<_, GpuError>>()?;
        let view = self.view.clone();
        Ok(Box::new(move |judge| {
            let mut errors = Errors::default();
            let view = judged_view(&view, judge.scene);
            grids.iter().for_each(|grid| grid.add_errors(&view, judge, &mut errors));
            Ok(errors)
        }))
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

/// Where the photons of a grid have landed.
struct LandedGrid {
    name: &'static str,
    /// That traces it.
    stage: &'static str,
    settings: GridSettings,
    photons: Vec<Photon>,
}

impl LandedGrid {
    fn add_errors(&self, view: &View, judge: &Judge<'_>, judged: &mut Errors) {
        let (scene, frame) = (judge.scene, view.light_frame());
        let tracer = judge.references.geometry.tracer(scene, &Animation::default());
        let frustum = Frustum::new(view, scene.solid_bounds().tank_scale());
        let Self { name, stage, settings, photons } = self;
        let GridSettings { grid: cells, offset, jitter, .. } = *settings;
        let grid = ExactGrid { cells, side: settings.side(), offset, jitter };
        let step = even_step(grid.count() as usize, MAX_PHOTONS);
        let tolerance_m = settings.tolerance_m as f32;
        let unconverged = photons.iter().filter(
            |p| matches!(p.fate(), Fate::Landed { residual_m } if residual_m > tolerance_m),
        );
        let unconverged_rate = unconverged.count() as f64 / photons.len() as f64;
        let content = judge.question("landings", &(&frame, &view.water, grid, step));
        let land = || land_all(&frame, &view.water, &tracer, grid, step);
        let landings = judge.references.answer(content, land);
        let (mut errors_m, mut rates) = (Vec::new(), Rates::default());
        for (photon, exact) in photons.iter().step_by(step).zip(&*landings) {
            let (found, exact) = (photon.has_landed(), exact.landed());
            rates.count("photon_false_hit_rate", [found && exact.is_none()]);
            let Some(exact) = exact else { continue };
            rates.count("photon_miss_rate", [!found]);
            errors_m.extend(found.then(|| photon.hit().distance(exact.hit.position)));
            if frustum.is_hidden_entry(&tracer, &exact.hit, exact.direction) {
                rates.count("photon_leak_rate", [frustum.is_leak(photon, exact.hit.position)]);
            }
        }
        let leaks = rates.rate("photon_leak_rate");
        judged.quantities.insert(format!("{name}_photon_leak_rate"), leaks);
        let [misses, false_hits] = ["photon_miss_rate", "photon_false_hit_rate"];
        let figures = [
            ("photon_error_median_m", quantile(&mut errors_m, 0.5), "m"),
            ("photon_error_p99_m", quantile(&mut errors_m, 0.99), "m"),
            (misses, rates.rate(misses), "1"),
            (false_hits, rates.rate(false_hits), "1"),
            ("unconverged_rate", unconverged_rate, "1"),
        ];
        judged.errors.extend(figures.map(|(figure, value, unit)| {
            ErrorFigure::new(format!("{name}_{figure}"), value, unit, stage)
        }));
    }
}
