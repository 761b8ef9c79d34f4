//! `scene/deform`: geometry in motion, each object about its own foot: vertices at rest to those of a moment, with normals.
//!
//! `spin` turns an object about its vertical axis. `twist` swings it, the further the higher: the top by `amplitude` turns.
//! `wave` moves vertices along their normals by `amplitude` of the object's height, one wave over the height, travelling up.
//! The paper's dynamic geometry (VAO §4.2) is animated characters; these motions touch every vertex as theirs does.

use glam::Vec3;

use crate::geometry::Geometry;
use crate::kit::{self, Bind, Dispatch, Group, Kernel, Resources};
use crate::shader_struct;
use crate::{Column, Output, OutputData, Stage, StageInfo};
use fathom_gpu::{GpuError, StageScope};
use fathom_record::Work;
use fathom_scene::Scene;

pub const INFO: StageInfo = StageInfo {
    name: "scene/deform",
    about: "vertices and normals of moving geometry: spin, twist or wave of each object",
    source: "VAO §4.2",
};

/// Floats of a vertex: position, normal, material.
const STRIDE: u32 = 7;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Motion {
    Spin,
    Twist,
    Wave,
}

shader_struct! {
    /// `Deform` in `shaders/scene/deform.wgsl`.
    pub struct DeformUniforms {
        pub vertices: u32,
        pub cycles: f32,
        pub amplitude: f32,
    }
}

shader_struct! {
    /// `Pivot` in `shaders/scene/deform.wgsl`.
    pub struct PivotUniforms {
        pub foot_m: Vec3,
        pub height_m: f32,
    }
}

pub struct Deform {
    kernel: Kernel,
    dispatch: Dispatch,
    geometry: Geometry,
}

/// The middle of an object's foot, and its height.
fn pivots(scene: &Scene) -> Vec<PivotUniforms> {
    scene
        .objects
        .iter()
        .map(|object| {
            let bounds = object.mesh.bounds();
            PivotUniforms {
                foot_m: bounds.center().with_y(bounds.min.y).as_vec3(),
                height_m: bounds.size().y as f32,
            }
        })
        .collect()
}

impl Deform {
    /// Rewrites the vertices of `geometry`, which must hold those of `scene`, at rest, when this is called. `cycles` is time ×
    /// frequency.
    pub fn new(
        resources: &Resources<'_>,
        geometry: &Geometry,
        scene: &Scene,
        motion: Motion,
        (cycles, amplitude): (f64, f64),
    ) -> Result<Self, GpuError> {
        let uniforms = DeformUniforms {
            vertices: geometry.vertices() as u32,
            cycles: cycles.rem_euclid(1.0) as f32,
            amplitude: amplitude as f32,
        };
        let uniforms = resources.uniform(INFO.name, &uniforms);
        let storage = wgpu::BufferUsages::STORAGE;
        let pivots = resources.structs("pivots", &pivots(scene), wgpu::BufferUsages::empty());
        let bytes = geometry.vertices.size();
        let rest = || Geometry::vertex_bytes(scene);
        let rest = resources.filled_by("vertices at rest", bytes, storage, rest);
        let binds = [
            Bind::Uniform(&uniforms),
            Bind::Read(&pivots),
            Bind::Read(&rest),
            Bind::Write(&geometry.vertices),
        ];
        let groups = [&Group::new(resources.gpu, INFO.name, &binds)];
        let workgroups = kit::linear_workgroups(geometry.vertices());
        let defs = [("MOTION", motion as i32)];
        Ok(Self {
            kernel: Kernel::new(resources, INFO.name, (INFO.name, &defs[..]), &groups)?,
            dispatch: Dispatch::new(resources, INFO.name, &groups, workgroups),
            geometry: geometry.clone(),
        })
    }
}

impl Stage for Deform {
    fn info(&self) -> &'static StageInfo {
        &INFO
    }

    fn encode(&self, scope: &mut StageScope<'_>) {
        scope.compute(|pass| self.kernel.run(pass, &self.dispatch));
    }

    fn work(&self) -> Work {
        let vertices = self.geometry.vertices();
        Work {
            bytes_read: vertices * u64::from(STRIDE) * 4,
            // The material stays.
            bytes_written: vertices * 6 * 4,
            ..Work::default()
        }
    }

    fn outputs(&self) -> Vec<Output> {
        let column = Column::new;
        vec![Output {
            name: "vertices".into(),
            meaning: "vertices of this moment".into(),
            columns: vec![
                column("x", "m", "position"),
                column("y", "m", "position"),
                column("z", "m", "position"),
                column("nx", "1", "unit normal"),
                column("ny", "1", "unit normal"),
                column("nz", "1", "unit normal"),
            ],
            data: OutputData::Buffer {
                buffer: self.geometry.vertices.raw(),
                stride_floats: STRIDE,
                count: self.geometry.vertices() as u32,
                row: Box::new(|vertex| vertex[..6].to_vec()),
            },
        }]
    }
}
