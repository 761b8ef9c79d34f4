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
use fathom_record::{OVER_BUDGET, Outcome};

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
    Not {
        kind: NotPassed,
        /// What a failure or an error is called.
        what: Option<String>,
        message: String,
    },
}

/// Why a test case did not pass, by the name of its element.
#[derive(Clone, Copy, Debug, PartialEq, Eq, strum::Display)]
#[strum(serialize_all = "lowercase")]
pub enum NotPassed {
    /// Not run, or run without a decision.
    Skipped,
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

    fn count(&self, wanted: NotPassed) -> usize {
        let is = |case: &&TestCase| matches!(case.status, CaseStatus::Not { kind, .. } if kind == wanted);
        self.cases.iter().filter(is).count()
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
        Outcome::OverBudget => skipped(OVER_BUDGET),
    }
}

/// A failure or an error of this type.
pub fn failed(kind: NotPassed, what: impl Display, message: &str) -> CaseStatus {
    CaseStatus::Not { kind, what: Some(what.to_string()), message: text::line(message) }
}

pub fn skipped(message: &str) -> CaseStatus {
    CaseStatus::Not { kind: NotPassed::Skipped, what: None, message: text::line(message) }
}

/// The file of these suites; those without a test case are left out.
pub fn xml<const N: usize>(name: &str, suites: [TestSuite; N]) -> String {
    let suites = suites.iter().filter(|suite| !suite.cases.is_empty()).collect_vec();
    let counts = counts(&suites, [NotPassed::Failure, NotPassed::Error]);
    let mut lines = vec![
        r#"<?xml version="1.0" encoding="UTF-8"?>"#.to_owned(),
        format!("<testsuites{}{counts}>", attribute("name", name)),
    ];
    suites.iter().for_each(|suite| write_suite(suite, &mut lines));
    lines.extend(["</testsuites>".to_owned(), String::new()]);
    lines.join("\n")
}

fn write_suite(suite: &TestSuite, lines: &mut Vec<String>) {
    let counts = counts(&[suite], [NotPassed::Error, NotPassed::Failure]);
    lines.push(format!("    <testsuite{}{counts}>", attribute("name", suite.name)));
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
    let CaseStatus::Not { kind, what, message } = &case.status else {
        return lines.push(format!("        <testcase{attributes}/>"));
    };
    let what = what.as_ref().map_or_else(String::new, |what| attribute("type", what));
    lines.push(format!("        <testcase{attributes}>"));
    lines.push(format!("            <{kind}{}{what}/>", attribute("message", message)));
    lines.push("        </testcase>".to_owned());
}

/// How many test cases there are, how many were skipped, and of these two kinds.
fn counts(suites: &[&TestSuite], kinds: [NotPassed; 2]) -> String {
    let sum = |count: &dyn Fn(&TestSuite) -> usize| {
        suites.iter().map(|suite| count(suite)).sum::<usize>().to_string()
    };
    let of_kinds =
        kinds.map(|kind| attribute(&format!("{kind}s"), &sum(&|suite| suite.count(kind))));
    attribute("tests", &sum(&|suite| suite.cases.len()))
        + &attribute("skipped", &sum(&|suite| suite.count(NotPassed::Skipped)))
        + &of_kinds.concat()
}

fn attribute(name: &str, value: &str) -> String {
    let value = value.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;");
    format!(r#" {name}="{}""#, value.replace('\'', "&apos;").replace('"', "&quot;"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing;

    #[test]
    fn claims_and_cells_have_a_case_each_by_what_became_of_them() {
        let view = testing::view();
        let [claims, cells] = suites(&view);
        let rulings: Vec<&Ruling> = view.sections.iter().flat_map(|s| s.rulings()).collect();
        let ruled = |verdict| rulings.iter().filter(|ruling| ruling.verdict == verdict).count();
        assert!(ruled(Verdict::Contradicted) > 0 && ruled(Verdict::Supported) > 0);
        let passed = |suite: &TestSuite| {
            suite.cases.iter().filter(|case| case.status == CaseStatus::Passed).count()
        };
        assert_eq!(passed(&claims), ruled(Verdict::Supported));
        assert_eq!(claims.count(NotPassed::Failure), ruled(Verdict::Contradicted));
        assert_eq!([NotPassed::Error, NotPassed::Skipped].map(|kind| cells.count(kind)), [1, 1]);
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
