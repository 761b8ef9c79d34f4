//! `water/reflection`: the [lit scene](crate::lit_scene::new) from the camera mirrored about y = 0. UW §3 step 4.

use crate::StageInfo;

pub const INFO: StageInfo = StageInfo {
    name: "water/reflection",
    about: "what the water mirrors, drawn from the camera mirrored about y = 0",
    source: "UW §3 step 4",
};
