//! `water/reflection`: the scene as the water mirrors it. [`lit_scene::new`](crate::lit_scene::new) makes it. UW §3 step 4.

use crate::StageInfo;

pub const INFO: StageInfo = StageInfo {
    name: "water/reflection",
    about: "what the water mirrors, drawn from the camera mirrored about y = 0",
    source: "UW §3 step 4",
};
