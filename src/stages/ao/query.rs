//! `ao/query`: volume ambient occlusion at given points. VAO §3 step 3, §5.1.

use encase::ShaderType;
use glam::Vec3;

use crate::kit::{self, Bind, Buffer, Dispatch, Group, Kernel, Resources};
use crate::marching::Marching;
use crate::shader_struct;
use crate::voxels::Voxels;
use crate::{Column, Output, OutputData, Stage, StageInfo};
use fathom_gpu::{GpuError, StageScope};
use fathom_record::Work;

pub const INFO: StageInfo = StageInfo {
    name: "ao/query",
    about: "volume ambient occlusion at given points and normals",
    source: "VAO §3 step 3, §5.1",
};

shader_struct! {
    /// `Point` in `shaders/ao/query.wgsl`.
    pub struct SurfacePoint {
        pub position_m: Vec3,
        /// Of unit length.
        pub normal: Vec3,
    }
}

pub struct Query {
    kernel: Kernel,
    /// One for each slice of the rays through each volume.
    dispatches: Vec<Dispatch>,
    count: u64,
    samples: u64,
    /// 1 − A of each point.
    pub visibility: Buffer,
}

impl Query {
    /// `points` holds one point at least. A query answers once: its buffer starts at 1 and is multiplied.
    pub fn new(
        resources: &Resources<'_>,
        volumes: &[Voxels],
        points: &[SurfacePoint],
        marching: &Marching,
    ) -> Result<Self, GpuError> {
        let resources = &resources.sized_by("points × ao.rays × samples");
        let count = points.len() as u64;
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC;
        let input = resources.structs("points", points, usage);
        resources.host_copies("points", input.size());
        let visibility = resources.filled_by(INFO.name, count * 4, usage, || {
            bytemuck::cast_slice(&vec![1f32; points.len()]).to_vec()
        });
        let binds = [Bind::Read(&input), Bind::Write(&visibility)];
        let point_group = Group::new(resources.gpu, INFO.name, &binds);
        let passes = marching.passes(resources, volumes, count)?;
        let (workgroups, mut defs) = (kit::linear_workgroups(count), marching.defs());
        defs.push(passes.def());
        let dispatch =
            |group: &Group| Dispatch::new(resources, INFO.name, &[&point_group, group], workgroups);
        let samples = volumes.iter().map(|v| marching.samples_in(&v.grid) as u64);
        let both = [&point_group, passes.first()];
        Ok(Self {
            kernel: Kernel::new(resources, INFO.name, (INFO.name, &defs[..]), &both)?,
            dispatches: passes.volumes().iter().flatten().map(dispatch).collect(),
            count,
            samples: samples.sum::<u64>() * u64::from(marching.rays),
            visibility,
        })
    }
}

impl Stage for Query {
    fn info(&self) -> &'static StageInfo {
        &INFO
    }

    fn encode(&self, scope: &mut StageScope<'_>) {
        scope.compute(|pass| {
            self.kernel.bind(pass);
            for dispatch in &self.dispatches {
                dispatch.run(pass);
            }
        });
    }

    /// Trilinear samples at most.
    fn work(&self) -> Work {
        Work {
            texel_fetches: self.count * self.samples,
            bytes_read: self.count * SurfacePoint::min_size().get(),
            bytes_written: self.count * 4,
            ..Work::default()
        }
    }

    /// Closed rays end.
    fn least_work(&self) -> Work {
        Work { texel_fetches: 0, ..self.work() }
    }

    fn outputs(&self) -> Vec<Output> {
        vec![Output {
            name: "visibility".into(),
            meaning: "1 − A at each point, in the order of the points".into(),
            columns: vec![Column {
                name: "visibility",
                unit: "1",
                meaning: "share of the cosine-weighted hemisphere that is open",
            }],
            data: OutputData::Buffer {
                buffer: self.visibility.raw(),
                stride_floats: 1,
                count: self.count as u32,
                row: Box::new(<[f32]>::to_vec),
            },
        }]
    }
}
