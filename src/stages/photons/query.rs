//! `photons/query`: photons from given starts through the water to the scene. UW §3.3.

use bytemuck::{Pod, Zeroable};
use encase::ShaderType;
use glam::Vec3;

use crate::frame::Shared;
use crate::kit::{self, Bind, Buffer, Dispatch, Group, Kernel, Resources};
use crate::photon::{Photon, TraceUniforms};
use crate::shader_struct;
use crate::{Column, Output, OutputData, Stage, StageInfo};
use fathom_gpu::{GpuError, StageScope};
use fathom_record::Work;

pub const INFO: StageInfo = StageInfo {
    name: "photons/query",
    about: "photons from given starts: water intersection, refraction, image-space estimator",
    source: "UW §3.3",
};

shader_struct! {
    /// `Start` in `shaders/photons/query.wgsl`.
    pub struct Start {
        pub position_m: Vec3,
        /// 1: the direction is given; 0: the light's own ray runs through the start.
        pub aimed: u32,
        /// Of unit length where it is given.
        pub direction: Vec3,
    }
}

shader_struct! {
    /// `Answer` in `shaders/photons/query.wgsl`.
    #[repr(C)]
    #[derive(Copy, Pod, Zeroable)]
    pub struct Answer {
        pub photon: Photon,
        /// After refraction, unit length; 0 for a photon that never enters the water.
        pub direction: Vec3,
        /// Share of a photon's flux that enters the water.
        pub weight: f32,
    }
}

pub struct Query {
    kernel: Kernel,
    dispatch: Dispatch,
    count: u64,
    lookups: u64,
    /// An [`Answer`] for each start.
    pub answers: Buffer,
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
        let resources = &resources.sized_by("starts");
        let defs =
            [("CONSERVING", i32::from(conserving)), shared.fresnel_def(), shared.water_def()];
        let input = resources.structs("starts", starts, wgpu::BufferUsages::empty());
        let count = starts.len() as u64;
        let answers = resources.room_for::<Answer>(INFO.name, count);
        let uniforms = resources.uniform(INFO.name, settings);
        let texels = resources.nearest_sampler(INFO.name);
        let binds = [
            Bind::Uniform(&uniforms),
            Bind::Depth(depth),
            Bind::Texels(mask),
            Bind::Read(&input),
            Bind::Write(&answers),
            Bind::NearestSampler(&texels),
        ];
        let group = Group::new(resources.gpu, INFO.name, &binds);
        let groups = [&shared.group, &group];
        let workgroups = kit::linear_workgroups(count);
        Ok(Self {
            kernel: Kernel::new(resources, INFO.name, (INFO.name, &defs[..]), &groups)?,
            dispatch: Dispatch::new(resources, INFO.name, &groups, workgroups),
            count,
            lookups: settings.lookups.into(),
            answers,
        })
    }
}

impl Stage for Query {
    fn info(&self) -> &'static StageInfo {
        &INFO
    }

    fn encode(&self, scope: &mut StageScope<'_>) {
        scope.compute(|pass| self.kernel.run(pass, &self.dispatch));
    }

    fn work(&self) -> Work {
        Work {
            photons: self.count,
            // Four depth texels a place.
            texel_fetches: self.count * 4 * self.lookups,
            bytes_read: self.count * Start::min_size().get(),
            bytes_written: self.count * Answer::min_size().get(),
            ..Work::default()
        }
    }

    /// The search ends where a photon has landed.
    fn least_work(&self) -> Work {
        Work { texel_fetches: 0, ..self.work() }
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
                buffer: self.answers.raw(),
                stride_floats: (size_of::<Answer>() / 4) as u32,
                count: self.count as u32,
                row: Box::new(|floats| vec![floats[11]]),
            },
        }]
    }
}
