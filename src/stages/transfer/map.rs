//! `transfer/map`: where each photon of the light's grid enters the water, and its refracted direction. SPT §2.

use glam::UVec2;

use crate::gpu::{GpuError, StageScope};
use crate::record::Work;
use crate::shader_struct;
use crate::stages::frame::Shared;
use crate::stages::kit::{Bind, Dispatch, Group, Kernel, Resources, linear_workgroups};
use crate::stages::screen_ray::{Transfer, Transfers};
use crate::stages::{Column, Output, OutputData, Stage, StageInfo};

pub const INFO: StageInfo = StageInfo {
    name: "transfer/map",
    about: "position and direction of each photon behind the water's surface",
    source: "SPT §2",
};

shader_struct! {
    /// `Map` in `shaders/transfer/map.wgsl`.
    pub struct MapUniforms {
        pub grid: UVec2,
    }
}

pub struct Map {
    kernel: Kernel,
    dispatch: Dispatch,
    pub transfers: Transfers,
}

impl Map {
    /// `mask` is where the light sees the water first.
    pub fn new(
        resources: &Resources<'_>,
        shared: &Shared,
        mask: &wgpu::Texture,
        settings: &MapUniforms,
    ) -> Result<Self, GpuError> {
        let count = settings.grid.x * settings.grid.y;
        let transfers = Transfers::new(resources, INFO.name, count);
        let uniforms = resources.uniform(INFO.name, settings);
        let binds = [Bind::Uniform(&uniforms), Bind::Texels(mask), Bind::Write(&transfers.buffer)];
        let group = Group::new(resources.gpu, INFO.name, &binds);
        let groups = [&shared.group, &group];
        let defs = [shared.water_def()];
        let workgroups = linear_workgroups(count.into());
        Ok(Self {
            kernel: Kernel::new(resources, INFO.name, (INFO.name, &defs[..]), &groups)?,
            dispatch: Dispatch::new(resources, INFO.name, &groups, workgroups),
            transfers,
        })
    }
}

impl Stage for Map {
    fn info(&self) -> &'static StageInfo {
        &INFO
    }

    fn encode(&self, scope: &mut StageScope<'_>) {
        scope.compute(|pass| self.kernel.run(pass, &self.dispatch));
    }

    fn work(&self) -> Work {
        let photons = u64::from(self.transfers.count);
        Work { photons, bytes_written: photons * size_of::<Transfer>() as u64, ..Work::default() }
    }

    fn outputs(&self) -> Vec<Output> {
        let column = Column::new;
        let place = "where the photon leaves the surface";
        let direction = "unit direction behind the surface";
        let columns = vec![
            column("x_m", "m", place),
            column("y_m", "m", place),
            column("z_m", "m", place),
            column("state", "1", "0 for a photon that never gets here, 4 for one that has ended"),
            column("direction_x", "1", direction),
            column("direction_y", "1", direction),
            column("direction_z", "1", direction),
            column("path_m", "m", "way under water that is behind it"),
        ];
        vec![Output {
            name: "transfers".into(),
            meaning: "the transfer map, a photon a row, row by row of the light's grid".into(),
            columns,
            data: OutputData::Buffer {
                buffer: self.transfers.buffer.raw(),
                stride_floats: (size_of::<Transfer>() / 4) as u32,
                count: self.transfers.count,
                row: Box::new(<[f32]>::to_vec),
            },
        }]
    }
}
