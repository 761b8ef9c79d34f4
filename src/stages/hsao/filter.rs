//! `hsao/filter`: a joint bilateral filter. [`bilateral::new`](crate::bilateral::new) makes it. VAO §6.

use crate::StageInfo;

pub const INFO: StageInfo = StageInfo {
    name: "hsao/filter",
    about: "joint bilateral filter guided by depth, and up-scaling, of screen-space occlusion",
    source: "VAO §6",
};
