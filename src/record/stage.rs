//! A stage in a cell: its times, its work, and how near it comes to the adapter's limits.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::ceilings::{CeilingShare, Reads, TargetRecord};
use super::{Clock, Estimate, PassKind};
use fathom_base::visits;

/// A stage's times and work in one cell.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct StageRecord {
    /// The stage's name: `FAMILY/STEM`.
    pub stage: String,
    pub clock: Clock,
    /// Nanoseconds, frame by frame. In a fenced stage none is below its `resolution_ns`: a sample of that value says "at most".
    pub samples_ns: Vec<f64>,
    /// Of `samples_ns` over visits, nanoseconds. Its median is a time only where it is above the resolution of `fenced`.
    pub time: Estimate,
    /// How the samples came about, where the cost of submissions was taken off.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fenced: Option<Fenced>,
    pub work: Work,
    /// A lower bound of the work, where `work` is none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub least_work: Option<Work>,
    /// Pipeline statistics, where the adapter counts them.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub counters: BTreeMap<String, u64>,
    /// How near it comes to the adapter's limits.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ceiling: Option<CeilingShare>,
    /// Kinds of its passes. Absent in records of before.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub passes: Vec<PassKind>,
    /// What these draw into.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub targets: Vec<TargetRecord>,
    /// Where they are counted.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reads: Option<Reads>,
}

impl StageRecord {
    /// A stage with these samples of these visits, of which nothing else is known.
    pub fn new(
        stage: impl Into<String>,
        clock: Clock,
        samples_ns: Vec<f64>,
        visits: &[u32],
    ) -> Self {
        Self {
            stage: stage.into(),
            clock,
            time: visits::estimate_of_samples(&samples_ns, visits),
            samples_ns,
            fenced: None,
            work: Work::default(),
            least_work: None,
            counters: BTreeMap::new(),
            ceiling: None,
            passes: Vec::new(),
            targets: Vec::new(),
            reads: None,
        }
    }

    /// Whether the time is longer than what the clock can tell from none. Where it is not, `time` is an upper bound.
    pub fn is_resolved(&self) -> bool {
        self.fenced.as_ref().is_none_or(|fenced| self.time.median > fenced.resolution_ns)
    }

    /// What was read less the cost of submissions, frame by frame: scatters about the stage's time, and below zero where that
    /// is short.
    pub fn differences_ns(&self) -> Vec<f64> {
        match &self.fenced {
            Some(fenced) => fenced.differences_ns().collect(),
            None => self.samples_ns.clone(),
        }
    }

    /// The clock's resolution: a shorter time is indistinguishable from zero; 0 where no cost was taken off.
    pub fn resolution_ns(&self) -> f64 {
        self.fenced.as_ref().map_or(0.0, |fenced| fenced.resolution_ns)
    }
}

/// Times of a stage's fenced submissions as they were read, and the cost of these submissions, which the least pass of the
/// same kind has in the same frames.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Fenced {
    /// Nanoseconds from submission to fence, summed over the stage's submissions, frame by frame. Its passes on other clocks are in it.
    pub wall_samples_ns: Vec<f64>,
    /// The cost that was taken off in each frame, nanoseconds.
    pub submit_cost_samples_ns: Vec<f64>,
    /// A shorter time is indistinguishable from zero, as the cost scatters: the median over the frames, nanoseconds.
    pub resolution_ns: f64,
}

impl Fenced {
    fn differences_ns(&self) -> impl Iterator<Item = f64> {
        let pairs = self.wall_samples_ns.iter().zip(&self.submit_cost_samples_ns);
        pairs.map(|(wall_ns, cost_ns)| wall_ns - cost_ns)
    }

    /// The stage's times, where no longer than the resolution the resolution itself.
    pub fn samples_ns(&self) -> Vec<f64> {
        let clamp = |ns: f64| ns.max(self.resolution_ns);
        self.differences_ns().map(clamp).collect()
    }
}

macro_rules! work {
    ($($(#[$about:meta])* $count:ident,)*) => {
        /// Work that a stage declares from its algorithm. Zero fields are left out of the record.
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
        #[serde(default)]
        pub struct Work {
            $($(#[$about])* #[serde(skip_serializing_if = "is_zero")] pub $count: u64,)*
        }

        impl Work {
            pub const NAMES: &[&str] = &[$(stringify!($count),)*];

            /// Every field by its name, in the order of [`Self::NAMES`].
            pub fn fields(&self) -> [(&'static str, u64); Self::NAMES.len()] {
                [$((stringify!($count), self.$count),)*]
            }
        }
    };
}

work! {
    /// Photons traced or drawn.
    photons,
    /// Triangles handed to the stage.
    triangles,
    /// Points, lines, quads or other primitives that it makes itself.
    primitives,
    /// Fragments written or blended; an estimate where it depends on the data.
    fragments,
    /// Texels read.
    texel_fetches,
    /// Bytes read from buffers.
    bytes_read,
    /// Bytes written to buffers and targets.
    bytes_written,
}

fn is_zero<N: Default + PartialEq>(count: &N) -> bool {
    *count == N::default()
}
