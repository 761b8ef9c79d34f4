//! `compose`: each pixel of the picture against an f64 evaluation of its light, from known buffers and exact rays to the water's surface.

use crate::prelude::*;
use fathom_reference::image::pixel_behind;
use fathom_reference::picture::{SHAFT_TINT, WATER_TINT};
use fathom_scene::{WaterModel, surface};
use fathom_stages::compose::{self, ComposeInputs, PictureUniforms};
use fathom_stages::picture::Picture;

const SIZE: [u32; 2] = [96, 64];
/// Buffers of caustics and godrays; those of reflection and refraction.
const BUFFER: [u32; 2] = [61, 41];
const MIRROR: [u32; 2] = [40, 26];
/// Scales of the caustics, where they are irradiance, and of the godrays.
const SCALES: [f64; 2] = [2.5, 0.7];
const DEPTH_SHARE: f64 = 0.05;
/// Below this sum of their weights, texels on the surface do not count.
const MIN_WEIGHT: f64 = 1e-3;
/// Cells of the water's grid along a side, few so that its triangles are not the smooth surface.
const CELLS: u32 = 14;
const TAPS: u32 = 12;
const RADIUS_M: f64 = 1.5;
/// Screen shift of reflection and refraction for a unit of slope (tuned for its looks).
const DISTORTION: f64 = 0.08;

/// What becomes of the light of photons.
#[derive(Clone, Copy, Debug, PartialEq)]
enum PhotonLight {
    Scaled,
    Conserving,
    Added,
    /// Added, and the water's waves are circles.
    AddedUnderRings,
    /// There is none, and screen-space occlusion, which is small beside it.
    Dark,
}

/// How high the camera stands, and the light.
type Variant = (f64, LightKind, PhotonLight);

const VARIANTS: [Variant; 7] = [
    (1.5, LightKind::Directional, PhotonLight::Scaled),
    (1.5, LightKind::Point, PhotonLight::Conserving),
    (0.06, LightKind::Directional, PhotonLight::Added),
    (-1.2, LightKind::Directional, PhotonLight::Scaled),
    (-1.2, LightKind::Point, PhotonLight::Conserving),
    (-1.2, LightKind::Directional, PhotonLight::AddedUnderRings),
    (-1.2, LightKind::Directional, PhotonLight::Dark),
];

pub fn cases() -> Vec<Case> {
    let what = |variant: Variant| format!("picture pixel by pixel, {}", described(variant));
    Case::each(compose::INFO.name, VARIANTS, what, composed).collect()
}

fn described((height_m, kind, photons): Variant) -> String {
    let side = if height_m < 0.0 { "below" } else { "above" };
    format!("{} m {side}, {kind:?} light, photons {photons:?}", height_m.abs())
}

fn composed(rig: &Rig<'_>, variant: Variant) -> Result<Check> {
    let (height_m, kind, photons) = variant;
    let mut scene = rig::shore(kind, height_m)?;
    if photons == PhotonLight::AddedUnderRings {
        let water = &mut scene.water;
        (water.model, water.noise, water.amplitude_m) = (WaterModel::Circular, 0.0, 0.08);
        water.waves.clear();
    }
    let fixture = rig.fixture(scene, SIZE)?;
    let known = NoisySurfaces::new(rig, &fixture, |_| DVec3::ZERO)?;
    let exact = Composed::new(rig, &known, photons);
    let shown = exact.draw(rig)?;
    let unlike = |distortion: f64| share_unlike(&shown, |at| exact.allowed(at, distortion));
    Ok(Check::new(rig, format!("{}: share of pixels unlike an f64 picture", described(variant)))
        .within((EDGES, "1"), unlike(DISTORTION))
        .control("2 % more distortion", unlike(1.02 * DISTORTION)))
}

/// What a picture is composed from, and its water's surface in triangles.
struct Composed<'a> {
    known: &'a NoisySurfaces<'a>,
    conserving: bool,
    added: bool,
    taps: u32,
    exposure: f64,
    water: Tracer,
    caustics: Image,
    godrays: Image,
    reflection: Texels,
    refraction: Texels,
}

impl<'a> Composed<'a> {
    fn new(rig: &Rig<'_>, known: &'a NoisySurfaces<'a>, photons: PhotonLight) -> Self {
        // Display values are then neither dark nor white.
        let [exposure, caustics, godrays] = match photons {
            PhotonLight::Dark => [5.0, 0.0, 0.0],
            PhotonLight::Conserving => [0.3, 0.5, 1.0],
            _ => [0.3, 1.0, 1.0],
        };
        let light = |seed, max: f64| noise(BUFFER, seed).map(|value| max * value);
        let water = &known.fixture.scene.water;
        // The diagonals of the stage's quads, from the upper right to the lower left.
        let grid = surface((CELLS as usize, CELLS as usize), (false, false), |u, v| {
            let unit = DVec2::new(1.0 - 2.0 * u, 2.0 * v - 1.0);
            let xz = DVec2::from(water.center_m) + unit * DVec2::from(water.half_size_m);
            DVec3::new(xz.x, water.height(xz.x, xz.y), xz.y)
        });
        Self {
            known,
            conserving: photons == PhotonLight::Conserving,
            added: matches!(photons, PhotonLight::Added | PhotonLight::AddedUnderRings),
            taps: if photons == PhotonLight::Dark { TAPS } else { 0 },
            exposure,
            water: Tracer::new(&[Object::new("water", grid)]),
            caustics: light(21, caustics),
            godrays: light(22, godrays),
            reflection: Texels::noise(rig, MIRROR, 23),
            refraction: Texels::noise(rig, MIRROR, 24),
        }
    }

    fn draw(&self, rig: &Rig<'_>) -> Result<Texels> {
        let fixture = self.known.fixture;
        let inputs = ComposeInputs {
            picture: Picture::new(&self.known.gbuffer, self.exposure, 0.0),
            caustics: &rig.grey(&self.caustics),
            godrays: &rig.grey(&self.godrays),
            reflection: &self.reflection.texture,
            refraction: &self.refraction.texture,
        };
        let side = fixture.view.pixel_tangent(BUFFER);
        let settings = PictureUniforms {
            caustics_scale: if self.conserving { side } else { SCALES[0] } as f32,
            godrays_scale: SCALES[1] as f32,
            occlusion_taps: self.taps,
            occlusion_radius_m: RADIUS_M as f32,
            water_cells: CELLS,
            depth_share: DEPTH_SHARE as f32,
        };
        let (shared, Self { conserving, added, .. }) = (&fixture.shared, self);
        let stage = compose::new(rig, shared, &inputs, &settings, *conserving, *added)?;
        Texels::draw(rig, &stage)
    }

    /// What a pixel may show: at its border either of what meets there.
    fn allowed(&self, at: (u32, u32), distortion: f64) -> Vec<DVec4> {
        let places = SHIFTS_PX.map(|shift| self.surface(rig::middle(at) + DVec2::from(shift), at));
        let wet = places.iter().flatten().map(|place| self.through_surface(at, *place, distortion));
        let is_dry = places.iter().any(Option::is_none);
        let dry = if is_dry { self.beside_water(at) } else { Vec::new() };
        let shafts = self.shafts(rig::middle(at));
        let deep = self.known.light.is_under_water() || self.known.depth.get(at) < 1.0;
        let shafts_beside = if deep { shafts } else { DVec3::ZERO };
        let wet = wet.map(|radiance| radiance + shafts);
        let dry = dry.into_iter().map(|radiance| radiance + shafts_beside);
        wet.chain(dry).map(|radiance| displayed(radiance, self.exposure)).collect()
    }

    /// Where the line of sight through a place of the picture, in pixels, meets the water before what a pixel shows.
    fn surface(&self, px: DVec2, at: (u32, u32)) -> Option<DVec3> {
        let Fixture { rays, scene, .. } = self.known.fixture;
        let (_, sight, _) = rays.ray_at(px.x, px.y);
        let place = self.water.cast(scene.camera.position(), sight, 0.0, f64::MAX)?.position;
        let seen_m = scene.camera.view_depth_m(self.known.depth.get(at));
        (rays.project(place)?.w < seen_m).then_some(place)
    }

    /// Radiances of what is seen without the water's surface before it, with least and most of the sky that is open.
    fn beside_water(&self, at: (u32, u32)) -> Vec<DVec3> {
        let (known, px) = (self.known, rig::middle(at));
        let Some(seen) = known.seen(at) else {
            return vec![known.light.background(known.sight(at))];
        };
        let caustic = self.caustic(px, &seen);
        let radiance = |open: f64| {
            let sky = known.light.ambient(seen.position, seen.normal) * open;
            let light = DVec3::splat(sky + known.light.direct(seen.position, seen.normal));
            if self.added {
                known.through_water(&seen, seen.lit(light)) + caustic / PI
            } else {
                known.through_water(&seen, seen.lit(light + caustic))
            }
        };
        self.openness(at, &seen).map(radiance).into()
    }

    /// Radiance from the water's surface: what it mirrors and what it lets through, as Fresnel's equations share it out.
    fn through_surface(&self, (x, y): (u32, u32), place: DVec3, distortion: f64) -> DVec3 {
        let (known, water) = (self.known, &self.known.fixture.scene.water);
        let light = &known.light;
        let under = light.is_under_water();
        let sight = (place - light.camera_m).normalize();
        let up = water.normal(place.x, place.z);
        let [before, behind] =
            if under { [water.refractive_index, 1.0] } else { [1.0, water.refractive_index] };
        let cosine = (sight.dot(up) * if under { 1.0 } else { -1.0 }).max(1e-3);
        let reflected = fresnel_reflectance(cosine, before, behind);
        let size = UVec2::from(SIZE).as_dvec2();
        let px = rig::middle((x, y)) + distortion * DVec2::new(up.x, up.z) * size;
        let seen = [&self.reflection, &self.refraction].map(|buffer| buffer.bilinear(px / size));

        let mirror = sight - 2.0 * sight.dot(up) * up;
        let sky = light.sky(DVec3::new(mirror.x, mirror.y.abs(), mirror.z));
        let background = if under { light.deep_water() } else { sky };
        let mirrored = over(seen[0], background);
        let through = match refract(sight, up, before, behind) {
            _ if !under => over(seen[1], light.deep_water()) + self.caustics_below(px),
            Some(direction) => over(seen[1], light.sky(direction)),
            None => DVec3::ZERO,
        };
        let radiance = reflected * mirrored + (1.0 - reflected) * through;
        let path_m = if under { place.distance(light.camera_m) } else { 0.0 };
        light.fogged(radiance, path_m)
    }

    /// What caustics add to what is seen through the water from above.
    fn caustics_below(&self, px: DVec2) -> DVec3 {
        let seen = self.known.surface(px, [px.x as i64, px.y as i64]);
        let caustic = self.caustic(px, &seen);
        let light = &self.known.light;
        if self.added {
            return caustic / PI;
        }
        seen.lit(caustic) * transmittance(light.attenuation_per_m, light.wet_m(seen.position))
    }

    /// Irradiance of the photons. UW §3.3's intensities are scaled; flux is over the area that a buffer's pixel covers: that across the line of sight over
    /// the cosine to the normal, of which a tenth counts at least.
    fn caustic(&self, px: DVec2, seen: &SeenSurface) -> DVec3 {
        let flux = self.on_surface(&self.caustics, px);
        if !self.conserving {
            return flux * SCALES[0] * WATER_TINT;
        }
        let away = seen.position - self.known.light.camera_m;
        let cosine = (away.normalize().dot(seen.normal)).abs().max(0.1);
        let across_m2 = self.pixel_sr(px) * away.length_squared();
        flux * cosine / across_m2 * WATER_TINT
    }

    /// Solid angle of a buffer's pixel.
    fn pixel_sr(&self, px: DVec2) -> f64 {
        const H: f64 = 1e-3;
        let sight = |x: f64, y: f64| self.known.fixture.rays.ray_at(px.x + x, px.y + y).1;
        let [across, down] =
            [sight(H, 0.0) - sight(-H, 0.0), sight(0.0, H) - sight(0.0, -H)].map(|d| d / (2.0 * H));
        let pixels = |size: [u32; 2]| f64::from(size[0] * size[1]);
        across.cross(down).length() * pixels(SIZE) / pixels(BUFFER)
    }

    fn shafts(&self, px: DVec2) -> DVec3 {
        self.on_surface(&self.godrays, px) * SCALES[1] * SHAFT_TINT
    }

    /// What a buffer holds on the surface that is seen at a place of the picture, in pixels: between those of the four texels around it that lie on that
    /// surface, or between all where none does.
    fn on_surface(&self, buffer: &Image, px: DVec2) -> f64 {
        let depth = &self.known.depth;
        let view_m =
            |[x, y]: [i64; 2]| self.known.fixture.scene.camera.view_depth_m(depth.clamped(x, y));
        let own_m = view_m([px.x, px.y].map(|k| (k + 1e-3).floor() as i64));
        let (mut all, mut near) = (0.0, DVec2::ZERO);
        for (weight, texel) in corners(px / UVec2::from(SIZE).as_dvec2(), BUFFER) {
            let texel = [0, 1].map(|k| texel[k].clamp(0, i64::from(BUFFER[k]) - 1));
            let there_m = view_m(pixel_behind(texel.map(|k| k as f64), BUFFER, SIZE));
            let value = buffer.clamped(texel[0], texel[1]);
            all += weight * value;
            if (there_m - own_m).abs() <= DEPTH_SHARE * own_m {
                near += weight * DVec2::new(value, 1.0);
            }
        }
        if near.y < MIN_WEIGHT { all } else { near.x / near.y }
    }

    /// Share of the sky that nearby geometry leaves open, at least and at most: taps fall into texels, and rounding sends those at a border to either.
    fn openness(&self, at: (u32, u32), seen: &SeenSurface) -> [f64; 2] {
        let taps = self.taps;
        let Fixture { rays, scene, .. } = self.known.fixture;
        let view_m = rays.project(seen.position).map_or(f64::NAN, |place| place.w);
        let half_height = (0.5 * scene.camera.fov_y_deg.to_radians()).tan();
        let radius_px = 0.5 * f64::from(SIZE[1]) * RADIUS_M / (view_m * half_height);
        // Interleaved gradient noise (Jimenez 2014), and a spiral of golden angles.
        let gradient = 0.067_110_56 * f64::from(at.0) + 0.005_837_15 * f64::from(at.1);
        let angle = TAU * (52.982_918_9 * gradient.fract()).fract();
        let golden = PI * (3.0 - 5f64.sqrt());
        let mut blocked = [0.0; 2];
        for i in (0..taps).map(f64::from) {
            let r_px = radius_px * ((i + 0.5) / f64::from(taps)).sqrt();
            let px = rig::middle(at) + r_px * DVec2::from_angle(i * golden + angle);
            // Rounding of the turn in f32: 5e-4 rad.
            let around =
                SHIFTS_PX.map(|shift| self.blocked(seen, px + 0.016 * r_px * DVec2::from(shift)));
            blocked[0] += around.into_iter().fold(f64::INFINITY, f64::min);
            blocked[1] += around.into_iter().fold(0.0, f64::max);
        }
        blocked.map(|sum| 1.0 - sum / f64::from(taps.max(1)))
    }

    /// What of the sky the surface at a place of the picture takes: the nearer it is and the higher over the tangent plane.
    fn blocked(&self, seen: &SeenSurface, px: DVec2) -> f64 {
        let texel = px.floor();
        let [x, y] = [texel.x as i64, texel.y as i64];
        if !self.known.depth.contains(x, y) {
            return 0.0;
        }
        let away = self.known.surface(texel + 0.5, [x, y]).position - seen.position;
        let (d, floor) = (away.length(), 1e-4 * RADIUS_M);
        let rise = (away.dot(seen.normal) / d.max(floor) - 0.1).clamp(0.0, 1.0);
        (1.0 - d / RADIUS_M).max(0.0) * rise
    }
}

/// A colour with its coverage before another.
fn over(seen: DVec4, behind: DVec3) -> DVec3 {
    behind.lerp(seen.truncate(), seen.w)
}
