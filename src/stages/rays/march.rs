//! `rays/march`: an invocation walks each ray and ends at the first hit. The single-shader form of SPT §2.1.

use crate::StageInfo;

pub const INFO: StageInfo = StageInfo {
    name: "rays/march",
    about: "photon rays, an invocation each, which ends at the first hit",
    source: "SPT §2.1",
};
