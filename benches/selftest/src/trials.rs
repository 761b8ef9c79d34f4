//! Which trials a self-test makes, in which order.

use fathom::compare::cells::Gates;
use fathom::record::comparison::{CellId, Gate};
use itertools::Itertools;
use rand::SeedableRng;
use rand::seq::SliceRandom;
use rand_pcg::Pcg64;

use crate::patches::Patch;

/// A build that is compared with the base.
#[derive(Clone, Debug, PartialEq)]
pub enum Variant {
    /// The same source, built once more.
    Again,
    /// Every stage has as many iterations more, which measures how many make it slower by a share.
    Tried,
    /// A stage takes longer by about this share.
    Slowed(String, f64),
    Patched(Patch),
}

impl Variant {
    /// The cells' stage that is changed, if one is.
    pub fn stage(&self) -> Option<&str> {
        match self {
            Self::Slowed(stage, _) => Some(stage),
            Self::Patched(patch) => patch.stage.as_deref(),
            Self::Again | Self::Tried => None,
        }
    }
}

/// One comparison of all cells.
#[derive(Clone, Debug, PartialEq)]
pub struct Trial {
    /// Name of its folder.
    pub id: String,
    /// What it has in common with others.
    pub group: String,
    pub variant: Variant,
    pub gates: Vec<Gate>,
    /// Another process works meanwhile.
    pub loaded: bool,
    pub seed: u64,
}

/// Of the order in which stages are slowed down.
const SEED: u64 = 28;
const COUNTED: [Gate; 2] = [Gate::Exact, Gate::Instructions];

/// Stages of the gates, in alphabetical order.
pub fn stages() -> Vec<String> {
    let gates = Gates::load(None, fathom::Catalog::builtin().gates);
    let cells = gates.expect("gates that are built in").cells();
    let stages = cells.iter().filter(|cell| cell.subject().is_stage()).map(CellId::stage);
    stages.map(str::to_owned).sorted().dedup().collect()
}

/// The trial that comes first, as the slowdowns need it.
pub fn tried() -> Trial {
    trial("tried", 0, Variant::Tried, &[Gate::Time])
}

/// All others: one stage slower by 5 % interleaved with equal builds, then what is counted, other shares and other changes.
pub fn trials(patches: &[Patch]) -> Vec<Trial> {
    let mut order = stages();
    order.shuffle(&mut Pcg64::seed_from_u64(SEED));
    let slower = |count: usize, percent: u32, gates: &'static [Gate]| {
        let slowed = move |(number, stage): (usize, &String)| {
            let variant = Variant::Slowed(stage.clone(), f64::from(percent) / 100.0);
            trial(&format!("slower by {percent} %"), number, variant, gates)
        };
        order.iter().cycle().take(count).enumerate().map(slowed).collect_vec()
    };
    let (equal, changed): (Vec<_>, Vec<_>) =
        patches.iter().cloned().partition(|patch| patch.stage.is_none());
    let equal = equal.into_iter().map(Variant::Patched).chain([Variant::Again]).collect_vec();
    let no_op = |number: usize| {
        let loaded = number % 3 == 2;
        let group = if loaded { "equal, loaded" } else { "equal" };
        let variant = equal[number % equal.len()].clone();
        Trial { loaded, ..trial(group, number, variant, &[Gate::Time]) }
    };
    let mut all =
        slower(40, 5, &[Gate::Time]).into_iter().interleave((0..60).map(no_op)).collect_vec();
    all.extend(
        equal.iter().enumerate().map(|(number, it)| trial("equal", number, it.clone(), &COUNTED)),
    );
    all.extend(slower(20, 2, &COUNTED));
    all.extend([3, 10].into_iter().flat_map(|percent| slower(15, percent, &[Gate::Time])));
    let patched = |patch: Patch| trial(&patch.kind.clone(), 0, Variant::Patched(patch), &Gate::ALL);
    all.extend(changed.into_iter().map(patched));
    all
}

fn trial(group: &str, number: usize, variant: Variant, gates: &[Gate]) -> Trial {
    let words = group.replace(|c: char| !c.is_alphanumeric(), "-");
    let id = format!("{}-{words}-{number:03}", gates.iter().join("-"));
    let (group, gates) = (group.to_owned(), gates.to_vec());
    Trial { id, group, variant, gates, loaded: false, seed: number as u64 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn trials_are_in_folders_of_their_own_and_slow_down_other_stages() {
        let trials = trials(&Patch::all().unwrap());
        assert!(trials.iter().map(|trial| &trial.id).all_unique());
        let slower = trials.iter().filter(|trial| trial.group == "slower by 5 %");
        assert_eq!(slower.clone().filter_map(|trial| trial.variant.stage()).unique().count(), 40);
        assert_eq!(trials.iter().filter(|trial| trial.loaded).count(), 20);
    }
}
