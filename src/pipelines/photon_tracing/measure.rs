//! Figures read back from a frame: where photons end, and how far that is from exact refraction and ray casting.

use std::collections::BTreeMap;

use glam::DVec3;

use super::{PhotonTracing, under_water};
use crate::caustics_image::{Compared, FoundCaustics, channel};
use crate::off_frustum::Frustum;
use crate::{Drawing, Judge, JudgeError, Judged};
use crate::{exact_of, judged_view, named, objects_of, share};
use fathom_gpu::{Gpu, GpuError, read_texture, read_volume};
use fathom_reference::photons::{land, place_in_grid};
use fathom_reference::quantities::quantile;
use fathom_reference::rays::Tracer;
use fathom_reference::specular::{End, Surfaces};
use fathom_scene::{Optics, Scene};
use fathom_stages::geometry::Part;
use fathom_stages::photon::{Fate, Photon};
use fathom_stages::sprites;

/// At most about this many photons are compared with the reference: enough for a 99th percentile.
const MOST_PHOTONS: usize = 10_000;
/// A photon that ends farther than this from its exact end lies on another surface, metres in scene tank: ten times the tolerance of SPT §5.
const WRONG_M: f64 = 0.1;

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
    /// End outside the camera's frustum on what keeps them from coming into view.
    kept_out: usize,
    /// Of these, found in view behind it.
    leaked: usize,
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
    /// Whether it would come into view, likewise.
    kept_out: bool,
    /// Whether it has come by a mirror or glass.
    specular: bool,
}

impl Ends {
    fn add(&mut self, found: &Photon, exact: DVec3, in_view: bool) {
        match (in_view, found.has_landed()) {
            (true, true) => self.errors_m.push(found.hit().distance(exact)),
            (true, false) => self.lost += 1,
            (false, landed) => {
                self.off_frustum += 1;
                self.false_hits += usize::from(landed);
            }
        }
    }

    /// Of a photon that ends in view on what stands before another object.
    fn add_occluded(&mut self, found: &Photon, exact: DVec3, wrong_m: f64) {
        let way_m = |end: DVec3| end.distance(found.entry());
        self.occluded += 1;
        self.passed +=
            usize::from(found.has_landed() && way_m(found.hit()) > way_m(exact) + wrong_m);
    }

    /// Of a photon that ends in view behind a mirror or glass.
    fn add_specular(&mut self, found: &Photon, exact: DVec3) {
        self.specular += 1;
        self.specular_errors_m.extend(found.has_landed().then(|| found.hit().distance(exact)));
    }
}

impl Drawing for PhotonTracing {
    fn image(&self) -> &wgpu::Texture {
        &self.image
    }

    /// Shares of the photons that never enter the water, whose rays meet no layer, and that are still between mirrors and glass. Of the layers
    /// what SPT §2.2 counts in a pass of its own: the most surfaces behind a pixel, and the share of all that lie behind the eighth.
    fn quantities(&self, gpu: &Gpu) -> Result<BTreeMap<String, f64>, GpuError> {
        let photons = self.photons.read(gpu)?;
        let rate = |fate: Fate| {
            let alike = photons.iter().filter(|p| p.fate() == fate);
            share(alike.count(), photons.len())
        };
        let depths = read_volume(gpu, &self.layers.depths, 0)?.data;
        let layers = depths.chunks_exact(self.view.size_px.element_product() as usize);
        let shown = |layer: &[f32]| layer.iter().filter(|z| **z < 1.0).count();
        let fragments: Vec<usize> = layers.map(shown).collect();
        let deepest = fragments.iter().filter(|count| **count > 0).count();
        let behind_8 = fragments.iter().skip(8).sum();
        Ok(named([
            ("depth_complexity", deepest as f64),
            ("fragments_behind_8_rate", share(behind_8, fragments.iter().sum())),
            ("missed_water_rate", rate(Fate::MissedWater)),
            ("photon_no_hit_rate", rate(Fate::LeftLight)),
            ("photon_on_its_way_rate", rate(Fate::StillBouncing)),
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
    /// Errors of the last frame's photons: `photon_error_median_m`, `photon_error_p99_m`, `photon_wrong_surface_rate` of those that
    /// end in view by both, and `photon_miss_rate` of those that end in view. The quantities `photon_off_frustum_rate` and
    /// `photon_false_hit_rate` are shares of all photons that end anywhere; `photon_occluded_rate` is the share of those in view that end
    /// before another object, and `photon_passed_rate` the share of these that were found behind what they end on. `photon_specular_rate` is
    /// the share of those in view that come by a mirror or glass, `photon_specular_miss_rate` the share of these that are lost, and
    /// `photon_specular_error_median_m` the error of the rest.
    /// `caustics_photon_kept_out_rate` is the share of all that end out of view on what keeps them from coming into view, and
    /// `caustics_photon_leak_rate` the share of these that were found in view behind it.
    /// `caustics_photon_error_median_m` and `caustics_photon_miss_rate` are the errors of the pipeline `underwater` by the same names: the second is a share of all photons that
    /// end anywhere, in view or not. Of large grids an even selection is compared.
    fn landing_errors(&self, gpu: &Gpu, scene: &Scene) -> Result<Judged, JudgeError> {
        let found = self.photons.read(gpu)?;
        let ends = self.ends(&found, scene)?;
        let Ends {
            mut errors_m,
            lost,
            off_frustum,
            false_hits,
            kept_out,
            leaked,
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
            ("caustics_photon_leak_rate", share(leaked, kept_out)),
            ("caustics_photon_kept_out_rate", share(kept_out, all)),
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

    fn ends(&self, found: &[Photon], scene: &Scene) -> Result<Ends, JudgeError> {
        let objects = objects_of(scene, Part::Solid);
        let tracer = &Tracer::new(&objects);
        let view = judged_view(&self.view, scene);
        let (frame, water) = (view.light_frame(), &view.water);
        let bounces = self.params.ways() - 1;
        let times = scene.solid_bounds().times_tank();
        let surfaces = Surfaces {
            tracer,
            objects: &objects,
            outside: water.refractive_index,
            top_m: under_water(scene).max.y,
        };
        let frustum = Frustum::new(tracer, &view, times);
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
                        && frustum
                            .hits_behind(hit, landed.direction)
                            .any(|next| next.object != hit.object),
                    kept_out: bounces == 0 && frustum.is_kept_out(&hit, landed.direction),
                    specular: bounces > 0
                        && objects[landed.hit.object].material.optics != Optics::Diffuse,
                }),
                End::Leaves(_) | End::OnItsWay => None,
            }
        });
        let mut ends = Ends::default();
        for (index, exact) in exact {
            let Exact { position, occluder, kept_out, specular } = exact;
            let in_view = frustum.holds(position);
            ends.kept_out += usize::from(kept_out);
            ends.leaked += usize::from(kept_out && frustum.leaks(&found[index], position));
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

#[cfg(test)]
mod tests {
    use fathom_stages::photon::OUTSIDE;
    use glam::Vec3;

    use super::*;

    #[test]
    fn photons_out_of_view_are_told_apart_from_errors() {
        let found =
            |fate: u32| Photon { entry_m: Vec3::ZERO, fate, hit_m: Vec3::NEG_Y, distance_m: 1.0 };
        let mut ends = Ends::default();
        ends.add(&found(0), DVec3::new(0.0, -1.5, 0.0), true);
        ends.add(&found(OUTSIDE), DVec3::NEG_Y, true);
        ends.add(&found(OUTSIDE), DVec3::NEG_Y, false);
        ends.add(&found(0), DVec3::NEG_Y, false);
        // Before another object: one that stops there, and one that goes through.
        ends.add_occluded(&found(0), DVec3::NEG_Y, WRONG_M);
        ends.add_occluded(&found(0), DVec3::new(0.0, -0.5, 0.0), WRONG_M);
        let (occluded, passed) = (2, 1);
        let errors_m = vec![0.5];
        // Behind a mirror: one that is found, and one that is not.
        ends.add_specular(&found(0), DVec3::new(0.0, -1.0, 0.25));
        ends.add_specular(&found(OUTSIDE), DVec3::NEG_Y);
        let (specular, specular_errors_m) = (2, vec![0.25]);
        let of_all = Ends { errors_m, lost: 1, off_frustum: 2, false_hits: 1, ..Ends::default() };
        assert_eq!(ends, Ends { occluded, passed, specular, specular_errors_m, ..of_all });
    }
}
