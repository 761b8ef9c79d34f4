//! `caustics/trace` in light of 0° to 80° to the vertical, against exact refraction and ray casting.

use super::photons::{Traced, in_frustum, settings};
use crate::prelude::*;
use fathom_stages::caustics;

const DEPTH_M: f64 = 5.0;
/// Half the width of the floor and of the water: where light of 80° enters, most of it sees no floor straight ahead.
const HALF_M: f64 = 25.0;
/// Slope of the slanted floor, which stays below the water.
const RISE: f64 = 0.15;
/// Azimuth of the light, degrees: along no axis of the scene.
const AZIMUTH_DEG: f64 = 20.0;
/// Half the width of the light's frustum, and where its middle lies: off the scene's.
const HALF_EXTENT_M: f64 = 4.0;
const MIDDLE: DVec3 = DVec3::new(1.7, -2.5, 0.4);
/// How far a point light stands above the water.
const LAMP_M: f64 = 6.0;
/// Amplitude of waves, whose length is 1.5 m.
const WAVES_M: f64 = 0.02;
/// Amplitude of waves as steep as those of scene `plane`: 12°.
const STEEP_WAVES_M: f64 = 0.05;
/// Light that meets steep waves more than once, or nearly.
const GRAZING: [f64; 3] = [60.0, 70.0, 80.0];
/// Share of the photons that enter the water more than [`CONVERGED_M`] from the exact place: where a ray touches a crest, 32-bit floats decide.
const ENTER_WRONG: f64 = 1e-3;
/// Cells per side of the photon grid, four photons a cell.
const CELLS: u32 = 32;
/// Median distance of a photon's end from the exact one.
const MEDIAN_M: f64 = 1e-3;
/// Share of the photons that land in the light's frustum and that the estimator loses.
const LOST: f64 = 0.0;

/// Share of those that count as converged and are off by more than the tolerance: within a texel of the light's depth about an edge.
const FALSE: f64 = 0.01;
/// Light in which the paper's estimator still lands photons, and already fails.
const CONTROL_DEG: f64 = 70.0;

/// What lies under the water.
#[derive(Clone, Copy, PartialEq)]
enum Floor {
    Level,
    /// Rises away from the light.
    Slanted,
    /// A step of 1 m.
    Stepped,
    /// A slab of 0.6 m over a level floor.
    Covered,
}

impl Floor {
    const ALL: [(Floor, &'static str); 4] = [
        (Floor::Level, "level floor"),
        (Floor::Slanted, "slanted floor"),
        (Floor::Stepped, "stepped floor"),
        (Floor::Covered, "slab over a floor"),
    ];

    fn objects(self) -> Vec<Object> {
        let across = |x: f64, y: f64, side: DVec3| {
            Mesh::parallelogram(DVec3::new(x, y, 0.0), DVec3::Z * HALF_M, side)
        };
        let whole = across(0.0, -DEPTH_M, DVec3::X * HALF_M);
        let meshes = match self {
            Floor::Level => vec![whole],
            Floor::Slanted => vec![across(0.0, -DEPTH_M, DVec3::new(HALF_M, RISE * HALF_M, 0.0))],
            Floor::Stepped => {
                let step = |x, y| across(x * HALF_M, y, DVec3::X * 0.5 * HALF_M);
                let riser = across(0.0, 0.5 - DEPTH_M, DVec3::Y * 0.5);
                vec![step(-0.5, -DEPTH_M), step(0.5, 1.0 - DEPTH_M), riser]
            }
            Floor::Covered => {
                let middle = DVec3::Y * (0.6 - DEPTH_M);
                vec![whole, Mesh::parallelogram(middle, DVec3::Z * 0.8, DVec3::X * 0.8)]
            }
        };
        meshes.into_iter().map(|mesh| Object::new("floor", mesh)).collect()
    }
}

/// Angles of the light to the vertical, degrees.
const ANGLES: [f64; 9] = [0.0, 10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 70.0, 80.0];
const STAGE: &str = caustics::trace::INFO.name;

pub fn cases() -> Vec<Case> {
    let case = |what: String, setup: Setup| {
        let title = format!("light of 0° to 80°, {what}");
        Case::new(STAGE, title.clone(), move |rig| setup.checks(rig, &title))
    };
    let still = Setup { kind: LightKind::Directional, floor: Floor::Level, amplitude_m: 0.0 };
    let floors = Floor::ALL.map(|(floor, what)| case(what.to_owned(), Setup { floor, ..still }));
    let mut cases = Vec::from(floors);
    cases.push(case("point light".to_owned(), Setup { kind: LightKind::Point, ..still }));
    cases.push(case("waves".to_owned(), Setup { amplitude_m: WAVES_M, ..still }));
    cases.push(Case::new(STAGE, "light of 60° to 80°, steep waves", move |rig| {
        Setup { amplitude_m: STEEP_WAVES_M, ..still }.grazing(rig)
    }));
    cases.push(Case::new(STAGE, "light of 0° to 60°, the paper's estimator", move |rig| {
        let median_m = |method| {
            let ends = ANGLES[..7].iter().map(|degrees| still.ends(rig, *degrees, method));
            Ok::<_, VerifyError>(most(&ends.collect::<Result<Vec<_>>>()?, |ends| ends.median_m))
        };
        Ok(Check::of(rig, "paper's estimator, light of 0° to 60°: largest median |hit − exact|")
            .within((MEDIAN_M, "m"), median_m(PAPER_MANY)?)
            .control("6 iterations", median_m(PAPER_SIX)?))
    }));
    cases
}

/// One kind of light over one floor.
#[derive(Clone, Copy)]
struct Setup {
    kind: LightKind,
    floor: Floor,
    amplitude_m: f64,
}

impl Setup {
    /// The scene in light that comes at an angle to the vertical in the middle of its frustum.
    fn scene(&self, degrees: f64) -> Result<Scene> {
        let mut scene = rig::flat_plane(self.kind)?;
        let (angle, azimuth) = (degrees.to_radians(), AZIMUTH_DEG.to_radians());
        let across = DVec3::new(azimuth.cos(), 0.0, azimuth.sin());
        let direction = angle.sin() * across - angle.cos() * DVec3::Y;
        let above_m = (LAMP_M - MIDDLE.y) / angle.cos();
        let eye = MIDDLE + DVec3::Z * 6.0;
        scene.objects = self.floor.objects();
        let of_objects = scene.objects.iter().map(|object| object.mesh.bounds());
        let rim = Bounds {
            min: DVec3::new(-HALF_M, -0.25, -HALF_M),
            max: DVec3::new(HALF_M, 0.25, HALF_M),
        };
        scene.bounds = of_objects.fold(rim, Bounds::union);
        scene.water.half_size_m = [HALF_M; 2];
        scene.water.amplitude_m = self.amplitude_m;
        scene.camera = Camera::new(eye.to_array(), MIDDLE.to_array(), 60.0, [0.1, 11.9]);
        scene.light.direction = direction.to_array();
        scene.light.position_m = (MIDDLE - direction * above_m).to_array();
        scene.light.half_extent_m = HALF_EXTENT_M;
        Ok(scene)
    }

    fn trace(
        &self,
        rig: &Rig<'_>,
        degrees: f64,
        (estimator, iterations): Method,
    ) -> Result<Traced> {
        let scene = self.scene(degrees)?;
        let uniforms = TraceUniforms {
            estimator: estimator as u32,
            iterations,
            bottom_m: scene.bounds.min.y as f32 - 0.01,
            // Nothing stands above the water, and the mask has texels of up to 0.7 m at the water's rim.
            masked: 0,
            ..settings(CELLS, 2)
        };
        Traced::new(rig, scene, uniforms)
    }

    /// The photons of this setup against exact ones.
    fn ends(&self, rig: &Rig<'_>, degrees: f64, method: Method) -> Result<Ends> {
        let traced = self.trace(rig, degrees, method)?;
        Ok(Ends::new(&traced, &traced.exact(&traced.stand.scene.water, &traced.stand.tracer)))
    }

    /// In grazing light: where photons land, which are lost, and where they enter the water.
    fn grazing(&self, rig: &Rig<'_>) -> Checks {
        let what = "light of 60° to 80°, steep waves";
        let (mut ends, mut wrong, mut newtons) = (Vec::new(), Vec::new(), Vec::new());
        for degrees in GRAZING {
            let traced = self.trace(rig, degrees, SECANT)?;
            let water = &traced.stand.scene.water;
            let landings = traced.exact(water, &traced.stand.tracer);
            let newton = (0..traced.grid.count()).map(|index| {
                let ray = traced.frame.photon_ray(traced.grid.ndc(index));
                Some(three_newton_steps(water, ray))
            });
            let entered = |p: &StoredPhoton| (p.residual_m != f64::from(MISSED)).then_some(p.entry);
            wrong.push(enter_wrong(traced.photons.iter().map(entered), &landings));
            newtons.push(enter_wrong(newton, &landings));
            ends.push(Ends::new(&traced, &landings));
        }
        let paper = self.ends(rig, CONTROL_DEG, PAPER_SIX)?;
        Ok(vec![
            Check::of(rig, format!("{what}: largest share that enters off the first place"))
                .within((ENTER_WRONG, "1"), largest(wrong))
                .control("three steps of Newton's method at 80°", newtons[GRAZING.len() - 1]),
            Check::of(rig, format!("{what}: largest median |hit − exact|"))
                .within((MEDIAN_M, "m"), most(&ends, |ends| ends.median_m))
                .control(PAPER, paper.median_m),
            Check::of(rig, format!("{what}: largest share lost in the light's frustum"))
                .within((LOST, "1"), most(&ends, |ends| ends.lost))
                .control(PAPER, paper.lost),
        ])
    }

    fn checks(&self, rig: &Rig<'_>, what: &str) -> Checks {
        let found = ANGLES.iter().map(|degrees| self.ends(rig, *degrees, SECANT));
        let found = found.collect::<Result<Vec<Ends>>>()?;
        let paper = self.ends(rig, CONTROL_DEG, PAPER_SIX)?;
        let fewest = found.iter().map(|ends| ends.count as f64).fold(f64::INFINITY, f64::min);
        let check = |of: &str| Check::of(rig, format!("{what}: {of}"));
        let mut checks = vec![
            check("largest median |hit − exact|")
                .within((MEDIAN_M, "m"), most(&found, |ends| ends.median_m))
                .control(PAPER, paper.median_m)
                .with("p99_m", most(&found, |ends| ends.p99_m))
                .with("unconverged_rate", most(&found, |ends| ends.unconverged))
                .with("fewest_photons", fewest),
            check("largest share lost of what lands in the light's frustum")
                .within((LOST, "1"), most(&found, |ends| ends.lost))
                .control(PAPER, paper.lost),
        ];
        if self.floor == Floor::Covered {
            let traced = self.trace(rig, CONTROL_DEG, SECANT)?;
            let level = Tracer::new(&Floor::Level.objects());
            let bare = Ends::new(&traced, &traced.exact(&traced.stand.scene.water, &level));
            checks.push(
                check("largest share that counts as converged and is off")
                    .within((FALSE, "1"), most(&found, |ends| ends.falsely_converged))
                    .control("no slab", bare.falsely_converged),
            );
        }
        Ok(checks)
    }
}

/// An estimator and its iterations.
type Method = (PhotonEstimator, u32);

const SECANT: Method = (PhotonEstimator::Secant, 8);
/// As many iterations as the default was before they followed from the light.
const PAPER_SIX: Method = (PhotonEstimator::Paper, 6);
/// Enough at 60°.
const PAPER_MANY: Method = (PhotonEstimator::Paper, 20);
/// What controls hold against the exact photons.
const PAPER: &str = "the paper's estimator at 70°, 6 iterations";

/// Of the photons that enter the water the share that enters more than [`CONVERGED_M`] from the exact place, or not at all.
fn enter_wrong(entries: impl Iterator<Item = Option<DVec3>>, landings: &[Landing]) -> f64 {
    share(entries.zip(landings).filter_map(|(entry, landing)| {
        let exact = match landing {
            Landing::Landed(landed) => landed.entry.position,
            Landing::Leaves { entry, .. } => entry.position,
            Landing::Blocked | Landing::MissesWater => return None,
        };
        Some(entry.is_none_or(|entry| entry.distance(exact) > CONVERGED_M))
    }))
}

/// Where three steps of Newton's method from the resting water take a ray.
pub fn three_newton_steps(water: &Water, (origin, direction): (DVec3, DVec3)) -> DVec3 {
    let from_rest = -origin.y / direction.y;
    let t = (0..3).fold(from_rest, |t, _| {
        let p = origin + t * direction;
        let slope = water.gradient(p.x, p.z);
        let across = slope.x * direction.x + slope.y * direction.z;
        t + (water.height(p.x, p.z) - p.y) / (direction.y - across)
    });
    origin + t * direction
}

/// The largest of a figure.
fn most(ends: &[Ends], figure: fn(&Ends) -> f64) -> f64 {
    largest(ends.iter().map(figure))
}

/// Photons that land within the light's frustum, against exact ones.
struct Ends {
    median_m: f64,
    p99_m: f64,
    /// Shares of all that land there.
    lost: f64,
    unconverged: f64,
    /// Those that count as converged, and are off by more than the tolerance.
    falsely_converged: f64,
    count: usize,
}

impl Ends {
    fn new(traced: &Traced, landings: &[Landing]) -> Ends {
        let held = traced.photons.iter().zip(landings).filter_map(|(photon, landing)| {
            let end = landing.landed()?.hit.position;
            in_frustum(&traced.frame, end).then_some((photon, photon.hit.distance(end)))
        });
        let held: Vec<(&StoredPhoton, f64)> = held.collect();
        let of = |what: fn(&StoredPhoton, f64) -> bool| {
            share(held.iter().map(|(photon, error_m)| what(photon, *error_m)))
        };
        let landed = held.iter().filter(|(photon, _)| photon.landed());
        let errors: Vec<f64> = landed.map(|(_, error_m)| *error_m).collect();
        Ends {
            median_m: median(errors.iter().copied()),
            p99_m: percentile::<99>(errors),
            lost: of(|photon, _| !photon.landed()),
            unconverged: of(|photon, _| photon.landed() && !photon.converged()),
            falsely_converged: of(|photon, error_m| photon.converged() && error_m > CONVERGED_M),
            count: held.len(),
        }
    }
}
