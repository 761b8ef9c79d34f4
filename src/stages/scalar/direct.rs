//! `scalar/direct`: direct volume rendering with ambient occlusion over the hemisphere down the gradient. VAO §5.2.2.

use fathom_gpu::StageInfo;

pub const INFO: StageInfo = StageInfo {
    name: "scalar/direct",
    about: "direct volume rendering, with ambient occlusion of each sample over the hemisphere down the gradient",
    source: "VAO §5.2.2, §5.2.3",
};
