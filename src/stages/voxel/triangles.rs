//! What `voxel/overlap` and `voxel/alpha` are: triangles against voxels, in three dispatches.
//!
//! The first empties a queue. The second takes a triangle an invocation; triangles of many columns of voxels would keep their
//! workgroup waiting: they go to the queue. In the third a workgroup takes each large triangle, and all workgroups share each
//! huge one.

use super::clear::Cleared;
use super::{Part, bit_volumes};
use crate::gpu::{GpuError, StageScope};
use crate::record::Work;
use crate::shader_struct;
use crate::stages::geometry::Geometry;
use crate::stages::kit::{self, Bind, Buffer, Dispatch, Group, Kernel, Resources};
use crate::stages::voxels::Voxels;
use crate::stages::{Output, Stage, StageInfo};

/// Columns of voxels above which a triangle is large, and above which it is huge. Tuned on scenes bunny_dry and room, on a software
/// driver and with workgroups of a GPU in mind: more columns leave a few invocations of a workgroup at work for long.
const SMALL_COLUMNS: u32 = 32;
const LARGE_COLUMNS: u32 = 4096;
/// Workgroups of the dispatch of large triangles. Tuned likewise.
const LARGE_GROUPS: u32 = 128;

shader_struct! {
    /// `Batch` in `shaders/shared/triangles.wgsl`.
    pub struct BatchUniforms {
        pub first_index: u32,
        pub triangles: u32,
        pub small_columns: u32,
        pub large_columns: u32,
    }
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
    /// The queue, small triangles, large ones.
    dispatches: [Dispatch; 3],
    voxels: Voxels,
    triangles: u64,
    /// With [`Contact::Alpha`], 0 … 255 in a word a voxel.
    alphas: Option<Buffer>,
}

pub struct Triangles {
    info: &'static StageInfo,
    /// One for each of a run's dispatches.
    kernels: [Kernel; 3],
    runs: Vec<Run>,
    bytes_read: u64,
}

impl Triangles {
    /// The stage `info`.
    pub(super) fn new(
        resources: &Resources<'_>,
        info: &'static StageInfo,
        geometry: &Geometry,
        parts: &[Part],
        contact: Contact,
    ) -> Result<Self, GpuError> {
        let make = |part: &Part| Run::new(resources, info.name, geometry, part, contact);
        let runs: Vec<Run> = parts.iter().map(make).collect();
        let groups: Vec<&Group> = runs.iter().take(1).map(|run| &run.group).collect();
        let kernel = |step: i32| {
            let defs = [("THIN", i32::from(contact == Contact::Thin)), ("STEP", step)];
            Kernel::new(resources, info.name, (info.name, &defs[..]), &groups)
        };
        let kernels = [kernel(0)?, kernel(1)?, kernel(2)?];
        Ok(Self { info, kernels, runs, bytes_read: geometry.bytes() })
    }

    /// Each volume's alphas, a word a voxel.
    pub fn alphas(&self) -> impl Iterator<Item = &Buffer> {
        self.runs.iter().filter_map(|run| run.alphas.as_ref())
    }

    /// What must be cleared before each frame.
    pub fn cleared(&self) -> Vec<Cleared> {
        let of = |run: &Run| {
            let bits = Cleared::from(&run.voxels.bits);
            [Some(bits), run.alphas.as_ref().map(Cleared::from)]
        };
        self.runs.iter().flat_map(of).flatten().collect()
    }
}

impl Stage for Triangles {
    fn info(&self) -> &'static StageInfo {
        self.info
    }

    fn encode(&self, scope: &mut StageScope<'_>) {
        scope.compute(|pass| {
            for (step, kernel) in self.kernels.iter().enumerate() {
                kernel.bind(pass);
                for run in &self.runs {
                    run.dispatches[step].run(pass);
                }
            }
        });
    }

    fn work(&self) -> Work {
        Work {
            triangles: self.runs.iter().map(|run| run.triangles).sum(),
            bytes_read: self.bytes_read,
            ..Work::default()
        }
    }

    /// A compute pass: no rasterizer draws the triangles.
    fn least_work(&self) -> Work {
        Work { triangles: 0, ..self.work() }
    }

    fn outputs(&self) -> Vec<Output> {
        bit_volumes(self.runs.iter().map(|run| &run.voxels))
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
        let (voxels, triangles) = (&part.voxels, part.triangles());
        let batch = BatchUniforms {
            first_index: part.indices.start,
            triangles: triangles as u32,
            small_columns: SMALL_COLUMNS,
            large_columns: LARGE_COLUMNS,
        };
        let batch = resources.uniform(name, &batch);
        // Two counters, and a word for each triangle.
        let queue = resources.storage("voxel queue", (2 + triangles) * 4);
        let alphas = (contact == Contact::Alpha)
            .then(|| resources.storage("voxel alphas", voxels.grid.count() * 4));
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
        let group = Group::new(resources.gpu, name, &binds);
        let small = kit::linear_workgroups(triangles);
        let dispatches = [[1, 1, 1], small, [LARGE_GROUPS, 1, 1]]
            .map(|workgroups| Dispatch::new(resources, name, &[&group], workgroups));
        Self { group, dispatches, voxels: voxels.clone(), triangles, alphas }
    }
}
