//! Volume ambient occlusion with the pipeline's defaults against ray casting: simple bodies in many orientations, voxelized and
//! marched as a user's scene would be.

use crate::prelude::*;
use fathom_pipelines::settings::{R_MAX_SHARE, VoxelMethod};
use fathom_pipelines::volume_ao::{Params, occlusion_at};
use fathom_reference::occlusion::{Obscurity, occlusion};
use fathom_scene::surface;
use fathom_stages::ao::query::{INFO, SurfacePoint};
use fathom_stages::marching::{Guard, HitPoint};

/// Points on each body.
const POINTS: u32 = 48;
/// Rays of the reference at each of them.
const RAYS: u32 = 256;
/// Nearest points to an edge where two surfaces meet, voxels of 128 a side: nearer, the first sample lies beyond both. VAO Fig. 10.
const NEAREST: f64 = 2.2;
/// Edge of the bodies, metres, and about that of a voxel.
const EDGE_M: f64 = 2.0;
const VOXEL_M: f64 = EDGE_M / 128.0;
/// Of the axis-aligned at several places in the grid, the two that leaked most, and random ones.
const ORIENTATIONS: u32 = 15;
/// Those in which a control is run: it need fail in one. The two that are slanted by rule, and some random ones.
const CONTROL_BODIES: std::ops::Range<usize> = 4..9;

/// Triangles of a body at rest, and points on it with their normals.
pub struct Body {
    pub mesh: Mesh,
    pub points: Vec<(DVec3, DVec3)>,
}

type MakeBody = fn(&mut Random) -> Body;

/// Settings with which the check must fail.
#[derive(Clone, Copy)]
struct BrokenSetting {
    name: &'static str,
    change: fn(&mut Params),
}

/// The volume of VAO §4.2 with the threshold that was the default before: it has gaps where it is slanted.
const GAPS: BrokenSetting = BrokenSetting {
    name: "volume from slicemaps, threshold 0.55",
    change: |params| {
        params.voxel.method = VoxelMethod::Slicemap;
        params.ao.threshold = 0.55;
        params.ao.offset_voxels = 0.25;
        params.ao.hit = HitPoint::Sample;
    },
};

/// Fig. 3a.
const UNGUARDED: BrokenSetting =
    BrokenSetting { name: "no guard", change: |params| params.ao.guard = Guard::None };

/// RMS error of A that is allowed over the points of a body in one orientation: above the largest seen, below the control's.
const BODIES: [(&str, f64, BrokenSetting, MakeBody); 4] = [
    ("ceiling", 0.05, GAPS, ceiling),
    ("ball over a floor", 0.05, GAPS, ball),
    ("hollow ball", 0.05, UNGUARDED, hollow_ball),
    ("open box", 0.03, GAPS, open_box),
];

pub fn cases() -> Vec<Case> {
    let what = |(name, ..): (&str, f64, BrokenSetting, MakeBody)| format!("orientations, {name}");
    Case::each(INFO.name, BODIES, what, check).collect()
}

/// The largest RMS error over the orientations with the defaults and with the control's settings.
fn check(
    rig: &Rig<'_>,
    (name, tolerance, control, make): (&str, f64, BrokenSetting, MakeBody),
) -> Result<Check> {
    let default = defaults()?;
    let mut other = default.clone();
    (control.change)(&mut other);
    let turned = turned(make)?;
    let errors = |params: &Params, turned: &[TurnedBody]| {
        let errors = turned.iter().map(|turned| turned.errors(rig, params).map(rms));
        errors.collect::<Result<Vec<f64>>>()
    };
    let [default, other] = [errors(&default, &turned)?, errors(&other, &turned[CONTROL_BODIES])?];
    let what = format!("{name}, {ORIENTATIONS} orientations: largest RMS error of A");
    Ok(Check::new(rig, what)
        .within((tolerance, "1"), largest(default.iter().copied()))
        .control(control.name, largest(other))
        .with("over_all_orientations", rms(default)))
}

/// The pipeline's defaults with 64 rays.
pub fn defaults() -> Result<Params> {
    let mut params = Params::from(&SceneFile::load("plane")?);
    params.ao.rays = 64;
    Ok(params)
}

/// A body in all orientations.
fn turned(make: MakeBody) -> Result<Vec<TurnedBody>> {
    let mut random = Random::new(41);
    (0..ORIENTATIONS)
        .map(|number| {
            let turn = orientation(number, &mut random);
            let shift = shift(&mut random);
            TurnedBody::new(&make(&mut random), turn, shift)
        })
        .collect()
}

/// As it is four times, turned by 45° about an axis, its y brought to (1, 1, 1), and then at random.
pub fn orientation(number: u32, random: &mut Random) -> DMat3 {
    match number {
        0..=3 => DMat3::IDENTITY,
        4 => DMat3::from_rotation_z(PI / 4.0),
        5 => DMat3::from_quat(DQuat::from_rotation_arc(DVec3::Y, DVec3::ONE.normalize())),
        _ => {
            let mut angle = || random.within(0.0, TAU);
            DMat3::from_euler(EulerRot::ZYZ, angle(), (angle() / PI - 1.0).acos(), angle())
        }
    }
}

/// Where a grid begins before a body, voxels.
pub fn shift(random: &mut Random) -> DVec3 {
    DVec3::from([(); 3].map(|()| random.number()))
}

/// A body in one orientation: points on it, and A there by ray casting.
pub struct TurnedBody {
    scene: Scene,
    points: Vec<SurfacePoint>,
    exact: Vec<f64>,
}

impl TurnedBody {
    /// `shift` moves the grid against the body, voxels.
    pub fn new(body: &Body, turn: DMat3, shift: DVec3) -> Result<Self> {
        let mut mesh = body.mesh.clone();
        for p in &mut mesh.positions {
            *p = (turn * DVec3::from(p.map(f64::from))).as_vec3().to_array();
        }
        // A grid begins at a mesh's bounds: a corner of no triangle moves it.
        mesh.positions.push((mesh.bounds().min - VOXEL_M * shift).as_vec3().to_array());
        mesh.recompute_normals();
        let mut scene = Scene::load("plane")?;
        scene.objects = vec![Object::new("body", mesh)];
        let r_max_m = R_MAX_SHARE * scene.solid_bounds().size().max_element();
        let tracer = Tracer::new(&scene.objects);
        let (mut points, mut exact) = (Vec::new(), Vec::new());
        for (p, n) in &body.points {
            let (p, n) = (turn * *p, turn * *n);
            exact.push(occlusion(&tracer, p, n, r_max_m, Obscurity::Linear, RAYS));
            points.push(SurfacePoint { position_m: p.as_vec3(), normal: n.as_vec3() });
        }
        Ok(Self { scene, points, exact })
    }

    /// Edge of a voxel.
    pub fn voxel_m(&self, params: &Params) -> Result<f64> {
        let grid = Grid::fit(&self.scene.solid_bounds(), params.voxel.resolution);
        Ok(grid.map_err(GpuError::Limit)?.voxel_m)
    }

    /// Of A at each point.
    pub fn errors(&self, rig: &Rig<'_>, params: &Params) -> Result<Vec<f64>> {
        let found = occlusion_at(rig.gpu, &self.scene, params, &self.points)?;
        Ok(found.iter().zip(&self.exact).map(|(a, b)| f64::from(*a) - b).collect())
    }
}

/// Parallelograms by their middles and half their sides.
fn quads(quads: impl IntoIterator<Item = [DVec3; 3]>) -> Mesh {
    let mut mesh = Mesh::default();
    for [middle, a, b] in quads {
        mesh.append(&Mesh::parallelogram(middle, a, b));
    }
    mesh
}

/// Rings of a ball of triangles, each of twice as many steps.
const RINGS: u32 = 48;

/// Place of a ball's corner in its surface's order.
fn on_ball(center: DVec3, radius: f64, ring: u32, step: u32) -> DVec3 {
    let (sin, cos) = (PI * f64::from(ring) / f64::from(RINGS)).sin_cos();
    let (across, along) = (PI * f64::from(step) / f64::from(RINGS)).sin_cos();
    center + radius * DVec3::new(sin * along, cos, sin * across)
}

/// The two triangles of a step of a ring; at a pole one of them has no area.
fn facets(ring: u32, step: u32) -> [[(u32, u32); 3]; 2] {
    let [a, b] = [(ring, step), (ring + 1, step)];
    let [c, d] = [(ring + 1, step + 1), (ring, step + 1)];
    [[a, b, c], [a, c, d]]
}

fn sphere(center: DVec3, radius: f64) -> Mesh {
    let (rings, steps) = (RINGS as usize, 2 * RINGS as usize);
    let nearest = |share: f64, count: usize| (share * count as f64).round() as u32;
    surface((rings, steps), (false, true), |u, v| {
        on_ball(center, radius, nearest(u, rings), nearest(v, steps))
    })
}

/// The middle of a facet of a ball, which lies on the triangles as no point of the sphere does, and its outer normal.
fn facet(random: &mut Random, center: DVec3, radius: f64) -> (DVec3, DVec3) {
    // Uniform over the sphere: the polar angle's cosine is.
    let polar = random.within(-1.0, 1.0).acos() / PI;
    let ring = ((polar * f64::from(RINGS)) as u32).min(RINGS - 1);
    let step = (random.number() * f64::from(2 * RINGS)) as u32;
    let [lower, upper] = facets(ring, step);
    let corners = if ring == 0 { lower } else { upper };
    let [a, b, c] = corners.map(|(ring, step)| on_ball(center, radius, ring, step));
    let normal = (b - a).cross(c - a).normalize();
    let outer = normal * normal.dot(a - center).signum();
    ((a + b + c) / 3.0, outer)
}

fn many(mut point: impl FnMut() -> (DVec3, DVec3)) -> Vec<(DVec3, DVec3)> {
    (0..POINTS).map(|_| point()).collect()
}

/// Two plates, seen from the lower one.
fn ceiling(random: &mut Random) -> Body {
    let height = random.within(0.08, 0.3);
    let mesh = quads([0.0, height].map(|y| [DVec3::Y * y, DVec3::X, DVec3::Z]));
    let point = || (DVec3::new(random.within(-0.6, 0.6), 0.0, random.within(-0.6, 0.6)), DVec3::Y);
    Body { points: many(point), mesh }
}

/// Two half planes that meet in the z axis at an angle, one of them along x.
pub fn half_planes(angle_deg: f64) -> Mesh {
    let (sin, cos) = angle_deg.to_radians().sin_cos();
    let sides = [DVec3::X, DVec3::new(cos, sin, 0.0)];
    quads(sides.map(|along| [0.5 * along, 0.5 * along, DVec3::Z]))
}

/// A ball above a floor, seen from both.
fn ball(random: &mut Random) -> Body {
    let (center, radius) = (DVec3::Y * 0.4, 0.3);
    let mut mesh = quads([[DVec3::ZERO, DVec3::X, DVec3::Z]]);
    mesh.append(&sphere(center, radius));
    let point = || {
        if random.number() < 0.6 {
            return (DVec3::new(random.within(-0.4, 0.4), 0.0, random.within(-0.4, 0.4)), DVec3::Y);
        }
        facet(random, center, radius)
    };
    Body { points: many(point), mesh }
}

/// A ball seen from outside and from within.
fn hollow_ball(random: &mut Random) -> Body {
    let point = || {
        let (point, normal) = facet(random, DVec3::ZERO, 1.0);
        let side = if random.number() < 0.5 { 1.0 } else { -1.0 };
        (point, side * normal)
    };
    Body { points: many(point), mesh: sphere(DVec3::ZERO, 1.0) }
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
    let mesh = quads(walls.map(|(out, along)| [out, along, out.cross(along)].map(|v| half * v)));
    let reach = half - NEAREST * VOXEL_M;
    let point = || {
        let (out, along) = walls[(random.number() * 5.0) as usize];
        let [a, b] = [(); 2].map(|()| random.within(-reach, reach));
        (half * out + a * along + b * out.cross(along), -out)
    };
    Body { points: many(point), mesh }
}
