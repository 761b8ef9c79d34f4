//! Stages of screen-space photon tracing against exact refraction, sorted depths and ray casting.

mod bounces;

use crate::prelude::*;
use fathom_pipelines::screen_tracing::{self, Method, RaySettings};
use fathom_stages::kit::Resources;
use fathom_stages::rays::reduce;
use std::iter::successors;

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
/// A ray cast from a stored position starts this far from it, metres.
const OFF_M: f64 = 1e-6;

pub fn cases() -> Vec<Case> {
    let mut cases = vec![Case::new(map::INFO.name, "positions and directions", transfers)];
    let kinds = [LightKind::Directional, LightKind::Point];
    let what = |kind| format!("weights, {kind:?} light");
    cases.extend(Case::each(map::INFO.name, kinds, what, weights));
    cases.extend(Case::each(peel::INFO.name, SCENES, |name| format!("scene {name}"), layers));
    for name in SCENES {
        for how in METHODS {
            let what = format!("scene {name}");
            cases.push(Case::new(how.0.info().name, what, move |rig| ends(rig, name, how)));
        }
    }
    let scenes = SCENES.into_iter().chain(PAPER_SCENES);
    let what = |name| format!("scene {name}: photon by photon as marched");
    cases.extend(Case::each(reduce::INFO.name, scenes, what, alike));
    cases.extend(bounces::cases());
    cases
}

/// What finds the ends of rays, and the rows of its target.
type How = (Method, u32);

const MARCH: How = (Method::March, 1);
const METHODS: [How; 2] = [(Method::Lines, FEW_ROWS), MARCH];

/// A scene with its layers and the photons behind its water.
struct Setup {
    stand: Stand,
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
        let stand = rig.stand(scene, SIZE)?;
        let Stand { scene, shared, geometry, .. } = &stand;
        let depth = shadow::depth::new(rig, shared, geometry, 512)?;
        let mask = shadow::mask::new(rig, shared, depth.texture(), 64)?;
        let settings = rig::light_grid(GRID);
        let map = map::new(rig, shared, mask.texture(), &settings)?;
        let peel = peel::new(rig, shared, scene, (geometry, Part::Solid), SIZE, layers)?;
        rig.run(&[&depth, &mask, &map, &peel])?;
        let stored = rig.read(&map.transfers.buffer)?;
        let weights = rig.read(&map.weights)?;
        let (layers, transfers) = (peel.left, map.left.transfers);
        Ok(Setup { stand, layers, transfers, stored, weights })
    }

    fn trace(&self, rig: &Rig<'_>, how: How, test: HitTest) -> Result<Vec<StoredPhoton>> {
        self.trace_ways(rig, how, test, 1)
    }

    /// Several ways use the transfer map up.
    fn trace_ways(
        &self,
        rig: &Rig<'_>,
        (method, rows): How,
        test: HitTest,
        ways: u32,
    ) -> Result<Vec<StoredPhoton>> {
        let settings =
            RaySettings { method, test, tolerance_m: TOLERANCE_M, start_m: 0.0, least_px: 8, rows };
        let walking = settings.walking(rig.gpu, ways);
        let rays = Rays {
            transfers: &self.transfers,
            layers: &self.layers,
            bounds: self.stand.scene.solid_bounds(),
            walking,
        };
        let resources = Resources::new(rig.gpu);
        let photons = screen_tracing::trace(&resources, &self.stand.shared, &rays, method)?;
        let stages = resources.into_parts().stages;
        rig.gpu.run(&stages.iter().map(AsRef::as_ref).collect::<Vec<&Stage>>())?;
        Ok(rig.read_photons(&photons)?)
    }

    /// Where each photon that is alive ends exactly, where that is in view.
    fn exact(&self, turned: f64) -> Vec<Option<DVec3>> {
        let end = |transfer: &Transfer| {
            let [origin, direction] =
                [transfer.position_m, transfer.direction].map(|v| v.as_dvec3());
            let direction = (direction + turned * DVec3::X).normalize();
            let hit = self.stand.tracer.cast(origin, direction, OFF_M, f64::MAX)?;
            Some(hit.position).filter(|place| self.stand.in_view(*place))
        };
        self.stored.iter().map(|t| if t.state > NEVER { end(t) } else { None }).collect()
    }

    /// Photons that are alive: their numbers, what is stored of them, and their rays before the water.
    fn alive(&self) -> impl Iterator<Item = (usize, &Transfer, (DVec3, DVec3))> {
        let frame = self.stand.view.light_frame();
        let alive = (0..).zip(&self.stored).filter(|(_, stored)| stored.state > NEVER);
        alive.map(move |(number, stored)| {
            (number as usize, stored, rig::grid_ray(&frame, number, GRID))
        })
    }
}

/// The transfer map against the exact entry and Snell's law.
fn transfers(rig: &Rig<'_>) -> Checks {
    let setup = Setup::new(rig, "tank", 1)?;
    let water = &setup.stand.scene.water;
    let off = |a: Option<DVec3>, b: Vec3| a.map_or(f64::NAN, |a| a.distance(b.as_dvec3()));
    let places = |water: &Water| {
        percentile::<99>(setup.alive().map(|(_, stored, (origin, incident))| {
            let entry = enter(water, origin, incident, f64::MAX);
            off(entry.map(|e| e.position), stored.position_m)
        }))
    };
    let directions = |index: f64| {
        percentile::<99>(setup.alive().map(|(_, stored, (origin, incident))| {
            let entry = enter(water, origin, incident, f64::MAX);
            off(entry.and_then(|e| refract(incident, e.normal, 1.0, index)), stored.direction)
        }))
    };
    let higher = Water { amplitude_m: 1.1 * water.amplitude_m, ..water.clone() };
    Ok(vec![
        // The noise texture is interpolated between texels.
        Check::of(rig, "99th percentile of |entry − exact entry|")
            .within((1e-3, "m"), places(water))
            .control("waves 10 % higher", places(&higher)),
        Check::of(rig, "99th percentile of |direction − Snell's|")
            .within((5e-3, "1"), directions(water.refractive_index))
            .control("refractive index 3 % higher", directions(1.03 * water.refractive_index)),
    ])
}

/// Weights of photons against the solid angle of their share of the light's screen and Fresnel's transmittance.
fn weights(rig: &Rig<'_>, kind: LightKind) -> Result<Check> {
    let mut scene = rig::flat_plane(kind)?;
    scene.water.amplitude_m = 0.05;
    scene.water.fresnel = true;
    let setup = Setup::of(rig, scene, 1)?;
    let water = &setup.stand.scene.water;
    let forward = setup.stand.view.light_frame().forward;
    let error = |fresnel: bool| {
        percentile::<99>(setup.alive().filter_map(|(number, _, (origin, incident))| {
            let entry = enter(water, origin, incident, f64::MAX)?;
            let cosine = incident.dot(entry.normal).abs();
            let passes = fresnel_transmittance(cosine, 1.0, water.refractive_index);
            let angular = match kind {
                LightKind::Directional => 1.0,
                LightKind::Point => incident.dot(forward).powi(3),
            };
            let exact = angular * if fresnel { passes } else { 1.0 };
            Some(relative_error(setup.weights[number].into(), exact))
        }))
    };
    Ok(Check::of(rig, format!("{kind:?}: 99th percentile of the weight's relative error"))
        .within((2e-3, "1"), error(true))
        .control("without Fresnel's transmittance", error(false)))
}

/// A pixel in every seventh row and column.
fn sparse_pixels() -> impl Iterator<Item = (u32, u32)> {
    pixels(SIZE).filter(|(x, y)| x % 7 == 3 && y % 7 == 3)
}

/// Where a pixel's ray meets surfaces, the nearest first, one more than there are layers at most.
fn all_hits(stand: &Stand, (x, y): (u32, u32)) -> impl Iterator<Item = DVec3> {
    let (origin, direction, _) = stand.rays.ray(x, y);
    let next = move |from_m: f64| stand.tracer.cast(origin, direction, from_m, f64::MAX);
    let hits = successors(next(0.0), move |hit| next(hit.distance_m + OFF_M));
    hits.take(LAYERS as usize + 1).map(|hit| hit.position)
}

/// Their depths.
fn all_depths(stand: &Stand, pixel: (u32, u32)) -> impl Iterator<Item = f64> {
    all_hits(stand, pixel).filter_map(|hit| Some(stand.rays.project(hit)?.depth))
}

/// Peeled depths against all hits along each pixel's ray, sorted.
fn layers(rig: &Rig<'_>, name: &str) -> Result<Check> {
    let setup = Setup::new(rig, name, LAYERS)?;
    let peeled = read_volume(rig.gpu, &setup.layers.depths, 0)?;
    let texel = |(x, y): (u32, u32), layer: usize| {
        let row = y as usize + layer * SIZE[1] as usize;
        f64::from(peeled.data[x as usize + row * SIZE[0] as usize])
    };
    let chosen: Vec<((u32, u32), Vec<f64>)> =
        sparse_pixels().map(|at| (at, all_depths(&setup.stand, at).collect())).collect();
    let view_m = |z: f64| setup.stand.view.camera.view_depth_m(z);
    let errors = |behind: usize| {
        percentile::<90>(chosen.iter().flat_map(|(at, exact)| {
            (0..LAYERS as usize).filter_map(move |layer| {
                let z = texel(*at, layer);
                match (z < 1.0, exact.get(layer + behind).filter(|z| **z < 1.0)) {
                    (true, Some(exact)) => Some(relative_error(view_m(z), view_m(*exact))),
                    (false, None) => None,
                    _ => Some(1.0),
                }
            })
        }))
    };
    let what = "90th percentile of the layers' depth errors, of the distance";
    // At silhouettes, and where surfaces touch, another one may be next.
    Ok(Check::of(rig, format!("scene {name}: {what}"))
        .within((5e-3, "1"), errors(0))
        .control("each layer held against the next", errors(1)))
}

/// Where a method ends the photons against rays cast from the same places in the same directions, and by the paper's tolerance
/// against the surfaces behind each pixel.
fn ends(rig: &Rig<'_>, name: &str, how: How) -> Checks {
    let setup = Setup::new(rig, name, LAYERS)?;
    let (exact, turned) = (setup.exact(0.0), setup.exact(0.02));
    let crossing = setup.trace(rig, how, HitTest::Crossing)?;
    let tolerant = setup.trace(rig, how, HitTest::Tolerance)?;
    // Of the photons that land and land exactly.
    let off = |found: &[StoredPhoton], exact: &[Option<DVec3>]| -> Vec<f64> {
        let landed = found.iter().zip(exact).filter(|(found, _)| found.landed());
        landed.filter_map(|(found, exact)| Some(found.hit.distance((*exact)?))).collect()
    };
    let lost = |found: &[StoredPhoton]| {
        let in_view = found.iter().zip(&exact).filter(|(_, exact)| exact.is_some());
        share(in_view.map(|(found, _)| !found.landed()))
    };
    let wrong =
        |found: &[StoredPhoton]| share(off(found, &exact).iter().map(|off_m| *off_m > WRONG_M));
    let from_surface = |moved_m: f64| {
        let landed = tolerant.iter().zip(&setup.stored).filter(|(found, _)| found.landed());
        percentile::<95>(landed.map(|(found, transfer)| {
            let place = found.hit + moved_m * transfer.direction.as_dvec3();
            from_surfaces_m(&setup.stand, place)
        }))
    };
    let check = |what: &str| Check::of(rig, format!("scene {name}: {what}"));
    let of_surface = "tolerance 0.01: 95th percentile of |hit − surface| along the line of sight";
    // Rasterizers move corners by up to 1/32 of a pixel, and with them the layers: some millimetres where surfaces are slanted.
    Ok(vec![
        check("median |hit − ray casting|")
            .within((TOLERANCE_M, "m"), median(off(&crossing, &exact)))
            .control("rays turned by 1.1 degrees", median(off(&crossing, &turned))),
        check("share of photons in view that are lost")
            .within((0.05, "1"), lost(&crossing))
            .control("by the paper's tolerance of 0.01", lost(&tolerant)),
        check("share of photons in view that end over 0.1 m off")
            .within((0.15, "1"), wrong(&crossing))
            .control("by the paper's tolerance of 0.01", wrong(&tolerant)),
        check(of_surface)
            .within((1.3 * TOLERANCE_M, "m"), from_surface(0.0))
            .control("hits 5 cm further", from_surface(0.05)),
    ])
}

/// Difference of a place's view depth from that of the nearest surface behind its pixel, as a way along the line of sight.
fn from_surfaces_m(stand: &Stand, place: DVec3) -> f64 {
    let Some(seen) = stand.rays.project(place) else { return f64::NAN };
    let pixel = |at: f64, side: u32| (at.floor() as u32).min(side - 1);
    let pixel = (pixel(seen.x_px, SIZE[0]), pixel(seen.y_px, SIZE[1]));
    let camera = &stand.view.camera;
    let view_m = |place: DVec3| (place - camera.position()).dot(camera.direction());
    let off = all_hits(stand, pixel).map(|hit| (view_m(hit) - view_m(place)).abs());
    off.fold(f64::INFINITY, f64::min) * place.distance(camera.position()) / view_m(place)
}

/// Rows and reduction, in one tile and in several, against marching.
fn alike(rig: &Rig<'_>, name: &str) -> Checks {
    let setup = Setup::new(rig, name, LAYERS)?;
    let mut checks = Vec::new();
    for test in [HitTest::Crossing, HitTest::Tolerance] {
        let marched = setup.trace(rig, MARCH, test)?;
        let others = [
            ("rows of one tile", (Method::Lines, 8192)),
            ("rows of several tiles", (Method::Lines, FEW_ROWS)),
        ];
        for (other, how) in others {
            let found = setup.trace(rig, how, test)?;
            let elsewhere = |shifted: usize| {
                share(found.iter().zip(marched.iter().cycle().skip(shifted)).map(|(a, b)| {
                    a.residual_m != b.residual_m || (a.distance_m - b.distance_m).abs() > 1e-3
                }))
            };
            let what =
                format!("scene {name}, {test:?}: share of photons that {other} end elsewhere");
            checks.push(
                Check::of(rig, what)
                    .within((0.0, "1"), elsewhere(0))
                    .control("each photon held against the next", elsewhere(1)),
            );
        }
    }
    Ok(checks)
}
