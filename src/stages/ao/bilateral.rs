//! `ao/bilateral`: a joint bilateral filter. [`bilateral::new`](crate::bilateral::new) makes it. VAO §6.

use crate::StageInfo;

pub const INFO: StageInfo = StageInfo {
    name: "ao/bilateral",
    about: "joint bilateral filter guided by depth, and up-scaling",
    source: "VAO §6",
};
