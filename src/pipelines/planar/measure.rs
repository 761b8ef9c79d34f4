//! Figures read back from a frame: where photons end against exact refraction and ray casting, and the illumination map against the same
//! photons counted in f64.

use std::collections::BTreeMap;

use glam::DVec3;

use super::{Params, Planar, with_pool};
use crate::{Errors, Judging, PipelineInstance, exact_answers, judged_view, share, to_map};
use fathom_gpu::{Gpu, GpuError, read_buffer, read_texture};
use fathom_reference::photons::{land, place_in_grid};
use fathom_reference::pool::{Basin, Face, FluxCounts, face_by_face, flux_share, middle_photon_w};
use fathom_reference::quantities::quantile;
use fathom_reference::rays::Tracer;
use fathom_scene::Scene;
use fathom_stages::planar::points;
use fathom_stages::screen_ray::{NEVER, Transfer};
use fathom_stages::transfer;
use fathom_stages::uniforms::View;

/// At most about this many photons are compared with the reference: enough for a 99th percentile.
const MAX_PHOTONS: usize = 10_000;
/// Rounding of a photon's place on a face in 32-bit floats, as a share of the pool's diagonal: some ten of their steps.
const ROUNDING: f64 = 1.5e-6;

/// Distance of a photon's end from the exact one, metres, and whether it lies on another face; none of a photon that is lost. `found` is where
/// it ends and on what; `exact` the exact end, and the normal there.
fn off(found: Option<(DVec3, Face)>, (exact, normal): (DVec3, DVec3)) -> Option<(f64, bool)> {
    found.map(|(place, face)| (place.distance(exact), face.normal().dot(normal) < 0.5))
}

impl PipelineInstance for Planar {
    fn image(&self) -> &wgpu::Texture {
        &self.image
    }

    /// Shares of the photons that never enter the water, and that meet no face; the share of the floor's texels that none has reached in the
    /// midst of others.
    fn quantities(&self, gpu: &Gpu) -> Result<BTreeMap<String, f64>, GpuError> {
        let read = self.read(gpu)?;
        let PoolPhotons { photons, map, .. } = &read;
        let missed = photons.iter().filter(|photon| photon.state == NEVER).count();
        let ended = photons.iter().filter(|photon| read.end(photon).is_some()).count();
        let floor = &map[..map.len() / Face::ALL.len()];
        Ok(to_map([
            ("missed_water_rate", share(missed, photons.len())),
            ("photon_no_hit_rate", share(photons.len() - missed - ended, photons.len())),
            ("map_floor_hole_rate", share(holes(floor), floor.len())),
        ]))
    }

    fn judge(&self, gpu: &Gpu) -> Result<Judging, GpuError> {
        let read = self.read(gpu)?;
        Ok(Box::new(move |judge| {
            let scene = &with_pool(judge.scene).map_err(GpuError::Unusable)?;
            let mut judged = read.landing_errors(scene);
            judged.errors.extend(read.map_errors(scene).errors);
            Ok(judged)
        }))
    }
}

impl Planar {
    fn read(&self, gpu: &Gpu) -> Result<PoolPhotons, GpuError> {
        let (params, view, basin) = (self.params.clone(), self.view.clone(), self.basin);
        let photons = bytemuck::pod_collect_to_vec(&read_buffer(gpu, &self.transfers.buffer)?);
        let atlas = read_texture(gpu, &self.map)?;
        let texels: Vec<f64> = atlas.data.into_iter().map(f64::from).collect();
        let map = face_by_face(&texels, params.planar.texels);
        Ok(PoolPhotons { params, view, basin, photons, map })
    }
}

/// What a frame has left of its photons.
struct PoolPhotons {
    params: Params,
    view: View,
    basin: Basin,
    photons: Vec<Transfer>,
    /// The map face by face, W/m².
    map: Vec<f64>,
}

impl PoolPhotons {
    /// Where a photon of the transfer map meets the pool.
    fn end(&self, photon: &Transfer) -> Option<(DVec3, Face)> {
        let (origin, direction) = (photon.position_m.as_dvec3(), photon.direction.as_dvec3());
        let met = self.basin.meet(origin, direction.normalize_or_zero());
        met.filter(|_| photon.state != NEVER).map(|met| (met.position, met.face))
    }

    /// Errors of the transfer map's photons on the pool's planes against exact refraction and ray casting: `photon_error_median_m`,
    /// `photon_error_p99_m`, `photon_wrong_face_rate` of those that end by both, and `photon_miss_rate` of those that end exactly. Of
    /// large grids an even selection is compared.
    fn landing_errors(&self, scene: &Scene) -> Errors {
        let ends = self.ends(scene);
        let found = ends.iter().flatten();
        let wrong_face = found.clone().filter(|(_, is_on_other)| *is_on_other).count();
        let mut errors_m: Vec<f64> = found.map(|(error_m, _)| *error_m).collect();
        let errors = [
            ("photon_miss_rate", share(ends.len() - errors_m.len(), ends.len()), "1"),
            ("photon_wrong_face_rate", share(wrong_face, errors_m.len()), "1"),
            ("photon_error_median_m", quantile(&mut errors_m, 0.5), "m"),
            ("photon_error_p99_m", quantile(&mut errors_m, 0.99), "m"),
        ];
        Errors::new(transfer::map::INFO.name, errors, [])
    }

    fn ends(&self, scene: &Scene) -> Vec<Option<(f64, bool)>> {
        let found = &self.photons;
        let (tracer, view) = (Tracer::new(&scene.objects), judged_view(&self.view, scene));
        let (frame, water) = (view.light_frame(), &view.water);
        let grid = self.params.transfer.grid;
        let offset = self.params.transfer.offset;
        let exact = exact_answers(found.len(), MAX_PHOTONS, |index| {
            let place = place_in_grid(index as u32, grid, offset);
            let hit = land(&frame, water, &tracer, place).landed()?.hit;
            Some((hit.position, hit.normal))
        });
        exact.into_iter().map(|(index, exact)| off(self.end(&found[index]), exact)).collect()
    }

    /// Errors of the illumination map against the transfer map's photons counted in f64: `map_energy_error`, the difference of the flux over
    /// all texels, and `map_misplaced_rate`, flux that lies in other texels. Both are shares of the flux of all photons.
    fn map_errors(&self, scene: &Scene) -> Errors {
        let (texels, map) = (self.params.planar.texels, &self.map);
        let counted = self.count_flux(scene);
        let (mut flux_w, mut misplaced_w) = (0.0, 0.0);
        for (texel, irradiance) in map.iter().enumerate() {
            let face = Face::ALL[texel * Face::ALL.len() / map.len()];
            let area_m2 = self.basin.texel_area_m2(face, texels);
            flux_w += irradiance * area_m2;
            // What is missing in one texel lies in another.
            misplaced_w += 0.5 * counted.deviation(texel, *irradiance) * area_m2;
        }
        let of_all = |watts: f64| watts / counted.flux_w;
        let errors = [
            ("map_energy_error", of_all((flux_w - counted.flux_w).abs()), "1"),
            ("map_misplaced_rate", of_all(misplaced_w), "1"),
        ];
        Errors::new(points::INFO.name, errors, [])
    }

    fn count_flux(&self, scene: &Scene) -> FluxCounts {
        let view = judged_view(&self.view, scene);
        let (frame, water, basin) =
            (view.light_frame(), &view.water, Basin::from_water(&view.water, scene.floor_depth_m));
        let photon_w = middle_photon_w(&view.light, &frame, self.params.transfer.photons());
        let texels = self.params.planar.texels;
        let mut counted = FluxCounts::new(texels);
        let [x, z] = basin.half_size_m;
        let rounding_m = 2.0 * ROUNDING * x.hypot(z).hypot(0.5 * basin.floor_depth_m);
        for photon in self.photons.iter().filter(|photon| photon.state != NEVER) {
            let (origin, direction) = (photon.position_m.as_dvec3(), photon.direction.as_dvec3());
            let flux_w = |way_m: f64| {
                photon_w * flux_share(&frame, water, origin, f64::from(photon.path_m) + way_m)
            };
            let ray = (origin, direction.normalize());
            counted.add((&basin, texels), ray, rounding_m, flux_w);
        }
        counted
    }
}

/// Dark texels of a face that have lit ones on both sides in their row and in their column: no photon has reached them, yet they lie in no
/// shadow of a wall.
fn holes(face: &[f64]) -> usize {
    let side = face.len().isqrt();
    let lit = |column: usize, row: usize| face[row * side + column] > 0.0;
    let is_hole = |texel: &usize| {
        let (column, row) = (texel % side, texel / side);
        !lit(column, row)
            && (0..column).any(|k| lit(k, row))
            && (column..side).any(|k| lit(k, row))
            && (0..row).any(|k| lit(column, k))
            && (row..side).any(|k| lit(column, k))
    };
    (0..face.len()).filter(is_hole).count()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn holes_lie_in_the_midst_of_light() {
        let rows = ["#####", "#.#..", "#####", "#..##", "....."];
        let face: Vec<f64> = rows
            .iter()
            .flat_map(|row| row.chars().map(|c| f64::from(u8::from(c == '#'))))
            .collect();
        // Those of the second row to the right and of the last row are open on a side.
        assert_eq!(holes(&face), 1);
        assert_eq!(holes(&[0.0; 9]), 0);
    }

    #[test]
    fn ends_on_other_faces_and_lost_photons_are_told_apart() {
        let exact = (DVec3::ZERO, DVec3::Y);
        let found = [Some((DVec3::X * 0.5, Face::Floor)), Some((DVec3::X, Face::West)), None];
        let ends = found.map(|found| off(found, exact));
        assert_eq!(ends, [Some((0.5, false)), Some((1.0, true)), None]);
    }
}
