//! Irradiance of what each pixel shows by many exact photons: a photon map in f64, gathered in the pixels of a camera.
//!
//! A photon that lands at a point brings the flux Φ. Seen at the distance z along the view, under the angles θ to the view and α to the
//! normal, the area dA of the surface takes the part cos α / (z² cos θ) dA of the picture at unit distance. The mean of irradiance over
//! a pixel, whose part there is t², is then the sum of Φ cos α / (z² cos θ t²) over the photons that land where the pixel sees. Pixels at
//! silhouettes have the mean of all surfaces that they show, as those of a picture with many samples.
//!
//! Photons are stratified: one at a random place of each cell of a regular grid over the light's screen. Two grids with other random
//! numbers are kept apart, and their difference is the noise.

use glam::DVec3;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::image::Image;
use super::optics::transmittance;
use super::photons::{Landed, entering_share, land};
use super::rays::{PixelRays, Tracer};
use fathom_scene::{Camera, LightFrame, LightKind, Water, pcg};

/// The camera sees a point where its ray ends so near to it, as a share of the scene.
const SAME_POINT: f64 = 1e-6;
/// Rows of the grid whose photons are kept until they are added in their order, so that sums do not depend on threads.
const ROWS_AT_ONCE: u32 = 128;

/// What is lit and seen.
pub struct Lighting<'a> {
    pub frame: &'a LightFrame,
    /// Of a point light, W/sr.
    pub intensity_w_sr: f64,
    pub water: &'a Water,
    pub tracer: &'a Tracer,
    pub camera: &'a Camera,
    /// Width over height of the picture, whose pixels need not be square.
    pub aspect: f64,
}

/// Irradiance by two independent halves of the photons.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PhotonMap {
    /// W/m².
    halves: [Image; 2],
}

/// A photon in the picture.
struct Deposit {
    pixel: [u32; 2],
    irradiance: f64,
}

impl PhotonMap {
    /// `columns`² photons in each half, for a picture of `size` pixels.
    pub fn new(lighting: &Lighting<'_>, size: [u32; 2], columns: u32) -> PhotonMap {
        PhotonMap { halves: [0, 1].map(|seed| lighting.gather(size, columns, seed)) }
    }

    #[must_use]
    pub fn downsample(&self, side: u32) -> PhotonMap {
        PhotonMap { halves: self.halves.each_ref().map(|half| half.downsample(side)) }
    }

    /// The mean of both halves.
    pub fn irradiance(&self) -> Image {
        let [a, b] = &self.halves;
        Image::from_fn(a.size(), |x, y| {
            let [a, b] = [a, b].map(|half| half.clamped(x.into(), y.into()));
            0.5 * (a + b)
        })
    }

    /// Mean |error| of [`Self::irradiance`] over its mean: half of the halves' difference, whose errors are independent.
    pub fn noise(&self) -> f64 {
        let [a, b] = self.halves.each_ref().map(|half| half.data().iter());
        let apart: f64 = a.zip(b).map(|(a, b)| 0.5 * (a - b).abs()).sum();
        apart / self.irradiance().sum()
    }
}

impl Lighting<'_> {
    /// Irradiance of each pixel by one grid of photons.
    fn gather(&self, size: [u32; 2], columns: u32, seed: u32) -> Image {
        let [width, height] = size;
        let rays = PixelRays::of_matrix(self.camera.view_projection(self.aspect), width, height);
        let mut irradiance = Image::constant(width, height, 0.0);
        for first in (0..columns).step_by(ROWS_AT_ONCE as usize) {
            let rows = first..(first + ROWS_AT_ONCE).min(columns);
            let of_row = |row: u32| -> Vec<Deposit> {
                let photons = (0..columns).filter_map(|column| {
                    let place = stratified([column, row], columns, seed);
                    self.project(&rays, size, place, f64::from(columns).powi(-2))
                });
                photons.collect()
            };
            let seen: Vec<Vec<Deposit>> = rows.into_par_iter().map(of_row).collect();
            for photon in seen.iter().flatten() {
                let [x, y] = photon.pixel.map(i64::from);
                irradiance.add(x, y, photon.irradiance);
            }
        }
        irradiance
    }

    /// What a photon through a place of the light's screen, with this share of its area, brings to the picture.
    fn project(
        &self,
        rays: &PixelRays,
        size: [u32; 2],
        place: [f64; 2],
        share: f64,
    ) -> Option<Deposit> {
        let landing = land(self.frame, self.water, self.tracer, place);
        let landed = landing.landed()?;
        let point = landed.hit.position;
        let at = rays.project(point).filter(|at| (0.0..=1.0).contains(&at.depth))?;
        let inside = |at: f64, side: u32| (0.0..f64::from(side)).contains(&at);
        if !inside(at.x_px, size[0]) || !inside(at.y_px, size[1]) {
            return None;
        }
        let (origin, sight, length_m) = rays.ray_at(at.x_px, at.y_px);
        let hit = self.tracer.cast(origin, sight, 0.0, length_m)?;
        // The side that is lit is not always the side that is seen.
        let same_m = SAME_POINT * self.tracer.size_m;
        if hit.position.distance(point) > same_m || hit.normal.dot(landed.hit.normal) <= 0.0 {
            return None;
        }
        let flux_w = self.flux_w(landed, place) * share;
        let along = sight.dot(self.camera.direction());
        let pixel = self.pixel_area(size) * at.w.powi(2);
        let irradiance = flux_w * hit.normal.dot(sight).abs() / (pixel * along);
        Some(Deposit { pixel: [at.x_px as u32, at.y_px as u32], irradiance })
    }

    /// Flux that the light's whole screen would bring if all of its photons were like this one, W.
    fn flux_w(&self, landed: &Landed, place: [f64; 2]) -> f64 {
        let (_, incident) = self.frame.photon_ray(place);
        // dΩ = cos³θ dA on the plane at unit distance along the axis of a point light.
        let spread = match self.frame.kind {
            LightKind::Directional => 1.0,
            LightKind::Point => self.cosine(incident).powi(3),
        };
        let emitted = self.intensity_w_sr * self.frame.grid_area * spread;
        let passed = entering_share(self.water, landed.entry.normal, incident);
        emitted * passed * transmittance(self.water.attenuation_per_m, landed.hit.distance_m)
    }

    fn cosine(&self, incident: DVec3) -> f64 {
        incident.dot(self.frame.forward)
    }

    /// Area of a pixel at unit distance along the view.
    fn pixel_area(&self, [width, height]: [u32; 2]) -> f64 {
        let side = 2.0 * (self.camera.fov_y_deg.to_radians() / 2.0).tan();
        side * side * self.aspect / (f64::from(width) * f64::from(height))
    }
}

/// A random place in a cell of the grid, in the light's normalised device coordinates.
fn stratified([x, y]: [u32; 2], columns: u32, seed: u32) -> [f64; 2] {
    let first = pcg(pcg(pcg(x).wrapping_add(y)).wrapping_add(seed));
    let second = pcg(first ^ 0x9e37_79b9);
    [(x, first), (y, second)].map(|(cell, bits)| {
        let share = f64::from(bits) / 4_294_967_296.0;
        2.0 * (f64::from(cell) + share) / f64::from(columns) - 1.0
    })
}

#[cfg(test)]
mod tests {
    use super::super::image::pixels;
    use super::super::optics::fresnel_transmittance;
    use super::*;
    use fathom_scene::{Bounds, Light, Mesh, Object};

    const SIZE: [u32; 2] = [12, 9];
    /// Pixels are not square.
    const ASPECT: f64 = 1.0;
    const DEPTH_M: f64 = 3.0;

    struct TestScene {
        light: Light,
        water: Water,
        camera: Camera,
        objects: Vec<Object>,
    }

    /// Flat water over a level floor, seen at a slant by a turned camera. The light's middle is that of the view, on the floor: all that is
    /// seen is lit.
    fn fixture() -> TestScene {
        let floor = Mesh::parallelogram(DVec3::Y * -DEPTH_M, DVec3::Z * 40.0, DVec3::X * 40.0);
        let mut camera = Camera::new([0.5, 3.0, 4.0], [0.2, -DEPTH_M, 0.3], 40.0, [0.1, 14.0]);
        camera.up = [0.2, 1.0, 0.1];
        TestScene {
            light: Light { direction: [0.4, -1.0, 0.25], half_extent_m: 6.0, ..Light::default() },
            water: Water { amplitude_m: 0.0, half_size_m: [40.0; 2], ..Water::default() },
            camera,
            objects: vec![Object::new("floor", floor)],
        }
    }

    impl TestScene {
        fn map(&self, size: [u32; 2], columns: u32) -> PhotonMap {
            let bounds =
                Bounds { min: DVec3::new(-40.0, -3.0, -40.0), max: DVec3::new(40.0, 1.0, 40.0) };
            let tracer = Tracer::new(&self.objects);
            let lighting = Lighting {
                frame: &self.light.frame(&self.camera, ASPECT, &bounds, &self.water, false),
                intensity_w_sr: self.light.intensity_w_sr,
                water: &self.water,
                tracer: &tracer,
                camera: &self.camera,
                aspect: ASPECT,
            };
            PhotonMap::new(&lighting, size, columns)
        }

        /// Irradiance of the floor in closed form: E cos θ of the light before the water, times what is left after the slanted way.
        fn closed_form(&self) -> f64 {
            let cosine = -DVec3::from(self.light.direction).normalize().y;
            let sine = (1.0 - cosine * cosine).sqrt() / self.water.refractive_index;
            let path_m = DEPTH_M / (1.0 - sine * sine).sqrt();
            let passed =
                if self.water.fresnel { fresnel_transmittance(cosine, 1.0, 1.33) } else { 1.0 };
            let left = transmittance(self.water.attenuation_per_m, path_m);
            self.light.intensity_w_sr * cosine * passed * left
        }
    }

    fn furthest(map: &PhotonMap, expected: f64) -> f64 {
        let off = map.irradiance().map(|found| (found / expected - 1.0).abs());
        off.data().iter().copied().fold(0.0, f64::max)
    }

    #[test]
    fn a_level_floor_has_the_closed_form_in_every_pixel() {
        for fresnel in [false, true] {
            let mut setup = fixture();
            setup.water.fresnel = fresnel;
            let map = setup.map(SIZE, 350);
            let off = furthest(&map, setup.closed_form());
            assert!(off < 0.05, "{off}");
            assert!(furthest(&map, 0.92 * setup.closed_form()) > 0.05);
        }
    }

    #[test]
    fn a_point_light_has_the_inverse_square_without_refraction() {
        let mut setup = fixture();
        setup.light.kind = LightKind::Point;
        setup.light.position_m = [1.0, 5.0, -0.5];
        (setup.water.refractive_index, setup.water.attenuation_per_m) = (1.0, 0.0);
        setup.light.half_extent_m = 9.0;
        let irradiance = setup.map(SIZE, 300).irradiance();
        let matrix = setup.camera.view_projection(ASPECT);
        let rays = PixelRays::of_matrix(matrix, SIZE[0], SIZE[1]);
        let light = DVec3::from(setup.light.position_m);
        // Intensity × cos θ / r², and the same without the cosine.
        let furthest = |power: i32| {
            let off = pixels(SIZE).map(|(x, y)| {
                let (origin, direction, _) = rays.ray(x, y);
                let point = origin + direction * ((-DEPTH_M - origin.y) / direction.y);
                let to_light = light - point;
                let cosine = (to_light.y / to_light.length()).powi(power);
                let exact = setup.light.intensity_w_sr * cosine / to_light.length_squared();
                (irradiance.clamped(x.into(), y.into()) / exact - 1.0).abs()
            });
            off.fold(0.0, f64::max)
        };
        assert!(furthest(1) < 0.1, "{}", furthest(1));
        assert!(furthest(0) > 0.1);
    }

    #[test]
    fn halves_tell_the_noise_and_it_falls_with_photons() {
        let mut setup = fixture();
        setup.water = Water { half_size_m: [40.0; 2], ..Water::default() };
        let size = SIZE.map(|side| 2 * side);
        let dense = setup.map(size, 500).irradiance();
        let [few, more] = [40, 160].map(|columns| {
            let map = setup.map(size, columns);
            let pairs = map
                .irradiance()
                .data()
                .iter()
                .zip(dense.data())
                .map(|(a, b)| (a - b).abs())
                .sum::<f64>();
            (map.noise(), pairs / dense.sum())
        });
        assert!(few.1 > 2.0 * more.1, "{few:?} {more:?}");
        for (told, error) in [few, more] {
            assert!((0.7..1.4).contains(&(told / error)), "{told} {error}");
        }
    }

    #[test]
    fn what_is_hidden_or_lit_from_behind_gets_nothing() {
        let mut setup = fixture();
        // Seen from below: the floor's lit side is turned away.
        setup.camera = Camera::new([0.5, -6.0, 1.0], [0.2, -DEPTH_M, 0.3], 40.0, [0.1, 14.0]);
        assert_eq!(setup.map(SIZE, 100).irradiance().sum(), 0.0);
        let mut hidden = self::fixture();
        let eye = hidden.camera.position() + hidden.camera.direction();
        hidden.objects.push(Object::new("lid", Mesh::parallelogram(eye, DVec3::Z, DVec3::X)));
        assert_eq!(hidden.map(SIZE, 100).irradiance().sum(), 0.0);
    }
}
