//! What is taken away from an adapter, so that paths for lesser adapters run on it.

use std::fmt;

use itertools::Itertools;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use strum::{Display, EnumIter, EnumString};

/// A feature that fathom uses where an adapter has it. Names are those of WebGPU, and of wgpu where WebGPU has none.
#[derive(
    Clone, Copy, Debug, PartialEq, Display, EnumIter, EnumString, Serialize, Deserialize, JsonSchema,
)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum Feature {
    /// Timestamps at both ends of a pass.
    TimestampQuery,
    /// Timestamps between passes.
    TimestampQueryInsideEncoders,
    /// Counts of shader invocations.
    PipelineStatisticsQuery,
    /// Blending into 32-bit float targets.
    Float32Blendable,
    /// Filtering of 32-bit float textures.
    Float32Filterable,
}

/// Features that were taken from an adapter. What is measured then is not the adapter as it is.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Mask {
    /// Features that were not used.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub without: Vec<Feature>,
}

impl Mask {
    /// Nothing is taken.
    pub fn is_none(&self) -> bool {
        *self == Self::default()
    }
}

/// `without timestamp-query`.
impl fmt::Display for Mask {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.without.iter().map(|feature| format!("without {feature}")).join(", "))
    }
}
