//! What an adapter can do at most, and how near to that a stage comes. `docs/ceilings.md` has the rule.

use std::collections::BTreeMap;

use itertools::Itertools as _;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use strum::{EnumIter, EnumString, IntoEnumIterator as _, IntoStaticStr};

use super::{Clock, Estimate, Interval, PassKind, StageRecord, Work};

/// Size of the buffers of a limit on memory: one that caches hold, and one that they do not.
pub const CACHED_SET_BYTES: u64 = 1 << 20;
pub const MEMORY_SET_BYTES: u64 = 256 << 20;

/// Colour targets whose fill is measured: those into which the stages of the committed runs draw for most of their time, and the smallest.
#[derive(Clone, Copy, Debug, PartialEq, Eq, EnumIter, EnumString, IntoStaticStr)]
#[strum(serialize_all = "lowercase")]
pub enum FillFormat {
    R8Unorm,
    Rgba8Unorm,
    R16Float,
    Rgba16Float,
    R32Float,
    Rgba32Float,
}

/// One thing that an adapter does at a limited rate.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(into = "String", from = "String")]
pub enum Limit {
    /// A compute shader reads a buffer of [`CACHED_SET_BYTES`].
    ReadCached,
    /// A compute shader reads a buffer of [`MEMORY_SET_BYTES`].
    ReadMemory,
    /// A buffer of [`CACHED_SET_BYTES`] is cleared.
    WriteCached,
    /// A buffer of [`MEMORY_SET_BYTES`] is cleared.
    WriteMemory,
    /// Fragments of a minimal shader, which replace what the target holds.
    Fill(FillFormat),
    /// Fragments that are added to what the target holds.
    Blend(FillFormat),
    /// Texels loaded from a picture in passes of this kind.
    Loads2d(PassKind),
    /// Texels loaded from a volume.
    Loads3d(PassKind),
    /// Fused multiply-adds.
    MultiplyAdds(PassKind),
    /// Triangles of about a pixel that face away, so that no fragment is shaded: those that are drawn take longer.
    SmallTriangles,
    /// Triangles of about a pixel, one fragment each or none.
    DrawnTriangles,
    /// One that an earlier version measured.
    Former(String),
}

impl Limit {
    /// All that are measured, but for what an adapter cannot do.
    pub fn all() -> Vec<Self> {
        let passes = [PassKind::Compute, PassKind::Render];
        let mut all =
            vec![Self::ReadCached, Self::ReadMemory, Self::WriteCached, Self::WriteMemory];
        all.extend([Self::Fill, Self::Blend].iter().flat_map(|of| FillFormat::iter().map(of)));
        all.extend([Self::Loads2d, Self::Loads3d].iter().flat_map(|of| passes.map(of)));
        all.extend(passes.map(Self::MultiplyAdds));
        all.extend([Self::SmallTriangles, Self::DrawnTriangles]);
        all
    }

    /// Its name in records, its name and what is counted, for people, and the kind of work that it bounds.
    fn facts(&self) -> (String, String, &'static str, Option<Bounded>) {
        let (key, name, unit, bounded) = match self {
            Self::ReadCached => ("read_cached", "read, 1 MiB", "B/s", Some(Bounded::Bytes)),
            Self::ReadMemory => ("read_memory", "read, 256 MiB", "B/s", Some(Bounded::Bytes)),
            Self::WriteCached => ("write_cached", "clear, 1 MiB", "B/s", Some(Bounded::Bytes)),
            Self::WriteMemory => ("write_memory", "clear, 256 MiB", "B/s", Some(Bounded::Bytes)),
            Self::Fill(_) => ("fill", "opaque fill", "fragments/s", Some(Bounded::Fragments)),
            Self::Blend(_) => ("blend", "blended fill", "fragments/s", Some(Bounded::Fragments)),
            Self::Loads2d(_) => ("loads2d", "2-D loads", "texels/s", Some(Bounded::Texels)),
            Self::Loads3d(_) => ("loads3d", "3-D loads", "texels/s", Some(Bounded::VolumeTexels)),
            Self::MultiplyAdds(_) => ("multiply_adds", "arithmetic", "multiply-adds/s", None),
            Self::SmallTriangles => {
                ("small_triangles", "culled triangles", "primitives/s", Some(Bounded::Primitives))
            }
            Self::DrawnTriangles => ("drawn_triangles", "drawn triangles", "primitives/s", None),
            Self::Former(name) => (name.as_str(), name.as_str(), "/s", None),
        };
        let (of_key, of_name) = match self {
            Self::Fill(format) | Self::Blend(format) => {
                let name: &str = format.into();
                let key = match format {
                    FillFormat::R8Unorm => "unorm8",
                    FillFormat::R32Float => "float32",
                    _ => name,
                };
                (format!("_{key}"), format!(", {name}"))
            }
            Self::MultiplyAdds(PassKind::Compute) => (String::new(), ", compute".to_owned()),
            Self::Loads2d(PassKind::Render)
            | Self::Loads3d(PassKind::Render)
            | Self::MultiplyAdds(_) => ("_render".to_owned(), ", render".to_owned()),
            _ => Default::default(),
        };
        (format!("{key}{of_key}"), format!("{name}{of_name}"), unit, bounded)
    }

    /// For people.
    pub fn name(&self) -> String {
        self.facts().1
    }

    /// What is counted, for people.
    pub fn unit(&self) -> &'static str {
        self.facts().2
    }

    /// Whether no stage does so much work of this kind faster, in the passes and targets that the limit speaks of. Bytes count once, so a
    /// stage uses as much memory as its amount, and caches do not hold what is as large as [`MEMORY_SET_BYTES`].
    pub fn bounds(&self, kind: Bounded, amount: u64) -> bool {
        let is_cached = matches!(self, Self::ReadCached | Self::WriteCached);
        let is_of_kind = self.facts().3 == Some(kind)
            || kind == Bounded::Texels && matches!(self, Self::Loads3d(_));
        is_of_kind && (!is_cached || amount < MEMORY_SET_BYTES)
    }
}

impl From<Limit> for String {
    fn from(limit: Limit) -> Self {
        limit.facts().0
    }
}

impl From<String> for Limit {
    fn from(key: String) -> Self {
        let known = Self::all().into_iter().find(|limit| limit.facts().0 == key);
        known.unwrap_or(Self::Former(key))
    }
}

/// What an earlier version told of a limit beside its name, such as a format.
type FormerFacts = BTreeMap<String, Value>;

/// `fill, additive, r8unorm`
fn former_name(limit: &Limit, facts: &FormerFacts) -> String {
    let text = |value: &Value| value.as_str().map_or_else(|| value.to_string(), str::to_owned);
    std::iter::once(limit.name()).chain(facts.values().map(text)).join(", ")
}

/// A measured limit.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Ceiling {
    /// Its name.
    #[schemars(with = "String")]
    pub limit: Limit,
    /// Per second, in the limit's [unit](Limit::unit).
    pub rate: Estimate,
    /// Time of twice the work over that of the work: 2 where the adapter does all of it.
    pub doubling: f64,
    #[serde(flatten)]
    pub former: FormerFacts,
}

/// Bounds of a sound ceiling's doubling: fixed costs shorten it, a machine that becomes busy shifts it.
const SOUND_DOUBLING: std::ops::Range<f64> = 1.7..2.4;

impl Ceiling {
    pub fn new(limit: Limit, rate: Estimate, doubling: f64) -> Self {
        Self { limit, rate, doubling, former: FormerFacts::new() }
    }

    /// For people.
    pub fn name(&self) -> String {
        former_name(&self.limit, &self.former)
    }

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
    /// Of these, those of volumes.
    VolumeTexels,
    Primitives,
}

impl Bounded {
    pub const ALL: [Self; 5] =
        [Self::Bytes, Self::Fragments, Self::Texels, Self::VolumeTexels, Self::Primitives];

    /// For people, in the plural.
    pub fn name(self) -> &'static str {
        match self {
            Self::Bytes => "bytes",
            Self::Fragments => "fragments",
            Self::Texels => "texel fetches",
            Self::VolumeTexels => "texel fetches of volumes",
            Self::Primitives => "primitives",
        }
    }

    /// The amount of it in declared work.
    pub fn amount(self, work: &Work) -> u64 {
        match self {
            Self::Bytes => work.bytes_read.saturating_add(work.bytes_written),
            Self::Fragments => work.fragments,
            Self::Texels => work.texel_fetches,
            Self::VolumeTexels => 0,
            Self::Primitives => work.triangles.saturating_add(work.primitives),
        }
    }

    /// The pipeline statistics that replace what is declared.
    fn counter(self) -> Option<&'static str> {
        match self {
            Self::Fragments => Some("fragment_invocations"),
            Self::Primitives => Some("clipper_invocations"),
            Self::Bytes | Self::Texels | Self::VolumeTexels => None,
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
    #[serde(flatten)]
    pub former: FormerFacts,
}

impl CeilingShare {
    /// The limit's, for people.
    pub fn limit_name(&self) -> String {
        former_name(&self.limit, &self.former)
    }

    /// More than the ceiling, beyond the interval: the amount of work or a time is wrong.
    pub fn is_impossible(&self) -> bool {
        self.interval.is_some_and(|interval| interval.low > 1.0)
    }
}

impl StageRecord {
    /// How much work of this kind the stage did at least in a frame: as the adapter counted, where it counts the stage's work; else as
    /// declared. None where that is nothing.
    pub fn min_work_of(&self, kind: Bounded) -> Option<(u64, Basis)> {
        let counted = match (kind, self.reads) {
            (Bounded::Texels, Some(reads)) => Some(reads.texels + reads.volume_texels),
            (Bounded::VolumeTexels, Some(reads)) => Some(reads.volume_texels),
            _ => kind
                .counter()
                .filter(|_| !self.counters.is_empty())
                .map(|name| self.counters.get(name).copied().unwrap_or(0)),
        };
        let declared = || kind.amount(self.least_work.as_ref().unwrap_or(&self.work));
        let (amount, basis) = match counted {
            Some(amount) => (amount, Basis::Counted),
            None => (declared(), Basis::Declared),
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
            let ceiling = self.binding(ceilings, *kind, amount)?;
            Some(share(self, ceiling, *kind, amount, basis))
        });
        shares.max_by(|a, b| a.share.total_cmp(&b.share))
    }

    /// The highest sound rate of all limits that bound so much work of this kind in its passes and targets: each of them shows that the adapter
    /// can do as much. None where a limit that is not sound may be higher: the adapter's limit is then unknown.
    fn binding<'c>(
        &self,
        ceilings: &'c [Ceiling],
        kind: Bounded,
        amount: u64,
    ) -> Option<&'c Ceiling> {
        let of_kind = || ceilings.iter().filter(|ceiling| ceiling.limit.bounds(kind, amount));
        let own = self.limits(kind);
        let is_measured = |limit: &Limit| of_kind().any(|ceiling| ceiling.limit == *limit);
        // What it does may be faster than all that was measured, where that is not all that it does.
        let is_own = !own.is_empty() && own.iter().all(is_measured);
        let bounding = of_kind().filter(|ceiling| !is_own || own.contains(&ceiling.limit));
        let (sound, unsound): (Vec<_>, Vec<_>) = bounding.partition(|ceiling| ceiling.is_sound());
        let highest = sound.into_iter().max_by(|a, b| a.rate.median.total_cmp(&b.rate.median))?;
        let higher = |other: &&Ceiling| other.rate.ends()[1] > highest.rate.median;
        (!unsound.iter().any(higher)).then_some(highest)
    }

    /// Those of its passes and targets; none where all of a kind of work are alike, or where the record does not tell.
    fn limits(&self, kind: Bounded) -> Vec<Limit> {
        let shading = self.passes.iter().filter(|pass| **pass != PassKind::Copy).copied();
        let volumes = shading.clone().map(Limit::Loads3d);
        match kind {
            Bounded::Fragments => self.targets.iter().map(TargetRecord::limit).collect(),
            Bounded::Texels => shading.map(Limit::Loads2d).chain(volumes).collect(),
            Bounded::VolumeTexels => volumes.collect(),
            Bounded::Bytes | Bounded::Primitives => Vec::new(),
        }
    }
}

/// A colour target of a stage's passes.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
pub struct TargetRecord {
    /// As WebGPU names it.
    pub format: String,
    pub drawing: Drawing,
}

/// What becomes of the value that a fragment shader gives.
#[derive(
    Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema,
)]
#[serde(rename_all = "snake_case")]
pub enum Drawing {
    /// It replaces what the target holds.
    #[default]
    Opaque,
    /// It is added to that.
    Blended,
    /// It is not written.
    Unwritten,
}

impl TargetRecord {
    /// The limit of what is drawn into it; one that is not measured where that is unknown.
    fn limit(&self) -> Limit {
        match (self.drawing, self.format.parse()) {
            (Drawing::Opaque, Ok(format)) => Limit::Fill(format),
            (Drawing::Blended, Ok(format)) => Limit::Blend(format),
            (Drawing::Unwritten, _) | (_, Err(_)) => Limit::Former(self.format.clone()),
        }
    }
}

/// Texels that a stage's shaders have read in a frame, counted by them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Reads {
    /// Of pictures.
    pub texels: u64,
    /// Of volumes.
    pub volume_texels: u64,
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
    let limit = ceiling.limit.clone();
    CeilingShare { limit, work, basis, amount, share, interval, former: FormerFacts::new() }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ceiling(limit: Limit, rate: f64) -> Ceiling {
        let interval = Some(Interval { low: 0.9 * rate, high: 1.1 * rate });
        Ceiling::new(limit, Estimate { median: rate, interval, n: 8 }, 2.0)
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
        let stage = stage(Work::default());
        let bound = |ceilings: &[Ceiling], amount| {
            stage.binding(ceilings, Bounded::Bytes, amount).map(|ceiling| ceiling.limit.clone())
        };
        let mut ceilings = memory();
        assert_eq!(bound(&ceilings, 100), Some(Limit::ReadCached));
        assert_eq!(bound(&ceilings, MEMORY_SET_BYTES - 1), Some(Limit::ReadCached));
        assert_eq!(bound(&ceilings, MEMORY_SET_BYTES), Some(Limit::WriteMemory));
        assert_eq!(stage.binding(&ceilings, Bounded::Texels, 1), None);
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
        let loads = Limit::Loads2d(PassKind::Compute);
        ceilings.extend([ceiling(loads, 1e9), ceiling(Limit::Fill(FillFormat::R8Unorm), 1e9)]);
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
            stage.share_of(&[ceiling(Limit::Loads2d(PassKind::Compute), 1e9)]).unwrap()
        };
        assert!(of(1150).share > 1.0 && !of(1150).is_impossible());
        assert!(of(1300).is_impossible());
    }

    #[test]
    fn a_limit_of_an_earlier_version_keeps_its_name_and_what_it_was_told_by() {
        let old = r#"{"limit":"fill","format":"r8unorm","blending":"additive","work":"fragments","basis":"counted","amount":5,
            "share":0.5,"low":0.4,"high":0.6}"#;
        let share: CeilingShare = serde_json::from_str(old).unwrap();
        assert_eq!(share.limit_name(), "fill, additive, r8unorm");
        assert_eq!(share.interval, Some(Interval { low: 0.4, high: 0.6 }));
        let again = serde_json::to_value(&share).unwrap();
        assert_eq!(again, serde_json::from_str::<Value>(old).unwrap());
        let old =
            r#"{"limit":"copy","working_set_bytes":1,"rate":{"median":1.5,"n":7},"doubling":2}"#;
        let ceiling: Ceiling = serde_json::from_str(old).unwrap();
        assert_eq!(ceiling.name(), "copy, 1");
        assert!(Bounded::ALL.iter().all(|kind| !ceiling.limit.bounds(*kind, 1)));
    }

    #[test]
    fn limits_are_told_apart_by_their_keys_and_names() {
        let all = Limit::all();
        assert!(all.iter().map(Limit::name).all_unique());
        for limit in &all {
            assert_eq!(Limit::from(String::from(limit.clone())), *limit);
        }
        // Records of before have these.
        for key in ["fill_unorm8", "blend_float32", "loads2d", "loads3d", "multiply_adds"] {
            assert!(all.contains(&Limit::from(key.to_owned())), "{key}");
        }
    }

    #[test]
    fn a_stage_is_bound_by_its_own_passes_and_targets_where_all_were_measured() {
        let [compute, render] = [PassKind::Compute, PassKind::Render].map(Limit::Loads2d);
        let ceilings = [
            ceiling(compute, 10e9),
            ceiling(render, 1e9),
            ceiling(Limit::Loads3d(PassKind::Render), 0.5e9),
            ceiling(Limit::Fill(FillFormat::R8Unorm), 9e9),
            ceiling(Limit::Blend(FillFormat::R32Float), 2e9),
        ];
        let target = |format: &str, drawing| TargetRecord { format: format.to_owned(), drawing };
        let mut stage = stage(Work { texel_fetches: 100, ..Work::default() });
        let share = |stage: &StageRecord| {
            let share = stage.share_of(&ceilings).unwrap();
            (share.work, (share.share * 1e3).round())
        };
        assert_eq!(share(&stage), (Bounded::Texels, 10.0), "nobody tells its passes");
        stage.passes = vec![PassKind::Render];
        assert_eq!(share(&stage), (Bounded::Texels, 100.0));
        stage.passes.push(PassKind::Compute);
        assert_eq!(share(&stage), (Bounded::Texels, 10.0), "the faster of both");
        stage.passes.pop();
        stage.reads = Some(Reads { texels: 20, volume_texels: 300 });
        assert_eq!(share(&stage), (Bounded::VolumeTexels, 600.0));
        stage =
            StageRecord { reads: None, work: Work { fragments: 900, ..Work::default() }, ..stage };
        stage.targets = vec![target("r32float", Drawing::Blended)];
        assert_eq!(share(&stage), (Bounded::Fragments, 450.0));
        for other in [target("rg32float", Drawing::Opaque), target("r8unorm", Drawing::Unwritten)] {
            stage.targets.push(other);
            assert_eq!(share(&stage), (Bounded::Fragments, 100.0), "one is not measured");
            stage.targets.pop();
        }
    }
}
