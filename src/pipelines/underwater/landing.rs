//! Where a frame's photons land, against exact refraction and ray casting.

use std::collections::BTreeMap;

use super::{PhotonGrid, Underwater};
use crate::off_frustum::Frustum;
use crate::{JudgeError, Judged, even_step, judged_view, share};
use fathom_gpu::{Gpu, read_buffer};
use fathom_record::ErrorFigure;
use fathom_reference::photons::{PhotonGrid as ExactGrid, land_all};
use fathom_reference::quantities::{StoredPhoton, photon_errors, stored_photons};
use fathom_reference::rays::Tracer;
use fathom_scene::Scene;
use fathom_stages::{caustics, godrays};

/// At most this many photons of a grid are compared with the reference: enough for a 99th percentile.
const MOST_PHOTONS: usize = 10_000;

impl Underwater {
    /// Errors of the last frame's photons, of both grids: `caustics_photon_error_median_m`, `…_photon_error_p99_m`,
    /// `…_photon_miss_rate`, `…_photon_false_hit_rate` and `…_unconverged_rate`, `godrays_…` likewise; the quantity
    /// `…_photon_leak_rate` as pipeline `photon_tracing` has it. Of large grids an even selection is compared.
    pub fn landing_errors(&self, gpu: &Gpu, scene: &Scene) -> Result<Judged, JudgeError> {
        let view = judged_view(&self.view, scene);
        let frame = view.light_frame();
        let tracer = Tracer::new(&scene.objects);
        let (mut errors, mut quantities) = (Vec::new(), BTreeMap::new());
        let frustum = Frustum::new(&tracer, &view, scene.solid_bounds().times_tank());
        for (name, stage, settings, photons) in self.grids() {
            let PhotonGrid { grid: cells, offset, jitter, .. } = settings;
            let grid = ExactGrid { cells, side: settings.side(), offset, jitter };
            let step = even_step(grid.count() as usize, MOST_PHOTONS);
            let photons = stored_photons(&read_buffer(gpu, photons)?);
            let tolerance_m = f64::from(settings.tolerance_m as f32);
            let unconverged = photons.iter().filter(|p| p.residual_m > tolerance_m);
            let unconverged_rate = unconverged.count() as f64 / photons.len() as f64;
            let judged: Vec<StoredPhoton> = photons.into_iter().step_by(step).collect();
            let landings = land_all(&frame, &view.water, &tracer, grid, step);
            let found = photon_errors(&judged, &landings);
            let exact = landings.iter().map(|exact| exact.landed());
            let pairs = judged.iter().zip(exact).filter_map(|(p, exact)| Some((p, exact?)));
            let kept_out = pairs.filter(|(_, at)| frustum.is_kept_out(&at.hit, at.direction));
            let leaks: Vec<bool> =
                kept_out.map(|(p, at)| frustum.leaks(p, at.hit.position)).collect();
            let leaked = leaks.iter().filter(|leaks| **leaks).count();
            quantities.insert(format!("{name}_photon_leak_rate"), share(leaked, leaks.len()));
            let figures = [
                ("photon_error_median_m", found.median_m, "m"),
                ("photon_error_p99_m", found.p99_m, "m"),
                ("photon_miss_rate", found.miss_rate, "1"),
                ("photon_false_hit_rate", found.false_hit_rate, "1"),
                ("unconverged_rate", unconverged_rate, "1"),
            ];
            errors.extend(figures.map(|(figure, value, unit)| {
                ErrorFigure::new(format!("{name}_{figure}"), value, unit, stage)
            }));
        }
        Ok(Judged { errors, quantities })
    }

    /// Both photon grids: name, stage that traces it, settings, photons.
    pub(super) fn grids(&self) -> [(&'static str, &'static str, PhotonGrid, &wgpu::Buffer); 2] {
        let caustics = (self.params.caustics.grid_settings(), &self.caustics.photons.buffer);
        let godrays = (self.params.godrays.grid_settings(), &self.godrays.photons.buffer);
        [
            ("caustics", caustics::trace::INFO.name, caustics.0, caustics.1),
            ("godrays", godrays::trace::INFO.name, godrays.0, godrays.1),
        ]
    }
}
