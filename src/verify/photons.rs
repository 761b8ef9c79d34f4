//! `caustics/trace` and `godrays/trace` against exact refraction and ray casting.

use crate::prelude::*;
use fathom_pipelines::underwater::{Params, Underwater};
use fathom_reference::estimator::{behind_seen, estimate, exact_depth, first_crossing};
use fathom_stages::photon;
use fathom_stages::{caustics, godrays};

/// Flat water over a plane has a closed form: what is left is f32 and the depth map's bits.
const FLAT_RELATIVE: f64 = 1e-4;
/// Median distance between a photon's landing and the exact one in real scenes.
const REAL_MEDIAN_M: f64 = 0.01;
/// 99th percentile of the distance between a photon's entry and the exact one: the noise texture is
/// interpolated between texels a sixteenth of a noise cell apart.
const ENTRY_P99_M: f64 = 1e-3;
/// Cells per side of the photon grids; four photons a cell.
const FLAT_GRID: u32 = 32;
const REAL_GRID: u32 = 48;
const SHADOW_TEXELS: u32 = 512;
/// Steps of the search over an exact depth.
const EXACT_STEPS: u32 = 64;
const STAGE: &str = caustics::trace::INFO.name;

pub fn cases() -> Vec<Case> {
    let mut cases = Vec::new();
    for info in [&caustics::trace::INFO, &godrays::trace::INFO] {
        for (kind, light) in rig::LIGHTS {
            let what = format!("flat water over a plane, {light} light");
            cases.push(Case::new(info.name, what.clone(), move |rig| flat(rig, info, kind, &what)));
        }
    }
    cases.push(Case::new(STAGE, "photons that meet nothing", beside_the_floor));
    cases.push(Case::new(STAGE, "estimates beyond the light's frustum", beyond_the_frustum));
    cases.push(Case::new(STAGE, "run-time subdivision", dynamic_subdivision));
    cases.push(Case::new(STAGE, "strewn photons", strewn));
    let models = [WaterModel::Circular, WaterModel::Directional];
    cases.extend(Case::each(STAGE, models, |model| format!("{model} waves"), waves));
    for name in Scene::names().into_iter().filter(|name| has_water(name)) {
        cases.push(Case::new(STAGE, format!("scene {name}"), move |rig| real(rig, &name)));
    }
    cases
}

/// Photons that a stage has traced through a scene.
pub struct Traced {
    pub stand: Stand,
    pub frame: LightFrame,
    pub grid: PhotonGrid,
    pub photons: Vec<StoredPhoton>,
}

impl Traced {
    /// By `caustics/trace`, with the loop over a cell's photons compiled in.
    pub fn new(rig: &Rig<'_>, scene: Scene, settings: TraceUniforms) -> Result<Self> {
        Self::by(rig, (&caustics::trace::INFO, false), scene, settings)
    }

    /// Depth map, mask and one tracing stage.
    fn by(
        rig: &Rig<'_>,
        by: (&'static StageInfo, bool),
        scene: Scene,
        settings: TraceUniforms,
    ) -> Result<Self> {
        Self::over(rig, by, rig.stand(scene, [256, 256])?, SHADOW_TEXELS, settings)
    }

    /// The same, with so many texels a side of the light's depth.
    pub fn over(
        rig: &Rig<'_>,
        (info, dynamic): (&'static StageInfo, bool),
        stand: Stand,
        shadow_px: u32,
        settings: TraceUniforms,
    ) -> Result<Self> {
        let depth = shadow::depth::new(rig, &stand.shared, &stand.geometry, shadow_px)?;
        let mask = shadow::mask::new(rig, &stand.shared, &depth, 64)?;
        let light = (&*depth, &*mask);
        let grid = PhotonGrid::new(settings.grid, settings.side);
        let stage = photon::tracing(rig, info, &stand.shared, light, &settings, (dynamic, false))?;
        rig.run(&[&depth, &mask, &stage])?;
        Ok(Self {
            frame: stand.view.light_frame(),
            grid,
            photons: rig.read_photons(&stage)?,
            stand,
        })
    }

    /// The same photons exactly, through this water over this geometry.
    pub fn exact(&self, water: &Water, tracer: &Tracer) -> Vec<Landing> {
        land_all(&self.frame, water, tracer, self.grid, 1)
    }

    /// Largest distance of a landing point from the exact one through water of this index, relative to the path under water.
    fn relative_error(&self, refractive_index: f64) -> f64 {
        let water = with_index(&self.stand.scene.water, refractive_index);
        let landings = self.exact(&water, &self.stand.tracer);
        largest(self.photons.iter().zip(&landings).filter_map(|(photon, landing)| {
            let exact = landing.landed().filter(|_| photon.landed())?;
            Some(photon.hit.distance(exact.hit.position) / exact.hit.distance_m)
        }))
    }

    /// Against exact ones through this water.
    pub fn errors(&self, water: &Water) -> PhotonErrors {
        photon_errors(&self.photons, &self.exact(water, &self.stand.tracer))
    }
}

pub fn settings(grid: u32, side: u32) -> TraceUniforms {
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
        search_turns: 0,
    }
}

fn with_index(water: &Water, refractive_index: f64) -> Water {
    Water { refractive_index, ..water.clone() }
}

fn flat(rig: &Rig<'_>, info: &'static StageInfo, kind: LightKind, what: &str) -> Result<Check> {
    let traced = Traced::by(rig, (info, false), rig::flat_plane(kind)?, settings(FLAT_GRID, 2))?;
    let water = &traced.stand.scene.water;
    let check = Check::of(rig, format!("{what}: largest |hit − exact| / path"))
        .within((FLAT_RELATIVE, "1"), traced.relative_error(water.refractive_index))
        .control("refractive index 1.34", traced.relative_error(1.34));
    Ok(with_rates(check, &traced.errors(water)))
}

/// Photons that pass beside the floor must not land where the depth map is empty.
fn beside_the_floor(rig: &Rig<'_>) -> Result<Check> {
    let mut scene = rig::flat_plane(LightKind::Point)?;
    scene.light.half_extent_m = 14.0;
    let traced = Traced::new(rig, scene, settings(FLAT_GRID, 2))?;
    let false_hits = |tracer: &Tracer| {
        let landings = traced.exact(&traced.stand.scene.water, tracer);
        photon_errors(&traced.photons, &landings).false_hit_rate
    };
    Ok(Check::of(rig, "photons beside the floor: share that lands")
        .within((0.01, "1"), false_hits(&traced.stand.tracer))
        .control("no floor", false_hits(&Tracer::new(&[]))))
}

/// The paper's estimator from a first estimate so far away that many leave the light's frustum: photons that land within it are found.
fn beyond_the_frustum(rig: &Rig<'_>) -> Checks {
    const START_M: f64 = 40.0;
    let paper = PhotonEstimator::Paper as u32;
    let settings =
        TraceUniforms { estimator: paper, start_m: START_M as f32, ..settings(FLAT_GRID, 2) };
    let traced = Traced::new(rig, rig::flat_plane(LightKind::Directional)?, settings)?;
    let frame = &traced.frame;
    let landings = traced.exact(&traced.stand.scene.water, &traced.stand.tracer);
    let within: Vec<(&StoredPhoton, &Landed)> = traced
        .photons
        .iter()
        .zip(&landings)
        .filter_map(|(photon, landing)| Some((photon, landing.landed()?)))
        .filter(|(_, exact)| in_frustum(frame, exact.hit.position))
        .collect();
    let lost = share(within.iter().map(|(photon, _)| !photon.landed()));
    let leaves =
        |exact: &Landed| !in_frustum(frame, exact.entry.position + START_M * exact.direction);
    Ok(vec![
        Check::of(rig, "photons that land in the light's frustum: share that is lost")
            .within((0.01, "1"), lost)
            .control(
                "lost where the first estimate leaves it",
                share(within.iter().map(|(_, exact)| leaves(exact))),
            ),
        Check::of(rig, "largest |hit − exact| / path of those that are found")
            .within(
                (FLAT_RELATIVE, "1"),
                traced.relative_error(traced.stand.scene.water.refractive_index),
            )
            .control("refractive index 1.34", traced.relative_error(1.34)),
    ])
}

/// The loop bound read at run time gives the very photons of the one compiled in. UW §4.1.
fn dynamic_subdivision(rig: &Rig<'_>) -> Result<Check> {
    let traced = |offset: f32, dynamic| -> Result<Vec<StoredPhoton>> {
        let settings = TraceUniforms { offset: Vec2::splat(offset), ..settings(16, 3) };
        let scene = rig::flat_plane(LightKind::Directional)?;
        Ok(Traced::by(rig, (&caustics::trace::INFO, dynamic), scene, settings)?.photons)
    };
    let fixed = traced(0.5, false)?;
    let apart = |other: &[StoredPhoton]| {
        largest(fixed.iter().zip(other).map(|(a, b)| a.hit.distance(b.hit)))
    };
    Ok(Check::of(rig, "run-time against compiled subdivision: largest distance")
        .within((1e-5, "m"), apart(&traced(0.5, true)?))
        .control("photons moved by 1 % of their share", apart(&traced(0.51, true)?)))
}

/// Photons that are strewn over their shares of a grid that is moved.
fn strewn(rig: &Rig<'_>) -> Result<Check> {
    const OFFSET: [f64; 2] = [0.3, 0.9];
    let offset = DVec2::from(OFFSET).as_vec2();
    let settings = TraceUniforms { offset, jitter: 1.0, ..settings(FLAT_GRID, 2) };
    let mut traced = Traced::new(rig, rig::flat_plane(LightKind::Directional)?, settings)?;
    traced.grid.offset = OFFSET;
    let mut off = |jitter: f64| {
        traced.grid.jitter = jitter;
        let scene = &traced.stand.scene;
        traced.errors(&scene.water).max_m / scene.floor_depth_m
    };
    Ok(Check::of(rig, "strewn photons: largest |hit − exact| / depth")
        .within((FLAT_RELATIVE, "1"), off(1.0))
        .control("a regular grid", off(0.0)))
}

/// Where photons enter steep waves. UW §4.1 has two models; noise takes half of each here.
fn waves(rig: &Rig<'_>, model: WaterModel) -> Result<Check> {
    let mut scene = rig::flat_plane(LightKind::Directional)?;
    scene.water = Water { model, amplitude_m: 0.12, noise: 0.5, ..scene.water };
    let traced = Traced::new(rig, scene, settings(FLAT_GRID, 2))?;
    let water = &traced.stand.scene.water;
    let errors = traced.errors(water);
    let higher = Water { amplitude_m: water.amplitude_m * 1.05, ..water.clone() };
    let check =
        Check::of(rig, format!("{model} waves of 0.12 m: 99th percentile of |entry − exact|"))
            .within((ENTRY_P99_M, "m"), errors.entry_p99_m)
            .control("amplitude 5 % higher", traced.errors(&higher).entry_p99_m);
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
    let mut params = Params::from(&file);
    (params.caustics.grid, params.caustics.subdivision) = (REAL_GRID, 4);
    (params.godrays.grid, params.godrays.subdivision) = (REAL_GRID, 4);
    let pipeline = Built::<Underwater>::new(rig.gpu, &scene, &params)?;
    run_until(rig, &pipeline, godrays::trace::INFO.name)?;
    let tracer = Tracer::new(&scene.objects);
    let frame = pipeline.view.light_frame();
    let grid = PhotonGrid { jitter: params.caustics.jitter, ..PhotonGrid::new(REAL_GRID, 2) };
    let landings = land_all(&frame, &scene.water, &tracer, grid, 1);
    let perturbed = land_all(&frame, &with_index(&scene.water, 1.40), &tracer, grid, 1);
    let unlimited = unconverged_over_exact_depth(&pipeline.view, &params, &tracer, &landings);
    let families = [
        (caustics::trace::INFO.name, &pipeline.caustics.photons),
        (godrays::trace::INFO.name, &pipeline.godrays.photons),
    ];
    let check = |(stage, photons)| {
        let photons = rig.read_photons(photons)?;
        let errors = photon_errors(&photons, &landings);
        let of_family = Rig::new(rig.gpu, stage);
        let check = Check::of(&of_family, format!("scene {name}: median |hit − exact|"))
            .within((REAL_MEDIAN_M, "m"), errors.median_m)
            .control("refractive index 1.40", photon_errors(&photons, &perturbed).median_m);
        Ok(with_rates(check, &errors).with("unconverged_rate_over_exact_depth", unlimited))
    };
    families.into_iter().map(check).collect()
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
pub fn in_frustum(frame: &LightFrame, point: DVec3) -> bool {
    let ndc = frame.view_projection.project_point3(point);
    ndc.truncate().abs().max_element() <= 1.0
}

pub fn with_rates(check: Check, errors: &PhotonErrors) -> Check {
    check
        .with("p99_m", errors.p99_m)
        .with("converged_p99_m", errors.converged_p99_m)
        .with("photons_compared", errors.compared as f64)
        .with("miss_rate", errors.miss_rate)
        .with("false_hit_rate", errors.false_hit_rate)
        .with("unconverged_rate", errors.unconverged_rate)
        .with("entry_p99_m", errors.entry_p99_m)
}
