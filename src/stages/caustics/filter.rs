//! `caustics/filter`: the [low-pass](crate::low_pass). UW §3.5.

use crate::StageInfo;

pub const INFO: StageInfo = StageInfo {
    name: "caustics/filter",
    about: "multi-tap low-pass with a kernel rotated per pixel",
    source: "UW §3.5",
};
