//! Volume ambient occlusion with the pipeline's defaults against ray casting: simple bodies in many orientations, voxelized and
//! marched as a user's scene would be.

use std::f64::consts::{PI, TAU};

use glam::{DMat3, DQuat, DVec3, EulerRot};

use super::{Case, Random, VerifyError};
use crate::harness::verify::Check;
use crate::harness::verify::rig::Rig;
use crate::pipelines::settings::{Method, R_MAX_SHARE};
use crate::pipelines::volume_ao::{Ao, Params, occlusion_at};
use crate::reference::occlusion::{Attenuation, occlusion};
use crate::reference::rays::Tracer;
use crate::scene::{Material, Mesh, Object, Scene, SceneFile};
use crate::stages::ao::query::{INFO, Point};
use crate::stages::marching::Hit;

/// Points on each body.
const POINTS: u32 = 48;
/// Rays of the reference at each of them.
const RAYS: u32 = 1024;
/// RMS error of A that is allowed over the points of a body in one orientation. Largest seen on lavapipe and SwiftShader: 0.05.
const TOLERANCE: f64 = 0.06;
/// Nearest points to an edge where two surfaces meet, voxels of 128 a side: nearer, the first sample lies beyond both. VAO Fig. 10.
const NEAREST: f64 = 2.2;
/// Edge of the bodies, metres, and about that of a voxel.
const EDGE_M: f64 = 2.0;
const VOXEL_M: f64 = EDGE_M / 128.0;
/// Of the axis-aligned, the two that leaked most, and random ones.
const ORIENTATIONS: u32 = 12;

/// Triangles of a body at rest, and points on it with their normals.
struct Body {
    mesh: Mesh,
    points: Vec<(DVec3, DVec3)>,
}

type Make = fn(&mut Random) -> Body;

const BODIES: [(&str, Make); 6] = [
    ("ceiling", ceiling),
    ("corner", |random| wedge(random, 90.0)),
    ("half planes at 30°", |random| wedge(random, 30.0)),
    ("ball over a floor", ball),
    ("hollow ball", hollow_ball),
    ("open box", open_box),
];

pub fn cases() -> Vec<Case> {
    let case = |(name, make): (&'static str, Make)| {
        Case::new(INFO.name, format!("orientations, {name}"), move |rig| {
            Ok(vec![against_rays(rig, name, make)?])
        })
    };
    BODIES.map(case).into()
}

/// The settings of VAO §5.1 and §4.2 with the threshold that this pipeline had as its default before: volumes from slicemaps.
fn with_gaps(params: &mut Params) {
    params.voxel.method = Method::Slicemap;
    params.ao.threshold = 0.55;
    params.ao.offset_voxels = 0.25;
    params.ao.hit = Hit::Between;
}

/// The largest RMS error over the orientations; the control's volume has gaps where it is slanted.
fn against_rays(rig: &Rig<'_>, name: &str, make: Make) -> Result<Check, VerifyError> {
    let mut random = Random::new(41);
    let mut worst = [0f64; 2];
    let mut squares = 0.0;
    for number in 0..ORIENTATIONS {
        let turn = orientation(number, &mut random);
        let body = make(&mut random);
        let [default, gaps] = rmse(rig, &body, turn)?;
        worst = [worst[0].max(default), worst[1].max(gaps)];
        squares += default * default;
    }
    let mean = (squares / f64::from(ORIENTATIONS)).sqrt();
    let control = ("volume from slicemaps, threshold 0.55", worst[1]);
    let what = format!("{name}, {ORIENTATIONS} orientations: largest RMS error of A");
    let check = Check::new((INFO.name, what), (TOLERANCE, "1"), worst[0], control);
    Ok(check.with("over_all_orientations", mean))
}

/// As it is, turned by 45° about an axis, its y brought to (1, 1, 1), and then at random.
fn orientation(number: u32, random: &mut Random) -> DMat3 {
    match number {
        0 => DMat3::IDENTITY,
        1 => DMat3::from_rotation_z(PI / 4.0),
        2 => DMat3::from_quat(DQuat::from_rotation_arc(DVec3::Y, DVec3::ONE.normalize())),
        _ => {
            let mut angle = || random.within(0.0, TAU);
            DMat3::from_euler(EulerRot::ZYZ, angle(), (angle() / PI - 1.0).acos(), angle())
        }
    }
}

/// RMS errors of A with the defaults, and with the control's settings.
fn rmse(rig: &Rig<'_>, body: &Body, turn: DMat3) -> Result<[f64; 2], VerifyError> {
    let mut scene = Scene::load("plane")?;
    let mut mesh = body.mesh.clone();
    for p in &mut mesh.positions {
        *p = (turn * DVec3::from(p.map(f64::from))).as_vec3().to_array();
    }
    mesh.recompute_normals();
    let material = Material::default();
    let name = "body".to_owned();
    scene.objects = vec![Object {
        name,
        mesh,
        material,
    }];
    let r_max_m = R_MAX_SHARE * scene.solid_bounds().size().max_element();
    let tracer = Tracer::new(&scene.objects)?;
    let points: Vec<(DVec3, DVec3)> = body
        .points
        .iter()
        .map(|(p, n)| (turn * *p, turn * *n))
        .collect();
    let cast =
        |(p, n): &(DVec3, DVec3)| occlusion(&tracer, *p, *n, r_max_m, Attenuation::Linear, RAYS);
    let exact: Vec<f64> = points.iter().map(cast).collect();
    let asked: Vec<Point> = points
        .iter()
        .map(|(p, n)| Point {
            position_m: p.as_vec3(),
            normal: n.as_vec3(),
        })
        .collect();
    let mut params = Params::from_scene(&SceneFile::load("plane")?);
    params.ao = Ao {
        rays: 64,
        ..params.ao
    };
    let error = |params: &Params| -> Result<f64, VerifyError> {
        let found = occlusion_at(rig.gpu, &scene, params, &asked)?;
        let squares = found
            .iter()
            .zip(&exact)
            .map(|(a, b)| (f64::from(*a) - b).powi(2));
        Ok((squares.sum::<f64>() / exact.len() as f64).sqrt())
    };
    let default = error(&params)?;
    with_gaps(&mut params);
    Ok([default, error(&params)?])
}

/// A parallelogram by its middle and half its sides.
fn quad(mesh: &mut Mesh, middle: DVec3, a: DVec3, b: DVec3) {
    let first = mesh.positions.len() as u32;
    let corners = [-a - b, a - b, a + b, b - a];
    mesh.positions
        .extend(corners.map(|d| (middle + d).as_vec3().to_array()));
    mesh.indices.extend([0, 1, 2, 0, 2, 3].map(|i| first + i));
}

/// A ball of triangles: its points lie within a thousandth of the radius of the sphere.
fn sphere(mesh: &mut Mesh, center: DVec3, radius: f64) {
    const RINGS: u32 = 48;
    let first = mesh.positions.len() as u32;
    for ring in 0..=RINGS {
        let (sin, cos) = (PI * f64::from(ring) / f64::from(RINGS)).sin_cos();
        for step in 0..2 * RINGS {
            let (across, along) = (PI * f64::from(step) / f64::from(RINGS)).sin_cos();
            let p = center + radius * DVec3::new(sin * along, cos, sin * across);
            mesh.positions.push(p.as_vec3().to_array());
        }
    }
    for ring in 0..RINGS {
        for step in 0..2 * RINGS {
            let at = |ring: u32, step: u32| first + ring * 2 * RINGS + step % (2 * RINGS);
            let [a, b] = [at(ring, step), at(ring + 1, step)];
            let [c, d] = [at(ring + 1, step + 1), at(ring, step + 1)];
            mesh.indices.extend([a, b, c, a, c, d]);
        }
    }
}

fn direction(random: &mut Random) -> DVec3 {
    let (up, angle) = (random.within(-1.0, 1.0), random.within(0.0, TAU));
    let flat = (1.0 - up * up).sqrt();
    DVec3::new(flat * angle.cos(), up, flat * angle.sin())
}

fn many(mut point: impl FnMut() -> (DVec3, DVec3)) -> Vec<(DVec3, DVec3)> {
    (0..POINTS).map(|_| point()).collect()
}

/// Two plates, seen from the lower one.
fn ceiling(random: &mut Random) -> Body {
    let height = random.within(0.08, 0.3);
    let mut mesh = Mesh::default();
    for y in [0.0, height] {
        quad(&mut mesh, DVec3::Y * y, DVec3::X, DVec3::Z);
    }
    let point = || {
        (
            DVec3::new(random.within(-0.6, 0.6), 0.0, random.within(-0.6, 0.6)),
            DVec3::Y,
        )
    };
    let points = many(point);
    Body { mesh, points }
}

/// Two half planes that meet at an angle, seen from one of them.
fn wedge(random: &mut Random, angle_deg: f64) -> Body {
    let (sin, cos) = angle_deg.to_radians().sin_cos();
    let mut mesh = Mesh::default();
    for along in [DVec3::X, DVec3::new(cos, sin, 0.0)] {
        quad(&mut mesh, 0.5 * along, 0.5 * along, DVec3::Z);
    }
    let point = || {
        let x = random.within(NEAREST * VOXEL_M, 0.9);
        (DVec3::new(x, 0.0, random.within(-0.6, 0.6)), DVec3::Y)
    };
    let points = many(point);
    Body { mesh, points }
}

/// A ball above a floor, seen from both.
fn ball(random: &mut Random) -> Body {
    let (center, radius) = (DVec3::Y * 0.4, 0.3);
    let mut mesh = Mesh::default();
    quad(&mut mesh, DVec3::ZERO, DVec3::X, DVec3::Z);
    sphere(&mut mesh, center, radius);
    let point = || {
        if random.next() < 0.6 {
            return (
                DVec3::new(random.within(-0.4, 0.4), 0.0, random.within(-0.4, 0.4)),
                DVec3::Y,
            );
        }
        let normal = direction(random);
        (center + radius * normal, normal)
    };
    let points = many(point);
    Body { mesh, points }
}

/// A ball seen from outside and from within.
fn hollow_ball(random: &mut Random) -> Body {
    let mut mesh = Mesh::default();
    sphere(&mut mesh, DVec3::ZERO, 1.0);
    let point = || {
        let normal = direction(random);
        let side = if random.next() < 0.5 { 1.0 } else { -1.0 };
        (normal, side * normal)
    };
    let points = many(point);
    Body { mesh, points }
}

/// A box without its lid, seen from within.
fn open_box(random: &mut Random) -> Body {
    let half = EDGE_M / 4.0;
    let walls = [
        (DVec3::NEG_Y, DVec3::X),
        (DVec3::X, DVec3::Y),
        (DVec3::NEG_X, DVec3::Y),
        (DVec3::Z, DVec3::X),
        (DVec3::NEG_Z, DVec3::X),
    ];
    let mut mesh = Mesh::default();
    for (out, along) in walls {
        quad(&mut mesh, half * out, half * along, half * out.cross(along));
    }
    let reach = half - NEAREST * VOXEL_M;
    let point = || {
        let (out, along) = walls[(random.next() * 5.0) as usize];
        let [a, b] = [(); 2].map(|()| random.within(-reach, reach));
        (half * out + a * along + b * out.cross(along), -out)
    };
    let points = many(point);
    Body { mesh, points }
}
