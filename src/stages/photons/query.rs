//! `photons/query`: photons from given starts through the water to the scene. UW §3.3.

use bytemuck::{Pod, Zeroable};
use encase::{ShaderType, StorageBuffer};
use glam::Vec3;

use crate::gpu::{Demand, GpuError, StageScope};
use crate::record::Work;
use crate::stages::frame::Shared;
use crate::stages::kit::{self, Bind, Group, Resources};
use crate::stages::photon::{Photon, TraceUniforms};
use crate::stages::{Column, Output, OutputData, Stage, StageInfo};

pub const INFO: StageInfo = StageInfo {
    name: "photons/query",
    about: "photons from given starts: water intersection, refraction, image-space estimator",
    source: "UW §3.3",
};

/// Host twin of `Start` in `shaders/photons/query.wgsl`.
#[derive(Clone, Debug, PartialEq, ShaderType)]
pub struct Start {
    pub position_m: Vec3,
    /// 1: the direction is given; 0: the light's own ray runs through the start.
    pub aimed: u32,
    /// Of unit length where it is given.
    pub direction: Vec3,
}

/// Host twin of `Answer` in `shaders/photons/query.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable, ShaderType)]
pub struct Answer {
    pub photon: Photon,
    /// After refraction, unit length; 0 for a photon that never enters the water.
    pub direction: Vec3,
    /// Share of a photon's flux that enters the water.
    pub weight: f32,
}

pub struct Query {
    pipeline: wgpu::ComputePipeline,
    shared: wgpu::BindGroup,
    group: Group,
    count: u64,
    iterations: u64,
    /// An [`Answer`] for each start.
    pub answers: wgpu::Buffer,
}

/// What a query of so many starts asks of an adapter.
pub fn demand(starts: u64) -> Demand {
    Demand::new()
        .storage("starts", starts * Answer::min_size().get())
        .dispatch(INFO.name, kit::linear_workgroups(starts).map(u64::from))
}

impl Query {
    /// `starts` holds one at least; `depth` and `mask` are the light's. Of the settings the grid plays no part.
    pub fn new(
        resources: &Resources<'_>,
        shared: &Shared,
        (depth, mask): (&wgpu::Texture, &wgpu::Texture),
        starts: &[Start],
        settings: &TraceUniforms,
        conserving: bool,
    ) -> Result<Self, GpuError> {
        let gpu = resources.gpu;
        let defs =
            [("CONSERVING", i32::from(conserving)), shared.fresnel_def(), shared.water_def()];
        let shader = gpu.shader(INFO.name, &defs)?;
        let mut bytes = StorageBuffer::new(Vec::new());
        bytes.write(starts).expect("a Vec grows to whatever a shader type needs");
        let usage = wgpu::BufferUsages::STORAGE;
        let input = resources.filled("photons/query starts", &bytes.into_inner(), usage);
        let count = starts.len() as u64;
        let answers = resources.storage(INFO.name, count * Answer::min_size().get());
        let uniforms = resources.uniform(INFO.name, settings);
        let texels = gpu.device.create_sampler(&wgpu::SamplerDescriptor {
            label: Some(INFO.name),
            ..Default::default()
        });
        let binds = [
            Bind::Uniform(&uniforms),
            Bind::Depth(depth),
            Bind::Texels(mask),
            Bind::Read(&input),
            Bind::Write(&answers),
            Bind::NearestSampler(&texels),
        ];
        let group = Group::new(gpu, INFO.name, &binds);
        Ok(Self {
            pipeline: kit::compute_pipeline(gpu, INFO.name, &shader, &[&shared.group, &group]),
            shared: shared.group.group.clone(),
            group,
            count,
            iterations: settings.iterations.into(),
            answers,
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
            pass.set_bind_group(0, &self.shared, &[]);
            pass.set_bind_group(1, &self.group.group, &[]);
            pass.dispatch_workgroups(x, y, z);
        });
    }

    fn work(&self) -> Work {
        Work {
            photons: self.count,
            // Four depth texels an iteration.
            texel_fetches: self.count * 4 * self.iterations,
            bytes_read: self.count * Start::min_size().get(),
            bytes_written: self.count * Answer::min_size().get(),
            ..Work::default()
        }
    }

    fn outputs(&self) -> Vec<Output> {
        vec![Output {
            name: "answers".into(),
            meaning: "weight of each photon, in the order of the starts".into(),
            columns: vec![Column {
                name: "weight",
                unit: "1",
                meaning: "share of a photon's flux that enters the water",
            }],
            data: OutputData::Buffer {
                buffer: self.answers.clone(),
                stride_floats: (size_of::<Answer>() / 4) as u32,
                count: self.count as u32,
                row: Box::new(|floats| vec![floats[11]]),
            },
        }]
    }
}
