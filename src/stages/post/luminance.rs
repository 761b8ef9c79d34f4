//! `post/luminance`: log-average luminance of the final image, as exposure is metered by. Reinhard, Stark, Shirley and Ferwerda,
//! *Photographic Tone Reproduction for Digital Images*, 2002, Eq. 1.

use crate::prelude::*;

pub const INFO: StageInfo = StageInfo {
    name: "post/luminance",
    about: "log-average luminance of the final image, by sums in workgroup memory",
    source: "Reinhard et al. 2002, Eq. 1",
};

/// Texels that a workgroup sums, as in the shader.
const GROUP_TEXELS: u64 = 256 * 4;
/// Workgroups along x: within every adapter's limit.
const GROUPS_X: u64 = 32_768;

/// `picture` holds display values of gamma 2.2. The stage leaves one float: the log-average luminance, 1 for a white picture.
pub fn new(resources: &Resources<'_>, picture: &wgpu::Texture) -> Result<Stage<Buffer>, GpuError> {
    let texels = kit::pixels(picture);
    let groups = texels.div_ceil(GROUP_TEXELS);
    let sums = resources.storage("post/luminance sums", groups * 4);
    let average = resources.storage(INFO.name, 4);
    let bound = Group::new(&[picture, &sums, &average]);
    let step = |number: i32, workgroups| {
        Dispatch::new(resources, (INFO.name, &[("STEP", number)]), &[&bound], workgroups)
    };
    let rows = groups.div_ceil(GROUPS_X) as u32;
    let wide = [groups.min(GROUPS_X) as u32, rows, 1];
    // Sums of workgroups, and the sum of these.
    let steps = [step(0, wide)?, step(1, [1, 1, 1])?];
    let work = Work {
        texel_fetches: texels,
        bytes_read: groups * 4,
        bytes_written: groups * 4 + 4,
        ..Work::default()
    };
    let meaning = "log-average luminance of the final image, 1 for white";
    let columns = vec![Column::new("luminance", "1", meaning)];
    let output = Output::rows("average", meaning, columns, (&*average, 1, 1), <[f32]>::to_vec);
    Ok(Dispatch::stage(steps, &INFO, work).output(output).leaving(average))
}
