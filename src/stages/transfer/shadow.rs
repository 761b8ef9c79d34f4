//! `transfer/shadow`: a ray from each pixel's surface back to the light. SPT §5.

use glam::Vec2;

use crate::frame::Shared;
use crate::gbuffer::GbufferTextures;
use crate::kit::{Bind, Dispatch, Group, Kernel, Resources};
use crate::screen_ray::{Transfer, Transfers};
use crate::shader_struct;
use crate::{Output, Stage, StageInfo};
use fathom_gpu::{GpuError, StageScope};
use fathom_record::Work;

pub const INFO: StageInfo = StageInfo {
    name: "transfer/shadow",
    about: "a ray from each pixel's surface back to the light",
    source: "SPT §5",
};

/// Sides of a workgroup, as in the shader.
const WORKGROUP: u32 = 8;

shader_struct! {
    /// `Shadow` in `shaders/transfer/shadow.wgsl`.
    pub struct ShadowUniforms {
        pub size_px: Vec2,
    }
}

pub struct Shadow {
    kernel: Kernel,
    dispatch: Dispatch,
    /// A pixel an entry, row by row.
    pub transfers: Transfers,
}

impl Shadow {
    pub fn new(
        resources: &Resources<'_>,
        shared: &Shared,
        gbuffer: &GbufferTextures,
    ) -> Result<Self, GpuError> {
        let size = [gbuffer.depth.width(), gbuffer.depth.height()];
        let transfers = Transfers::new(resources, INFO.name, size[0].saturating_mul(size[1]));
        let settings = ShadowUniforms { size_px: Vec2::from(size.map(|side| side as f32)) };
        let uniforms = resources.uniform(INFO.name, &settings);
        let binds = [
            Bind::Uniform(&uniforms),
            Bind::Depth(&gbuffer.depth),
            Bind::Texels(&gbuffer.normal),
            Bind::Write(&transfers.buffer),
        ];
        let group = Group::new(resources.gpu, INFO.name, &binds);
        let groups = [&shared.group, &group];
        let [x, y] = size.map(|side| side.div_ceil(WORKGROUP));
        Ok(Self {
            kernel: Kernel::new(resources, INFO.name, INFO.name, &groups)?,
            dispatch: Dispatch::new(resources, INFO.name, &groups, [x, y, 1]),
            transfers,
        })
    }
}

impl Stage for Shadow {
    fn info(&self) -> &'static StageInfo {
        &INFO
    }

    fn encode(&self, scope: &mut StageScope<'_>) {
        scope.compute(|pass| self.kernel.run(pass, &self.dispatch));
    }

    fn work(&self) -> Work {
        let rays = u64::from(self.transfers.count);
        Work {
            texel_fetches: 2 * rays,
            bytes_written: rays * size_of::<Transfer>() as u64,
            ..Work::default()
        }
    }

    /// The background has no texels but its depth.
    fn least_work(&self) -> Work {
        Work { texel_fetches: u64::from(self.transfers.count), ..self.work() }
    }

    fn outputs(&self) -> Vec<Output> {
        vec![self.transfers.output()]
    }
}
