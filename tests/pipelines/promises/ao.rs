//! Volume and screen-space ambient occlusion: skipping, looks between samples, points out of reach, positions by vectors.

use fathom::gpu::{Gpu, read_texture};
use fathom::parameter::{self, tree};
use fathom::pipelines::Drawing;
use fathom::pipelines::hsao::Hsao;
use fathom::pipelines::volume_ao::{Params, occlusion_at};
use fathom::reference::horizon::{HorizonSplit, SeenDepth};
use fathom::reference::image::{Image, pixels};
use fathom::reference::occlusion::Attenuation;
use fathom::scene::{Camera, Mesh, Object, Scene, SceneFile};
use fathom::stages::ao::query::SurfacePoint;
use glam::DVec3;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

use super::super::{built, common, gpu, prepared};
use super::draws;

const RAYS: f64 = 48.0;

struct Draw {
    seed: u64,
    random: Pcg64,
    scene: Scene,
    points: Vec<SurfacePoint>,
}

impl Draw {
    /// Sheets in a cube of 2 m around the origin, half of them along the axes, with specks of a voxel and points on and around them.
    fn new(seed: u64) -> Self {
        let mut draw = Self {
            seed,
            random: Pcg64::seed_from_u64(seed),
            scene: Scene::load("plane").unwrap(),
            points: Vec::new(),
        };
        let mut mesh = Mesh::default();
        for number in 0..draw.random.random_range(3..16_u8) {
            let (middle, normal) = (0.6 * draw.vector(), draw.vector().normalize());
            let normal =
                if number % 2 == 0 { DVec3::AXES[usize::from(number / 2 % 3)] } else { normal };
            let [a, b] = normal.any_orthonormal_pair().into();
            let size = draw.between(0.05, 0.4);
            mesh.append(&Mesh::parallelogram(middle, size * a, size * b));
            for _ in 0..4 {
                let speck = middle + 0.3 * draw.vector();
                mesh.append(&Mesh::parallelogram(speck, 1e-3 * a, 1e-3 * b));
                let [x, y, off] = [(); 3].map(|()| draw.between(-1.0, 1.0));
                let position =
                    middle + size * (x * a + y * b) + f64::from(number % 3) * off * normal;
                let (position_m, normal) = (position.as_vec3(), normal.as_vec3());
                draw.points.push(SurfacePoint { position_m, normal });
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

    fn of<'a>(&mut self, choices: &[&'a str]) -> &'a str {
        choices[self.random.random_range(0..choices.len())]
    }

    /// A grid that fits, or one by hand of another shape that cuts the sheets.
    fn grid(&mut self) -> String {
        if self.seed % 2 == 0 {
            return format!("voxel.resolution={}", self.random.random_range(12..56));
        }
        let (cells, voxel_m) =
            ([(); 3].map(|()| self.random.random_range(5..40_u32)), self.between(0.03, 0.1));
        let middle = self.points[0].position_m.as_dvec3();
        let origin = (middle
            - voxel_m * DVec3::from(cells.map(f64::from)) * self.between(0.1, 0.9))
        .to_array();
        format!("voxel.cells={cells:?} voxel.origin_m={origin:?} voxel.voxel_m={voxel_m}")
            .replace(", ", ",")
    }

    /// A at the points.
    fn occlusion(&self, gpu: &Gpu, set: &str) -> Vec<f32> {
        occlusion_at(gpu, &self.scene, &params(set), &self.points).unwrap()
    }
}

/// The pipeline's parameters with these.
fn params(set: &str) -> Params {
    let mut tree = tree(&Params::from(&SceneFile::load("plane").unwrap()));
    for (path, value) in common::sets(&format!("ao.rays={RAYS} {set}")) {
        parameter::set(&mut tree, &path, value).unwrap();
    }
    fathom::pipelines::read(&tree).unwrap()
}

#[test]
fn skipping_changes_no_bit() {
    let (gpu, mut moved) = (gpu(), 0);
    for seed in 0..draws() {
        let mut draw = Draw::new(seed);
        let mut set = draw.grid();
        for (path, choices) in [
            ("voxel.method", &["overlap", "overlap_thin", "slicemap"][..]),
            ("ao.attenuation", &["linear", "hard"]),
            ("ao.estimator", &["unbiased", "paper"]),
            ("ao.guard", &["variable", "voxel", "none", "seven_voxels"]),
            ("ao.sampling", &["stratified", "random"]),
            ("ao.hit", &["peak", "peak", "sample"]),
            ("ao.occluder", &["binary", "binary", "opacity"]),
            ("ao.jitter", &["false", "true"]),
            ("ao.storage", &["texture", "texture", "bits"]),
        ] {
            set += &format!(" {path}={}", draw.of(choices));
        }
        let [step, threshold] =
            [0.25 * 16f64.powf(draw.between(0.0, 1.0)), draw.between(0.1, 0.95)];
        let [offset, r_max] = [draw.between(0.0, 1.0), draw.between(0.3, 3.0)];
        set += &format!(" ao.step_voxels={step} ao.threshold={threshold}");
        set += &format!(" ao.offset_voxels={offset} ao.r_max_m={r_max}");
        let plain = draw.occlusion(&gpu, &set);
        assert_eq!(
            plain,
            draw.occlusion(&gpu, &format!("{set} ao.skipping=true")),
            "{seed}: {set}"
        );
        moved += u64::from(plain != draw.occlusion(&gpu, &format!("{set} ao.seed=1")));
    }
    assert!(2 * moved > draws(), "{moved} draws show another seed");
}

/// Looks between samples find what samples at every fifth of a step do, up to the last whole step.
#[test]
fn looks_between_samples_leave_no_hit_out() {
    let (gpu, mut other) = (gpu(), 0);
    for seed in 0..draws() {
        let mut draw = Draw::new(seed);
        let resolution = draw.random.random_range(16..48);
        let [step, threshold] =
            [0.25 * 16f64.powf(draw.between(0.0, 1.0)), draw.between(0.3, 0.95)];
        let set = format!("voxel.resolution={resolution} ao.attenuation=hard ao.r_max_share=0.5");
        let params = params(&set);
        let voxel_m =
            params.voxel.grids(&draw.scene, &params.camera, &params.animation).unwrap()[0].voxel_m;
        let run = |hit: &str, step: f64, r_max_m: f64, threshold: f64| {
            let set = format!(
                "{set} ao.hit={hit} ao.step_voxels={step} ao.r_max_m={r_max_m} ao.threshold={threshold}"
            );
            draw.occlusion(&gpu, &set)
        };
        let looks = run("peak", step, 1.0, threshold);
        let [least, most] = [1.0 - step * voxel_m, 1.0]
            .map(|r_max_m| run("sample", step / 5.0, r_max_m, threshold));
        let outside = |looks: &[f32]| {
            let ends = least.iter().zip(&most).zip(looks);
            // Places between samples are rounded otherwise, which may end a ray elsewhere.
            let ray = 1.01 / RAYS as f32;
            ends.filter(|((least, most), a)| **a < *least - ray || **a > *most + ray).count()
        };
        assert_eq!(outside(&looks), 0, "{seed}: {set} step {step} threshold {threshold}");

        other += u64::from(outside(&run("peak", step, 1.0, threshold - 0.2)) > 0);
    }
    assert!(2 * other > draws(), "{other} draws show another threshold");
}

/// Points farther from the volume than rays reach are left out: a larger grid of the same voxels, in which they lie, changes nothing.
#[test]
fn points_out_of_reach_see_nothing() {
    let (gpu, mut far) = (gpu(), 0);
    for seed in 0..draws() {
        let mut draw = Draw::new(seed);
        let side = draw.random.random_range(24..40);
        let voxel_m = 2.6 / f64::from(side);
        let [r_max_m, offset] = [draw.between(0.1, 0.6), draw.between(2.0, 20.0)];
        let beyond = |p: &SurfacePoint| f64::from(p.position_m.abs().max_element()) - 1.3;
        let mut points = draw.points.clone();
        for point in &mut points {
            let reach = 1.3 + draw.between(0.0, r_max_m + offset * voxel_m);
            let place = draw.vector();
            point.position_m = (place * reach / place.abs().max_element()).as_vec3();
            point.normal = (0.3 * draw.vector() - place).normalize().as_vec3();
        }
        draw.points = points;
        let run = |around: u32| {
            let (cells, low) = ([side + 2 * around; 3], -1.3 - f64::from(around) * voxel_m);
            let grid = format!("voxel.cells={cells:?} voxel.origin_m={:?}", [low; 3]);
            let set =
                format!("voxel.voxel_m={voxel_m} ao.offset_voxels={offset} ao.r_max_m={r_max_m}");
            draw.occlusion(&gpu, &format!("{} {set}", grid.replace(", ", ",")))
        };
        let (own, larger) = (run(0), run(((r_max_m / voxel_m + offset) as u32) + 2));
        // Rounding of places ends single rays elsewhere.
        let apart = own.iter().zip(&larger).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(f64::from(apart) <= 2.0 / RAYS, "{seed}: {apart}");
        let seen = draw.points.iter().zip(&own).filter(|(p, a)| beyond(p) > r_max_m && **a > 0.0);
        far += seen.count();
    }
    assert!(far > 0, "no offset brings a ray into reach");
}

/// `hsao/march` of objects: A by the GPU, and by its f64 twin with r_max so many times as long.
fn horizons(
    gpu: &Gpu,
    scene: &Scene,
    camera: Camera,
    r_max_m: f64,
    twins: &[f64],
) -> Vec<Vec<f64>> {
    let (_, mut params) =
        prepared::<Hsao>(gpu, "plane", "view.width=48 view.height=36 shadow.size=16");
    (params.camera, params.hsao.r_max_m) = (camera, r_max_m);
    let drawn = built::<Hsao>(gpu, scene, &params);
    let buffers = drawn.occlusion().unwrap();
    let read = |texture| read_texture(gpu, texture).unwrap();
    let [raw, depth, normal] =
        [&buffers.raw.1, &buffers.gbuffer.depth, &buffers.gbuffer.normal].map(read);
    let own = raw.data.iter().step_by(raw.channels as usize).map(|v| 1.0 - f64::from(*v)).collect();
    let size = [depth.width, depth.height];
    let depth = Image::from_data(size, depth.data.iter().map(|z| f64::from(*z)).collect());
    let normals: Vec<DVec3> = normal
        .data
        .chunks_exact(4)
        .map(|n| DVec3::new(n[0].into(), n[1].into(), n[2].into()))
        .collect();
    let seen = SeenDepth::new(&params.camera, &depth, &normals);
    let twin = |times: &f64| {
        let hsao = &params.hsao;
        let r_max_m = times * r_max_m;
        let split = HorizonSplit {
            directions: hsao.directions,
            steps: hsao.steps,
            rays: hsao.rays,
            ray_steps: hsao.ray_steps,
            r_max_m,
            layer_m: hsao.layer_share * r_max_m,
            attenuation: Attenuation::Linear,
            seed: 0,
        };
        pixels(size).map(|(x, y)| split.at(&seen, size, x, y).unwrap_or(0.0)).collect()
    };
    std::iter::once(own).chain(twins.iter().map(twin)).collect()
}

#[test]
fn horizons_are_those_of_exact_positions() {
    let (gpu, mut other) = (gpu(), 0);
    let largest = |a: &[f64]| a.iter().copied().fold(0.0, f64::max);
    for seed in 0..draws() {
        let mut draw = Draw::new(seed);
        let scale = 10f64.powf(draw.between(-0.5, 1.5));
        let eye = draw.vector().normalize() * scale * draw.between(0.5, 2.0);
        let [a, mut b, mut c] = [(); 3].map(|()| scale * draw.vector());
        if (b - a).cross(c - a).dot(eye - a) < 0.0 {
            (b, c) = (c, b);
        }
        let corners = [a, b, c].map(|p| p.as_vec3().to_array()).to_vec();
        let sheet = vec![Object::new("sheet", Mesh::smooth(corners, vec![0, 1, 2]))];
        let camera = |eye: DVec3, scale: f64| {
            Camera::new(eye.to_array(), [0.01 * scale; 3], 60.0, [0.01 * scale, 6.0 * scale])
        };
        let r_max_m = scale * 200f64.powf(draw.between(-0.5, 1.0));
        let scene = Scene { objects: sheet, ..draw.scene.clone() };
        let found = horizons(&gpu, &scene, camera(eye, scale), r_max_m, &[]);
        assert!(largest(&found[0]) < 2e-3, "{seed}: {}", largest(&found[0]));

        let r_max_m = draw.between(0.1, 3.0);
        let found =
            horizons(&gpu, &draw.scene, camera(2.0 / scale * eye, 1.0), r_max_m, &[1.0, 1.2]);
        let apart = |twin: &[f64]| {
            found[0].iter().zip(twin).filter(|(a, b)| (*a - *b).abs() > 2e-3).count()
        };
        // Where rounding puts a sample on the other side of a border between texels.
        assert!(apart(&found[1]) <= 48 * 36 / 200, "{seed}: {} pixels", apart(&found[1]));
        other += apart(&found[2]);
    }
    assert!(other as u64 > 20 * draws(), "{other} pixels show a longer r_max");
}
