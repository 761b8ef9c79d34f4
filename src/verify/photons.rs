//! `caustics/trace` and `godrays/trace` against exact refraction and ray casting.

use glam::{DVec3, Vec2};

use super::{Case, Check, Checks, Result, Rig, largest, rig};
use fathom_gpu::{GpuError, StageInfo};
use fathom_pipelines::underwater::{Params, Underwater};
use fathom_pipelines::{AnyPipeline, Built};
use fathom_reference::estimator::{behind_seen, estimate, exact_depth, first_crossing};
use fathom_reference::photons::{Landed, Landing, PhotonGrid, land_all};
use fathom_reference::quantities::{PhotonErrors, StoredPhoton, photon_errors};
use fathom_reference::rays::Tracer;
use fathom_scene::{LightFrame, LightKind, Scene, SceneFile, Water, WaterModel};
use fathom_stages::frame::View;
use fathom_stages::photon::{self, PhotonEstimator, TraceUniforms};
use fathom_stages::{caustics, godrays, shadow};

/// Flat water over a plane has a closed form: what is left is f32 and the depth map's bits.
const FLAT_RELATIVE: f64 = 1e-4;
/// Median distance between a photon's landing and the exact one in real scenes.
const REAL_MEDIAN_M: f64 = 0.01;
/// 99th percentile of the distance between a photon's entry and the exact one: the noise texture is
/// interpolated between texels a sixteenth of a noise cell apart.
const ENTRY_P99_M: f64 = 1e-3;
/// Cells per side of the photon grids; four photons a cell.
const FLAT_GRID: u32 = 32;
const REAL_GRID: u32 = 64;
const SHADOW_TEXELS: u32 = 512;
/// Steps of the search over an exact depth.
const EXACT_STEPS: u32 = 64;

pub fn cases() -> Vec<Case> {
    let mut cases = Vec::new();
    for family in [Family::Caustics, Family::Godrays] {
        for (kind, light) in [(LightKind::Directional, "directional"), (LightKind::Point, "point")]
        {
            let what = format!("flat water over a plane, {light} light");
            let title = what.clone();
            cases.push(Case::new(family.info().name, what, move |rig| {
                flat(rig, family, kind, &title)
            }));
        }
    }
    cases.push(Case::new("caustics/trace", "photons that meet nothing", beside_the_floor));
    cases.push(Case::new("caustics/trace", "run-time subdivision", dynamic_subdivision));
    cases.push(Case::new("caustics/trace", "strewn photons", strewn));
    for (model, name) in
        [(WaterModel::Circular, "circular"), (WaterModel::Directional, "directional")]
    {
        let what = format!("{name} waves");
        cases.push(Case::new("caustics/trace", what, move |rig| waves(rig, model, name)));
    }
    for name in Scene::names().into_iter().filter(|name| has_water(name)) {
        let what = format!("scene {name}");
        cases.push(Case::new("caustics/trace", what, move |rig| real(rig, &name)));
    }
    cases
}

#[derive(Clone, Copy, PartialEq)]
pub(super) enum Family {
    Caustics,
    Godrays,
}

impl Family {
    fn info(self) -> &'static StageInfo {
        match self {
            Family::Caustics => &caustics::trace::INFO,
            Family::Godrays => &godrays::trace::INFO,
        }
    }
}

/// Depth map, mask and one tracing stage for a scene; returns the photons.
pub(super) fn trace(
    rig: &Rig<'_>,
    scene: &Scene,
    family: Family,
    settings: TraceUniforms,
    dynamic: bool,
) -> Result<(Vec<StoredPhoton>, LightFrame)> {
    let rig::Stand { view, shared, geometry } = rig.stand(scene, [256, 256]);
    let depth = shadow::depth::new(&rig.resources, &shared, &geometry, SHADOW_TEXELS)?;
    let mask = shadow::mask::new(&rig.resources, &shared, &depth, 64)?;
    let light = (&*depth, &*mask);
    let info = family.info();
    let stage = photon::tracing(&rig.resources, info, &shared, light, &settings, (dynamic, false))?;
    rig.run(&[&depth, &mask, &stage])?;
    Ok((rig.read_photons(&stage)?, view.light_frame()))
}

pub(super) fn settings(grid: u32, side: u32) -> TraceUniforms {
    TraceUniforms {
        grid,
        side,
        estimator: PhotonEstimator::Secant as u32,
        iterations: 12,
        masked: 1,
        offset: Vec2::splat(0.5),
        start_m: 1.0,
        tolerance_m: 0.01,
        jitter: 0.0,
        step_px: 4.0,
        // Below the floor of scene `plane`.
        bottom_m: -3.01,
        lookups: 12,
    }
}

pub(super) fn exact(
    frame: &LightFrame,
    water: &Water,
    tracer: &Tracer,
    grid: [u32; 2],
) -> Result<Vec<Landing>> {
    let grid = PhotonGrid::new(grid[0], grid[1])?;
    Ok(land_all(frame, water, tracer, grid, 1))
}

pub(super) fn with_index(water: &Water, refractive_index: f64) -> Water {
    Water { refractive_index, ..water.clone() }
}

fn flat(rig: &Rig<'_>, family: Family, kind: LightKind, what: &str) -> Result<Check> {
    let scene = rig::flat_plane(kind)?;
    let (photons, frame) = trace(rig, &scene, family, settings(FLAT_GRID, 2), false)?;
    let tracer = Tracer::new(&scene.objects)?;
    let grid = [FLAT_GRID, 4];
    let landings = exact(&frame, &scene.water, &tracer, grid)?;
    let perturbed = exact(&frame, &with_index(&scene.water, 1.34), &tracer, grid)?;
    let errors = photon_errors(&photons, &landings);
    let check = Check::of(family.info().name, format!("{what}: largest |hit − exact| / path"))
        .within((FLAT_RELATIVE, "1"), largest_relative(&photons, &landings))
        .control("refractive index 1.34", largest_relative(&photons, &perturbed));
    Ok(with_rates(check, &errors))
}

/// Largest error of a landing point relative to the path under water; NaN when nothing lands.
fn largest_relative(photons: &[StoredPhoton], landings: &[Landing]) -> f64 {
    let error = |(photon, landing): (&StoredPhoton, &Landing)| {
        let exact = landing.landed().filter(|_| photon.landed())?;
        Some((photon.hit - exact.hit.position).length() / exact.hit.distance_m)
    };
    largest(photons.iter().zip(landings).filter_map(error))
}

/// Photons that pass beside the floor must not land where the depth map is empty.
fn beside_the_floor(rig: &Rig<'_>) -> Result<Check> {
    let mut scene = rig::flat_plane(LightKind::Point)?;
    scene.light.half_extent_m = 14.0;
    let (photons, frame) = trace(rig, &scene, Family::Caustics, settings(FLAT_GRID, 2), false)?;
    let false_hits = |tracer: Tracer| -> Result<f64> {
        let landings = exact(&frame, &scene.water, &tracer, [FLAT_GRID, 4])?;
        Ok(photon_errors(&photons, &landings).false_hit_rate)
    };
    Ok(Check::of("caustics/trace", "photons beside the floor: share that lands")
        .within((0.01, "1"), false_hits(Tracer::new(&scene.objects)?)?)
        .control("no floor", false_hits(Tracer::new(&[])?)?))
}

/// The loop bound read at run time gives the very photons of the one compiled in. UW §4.1.
fn dynamic_subdivision(rig: &Rig<'_>) -> Result<Check> {
    let scene = rig::flat_plane(LightKind::Directional)?;
    let traced = |offset: f32, dynamic| {
        let settings = TraceUniforms { offset: Vec2::splat(offset), ..settings(16, 3) };
        trace(rig, &scene, Family::Caustics, settings, dynamic).map(|(photons, _)| photons)
    };
    let fixed = traced(0.5, false)?;
    let apart = |other: &[StoredPhoton]| {
        largest(fixed.iter().zip(other).map(|(a, b)| (a.hit - b.hit).length()))
    };
    Ok(Check::of("caustics/trace", "run-time against compiled subdivision: largest distance")
        .within((1e-5, "m"), apart(&traced(0.5, true)?))
        .control("photons moved by 1 % of their share", apart(&traced(0.51, true)?)))
}

/// Photons that are strewn over their shares of a grid that is moved.
fn strewn(rig: &Rig<'_>) -> Result<Check> {
    const OFFSET: [f64; 2] = [0.3, 0.9];
    let scene = rig::flat_plane(LightKind::Directional)?;
    let offset = Vec2::new(OFFSET[0] as f32, OFFSET[1] as f32);
    let settings = TraceUniforms { offset, jitter: 1.0, ..settings(FLAT_GRID, 2) };
    let (photons, frame) = trace(rig, &scene, Family::Caustics, settings, false)?;
    let tracer = Tracer::new(&scene.objects)?;
    let off = |jitter: f64| -> Result<f64> {
        let grid = PhotonGrid::new(FLAT_GRID, 4)?.with_offset(OFFSET).with_jitter(jitter);
        let landings = land_all(&frame, &scene.water, &tracer, grid, 1);
        let found = photon_errors(&photons, &landings);
        Ok(found.max_m / scene.floor_depth_m)
    };
    Ok(Check::of("caustics/trace", "strewn photons: largest |hit − exact| / depth")
        .within((FLAT_RELATIVE, "1"), off(1.0)?)
        .control("a regular grid", off(0.0)?))
}

/// Where photons enter steep waves. UW §4.1 has two models; noise takes half of each here.
fn waves(rig: &Rig<'_>, model: WaterModel, name: &str) -> Result<Check> {
    let mut scene = rig::flat_plane(LightKind::Directional)?;
    scene.water.model = model;
    scene.water.amplitude_m = 0.12;
    scene.water.noise = 0.5;
    let (photons, frame) = trace(rig, &scene, Family::Caustics, settings(FLAT_GRID, 2), false)?;
    let tracer = Tracer::new(&scene.objects)?;
    let grid = [FLAT_GRID, 4];
    let errors = photon_errors(&photons, &exact(&frame, &scene.water, &tracer, grid)?);
    let higher = Water { amplitude_m: scene.water.amplitude_m * 1.05, ..scene.water.clone() };
    let perturbed = photon_errors(&photons, &exact(&frame, &higher, &tracer, grid)?);
    let what = format!("{name} waves of 0.12 m: 99th percentile of |entry − exact|");
    let check = Check::of("caustics/trace", what)
        .within((ENTRY_P99_M, "m"), errors.entry_p99_m)
        .control("amplitude 5 % higher", perturbed.entry_p99_m);
    Ok(with_rates(check, &errors))
}

/// The scene's file sets its water; dry scenes and volumes leave it alone.
fn has_water(scene: &str) -> bool {
    SceneFile::load(scene).is_ok_and(|file| file.water != Water::default())
}

/// Both tracing stages of the whole pipeline at the scene's own settings.
fn real(rig: &Rig<'_>, name: &str) -> Checks {
    let file = SceneFile::load(name)?;
    let scene = Scene::build(&file)?;
    let pipeline = Built::<Underwater>::new(rig.gpu, &scene, &real_params(&file))?;
    run_until(rig, &pipeline, godrays::trace::INFO.name)?;
    let tracer = Tracer::new(&scene.objects)?;
    let frame = pipeline.view.light_frame();
    let grid = PhotonGrid::new(REAL_GRID, 4)?.with_jitter(pipeline.params.caustics.jitter);
    let landings = land_all(&frame, &scene.water, &tracer, grid, 1);
    let perturbed = land_all(&frame, &with_index(&scene.water, 1.40), &tracer, grid, 1);
    let unlimited =
        unconverged_over_exact_depth(&pipeline.view, &pipeline.params, &tracer, &landings);
    [Family::Caustics, Family::Godrays]
        .into_iter()
        .map(|family| {
            let photons = rig.read_photons(match family {
                Family::Caustics => &pipeline.caustics.photons,
                Family::Godrays => &pipeline.godrays.photons,
            })?;
            let errors = photon_errors(&photons, &landings);
            let check =
                Check::of(family.info().name, format!("scene {name}: median |hit − exact|"))
                    .within((REAL_MEDIAN_M, "m"), errors.median_m)
                    .control("refractive index 1.40", photon_errors(&photons, &perturbed).median_m);
            Ok(with_rates(check, &errors).with("unconverged_rate_over_exact_depth", unlimited))
        })
        .collect()
}

fn real_params(file: &SceneFile) -> Params {
    let mut params = Params::from(file);
    (params.caustics.grid, params.caustics.subdivision) = (REAL_GRID, 4);
    (params.godrays.grid, params.godrays.subdivision) = (REAL_GRID, 4);
    params
}

/// Runs a pipeline's stages up to and including one.
pub fn run_until(rig: &Rig<'_>, pipeline: &Built<Underwater>, last: &str) -> Result<(), GpuError> {
    let stages = pipeline.stages();
    let end = stages.iter().position(|stage| stage.name() == last);
    rig.gpu.run(&stages[..end.map_or(stages.len(), |i| i + 1)])
}

/// Of every fourth photon that lands within the light's frustum: the share that the pipeline's estimator does not bring within the
/// tolerance of what the light sees, over a depth map of unlimited resolution. These are the method's own failures.
fn unconverged_over_exact_depth(
    view: &View,
    params: &Params,
    tracer: &Tracer,
    landings: &[Landing],
) -> f64 {
    let (frame, settings) = (view.light_frame(), &params.caustics);
    let grid = settings.grid_settings();
    let sampled = landings.iter().step_by(4).filter_map(Landing::landed);
    let held = sampled.filter(|landed| in_frustum(&frame, landed.hit.position)).collect::<Vec<_>>();
    let converges = |landed: &Landed| {
        let (entry, direction) = (landed.entry.position, landed.direction);
        match settings.estimator {
            PhotonEstimator::Secant => {
                let reach_m = (view.bounds.min.y - entry.y) / direction.y * 1.001;
                let behind = |d: f64| behind_seen(&frame, tracer, entry + direction * d);
                first_crossing(reach_m, EXACT_STEPS, behind).is_some()
            }
            PhotonEstimator::Paper => {
                let surface = |p| exact_depth(&frame, tracer, p);
                let iterations = grid.iterations_in(view);
                estimate(entry, direction, settings.start_m, iterations, surface)
                    .is_some_and(|end| end.residual_m <= settings.tolerance_m)
            }
        }
    };
    let failed = held.iter().filter(|landed| !converges(landed)).count();
    failed as f64 / held.len().max(1) as f64
}

/// Whether a point lies within the light's frustum.
pub(super) fn in_frustum(frame: &LightFrame, point: DVec3) -> bool {
    let ndc = frame.view_projection.project_point3(point);
    ndc.truncate().abs().max_element() <= 1.0
}

pub(super) fn with_rates(check: Check, errors: &PhotonErrors) -> Check {
    check
        .with("p99_m", errors.p99_m)
        .with("converged_p99_m", errors.converged_p99_m)
        .with("photons_compared", errors.compared as f64)
        .with("miss_rate", errors.miss_rate)
        .with("false_hit_rate", errors.false_hit_rate)
        .with("unconverged_rate", errors.unconverged_rate)
        .with("entry_p99_m", errors.entry_p99_m)
}
