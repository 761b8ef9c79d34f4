//! JUnit XML, which most CI systems show: a test case for each cell, one for each gate, for each fault of a whole gate and
//! for each regression of a whole configuration.

use itertools::Itertools;

use super::rows;
use crate::exact::{DifferenceScope, FigureKind};
use crate::verdict::{CellVerdict, GateState, JudgedCell, Verdicts};
use fathom_base::text;
use fathom_report::junit::{CaseStatus, NotPassed, TestSuite, failed, skipped, xml};

pub fn export(verdicts: &Verdicts<'_>) -> String {
    let mut gates = TestSuite::new("fathom compare: gates");
    let [sides, adapters] = rows::sides(verdicts).map(|side| text::line(&side));
    gates.add_property("builds", sides);
    gates.add_property("adapters", adapters);
    for (gate, state) in &verdicts.gates {
        let status = match state {
            GateState::Ran => CaseStatus::Passed,
            GateState::Skipped(reason) => skipped(reason),
            GateState::Void(reason) => failed(NotPassed::Error, "void", reason),
        };
        gates.add("gate", &gate.to_string(), status);
    }
    for (number, fault) in verdicts.faults.iter().enumerate() {
        let name = format!("{} fault {}", fault.gate, number + 1);
        let status = failed(NotPassed::Error, "fault", &rows::fault(fault));
        gates.add("gate", &name, status);
    }
    if !verdicts.comparison.came_to_its_end() {
        let status = failed(NotPassed::Error, "incomplete", rows::INCOMPLETE);
        gates.add("gate", "end", status);
    }
    let mut cells = TestSuite::new("fathom compare: cells");
    for cell in &verdicts.cells {
        let (configuration, stage) = (cell.cell.configuration(), cell.cell.stage());
        cells.add(configuration, stage, cell_status(cell));
    }
    let mut whole = TestSuite::new("fathom compare: configurations");
    for difference in verdicts.configurations.iter().filter(|other| other.worse) {
        let told = rows::difference(difference);
        let what = match difference.kind {
            FigureKind::Error => CellVerdict::LessAccurate,
            _ => CellVerdict::Costlier,
        };
        let status = failed(NotPassed::Failure, what, &told);
        let class = match &difference.scope {
            DifferenceScope::Configuration(id) => id,
            DifferenceScope::Stage(stage) => stage,
            DifferenceScope::Cell(cell) => cell.configuration(),
        };
        whole.add(class, &difference.figure, status);
    }
    xml("fathom compare", [gates, cells, whole])
}

fn cell_status(cell: &JudgedCell) -> CaseStatus {
    let row = rows::cell(cell);
    let told = rows::HEADER.iter().zip(&row).skip(2);
    let told = told.filter(|(_, value)| !value.is_empty() && *value != rows::NONE);
    let told = told.map(|(name, value)| format!("{name}: {value}")).join("; ");
    match cell.verdict {
        verdict @ (CellVerdict::Failed | CellVerdict::NotMeasured) => {
            failed(NotPassed::Error, verdict, &told)
        }
        CellVerdict::New | CellVerdict::Inconclusive | CellVerdict::NotJudged => {
            skipped(&format!("{}: {told}", cell.verdict))
        }
        verdict if verdict.is_regression() => failed(NotPassed::Failure, verdict, &told),
        _ => CaseStatus::Passed,
    }
}
