//! `godrays/lines`: intensity along lines, their width, and the phase function, against closed forms.

use std::f64::consts::TAU;

use glam::{DVec2, DVec3, Vec2};

use super::{Case, Check, Checks, Random, Result, Rig, largest, rig};
use fathom_reference::godray::{Godray, Medium};
use fathom_reference::image::{Image, pixels};
use fathom_reference::rays::PixelRays;
use fathom_stages::frame::{Shared, View};
use fathom_stages::godrays::lines::{self, LinesUniforms};
use fathom_stages::photon::Photon;
use fathom_stages::splatting::PHOTONS_PER_INSTANCE;

const STAGE: &str = "godrays/lines";
const SIZE: [u32; 2] = [384, 384];
const WIDTH_PX: f64 = 6.0;
const GAMMA_PER_M: f64 = 0.13;
const PHASE_K: f64 = 0.6;
const PHOTON_W: f64 = 0.05;
/// Cells per side in which isolated lines lie.
const CELLS: u32 = 4;
/// Pixels this near to a line's edge are not judged: the rasterizer works in 1/256 px.
const EDGE_PX: f64 = 0.6;

pub fn cases() -> Vec<Case> {
    vec![
        Case::new(STAGE, "intensity and width along isolated lines", isolated),
        Case::new(STAGE, "conserved energy of lines", conserved),
        Case::new(STAGE, "integral of the phase function", phase_integral),
    ]
}

/// How lines are drawn.
#[derive(Clone, Copy)]
struct Drawn {
    side_px: u32,
    width_px: f64,
    conserving: bool,
}

/// Draws photons' lines without occlusion.
pub(super) fn draw(rig: &Rig<'_>, view: &View, photons: &[Photon]) -> Result<Image> {
    draw_as(rig, view, photons, Drawn { side_px: SIZE[0], width_px: WIDTH_PX, conserving: false })
}

fn draw_as(rig: &Rig<'_>, view: &View, photons: &[Photon], drawn: Drawn) -> Result<Image> {
    let shared = Shared::new(&rig.resources, view);
    let size = [drawn.side_px; 2];
    let settings = LinesUniforms {
        size_px: Vec2::splat(drawn.side_px as f32),
        width_px: drawn.width_px as f32,
        phase_k: PHASE_K as f32,
        photon_w: PHOTON_W as f32,
        photons_per_instance: PHOTONS_PER_INSTANCE,
        photons: photons.len() as u32,
    };
    let buffer = rig.photons(photons);
    let depth = rig.depth(size, 1.0)?;
    let (inputs, conserving) = ((&buffer, &depth), drawn.conserving);
    let stage = lines::new(&rig.resources, &shared, inputs, &settings, conserving, 10.0)?;
    rig.run(&[&stage])?;
    rig.channel(&stage.texture, 0)
}

/// A photon's line with the numbers that the GPU has.
fn godray(photon: &Photon) -> Godray {
    Godray { entry: photon.entry_m.as_dvec3(), hit: photon.hit_m.as_dvec3(), photon: PHOTON_W }
}

/// Lines at all angles, each in its own cell of the buffer, some of them running away from the viewer.
fn isolated(rig: &Rig<'_>) -> Checks {
    let view = rig::synthetic_view(SIZE, GAMMA_PER_M)?;
    let eye = DVec3::from(view.camera.position_m);
    let rays = PixelRays::new(&view.camera, SIZE[0], SIZE[1]);
    let photons = at_all_angles(&rays, eye);
    let image = draw(rig, &view, &photons)?;
    let medium = Medium { gamma_per_m: GAMMA_PER_M, phase_k: PHASE_K };
    let errors =
        |medium: Medium, width_px: f64| line_errors(&image, &photons, &rays, eye, medium, width_px);
    let exact = errors(medium, WIDTH_PX);
    let murky = errors(Medium { gamma_per_m: GAMMA_PER_M * 1.05, ..medium }, WIDTH_PX);
    let broad = errors(medium, WIDTH_PX + 2.0);
    let round = errors(Medium { phase_k: PHASE_K * 1.05, ..medium }, WIDTH_PX);
    Ok(vec![
        Check::of(STAGE, "isolated lines: largest relative error of intensity")
            .within((1e-3, "1"), exact.intensity)
            .control("attenuation 5 % higher", murky.intensity)
            .with("pixels_compared", exact.pixels as f64)
            .with("control_with_phase_k_5_percent_higher", round.intensity),
        Check::of(STAGE, "isolated lines: share of pixels unlike the rectangle")
            .within((1e-3, "1"), exact.coverage)
            .control("lines 2 px wider", broad.coverage),
    ])
}

/// Lines at all angles, each in its own cell of the buffer, some of them running away from the viewer.
fn at_all_angles(rays: &PixelRays, eye: DVec3) -> Vec<Photon> {
    let mut random = Random::new(5);
    let cell_px = f64::from(SIZE[0] / CELLS);
    let line = |i: u32| {
        let middle = [i % CELLS, i / CELLS].map(|c| (f64::from(c) + 0.5) * cell_px);
        let (sin, cos) = (random.within(0.0, TAU)).sin_cos();
        let end = |sign: f64, distance_m: f64| {
            let reach = sign * 0.3 * cell_px;
            let (_, direction, _) = rays.ray_at(middle[0] + cos * reach, middle[1] + sin * reach);
            eye + direction * distance_m
        };
        let (entry, hit) = (end(-1.0, random.within(1.0, 6.0)), end(1.0, random.within(1.0, 6.0)));
        rig::photon(entry, hit, entry.distance(hit))
    };
    (0..CELLS * CELLS).map(line).collect()
}

/// What all lines bring to a conserving buffer does not depend on their width, and grows with the buffer's side as their
/// length in pixels does: it is the integral of the intensity along them.
fn conserved(rig: &Rig<'_>) -> Result<Check> {
    const STEPS: u32 = 400;
    let view = rig::synthetic_view(SIZE, GAMMA_PER_M)?;
    let eye = DVec3::from(view.camera.position_m);
    let rays = PixelRays::new(&view.camera, SIZE[0], SIZE[1]);
    let photons = at_all_angles(&rays, eye);
    let medium = Medium { gamma_per_m: GAMMA_PER_M, phase_k: PHASE_K };
    let integral = |photon: &Photon| {
        let ray = godray(photon);
        let segment = Segment::new(&ray, &rays)?;
        let length = segment.from.distance(segment.to);
        let step = length / f64::from(STEPS);
        let at = |i: u32| {
            ray.intensity(ray.point(segment.share((f64::from(i) + 0.5) * step)), eye, medium)
        };
        Some((0..STEPS).map(at).sum::<f64>() * step)
    };
    let exact: f64 = photons.iter().filter_map(integral).sum::<f64>() / f64::from(SIZE[0]);
    let worst = |conserving: bool| -> Result<f64> {
        let ways = [(SIZE[0], 1.5), (SIZE[0], 12.0), (SIZE[0] / 2, 3.0), (SIZE[0] * 2, 6.0)];
        let errors = ways.into_iter().map(|(side_px, width_px)| {
            let drawn = Drawn { side_px, width_px, conserving };
            let sum = draw_as(rig, &view, &photons, drawn)?.sum();
            Ok((sum / f64::from(side_px) / exact - 1.0).abs())
        });
        Ok(largest(errors.collect::<Result<Vec<_>>>()?))
    };
    Ok(Check::of(
        STAGE,
        "energy of lines of 1.5 to 12 px in buffers of 192 to 768 px: largest relative error",
    )
    .within((0.02, "1"), worst(true)?)
    .control("the paper's rule", worst(false)?))
}

struct LineErrors {
    /// Largest relative error of intensity over pixels well within a line.
    intensity: f64,
    pixels: usize,
    /// Of the pixels that a rectangle clearly covers or leaves free: those drawn otherwise.
    coverage: f64,
}

/// A line on the screen.
struct Segment {
    from: DVec2,
    to: DVec2,
    /// Distances along the view direction of its ends: clip-space w.
    w: [f64; 2],
}

impl Segment {
    fn new(ray: &Godray, rays: &PixelRays) -> Option<Segment> {
        let (a, b) = (rays.project(ray.entry)?, rays.project(ray.hit)?);
        Some(Segment {
            from: DVec2::new(a.x_px, a.y_px),
            to: DVec2::new(b.x_px, b.y_px),
            w: [a.w, b.w],
        })
    }

    /// Place of a pixel along the line (pixels from its start, and to its end) and beside it.
    fn place(&self, pixel: DVec2) -> (f64, f64, f64) {
        let along = (self.to - self.from).normalize();
        let offset = pixel - self.from;
        let start = offset.dot(along);
        (start, self.from.distance(self.to) - start, offset.perp_dot(along).abs())
    }

    /// Share of the way in the world at `start` pixels along the line: perspective makes the nearer half longer.
    fn share(&self, start: f64) -> f64 {
        let s = start / self.from.distance(self.to);
        (s / self.w[1]) / ((1.0 - s) / self.w[0] + s / self.w[1])
    }
}

/// Holds the image against every line; lines must not overlap.
fn line_errors(
    image: &Image,
    photons: &[Photon],
    rays: &PixelRays,
    eye: DVec3,
    medium: Medium,
    width_px: f64,
) -> LineErrors {
    let godrays: Vec<Godray> = photons.iter().map(godray).collect();
    let segments = godrays.iter().filter_map(|ray| Some((ray, Segment::new(ray, rays)?)));
    let segments: Vec<(&Godray, Segment)> = segments.collect();
    let (mut intensity, mut compared, mut judged, mut unlike) = (0.0f64, 0, 0u32, 0u32);
    for (x, y) in pixels(image.size()) {
        let value = image.clamped(x.into(), y.into());
        let pixel = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
        // Margin by which the nearest line covers the pixel, negative outside.
        let covering = segments.iter().map(|(ray, segment)| {
            let (start, rest, beside) = segment.place(pixel);
            (start.min(rest).min(0.5 * width_px - beside), ray, segment, start)
        });
        let Some((margin, ray, segment, start)) = covering.max_by(|a, b| a.0.total_cmp(&b.0))
        else {
            continue;
        };
        if margin.abs() < EDGE_PX {
            continue;
        }
        judged += 1;
        unlike += u32::from((margin > 0.0) != (value > 0.0));
        if margin > 0.0 && value > 0.0 {
            let expected = ray.intensity(ray.point(segment.share(start)), eye, medium);
            intensity = intensity.max((value / expected - 1.0).abs());
            compared += 1;
        }
    }
    LineErrors {
        intensity: if compared == 0 { f64::NAN } else { intensity },
        pixels: compared,
        coverage: f64::from(unlike) / f64::from(judged.max(1)),
    }
}

/// Nodes and weights of Gauss–Legendre quadrature of 12 points over −1…1 (Abramowitz and Stegun, table 25.4).
const GAUSS: [(f64, f64); 6] = [
    (0.125_233_408_511_469, 0.249_147_045_813_403),
    (0.367_831_498_998_180, 0.233_492_536_538_355),
    (0.587_317_954_286_617, 0.203_167_426_723_066),
    (0.769_902_674_194_305, 0.160_078_328_543_346),
    (0.904_117_256_370_475, 0.106_939_325_995_318),
    (0.981_560_634_246_719, 0.047_175_336_386_512),
];

/// Clear water: the pixel in the middle of a line shows p(α) alone. Twelve lines whose scattering
/// angles are the nodes of a quadrature sum up to the integral over the sphere.
fn phase_integral(rig: &Rig<'_>) -> Result<Check> {
    let view = rig::synthetic_view(SIZE, 0.0)?;
    let eye = DVec3::from(view.camera.position_m);
    let rays = PixelRays::new(&view.camera, SIZE[0], SIZE[1]);
    let nodes: Vec<(f64, f64)> =
        GAUSS.iter().flat_map(|(node, weight)| [(*node, *weight), (-node, *weight)]).collect();
    let pixel = |i: usize| [i % CELLS as usize, i / CELLS as usize].map(|c| c as u32 * 96 + 48);
    let photons: Vec<Photon> = nodes
        .iter()
        .enumerate()
        .map(|(i, (cosine, _))| {
            let [x, y] = pixel(i);
            let (_, seen, _) = rays.ray(x, y);
            let middle = eye + seen * 3.0;
            let across = seen.cross(DVec3::Y).normalize();
            let direction = -seen * *cosine + across * (1.0 - cosine * cosine).sqrt();
            rig::photon(middle - direction * 0.3, middle + direction * 0.3, 0.6)
        })
        .collect();
    let image = draw(rig, &view, &photons)?;
    let integral = |weight: &dyn Fn(f64, f64) -> f64| -> f64 {
        let term = |(i, (cosine, w)): (usize, &(f64, f64))| {
            let [x, y] = pixel(i);
            image.clamped(x.into(), y.into()) / PHOTON_W * TAU * weight(*cosine, *w)
        };
        nodes.iter().enumerate().map(term).sum()
    };
    let sphere = integral(&|_, weight| weight);
    // Leaving out the sine that turns angles into solid angle.
    let flat = integral(&|cosine, weight| weight / (1.0 - cosine * cosine).sqrt());
    Ok(Check::of(STAGE, "|integral of the phase function over the sphere − 1|")
        .within((1e-3, "1"), (sphere - 1.0).abs())
        .control("weights without the sine", (flat - 1.0).abs())
        .with("integral", sphere))
}
