//! Which trials a self-test makes, in which order.

use std::fmt;

use fathom::record::comparison::Gate;
use itertools::Itertools;
use rand::SeedableRng;
use rand::seq::SliceRandom;
use rand_pcg::Pcg64;

use crate::injections::{Injection, Size};

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
        match self {
            Self::Again | Self::Unrelated => false,
            Self::Injected(id, _) => *id == injection.id,
            Self::Every(size) => injection.sizes.contains_key(size),
        }
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
    /// How often intervals hold the truth, where every stage is injected.
    Coverage,
}

/// One comparison of all cells.
#[derive(Clone, Debug, PartialEq)]
pub struct Trial {
    /// Name of its folder.
    pub id: String,
    pub variant: Variant,
    pub aim: Aim,
    pub gates: Vec<Gate>,
    /// Another process works meanwhile.
    pub loaded: bool,
    pub seed: u64,
}

impl Trial {
    /// A time gate, on a quiet machine.
    #[cfg(test)]
    pub fn time(id: &str, variant: Variant, aim: Aim) -> Self {
        Self::new(id.to_owned(), variant, aim, &[Gate::Time])
    }

    /// On a quiet machine.
    fn new(id: String, variant: Variant, aim: Aim, gates: &[Gate]) -> Self {
        let gates = gates.to_vec();
        Self { id, variant, aim, gates, loaded: false, seed: 0 }
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
    /// Time gates with 5 % injected into every stage
    #[arg(long, value_name = "N", default_value_t = 6)]
    pub coverage: u32,
    /// Exact and instruction gates with 2 % more instructions injected into a stage
    #[arg(long, value_name = "N", default_value_t = 20)]
    pub counted: u32,
}

/// Time gates with 3 % injected into a stage, and with 10 %.
const OF_OTHER_SIZES: u32 = 15;
/// Of the order in which stages are injected.
const SEED: u64 = 28;

/// Every trial: 5 % more time in a stage, interleaved with equal builds; all stages at once; then instructions, and equal
/// builds on a loaded machine; then other kinds of changes and other sizes.
pub fn trials(plan: Plan, injections: &[Injection]) -> Vec<Trial> {
    let (mut sized, kinds): (Vec<&Injection>, Vec<&Injection>) =
        injections.iter().partition(|injection| !injection.sizes.is_empty());
    sized.shuffle(&mut Pcg64::seed_from_u64(SEED));
    let drawn = |count: u32| (0..count).zip(sized.iter().copied().cycle());
    let (loaded, calm): (Vec<Trial>, Vec<Trial>) =
        (0..plan.no_ops).map(no_op).partition(|trial| trial.loaded);
    let fives = drawn(plan.slow5).map(|(number, injection)| timed(injection, Size::Slow5, number));
    let mut all: Vec<Trial> = fives.interleave(calm).collect();
    all.extend((0..plan.coverage).map(coverage));
    all.extend(counted_no_ops());
    all.extend(drawn(plan.counted).map(|(number, injection)| counted(injection, number)));
    all.extend(loaded);
    // All gates on each change that has no sizes.
    all.extend(kinds.iter().map(|injection| injected(injection, None, "", &Gate::ALL)));
    for size in [Size::Slow3, Size::Slow10] {
        all.extend(drawn(OF_OTHER_SIZES).map(|(number, injection)| timed(injection, size, number)));
    }
    all
}

/// The gates without statistics, on both no-op builds.
fn counted_no_ops() -> Vec<Trial> {
    let counted = |variant: Variant| {
        let id = format!("no-op-exact-{variant}");
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

/// A time gate among all cells: with fewer of them a stage would find its caches warmer.
fn coverage(number: u32) -> Trial {
    let variant = Variant::Every(Size::Slow5);
    Trial {
        seed: 1 + u64::from(number),
        ..Trial::new(format!("{variant}-{number:03}"), variant, Aim::Coverage, &[Gate::Time])
    }
}

/// The gates without statistics, of all cells.
fn counted(injection: &Injection, number: u32) -> Trial {
    let gates = [Gate::Exact, Gate::Instructions];
    let trial = injected(injection, Some(Size::Instructions), "", &gates);
    Trial { id: format!("counted-{number:03}-{}", injection.id), ..trial }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    const PLAN: Plan = Plan { no_ops: 60, slow5: 40, coverage: 6, counted: 20 };

    #[test]
    fn trials_are_as_many_as_asked_each_of_another_stage() {
        let injections = Injection::all().unwrap();
        let trials = trials(PLAN, &injections);
        let ids: BTreeSet<&str> = trials.iter().map(|trial| trial.id.as_str()).collect();
        assert_eq!(ids.len(), trials.len());
        let time = |trial: &&Trial| trial.gates == [Gate::Time];
        let no_ops = trials.iter().filter(time).filter(|trial| trial.aim == Aim::NoAlarm);
        assert_eq!(no_ops.clone().count(), 60);
        assert_eq!(no_ops.filter(|trial| trial.loaded).count(), 20);
        assert_eq!(trials.iter().filter(|trial| trial.aim == Aim::Coverage).count(), 6);
        for (size, count) in [(Size::Slow5, 40), (Size::Instructions, 20), (Size::Slow10, 15)] {
            let of_size = trials.iter().filter_map(|trial| match &trial.variant {
                Variant::Injected(id, Some(own)) if *own == size => Some(id),
                _ => None,
            });
            assert_eq!(of_size.clone().count(), count);
            assert!(of_size.collect::<BTreeSet<_>>().len() == count, "{size}: a stage twice");
        }
    }
}
