//! `godrays/trace`: the [tracing](crate::photon::tracing) of the light's photon grid through the water to the scene. UW §3.4.

use crate::StageInfo;

pub const INFO: StageInfo = StageInfo {
    name: "godrays/trace",
    about: "photon grid: water intersection, refraction, image-space estimator",
    source: "UW §3.4",
};
