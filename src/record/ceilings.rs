//! What an adapter can do at most, and how near to that a stage comes. `docs/ceilings.md` has the rule.

use schemars::JsonSchema;
use serde::de::{DeserializeOwned, Error as _};
use serde::{Deserialize, Deserializer, Serialize};
use serde_json::Value;
use strum::EnumIter;

use super::{Clock, Estimate, Interval, StageRecord, Work};

/// Size of the buffers of a limit on memory: one that caches hold, and one that they do not.
pub const CACHED_SET_BYTES: u64 = 1 << 20;
pub const MEMORY_SET_BYTES: u64 = 256 << 20;

/// One thing that an adapter does at a limited rate.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, EnumIter)]
#[serde(rename_all = "snake_case")]
pub enum Limit {
    /// A compute shader reads a buffer of [`CACHED_SET_BYTES`].
    ReadCached,
    /// A compute shader reads a buffer of [`MEMORY_SET_BYTES`].
    ReadMemory,
    /// A buffer of [`CACHED_SET_BYTES`] is cleared.
    WriteCached,
    /// A buffer of [`MEMORY_SET_BYTES`] is cleared.
    WriteMemory,
    /// Fragments of a minimal shader, into a target of 8 bits.
    FillUnorm8,
    /// The same, into a target of a 32-bit float.
    FillFloat32,
    /// Fragments that are added to what the target holds.
    BlendUnorm8,
    BlendFloat32,
    /// Texels loaded from a picture.
    Loads2d,
    /// Texels loaded from a volume.
    Loads3d,
    /// Each invocation adds to a word of its own.
    AtomicAdds,
    /// Fused multiply-adds of a compute pass.
    MultiplyAdds,
    /// Triangles of about a pixel. They face away, so that no fragment is shaded: those that are drawn take longer.
    SmallTriangles,
    /// Compute passes that do next to nothing.
    EmptyPasses,
}

impl Limit {
    /// Its name and what is counted, for people, and the kind of work that it bounds.
    fn facts(self) -> (&'static str, &'static str, Option<Bounded>) {
        match self {
            Self::ReadCached => ("read, 1 MiB", "B/s", Some(Bounded::Bytes)),
            Self::ReadMemory => ("read, 256 MiB", "B/s", Some(Bounded::Bytes)),
            Self::WriteCached => ("clear, 1 MiB", "B/s", Some(Bounded::Bytes)),
            Self::WriteMemory => ("clear, 256 MiB", "B/s", Some(Bounded::Bytes)),
            Self::FillUnorm8 => ("opaque fill, r8unorm", "fragments/s", Some(Bounded::Fragments)),
            Self::FillFloat32 => ("opaque fill, r32float", "fragments/s", Some(Bounded::Fragments)),
            Self::BlendUnorm8 => ("blended fill, r8unorm", "fragments/s", Some(Bounded::Fragments)),
            Self::BlendFloat32 => {
                ("blended fill, r32float", "fragments/s", Some(Bounded::Fragments))
            }
            Self::Loads2d => ("2-D loads", "texels/s", Some(Bounded::Texels)),
            Self::Loads3d => ("3-D loads", "texels/s", Some(Bounded::Texels)),
            Self::AtomicAdds => ("atomic adds, spread", "adds/s", None),
            Self::MultiplyAdds => ("arithmetic, compute", "multiply-adds/s", None),
            Self::SmallTriangles => ("culled triangles", "primitives/s", Some(Bounded::Primitives)),
            Self::EmptyPasses => ("empty passes, compute", "passes/s", None),
        }
    }

    /// For people.
    pub fn name(self) -> &'static str {
        self.facts().0
    }

    /// What is counted, for people.
    pub fn unit(self) -> &'static str {
        self.facts().1
    }

    /// Whether no stage does so much work of this kind faster. Bytes count once, so a stage uses as much memory as its amount, and
    /// caches do not hold what is as large as [`MEMORY_SET_BYTES`].
    pub fn bounds(self, kind: Bounded, amount: u64) -> bool {
        let is_cached = matches!(self, Self::ReadCached | Self::WriteCached);
        self.facts().2 == Some(kind) && (!is_cached || amount < MEMORY_SET_BYTES)
    }
}

/// Reads a run's limits. Those of other names are left out: the committed runs have some.
pub(super) fn read<'de, D: Deserializer<'de>>(from: D) -> Result<Vec<Ceiling>, D::Error> {
    let all = Vec::<Value>::deserialize(from)?;
    all.into_iter().filter_map(parse_if_known).collect::<Result<_, _>>().map_err(D::Error::custom)
}

/// Reads a stage's share, unless it is of a limit of another name.
pub(super) fn read_share<'de, D: Deserializer<'de>>(
    from: D,
) -> Result<Option<CeilingShare>, D::Error> {
    let share = Option::<Value>::deserialize(from)?;
    share.and_then(parse_if_known).transpose().map_err(D::Error::custom)
}

fn parse_if_known<T: DeserializeOwned>(value: Value) -> Option<serde_json::Result<T>> {
    Limit::deserialize(&value["limit"]).ok()?;
    Some(serde_json::from_value(value))
}

/// A measured limit.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Ceiling {
    /// Limits of other names are not read.
    #[schemars(with = "String")]
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
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
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
    pub fn amount(self, work: &Work) -> u64 {
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
    /// The tightest that bounds the stage.
    #[schemars(with = "String")]
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
    pub fn min_work_of(&self, kind: Bounded) -> Option<(u64, Basis)> {
        let (amount, basis) = match kind.counter().filter(|_| !self.counters.is_empty()) {
            Some(name) => (self.counters.get(name).copied().unwrap_or(0), Basis::Counted),
            None => (kind.amount(self.least_work.as_ref().unwrap_or(&self.work)), Basis::Declared),
        };
        (amount > 0).then_some((amount, basis))
    }

    /// Its share of the tightest ceiling that bounds it. None where it is unknown: the time is below the clock's resolution, the CPU
    /// does the work, or no ceiling bounds it.
    pub fn share_of(&self, ceilings: &[Ceiling]) -> Option<CeilingShare> {
        if self.clock == Clock::Host || !self.is_resolved() || self.time.median <= 0.0 {
            return None;
        }
        let shares = Bounded::ALL.iter().filter_map(|kind| {
            let (amount, basis) = self.min_work_of(*kind)?;
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

/// The highest sound rate of all limits that bound so much work of this kind: each of them shows that the adapter can do as much. None
/// where a limit that is not sound may be higher: the adapter's limit is then unknown.
pub fn binding(ceilings: &[Ceiling], kind: Bounded, amount: u64) -> Option<&Ceiling> {
    let bounding = ceilings.iter().filter(|ceiling| ceiling.limit.bounds(kind, amount));
    let (sound, unsound): (Vec<_>, Vec<_>) = bounding.partition(|ceiling| ceiling.is_sound());
    let highest = sound.into_iter().max_by(|a, b| a.rate.median.total_cmp(&b.rate.median))?;
    let higher = |other: &&Ceiling| other.rate.ends()[1] > highest.rate.median;
    (!unsound.iter().any(higher)).then_some(highest)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ceiling(limit: Limit, rate: f64) -> Ceiling {
        let interval = Some(Interval { low: 0.9 * rate, high: 1.1 * rate });
        Ceiling { limit, rate: Estimate { median: rate, interval, n: 8 }, doubling: 2.0 }
    }

    fn memory() -> Vec<Ceiling> {
        use Limit::{ReadCached, ReadMemory, WriteCached, WriteMemory};
        let rates =
            [(ReadCached, 50e9), (ReadMemory, 10e9), (WriteCached, 5e9), (WriteMemory, 20e9)];
        rates.map(|(limit, rate)| ceiling(limit, rate)).into()
    }

    /// A stage of a microsecond.
    fn stage(work: Work) -> StageRecord {
        let interval = Some(Interval { low: 900.0, high: 1100.0 });
        let time = Estimate { median: 1000.0, interval, n: 8 };
        StageRecord { time, work, ..StageRecord::new("a", Clock::Timestamp, vec![1000.0], &[]) }
    }

    #[test]
    fn the_highest_rate_binds_unless_one_that_is_not_sound_may_be_higher() {
        let bound = |ceilings: &[Ceiling], amount| {
            binding(ceilings, Bounded::Bytes, amount).map(|ceiling| ceiling.limit)
        };
        let mut ceilings = memory();
        assert_eq!(bound(&ceilings, 100), Some(Limit::ReadCached));
        assert_eq!(bound(&ceilings, MEMORY_SET_BYTES - 1), Some(Limit::ReadCached));
        assert_eq!(bound(&ceilings, MEMORY_SET_BYTES), Some(Limit::WriteMemory));
        assert_eq!(binding(&ceilings, Bounded::Texels, 1), None);
        ceilings[1].doubling = 1.0;
        assert_eq!(bound(&ceilings, MEMORY_SET_BYTES), Some(Limit::WriteMemory), "it is slower");
        ceilings[0].doubling = 1.0;
        assert_eq!(bound(&ceilings, 100), None);
        assert_eq!(
            bound(&ceilings, MEMORY_SET_BYTES),
            Some(Limit::WriteMemory),
            "it bounds no such"
        );
    }

    #[test]
    fn a_share_is_of_the_tightest_ceiling_and_of_work_that_was_done() {
        let mut ceilings = memory();
        ceilings.extend([ceiling(Limit::Loads2d, 1e9), ceiling(Limit::FillUnorm8, 1e9)]);
        let mut stage = stage(Work { texel_fetches: 500, bytes_written: 1000, ..Work::default() });
        let found = |stage: &StageRecord| {
            let share = stage.share_of(&ceilings)?;
            Some((share.work, share.basis, share.amount, (share.share * 1e3).round()))
        };
        assert_eq!(found(&stage), Some((Bounded::Texels, Basis::Declared, 500, 500.0)));
        // Where a lower bound is declared, the estimate beside it bounds nothing.
        stage.least_work = Some(Work { bytes_written: 1000, ..Work::default() });
        assert_eq!(found(&stage), Some((Bounded::Bytes, Basis::Declared, 1000, 20.0)));
        stage.least_work = Some(Work { fragments: 5000, ..Work::default() });
        assert_eq!(found(&stage), Some((Bounded::Fragments, Basis::Declared, 5000, 5000.0)));
        stage.counters.insert("fragment_invocations".into(), 100);
        assert_eq!(found(&stage), Some((Bounded::Fragments, Basis::Counted, 100, 100.0)));
        let of_cpu = StageRecord { clock: Clock::Host, ..stage.clone() };
        assert_eq!(found(&of_cpu), None);
        stage.fenced = Some(crate::Fenced {
            wall_samples_ns: vec![1500.0],
            submit_cost_samples_ns: vec![500.0],
            resolution_ns: 1000.0,
        });
        assert_eq!(found(&stage), None, "below the clock's resolution");
    }

    #[test]
    fn more_than_the_ceiling_counts_beyond_the_interval_only() {
        let of = |texel_fetches| {
            let stage = stage(Work { texel_fetches, ..Work::default() });
            stage.share_of(&[ceiling(Limit::Loads2d, 1e9)]).unwrap()
        };
        assert!(of(1150).share > 1.0 && !of(1150).is_impossible());
        assert!(of(1300).is_impossible());
    }

    #[test]
    fn limits_of_other_names_are_left_out_and_a_broken_one_is_an_error() {
        let rate = r#""median":1.5,"n":7"#;
        let read = |ceilings: &str| {
            read(&mut serde_json::Deserializer::from_str(ceilings)).map(|found| found.len())
        };
        let old =
            format!(r#"{{"limit":"copy","working_set_bytes":1,"rate":{{{rate}}},"doubling":2}}"#);
        let new = format!(r#"{{"limit":"loads2d","rate":{{{rate}}},"doubling":2}}"#);
        assert_eq!(read(&format!("[{old},{new},{old}]")).unwrap(), 1);
        assert!(read(r#"[{"limit":"loads2d"}]"#).is_err());
        let share = r#"{"limit":"load2d","format":"r8unorm","work":"texels","share":1}"#;
        assert_eq!(read_share(&mut serde_json::Deserializer::from_str(share)).unwrap(), None);
    }
}
