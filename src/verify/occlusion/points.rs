//! `ao/query`: what each setting makes of a furnished volume. The figures were stored when A at each point agreed with an f64 copy of the marching
//! to within 5e-4, on lavapipe (Mesa 22.3).

use super::*;
use fathom_stages::ao::query::INFO;

/// Filtering units have 8 bits of weight along each axis: adapters differ by nearly as much.
const TOLERANCE: f64 = 3e-4;
const SIDE: u32 = 32;
/// Rays whose marching takes more turns than an adapter may make of an invocation's loops: see [`fathom_gpu::MAX_ITERATIONS`]. The stage
/// takes several passes.
const MANY_RAYS: u32 = 8_192;

type MarchChange = fn(&mut Marching);

/// What the shader's definitions choose between, and the weighted mean of A.
const VARIANTS: [(&str, MarchChange, f64); 16] = [
    ("defaults", |_| (), 0.053418),
    ("settings of VAO §5.1", paper, 0.00611),
    ("uniform directions, doubled", |m| m.estimator = Estimator::Uniform, 0.054915),
    ("look-ups moved", |m| m.shift_voxels = -0.3, 0.0579),
    ("guard of a voxel", |m| m.guard = Guard::Voxel, 0.0601),
    ("guard of seven voxels", |m| m.guard = Guard::SevenVoxels, 0.013261),
    ("hard attenuation", |m| m.attenuation = Attenuation::Hard, 0.14918),
    ("random directions", |m| m.sampling = Sampling::Random, 0.05267),
    ("steps of half a voxel", |m| m.step_voxels = 0.5, 0.0541),
    ("a low threshold", |m| m.threshold = 0.55, 0.07055),
    ("jitter", |m| m.jitter = true, 0.05154),
    ("another seed, few rays", |m| (m.seed, m.rays) = (3, 4), 0.05489),
    ("rays of several passes", |m| m.rays = MANY_RAYS, 0.0341),
    ("opacities", |m| opacities(m, 1.0), 0.0741),
    ("opacities, steps of half a voxel", |m| opacities(m, 0.5), 0.06675),
    ("opacities, steps of two voxels", |m| opacities(m, 2.0), 0.0808),
];

fn paper(m: &mut Marching) {
    (m.estimator, m.step, m.hit) = (Estimator::Paper, StepLength::Paper, HitPoint::Sample);
    (m.offset_voxels, m.sampling) = (0.0, Sampling::Random);
}

fn opacities(m: &mut Marching, step_voxels: f64) {
    (m.occluder, m.threshold, m.step_voxels) = (Occluder::Opacity, 1.0, step_voxels);
}

pub fn cases() -> Vec<Case> {
    let what = |(name, ..): (&str, MarchChange, f64)| format!("a furnished volume, {name}");
    let skipping = Case::new(INFO.name, "a furnished volume, skipping", skipping);
    Case::each(INFO.name, VARIANTS, what, check).chain([skipping]).collect()
}

/// What is skipped is empty: rays find the same, bit for bit, at any step, threshold and kind of march.
fn skipping(rig: &Rig<'_>) -> Result<Check> {
    // Of some sides a cell of the pyramid is a part of one.
    let volumes = [0, 1, 2, 3].map(|more| pyramid(rig, SIDE + more, furnished));
    let volumes = volumes.into_iter().collect::<Result<Vec<_>>>()?;
    let (mut random, mut differ) = (Random::new(17), [0.0; 2]);
    for number in 0..20 {
        let draw = [(); 8].map(|()| random.number());
        let pick = |i: usize, count: f64| (draw[i] * count) as usize;
        let mut settings = marching(|m| {
            let guards = [Guard::None, Guard::Voxel, Guard::SevenVoxels, Guard::Variable];
            m.guard = guards[pick(0, 4.0)];
            m.occluder = [Occluder::Binary, Occluder::Binary, Occluder::Opacity][pick(1, 3.0)];
            m.hit = [HitPoint::Sample, HitPoint::Peak][pick(2, 2.0)];
            m.attenuation = [Attenuation::Linear, Attenuation::Hard][pick(3, 2.0)];
            m.jitter = pick(4, 2.0) == 1;
            (m.r_max_m, m.offset_voxels, m.threshold) = (3.0, draw[5], 0.1 + 0.85 * draw[6]);
            m.step_voxels = 0.3 * 20f64.powf(draw[7]);
        });
        let mut run = |skipping: bool, seed: u32| {
            (settings.skipping, settings.seed) = (skipping, seed);
            query(rig, &volumes[number % 4], &furnished_points(), &settings)
        };
        let plain = run(false, 0)?;
        differ[0] += differing(&run(true, 0)?, &plain);
        if number == 0 {
            differ[1] = differing(&run(true, 1)?, &plain);
        }
    }
    Ok(Check::new(rig, "random steps and settings: points where skipping changes A")
        .within((0.0, "1"), differ[0])
        .control("another seed", differ[1]))
}

fn check(rig: &Rig<'_>, (name, change, stored): (&str, MarchChange, f64)) -> Result<Check> {
    let mut settings = Marching { rays: 32, r_max_m: 10.0 * VOXEL_M, ..Marching::default() };
    change(&mut settings);
    let level = if settings.occluder == Occluder::Opacity { 90 } else { 255 };
    let volume = volume(rig, SIDE, level, furnished)?;
    let mut points = furnished_points();
    points.truncate(if settings.rays == MANY_RAYS { 12 } else { points.len() });
    // Each point counts by another weight, so that no two errors cancel out.
    let mut random = Random::new(3);
    let weights: Vec<f64> = points.iter().map(|_| random.within(0.0, 2.0)).collect();
    let off = |r_max: f64| -> Result<f64> {
        let settings = Marching { r_max_m: r_max * settings.r_max_m, ..settings.clone() };
        let found = query(rig, &volume, &points, &settings)?;
        Ok((mean(found.iter().zip(&weights).map(|(a, weight)| a * weight)) - stored).abs())
    };
    Ok(Check::new(rig, format!("{name}: weighted mean of A against the stored one"))
        .within((TOLERANCE, "1"), off(1.0)?)
        .control("r_max half as great again", off(1.5)?))
}

/// Shells about a voxel thick: a floor, a wall, and a ball above the floor that touches neither.
fn furnished(p: DVec3) -> bool {
    let shell = |distance: f64| distance.abs() < 0.5 * VOXEL_M;
    shell(p.y - FLOOR_M) || shell(p.x - WALL_M) || shell(p.distance(BALL_M) - RADIUS_M)
}

const FLOOR_M: f64 = -0.97;
const WALL_M: f64 = -1.03;
const BALL_M: DVec3 = DVec3::new(0.3, -0.2, 0.1);
const RADIUS_M: f64 = 0.5;

/// Points on floor, wall and ball with their normals, in general position.
fn furnished_points() -> Vec<(DVec3, DVec3)> {
    let mut random = Random::new(11);
    let mut within = |low, high| random.within(low, high);
    let point = |i| match i % 3 {
        0 => (DVec3::new(within(-0.9, 1.2), FLOOR_M, within(-1.2, 1.2)), DVec3::Y),
        1 => (DVec3::new(WALL_M, within(-0.8, 1.2), within(-1.2, 1.2)), DVec3::X),
        _ => {
            let (sin, cos) = within(0.0, TAU).sin_cos();
            let up = within(-1.0, 1.0);
            let flat = (1.0 - up * up).sqrt();
            let normal = DVec3::new(flat * cos, up, flat * sin);
            (BALL_M + RADIUS_M * normal, normal)
        }
    };
    (0..96).map(point).collect()
}
