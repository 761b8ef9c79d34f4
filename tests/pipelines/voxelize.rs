//! The pipeline `voxelize`: grids of all shapes, geometry outside them, volumes by the object, and
//! triangles that stretch.

use fathom::gpu::{Gpu, read_buffer};
use fathom::pipelines::settings::{Deform, VoxelMethod};
use fathom::pipelines::voxelize::{Params, Voxelize};
use fathom::pipelines::{BuiltPipeline, PipelineInstance};
use fathom::scene::{Scene, SceneFile};
use fathom::stages::voxel::slicemap::Rasterizer;

use super::gpu;

const METHODS: [VoxelMethod; 4] =
    [VoxelMethod::Slicemap, VoxelMethod::Slice, VoxelMethod::Overlap, VoxelMethod::MaxAlpha];

/// A floor, a ball and a box beside it, in dry air.
const SCENE: &str = r#"
name = "test"
description = "a floor, a ball and a box"
floor_depth_m = 1.0
[camera]
position_m = [0.0, 1.0, 5.0]
target_m = [0.0, 0.0, 0.0]
fov_y_deg = 45.0
z_near_m = 0.1
z_far_m = 20.0
[[object]]
name = "floor"
generator = "plane"
params = { width_m = 4.0, depth_m = 3.0 }
[[object]]
name = "ball"
generator = "sphere"
transform = { translate_m = [-0.7, 0.3, 0.1] }
[[object]]
name = "box"
generator = "box"
transform = { translate_m = [1.0, 0.1, -0.2], rotate_deg = [0.0, 20.0, 0.0] }
"#;

struct VoxelFixture {
    gpu: Gpu,
    file: SceneFile,
    scene: Scene,
}

impl VoxelFixture {
    fn new() -> Self {
        let file = SceneFile::parse("test.toml", SCENE).unwrap();
        Self { gpu: gpu(), scene: Scene::build(&file).unwrap(), file }
    }

    /// Two frames of the pipeline: what the first leaves behind must not be in the second.
    fn frames(&self, change: impl FnOnce(&mut Params)) -> BuiltPipeline<Voxelize> {
        let mut params = Params::from(&self.file);
        params.voxel.resolution = 24;
        (params.view.width, params.view.height) = (16, 16);
        change(&mut params);
        let make = || BuiltPipeline::<Voxelize>::new(&self.gpu, &self.scene, &params);
        let pipeline = self.gpu.catch(make).unwrap();
        let mut frame = pipeline.stages();
        frame.extend(pipeline.presenting());
        for _ in 0..2 {
            self.gpu.run(&frame).unwrap();
        }
        pipeline
    }

    fn occupied(&self, pipeline: &Voxelize) -> f64 {
        pipeline.quantities(&self.gpu).unwrap()["occupied_voxels"]
    }

    fn bits(&self, pipeline: &Voxelize, volume: usize) -> Vec<u8> {
        read_buffer(&self.gpu, &pipeline.volumes[volume].bits).unwrap()
    }
}

#[test]
fn grids_of_all_shapes_and_places() {
    let fixture = VoxelFixture::new();
    for method in METHODS {
        let frames = |cells: [u32; 3], origin_m: [f64; 3], voxel_m: f64| {
            let pipeline = fixture.frames(|params| {
                params.voxel.method = method;
                params.pyramid = true;
                params.voxel.cells = cells;
                (params.voxel.origin_m, params.voxel.voxel_m) = (origin_m, voxel_m);
            });
            fixture.occupied(&pipeline)
        };
        // Between ball and box.
        assert_eq!(frames([4, 4, 4], [0.0, -0.3, 0.0], 0.02), 0.0, "{method:?}");
        // One voxel around everything: no middle line of its sides need meet the surface.
        if method == VoxelMethod::Overlap || method == VoxelMethod::MaxAlpha {
            assert_eq!(frames([1, 1, 1], [-3.0, -3.0, -3.0], 6.0), 1.0, "{method:?}");
        }
        // A part of the scene, in rows longer than a copy's alignment.
        let part = frames([270, 5, 2], [-1.5, -0.4, 0.1], 0.01);
        assert!(part > 0.0 && part < 2700.0, "{method:?}: {part}");
    }
}

#[test]
fn each_object_fills_its_own_volume() {
    let fixture = VoxelFixture::new();
    for method in METHODS {
        let apart = fixture.frames(|params| {
            params.voxel.method = method;
            params.voxel.per_object = true;
        });
        assert_eq!(apart.volumes.len(), 3);
        let mut alone = VoxelFixture::new();
        alone.scene.objects.drain(..2);
        let pipeline = alone.frames(|params| params.voxel.method = method);
        assert_eq!(fixture.bits(&apart, 2), alone.bits(&pipeline, 0), "{method:?}");
    }
}

/// With an amplitude of ten heights small triangles become larger than what the compute shader can hold.
#[test]
fn triangles_that_stretch_are_drawn_by_the_hardware() {
    let fixture = VoxelFixture::new();
    for deform in [Deform::Twist, Deform::Wave] {
        let [mixed, hardware] = [Rasterizer::Mixed, Rasterizer::Hardware].map(|rasterizer| {
            let pipeline = fixture.frames(|params| {
                params.animation.deform = deform;
                params.animation.time_s = 0.3;
                params.animation.amplitude = 10.0;
                params.voxel.rasterizer = rasterizer;
                params.voxel.resolution = 512;
            });
            fixture.bits(&pipeline, 0)
        });
        assert!(mixed == hardware, "{deform:?}");
    }
}
