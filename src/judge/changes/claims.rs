//! Claims on which two runs rule otherwise.

use std::collections::BTreeMap;

use itertools::Itertools;

use fathom_experiments::{RuledFigure, Ruling, Verdict, schema::Claim};

/// A claim with the verdicts of base and head.
pub struct ClaimChange<'a> {
    pub experiment: &'a str,
    pub rulings: [&'a Ruling; 2],
    /// Its text or test is not the same in both runs.
    pub redefined: bool,
}

impl ClaimChange<'_> {
    pub fn verdicts(&self) -> [Verdict; 2] {
        self.rulings.map(|ruling| ruling.verdict)
    }

    /// The figure that decided in each run; the reason where there is none.
    pub fn figures(&self) -> String {
        let figure = |ruling: &Ruling| match ruling.deciding.first() {
            Some(figure) => RuledFigure::text(figure),
            None => ruling.reason.clone(),
        };
        let [base, head] = self.rulings;
        let asked = head.deciding.first().or(base.deciding.first());
        let asked = asked.map_or_else(String::new, |f| format!("; {} is asked", f.limits()));
        let redefined = if self.redefined { "; its definition changed" } else { "" };
        format!("{} → {}{asked}{redefined}", figure(base), figure(head))
    }

    /// Verdicts that contradict each other first, then those that are no longer settled, then those that now are.
    fn rank(&self) -> usize {
        match self.verdicts().map(Verdict::is_settled) {
            [true, true] => 0,
            [true, false] => 1,
            [false, true] => 2,
            [false, false] => 3,
        }
    }
}

/// Claims that both runs have, and those of them whose verdicts differ, the gravest first.
pub fn changed<'a>(
    [base, head]: [impl Iterator<Item = (&'a str, &'a Claim, &'a Ruling)>; 2],
) -> (usize, Vec<ClaimChange<'a>>) {
    let before: BTreeMap<_, (&Claim, &Ruling)> = base
        .map(|(experiment, claim, ruling)| ((experiment, &claim.id), (claim, ruling)))
        .collect();
    let both = head.filter_map(|(experiment, claim, ruling)| {
        let (earlier, earlier_ruling) = before.get(&(experiment, &claim.id))?;
        let rulings = [*earlier_ruling, ruling];
        Some(ClaimChange { experiment, rulings, redefined: *earlier != claim })
    });
    let both = both.collect_vec();
    let count = both.len();
    let changed = both.into_iter().filter(|claim| !claim.verdicts().iter().all_equal());
    (count, changed.sorted_by_key(ClaimChange::rank).collect())
}
