//! `gtao/gather` against an f64 evaluation of its formulas and cast rays.

use super::hsao::{built, camera, quad};
use crate::prelude::*;
use fathom_pipelines::gtao::Gather;
use fathom_reference::occlusion::{Obscurity, occlusion};
use fathom_reference::slices::{SeenDepth, SliceMethod, SliceSearch};
use fathom_stages::bilateral::Window;
use fathom_stages::gtao::gather::{self, Occluders, Sectors};
use glam::DQuat;

const STAGE: &str = "gtao/gather";
const SIZE: [u32; 2] = [96, 72];
/// Of 95 pixels in 100: sectors whose middle an arc ends at, and samples at the border of two texels, go either way,
/// on SwiftShader in more than one pixel of 100.
const AS_IN_F64: f64 = 1e-3;
/// Of a plane by itself: what a sector weighs, where each weighs the same. On SwiftShader half a sector is
/// covered and cosine-weighted methods find 0.002; its depths are likely less exact, which was not shown.
fn of_plane(sectors: Sectors) -> f64 {
    if matches!(sectors, Sectors::Uniform) { 1.0 / 32.0 } else { 4e-3 }
}
const R_MAX_M: f64 = 1.0;
/// Over pixels of some 2 cm, of 32 slices of 64 samples.
const WALL_RMS: f64 = 0.02;
const BAR_RMS: f64 = 0.03;
const METHODS: [(&str, Occluders, Sectors); 3] = [
    ("horizons", Occluders::Horizons, Sectors::Cosine),
    ("uniform sectors", Occluders::Bitmask, Sectors::Uniform),
    ("cosine sectors", Occluders::Bitmask, Sectors::Cosine),
];

pub fn cases() -> Vec<Case> {
    let views = [("upright", 0), ("turned, slanted", 1), ("turned, grazing and off the middle", 2)];
    let of_views = Case::each(
        STAGE,
        views,
        |(view, _)| format!("known shapes, {view}"),
        |rig, (name, view)| known_shapes(rig, name, view),
    );
    let mut cases = vec![Case::new(STAGE, "an f64 evaluation", as_in_f64)];
    cases.extend(of_views);
    cases
}

fn dense(occluders: Occluders, sectors: Sectors) -> Gather {
    Gather { occluders, sectors, slices: 32, steps: 32, thickness_share: 4.0, ..Gather::default() }
}

/// What the stage makes of a scene's G-buffer: A.
fn shade(
    rig: &Rig<'_>,
    fixture: &Fixture,
    settings: &Gather,
    buffer_px: [u32; 2],
    r_max_m: f64,
) -> Result<Image> {
    let (gbuffer, uniforms) = (rig.gbuffer(fixture)?, settings.uniforms(buffer_px, r_max_m));
    let stage = gather::new(rig, &fixture.shared, &gbuffer, &uniforms, settings.method(), None)?;
    Ok(rig.draw(&[&stage], stage.texture(), 0)?.map(|visibility| 1.0 - visibility))
}

/// Every method in scenes with columns, bars and background, from a camera that is rolled; settings off their defaults.
fn as_in_f64(rig: &Rig<'_>) -> Checks {
    let half = SIZE.map(|side| side / 2);
    let cases = METHODS.map(|(name, occluders, sectors)| {
        let settings = Gather { occluders, sectors, seed: 3, steps: 5, ..Gather::default() };
        (name, "tank", settings, SIZE, 1.0)
    });
    let with = |change: fn(&mut Gather)| {
        let mut settings = cases[2].2.clone();
        change(&mut settings);
        settings
    };
    let falling = with(|s| (s.occluders, s.fall, s.slices) = (Occluders::Horizons, 0.4, 7));
    let tiled = with(|s| (s.window, s.thickness_share) = (Window::Square, 0.07));
    let more = [
        ("horizons that fall, at half the size", "thicket", falling, half, 0.4),
        ("cosine sectors, tiles of rotations", "thicket", tiled, SIZE, 0.6),
    ];
    let check = |(name, scene, settings, buffer_px, r_max_m)| {
        let (mut scene, settings): (Scene, Gather) = (Scene::load(scene)?, settings);
        scene.camera.up = [0.3, 0.9, -0.2];
        let fixture = rig.fixture(scene, SIZE)?;
        let gbuffer = rig.gbuffer(&fixture)?;
        let normal = |i| rig.channel(&gbuffer.normal, i);
        let seen = SeenDepth {
            depth: rig.channel(&gbuffer.depth, 0)?,
            normal: [normal(0)?, normal(1)?, normal(2)?],
            rays: rig::rays(&fixture.view),
            eye: fixture.scene.camera.position(),
        };
        let found = shade(rig, &fixture, &settings, buffer_px, r_max_m)?;
        let off = |r_max_m: f64| {
            let search = SliceSearch {
                method: match (settings.occluders, settings.sectors) {
                    (Occluders::Horizons, _) => SliceMethod::Horizons,
                    (_, Sectors::Uniform) => SliceMethod::UniformSectors,
                    (_, Sectors::Cosine) => SliceMethod::CosineSectors,
                },
                r_max_m,
                thickness_m: settings.thickness_share * r_max_m,
                fall: settings.fall,
                slices: settings.slices,
                steps: settings.steps,
                seed: settings.seed,
                tiled: settings.window == Window::Square,
            };
            let exact = |at| Some(search.occlusion(&seen, at, buffer_px)?.clamp(0.0, 1.0));
            let off = |at| Some((found.get(at) - exact(at)?).abs());
            percentile::<95>(pixels(buffer_px).filter_map(off))
        };
        Ok(Check::new(rig, format!("{name}: A against an f64 evaluation, of 95 pixels in 100"))
            .within((AS_IN_F64, "1"), off(r_max_m))
            .control("r_max 5 % greater", off(1.05 * r_max_m)))
    };
    cases.into_iter().chain(more).map(check).collect()
}

/// Objects and a camera, turned together.
fn turned(rig: &Rig<'_>, view: usize, mut objects: Vec<Object>) -> Result<Fixture> {
    let turn = [DQuat::IDENTITY, DQuat::from_rotation_x(2.1), DQuat::from_rotation_z(-1.2)][view]
        * DQuat::from_rotation_y([0.0, 0.7, 2.5][view]);
    let (position, target, up) = [
        (DVec3::new(3.0, 2.6, 0.0), DVec3::new(0.0, 0.4, 0.0), DVec3::Y),
        (DVec3::new(2.2, 1.3, 1.9), DVec3::new(0.0, 0.3, 0.2), DVec3::new(0.4, 1.0, 0.2)),
        (DVec3::new(3.2, 0.9, 0.6), DVec3::new(0.2, 0.8, -1.1), DVec3::new(-0.5, 1.0, 0.0)),
    ][view];
    let mut camera = camera((turn * position).into(), (turn * target).into());
    camera.up = (turn * up).into();
    let wide = |v: &mut [f32; 3]| *v = (turn * DVec3::from(v.map(f64::from))).as_vec3().into();
    for Object { mesh, .. } in &mut objects {
        mesh.positions.iter_mut().chain(&mut mesh.normals).for_each(wide);
    }
    built(rig, camera, objects)
}

/// A plane is open; an endless wall and one of known height occlude it as much as cast rays tell; what is thin occludes it with horizons and
/// does not with sectors.
fn known_shapes(rig: &Rig<'_>, name: &str, view: usize) -> Checks {
    let raised = |lift_m: f64, mut sheet: Object| {
        sheet.mesh.positions.iter_mut().for_each(|position| position[1] += lift_m as f32);
        sheet
    };
    let with = |other: Option<Object>| {
        let floor = quad([30.0, 0.0, 0.0], [0.0, 0.0, -30.0]);
        turned(rig, view, [floor].into_iter().chain(other).collect())
    };
    let wall = |m: f64| with(Some(raised(0.5 * m, quad([0.0, 0.5 * m, 0.0], [0.0, 0.0, 30.0]))));
    let bar = raised(0.3, quad([0.03, 0.0, 0.0], [0.0, 0.0, -30.0]));
    let (plane, corner, low, lower) = (with(None)?, wall(60.0)?, wall(0.3)?, wall(0.1)?);
    let barred = with(Some(bar))?;
    let inner = || pixels(SIZE).filter(|(x, y)| (20..76).contains(x) && (12..60).contains(y));
    // Of the floor, some pixels in from the picture's border, beyond which nothing is seen.
    let errors = |seen: &Fixture, settings: &Gather, exact: &Tracer| -> Result<Vec<f64>> {
        let found = shade(rig, seen, settings, SIZE, R_MAX_M)?;
        let error = |at| {
            let Hit { position, normal, object, .. } = seen.hit(at)?;
            let cast = || occlusion(exact, position, normal, R_MAX_M, Obscurity::Hard, 1024);
            (object == 0).then(|| found.get(at) - cast())
        };
        Ok(inner().step_by(3).filter_map(error).collect())
    };
    let mut checks = Vec::new();
    for (method, occluders, sectors) in METHODS {
        let settings = dense(occluders, sectors);
        let max = |seen: &Fixture| -> Result<f64> {
            let found = shade(rig, seen, &settings, SIZE, R_MAX_M)?;
            Ok(largest(inner().map(|at| found.get(at))))
        };
        checks.push(
            Check::new(rig, format!("{name}, {method}: largest occlusion of a plane by itself"))
                .within((of_plane(sectors), "1"), max(&plane)?)
                .control("a wall stands on it", max(&corner)?),
        );
        // Sectors of equal angle do not estimate A.
        let walls = [("a corner", &corner), ("a wall of 0.3 m", &low)];
        for (of, seen) in walls.into_iter().filter(|_| sectors == Sectors::Cosine) {
            let off = |exact: &Fixture| {
                Ok::<_, VerifyError>(rms(errors(seen, &settings, &exact.tracer)?))
            };
            checks.push(
                Check::new(rig, format!("{name}, {method}: {of}, RMS against cast rays"))
                    .within((WALL_RMS, "1"), off(seen)?)
                    .control("rays cast at a wall of 0.1 m", off(&lower)?),
            );
        }
    }
    let off = |occluders| -> Result<f64> {
        let settings = Gather { thickness_share: 0.02, ..dense(occluders, Sectors::Cosine) };
        Ok(rms(errors(&barred, &settings, &barred.tracer)?))
    };
    checks.push(
        Check::new(
            rig,
            format!("{name}: behind a thin bar, cosine sectors, RMS against cast rays"),
        )
        .within((BAR_RMS, "1"), off(Occluders::Bitmask)?)
        .control("horizons", off(Occluders::Horizons)?),
    );
    Ok(checks)
}
