//! Figures read back from a frame: where photons end, and how far that is from exact refraction and ray casting.

use std::collections::BTreeMap;

use glam::DVec3;

use super::{Params, PhotonTracing, under_water};
use crate::caustics_image::{FrameCaustics, channel};
use crate::off_frustum::Frustum;
use crate::{Errors, Judge, Judging, PipelineInstance, Rates};
use crate::{exact_answers, judged_view, objects_of, share, to_map};
use fathom_gpu::{Gpu, GpuError, read_texture, read_volume};
use fathom_reference::photons::{land, place_in_grid};
use fathom_reference::quantities::quantile;
use fathom_reference::rays::{Hit, PixelRays, Tracer};
use fathom_reference::specular::{PathEnd, Surfaces};
use fathom_scene::Optics;
use fathom_stages::geometry::Objects;
use fathom_stages::photon::{Fate, Photon};
use fathom_stages::sprites;
use fathom_stages::uniforms::View;

/// At most about this many photons are compared with the reference: enough for a 99th percentile.
const MAX_PHOTONS: usize = 10_000;
/// A photon that ends farther than this from its exact end lies on another surface, metres in scene tank: ten times the tolerance of SPT §5.
const WRONG_M: f64 = 0.1;
/// Rates of every frame that are no errors.
const QUANTITIES: [&str; 8] = [
    "photon_off_frustum_rate",
    "photon_false_hit_rate",
    "caustics_photon_leak_rate",
    "caustics_photon_kept_out_rate",
    "photon_occluded_rate",
    "photon_passed_rate",
    "photon_specular_rate",
    "photon_specular_miss_rate",
];

#[derive(Default)]
struct ExactEnd {
    position: DVec3,
    in_view: bool,
    /// Its way through the water, without that in glass.
    path_m: f64,
    /// Whether it would meet another object if the one that it ends on were not there.
    occluder: bool,
    /// Whether it would come into view, likewise.
    kept_out: bool,
    /// Whether it has come by a mirror or glass.
    specular: bool,
    /// The surfaces along its ray that are in view, the one that it ends on and those behind.
    along: Vec<DVec3>,
}

/// Photons held against their exact ends.
#[derive(Clone, Debug, Default, PartialEq)]
struct Tally {
    /// Of photons that end in view, by both: distance from the exact end, metres.
    errors_m: Vec<f64>,
    /// The same of those that come by a mirror or glass.
    specular_errors_m: Vec<f64>,
    /// The same of their ways under water.
    path_errors_m: Vec<f64>,
    /// Of all photons that end in view: distance from the exact end on the screen, over the picture's height. 1 for a lost one.
    screen_errors: Vec<f64>,
    rates: Rates,
}

impl Tally {
    /// `found` is all that a photon lights: its end, or the first intersections of its ray.
    fn add(&mut self, found: &[Photon], exact: &ExactEnd, wrong_m: f64) {
        let ExactEnd { in_view, position, .. } = *exact;
        let landed = found[0].has_landed();
        self.rates.count("photon_off_frustum_rate", [!in_view]);
        self.rates.count("photon_false_hit_rate", [landed && !in_view]);
        self.rates.count("caustics_photon_miss_rate", [!landed || !in_view]);
        self.rates.count("caustics_photon_kept_out_rate", [exact.kept_out]);
        if !in_view {
            return;
        }
        self.rates.count("photon_miss_rate", [!landed]);
        self.rates.count("photon_occluded_rate", [exact.occluder]);
        self.rates.count("photon_specular_rate", [exact.specular]);
        if exact.occluder {
            let distance_m = |end: DVec3| end.distance(found[0].entry());
            let behind = |hit: &Photon| distance_m(hit.hit()) > distance_m(position) + wrong_m;
            self.rates.count(
                "photon_passed_rate",
                [found.iter().any(|hit| hit.has_landed() && behind(hit))],
            );
        }
        if exact.specular {
            self.rates.count("photon_specular_miss_rate", [!landed]);
        }
        if landed {
            let error_m = found[0].hit().distance(position);
            self.rates.count("photon_wrong_surface_rate", [error_m > wrong_m]);
            self.errors_m.push(error_m);
            if exact.specular {
                self.specular_errors_m.push(error_m);
                self.path_errors_m.push((f64::from(found[0].distance_m) - exact.path_m).abs());
            }
        }
    }

    /// Of a photon that lights all intersections of its ray.
    fn add_along(&mut self, found: &[Photon], along: &[DVec3], wrong_m: f64) {
        let lit: Vec<_> =
            found.iter().filter(|hit| hit.has_landed()).map(|hit| hit.hit()).collect();
        let is_far =
            |from: &[DVec3], place: DVec3| from.iter().all(|p| p.distance(place) > wrong_m);
        self.rates.count("photons_full_rate", [lit.len() == found.len()]);
        self.rates.count("intersections_lost_rate", along.iter().map(|place| is_far(&lit, *place)));
        self.rates.count("intersections_false_rate", lit.iter().map(|place| is_far(along, *place)));
    }
}

impl PipelineInstance for PhotonTracing {
    fn image(&self) -> &wgpu::Texture {
        &self.image
    }

    /// Shares of the photons that never enter the water, whose rays meet no layer, and that are still between mirrors and glass. Of the layers
    /// what SPT §2.2 counts in a pass of its own: the most surfaces behind a pixel, and the share of all that lie behind the eighth.
    fn quantities(&self, gpu: &Gpu) -> Result<BTreeMap<String, f64>, GpuError> {
        let stored = self.photons.read(gpu)?;
        let photons: Vec<_> = stored.chunks(self.photons.per_ray as usize).collect();
        let rate = |fate: Fate| {
            let alike = photons.iter().filter(|p| p[0].fate() == fate);
            share(alike.count(), photons.len())
        };
        let depths = read_volume(gpu, &self.layers.depths, 0)?.data;
        let layers = depths.chunks_exact(self.view.size_px.element_product() as usize);
        let shown = |layer: &[f32]| layer.iter().filter(|z| **z < 1.0).count();
        let fragments: Vec<usize> = layers.map(shown).collect();
        let deepest = fragments.iter().filter(|count| **count > 0).count();
        let behind_8 = fragments.iter().skip(8).sum();
        Ok(to_map([
            ("depth_complexity", deepest as f64),
            ("fragments_behind_8_rate", share(behind_8, fragments.iter().sum())),
            ("missed_water_rate", rate(Fate::MissedWater)),
            ("photon_no_hit_rate", rate(Fate::LeftLight)),
            ("photon_on_its_way_rate", rate(Fate::StillBouncing)),
        ]))
    }

    /// Errors of the last frame's photons. `src/experiments/words.rs` says what each rate counts; `caustics_photon_error_median_m` and
    /// `caustics_photon_miss_rate` are the errors of the pipeline `underwater` by the same names. Of large grids an even selection is compared.
    fn judge(&self, gpu: &Gpu) -> Result<Judging, GpuError> {
        let (photons, per_ray) = (self.photons.read(gpu)?, self.photons.per_ray as usize);
        let (view, params) = (self.view.clone(), self.params.clone());
        let traced = TracedPhotons { view, params, per_ray, photons };
        Ok(Box::new(move |judge| Ok(traced.errors(judge))))
    }

    fn caustics(&self, gpu: &Gpu) -> Result<Option<FrameCaustics>, GpuError> {
        // What the sprites have added up.
        let irradiance = channel(&read_texture(gpu, &self.irradiance)?, 0);
        let (irradiance, view) = (Box::new(|_: &Judge<'_>| Ok(irradiance)), self.view.clone());
        Ok(Some(FrameCaustics { irradiance, stage: sprites::draw::INFO.name, view }))
    }
}

/// What a frame has left of its photons.
struct TracedPhotons {
    view: View,
    params: Params,
    per_ray: usize,
    photons: Vec<Photon>,
}

impl TracedPhotons {
    fn errors(&self, judge: &Judge<'_>) -> Errors {
        let mut ends = self.ends(judge);
        let median_m = quantile(&mut ends.errors_m, 0.5);
        let of_all = ["photon_miss_rate", "photon_wrong_surface_rate", "caustics_photon_miss_rate"];
        let errors = of_all.map(|rate| (rate, ends.rates.rate(rate), "1"));
        let distances = [
            ("photon_error_median_m", median_m, "m"),
            ("photon_error_p99_m", quantile(&mut ends.errors_m, 0.99), "m"),
            ("caustics_photon_error_median_m", median_m, "m"),
        ];
        let along = ["photons_full_rate", "intersections_lost_rate", "intersections_false_rate"];
        let along = along.into_iter().filter(|_| self.per_ray > 1);
        let rates = QUANTITIES.into_iter().chain(along).map(|rate| (rate, ends.rates.rate(rate)));
        let stage = self.params.rays.method.info().name;
        let screen_error = quantile(&mut ends.screen_errors, 0.5);
        let mut judged = Errors::new(stage, errors.into_iter().chain(distances), rates);
        judged.quantities.insert("photon_screen_error_share".to_owned(), screen_error);
        if !ends.specular_errors_m.is_empty() {
            judged.quantities.extend(to_map([
                ("photon_specular_error_median_m", quantile(&mut ends.specular_errors_m, 0.5)),
                ("photon_specular_path_error_median_m", quantile(&mut ends.path_errors_m, 0.5)),
            ]));
        }
        judged
    }

    fn ends(&self, judge: &Judge<'_>) -> Tally {
        let scene = judge.scene;
        let view = judged_view(&self.view, scene);
        let (frame, water) = (view.light_frame(), &view.water);
        let bounces = self.params.path_segments() - 1;
        let times = scene.solid_bounds().tank_scale();
        let frustum = Frustum::new(&view, times);
        let in_view = |hit: &&Hit| frustum.holds(hit.position);
        let transfer = &self.params.transfer;
        let found: Vec<_> = self.photons.chunks(self.per_ray).collect();
        let asked = (&frame, water, &view.camera, view.size_px, transfer, bounces);
        let content = judge.question("photon ends", &asked);
        let exact = judge.references.answer(content, || {
            let objects = objects_of(scene, Objects::Solid);
            let (tracer, top_m) = (&Tracer::new(&objects), under_water(scene).max.y);
            let surfaces =
                Surfaces { tracer, objects: &objects, outside: water.refractive_index, top_m };
            exact_answers(found.len(), MAX_PHOTONS, |index| {
                let place = place_in_grid(index as u32, transfer.grid, transfer.offset);
                let landing = land(&frame, water, tracer, place);
                let landed = landing.landed()?;
                let ray = surfaces.ray(landed.entry.position, landed.direction);
                let PathEnd::Diffuse(hit, path_m) = surfaces.trace(ray, bounces) else {
                    return None;
                };
                let behind = frustum.hits_behind(tracer, hit, landed.direction);
                let behind = behind.take_while(|_| bounces == 0);
                let along: Vec<Hit> = std::iter::once(hit).chain(behind).collect();
                let places = along.iter().filter(in_view).map(|hit| hit.position);
                Some(ExactEnd {
                    position: hit.position,
                    path_m,
                    in_view: in_view(&&hit),
                    occluder: along.iter().any(|next| next.object != hit.object),
                    kept_out: !in_view(&&hit) && along.iter().any(|next| in_view(&next)),
                    specular: bounces > 0
                        && objects[landed.hit.object].material.optics != Optics::Diffuse,
                    along: places.collect(),
                })
            })
        });
        let screen = PixelRays::new(&view.camera, view.size_px.x, view.size_px.y);
        let mut ends = Tally::default();
        for (index, exact) in exact.iter() {
            let (hits, wrong_m) = (found[*index], WRONG_M * times);
            ends.add(hits, exact, wrong_m);
            ends.add_along(hits, &exact.along, wrong_m);
            if exact.in_view {
                let ends_at = hits.first().filter(|hit| hit.has_landed());
                let places = ends_at.and_then(|hit| {
                    Some([screen.project(hit.hit())?, screen.project(exact.position)?])
                });
                ends.screen_errors.push(places.map_or(1.0, |[a, b]| {
                    (a.x_px - b.x_px).hypot(a.y_px - b.y_px) / f64::from(view.size_px.y)
                }));
            }
            if exact.kept_out {
                let leaks = |hit| frustum.is_leak(hit, exact.position);
                ends.rates.count("caustics_photon_leak_rate", [hits.iter().any(leaks)]);
            }
        }
        ends
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use fathom_stages::photon::OUTSIDE;

    #[test]
    fn photons_out_of_view_are_told_apart_from_errors() {
        let found =
            |fate: u32| Photon { entry_m: Vec3::ZERO, fate, hit_m: Vec3::NEG_Y, distance_m: 1.0 };
        let (hit, lost) = (found(0), found(OUTSIDE));
        let mut ends = Tally::default();
        let exact =
            |y, in_view| ExactEnd { position: DVec3::Y * y, in_view, ..ExactEnd::default() };
        ends.add(&[hit], &exact(-1.5, true), WRONG_M);
        ends.add(&[lost], &exact(-1.0, true), WRONG_M);
        ends.add(&[lost], &exact(-1.0, false), WRONG_M);
        ends.add(&[hit], &exact(-1.0, false), WRONG_M);
        // Before another object: one that stops there, and one that goes through.
        for y in [-1.0, -0.5] {
            ends.add(&[hit], &ExactEnd { occluder: true, ..exact(y, true) }, WRONG_M);
        }
        // Behind a mirror: one that is found, and one that is not.
        for found in [hit, lost] {
            ends.add(&[found], &ExactEnd { specular: true, ..exact(-0.75, true) }, WRONG_M);
        }
        // Of two surfaces along a ray one is found, and nothing else.
        ends.add_along(&[hit, lost], &[DVec3::NEG_Y, DVec3::NEG_Y * 2.0], WRONG_M);
        assert_eq!((ends.errors_m.len(), ends.specular_errors_m.as_slice()), (4, &[0.25][..]));
        let counts = [
            ("caustics_photon_kept_out_rate", [0, 8]),
            ("caustics_photon_miss_rate", [4, 8]),
            ("intersections_false_rate", [0, 1]),
            ("intersections_lost_rate", [1, 2]),
            ("photon_false_hit_rate", [1, 8]),
            ("photon_miss_rate", [2, 6]),
            ("photon_occluded_rate", [2, 6]),
            ("photon_off_frustum_rate", [2, 8]),
            ("photon_passed_rate", [1, 2]),
            ("photon_specular_miss_rate", [1, 2]),
            ("photon_specular_rate", [2, 6]),
            ("photon_wrong_surface_rate", [3, 4]),
            ("photons_full_rate", [0, 1]),
        ];
        assert_eq!(ends.rates.0, BTreeMap::from(counts));
    }
}
