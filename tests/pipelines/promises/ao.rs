//! Volume and screen-space ambient occlusion: looks between samples, points out of reach, positions by vectors.

use fathom::gpu::{Gpu, read_texture};
use fathom::parameter;
use fathom::pipelines::PipelineInstance;
use fathom::pipelines::hsao::Hsao;
use fathom::pipelines::volume_ao::{Params, occlusion_at};
use fathom::scene::{Camera, Mesh, Object, Scene, SceneFile};
use fathom::stages::ao::query::SurfacePoint;
use glam::DVec3;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

use super::super::{built, common, gpu, prepared};
use super::draws;

const RAYS: f32 = 48.0;

/// Sheets within 1.2 m of the origin, half of them along the axes, with specks of a voxel, and points on and around them.
struct SheetScene {
    random: Pcg64,
    scene: Scene,
    points: Vec<SurfacePoint>,
}

impl SheetScene {
    fn new(seed: u64) -> Self {
        let scene = Scene::load("plane").unwrap();
        let mut draw = Self { random: Pcg64::seed_from_u64(seed), scene, points: Vec::new() };
        let mut mesh = Mesh::default();
        for number in 0..draw.random.random_range(3..16_u8) {
            let (middle, mut normal) = (0.6 * draw.vector(), draw.vector().normalize());
            if number % 2 == 0 {
                normal = DVec3::AXES[usize::from(number / 2 % 3)];
            }
            let [a, b] = normal.any_orthonormal_pair().into();
            let size = draw.between(0.05, 0.4);
            mesh.append(&Mesh::parallelogram(middle, size * a, size * b));
            for _ in 0..4 {
                let speck = middle + 0.3 * draw.vector();
                mesh.append(&Mesh::parallelogram(speck, 1e-3 * a, 1e-3 * b));
                let off = draw.vector() * DVec3::new(size, size, f64::from(number % 3));
                let position_m = (middle + off.x * a + off.y * b + off.z * normal).as_vec3();
                draw.points.push(SurfacePoint { position_m, normal: normal.as_vec3() });
            }
        }
        draw.scene.objects = vec![Object::new("sheets", mesh)];
        draw
    }

    fn between(&mut self, low: f64, high: f64) -> f64 {
        self.random.random_range(low..high)
    }

    fn vector(&mut self) -> DVec3 {
        DVec3::from([(); 3].map(|()| self.between(-1.0, 1.0)))
    }

    /// A at the points, by a grid around the origin.
    fn occlusion(&self, gpu: &Gpu, (cells, voxel_m): ([u32; 3], f64), set: &str) -> Vec<f32> {
        let low = cells.map(|count| -0.5 * voxel_m * f64::from(count));
        let grid = format!("voxel.cells={cells:?} voxel.origin_m={low:?}").replace(", ", ",");
        let mut tree = parameter::tree(&Params::from(&SceneFile::load("plane").unwrap()));
        let set = format!("ao.rays={RAYS} {grid} voxel.voxel_m={voxel_m} {set}");
        for (path, value) in common::sets(&set) {
            parameter::set(&mut tree, &path, value).unwrap();
        }
        let params = fathom::pipelines::read(&tree).unwrap();
        occlusion_at(gpu, &self.scene, &params, &self.points).unwrap()
    }
}

/// Looks between samples find what samples at every fifth of a step do, up to the last whole step.
#[test]
fn looks_between_samples_leave_no_hit_out() {
    let (gpu, mut other) = (gpu(), 0);
    for seed in 0..draws() {
        let mut draw = SheetScene::new(seed);
        // In voxels.
        let step = 0.25 * 16f64.powf(draw.between(0.0, 1.0));
        let (threshold, side) = (draw.between(0.1, 0.95), draw.random.random_range(20..50));
        let voxel_m = 3.0 / f64::from(side);
        let run = |[step, r_max_m, threshold]: [f64; 3], hit: &str| {
            let set =
                format!("ao.step_voxels={step} ao.r_max_m={r_max_m} ao.threshold={threshold}");
            let set = format!("ao.attenuation=hard ao.hit={hit} {set}");
            draw.occlusion(&gpu, ([side; 3], voxel_m), &set)
        };
        let fifths = |r_max_m: f64| run([step / 5.0, r_max_m, threshold], "sample");
        let (least, most) = (fifths(1.0 - step * voxel_m), fifths(1.0));
        // Places between samples are rounded otherwise, which may end a ray elsewhere.
        let outside =
            |(a, (least, most)): (&f32, (&f32, &f32))| (least - a).max(a - most) > 1.01 / RAYS;
        let count = |looks: &[f32]| {
            looks.iter().zip(least.iter().zip(&most)).filter(|point| outside(*point)).count()
        };
        let missed = count(&run([step, 1.0, threshold], "peak"));
        assert_eq!(missed, 0, "{seed}: {side} voxels, step {step}, threshold {threshold}");
        other += u64::from(count(&run([step, 1.0, 0.5 * threshold], "peak")) > 0);
    }
    assert!(2 * other > draws(), "{other} draws show another threshold");
}

/// Points beyond the reach of rays are left out: a larger grid of the same voxels, in which they lie, changes nothing.
#[test]
fn points_out_of_reach_see_nothing() {
    let (gpu, mut far) = (gpu(), 0);
    for seed in 0..draws() {
        let mut draw = SheetScene::new(seed);
        let side = draw.random.random_range(24..40);
        let voxel_m = 2.6 / f64::from(side);
        let [r_max_m, offset] = [draw.between(0.1, 0.6), draw.between(2.0, 20.0)];
        for point in 0..draw.points.len() {
            let beyond = draw.between(0.0, r_max_m + offset * voxel_m);
            let toward = draw.vector();
            let place = toward * (1.3 + beyond) / toward.abs().max_element();
            let normal = (0.3 * draw.vector() - toward).normalize().as_vec3();
            draw.points[point] = SurfacePoint { position_m: place.as_vec3(), normal };
        }
        let shift = draw.between(-1.0, 1.0);
        let set = format!("ao.offset_voxels={offset} ao.shift_voxels={shift} ao.r_max_m={r_max_m}");
        let run = |side| draw.occlusion(&gpu, ([side; 3], voxel_m), &set);
        let own = run(side);
        let larger = run(side + 2 * ((r_max_m / voxel_m + offset) as u32 + 2));
        // Rounding of places ends single rays elsewhere.
        let apart = own.iter().zip(larger).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(apart <= 2.0 / RAYS, "{seed}: {apart}");
        let beyond = |p: &SurfacePoint| f64::from(p.position_m.abs().max_element()) - 1.3;
        let seen = draw.points.iter().zip(&own).filter(|(p, a)| beyond(p) > r_max_m && **a > 0.0);
        far += seen.count();
    }
    assert!(far > 0, "no offset brings a ray into reach");
}

/// The positions of a flat sheet's pixels lie in its plane at any size, slant and r_max; another sheet before it is seen.
#[test]
fn a_flat_sheet_does_not_occlude_itself() {
    let (gpu, mut seen) = (gpu(), 0);
    for seed in 0..draws() {
        let mut draw = SheetScene::new(seed);
        let scale = 10f64.powf(draw.between(-0.5, 1.5));
        let eye = draw.vector().normalize() * scale * draw.between(0.5, 2.0);
        let [a, mut b, mut c] = [(); 3].map(|()| scale * draw.vector());
        if (b - a).cross(c - a).dot(eye - a) < 0.0 {
            (b, c) = (c, b);
        }
        let small = "view.width=48 view.height=36 shadow.size=16";
        let (mut scene, mut params) = prepared::<Hsao>(&gpu, "plane", small);
        let target = (0.01 * scale * DVec3::ONE).to_array();
        let [near, far] = [0.01 * scale, 6.0 * scale];
        scene.objects.clear();
        params.camera = Camera::new(eye.to_array(), target, 60.0, [near, far]);
        params.hsao.r_max_m = scale * 200f64.powf(draw.between(-0.5, 1.0));
        let mut sheet = |corners: [DVec3; 3]| {
            let corners = corners.map(|p| p.as_vec3().to_array()).to_vec();
            scene.objects.push(Object::new("sheet", Mesh::smooth(corners, vec![0, 1, 2])));
            let drawn = built::<Hsao>(&gpu, &scene, &params);
            let visibility = read_texture(&gpu, &drawn.occlusion().unwrap().raw.1).unwrap();
            visibility.data.iter().copied().fold(1.0, f32::min)
        };
        let alone = sheet([a, b, c]);
        assert!(alone > 0.998, "{seed}: {alone}");
        seen += u64::from(sheet([a, b, 0.7 * eye]) < 0.9);
    }
    assert!(2 * seen > draws(), "{seen} draws show a second sheet");
}
