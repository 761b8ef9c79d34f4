//! `caustics/filter`: [`LowPass`](crate::low_pass::LowPass). UW §3.5.

use crate::StageInfo;

pub const INFO: StageInfo = StageInfo {
    name: "caustics/filter",
    about: "multi-tap low-pass with a kernel rotated per pixel",
    source: "UW §3.5",
};
