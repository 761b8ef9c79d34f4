//! Stages of screen-space photon tracing against exact refraction, sorted depths and ray casting.

mod bounces;

use std::iter::successors;

use glam::{DVec3, UVec2};

use super::{Case, Check, Checks, Result, Rig, rig};
use fathom_gpu::{TimedStage, read_volume};
use fathom_reference::image::pixels;
use fathom_reference::optics::{fresnel_transmittance, refract};
use fathom_reference::quantities::{StoredPhoton, quantile};
use fathom_reference::rays::{PixelRays, Tracer};
use fathom_reference::surface::enter;
use fathom_scene::{Camera, LightKind, Scene, Water};
use fathom_stages::geometry::Part;
use fathom_stages::kit::linear_workgroups;
use fathom_stages::ldi::lists;
use fathom_stages::ldi::peel;
use fathom_stages::ldi::sort;
use fathom_stages::photon::Photons;
use fathom_stages::rays::{group, march, rasterize, reduce};
use fathom_stages::screen_ray::{
    self, HitTest, Layers, NEVER, Rays, Transfer, Transfers, Walking, group_each,
};
use fathom_stages::shadow::{depth, mask};
use fathom_stages::transfer::bounce;
use fathom_stages::transfer::map::{self, MapUniforms};

/// Scenes with columns and curved objects; with an open shore, seen from above; with many boxes and barrels.
const SCENES: [&str; 3] = ["tank", "port", "storage"];
/// Scenes like those of the paper, and one with mirror and glass.
const PAPER_SCENES: [&str; 5] = ["cornell", "dolphin", "diving_pool", "planar_pool", "specular"];
const SIZE: [u32; 2] = [320, 240];
const GRID: [u32; 2] = [48, 40];
const LAYERS: u32 = 8;
/// SPT §5: the paper's tolerance, world units.
const TOLERANCE_M: f64 = 0.01;
/// A photon that ends farther than this from its exact end lies on another surface.
const WRONG_M: f64 = 0.1;
/// Rows of the forced small target: three tiles and a rest.
const FEW_ROWS: u32 = 600;
/// Fragments a pixel for which lists have room: more than any of these scenes has.
const ROOM: u32 = 32;
/// A ray cast from a stored position starts this far from it, metres.
const OFF_M: f64 = 1e-6;

pub fn cases() -> Vec<Case> {
    let mut cases = vec![Case::new(map::INFO.name, "positions and directions", transfers)];
    for kind in [LightKind::Directional, LightKind::Point] {
        let what = format!("weights, {kind:?} light");
        cases.push(Case::new(map::INFO.name, what, move |rig| weights(rig, kind)));
    }
    for name in SCENES {
        cases.push(Case::new(peel::INFO.name, format!("scene {name}"), move |rig| {
            layers(rig, name)
        }));
    }
    for name in SCENES {
        let what = format!("scene {name}");
        cases.push(Case::new(lists::INFO.name, what.clone(), move |rig| listed(rig, name)));
        cases.push(Case::new(sort::INFO.name, what, move |rig| sorted(rig, name)));
    }
    for name in SCENES {
        for (stage, method) in METHODS {
            let what = format!("scene {name}");
            cases.push(Case::new(stage, what, move |rig| ends(rig, name, stage, method)));
        }
    }
    for name in SCENES.into_iter().chain(PAPER_SCENES) {
        let what = format!("scene {name}: photon by photon as marched");
        cases.push(Case::new(reduce::INFO.name, what, move |rig| alike(rig, name)));
    }
    cases.extend(bounces::cases());
    cases
}

/// What finds the ends of rays.
#[derive(Clone, Copy, PartialEq)]
enum Method {
    Lines { rows: u32 },
    March,
    Group,
}

const METHODS: [(&str, Method); 3] = [
    (rasterize::INFO.name, Method::Lines { rows: FEW_ROWS }),
    (march::INFO.name, Method::March),
    (group::INFO.name, Method::Group),
];

/// A scene with its layers and the photons behind its water.
struct Setup {
    scene: Scene,
    stand: rig::Stand,
    layers: Layers,
    transfers: Transfers,
    stored: Vec<Transfer>,
    weights: Vec<f32>,
}

impl Setup {
    fn new(rig: &Rig<'_>, name: &str, layers: u32) -> Result<Setup> {
        Setup::of(rig, Scene::load(name)?, layers)
    }

    fn of(rig: &Rig<'_>, scene: Scene, layers: u32) -> Result<Setup> {
        let stand = rig.stand(&scene, SIZE);
        let rig::Stand { shared, geometry, .. } = &stand;
        let depth = depth::new(&rig.resources, shared, geometry, 512)?;
        let mask = mask::new(&rig.resources, shared, depth.texture(), 64)?;
        let settings = MapUniforms { grid: UVec2::from(GRID) };
        let map = map::new(&rig.resources, shared, mask.texture(), &settings)?;
        let peel = peel::new(&rig.resources, shared, (geometry, Part::Solid), SIZE, layers)?;
        rig.run(&[&depth, &mask, &map, &peel])?;
        let stored = rig.read(&map.transfers.buffer)?;
        let weights = rig.read(&map.weights)?;
        let (layers, transfers) = (peel.left, map.left.transfers);
        Ok(Setup { scene, stand, layers, transfers, stored, weights })
    }

    fn trace(&self, rig: &Rig<'_>, method: Method, test: HitTest) -> Result<Vec<StoredPhoton>> {
        self.trace_ways(rig, method, test, 1)
    }

    /// Several ways use the transfer map up.
    fn trace_ways(
        &self,
        rig: &Rig<'_>,
        method: Method,
        test: HitTest,
        ways: u32,
    ) -> Result<Vec<StoredPhoton>> {
        let rows = if let Method::Lines { rows } = method { rows } else { 1 };
        let walking =
            Walking { test, tolerance_m: TOLERANCE_M, start_m: 0.0, least: 8, rows, ways };
        let rays = Rays {
            transfers: &self.transfers,
            layers: &self.layers,
            bounds: self.scene.solid_bounds(),
            walking,
        };
        let shared = &self.stand.shared;
        let count = self.transfers.count;
        let traced = |stages: &[&dyn TimedStage], photons: &Photons, tiles: u32| {
            let bounce = bounce::new(&rig.resources, shared, &rays, photons, tiles)?;
            let bounces: &[&dyn TimedStage] = if ways > 1 { &[&bounce] } else { &[] };
            rig.run(&[stages, bounces].concat())?;
            Ok(rig.read_photons(photons)?)
        };
        let walked = |info, workgroups| {
            let stage = screen_ray::walked(&rig.resources, info, shared, &rays, workgroups)?;
            traced(&[&stage], &stage, 1)
        };
        match method {
            Method::Lines { .. } => {
                let lines = rasterize::new(&rig.resources, shared, &rays)?;
                let reduce = reduce::new(&rig.resources, &lines, &rays)?;
                traced(&[&lines, &reduce], &reduce, rays.tiles())
            }
            Method::March => walked(&march::INFO, linear_workgroups(count.into())),
            Method::Group => walked(&group::INFO, group_each(count)),
        }
    }

    /// Where each photon that is alive ends exactly, where that is in view.
    fn exact(&self, tracer: &Tracer, turned: f64) -> Vec<Option<DVec3>> {
        let rays = PixelRays::new(&self.stand.view.camera, SIZE[0], SIZE[1]);
        let end = |transfer: &Transfer| {
            let (origin, direction) =
                (transfer.position_m.as_dvec3(), transfer.direction.as_dvec3());
            let direction = (direction + turned * DVec3::X).normalize();
            let hit = tracer.cast(origin, direction, OFF_M, f64::MAX)?;
            let place = rays.project(hit.position)?;
            let inside = |at: f64, side: u32| (0.0..=f64::from(side)).contains(&at);
            (inside(place.x_px, SIZE[0]) && inside(place.y_px, SIZE[1])).then_some(hit.position)
        };
        self.stored.iter().map(|t| if t.state > NEVER { end(t) } else { None }).collect()
    }
}

/// The transfer map against the exact entry and Snell's law.
fn transfers(rig: &Rig<'_>) -> Checks {
    let setup = Setup::new(rig, "tank", 1)?;
    let view = &setup.stand.view;
    let frame = view.light_frame();
    let ndc = |k: u32, n: u32| 2.0 * (f64::from(k) + 0.5) / f64::from(n) - 1.0;
    let errors = |water: &Water, index: f64| {
        let (mut places, mut directions) = (Vec::new(), Vec::new());
        for (number, stored) in (0..).zip(&setup.stored).filter(|(_, stored)| stored.state > NEVER)
        {
            let (origin, incident) =
                frame.ray(ndc(number % GRID[0], GRID[0]), ndc(number / GRID[0], GRID[1]));
            let entry = enter(water, origin, incident, f64::MAX);
            let refracted = entry.and_then(|e| refract(incident, e.normal, 1.0, index));
            let off = |a: Option<DVec3>, b: DVec3| a.map_or(f64::NAN, |a| a.distance(b));
            places.push(off(entry.map(|e| e.position), stored.position_m.as_dvec3()));
            directions.push(off(refracted, stored.direction.as_dvec3()));
        }
        [quantile(&mut places, 0.99), quantile(&mut directions, 0.99)]
    };
    let index = view.water.refractive_index;
    let [places, directions] = errors(&view.water, index);
    let higher = Water { amplitude_m: 1.1 * view.water.amplitude_m, ..view.water.clone() };
    Ok(vec![
        // The noise texture is interpolated between texels.
        Check::of(map::INFO.name, "99th percentile of |entry − exact entry|")
            .within((1e-3, "m"), places)
            .control("waves 10 % higher", errors(&higher, index)[0]),
        Check::of(map::INFO.name, "99th percentile of |direction − Snell's|")
            .within((5e-3, "1"), directions)
            .control("refractive index 3 % higher", errors(&view.water, 1.03 * index)[1]),
    ])
}

/// Weights of photons against the solid angle of their share of the light's screen and Fresnel's transmittance.
fn weights(rig: &Rig<'_>, kind: LightKind) -> Result<Check> {
    let mut scene = rig::flat_plane(kind)?;
    scene.water.amplitude_m = 0.05;
    scene.water.fresnel = true;
    let setup = Setup::of(rig, scene, 1)?;
    let (frame, water) = (setup.stand.view.light_frame(), &setup.stand.view.water);
    let ndc = |k: u32, n: u32| 2.0 * (f64::from(k) + 0.5) / f64::from(n) - 1.0;
    let error = |fresnel: bool| {
        let alive = (0..).zip(&setup.stored).filter(|(_, photon)| photon.state != NEVER);
        let off = alive.filter_map(|(number, _)| {
            let place = [ndc(number % GRID[0], GRID[0]), ndc(number / GRID[0], GRID[1])];
            let (origin, incident) = frame.ray(place[0], place[1]);
            let entry = enter(water, origin, incident, f64::MAX)?;
            let cosine = incident.dot(entry.normal).abs();
            let passes = fresnel_transmittance(cosine, 1.0, water.refractive_index);
            let angular = match kind {
                LightKind::Directional => 1.0,
                LightKind::Point => incident.dot(frame.forward).powi(3),
            };
            let exact = angular * if fresnel { passes } else { 1.0 };
            Some((f64::from(setup.weights[number as usize]) / exact - 1.0).abs())
        });
        quantile(&mut off.collect::<Vec<_>>(), 0.99)
    };
    Ok(Check::of(
        map::INFO.name,
        format!("{kind:?}: 99th percentile of the weight's relative error"),
    )
    .within((2e-3, "1"), error(true))
    .control("without Fresnel's transmittance", error(false)))
}

/// A pixel in every seventh row and column.
fn sparse_pixels() -> impl Iterator<Item = (u32, u32)> {
    pixels(SIZE).filter(|(x, y)| x % 7 == 3 && y % 7 == 3)
}

/// Where a pixel's ray meets surfaces, the nearest first, one more than there are layers at most.
fn all_hits(tracer: &Tracer, rays: &PixelRays, [x, y]: [u32; 2]) -> Vec<DVec3> {
    let (origin, direction, _) = rays.ray(x, y);
    let next = |from_m: f64| tracer.cast(origin, direction, from_m, f64::MAX);
    let hits = successors(next(0.0), |hit| next(hit.distance_m + OFF_M));
    hits.take(LAYERS as usize + 1).map(|hit| hit.position).collect()
}

/// Peeled depths against all hits along each pixel's ray, sorted.
fn layers(rig: &Rig<'_>, name: &str) -> Checks {
    let setup = Setup::new(rig, name, LAYERS)?;
    let tracer = Tracer::new(&setup.scene.objects)?;
    let rays = PixelRays::new(&setup.stand.view.camera, SIZE[0], SIZE[1]);
    let peeled = read_volume(rig.gpu, &setup.layers.depths, 0)?;
    let texel = |x: u32, y: u32, layer: usize| {
        let row = y as usize + layer * SIZE[1] as usize;
        f64::from(peeled.data[x as usize + row * SIZE[0] as usize])
    };
    let chosen: Vec<(u32, u32)> = sparse_pixels().collect();
    let depths = |(x, y): &(u32, u32)| -> Vec<f64> {
        let hits = all_hits(&tracer, &rays, [*x, *y]).into_iter();
        hits.filter_map(|hit| Some(rays.project(hit)?.depth)).collect()
    };
    let sorted: Vec<Vec<f64>> = chosen.iter().map(depths).collect();
    let (near_m, far_m) = (setup.stand.view.camera.z_near_m, setup.stand.view.camera.z_far_m);
    let view_m = |z: f64| near_m * far_m / (far_m - z * (far_m - near_m));
    let errors = |behind: usize| {
        let mut off = Vec::new();
        for ((x, y), exact) in chosen.iter().zip(&sorted) {
            for layer in 0..LAYERS as usize {
                let z = texel(*x, *y, layer);
                let exact = exact.get(layer + behind).copied().filter(|z| *z < 1.0);
                match (z < 1.0, exact) {
                    (true, Some(exact)) => off.push((view_m(z) / view_m(exact) - 1.0).abs()),
                    (false, None) => {}
                    _ => off.push(1.0),
                }
            }
        }
        quantile(&mut off, 0.9)
    };
    // At silhouettes, and where surfaces touch, another one may be next.
    let what =
        format!("scene {name}: 90th percentile of the layers' depth errors, of the distance");
    Ok(vec![
        Check::of(peel::INFO.name, what)
            .within((5e-3, "1"), errors(0))
            .control("each layer held against the next", errors(1)),
    ])
}

/// Lengths of the lists against the surfaces along each pixel's ray.
fn listed(rig: &Rig<'_>, name: &str) -> Result<Check> {
    /// 32-bit words of a node, and the place of the next one's number among them.
    const NODE: [usize; 2] = [4, 1];
    let setup = Setup::new(rig, name, 1)?;
    let rig::Stand { shared, geometry, view } = &setup.stand;
    let stage = lists::new(&rig.resources, shared, (geometry, Part::Solid), SIZE, ROOM)?;
    // Twice, as the second frame finds what the first has left.
    rig.run(&[&stage])?;
    rig.run(&[&stage])?;
    let heads = rig.read::<u32>(&stage.heads)?;
    let nodes = rig.read::<u32>(&stage.nodes)?;
    let next = |number: u32| nodes[(number as usize - 1) * NODE[0] + NODE[1]];
    let length = |x: u32, y: u32| {
        let first = heads[1 + (x + y * SIZE[0]) as usize];
        let some = |number: u32| (number > 0).then_some(number);
        successors(some(first), |number| some(next(*number))).count()
    };
    let tracer = Tracer::new(&setup.scene.objects)?;
    let rays = PixelRays::new(&view.camera, SIZE[0], SIZE[1]);
    let counts: Vec<[usize; 2]> = sparse_pixels()
        .map(|(x, y)| {
            let seen = |place: &DVec3| rays.project(*place).is_some_and(|p| p.depth < 1.0);
            let exact = all_hits(&tracer, &rays, [x, y]).iter().filter(|hit| seen(hit)).count();
            [length(x, y).min(LAYERS as usize + 1), exact]
        })
        .collect();
    let unlike = |more: usize| {
        let unlike = counts.iter().filter(|[listed, exact]| listed + more != *exact).count();
        unlike as f64 / counts.len() as f64
    };
    let fragments: usize = counts.iter().map(|[listed, _]| listed).sum();
    // At silhouettes, and where surfaces touch, a ray meets one more or fewer.
    Ok(Check::of(
        lists::INFO.name,
        format!("scene {name}: share of lists unlike the surfaces behind the pixel"),
    )
    .within((0.1, "1"), unlike(0))
    .control("each list one longer", unlike(1))
    .with("fragments_per_pixel", fragments as f64 / counts.len() as f64))
}

/// Layers from lists against peeled ones.
fn sorted(rig: &Rig<'_>, name: &str) -> Result<Check> {
    let setup = Setup::new(rig, name, LAYERS)?;
    let rig::Stand { shared, geometry, .. } = &setup.stand;
    let peeled = read_volume(rig.gpu, &setup.layers.depths, 0)?.data;
    let unlike = |room: u32| -> Result<f64> {
        let lists = lists::new(&rig.resources, shared, (geometry, Part::Solid), SIZE, room)?;
        let sort = sort::new(&rig.resources, &lists, LAYERS)?;
        rig.run(&[&lists, &sort])?;
        let sorted = read_volume(rig.gpu, &sort.depths, 0)?.data;
        let unlike = peeled.iter().zip(&sorted).filter(|(a, b)| a != b).count();
        Ok(unlike as f64 / peeled.len() as f64)
    };
    Ok(Check::of(sort::INFO.name, format!("scene {name}: share of texels unlike the peeled ones"))
        .within((1e-3, "1"), unlike(ROOM)?)
        .control("room for one fragment a pixel", unlike(1)?))
}

/// Where a method ends the photons against rays cast from the same places in the same directions, and by the paper's tolerance
/// against the surfaces behind each pixel.
fn ends(rig: &Rig<'_>, name: &str, stage: &'static str, method: Method) -> Checks {
    let setup = Setup::new(rig, name, LAYERS)?;
    let tracer = Tracer::new(&setup.scene.objects)?;
    let exact = setup.exact(&tracer, 0.0);
    let turned = setup.exact(&tracer, 0.02);
    let crossing = setup.trace(rig, method, HitTest::Crossing)?;
    let tolerant = setup.trace(rig, method, HitTest::Tolerance)?;
    let median = |exact: &[Option<DVec3>]| {
        let landed = crossing.iter().zip(exact).filter(|(found, _)| found.landed());
        let off = landed.filter_map(|(found, exact)| Some(found.hit.distance((*exact)?)));
        quantile(&mut off.collect::<Vec<_>>(), 0.5)
    };
    let lost = |found: &[StoredPhoton]| {
        let in_view = || found.iter().zip(&exact).filter(|(_, exact)| exact.is_some());
        let lost = in_view().filter(|(found, _)| !found.landed()).count();
        lost as f64 / in_view().count() as f64
    };
    let wrong = |found: &[StoredPhoton]| {
        let landed = found.iter().zip(&exact).filter(|(found, _)| found.landed());
        let off = landed.filter_map(|(found, exact)| Some(found.hit.distance((*exact)?)));
        let off: Vec<f64> = off.collect();
        off.iter().filter(|off_m| **off_m > WRONG_M).count() as f64 / off.len() as f64
    };
    let from_surface = |moved_m: f64| {
        let landed = tolerant.iter().zip(&setup.stored).filter(|(found, _)| found.landed());
        let off = landed.map(|(found, transfer)| {
            let place = found.hit + moved_m * transfer.direction.as_dvec3();
            from_surfaces_m(&tracer, &setup.stand.view.camera, place)
        });
        quantile(&mut off.collect::<Vec<_>>(), 0.95)
    };
    // Rasterizers move corners by up to 1/32 of a pixel, and with them the layers: some millimetres where surfaces are slanted.
    Ok(vec![
        Check::of(stage, format!("scene {name}: median |hit − ray casting|"))
            .within((TOLERANCE_M, "m"), median(&exact))
            .control("rays turned by 1.1 degrees", median(&turned)),
        Check::of(stage, format!("scene {name}: share of photons in view that are lost"))
            .within((0.05, "1"), lost(&crossing))
            .control("by the paper's tolerance of 0.01", lost(&tolerant)),
        Check::of(stage, format!("scene {name}: share of photons in view that end over 0.1 m off"))
            .within((0.15, "1"), wrong(&crossing))
            .control("by the paper's tolerance of 0.01", wrong(&tolerant)),
        Check::of(stage, format!("scene {name}: tolerance 0.01: 95th percentile of |hit − surface| along the line of sight"))
            .within((1.3 * TOLERANCE_M, "m"), from_surface(0.0))
            .control("hits 5 cm further", from_surface(0.05)),
    ])
}

/// Difference of a place's view depth from that of the nearest surface behind its pixel, as a way along the line of sight.
fn from_surfaces_m(tracer: &Tracer, camera: &Camera, place: DVec3) -> f64 {
    let rays = PixelRays::new(camera, SIZE[0], SIZE[1]);
    let Some(seen) = rays.project(place) else { return f64::NAN };
    let pixel = [(seen.x_px, SIZE[0]), (seen.y_px, SIZE[1])]
        .map(|(at, side)| (at.floor() as u32).min(side - 1));
    let view_m = |place: DVec3| (place - camera.position()).dot(camera.direction());
    let off =
        all_hits(tracer, &rays, pixel).into_iter().map(|hit| (view_m(hit) - view_m(place)).abs());
    off.fold(f64::INFINITY, f64::min) * place.distance(camera.position()) / view_m(place)
}

/// Rows and reduction, in one tile and in several, and workgroups, against marching.
fn alike(rig: &Rig<'_>, name: &str) -> Checks {
    let setup = Setup::new(rig, name, LAYERS)?;
    let mut checks = Vec::new();
    for test in [HitTest::Crossing, HitTest::Tolerance] {
        let marched = setup.trace(rig, Method::March, test)?;
        let others = [
            ("rows of one tile", Method::Lines { rows: 8192 }),
            ("rows of several tiles", Method::Lines { rows: FEW_ROWS }),
            ("workgroups", Method::Group),
        ];
        for (other, method) in others {
            let found = setup.trace(rig, method, test)?;
            let differing = |shifted: usize| {
                let pairs = found.iter().zip(marched.iter().cycle().skip(shifted));
                let differs = |(a, b): &(&StoredPhoton, &StoredPhoton)| {
                    a.residual_m != b.residual_m || (a.distance_m - b.distance_m).abs() > 1e-3
                };
                pairs.filter(differs).count() as f64 / found.len() as f64
            };
            let what =
                format!("scene {name}, {test:?}: share of photons that {other} end elsewhere");
            checks.push(
                Check::of(reduce::INFO.name, what)
                    .within((0.0, "1"), differing(0))
                    .control("each photon held against the next", differing(1)),
            );
        }
    }
    Ok(checks)
}
