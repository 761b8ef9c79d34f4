//! `post/luminance`: log-average luminance of the final image, as exposure is metered by. Reinhard, Stark, Shirley and Ferwerda,
//! *Photographic Tone Reproduction for Digital Images*, 2002, Eq. 1.

use crate::kit::{self, Bind, Buffer, Dispatch, Group, Kernel, Resources};
use crate::{Column, Output, OutputData, Stage, StageInfo};
use fathom_gpu::{GpuError, StageScope};
use fathom_record::Work;

pub const INFO: StageInfo = StageInfo {
    name: "post/luminance",
    about: "log-average luminance of the final image, by sums in workgroup memory",
    source: "Reinhard et al. 2002, Eq. 1",
};

/// Texels that a workgroup sums, as in the shader.
const GROUP_TEXELS: u64 = 256 * 4;
/// Workgroups along x: within every adapter's limit.
const GROUPS_X: u64 = 32_768;

pub struct Luminance {
    /// Sums of workgroups, and the sum of these.
    steps: [(Kernel, Dispatch); 2],
    texels: u64,
    groups: u64,
    /// One float: the log-average luminance, 1 for a white picture.
    pub average: Buffer,
}

impl Luminance {
    /// `picture` holds display values of gamma 2.2.
    pub fn new(resources: &Resources<'_>, picture: &wgpu::Texture) -> Result<Self, GpuError> {
        let texels = kit::pixels(picture);
        let groups = texels.div_ceil(GROUP_TEXELS);
        let sums = resources.storage("post/luminance sums", groups * 4);
        let average = resources.storage(INFO.name, 4);
        let binds = [Bind::Texels(picture), Bind::Write(&sums), Bind::Write(&average)];
        let bound = [&Group::new(resources.gpu, INFO.name, &binds)];
        let rows = groups.div_ceil(GROUPS_X) as u32;
        let step = |number: i32, workgroups| -> Result<(Kernel, Dispatch), GpuError> {
            let defs = [("STEP", number)];
            let kernel = Kernel::new(resources, INFO.name, (INFO.name, &defs[..]), &bound)?;
            Ok((kernel, Dispatch::new(resources, INFO.name, &bound, workgroups)))
        };
        let wide = [groups.min(GROUPS_X) as u32, rows, 1];
        Ok(Self { steps: [step(0, wide)?, step(1, [1, 1, 1])?], texels, groups, average })
    }
}

impl Stage for Luminance {
    fn info(&self) -> &'static StageInfo {
        &INFO
    }

    fn encode(&self, scope: &mut StageScope<'_>) {
        scope.compute(|pass| {
            for (kernel, dispatch) in &self.steps {
                kernel.run(pass, dispatch);
            }
        });
    }

    fn work(&self) -> Work {
        Work {
            texel_fetches: self.texels,
            bytes_read: self.groups * 4,
            bytes_written: self.groups * 4 + 4,
            ..Work::default()
        }
    }

    fn outputs(&self) -> Vec<Output> {
        let meaning = "log-average luminance of the final image, 1 for white";
        vec![Output {
            name: "average".into(),
            meaning: meaning.into(),
            columns: vec![Column::new("luminance", "1", meaning)],
            data: OutputData::Buffer {
                buffer: self.average.raw(),
                stride_floats: 1,
                count: 1,
                row: Box::new(<[f32]>::to_vec),
            },
        }]
    }
}
