//! `caustics/trace`: the photon grid of caustics. [`photon::tracing`] makes it. UW §3.3.

use crate::StageInfo;
use crate::photon;

pub const INFO: StageInfo = photon::info("caustics/trace", "UW §3.3");
