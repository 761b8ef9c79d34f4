//! Whole frames of the stages of family `scalar` against VAO §5.2 in f64, pixel by pixel: windows, opacities, colours and lengths of
//! steps are random, cells are no cubes, and near and far plane lie within the field.

use super::*;
use fathom_pipelines::scalar_ao::Gather;
use fathom_reference::isosurface::FieldSurface;
use fathom_reference::media::FieldMarch;

const SIZE: [u32; 2] = [14, 10];
const SPACING_M: DVec3 = DVec3::new(0.1, 0.13, 0.17);
/// Rays of the reference at each point of a medium. Of an isosurface a pixel shows one point, with ten times as many.
const RAYS: u32 = 192;
/// Value that ends rays, share of the window.
const ENDS_AT: f64 = 0.7;
/// Of `shaders/shared/ray_cast.wgsl`: behind the volume, below and above; tuned.
const BACKGROUND: [[f64; 3]; 2] = [[0.25, 0.28, 0.33], [0.70, 0.76, 0.85]];
/// Transmittance below which nothing more shows in 8 bits.
const OPAQUE: f64 = 1.0 / 256.0;

type Change = fn(&mut Scalar);

/// With seeds whose near plane cuts the isosurface.
const FRAMES: [(u32, &str, &str, Change); 7] = [
    (0, "scalar/direct", "opacities, rejection", |s| (s.mode, s.rejection) = (Mode::Direct, true)),
    (100, "scalar/direct", "densities", |s| (s.mode, s.law) = (Mode::Direct, Law::Beer)),
    (200, "scalar/positional", "opacities", |s| s.mode = Mode::Positional),
    (300, "scalar/positional", "densities, rejection", |s| {
        (s.mode, s.law, s.rejection) = (Mode::Positional, Law::Beer, true);
    }),
    (400, "scalar/positional", "strata of two voxels", |s| {
        s.mode = Mode::Positional;
        (s.samples, s.r_max_m) = (3, 6.0 * scalar_field::voxel_m(SPACING_M));
    }),
    (700, "scalar/isosurface", "opacities, rejection", |s| {
        (s.gather, s.rejection) = (Gather::Opacity, true);
    }),
    (800, "scalar/isosurface", "opacities", |s| s.gather = Gather::Opacity),
];

pub fn cases() -> Vec<Case> {
    let frame = |(seed, stage, what, change): (u32, &'static str, &'static str, Change)| {
        let judged = move |rig: &Rig<'_>| check(rig, what, &setup(seed, change));
        Case::new(stage, format!("a frame, {what}"), judged)
    };
    FRAMES.map(frame).into()
}

fn setup(seed: u32, change: Change) -> Setup {
    let mut random = Random::new(seed);
    let mut within = |low, high| random.within(low, high);
    let waves = [(); 4].map(|()| {
        let wave = DVec3::from([(); 3].map(|()| within(-7.0, 7.0)));
        (wave, within(0.0, TAU))
    });
    let value =
        |p: DVec3| 0.45 + 0.15 * waves.iter().map(|(k, at)| (k.dot(p) + at).sin()).sum::<f64>();
    let mut color = || [(); 3].map(|()| within(0.1, 1.0) as f32);
    let [low_color, high_color] = [color(), color()];
    let mut scalar = Scalar {
        window: [within(0.15, 0.3), within(0.65, 0.85)],
        opacity: within(0.3, 0.6),
        density_per_m: within(3.0, 6.0),
        ambient: within(0.2, 0.8),
        view_step_voxels: within(0.6, 1.3),
        iso: 0.6,
        threshold: 0.66,
        r_max_m: 0.55,
        samples: 5,
        rays: 96,
        pyramid: true,
        low_color,
        high_color,
        ..settings(Mode::Isosurface)
    };
    let z_far_m = within(1.2, 3.2);
    change(&mut scalar);
    let voxel_m = scalar_field::voxel_m(SPACING_M);
    if scalar.mode != Mode::Isosurface {
        scalar.threshold = match scalar.law {
            Law::Opacity => ENDS_AT * scalar.opacity,
            Law::Beer => 1.0 - (-ENDS_AT * scalar.density_per_m * voxel_m).exp(),
        };
    }
    let mut camera = looking(DVec3::new(0.7, 0.4, 1.2), DVec3::new(-0.1, -0.1, 0.1));
    (camera.fov_y_deg, camera.z_near_m, camera.z_far_m) = (50.0, 0.45, z_far_m);
    // Some drivers round samples of textures of 8 bits to 8 bits: neighbours are then equal and not falling.
    let volume = unrounded([16, 12, 12], SPACING_M, value);
    Setup { volume, scalar, camera, size_px: SIZE }
}

/// Opacity, distance, visibility and the displayed colour of a pixel.
struct Shown {
    opacity: f64,
    distance_m: f64,
    visibility: f64,
    color: DVec3,
}

struct FrameReference<'a> {
    setup: &'a Setup,
    march: FieldMarch,
    /// What the rays of occlusion read: means of cells as long as a stratum.
    coarse: Volume,
    to_light: DVec3,
}

impl<'a> FrameReference<'a> {
    fn new(setup: &'a Setup) -> Result<Self> {
        let &Scalar { window, r_max_m, samples, rejection, .. } = &setup.scalar;
        let law = media::reference_law(&setup.scalar, &setup.volume);
        let voxel_m = scalar_field::voxel_m(SPACING_M);
        let isosurface = setup.scalar.mode == Mode::Isosurface;
        let ends_at = (setup.scalar.threshold - window[0]) / (window[1] - window[0]);
        let threshold = if isosurface { ends_at } else { ENDS_AT };
        let march = FieldMarch { law, window, r_max_m, samples, rejection, threshold };
        let factor = (r_max_m / f64::from(samples) / voxel_m).round().max(1.0) as u32;
        let coarse = setup.volume.clone().reduced(factor);
        let to_light = -setup.view()?.light_frame().forward;
        Ok(Self { setup, march, coarse, to_light })
    }

    /// What a place of the window sends to the viewer: VAO §5.2.2; of a particle, §5.2.4, the light has no side.
    fn lit(&self, value: f64, normal: DVec3, visibility: f64) -> DVec3 {
        let scalar = &self.setup.scalar;
        let [low, high] =
            [scalar.low_color, scalar.high_color].map(|c| DVec3::from(c.map(f64::from)));
        let facing = normal.dot(self.to_light).max(0.0);
        let light = match scalar.mode {
            Mode::Positional => 1.0,
            _ => facing + (1.0 - facing) * scalar.ambient,
        };
        low.lerp(high, value) * visibility * light
    }

    fn pixel(&self, (x, y): (u32, u32)) -> Shown {
        let Setup { volume, scalar, camera, .. } = self.setup;
        let (near, direction, length_m) = PixelRays::new(camera, SIZE[0], SIZE[1]).ray(x, y);
        let bounds = volume.bounds();
        let (low, high) = ((bounds.min - near) / direction, (bounds.max - near) / direction);
        let from_m = low.min(high).max_element().max(0.0);
        let to_m = low.max(high).min_element().min(length_m).max(from_m);
        let [low_color, high_color] = BACKGROUND.map(DVec3::from);
        let behind = low_color.lerp(high_color, 0.5 + 0.5 * direction.y);
        let surface = FieldSurface { field: volume, iso: scalar.iso };
        let at = |d: f64| near + direction * d;
        // Distances of what is shaded, each with its opacity and its place in the window.
        let shaded: Vec<[f64; 3]> = if scalar.mode == Mode::Isosurface {
            let hit = surface.entry(at(from_m), direction, to_m - from_m);
            hit.map(|d| [from_m + d, 1.0, self.march.value_of(scalar.iso)]).into_iter().collect()
        } else {
            let longest_m = scalar.view_step_voxels * scalar_field::voxel_m(SPACING_M);
            let steps = ((to_m - from_m) / longest_m).ceil();
            let step_m = (to_m - from_m) / steps;
            let middles = (0..steps as u32).map(|k| from_m + (f64::from(k) + 0.5) * step_m);
            let values = middles.map(|d| (d, self.march.value(volume, at(d))));
            values.map(|(d, v)| [d, self.march.law.opacity(v, step_m), v]).collect()
        };
        let (mut through, mut far, mut visible, mut radiance) = (1.0, 0.0, 0.0, DVec3::ZERO);
        for [d, opacity, value] in shaded.into_iter().filter(|[_, opacity, _]| *opacity > 0.0) {
            if through <= OPAQUE {
                break;
            }
            let normal = surface.normal(at(d)).unwrap_or(-direction);
            let visibility = 1.0 - self.occlusion(at(d), normal);
            let weight = through * opacity;
            radiance += weight * self.lit(value, normal, visibility);
            visible += weight * visibility;
            far += weight * at(d).distance(camera.position());
            through -= weight;
        }
        let opacity = 1.0 - through;
        let radiance = (radiance + through * behind).clamp(DVec3::ZERO, DVec3::ONE);
        let color = radiance.powf(1.0 / DISPLAY_GAMMA);
        Shown { opacity, distance_m: far / opacity, visibility: visible / opacity, color }
    }

    fn occlusion(&self, p: DVec3, normal: DVec3) -> f64 {
        match self.setup.scalar.mode {
            Mode::Isosurface => self.march.hemispherical(&self.coarse, p, normal, 10 * RAYS),
            Mode::Direct => self.march.hemispherical(&self.coarse, p, normal, RAYS),
            Mode::Positional => self.march.positional(&self.coarse, p, RAYS),
        }
    }
}

/// A frame against the reference, and against one with the window, the isosurface, the reach of rays and the ambient light changed.
fn check(rig: &Rig<'_>, what: &str, setup: &Setup) -> Checks {
    let found = setup.run(rig)?;
    let mut other = setup.clone();
    (other.scalar.window[1], other.scalar.iso) =
        (setup.scalar.window[1] + 0.03, setup.scalar.iso + 0.03);
    (other.scalar.r_max_m, other.scalar.ambient) =
        (1.2 * setup.scalar.r_max_m, setup.scalar.ambient + 0.1);
    let exact = |setup: &Setup| -> Result<Vec<Shown>> {
        let reference = FrameReference::new(setup)?;
        Ok(pixels(SIZE).map(|at| reference.pixel(at)).collect())
    };
    let (exact, other) = (exact(setup)?, exact(&other)?);
    // Which side of a silhouette a pixel shows is left open, in two pixels for what is covered.
    let isosurface = setup.scalar.mode == Mode::Isosurface;
    let opaque = if isosurface { 2.1 / exact.len() as f64 } else { 1e-3 };
    let check = |name: &str,
                 tolerance,
                 image: &Image,
                 of: fn(&Shown) -> f64,
                 measure: fn(&[f64]) -> f64| {
        let error = |shown: &[Shown]| {
            let apart = |i: usize| (found.distance_m.data()[i] - shown[i].distance_m).abs();
            let same = |i: usize| !isosurface || apart(i) < 0.1;
            let judged = |i: usize| match image.data()[i] - of(&shown[i]) {
                _ if !same(i) && ![OPACITY, DISTANCE].contains(&name) => f64::NAN,
                _ if image.data()[i].is_nan() => f64::INFINITY,
                error => error,
            };
            measure(&(0..shown.len()).map(judged).collect::<Vec<_>>())
        };
        Check::new(rig, format!("{what}: {name}"))
            .within((tolerance, "1"), error(&exact))
            .control("another window, isosurface, r_max and ambient light", error(&other))
    };
    let visibility = |shown: &Shown| shown.visibility;
    let own = "correlation of neighbours' errors of visibility";
    Ok(vec![
        check(OPACITY, opaque, &found.opacity, |s| s.opacity, bias),
        check(DISTANCE, 2e-3, &found.distance_m, |s| s.distance_m, p95),
        check("mean error of visibility", 1.5e-3, &found.visibility, visibility, bias),
        check("p95 of the colour's error", 6e-3, &found.shown, |s| s.color.dot(COLOR_WEIGHTS), p95),
        check(own, 0.4, &found.visibility, visibility, correlation),
    ])
}

const OPACITY: &str = "mean error of opacity";
const DISTANCE: &str = "p95 of the distance's error";

/// Where the reference shows something.
fn known(errors: &[f64]) -> impl Iterator<Item = f64> {
    errors.iter().copied().filter(|error| !error.is_nan())
}

fn bias(errors: &[f64]) -> f64 {
    mean(known(errors)).abs()
}

fn p95(errors: &[f64]) -> f64 {
    percentile::<95>(known(errors).map(f64::abs))
}

/// Pixels draw rays of their own: neither those beside nor those below have the same error.
fn correlation(errors: &[f64]) -> f64 {
    let along = |step: usize| {
        let pairs = errors.iter().zip(&errors[step..]).map(|(a, b)| a * b);
        mean(known(&pairs.collect::<Vec<_>>())) / mean(known(errors).map(|error| error * error))
    };
    along(1).max(along(SIZE[0] as usize))
}
