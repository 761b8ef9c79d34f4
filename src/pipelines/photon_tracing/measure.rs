//! Figures read back from a frame: where photons end, and how far that is from exact refraction and ray casting.

use std::collections::BTreeMap;

use glam::DVec3;

use super::{PhotonTracing, under_water};
use crate::caustics_image::{Compared, FoundCaustics, channel};
use crate::{Drawing, Judge, JudgeError, Judged, exact_of, named, objects_of, share};
use fathom_gpu::{Gpu, GpuError, read_buffer, read_texture};
use fathom_reference::photons::{land, place_in_grid};
use fathom_reference::quantities::{StoredPhoton, quantile, stored_photons};
use fathom_reference::rays::{Hit, Tracer};
use fathom_reference::specular::{End, Surfaces};
use fathom_scene::{Optics, Scene};
use fathom_stages::geometry::Part;
use fathom_stages::photon::{MISSED, ON_ITS_WAY, OUTSIDE};
use fathom_stages::sprites;

/// At most about this many photons are compared with the reference: enough for a 99th percentile.
const MOST_PHOTONS: usize = 10_000;
/// A photon that ends farther than this from its exact end lies on another surface, metres in scene tank: ten times the tolerance of SPT §5.
const WRONG_M: f64 = 0.1;
/// A ray goes on this far behind a surface, so as not to meet it again, metres in scene tank.
const BEYOND_M: f64 = 1e-6;

/// Photons held against their exact ends.
#[derive(Clone, Debug, Default, PartialEq)]
struct Ends {
    /// Of photons that end in view, by both: distance from the exact end, metres.
    errors_m: Vec<f64>,
    /// End in view, and were not found.
    lost: usize,
    /// End outside the camera's frustum: no layer shows the surface that they meet.
    off_frustum: usize,
    /// Of these, found to end in view.
    false_hits: usize,
    /// Exact ends, in view, with the surface of another object behind them.
    occluded: usize,
    /// Of these, found to end behind the occluder.
    passed: usize,
    /// Exact ends, in view, behind a mirror or glass.
    specular: usize,
    /// Of these, found to end anywhere: distance from the exact end, metres.
    specular_errors_m: Vec<f64>,
}

/// Where a photon ends.
struct Exact {
    position: DVec3,
    /// Whether it would meet another object if the one that it ends on were not there.
    occluder: bool,
    /// Whether it has come by a mirror or glass.
    specular: bool,
}

impl Ends {
    fn add(&mut self, found: &StoredPhoton, exact: DVec3, in_view: bool) {
        match (in_view, found.landed()) {
            (true, true) => self.errors_m.push(found.hit.distance(exact)),
            (true, false) => self.lost += 1,
            (false, landed) => {
                self.off_frustum += 1;
                self.false_hits += usize::from(landed);
            }
        }
    }

    /// Of a photon that ends in view on what stands before another object.
    fn add_occluded(&mut self, found: &StoredPhoton, exact: DVec3, wrong_m: f64) {
        let way_m = |end: DVec3| end.distance(found.entry);
        self.occluded += 1;
        self.passed += usize::from(found.landed() && way_m(found.hit) > way_m(exact) + wrong_m);
    }

    /// Of a photon that ends in view behind a mirror or glass.
    fn add_specular(&mut self, found: &StoredPhoton, exact: DVec3) {
        self.specular += 1;
        self.specular_errors_m.extend(found.landed().then(|| found.hit.distance(exact)));
    }
}

impl Drawing for PhotonTracing {
    fn image(&self) -> &wgpu::Texture {
        &self.image
    }

    /// Shares of the photons that never enter the water, whose rays meet no layer, and that are still between mirrors and glass.
    fn quantities(&self, gpu: &Gpu) -> Result<BTreeMap<String, f64>, GpuError> {
        let photons = self.stored(gpu)?;
        let rate = |residual_m: f32| {
            let alike = photons.iter().filter(|p| p.residual_m == f64::from(residual_m));
            share(alike.count(), photons.len())
        };
        Ok(named([
            ("missed_water_rate", rate(MISSED)),
            ("photon_no_hit_rate", rate(OUTSIDE)),
            ("photon_on_its_way_rate", rate(ON_ITS_WAY)),
        ]))
    }

    fn judge(&self, judge: &mut Judge<'_>) -> Result<Judged, JudgeError> {
        self.landing_errors(judge.gpu, judge.scene)
    }

    fn caustics(&self, judge: &mut Judge<'_>) -> Result<Option<Compared>, JudgeError> {
        // What the sprites have added up.
        let irradiance = channel(&read_texture(judge.gpu, &self.irradiance)?, 0);
        let found = FoundCaustics { irradiance, stage: sprites::draw::INFO.name };
        Compared::new(judge, &self.view, &found).map(Some)
    }
}

impl PhotonTracing {
    fn stored(&self, gpu: &Gpu) -> Result<Vec<StoredPhoton>, GpuError> {
        Ok(stored_photons(&read_buffer(gpu, &self.photons.buffer)?))
    }

    /// Errors of the last frame's photons: `photon_error_median_m`, `photon_error_p99_m`, `photon_wrong_surface_rate` of those that
    /// end in view by both, and `photon_miss_rate` of those that end in view. The quantities `photon_off_frustum_rate` and
    /// `photon_false_hit_rate` are shares of all photons that end anywhere; `photon_occluded_rate` is the share of those in view that end
    /// before another object, and `photon_passed_rate` the share of these that were found behind what they end on. `photon_specular_rate` is
    /// the share of those in view that come by a mirror or glass, `photon_specular_miss_rate` the share of these that are lost, and
    /// `photon_specular_error_median_m` the error of the rest.
    /// `caustics_photon_error_median_m` and `caustics_photon_miss_rate` are the errors of the pipeline `underwater` by the same names: the second is a share of all photons that
    /// end anywhere, in view or not. Of large grids an even selection is compared.
    fn landing_errors(&self, gpu: &Gpu, scene: &Scene) -> Result<Judged, JudgeError> {
        let found = self.stored(gpu)?;
        let ends = self.ends(&found, scene)?;
        let Ends {
            mut errors_m,
            lost,
            off_frustum,
            false_hits,
            occluded,
            passed,
            specular,
            mut specular_errors_m,
        } = ends;
        let in_view = errors_m.len() + lost;
        let wrong_m = WRONG_M * scene.solid_bounds().times_tank();
        let wrong = errors_m.iter().filter(|error_m| **error_m > wrong_m).count();
        let all = in_view + off_frustum;
        let (median_m, p99_m) = (quantile(&mut errors_m, 0.5), quantile(&mut errors_m, 0.99));
        let errors = [
            ("photon_miss_rate", share(lost, in_view), "1"),
            ("photon_wrong_surface_rate", share(wrong, errors_m.len()), "1"),
            ("photon_error_median_m", median_m, "m"),
            ("photon_error_p99_m", p99_m, "m"),
            ("caustics_photon_error_median_m", median_m, "m"),
            ("caustics_photon_miss_rate", share(lost + off_frustum, all), "1"),
        ];
        let quantities = [
            ("photon_off_frustum_rate", share(off_frustum, all)),
            ("photon_false_hit_rate", share(false_hits, all)),
            ("photon_occluded_rate", share(occluded, in_view)),
            ("photon_passed_rate", share(passed, occluded)),
            ("photon_specular_rate", share(specular, in_view)),
            ("photon_specular_miss_rate", share(specular - specular_errors_m.len(), specular)),
        ];
        let stage = self.params.rays.method.info().name;
        let mut judged = Judged::of(stage, errors, quantities);
        if !specular_errors_m.is_empty() {
            let median_m = quantile(&mut specular_errors_m, 0.5);
            judged.quantities.insert("photon_specular_error_median_m".to_owned(), median_m);
        }
        Ok(judged)
    }

    fn ends(&self, found: &[StoredPhoton], scene: &Scene) -> Result<Ends, JudgeError> {
        let objects = objects_of(scene, Part::Solid);
        let tracer = &Tracer::new(&objects);
        let (frame, water) = (self.view.light_frame(), &self.view.water);
        let bounces = self.params.ways() - 1;
        let times = scene.solid_bounds().times_tank();
        let surfaces = Surfaces {
            tracer,
            objects: &objects,
            outside: water.refractive_index,
            top_m: under_water(scene).max.y,
        };
        let matrix = self.view.camera.view_projection(self.view.aspect());
        let transfer = &self.params.transfer;
        let exact = exact_of(found.len(), MOST_PHOTONS, |index| {
            let place = place_in_grid(index as u32, transfer.grid, transfer.offset);
            let landing = land(&frame, water, tracer, place);
            let landed = landing.landed()?;
            let ray = surfaces.ray(landed.entry.position, landed.direction);
            match surfaces.follow(ray, bounces) {
                End::Diffuse(hit) => Some(Exact {
                    position: hit.position,
                    occluder: bounces == 0
                        && stands_before_another(tracer, &hit, landed.direction, BEYOND_M * times),
                    specular: bounces > 0
                        && objects[landed.hit.object].material.optics != Optics::Diffuse,
                }),
                End::Leaves(_) | End::OnItsWay => None,
            }
        });
        let mut ends = Ends::default();
        for (index, exact) in exact {
            let Exact { position, occluder, specular } = exact;
            let clip = matrix * position.extend(1.0);
            let in_view = clip.x.abs() <= clip.w
                && clip.y.abs() <= clip.w
                && (0.0..=clip.w).contains(&clip.z);
            ends.add(&found[index], position, in_view);
            if in_view && specular {
                ends.add_specular(&found[index], position);
            }
            if in_view && occluder {
                ends.add_occluded(&found[index], position, WRONG_M * times);
            }
        }
        Ok(ends)
    }
}

/// Whether a ray that ends on a surface would go on to another object.
fn stands_before_another(tracer: &Tracer, hit: &Hit, direction: DVec3, beyond_m: f64) -> bool {
    let mut origin = hit.position;
    // Surfaces of the same object are passed; a ray meets few of them.
    for _ in 0..16 {
        match tracer.cast(origin, direction, beyond_m, f64::MAX) {
            Some(next) if next.object == hit.object => origin = next.position,
            next => return next.is_some(),
        }
    }
    false
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn photons_out_of_view_are_told_apart_from_errors() {
        let found = |residual_m: f64| StoredPhoton {
            entry: DVec3::ZERO,
            residual_m,
            hit: DVec3::NEG_Y,
            distance_m: 1.0,
        };
        let mut ends = Ends::default();
        ends.add(&found(0.0), DVec3::new(0.0, -1.5, 0.0), true);
        ends.add(&found(f64::from(OUTSIDE)), DVec3::NEG_Y, true);
        ends.add(&found(f64::from(OUTSIDE)), DVec3::NEG_Y, false);
        ends.add(&found(0.0), DVec3::NEG_Y, false);
        // Before another object: one that stops there, and one that goes through.
        ends.add_occluded(&found(0.0), DVec3::NEG_Y, WRONG_M);
        ends.add_occluded(&found(0.0), DVec3::new(0.0, -0.5, 0.0), WRONG_M);
        let (occluded, passed) = (2, 1);
        let errors_m = vec![0.5];
        // Behind a mirror: one that is found, and one that is not.
        ends.add_specular(&found(0.0), DVec3::new(0.0, -1.0, 0.25));
        ends.add_specular(&found(f64::from(OUTSIDE)), DVec3::NEG_Y);
        let (specular, specular_errors_m) = (2, vec![0.25]);
        let of_all = Ends { errors_m, lost: 1, off_frustum: 2, false_hits: 1, ..Ends::default() };
        assert_eq!(ends, Ends { occluded, passed, specular, specular_errors_m, ..of_all });
    }
}
