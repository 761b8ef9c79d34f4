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

use itertools::Itertools;

use super::{Exporter, OfRun, ReportView, RunExporter, Written};
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

/// What became of a test case.
#[derive(Clone, Debug, PartialEq)]
pub enum CaseStatus {
    Passed,
    /// Not run, or run without a decision.
    Skipped {
        message: String,
    },
    NotPassed {
        kind: NotPassed,
        what: String,
        message: String,
    },
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NotPassed {
    Failure,
    Error,
}

struct TestCase {
    class: String,
    name: String,
    status: CaseStatus,
}

/// Test cases under a name, with properties of all of them.
pub struct TestSuite {
    name: &'static str,
    properties: Vec<(&'static str, String)>,
    cases: Vec<TestCase>,
}

impl TestSuite {
    pub fn new(name: &'static str) -> Self {
        Self { name, properties: Vec::new(), cases: Vec::new() }
    }

    pub fn add_property(&mut self, name: &'static str, value: String) {
        self.properties.push((name, value));
    }

    pub fn add(&mut self, class: &str, name: &str, status: CaseStatus) {
        self.cases.push(TestCase { class: text::line(class), name: text::line(name), status });
    }

    fn count(&self, wanted: impl Fn(&CaseStatus) -> bool) -> usize {
        self.cases.iter().filter(|case| wanted(&case.status)).count()
    }

    fn skipped(&self) -> usize {
        self.count(|status| matches!(status, CaseStatus::Skipped { .. }))
    }

    fn not_passed(&self, wanted: NotPassed) -> usize {
        self.count(|status| matches!(status, CaseStatus::NotPassed { kind, .. } if *kind == wanted))
    }
}

fn export(view: &ReportView<'_>) -> String {
    xml("fathom run", suites(view))
}

fn suites(view: &ReportView<'_>) -> [TestSuite; 2] {
    let mut claims = TestSuite::new("fathom run: claims");
    let mut cells = TestSuite::new("fathom run: cells");
    for section in &view.sections {
        for ruling in section.rulings() {
            claims.add(section.id, &ruling.id, claim_status(ruling));
        }
        for entry in &section.entries {
            cells.add(section.id, &entry.cell.cell, cell_status(&entry.cell.outcome));
        }
    }
    [claims, cells]
}

fn claim_status(ruling: &Ruling) -> CaseStatus {
    let Ruling { text, verdict, reason, .. } = ruling;
    match verdict {
        Verdict::Supported => CaseStatus::Passed,
        Verdict::Contradicted => failed(NotPassed::Failure, verdict, &format!("{text}: {reason}")),
        Verdict::Inconclusive | Verdict::NotRun => skipped(&format!("{verdict}: {reason}")),
    }
}

fn cell_status(outcome: &Outcome) -> CaseStatus {
    match outcome {
        Outcome::Measured(_) => CaseStatus::Passed,
        Outcome::Skipped { reason } => skipped(reason),
        Outcome::Failed { reason } => failed(NotPassed::Error, "failed", reason),
    }
}

/// A failure or an error of this type.
pub fn failed(kind: NotPassed, what: impl Display, message: &str) -> CaseStatus {
    CaseStatus::NotPassed { kind, what: what.to_string(), message: text::line(message) }
}

pub fn skipped(message: &str) -> CaseStatus {
    CaseStatus::Skipped { message: text::line(message) }
}

/// The file of these suites; those without a test case are left out.
pub fn xml<const N: usize>(name: &str, suites: [TestSuite; N]) -> String {
    let suites = suites.iter().filter(|suite| !suite.cases.is_empty()).collect_vec();
    let sum = |count: fn(&TestSuite) -> usize| suites.iter().map(|s| count(s)).sum::<usize>();
    let counts = [
        ("tests", sum(|suite| suite.cases.len())),
        ("skipped", sum(TestSuite::skipped)),
        ("failures", sum(|suite| suite.not_passed(NotPassed::Failure))),
        ("errors", sum(|suite| suite.not_passed(NotPassed::Error))),
    ];
    let mut lines = vec![r#"<?xml version="1.0" encoding="UTF-8"?>"#.to_owned()];
    lines.push(format!("<testsuites{}{}>", attribute("name", name), counted(&counts)));
    suites.iter().for_each(|suite| write_suite(suite, &mut lines));
    lines.extend(["</testsuites>".to_owned(), String::new()]);
    lines.join("\n")
}

fn write_suite(suite: &TestSuite, lines: &mut Vec<String>) {
    let counts = [
        ("tests", suite.cases.len()),
        ("skipped", suite.skipped()),
        ("errors", suite.not_passed(NotPassed::Error)),
        ("failures", suite.not_passed(NotPassed::Failure)),
    ];
    lines.push(format!("    <testsuite{}{}>", attribute("name", suite.name), counted(&counts)));
    if !suite.properties.is_empty() {
        lines.push("        <properties>".to_owned());
        lines.extend(suite.properties.iter().map(|(name, value)| {
            let attributes = attribute("name", name) + &attribute("value", value);
            format!("            <property{attributes}/>")
        }));
        lines.push("        </properties>".to_owned());
    }
    suite.cases.iter().for_each(|case| write_case(case, lines));
    lines.push("    </testsuite>".to_owned());
}

fn write_case(case: &TestCase, lines: &mut Vec<String>) {
    let attributes = attribute("name", &case.name) + &attribute("classname", &case.class);
    let inner = match &case.status {
        CaseStatus::Passed => return lines.push(format!("        <testcase{attributes}/>")),
        CaseStatus::Skipped { message } => format!("skipped{}", attribute("message", message)),
        CaseStatus::NotPassed { kind, what, message } => {
            let tag = if *kind == NotPassed::Failure { "failure" } else { "error" };
            format!("{tag}{}{}", attribute("message", message), attribute("type", what))
        }
    };
    lines.push(format!("        <testcase{attributes}>"));
    lines.push(format!("            <{inner}/>"));
    lines.push("        </testcase>".to_owned());
}

fn counted(counts: &[(&str, usize)]) -> String {
    counts.iter().map(|(name, count)| attribute(name, &count.to_string())).collect()
}

fn attribute(name: &str, value: &str) -> String {
    let value = value.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;");
    format!(r#" {name}="{}""#, value.replace('\'', "&apos;").replace('"', "&quot;"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use fathom_experiments::fixtures;

    #[test]
    fn claims_and_cells_have_a_case_each_by_what_became_of_them() {
        let records = fixtures::run();
        let view = ReportView::new(&records, None);
        let [claims, cells] = suites(&view);
        let rulings: Vec<&Ruling> = view.sections.iter().flat_map(|s| s.rulings()).collect();
        let ruled = |verdict| rulings.iter().filter(|ruling| ruling.verdict == verdict).count();
        assert!(ruled(Verdict::Contradicted) > 0 && ruled(Verdict::Supported) > 0);
        let passed = |suite: &TestSuite| suite.count(|status| *status == CaseStatus::Passed);
        assert_eq!(passed(&claims), ruled(Verdict::Supported));
        assert_eq!(claims.not_passed(NotPassed::Failure), ruled(Verdict::Contradicted));
        assert_eq!([cells.not_passed(NotPassed::Error), cells.skipped()], [1, 1]);
        assert_eq!(passed(&cells), view.measured().count());
    }

    /// As quick-junit 0.8 writes it.
    #[test]
    fn the_file_is_sound_xml() {
        let mut suite = TestSuite::new("cells");
        suite.add_property("builds", "a & b".to_owned());
        suite.add("pool", "<one>", CaseStatus::Passed);
        suite.add("pool", "two", skipped("no \"reason\""));
        suite.add("pool", "three", failed(NotPassed::Failure, "slower", "it's slow"));
        suite.add("pool", "four", failed(NotPassed::Error, "void", "no\nclock"));
        let expected = r#"<?xml version="1.0" encoding="UTF-8"?>
<testsuites name="fathom run" tests="4" skipped="1" failures="1" errors="1">
    <testsuite name="cells" tests="4" skipped="1" errors="1" failures="1">
        <properties>
            <property name="builds" value="a &amp; b"/>
        </properties>
        <testcase name="&lt;one&gt;" classname="pool"/>
        <testcase name="two" classname="pool">
            <skipped message="no &quot;reason&quot;"/>
        </testcase>
        <testcase name="three" classname="pool">
            <failure message="it&apos;s slow" type="slower"/>
        </testcase>
        <testcase name="four" classname="pool">
            <error message="no clock" type="void"/>
        </testcase>
    </testsuite>
</testsuites>
"#;
        assert_eq!(xml("fathom run", [suite, TestSuite::new("empty")]), expected);
    }
}
