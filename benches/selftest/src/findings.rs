//! What the trials of a self-test show, as Markdown: a function of their stored comparisons alone.

use std::collections::BTreeMap;

use fathom::compare::store::Comparison;
use fathom::compare::verdict::{JudgedCell, Verdicts};
use fathom::record::comparison::Gate;
use fathom::report::document::Table;
use fathom::text;
use itertools::Itertools;

use crate::trials::Trial;

/// What the trials of one group and the same gates show together.
#[derive(Clone, Debug, Default, PartialEq)]
struct TrialFindings {
    trials: usize,
    /// With a regression of the changed stage, and those in which it is named first.
    caught: usize,
    named_first: usize,
    /// Cells of stages that were not changed, and those with a regression.
    others: usize,
    blamed: usize,
    /// Of the first cell of the changed stage, in time or instructions.
    changes: Vec<f64>,
}

impl TrialFindings {
    fn add(&mut self, trial: &Trial, verdicts: &Verdicts<'_>) {
        let is_own = |cell: &&JudgedCell| Some(cell.cell.stage()) == trial.variant.stage();
        let regressions = verdicts.regressions();
        self.trials += 1;
        self.caught += usize::from(regressions.iter().any(&is_own));
        self.named_first += usize::from(regressions.first().is_some_and(&is_own));
        let others =
            verdicts.cells.iter().filter(|cell| cell.cell.subject().is_stage() && !is_own(cell));
        self.blamed += others.clone().filter(|cell| cell.verdict.is_regression()).count();
        self.others += others.count();
        let first = verdicts.comparison.header.cells.iter();
        let first =
            first.filter_map(|cell| verdicts.cells.iter().find(|judged| judged.cell == *cell));
        self.changes.extend(first.filter(is_own).find_map(|cell| {
            let counted = cell.instructions.as_ref().map(|counted| counted.ratio - 1.0);
            cell.time.as_ref().map(|time| time.change.median).or(counted)
        }));
    }
}

/// One line for each group of trials.
pub fn markdown(made: &[(Trial, Comparison)]) -> String {
    let mut groups: BTreeMap<(&str, &[Gate]), TrialFindings> = BTreeMap::new();
    for (trial, stored) in made {
        let found = groups.entry((&trial.group, &trial.gates)).or_default();
        found.add(trial, &Verdicts::judge(stored));
    }
    let header =
        ["builds", "gates", "trials", "caught", "named first", "others blamed", "measured"];
    let rows = groups.into_iter().map(|((group, gates), found)| {
        let span = |(least, most)| format!("{:+.1} … {:+.1} %", 100.0 * least, 100.0 * most);
        [
            group.to_owned(),
            gates.iter().join(", "),
            found.trials.to_string(),
            found.caught.to_string(),
            found.named_first.to_string(),
            format!("{} of {}", found.blamed, found.others),
            found.changes.into_iter().minmax().into_option().map_or("–".to_owned(), span),
        ]
    });
    let table = Table::new("Trials", header).with_rows(rows).markdown();
    let adapter = made.first().map(|(_, stored)| text::markdown(&stored.header.adapter.name));
    format!("# Self-test of `fathom compare`\n\n{}\n\n{}", adapter.unwrap_or_default(), table)
}

#[cfg(test)]
mod tests {
    use fathom::record::comparison::{
        CellId, ComparisonEnd, ComparisonHeader, GateSettings, Launch, Pair, Side,
    };

    use super::*;
    use crate::slowed;
    use crate::trials::Variant;

    /// A time gate of two stages whose times change by these factors, in each launch by up to 0.4 % less or more.
    fn timed(trace: f64, compose: f64) -> Comparison {
        let cells = ["caustics/trace", "compose"].map(|stage| CellId::new("pool", stage));
        let settings = GateSettings { gates: vec![Gate::Time], ..GateSettings::default() };
        let header =
            ComparisonHeader { settings, cells: cells.to_vec(), ..ComparisonHeader::default() };
        let mut comparison = Comparison { header, ..Comparison::default() };
        let measured = [(0, true, 1.0), (0, false, trace), (1, false, compose)];
        for launch in 0..10 {
            comparison.launches.push(Launch { launch, ..Launch::default() });
            let scatter = 0.004 * (f64::from(launch) / 4.5 - 1.0);
            for (cell, control, ratio) in measured {
                comparison.pairs.extend([Side::Base, Side::Head].map(|first| Pair {
                    launch,
                    round: 0,
                    cell: cells[cell].clone(),
                    control,
                    second: false,
                    first,
                    base_ns: 2e6,
                    head_ns: 2e6 * ratio * (1.0 + scatter),
                    machine: Default::default(),
                }));
            }
        }
        comparison.end = Some(ComparisonEnd { wall_s: 60.0, interrupted: false });
        comparison
    }

    #[test]
    fn findings_count_what_the_trials_show() {
        let trial = |group: &str, variant| Trial {
            group: group.to_owned(),
            variant,
            ..crate::trials::tried()
        };
        let slower = trial("slower", Variant::Slowed("caustics/trace".to_owned(), 0.05));
        let made = [
            (trial("equal", Variant::Again), timed(1.001, 1.0005)),
            (trial("equal", Variant::Again), timed(1.05, 1.0005)),
            (slower.clone(), timed(1.05, 1.0005)),
            (slower, timed(1.045, 1.1)),
        ];
        let text = markdown(&made);
        for line in [
            "| equal | time | 2 | 0 | 0 | 1 of 4 | – |",
            "| slower | time | 2 | 2 | 1 | 1 of 2 | +4.5 … +5.0 % |",
        ] {
            assert!(text.contains(line), "no {line} in\n{text}");
        }
        let tried = timed(1.64, 0.99);
        assert_eq!(slowed::iterations(&tried, "caustics/trace", 0.05), Some(5));
        assert_eq!(slowed::iterations(&tried, "compose", 0.05), None, "nothing came of them");
    }
}
