//! What an adapter can do at most, and how near to that a stage comes. `docs/ceilings.md` has the rule.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use strum::Display;

use super::{Clock, Estimate, Interval, PassKind, StageRecord, Work};

/// Format of the texels that a limit is measured with.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema, Display)]
#[serde(rename_all = "lowercase")]
#[strum(serialize_all = "lowercase")]
pub enum TexelFormat {
    R8Unorm,
    Rgba8Unorm,
    R16Float,
    Rgba16Float,
    R32Float,
    Rgba32Float,
    Depth32Float,
}

/// How a fragment gets into its target.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Blending {
    Opaque,
    /// Added to what the target holds.
    Additive,
}

/// Where atomic operations go.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Addresses {
    /// Each invocation has a word of its own.
    Spread,
    /// All invocations share one word.
    Contended,
}

/// A primitive of about one pixel, and what becomes of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum SmallPrimitive {
    Triangle,
    /// Faces away and is not drawn.
    CulledTriangle,
    Point,
    /// Lies outside the view.
    ClippedPoint,
}

/// One thing that an adapter does at a limited rate.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "limit", rename_all = "snake_case")]
pub enum Limit {
    /// Copying between two buffers that have this size together.
    Copy {
        /// All buffers together.
        working_set_bytes: u64,
    },
    /// Reading a buffer in a compute shader.
    Read {
        /// All buffers together.
        working_set_bytes: u64,
    },
    /// Clearing a buffer.
    Write {
        /// All buffers together.
        working_set_bytes: u64,
    },
    /// Fragments of a minimal shader.
    Fill {
        format: TexelFormat,
        blending: Blending,
    },
    /// Texels loaded without a filter.
    Load2d {
        format: TexelFormat,
    },
    /// Texels of gathers, four each.
    Gather2d {
        format: TexelFormat,
    },
    /// Trilinear look-ups in a volume.
    Sample3d {
        format: TexelFormat,
    },
    Atomics {
        addresses: Addresses,
    },
    /// Fused multiply-adds in this kind of pass.
    Arithmetic {
        /// Kind of pass.
        pass: PassKind,
    },
    Primitives {
        primitive: SmallPrimitive,
    },
    /// Passes that do next to nothing.
    EmptyPass {
        /// Kind of pass.
        pass: PassKind,
    },
}

impl Limit {
    /// What is counted, for people, and the kind of work that it bounds.
    fn counted(self) -> (&'static str, Option<Bounded>) {
        match self {
            Self::Copy { .. } | Self::Read { .. } | Self::Write { .. } => {
                ("B/s", Some(Bounded::Bytes))
            }
            Self::Fill { .. } => ("fragments/s", Some(Bounded::Fragments)),
            Self::Load2d { .. } | Self::Gather2d { .. } | Self::Sample3d { .. } => {
                ("texels/s", Some(Bounded::Texels))
            }
            Self::Primitives { .. } => ("primitives/s", Some(Bounded::Primitives)),
            Self::Atomics { .. } => ("adds/s", None),
            Self::Arithmetic { .. } => ("multiply-adds/s", None),
            Self::EmptyPass { .. } => ("passes/s", None),
        }
    }

    /// What is counted, for people.
    pub fn unit(self) -> &'static str {
        self.counted().0
    }

    /// For people.
    pub fn name(self) -> String {
        match self {
            Self::Copy { working_set_bytes } => format!("copy, {}", size(working_set_bytes)),
            Self::Read { working_set_bytes } => format!("read, {}", size(working_set_bytes)),
            Self::Write { working_set_bytes } => format!("clear, {}", size(working_set_bytes)),
            Self::Fill { format, blending } => {
                let blending = if blending == Blending::Opaque { "opaque" } else { "blended" };
                format!("{blending} fill, {format}")
            }
            Self::Load2d { format } => format!("2-D loads, {format}"),
            Self::Gather2d { format } => format!("2-D gathers, {format}"),
            Self::Sample3d { format } => format!("trilinear 3-D samples, {format}"),
            Self::Atomics { addresses: Addresses::Spread } => "atomic adds, spread".to_owned(),
            Self::Atomics { addresses: Addresses::Contended } => {
                "atomic adds, contended".to_owned()
            }
            Self::Arithmetic { pass } => format!("arithmetic, {pass}"),
            Self::Primitives { primitive } => primitive.name().to_owned(),
            Self::EmptyPass { pass } => format!("empty passes, {pass}"),
        }
    }

    /// The buffers' size, of a limit on memory.
    pub fn working_set_bytes(self) -> Option<u64> {
        match self {
            Self::Copy { working_set_bytes }
            | Self::Read { working_set_bytes }
            | Self::Write { working_set_bytes } => Some(working_set_bytes),
            _ => None,
        }
    }

    /// Whether it bounds work of this kind.
    pub fn bounds(self, kind: Bounded) -> bool {
        self.counted().1 == Some(kind)
    }
}

impl SmallPrimitive {
    /// For people.
    pub fn name(self) -> &'static str {
        match self {
            Self::Triangle => "triangles of a pixel",
            Self::CulledTriangle => "culled triangles",
            Self::Point => "points",
            Self::ClippedPoint => "clipped points",
        }
    }
}

/// `64 KiB`, `16 MiB`.
fn size(bytes: u64) -> String {
    if bytes < 1 << 20 {
        return format!("{} KiB", bytes >> 10);
    }
    format!("{} MiB", bytes >> 20)
}

/// A measured limit.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Ceiling {
    #[serde(flatten)]
    pub limit: Limit,
    /// Per second, in the limit's [unit](Limit::unit).
    pub rate: Estimate,
    /// Time of twice the work over that of the work: 2 where the adapter does all of it.
    pub doubling: f64,
}

/// Bounds of a sound ceiling's doubling: fixed costs shorten it, a machine that becomes busy shifts it.
const SOUND_DOUBLING: std::ops::Range<f64> = 1.7..2.4;

impl Ceiling {
    /// Twice the work took about twice the time. If not, work was skipped or the machine was too busy, and the rate bounds nothing.
    pub fn is_sound(&self) -> bool {
        SOUND_DOUBLING.contains(&self.doubling) && self.rate.median.is_finite()
    }

    /// Twice the work took much less than twice the time.
    pub fn is_short(&self) -> bool {
        self.doubling < SOUND_DOUBLING.start
    }
}

/// Kinds of work that limits are compared with.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema,
)]
#[serde(rename_all = "snake_case")]
pub enum Bounded {
    /// Read and written.
    Bytes,
    Fragments,
    Texels,
    Primitives,
}

impl Bounded {
    pub const ALL: [Self; 4] = [Self::Bytes, Self::Fragments, Self::Texels, Self::Primitives];

    /// For people, in the plural.
    pub fn name(self) -> &'static str {
        match self {
            Self::Bytes => "bytes",
            Self::Fragments => "fragments",
            Self::Texels => "texel fetches",
            Self::Primitives => "primitives",
        }
    }

    /// The amount of it in declared work.
    pub fn of(self, work: &Work) -> u64 {
        match self {
            Self::Bytes => work.bytes_read.saturating_add(work.bytes_written),
            Self::Fragments => work.fragments,
            Self::Texels => work.texel_fetches,
            Self::Primitives => work.triangles.saturating_add(work.primitives),
        }
    }

    /// The pipeline statistics that replace what is declared.
    fn counter(self) -> Option<&'static str> {
        match self {
            Self::Fragments => Some("fragment_invocations"),
            Self::Primitives => Some("clipper_invocations"),
            Self::Bytes | Self::Texels => None,
        }
    }
}

/// Where an amount of work comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Basis {
    /// Counted by the adapter.
    Counted,
    /// Declared by the stage.
    Declared,
}

/// Share of the ceiling that binds a stage: the least time that the ceiling allows for the stage's work, over the stage's time.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct CeilingShare {
    #[serde(flatten)]
    pub limit: Limit,
    pub work: Bounded,
    pub basis: Basis,
    /// Amount of that work in a frame.
    pub amount: u64,
    /// 1 is the ceiling. Its interval has the uncertainty of both times.
    pub share: f64,
    #[serde(flatten)]
    pub interval: Option<Interval>,
}

impl CeilingShare {
    /// More than the ceiling, beyond the interval: the amount of work or a time is wrong.
    pub fn is_impossible(&self) -> bool {
        self.interval.is_some_and(|interval| interval.low > 1.0)
    }
}

impl StageRecord {
    /// How much work of this kind the stage did at least in a frame: as the adapter counted, where it counts the stage's work; else as
    /// declared. None where that is nothing.
    pub fn least_work_of(&self, kind: Bounded) -> Option<(u64, Basis)> {
        let (amount, basis) = match kind.counter().filter(|_| !self.counters.is_empty()) {
            Some(name) => (self.counters.get(name).copied().unwrap_or(0), Basis::Counted),
            None => (kind.of(self.least_work.as_ref().unwrap_or(&self.work)), Basis::Declared),
        };
        (amount > 0).then_some((amount, basis))
    }

    /// Its share of the ceiling that binds it. None where its time is below the clock's resolution, where the CPU does its work,
    /// and where no ceiling bounds it.
    pub fn share_of(&self, ceilings: &[Ceiling]) -> Option<CeilingShare> {
        if self.clock == Clock::Host || !self.is_resolved() || self.time.median <= 0.0 {
            return None;
        }
        let shares = Bounded::ALL.iter().filter_map(|kind| {
            let (amount, basis) = self.least_work_of(*kind)?;
            let ceiling = binding(ceilings, *kind, amount)?;
            Some(share(self, ceiling, *kind, amount, basis))
        });
        shares.max_by(|a, b| a.share.total_cmp(&b.share))
    }
}

fn share(
    stage: &StageRecord,
    ceiling: &Ceiling,
    work: Bounded,
    amount: u64,
    basis: Basis,
) -> CeilingShare {
    let of = |ns: f64, rate: f64| amount as f64 / rate / (ns * 1e-9);
    let both = stage.time.interval.zip(ceiling.rate.interval);
    let interval =
        both.map(|(ns, rate)| Interval { low: of(ns.high, rate.high), high: of(ns.low, rate.low) });
    let share = of(stage.time.median, ceiling.rate.median);
    CeilingShare { limit: ceiling.limit, work, basis, amount, share, interval }
}

/// The highest sound rate of all limits that bound this kind of work: each of them shows that the adapter can do as much. Of limits
/// on memory those count whose working set is at least the largest that is not larger than the amount. None where a limit that is not
/// sound may be higher: the adapter's limit is then unknown.
pub fn binding(ceilings: &[Ceiling], kind: Bounded, amount: u64) -> Option<&Ceiling> {
    let bounding = || ceilings.iter().filter(|ceiling| ceiling.limit.bounds(kind));
    let sizes = || bounding().filter_map(|ceiling| ceiling.limit.working_set_bytes());
    let size = sizes().filter(|size| *size <= amount).max().or_else(|| sizes().min());
    let apt = bounding().filter(|ceiling| {
        // A larger set that is copied faster shows that a smaller one is held back by something else.
        ceiling.limit.working_set_bytes().is_none_or(|bytes| Some(bytes) >= size)
    });
    let (sound, unsound): (Vec<_>, Vec<_>) = apt.partition(|ceiling| ceiling.is_sound());
    let highest = sound.into_iter().max_by(|a, b| a.rate.median.total_cmp(&b.rate.median))?;
    let higher = |other: &&Ceiling| other.rate.ends()[1] > highest.rate.median;
    (!unsound.iter().any(higher)).then_some(highest)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Work;

    fn ceiling(limit: Limit, rate: f64) -> Ceiling {
        let interval = Some(Interval { low: 0.9 * rate, high: 1.1 * rate });
        Ceiling { limit, rate: Estimate { median: rate, interval, n: 8 }, doubling: 2.0 }
    }

    fn copies() -> Vec<Ceiling> {
        let of = |bytes, rate| ceiling(Limit::Copy { working_set_bytes: bytes }, rate);
        vec![of(1 << 15, 40e9), of(1 << 20, 50e9), of(1 << 24, 20e9), of(1 << 28, 10e9)]
    }

    fn stage(ns: f64, work: Work) -> StageRecord {
        let interval = Some(Interval { low: 0.9 * ns, high: 1.1 * ns });
        let time = Estimate { median: ns, interval, n: 8 };
        StageRecord { time, work, ..StageRecord::of("a", Clock::Timestamp, vec![ns]) }
    }

    #[test]
    fn memory_is_bounded_by_the_rate_of_its_working_set() {
        let rate = |amount| binding(&copies(), Bounded::Bytes, amount).unwrap().rate.median;
        assert_eq!(rate(1 << 30), 10e9);
        assert_eq!(rate(1 << 28), 10e9);
        // Smaller than the next measured set: the one below is faster, and bounds it.
        assert_eq!(rate((1 << 28) - 1), 20e9);
        assert_eq!(rate(1 << 20), 50e9);
        // Small copies are slow for another reason than memory.
        assert_eq!(rate(100), 50e9);
        assert_eq!(binding(&copies(), Bounded::Texels, 1), None);
    }

    #[test]
    fn the_ceiling_with_the_longest_least_time_binds() {
        let mut ceilings = copies();
        ceilings.push(ceiling(Limit::Load2d { format: TexelFormat::R32Float }, 1e9));
        let work = Work { texel_fetches: 500, bytes_written: 1000, ..Work::default() };
        let mut stage = stage(1000.0, work);
        let share = stage.share_of(&ceilings).unwrap();
        assert_eq!(
            (share.work, share.basis, share.amount),
            (Bounded::Texels, Basis::Declared, 500)
        );
        assert!((share.share - 0.5).abs() < 1e-9 && !share.is_impossible());
        // Where a lower bound is declared, the estimate beside it bounds nothing.
        stage.least_work = Some(Work { bytes_written: 1000, ..Work::default() });
        assert_eq!(stage.share_of(&ceilings).unwrap().work, Bounded::Bytes);
        stage.least_work = Some(Work::default());
        assert_eq!(stage.share_of(&ceilings), None);
    }

    #[test]
    fn counters_replace_what_is_declared() {
        let format = TexelFormat::Rgba8Unorm;
        let ceilings = [ceiling(Limit::Fill { format, blending: Blending::Opaque }, 1e9)];
        let mut stage = stage(1000.0, Work { fragments: 5000, ..Work::default() });
        assert!(stage.share_of(&ceilings).unwrap().is_impossible());
        stage.counters.insert("fragment_invocations".into(), 100);
        let share = stage.share_of(&ceilings).unwrap();
        assert_eq!((share.basis, share.amount), (Basis::Counted, 100));
        assert!((share.share - 0.1).abs() < 1e-9);
    }

    #[test]
    fn more_than_the_ceiling_counts_beyond_the_interval_only() {
        let ceilings = [ceiling(Limit::Load2d { format: TexelFormat::R32Float }, 1e9)];
        let of = |texel_fetches| {
            let work = Work { texel_fetches, ..Work::default() };
            stage(1000.0, work).share_of(&ceilings).unwrap()
        };
        assert!(of(1150).share > 1.0 && !of(1150).is_impossible());
        assert!(of(1300).is_impossible());
    }

    #[test]
    fn stages_below_the_resolution_and_of_the_cpu_have_no_share() {
        let ceilings = [ceiling(Limit::Load2d { format: TexelFormat::R32Float }, 1e9)];
        let timed = stage(1000.0, Work { texel_fetches: 500, ..Work::default() });
        let of_cpu = StageRecord { clock: Clock::Host, ..timed.clone() };
        assert_eq!(of_cpu.share_of(&ceilings), None);
        let fenced = crate::Fenced {
            wall_samples_ns: vec![1500.0],
            submit_cost_samples_ns: vec![500.0],
            resolution_ns: 1000.0,
        };
        let short = StageRecord { fenced: Some(fenced), ..timed };
        assert_eq!(short.share_of(&ceilings), None);
    }

    #[test]
    fn a_limit_that_may_be_higher_than_the_others_but_is_not_sound_leaves_the_ceiling_unknown() {
        let mut ceilings = copies();
        ceilings[0].doubling = 1.0;
        ceilings[0].rate.interval = None;
        assert!(binding(&ceilings, Bounded::Bytes, 100).is_some(), "a larger set is faster");
        ceilings[1].doubling = 1.0;
        assert_eq!(binding(&ceilings, Bounded::Bytes, 1 << 20), None);
        assert!(binding(&ceilings, Bounded::Bytes, 1 << 24).is_some());
    }
}
