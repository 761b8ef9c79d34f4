//! JUnit XML, which most CI systems show: a test case for each cell, one for each gate, for each fault of a whole gate and
//! for each regression of a whole configuration.

use itertools::Itertools;

use super::rows;
use fathom_base::text;
use fathom_judge::exact::{DifferenceScope, FigureKind};
use fathom_judge::verdict::{CellVerdict, GateState, JudgedCell, Verdicts};
use quick_junit::{NonSuccessKind, Report, TestCase, TestCaseStatus, TestSuite};

pub fn export(verdicts: &Verdicts<'_>) -> String {
    let mut gates = TestSuite::new("fathom compare: gates");
    let [sides, adapters] = rows::sides(verdicts).map(|side| text::line(&side));
    gates.add_property(("builds", sides.as_str()));
    gates.add_property(("adapters", adapters.as_str()));
    for (gate, state) in &verdicts.gates {
        let status = match state {
            GateState::Ran => TestCaseStatus::success(),
            GateState::Skipped(reason) => skipped(reason),
            GateState::Void(reason) => failed(NonSuccessKind::Error, "void", reason),
        };
        add(&mut gates, "gate", &gate.to_string(), status);
    }
    for (number, fault) in verdicts.faults.iter().enumerate() {
        let name = format!("{} fault {}", fault.gate, number + 1);
        let status = failed(NonSuccessKind::Error, "fault", &rows::fault(fault));
        add(&mut gates, "gate", &name, status);
    }
    if !verdicts.comparison.is_complete() {
        let status = failed(NonSuccessKind::Error, "incomplete", rows::INCOMPLETE);
        add(&mut gates, "gate", "end", status);
    }
    let mut cells = TestSuite::new("fathom compare: cells");
    for cell in &verdicts.cells {
        let (configuration, stage) = (cell.cell.configuration(), cell.cell.stage());
        add(&mut cells, configuration, stage, cell_status(cell));
    }
    let mut whole = TestSuite::new("fathom compare: configurations");
    for difference in verdicts.configurations.iter().filter(|other| other.worse) {
        let message = rows::difference(difference);
        let what = match difference.kind {
            FigureKind::Error => CellVerdict::LessAccurate,
            _ => CellVerdict::Costlier,
        };
        let status = failed(NonSuccessKind::Failure, what, &message);
        let class = match &difference.scope {
            DifferenceScope::Configuration(id) => id,
            DifferenceScope::Stage(stage) => stage,
            DifferenceScope::Cell(cell) => cell.configuration(),
        };
        add(&mut whole, class, &difference.figure, status);
    }
    let summary = text::line(&rows::summary(verdicts));
    let mut report = Report::new(
        ["fathom compare", &summary].into_iter().filter(|part| !part.is_empty()).join(": "),
    );
    report.add_test_suites([gates, cells, whole].into_iter().filter(|suite| suite.tests > 0));
    // Writing to memory does not fail.
    report.to_string().unwrap_or_default()
}

fn add(suite: &mut TestSuite, class: &str, name: &str, status: TestCaseStatus) {
    let mut case = TestCase::new(text::line(name), status);
    case.set_classname(text::line(class));
    suite.add_test_case(case);
}

fn failed(kind: NonSuccessKind, what: impl std::fmt::Display, message: &str) -> TestCaseStatus {
    let mut status = TestCaseStatus::non_success(kind);
    status.set_type(what.to_string()).set_message(text::line(message));
    status
}

fn skipped(message: &str) -> TestCaseStatus {
    let mut status = TestCaseStatus::skipped();
    status.set_message(text::line(message));
    status
}

fn cell_status(cell: &JudgedCell) -> TestCaseStatus {
    let row = rows::cell(cell);
    let message = rows::HEADER.iter().zip(&row).skip(2);
    let message = message.filter(|(_, value)| !value.is_empty() && *value != rows::NONE);
    let message = message.map(|(name, value)| format!("{name}: {value}")).join("; ");
    match cell.verdict {
        verdict @ (CellVerdict::Failed | CellVerdict::NotMeasured) => {
            failed(NonSuccessKind::Error, verdict, &message)
        }
        CellVerdict::New | CellVerdict::Inconclusive | CellVerdict::NotJudged => {
            skipped(&format!("{}: {message}", cell.verdict))
        }
        verdict if verdict.is_regression() => failed(NonSuccessKind::Failure, verdict, &message),
        _ => TestCaseStatus::success(),
    }
}
