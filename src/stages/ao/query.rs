//! `ao/query`: volume ambient occlusion at given points. VAO §3 step 3, §5.1.

use encase::{ShaderType, StorageBuffer};
use glam::Vec3;

use crate::gpu::{Demand, GpuError, StageScope};
use crate::record::Work;
use crate::stages::kit::{self, Bind, Group, Resources};
use crate::stages::marching::Marching;
use crate::stages::voxels::Voxels;
use crate::stages::{Column, Output, OutputData, Stage, StageInfo};

pub const INFO: StageInfo = StageInfo {
    name: "ao/query",
    about: "volume ambient occlusion at given points and normals",
    source: "VAO §3 step 3, §5.1",
};

/// Host twin of `Point` in `shaders/ao/query.wgsl`.
#[derive(Clone, Debug, PartialEq, ShaderType)]
pub struct Point {
    pub position_m: Vec3,
    /// Of unit length.
    pub normal: Vec3,
}

pub struct Query {
    pipeline: wgpu::ComputePipeline,
    points: Group,
    volumes: Vec<wgpu::BindGroup>,
    count: u64,
    samples: u64,
    /// 1 − A of each point.
    pub visibility: wgpu::Buffer,
}

/// What a query of so many points asks of an adapter.
pub fn demand(points: u64) -> Demand {
    let bytes = points * Point::min_size().get();
    Demand::new()
        .storage("points", bytes)
        .holds("points", bytes + points * size_of::<f32>() as u64)
        .copies("points", bytes)
        .dispatch(INFO.name, kit::linear_workgroups(points).map(u64::from))
}

impl Query {
    /// `points` holds one point at least. A query answers once: its buffer starts at 1 and is multiplied.
    pub fn new(
        resources: &Resources<'_>,
        volumes: &[Voxels],
        points: &[Point],
        marching: &Marching,
    ) -> Result<Self, GpuError> {
        let gpu = resources.gpu;
        let mut bytes = StorageBuffer::new(Vec::new());
        bytes.write(points).expect("a Vec grows to whatever a shader type needs");
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC;
        let input = resources.filled("ao/query points", &bytes.into_inner(), usage);
        let open = vec![1f32; points.len()];
        let visibility = resources.filled(INFO.name, bytemuck::cast_slice(&open), usage);
        let point_group =
            Group::new(gpu, INFO.name, &[Bind::Read(&input), Bind::Write(&visibility)]);
        let groups: Vec<Group> =
            volumes.iter().map(|voxels| marching.group(resources, voxels)).collect();
        let first = groups
            .first()
            .ok_or_else(|| GpuError::Limit("there is no volume to march through".into()))?;
        let shader = gpu.shader(INFO.name, &marching.defs())?;
        let pipeline = kit::compute_pipeline(gpu, INFO.name, &shader, &[&point_group, first]);
        let samples = volumes.iter().map(|v| marching.samples_in(&v.grid) as u64);
        Ok(Self {
            pipeline,
            points: point_group,
            volumes: groups.into_iter().map(|group| group.group).collect(),
            count: points.len() as u64,
            samples: samples.sum::<u64>() * u64::from(marching.rays),
            visibility,
        })
    }
}

impl Stage for Query {
    fn name(&self) -> &'static str {
        INFO.name
    }

    fn encode(&self, scope: &mut StageScope<'_>) {
        let [x, y, z] = kit::linear_workgroups(self.count);
        scope.compute(|pass| {
            pass.set_pipeline(&self.pipeline);
            pass.set_bind_group(0, &self.points.group, &[]);
            for volume in &self.volumes {
                pass.set_bind_group(1, volume, &[]);
                pass.dispatch_workgroups(x, y, z);
            }
        });
    }

    /// Trilinear samples at most.
    fn work(&self) -> Work {
        Work {
            texel_fetches: self.count * self.samples,
            bytes_read: self.count * Point::min_size().get(),
            bytes_written: self.count * 4,
            ..Work::default()
        }
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
                buffer: self.visibility.clone(),
                stride_floats: 1,
                count: self.count as u32,
                row: Box::new(<[f32]>::to_vec),
            },
        }]
    }
}
