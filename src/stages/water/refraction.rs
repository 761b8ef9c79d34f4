//! `water/refraction`: the [lit scene](crate::lit_scene::new) from the camera. UW §3 step 4.

use crate::StageInfo;

pub const INFO: StageInfo = StageInfo {
    name: "water/refraction",
    about: "what lies beyond the water, drawn from the camera",
    source: "UW §3 step 4",
};
