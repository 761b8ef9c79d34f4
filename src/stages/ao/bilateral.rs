//! `ao/bilateral`: the [bilateral filter](crate::bilateral::new) of the occlusion by volumes. VAO §6.

use crate::StageInfo;

pub const INFO: StageInfo = StageInfo {
    name: "ao/bilateral",
    about: "joint bilateral filter guided by depth, and up-scaling",
    source: "VAO §6",
};
