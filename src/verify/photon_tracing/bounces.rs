//! Photons behind mirrors and glass against exact ray casting.

use super::*;
use fathom_reference::specular::{End, Surfaces};
use fathom_scene::Material;
use fathom_stages::transfer::bounce;

/// Mirrors and surfaces of glass that a photon may leave.
const BOUNCES: u32 = 4;
/// Turns of a level mirror about y, x and z, degrees.
const TILTS_DEG: [[f64; 3]; 5] = [
    [0.0, 58.0, 0.0],
    [-33.0, 52.0, 14.0],
    [-75.0, 61.0, 0.0],
    [-50.0, 74.0, -30.0],
    [20.0, 66.0, 37.0],
];

pub fn cases() -> Vec<Case> {
    let of = |what: &str, how: How, view| {
        let name = format!("{what}, by {}", how.0.info().name);
        Case::new(bounce::INFO.name, name, move |rig| bounced(rig, view, how))
    };
    let mut cases = Vec::from(METHODS.map(|how| of("behind mirror and glass", how, View::Level)));
    cases.push(of("behind mirror and glass, camera turned", MARCH, View::Turned));
    cases.push(Case::new(bounce::INFO.name, "tilted mirrors", tilted_mirrors));
    cases
}

/// How the camera looks at mirror and glass.
#[derive(Clone, Copy, Debug)]
enum View {
    Level,
    /// Rolled and from above, with the glass off the picture's middle.
    Turned,
}

impl View {
    fn of(self, level: Camera, floor_y: f64) -> Camera {
        let camera = Camera {
            position_m: [0.3, floor_y + 3.0, 4.6],
            target_m: [0.0, floor_y + 0.5, 0.0],
            ..level
        };
        match self {
            Self::Level => camera,
            Self::Turned => Camera {
                position_m: [-2.4, floor_y + 3.4, 3.3],
                target_m: [0.2, floor_y + 0.2, -0.5],
                up: [0.4, 1.0, -0.2],
                ..camera
            },
        }
    }
}

/// A square mirror by its middle, and half its sides, the first times the second of which points outwards.
fn mirror(middle: DVec3, [a, b]: [DVec3; 2]) -> Object {
    let mut mirror = Object::new("mirror", Mesh::parallelogram(middle, a, b));
    mirror.material.optics = Optics::Mirror;
    mirror
}

/// A slanted mirror, whose outer side the light meets, and a ball of glass over a floor.
fn mirror_and_glass(view: View) -> Result<Scene> {
    let mut scene = rig::flat_plane(LightKind::Directional)?;
    let floor_y = scene.objects[0].mesh.bounds().max.y;
    let slanted = [DVec3::new(0.56, 0.0, 0.75), DVec3::new(0.26, 0.88, -0.2)];
    scene.objects.push(mirror(DVec3::new(-1.1, floor_y + 1.0, 0.0), slanted));
    let ball = Scene::load("ball")?.objects.into_iter().filter(|object| object.name == "ball");
    scene.objects.extend(ball.map(|mut ball| {
        let lowest = ball.mesh.bounds().min.y;
        let lift = DVec3::new(1.1, floor_y + 0.3 - lowest, 0.2);
        ball.mesh = ball.mesh.transformed(&DMat4::from_translation(lift));
        ball.material =
            Material { optics: Optics::Glass, alpha: 0.2, refractive_index: 1.7, ..ball.material };
        ball
    }));
    scene.camera = view.of(scene.camera, floor_y);
    scene.light.half_extent_m = 2.5;
    Ok(scene)
}

/// A photon that meets a mirror or glass first and then ends in view, by exact ray casting.
struct Exact {
    number: usize,
    first: Hit,
    end: DVec3,
}

impl Exact {
    fn all(setup: &Setup, optics: Optics) -> Vec<Exact> {
        let stand = &setup.stand;
        let surfaces = Surfaces {
            tracer: &stand.tracer,
            objects: &stand.scene.objects,
            outside: stand.scene.water.refractive_index,
            top_m: 0.0,
        };
        let exact = |(number, transfer): (usize, &Transfer)| {
            let [origin, along] = [transfer.position_m, transfer.direction].map(|v| v.as_dvec3());
            let ray = surfaces.ray(origin, along.normalize());
            let first = surfaces.meet(&ray)?;
            let End::Diffuse(hit) = surfaces.follow(ray, BOUNCES) else { return None };
            let meets = stand.scene.objects[first.object].material.optics == optics;
            let is_judged = meets && stand.in_view(hit.position);
            is_judged.then_some(Exact { number, first, end: hit.position })
        };
        let alive = setup.stored.iter().enumerate().filter(|(_, t)| t.state > NEVER);
        alive.filter_map(exact).collect()
    }
}

/// Ends of photons that meet a mirror or glass first, against exact ray casting.
fn bounced(rig: &Rig<'_>, view: View, how: How) -> Checks {
    let stage = how.0.info().name;
    let setup = Setup::of(rig, mirror_and_glass(view)?, LAYERS)?;
    let unbounced = setup.trace(rig, how, HitTest::Crossing)?;
    let found = setup.trace_ways(rig, how, HitTest::Crossing, BOUNCES + 1)?;
    let mut checks = Vec::new();
    // Rasterizers move corners by up to 1/32 of a pixel; on the ball normals are interpolated between pixels.
    for (optics, tolerance_m) in [(Optics::Mirror, 2e-3), (Optics::Glass, 0.02)] {
        let exact = Exact::all(&setup, optics);
        let off = |end: fn(&Exact) -> DVec3| {
            let landed = exact.iter().filter(|photon| found[photon.number].landed());
            median(landed.map(|photon| found[photon.number].hit.distance(end(photon))))
        };
        // On the first surface, and not near the end: as if it were diffuse.
        let stays = |found: &[StoredPhoton]| {
            share(exact.iter().map(|photon| {
                let found = &found[photon.number];
                let off = |place: DVec3| found.hit.distance(place);
                found.landed() && off(photon.first.position) < WRONG_M && off(photon.end) > WRONG_M
            }))
        };
        // These meet the ball within 2 degrees of where its surface is seen edge-on, with 64 rows of faces or 100, in 320 x 240 pixels or
        // nine times as many: 2 to 8 % of those that come by it.
        let misplaced = |end: fn(&Exact) -> DVec3| {
            let landed = exact.iter().filter(|photon| found[photon.number].landed());
            share(landed.map(|photon| found[photon.number].hit.distance(end(photon)) > WRONG_M))
        };
        let lost = share(exact.iter().map(|photon| !found[photon.number].landed()));
        let of =
            |what: &str| Check::of(rig, format!("{optics:?}, {view:?} view, by {stage}: {what}"));
        checks.push(
            of("median |end − exact end|")
                .within((tolerance_m, "m"), off(|photon| photon.end))
                .control("photons that end where they meet it", off(|photon| photon.first.position))
                .with("photons", exact.len() as f64)
                .with("lost_share", lost),
        );
        checks.push(
            of("share of photons that end more than 0.1 m off")
                .within((0.1, "1"), misplaced(|photon| photon.end))
                .control(
                    "photons that end where they meet it",
                    misplaced(|photon| photon.first.position),
                ),
        );
        checks.push(
            of("share of photons that end where they first meet it")
                .within((0.003, "1"), stays(&found))
                .control("without transfer/bounce", stays(&unbounced)),
        );
    }
    Ok(checks)
}

/// Photons behind plane mirrors, whose normals are packed as `shaders/shared/surface_texel.wgsl` says.
fn tilted_mirrors(rig: &Rig<'_>) -> Checks {
    let half =
        |normal: DVec3| DVec3::from(normal.to_array().map(|n| f64::from(half::f16::from_f64(n))));
    let [mut turned, mut turned_half, mut off_m] = [const { Vec::new() }; 3];
    for tilt in TILTS_DEG {
        let setup = Setup::of(rig, tilted_mirror(tilt)?, LAYERS)?;
        let found = setup.trace_ways(rig, MARCH, HitTest::Crossing, 2)?;
        let behind: Vec<Transfer> = rig.read(&setup.transfers.buffer)?;
        for photon in Exact::all(&setup, Optics::Mirror) {
            let before = setup.stored[photon.number].direction.as_dvec3().normalize();
            let after = behind[photon.number].direction.as_dvec3();
            let reflected = |normal: DVec3| before - 2.0 * before.dot(normal) * normal;
            let exact = reflected(photon.first.normal);
            // Beside the mirror's silhouette some go on as they came.
            if !found[photon.number].landed() || after.distance(before) < 1e-3 {
                continue;
            }
            turned.push(after.distance(exact));
            turned_half.push(reflected(half(photon.first.normal)).distance(exact));
            off_m.push(found[photon.number].hit.distance(photon.end));
        }
    }
    let what = "tilted mirrors: largest |direction − exact direction|";
    let photons = turned.len() as f64;
    // Ends also depend on how far the rasterizer moves corners.
    Ok(vec![
        Check::of(rig, what)
            .within((1e-5, "1"), largest(turned))
            .control("normals of 16-bit floats", largest(turned_half))
            .with("photons", photons)
            .with("largest_end_error_m", largest(off_m)),
    ])
}

/// A mirror over a floor, seen by the turned camera, that reflects light downwards.
fn tilted_mirror(tilt_deg: [f64; 3]) -> Result<Scene> {
    let mut scene = rig::flat_plane(LightKind::Directional)?;
    let floor_y = scene.objects[0].mesh.bounds().max.y;
    let [y, x, z] = tilt_deg.map(f64::to_radians);
    let turn = DMat3::from_euler(EulerRot::YXZ, y, x, z);
    let sides = [DVec3::Z, DVec3::X].map(|side| 0.7 * (turn * side));
    scene.objects.push(mirror(DVec3::new(-0.4, floor_y + 1.3, 0.2), sides));
    scene.camera = View::Turned.of(scene.camera, floor_y);
    Ok(scene)
}
