//! Where light enters the water and lands: fitted photon starts, the search for the water's surface, and the estimator's search along
//! the light's depth, over random water, light, cameras and obstacles.

use fathom::gpu::Gpu;
use fathom::pipelines::BuiltPipeline;
use fathom::pipelines::underwater::{Params, Underwater};
use fathom::reference::optics::refract;
use fathom::reference::photons::{Landing, PhotonGrid, land_all};
use fathom::reference::rays::Tracer;
use fathom::scene::{Bounds, Camera, LightFrame, LightKind, Mesh, Object};
use fathom::scene::{Scene, SceneFile, Water, WaterModel, Wave};
use fathom::stages::caustics::trace::INFO;
use fathom::stages::photon::{Fate, Photon};
use fathom::verify::rig::{Random, Rig};
use glam::DVec3;

/// Half the width of the floor and of the water, metres.
const HALF_M: f64 = 12.0;

fn random(seed: u64) -> Random {
    Random::new(seed as u32 * 7919 + 1)
}

/// Water whose steepest slope is drawn.
fn water(random: &mut Random, steepest: f64) -> Water {
    let model = [WaterModel::Circular, WaterModel::Directional, WaterModel::Waves]
        [(random.number() * 3.0) as usize];
    let mut water = Water {
        model,
        wavelength_m: random.within(0.3, 5.0),
        noise: random.number(),
        noise_tile_m: random.within(2.0, 16.0),
        seed: (random.number() * 1e6) as u32,
        time_s: random.within(0.0, 10.0),
        center_m: [random.within(-1.0, 1.0), random.within(-1.0, 1.0)],
        half_size_m: [HALF_M; 2],
        amplitude_m: 1.0,
        ..Water::default()
    };
    if model == WaterModel::Waves {
        let wave = |_| Wave {
            direction: [random.within(-1.0, 1.0), random.within(-1.0, 1.0)],
            wavelength_m: 10f64.powf(random.within(-1.0, 1.0)),
            amplitude_m: 0.0,
            phase_rad: random.within(-3.0, 3.0),
        };
        water.waves = (0..4).map(wave).collect();
        // As steep as one another, or as high.
        let as_steep = random.number() < 0.5;
        for wave in &mut water.waves {
            wave.amplitude_m = random.number() * if as_steep { wave.wavelength_m } else { 1.0 };
        }
    }
    let factor = steepest / water.steepest();
    water.amplitude_m *= factor;
    water.waves.iter_mut().for_each(|wave| wave.amplitude_m *= factor);
    water
}

fn block(low: DVec3, high: DVec3) -> Object {
    let (middle, half) = (0.5 * (low + high), 0.5 * (high - low));
    let axes = [DVec3::X * half.x, DVec3::Y * half.y, DVec3::Z * half.z];
    let mut mesh = Mesh::default();
    for i in 0..3 {
        let [to, a, b] = [0, 1, 2].map(|k| axes[(i + k) % 3]);
        mesh.append(&Mesh::parallelogram(middle + to, a, b));
        mesh.append(&Mesh::parallelogram(middle - to, b, a));
    }
    Object::new("block", mesh)
}

/// Objects over a floor of this depth, and light and water over them.
fn scene(
    random: &mut Random,
    steepest: f64,
    degrees: f64,
    depth_m: f64,
    mut objects: Vec<Object>,
) -> Scene {
    let mut scene = Scene::load("plane").unwrap();
    scene.water = water(random, steepest);
    scene.floor_depth_m = depth_m;
    let floor = Mesh::parallelogram(DVec3::Y * -depth_m, DVec3::Z * HALF_M, DVec3::X * HALF_M);
    objects.push(Object::new("floor", floor));
    scene.objects = objects;
    let room_m = scene.water.bound_m() + 1.0;
    let side = DVec3::new(HALF_M, 0.0, HALF_M);
    scene.bounds = Bounds { min: -side.with_y(depth_m), max: side.with_y(room_m) };
    let ((sin, cos), (z, x)) =
        (degrees.to_radians().sin_cos(), random.within(0.0, std::f64::consts::TAU).sin_cos());
    let direction = DVec3::new(sin * x, -cos, sin * z);
    scene.light.direction = direction.to_array();
    if random.number() < 0.4 {
        scene.light.kind = LightKind::Point;
        let lamp = direction * -random.within(1.0, 8.0) / cos;
        scene.light.position_m = lamp.with_y(lamp.y + scene.water.bound_m()).to_array();
    }
    let mut place = |y| [random.within(-5.0, 5.0), y, random.within(-5.0, 5.0)];
    let (eye, target) = (place(0.0), place(-depth_m));
    let eye = [eye[0], random.within(-0.9 * depth_m, 3.0), eye[2]];
    scene.camera =
        Camera::new(eye, target, random.within(20.0, 90.0), [0.1, random.within(4.0, 30.0)]);
    scene
}

fn within(ndc: DVec3) -> bool {
    ndc.truncate().abs().max_element() <= 1.0 + 1e-9
}

/// Of light that enters anywhere and lands in view: how much, and how much of it enters where no photon of a frame starts, or enters or lands
/// out of the light's frustum.
fn left_out(scene: &Scene, frame: &LightFrame, random: &mut Random) -> [f64; 2] {
    let tracer = Tracer::new(&scene.objects);
    let (water, view) = (&scene.water, scene.camera.view_projection(1.2));
    let start = frame.photon_grid.inverse();
    let (mut seen, mut lost) = (0.0, 0.0);
    for _ in 0..20_000 {
        let [x, z] = [0; 2].map(|_| random.within(-HALF_M, HALF_M));
        let entry = DVec3::new(x, water.height(x, z), z);
        let incident = match frame.kind {
            LightKind::Directional => frame.forward,
            LightKind::Point => (entry - frame.position).normalize(),
        };
        let normal = water.normal(x, z);
        if incident.dot(normal) >= 0.0 || entry.y >= frame.position.y || !water.contains(x, z) {
            continue;
        }
        let Some(direction) = refract(incident, normal, 1.0, water.refractive_index) else {
            continue;
        };
        let Some(hit) = tracer.cast(entry, direction, 1e-9, f64::MAX) else { continue };
        let clip = view * hit.position.extend(1.0);
        let off_axis = |p| {
            let p = frame.view.transform_point3(p);
            p.truncate().abs().max_element() / -p.z.min(-1e-9)
        };
        // A point light's frustum ends 79° off its axis.
        let far =
            frame.kind == LightKind::Point && off_axis(entry).max(off_axis(hit.position)) > 4.99;
        if clip.w <= 0.0
            || clip.z > clip.w
            || !within(clip.truncate() / clip.w)
            || clip.z < 0.0
            || far
        {
            continue;
        }
        seen += 1.0;
        let light = |p| within(frame.view_projection.project_point3(p));
        if !within(start.project_point3(entry)) || !light(entry) || !light(hit.position) {
            lost += 1.0;
        }
    }
    [seen, lost]
}

#[test]
fn fitted_starts_leave_out_no_light_that_lands_in_view() {
    let (mut all, mut still) = ([0.0; 2], [0.0; 2]);
    for seed in 0..super::draws() {
        let mut random = random(seed);
        let (steepest, degrees, depth_m) =
            (random.within(0.0, 0.9), random.within(0.0, 85.0), random.within(0.5, 8.0));
        let blocks = (0..3).map(|_| {
            let low = DVec3::new(random.within(-4.0, 4.0), -depth_m, random.within(-4.0, 4.0));
            block(low, low + DVec3::new(1.0, 0.9 * depth_m * random.number(), 1.5))
        });
        let blocks = blocks.collect();
        let scene = scene(&mut random, steepest, degrees, depth_m, blocks);
        let mut left_out = |water: &Water, sums: &mut [f64; 2]| {
            let frame = scene.light.frame(&scene.camera, 1.2, &scene.bounds, water, true);
            let found = left_out(&scene, &frame, &mut random);
            (0..2).for_each(|i| sums[i] += found[i]);
            found
        };
        let [seen, lost] = left_out(&scene.water, &mut all);
        assert!(lost == 0.0, "seed {seed}: {lost} of {seen}: {:?} {:?}", scene.light, scene.water);
        left_out(&Water { amplitude_m: 0.0, waves: Vec::new(), ..scene.water.clone() }, &mut still);
    }
    assert!(all[0] > 1000.0 && still[1] > 1e-3 * still[0], "{all:?} {still:?}");
}

/// Photons that `caustics/trace` finds, and where they land exactly.
struct Traced {
    frame: LightFrame,
    grid: PhotonGrid,
    tracer: Tracer,
    photons: Vec<Photon>,
    landings: Vec<Landing>,
}

impl Traced {
    /// In steps of so many texels of the light's depth.
    fn new(gpu: &Gpu, scene: &Scene, cells: u32, shadow_px: u32, step_px: f64) -> Self {
        let mut params = Params::from(&SceneFile::load("plane").unwrap());
        (params.view.width, params.view.height) = (64, 64);
        (params.camera, params.light) = (scene.camera.clone(), scene.light.clone());
        (params.water, params.floor_depth_m) = (scene.water.clone(), scene.floor_depth_m);
        // A photon that passes closer behind an edge than this meets it: what the light sees counts as so thick.
        (params.shadow.size, params.shadow.edge_m) = (shadow_px, 0.005);
        (params.caustics.grid, params.caustics.mask, params.godrays.grid) = (cells, false, 1);
        (params.caustics.jitter, params.caustics.step_px) = (0.0, step_px);
        let (rig, grid) = (Rig::new(gpu, INFO.name), PhotonGrid::new(cells, 2));
        let pipeline = BuiltPipeline::<Underwater>::new(gpu, scene, &params).unwrap();
        rig.run_until(&pipeline, INFO.name).unwrap();
        let (frame, tracer) = (pipeline.view.light_frame(), Tracer::new(&scene.objects));
        let landings = land_all(&frame, &scene.water, &tracer, grid, 1);
        let photons = pipeline.caustics.photons.read(rig.gpu).unwrap();
        Self { frame, grid, tracer, photons, landings }
    }
}

/// Where three steps of Newton's method from the resting water take a ray.
fn three_newton_steps(water: &Water, (origin, direction): (DVec3, DVec3)) -> DVec3 {
    let from_rest = -origin.y / direction.y;
    let t = (0..3).fold(from_rest, |t, _| {
        let p = origin + t * direction;
        let slope = water.gradient(p.x, p.z);
        let across = slope.x * direction.x + slope.y * direction.z;
        t + (water.height(p.x, p.z) - p.y) / (direction.y - across)
    });
    origin + t * direction
}

/// Of the amplitude: noise is interpolated between texels, and light that grazes the water magnifies that. Where a ray touches a crest it
/// decides between two places, of one photon in a thousand at most.
const ENTRY: f64 = 0.05;

#[test]
fn photons_enter_the_water_where_their_rays_meet_it_first() {
    let (gpu, [mut count, mut wrong, mut newtons]) = (crate::gpu(), [0; 3]);
    for seed in 0..super::draws() {
        let mut random = random(1000 + seed);
        let (steepest, degrees) = (random.within(0.0, 0.9), random.within(0.0, 85.0));
        let mut scene = scene(&mut random, steepest, degrees, 3.0, Vec::new());
        scene.light.half_extent_m = 3.0;
        let traced = Traced::new(&gpu, &scene, 12, 64, 4.0);
        for (i, (photon, exact)) in traced.photons.iter().zip(&traced.landings).enumerate() {
            let exact = match exact {
                Landing::Landed(landed) => landed.entry.position,
                Landing::Leaves { entry, .. } => entry.position,
                Landing::Blocked | Landing::MissesWater => continue,
            };
            let off = |entry: DVec3| entry.distance(exact) / scene.water.bound_m();
            let entered = photon.fate() != Fate::MissedWater;
            wrong += usize::from(!entered || off(photon.entry()) > ENTRY);
            let ray = traced.frame.photon_ray(traced.grid.ndc(i as u64));
            count += 1;
            newtons += usize::from(off(three_newton_steps(&scene.water, ray)) > ENTRY);
        }
    }
    assert!(count > 1000 && wrong <= count / 1000 && newtons > wrong, "{wrong} {newtons}");
}

/// Share of the photons that land in the light's sight and that are lost or more than [`OFF_M`] off: where a ray cuts off a corner that is
/// narrower than a step, or touches an edge. Of those that land nowhere the share that is found to land.
const LANDED_WRONG: f64 = 0.01;
const OFF_M: f64 = 0.01;
/// Texels of the light's depth, and half the width of what it shows.
const SHADOW_PX: u32 = 2048;
const SHOWN_M: f64 = 1.5;
const STEP_PX: f64 = 4.0;

#[test]
fn photons_land_where_the_light_sees_them_land_behind_any_number_of_obstacles() {
    let (gpu, mut sums) = (crate::gpu(), [[0u32; 4]; 2]);
    for seed in 0..super::draws() {
        let mut random = random(2000 + seed);
        let (degrees, depth_m) = (random.within(0.0, 80.0), random.within(1.0, 5.0));
        // At least two steps wide.
        let least_m = 4.0 * STEP_PX * SHOWN_M / f64::from(SHADOW_PX);
        let pitch_m = random.within(0.1, 0.3);
        let bars = (0..(random.number() * 40.0) as usize).map(|i| {
            let mut place = || random.within(-2.5, 2.5);
            let mut middle = DVec3::new(place(), -depth_m * (place() + 2.5) / 5.0, place());
            let mut half = [0; 3].map(|_| least_m * random.within(0.5, 2.0));
            half[(random.number() * 3.0) as usize] = random.within(0.2, 2.0);
            // A grate in every second scene, which rays pass behind for a while.
            if seed % 2 == 1 {
                middle = DVec3::new(pitch_m * (i as f64 - 20.0), -0.2, 0.0);
                half = [0.25 * pitch_m, 0.01, 3.0];
            }
            let high = middle + DVec3::from(half);
            block(middle - DVec3::from(half), high.with_y(high.y.min(-0.05)))
        });
        let bars: Vec<_> = bars.collect();
        let mut scene = scene(&mut random, 0.0, degrees, depth_m, bars);
        // Some rays pass below the floor.
        let half_m = if seed % 2 == 1 { HALF_M } else { random.within(1.0, 5.0) };
        let floor = Mesh::parallelogram(DVec3::Y * -depth_m, DVec3::Z * half_m, DVec3::X * half_m);
        *scene.objects.last_mut().unwrap() = Object::new("floor", floor);
        let middle = [0.0, -0.5 * depth_m, 0.0];
        let eye = [0.0, middle[1], 6.0];
        scene.camera = Camera::new(eye, middle, 60.0, [0.1, 11.9]);
        scene.light.half_extent_m = SHOWN_M;
        for (sums, longer) in sums.iter_mut().zip([1.0, 16.0]) {
            let traced = Traced::new(&gpu, &scene, 32, SHADOW_PX, longer * STEP_PX);
            let Traced { frame, photons, tracer, landings, .. } = &traced;
            for (photon, exact) in photons.iter().zip(landings) {
                let exact = match exact {
                    Landing::Landed(exact) => exact.hit.position,
                    Landing::Leaves { .. } => {
                        sums[2] += 1;
                        sums[3] += u32::from(photon.has_landed());
                        continue;
                    }
                    Landing::Blocked | Landing::MissesWater => continue,
                };
                let ndc = frame.view_projection.project_point3(exact);
                let (origin, direction) = frame.ray(ndc.x, ndc.y);
                let seen = tracer.cast(origin, direction, 0.0, f64::MAX);
                if within(ndc) && seen.is_some_and(|seen| seen.position.distance(exact) < 1e-6) {
                    sums[0] += 1;
                    sums[1] +=
                        u32::from(!photon.has_landed() || photon.hit().distance(exact) > OFF_M);
                }
            }
        }
    }
    let [[lit, wrong, nowhere, landed], [_, control, ..]] = sums.map(|sums| sums.map(f64::from));
    assert!(
        lit > 1000.0 && wrong <= LANDED_WRONG * lit && control > LANDED_WRONG * lit,
        "{sums:?}"
    );
    assert!(landed <= LANDED_WRONG * nowhere, "{sums:?}");
}
