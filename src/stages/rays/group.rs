//! `rays/group`: a workgroup walks each ray, its invocations at neighbouring steps. Not in the paper.

use crate::StageInfo;

pub const INFO: StageInfo = StageInfo {
    name: "rays/group",
    about: "photon rays, a workgroup each, whose invocations take neighbouring steps",
    source: "SPT §2.1, changed",
};
