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

/// How a picture is composed, and from where it is seen.
#[derive(Clone, Copy)]
struct Variant {
    name: &'static str,
    height_m: f64,
    kind: LightKind,
    has_rings: bool,
    added: bool,
    conserving: bool,
    /// Without light of photons and with occlusion, which is small beside it.
    in_dark: bool,
}

const VARIANTS: [Variant; 7] = {
    let name = "from above";
    let kind = LightKind::Directional;
    let (has_rings, added, conserving, in_dark) = (false, false, false, false);
    let above = Variant { name, height_m: 1.5, kind, has_rings, added, conserving, in_dark };
    let below = Variant { name: "from below", height_m: -1.2, ..above };
    let lamp = Variant { kind: LightKind::Point, conserving: true, ..above };
    [
        above,
        Variant { name: "from above by a lamp, conserving", ..lamp },
        Variant { name: "at the surface, added", height_m: 0.06, added: true, ..above },
        below,
        Variant { name: "from below by a lamp, conserving", height_m: -1.2, ..lamp },
        Variant { name: "from below under rings, added", has_rings: true, added: true, ..below },
        Variant { name: "from below in the dark", in_dark: true, ..below },
    ]
};

impl Variant {
    /// Display values are neither dark nor white.
    fn exposure(&self) -> f64 {
        if self.in_dark { 5.0 } else { 0.3 }
    }

    fn taps(&self) -> u32 {
        if self.in_dark { TAPS } else { 0 }
    }
}

pub fn cases() -> Vec<Case> {
    let what = |variant: Variant| format!("picture pixel by pixel, {}", variant.name);
    Case::each(compose::INFO.name, VARIANTS, what, composed).collect()
}

fn composed(rig: &Rig<'_>, variant: Variant) -> Result<Check> {
    let mut scene = rig::shore(variant.kind, variant.height_m)?;
    if variant.has_rings {
        let water = &mut scene.water;
        (water.model, water.noise, water.amplitude_m) = (WaterModel::Circular, 0.0, 0.08);
        water.waves.clear();
    }
    let fixture = rig.fixture(scene, SIZE)?;
    let known = NoisySurfaces::new(rig, &fixture)?;
    let exact = Composed::new(rig, &known, variant);
    let shown = exact.draw(rig)?;
    let unlike = |distortion: f64| share_unlike(&shown, |at| exact.allowed(at, distortion));
    let wet = share(pixels(SIZE).map(|at| exact.surface(rig::middle(at), at).is_some()));
    Ok(Check::new(rig, format!("{}: share of pixels unlike an f64 picture", variant.name))
        .within((EDGES, "1"), unlike(DISTORTION))
        .control("2 % more distortion", unlike(1.02 * DISTORTION))
        .with("share_of_the_water", wet))
}

/// What a picture is composed from, and its water's surface in triangles.
struct Composed<'a> {
    known: &'a NoisySurfaces<'a>,
    variant: Variant,
    water: Tracer,
    caustics: Image,
    godrays: Image,
    reflection: Texels,
    refraction: Texels,
}

impl<'a> Composed<'a> {
    fn new(rig: &Rig<'_>, known: &'a NoisySurfaces<'a>, variant: Variant) -> Self {
        let mirror = |seed| Texels::noise(rig, MIRROR, seed);
        let photons = if variant.in_dark { 0.0 } else { 1.0 };
        let light = |seed, factor: f64| noise(BUFFER, seed).map(|value| photons * factor * value);
        let water = &known.fixture.scene.water;
        // The diagonals of the stage's quads, from the upper right to the lower left.
        let cells = CELLS as usize;
        let grid = surface((cells, cells), (false, false), |u, v| {
            let unit = DVec2::new(1.0 - 2.0 * u, 2.0 * v - 1.0);
            let xz = DVec2::from(water.center_m) + unit * DVec2::from(water.half_size_m);
            DVec3::new(xz.x, water.height(xz.x, xz.y), xz.y)
        });
        Self {
            known,
            variant,
            water: Tracer::new(&[Object::new("water", grid)]),
            caustics: light(21, if variant.conserving { 2e-2 } else { 1.0 }),
            godrays: light(22, 1.0),
            reflection: mirror(23),
            refraction: mirror(24),
        }
    }

    fn draw(&self, rig: &Rig<'_>) -> Result<Texels> {
        let Self { known, variant, .. } = self;
        let fixture = known.fixture;
        let inputs = ComposeInputs {
            picture: Picture::new(&known.gbuffer, variant.exposure(), 0.0),
            caustics: &rig.grey(&self.caustics),
            godrays: &rig.grey(&self.godrays),
            reflection: &self.reflection.texture,
            refraction: &self.refraction.texture,
        };
        let side = fixture.view.pixel_tangent(BUFFER);
        let settings = PictureUniforms {
            caustics_scale: if variant.conserving { side } else { SCALES[0] } as f32,
            godrays_scale: SCALES[1] as f32,
            occlusion_taps: variant.taps(),
            occlusion_radius_m: RADIUS_M as f32,
            water_cells: CELLS,
            depth_share: DEPTH_SHARE as f32,
        };
        let Variant { conserving, added, .. } = *variant;
        let stage = compose::new(rig, &fixture.shared, &inputs, &settings, conserving, added)?;
        rig.run(&[&stage])?;
        Texels::read(rig, stage.texture())
    }

    /// What a pixel may show: at its border either of what meets there.
    fn allowed(&self, at: (u32, u32), distortion: f64) -> Vec<DVec4> {
        let places = SHIFTS_PX.map(|shift| self.surface(rig::middle(at) + shift, at));
        let wet = places.iter().flatten().map(|place| self.through_surface(at, *place, distortion));
        let is_dry = places.iter().any(Option::is_none);
        let dry = if is_dry { self.beside_water(at) } else { Vec::new() };
        let shafts = self.shafts(rig::middle(at));
        let deep = self.known.light.is_under_water() || self.known.depth.get(at) < 1.0;
        let shafts_beside = if deep { shafts } else { DVec3::ZERO };
        let wet = wet.map(|radiance| radiance + shafts);
        let dry = dry.into_iter().map(|radiance| radiance + shafts_beside);
        wet.chain(dry).map(|radiance| displayed(radiance, self.variant.exposure())).collect()
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
            if self.variant.added {
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
        let way_m = if under { place.distance(light.camera_m) } else { 0.0 };
        light.fogged(radiance, way_m)
    }

    /// What caustics add to what is seen through the water from above.
    fn caustics_below(&self, px: DVec2) -> DVec3 {
        let texel = [px.x, px.y].map(|k| k.trunc() as i64);
        let last = SIZE.map(|side| i64::from(side) - 1);
        let seen = self.known.surface(px, [0, 1].map(|k| texel[k].clamp(0, last[k])));
        let caustic = self.caustic(px, &seen);
        let light = &self.known.light;
        if self.variant.added {
            return caustic / PI;
        }
        seen.lit(caustic) * transmittance(light.attenuation_per_m, light.wet_m(seen.position))
    }

    /// Irradiance of the photons. UW §3.3's intensities are scaled; flux is over the area that a buffer's pixel covers: that across the line of sight over
    /// the cosine to the normal, of which a tenth counts at least.
    fn caustic(&self, px: DVec2, seen: &SeenSurface) -> DVec3 {
        let flux = self.on_surface(&self.caustics, px);
        if !self.variant.conserving {
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
        let texels = corners(px / UVec2::from(SIZE).as_dvec2(), BUFFER).map(|(weight, texel)| {
            let texel = [0, 1].map(|k| texel[k].clamp(0, i64::from(BUFFER[k]) - 1));
            let there_m = view_m(pixel_behind(texel.map(|k| k as f64), BUFFER, SIZE));
            let is_on_it = (there_m - own_m).abs() <= DEPTH_SHARE * own_m;
            (weight, buffer.clamped(texel[0], texel[1]), is_on_it)
        });
        let mean = |keeps: fn(bool) -> bool| {
            let kept = texels.iter().filter(|(.., is_on_it)| keeps(*is_on_it));
            kept.fold((0.0, 0.0), |(sum, weights), (weight, value, _)| {
                (sum + weight * value, weights + weight)
            })
        };
        match mean(|is_on_it| is_on_it) {
            (sum, weights) if weights >= MIN_WEIGHT => sum / weights,
            _ => mean(|_| true).0,
        }
    }

    /// Share of the sky that nearby geometry leaves open, at least and at most: taps fall into texels, and rounding sends those at a border to either.
    fn openness(&self, at: (u32, u32), seen: &SeenSurface) -> [f64; 2] {
        let taps = self.variant.taps();
        let Fixture { rays, scene, .. } = self.known.fixture;
        let view_m = rays.project(seen.position).map_or(f64::NAN, |place| place.w);
        let half_height = (0.5 * scene.camera.fov_y_deg.to_radians()).tan();
        let radius_px = 0.5 * f64::from(SIZE[1]) * RADIUS_M / (view_m * half_height);
        // Interleaved gradient noise (Jimenez 2014), and a spiral of golden angles.
        let gradient = 0.067_110_56 * f64::from(at.0) + 0.005_837_15 * f64::from(at.1);
        let turn = TAU * (52.982_918_9 * gradient.fract()).fract();
        let golden = PI * (3.0 - 5f64.sqrt());
        let mut blocked = [0.0; 2];
        for i in (0..taps).map(f64::from) {
            let r_px = radius_px * ((i + 0.5) / f64::from(taps)).sqrt();
            let px = rig::middle(at) + r_px * DVec2::from_angle(i * golden + turn);
            // Rounding of the turn in f32, 5e-4 rad.
            let around =
                SHIFTS_PX.map(|shift| self.blocked(seen, px + 5e-4 * r_px / NEAR_PX * shift));
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
