//! `gtao/filter`: a joint bilateral filter over a disc or a square. [`bilateral::new`](crate::bilateral::new) makes it. VAO §6; GTAO §4.3.

use crate::StageInfo;

pub const INFO: StageInfo = StageInfo {
    name: "gtao/filter",
    about: "joint bilateral filter guided by depth, and up-scaling, of occlusion in slices",
    source: "VAO §6; GTAO §4.3",
};
