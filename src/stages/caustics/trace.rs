//! `caustics/trace`: the [tracing](crate::photon::tracing) of the light's photon grid through the water to the scene. UW §3.3.

use crate::StageInfo;

pub const INFO: StageInfo = StageInfo {
    name: "caustics/trace",
    about: "photon grid: water intersection, refraction, image-space estimator",
    source: "UW §3.3",
};
