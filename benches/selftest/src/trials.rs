//! Which trials a self-test makes, in which order.

use std::fmt;

use crate::injections::{Injection, Size};
use fathom::record::comparison::Gate;

/// A build that is compared with the base.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Variant {
    /// The same source, built once more.
    Again,
    /// A change of the host that no stage uses.
    Unrelated,
    /// An injection, by its id, at a size if it has sizes.
    Injected(String, Option<Size>),
    /// Every injection that has sizes, each in its own stage.
    Every(Size),
}

impl Variant {
    pub fn injects(&self, injection: &Injection) -> bool {
        matches!(self, Self::Injected(id, _) if *id == injection.id)
    }
}

/// As part of a file's name.
impl fmt::Display for Variant {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Again => f.write_str("again"),
            Self::Unrelated => f.write_str("unrelated"),
            Self::Injected(id, None) => f.write_str(id),
            Self::Injected(id, Some(size)) => write!(f, "{id}-{size}"),
            Self::Every(size) => write!(f, "every-{size}"),
        }
    }
}

/// What a trial is there to show.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Aim {
    /// No alarm where nothing changed.
    NoAlarm,
    /// The injected stage is found and named.
    Detection,
    /// How large the injections are: many launches.
    Truth,
}

/// One comparison.
#[derive(Clone, Debug, PartialEq)]
pub struct Trial {
    /// Name of its folder.
    pub id: String,
    pub variant: Variant,
    pub aim: Aim,
    pub gates: Vec<Gate>,
    /// Only cells whose names contain this.
    pub filter: Option<String>,
    /// Instead of the default.
    pub launches: Option<u32>,
    /// Another process works meanwhile.
    pub loaded: bool,
    pub seed: u64,
}

impl Trial {
    /// Of all cells, on a quiet machine.
    fn new(id: String, variant: Variant, aim: Aim, gates: &[Gate]) -> Self {
        let gates = gates.to_vec();
        Self { id, variant, aim, gates, filter: None, launches: None, loaded: false, seed: 0 }
    }
}

/// How many trials of each sort.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::Args)]
pub struct Plan {
    /// Time gates between equal builds, every third on a loaded machine
    #[arg(long, value_name = "N", default_value_t = 60)]
    pub no_ops: u32,
    /// Time gates with 5 % injected into a stage
    #[arg(long = "slowdowns", value_name = "N", default_value_t = 40)]
    pub slow5: u32,
}

/// Launches that tell how large the injections are: four times those of a trial.
const TRUTH_LAUNCHES: u32 = 80;

/// Every trial, what is asked of the gates first: 5 % more time, interleaved with equal builds; then instructions, and equal
/// builds on a loaded machine; then other kinds of changes and other sizes. Those of one build stand together.
pub fn trials(plan: Plan, injections: &[Injection]) -> Vec<Trial> {
    let (sized, kinds): (Vec<&Injection>, Vec<&Injection>) =
        injections.iter().partition(|injection| !injection.sizes.is_empty());
    let count = sized.len() as u32;
    let (loaded, calm): (Vec<Trial>, Vec<Trial>) =
        (0..plan.no_ops).map(no_op).partition(|trial| trial.loaded);
    let due_by = |rank: u32| rank as usize * calm.len() / sized.len();
    let mut all = vec![truth()];
    for (rank, injection) in (0..).zip(&sized) {
        let fives = plan.slow5 / count + u32::from(rank < plan.slow5 % count);
        all.extend((0..fives).map(|number| timed(injection, Size::Slow5, number)));
        all.extend_from_slice(&calm[due_by(rank)..due_by(rank + 1)]);
    }
    all.extend(counted_no_ops());
    all.extend(sized.iter().map(|injection| counted(injection)));
    all.extend(loaded);
    // All gates on each change that has no sizes.
    all.extend(kinds.iter().map(|injection| injected(injection, None, "", &Gate::ALL)));
    for size in [Size::Slow3, Size::Slow10] {
        all.extend(sized.iter().map(|injection| timed(injection, size, 0)));
    }
    all
}

/// The gates without statistics, on both no-op builds.
fn counted_no_ops() -> Vec<Trial> {
    let counted = |variant: Variant| {
        let id = format!("no-op-counted-{variant}");
        Trial::new(id, variant, Aim::NoAlarm, &[Gate::Exact, Gate::Instructions])
    };
    [Variant::Again, Variant::Unrelated].map(counted).into()
}

fn no_op(number: u32) -> Trial {
    let variant = if number.is_multiple_of(2) { Variant::Again } else { Variant::Unrelated };
    let loaded = number % 3 == 2;
    let load = if loaded { "-loaded" } else { "" };
    let id = format!("no-op-{number:03}-{variant}{load}");
    Trial {
        loaded,
        seed: 1_000 + u64::from(number),
        ..Trial::new(id, variant, Aim::NoAlarm, &[Gate::Time])
    }
}

fn injected(injection: &Injection, size: Option<Size>, what: &str, gates: &[Gate]) -> Trial {
    let variant = Variant::Injected(injection.id.clone(), size);
    Trial::new(format!("{variant}{what}"), variant, Aim::Detection, gates)
}

/// A time gate.
fn timed(injection: &Injection, size: Size, number: u32) -> Trial {
    Trial {
        seed: 10_000 * (size as u64 + 1) + u64::from(number),
        ..injected(injection, Some(size), &format!("-{number}"), &[Gate::Time])
    }
}

/// How much time 5 % are, among all cells: with fewer of them a stage would find its caches warmer.
fn truth() -> Trial {
    let variant = Variant::Every(Size::Slow5);
    let id = format!("{variant}-truth");
    Trial {
        launches: Some(TRUTH_LAUNCHES),
        seed: 1,
        ..Trial::new(id, variant, Aim::Truth, &[Gate::Time])
    }
}

/// An instruction gate.
fn counted(injection: &Injection) -> Trial {
    Trial {
        filter: Some(format!("{} ", injection.configuration)),
        ..injected(injection, Some(Size::Instructions), "", &[Gate::Instructions])
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    const PLAN: Plan = Plan { no_ops: 60, slow5: 40 };

    #[test]
    fn trials_are_as_many_as_asked_and_spread_over_the_stages() {
        let injections = Injection::all().unwrap();
        let trials = trials(PLAN, &injections);
        let ids: BTreeSet<&str> = trials.iter().map(|trial| trial.id.as_str()).collect();
        assert_eq!(ids.len(), trials.len());
        let no_ops =
            trials.iter().filter(|trial| trial.aim == Aim::NoAlarm && trial.gates == [Gate::Time]);
        assert_eq!(no_ops.clone().count(), 60);
        assert_eq!(no_ops.filter(|trial| trial.loaded).count(), 20);
        let fives = trials.iter().filter(|trial| {
            let five = matches!(trial.variant, Variant::Injected(_, Some(Size::Slow5)));
            five && trial.aim == Aim::Detection
        });
        assert_eq!(fives.count(), 40);
        for injection in injections.iter().filter(|other| !other.sizes.is_empty()) {
            let own = trials.iter().filter(|trial| trial.variant.injects(injection));
            assert!(own.count() >= 5, "{}", injection.id);
        }
    }

    #[test]
    fn trials_of_one_injected_build_stand_together() {
        let injections = Injection::all().unwrap();
        let mut seen: Vec<Variant> = Vec::new();
        for trial in trials(PLAN, &injections) {
            if !matches!(trial.variant, Variant::Injected(..)) {
                continue;
            }
            if seen.last() != Some(&trial.variant) {
                assert!(!seen.contains(&trial.variant), "{}", trial.id);
                seen.push(trial.variant);
            }
        }
    }
}
