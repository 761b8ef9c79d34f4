//! Which trials a self-test makes, in which order.

use super::injections::{Injection, Size};
use crate::compare::store::Gate;

/// A build that is held against the base.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Variant {
    /// The same source, built once more.
    Again,
    /// A change of the host that no stage uses.
    Unrelated,
    /// An injection, by its id, at a size if it has sizes.
    Injected(String, Option<Size>),
}

impl Variant {
    /// As part of a file's name.
    pub fn word(&self) -> String {
        match self {
            Self::Again => "again".to_owned(),
            Self::Unrelated => "unrelated".to_owned(),
            Self::Injected(id, None) => id.clone(),
            Self::Injected(id, Some(size)) => format!("{id}-{}", size.word()),
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
    /// How large an injection is: many launches of its stage's cells alone.
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
    /// Another process works on every core meanwhile.
    pub loaded: bool,
    pub seed: u64,
}

/// How many trials of each sort.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Plan {
    /// Time gates between equal builds, every third on a loaded machine.
    pub no_ops: u32,
    /// Time gates with 5 % more time in one stage.
    pub slow5: u32,
}

/// Launches that tell how large an injection is. Twice as sure as a trial's.
const TRUTH_LAUNCHES: u32 = 80;
/// Instruction gates with an injection look at this configuration, which has every stage.
const INSTRUCTED: &str = "pool ";

/// Every trial. Those of one build stand together; no-op gates are strewn between them.
pub fn trials(plan: Plan, injections: &[Injection]) -> Vec<Trial> {
    let mut blocks = vec![counted_no_ops()];
    for (index, injection) in injections.iter().enumerate() {
        let share = share(plan.slow5, sized(injections), rank(injections, index));
        blocks.extend(of_injection(injection, share));
    }
    let count = blocks.len() as u32;
    let mut all = Vec::new();
    let mut next = 0;
    for (index, block) in blocks.into_iter().enumerate() {
        all.extend(block);
        let due = (index as u32 + 1) * plan.no_ops / count;
        all.extend((next..due).map(no_op));
        next = due;
    }
    all
}

fn sized(injections: &[Injection]) -> u32 {
    let sized = injections.iter().filter(|other| !other.sizes.is_empty());
    sized.count() as u32
}

/// Place of an injection among those with sizes.
fn rank(injections: &[Injection], index: usize) -> u32 {
    sized(&injections[..index])
}

/// What the one of this rank gets of `total`.
fn share(total: u32, among: u32, rank: u32) -> u32 {
    match among {
        0 => 0,
        _ => total / among + u32::from(rank < total % among),
    }
}

/// The gates without statistics, on both no-op builds.
fn counted_no_ops() -> Vec<Trial> {
    [Variant::Again, Variant::Unrelated]
        .into_iter()
        .map(|variant| Trial {
            id: format!("no-op-counted-{}", variant.word()),
            variant,
            aim: Aim::NoAlarm,
            gates: vec![Gate::Exact, Gate::Instructions],
            filter: None,
            launches: None,
            loaded: false,
            seed: 0,
        })
        .collect()
}

fn no_op(number: u32) -> Trial {
    let variant = match number % 2 {
        0 => Variant::Again,
        _ => Variant::Unrelated,
    };
    let loaded = number % 3 == 2;
    let load = if loaded { "-loaded" } else { "" };
    Trial {
        id: format!("no-op-{number:03}-{}{load}", variant.word()),
        variant,
        aim: Aim::NoAlarm,
        gates: vec![Gate::Time],
        filter: None,
        launches: None,
        loaded,
        seed: 1_000 + u64::from(number),
    }
}

/// Blocks of trials, each of one build.
fn of_injection(injection: &Injection, slow5: u32) -> Vec<Vec<Trial>> {
    let trial = |size: Option<Size>, what: &str, gates: &[Gate]| {
        let variant = Variant::Injected(injection.id.clone(), size);
        Trial {
            id: format!("{}{what}", variant.word()),
            variant,
            aim: Aim::Detection,
            gates: gates.to_vec(),
            filter: None,
            launches: None,
            loaded: false,
            seed: 0,
        }
    };
    if injection.sizes.is_empty() {
        return vec![vec![trial(None, "", &Gate::ALL)]];
    }
    let counted = Trial {
        filter: Some(INSTRUCTED.to_owned()),
        ..trial(Some(Size::Instructions), "", &[Gate::Instructions])
    };
    let timed = |size: Size, number: u32| Trial {
        seed: 10_000 * (size as u64 + 1) + u64::from(number),
        ..trial(Some(size), &format!("-{number}"), &[Gate::Time])
    };
    let truth = Trial {
        aim: Aim::Truth,
        filter: Some(format!(" {}", injection.stage)),
        launches: Some(TRUTH_LAUNCHES),
        seed: 1,
        ..trial(Some(Size::Slow5), "-truth", &[Gate::Time])
    };
    let fives = (0..slow5).map(|number| timed(Size::Slow5, number));
    vec![
        vec![counted],
        vec![timed(Size::Slow3, 0)],
        std::iter::once(truth).chain(fives).collect(),
        vec![timed(Size::Slow10, 0)],
    ]
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    const PLAN: Plan = Plan {
        no_ops: 60,
        slow5: 40,
    };

    #[test]
    fn trials_are_as_many_as_asked_and_spread_over_the_stages() {
        let injections = Injection::all().unwrap();
        let trials = trials(PLAN, &injections);
        let ids: BTreeSet<&str> = trials.iter().map(|trial| trial.id.as_str()).collect();
        assert_eq!(ids.len(), trials.len());
        let no_ops = trials
            .iter()
            .filter(|trial| trial.aim == Aim::NoAlarm && trial.gates == [Gate::Time]);
        assert_eq!(no_ops.clone().count(), 60);
        assert_eq!(no_ops.filter(|trial| trial.loaded).count(), 20);
        let fives = trials.iter().filter(|trial| {
            let five = matches!(trial.variant, Variant::Injected(_, Some(Size::Slow5)));
            five && trial.aim == Aim::Detection
        });
        assert_eq!(fives.count(), 40);
        for injection in injections.iter().filter(|other| !other.sizes.is_empty()) {
            let own = trials.iter().filter(
                |trial| matches!(&trial.variant, Variant::Injected(id, _) if *id == injection.id),
            );
            assert!(own.count() >= 7, "{}", injection.id);
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
