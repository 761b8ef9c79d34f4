//! `transfer/map`: where each photon of the light's grid enters the water, and its refracted direction. SPT §2.

use glam::UVec2;

use crate::frame::Shared;
use crate::kit::{Bind, Buffer, Dispatch, Group, Kernel, Resources, linear_workgroups};
use crate::screen_ray::{Transfer, Transfers};
use crate::shader_struct;
use crate::{Output, Stage, StageInfo};
use fathom_gpu::{GpuError, StageScope};
use fathom_record::Work;

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
    /// Of each photon: its share of the flux that one in the middle of the light's frustum carries.
    pub weights: Buffer,
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
        let weights = resources.storage(INFO.name, u64::from(count) * 4);
        let binds = [
            Bind::Uniform(&uniforms),
            Bind::Texels(mask),
            Bind::Write(&transfers.buffer),
            Bind::Write(&weights),
        ];
        let group = Group::new(resources.gpu, INFO.name, &binds);
        let groups = [&shared.group, &group];
        let defs = [shared.water_def(), shared.fresnel_def()];
        let workgroups = linear_workgroups(count.into());
        Ok(Self {
            kernel: Kernel::new(resources, INFO.name, (INFO.name, &defs[..]), &groups)?,
            dispatch: Dispatch::new(resources, INFO.name, &groups, workgroups),
            transfers,
            weights,
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
        Work {
            photons,
            bytes_written: photons * (size_of::<Transfer>() as u64 + 4),
            ..Work::default()
        }
    }

    fn outputs(&self) -> Vec<Output> {
        vec![self.transfers.output()]
    }
}
