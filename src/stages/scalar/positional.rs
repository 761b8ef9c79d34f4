//! `scalar/positional`: participating media with positional ambient occlusion. VAO §5.2.4.

use fathom_gpu::StageInfo;

pub const INFO: StageInfo = StageInfo {
    name: "scalar/positional",
    about: "participating media, with positional ambient occlusion of each sample over the whole sphere",
    source: "VAO §5.2.4",
};
