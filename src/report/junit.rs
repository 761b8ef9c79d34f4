//! JUnit XML, which most CI systems show: a test case for each claim and for each cell.
//!
//! | what | test case |
//! |---|---|
//! | claim supported | passed |
//! | claim contradicted | *failure*: what was claimed does not hold on this adapter, though measuring went well |
//! | claim inconclusive or not run | skipped, with the reason |
//! | cell measured | passed |
//! | cell failed | *error*: measuring it failed |
//! | cell skipped | skipped, with the reason |
//!
//! JUnit means the same by the two: a failure is an assertion that does not hold, an error is what keeps a test from its end.
//! The exit status of `fathom run` and of `fathom export` does not depend on claims.

use std::fmt::Display;

use quick_junit::{NonSuccessKind, Report, TestCase, TestCaseStatus, TestSuite};

use super::{Exporter, OfRun, ReportError, ReportView, RunExporter, Written};
use fathom_base::text;
use fathom_experiments::{Ruling, Verdict};
use fathom_record::Outcome;

pub const EXPORTER: RunExporter = Exporter {
    name: "junit",
    about: "JUnit XML: contradicted claims as failures, failed cells as errors",
    file: "junit.xml",
    written: Written::OnRequest,
    export: OfRun::One(export),
};

fn export(view: &ReportView<'_>) -> Result<String, ReportError> {
    let mut claims = TestSuite::new("fathom run: claims");
    let mut cells = TestSuite::new("fathom run: cells");
    for section in &view.sections {
        for ruling in section.rulings() {
            add(&mut claims, section.id, &ruling.id, claim_status(ruling));
        }
        for entry in &section.entries {
            add(&mut cells, section.id, &entry.cell.cell, cell_status(&entry.cell.outcome));
        }
    }
    Ok(xml("fathom run", [claims, cells]))
}

fn claim_status(ruling: &Ruling) -> TestCaseStatus {
    let Ruling { text, verdict, reason, .. } = ruling;
    match verdict {
        Verdict::Supported => TestCaseStatus::success(),
        Verdict::Contradicted => {
            failed(NonSuccessKind::Failure, verdict, &format!("{text}: {reason}"))
        }
        Verdict::Inconclusive | Verdict::NotRun => skipped(&format!("{verdict}: {reason}")),
    }
}

fn cell_status(outcome: &Outcome) -> TestCaseStatus {
    match outcome {
        Outcome::Measured(_) => TestCaseStatus::success(),
        Outcome::Skipped { reason } => skipped(reason),
        Outcome::Failed { reason } => failed(NonSuccessKind::Error, "failed", reason),
    }
}

/// The file of these suites; those without a test case are left out.
pub fn xml<const N: usize>(name: &str, suites: [TestSuite; N]) -> String {
    let mut report = Report::new(name);
    report.add_test_suites(suites.into_iter().filter(|suite| !suite.test_cases.is_empty()));
    // Writing to memory fails for no reason but memory itself.
    report.to_string().unwrap_or_default()
}

/// Adds a test case to a suite.
pub fn add(suite: &mut TestSuite, class: &str, name: &str, status: TestCaseStatus) {
    let mut case = TestCase::new(text::line(name), status);
    case.set_classname(text::line(class));
    suite.add_test_case(case);
}

/// A failure or an error of this type.
pub fn failed(kind: NonSuccessKind, what: impl Display, message: &str) -> TestCaseStatus {
    let mut status = TestCaseStatus::non_success(kind);
    status.set_type(what.to_string()).set_message(text::line(message));
    status
}

/// A test case that was not run, or that decided nothing.
pub fn skipped(message: &str) -> TestCaseStatus {
    let mut status = TestCaseStatus::skipped();
    status.set_message(text::line(message));
    status
}

#[cfg(test)]
mod tests {
    use super::*;
    use fathom_experiments::fixtures;

    fn count(report: &Report, suite: usize, wanted: fn(&TestCaseStatus) -> bool) -> usize {
        let cases = report.test_suites[suite].test_cases.iter();
        cases.filter(|case| wanted(&case.status)).count()
    }

    fn is(status: &TestCaseStatus, wanted: NonSuccessKind) -> bool {
        matches!(status, TestCaseStatus::NonSuccess { kind, .. } if *kind == wanted)
    }

    #[test]
    fn claims_and_cells_have_a_case_each_by_what_became_of_them() {
        let records = fixtures::run();
        let view = ReportView::new(&records, None);
        let report = Report::deserialize_from_str(&export(&view).unwrap()).unwrap();
        let rulings: Vec<&Ruling> = view.sections.iter().flat_map(|s| s.rulings()).collect();
        let ruled = |verdict| rulings.iter().filter(|ruling| ruling.verdict == verdict).count();
        assert!(ruled(Verdict::Contradicted) > 0 && ruled(Verdict::Supported) > 0);
        let success = |status: &TestCaseStatus| matches!(status, TestCaseStatus::Success { .. });
        assert_eq!(count(&report, 0, success), ruled(Verdict::Supported));
        let failures = count(&report, 0, |status| is(status, NonSuccessKind::Failure));
        assert_eq!(failures, ruled(Verdict::Contradicted));
        assert_eq!(count(&report, 1, |status| is(status, NonSuccessKind::Error)), 1);
        assert_eq!(count(&report, 1, |status| matches!(status, TestCaseStatus::Skipped { .. })), 1);
        assert_eq!(count(&report, 1, success), view.measured().count());
    }

    #[test]
    fn without_cells_it_is_empty_and_whole() {
        let report = Report::deserialize_from_str(&xml("fathom run", [TestSuite::new("a")]));
        assert!(report.unwrap().test_suites.is_empty());
    }
}
