//! The three dispatches that `voxel/overlap` and `voxel/alpha` share: triangles against voxels.
//!
//! The first empties a queue. The second takes a triangle an invocation; triangles of many columns of voxels would keep their
//! workgroup waiting: they go to the queue. In the third a workgroup takes each large triangle, and all workgroups share each
//! huge one.

use encase::ShaderType;

use super::Part;
use super::clear::Cleared;
use crate::gpu::{GpuError, StageScope};
use crate::stages::geometry::Geometry;
use crate::stages::kit::{self, Bind, Group, Resources};
use crate::stages::voxels::Voxels;

/// Columns of voxels above which a triangle is large, and above which it is huge. Tuned on scenes bunny_dry and room, on a software
/// driver and with workgroups of a GPU in mind: more columns leave a few invocations of a workgroup at work for long.
const SMALL_COLUMNS: u32 = 32;
const LARGE_COLUMNS: u32 = 4096;
/// Workgroups of the dispatch of large triangles. Tuned likewise.
const LARGE_GROUPS: u32 = 128;

/// Host twin of `Batch` in `shaders/shared/triangles.wgsl`.
#[derive(Clone, Debug, PartialEq, ShaderType)]
pub struct BatchUniforms {
    pub first_index: u32,
    pub triangles: u32,
    pub small_columns: u32,
    pub large_columns: u32,
}

/// Which voxels a triangle sets, and what is stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Contact {
    /// All that it touches.
    Conservative,
    /// Those of a 6-separating surface.
    Thin,
    /// All that it touches, with the largest alpha of them.
    Alpha,
}

/// One volume's share.
struct Run {
    group: Group,
    part: Part,
    /// With [`Contact::Alpha`].
    alphas: Option<wgpu::Buffer>,
}

pub(super) struct Triangles {
    /// A dispatch each: the queue, small triangles, large ones.
    pipelines: [wgpu::ComputePipeline; 3],
    runs: Vec<Run>,
}

/// Bytes of the queue for so many triangles: two counters and a word each.
pub fn queue_bytes(triangles: u64) -> u64 {
    (2 + triangles) * 4
}

/// Workgroups of the dispatch of small triangles.
pub fn workgroups(triangles: u64) -> [u32; 3] {
    kit::linear_workgroups(triangles)
}

impl Triangles {
    /// `name` is the stage's, and names its shader.
    pub(super) fn new(
        resources: &Resources<'_>,
        name: &'static str,
        geometry: &Geometry,
        parts: &[Part],
        contact: Contact,
    ) -> Result<Self, GpuError> {
        let gpu = resources.gpu;
        let make = |part: &Part| Run::new(resources, name, geometry, part, contact);
        let runs: Vec<Run> = parts.iter().map(make).collect();
        let groups: Vec<&Group> = runs.iter().take(1).map(|run| &run.group).collect();
        let pipeline = |step: i32| -> Result<wgpu::ComputePipeline, GpuError> {
            let thin = i32::from(contact == Contact::Thin);
            let shader = gpu.shader(name, &[("THIN", thin), ("STEP", step)])?;
            Ok(kit::compute_pipeline(gpu, name, &shader, &groups))
        };
        Ok(Self { pipelines: [pipeline(0)?, pipeline(1)?, pipeline(2)?], runs })
    }

    /// Each volume's alphas, a word a voxel.
    pub(super) fn alphas(&self) -> impl Iterator<Item = &wgpu::Buffer> {
        self.runs.iter().filter_map(|run| run.alphas.as_ref())
    }

    /// What must be cleared before each frame.
    pub(super) fn cleared(&self) -> Vec<Cleared> {
        let of = |run: &Run| {
            let bits = Cleared::from(&run.part.voxels.bits);
            [Some(bits), run.alphas.as_ref().map(Cleared::from)]
        };
        self.runs.iter().flat_map(of).flatten().collect()
    }

    pub(super) fn volumes(&self) -> impl Iterator<Item = &Voxels> {
        self.runs.iter().map(|run| &run.part.voxels)
    }

    pub(super) fn triangles(&self) -> u64 {
        self.runs.iter().map(|run| run.part.triangles()).sum()
    }

    pub(super) fn encode(&self, scope: &mut StageScope<'_>) {
        scope.compute(|pass| {
            for (step, pipeline) in self.pipelines.iter().enumerate() {
                pass.set_pipeline(pipeline);
                for run in &self.runs {
                    let [x, y, z] = match step {
                        0 => [1, 1, 1],
                        1 => workgroups(run.part.triangles()),
                        _ => [LARGE_GROUPS, 1, 1],
                    };
                    pass.set_bind_group(0, &run.group.group, &[]);
                    pass.dispatch_workgroups(x, y, z);
                }
            }
        });
    }
}

impl Run {
    fn new(
        resources: &Resources<'_>,
        name: &'static str,
        geometry: &Geometry,
        part: &Part,
        contact: Contact,
    ) -> Self {
        let batch = BatchUniforms {
            first_index: part.indices.start,
            triangles: part.triangles() as u32,
            small_columns: SMALL_COLUMNS,
            large_columns: LARGE_COLUMNS,
        };
        let batch = resources.uniform(name, &batch);
        let queue = resources.storage("voxel queue", queue_bytes(part.triangles()));
        let voxels = &part.voxels;
        let alphas = (contact == Contact::Alpha)
            .then(|| resources.storage("voxel alphas", super::alpha::alphas_bytes(&voxels.grid)));
        let mut binds = vec![
            Bind::Uniform(&voxels.uniforms),
            Bind::Uniform(&batch),
            Bind::Read(&geometry.vertices),
            Bind::Read(&geometry.indices),
            Bind::Write(&voxels.bits),
            Bind::Write(&queue),
        ];
        if let Some(alphas) = &alphas {
            binds.extend([Bind::Read(&geometry.materials), Bind::Write(alphas)]);
        }
        Self { group: Group::new(resources.gpu, name, &binds), part: part.clone(), alphas }
    }
}
