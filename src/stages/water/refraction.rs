//! `water/refraction`: the scene beyond the water. [`lit_scene::new`](crate::lit_scene::new) makes it. UW §3 step 4.

use crate::StageInfo;

pub const INFO: StageInfo = StageInfo {
    name: "water/refraction",
    about: "what lies beyond the water, drawn from the camera",
    source: "UW §3 step 4",
};
