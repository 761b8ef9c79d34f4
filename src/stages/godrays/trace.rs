//! `godrays/trace`: the photon grid of godrays. [`photon::tracing`] makes it. UW §3.4.

use crate::StageInfo;
use crate::photon;

pub const INFO: StageInfo = photon::info("godrays/trace", "UW §3.4");
