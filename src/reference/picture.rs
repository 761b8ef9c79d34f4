//! Light that does not come by photons, as pictures show it: sky, light above the water, and the water's own colour. UW §3.5 composes a picture from these
//! and prints no formula for them. What is tuned for its looks has the values of `shaders/shared/shading.wgsl`, stated here once more.

use std::f64::consts::PI;

use glam::DVec3;

use super::optics::transmittance;
use fathom_scene::{Camera, Light, LightKind, Water};

/// Irradiance from the sky over that from the light.
pub const SKY_SHARE: f64 = 0.15;
/// Colours relative to that of the light: of the photons' light, of shafts, of deep water.
pub const WATER_TINT: DVec3 = DVec3::new(0.75, 0.95, 1.0);
pub const SHAFT_TINT: DVec3 = DVec3::new(0.5, 0.85, 1.0);
const WATER_COLOR: DVec3 = DVec3::new(0.004, 0.05, 0.075);
/// The sky at the horizon and straight up.
const SKY: [DVec3; 2] = [DVec3::new(0.45, 0.60, 0.80), DVec3::new(0.14, 0.30, 0.70)];

#[derive(Clone, Debug)]
pub struct PictureLight {
    pub camera_m: DVec3,
    pub z_far_m: f64,
    /// Unit, from the middle of the view to the light.
    pub sun: DVec3,
    /// Where a point light stands.
    pub lamp_m: Option<DVec3>,
    /// At normal incidence in the middle of the view, W/m².
    pub irradiance: f64,
    pub attenuation_per_m: f64,
}

impl PictureLight {
    pub fn new(camera: &Camera, light: &Light, water: &Water) -> Self {
        let lamp_m = (light.kind == LightKind::Point).then(|| DVec3::from(light.position_m));
        let to_lamp_m = lamp_m.map(|lamp| lamp - camera.middle());
        let spread_m2 = to_lamp_m.map_or(1.0, |way| way.length_squared());
        Self {
            camera_m: camera.position(),
            z_far_m: camera.z_far_m,
            sun: to_lamp_m.unwrap_or(-DVec3::from(light.direction)).normalize(),
            lamp_m,
            irradiance: light.intensity_w_sr / spread_m2,
            attenuation_per_m: water.attenuation_per_m,
        }
    }

    pub fn is_under_water(&self) -> bool {
        self.camera_m.y < 0.0
    }

    pub fn to_light(&self, place: DVec3) -> DVec3 {
        self.lamp_m.map_or(self.sun, |lamp| (lamp - place).normalize())
    }

    /// How far the light is from a place.
    pub fn distance_m(&self, place: DVec3) -> f64 {
        self.lamp_m.map_or(f64::INFINITY, |lamp| lamp.distance(place))
    }

    /// Radiance of a white surface at normal incidence, W/(m² sr): Lambert's law.
    fn white(&self) -> f64 {
        self.irradiance / PI
    }

    pub fn sky(&self, direction: DVec3) -> DVec3 {
        let [horizon, zenith] = SKY;
        let gradient = horizon.lerp(zenith, direction.y.clamp(0.0, 1.0).sqrt());
        let sun = 20.0 * direction.dot(self.sun).max(0.0).powi(600);
        self.white() * (0.5 * gradient + sun)
    }

    /// Irradiance from the sky without water: more of it from above.
    pub fn dry_ambient(&self, normal: DVec3) -> f64 {
        SKY_SHARE * self.irradiance * (0.6 + 0.4 * normal.y)
    }

    /// Irradiance from the sky, through the water straight above.
    pub fn ambient(&self, place: DVec3, normal: DVec3) -> f64 {
        let above_m = if place.y < 0.0 { -place.y } else { 0.0 };
        self.dry_ambient(normal) * transmittance(self.attenuation_per_m, above_m)
    }

    /// Irradiance straight from the light, above the water: below it comes by photons.
    pub fn direct(&self, place: DVec3, normal: DVec3) -> f64 {
        let cosine = if place.y < 0.0 { 0.0 } else { normal.dot(self.to_light(place)) };
        self.irradiance * cosine.max(0.0)
    }

    /// How much of the straight way from the camera to a place is below y = 0.
    pub fn wet_m(&self, place: DVec3) -> f64 {
        let (from, to) = (self.camera_m.y, place.y);
        let share = match (from <= 0.0, to <= 0.0) {
            (true, true) => 1.0,
            (false, false) => 0.0,
            (true, false) => from / (from - to),
            (false, true) => 1.0 - from / (from - to),
        };
        share * self.camera_m.distance(place)
    }

    /// Radiance through so much water: Beer's law, and the water's own colour for what is lost.
    pub fn fogged(&self, radiance: DVec3, path_m: f64) -> DVec3 {
        let deep = WATER_COLOR * self.white();
        deep + (radiance - deep) * transmittance(self.attenuation_per_m, path_m)
    }

    /// Water up to the far plane.
    pub fn deep_water(&self) -> DVec3 {
        self.fogged(DVec3::ZERO, self.z_far_m)
    }

    /// What is seen where there is nothing.
    pub fn background(&self, direction: DVec3) -> DVec3 {
        if self.is_under_water() { self.deep_water() } else { self.sky(direction) }
    }
}
