//! Reports of a comparison: functions of its verdicts alone.

mod comment;
mod document;
mod junit;
pub(crate) mod rows;

pub use document::{markdown, on_page};

use crate::{Exporter, Timing, page as html};
use fathom_judge::verdict::Verdicts;

/// A format of verdicts: it makes the text of its file.
pub type ComparisonExporter = Exporter<fn(&Verdicts<'_>) -> String>;

/// Exporters of comparisons, in the order in which their files are written.
pub const OF_COMPARISONS: [ComparisonExporter; 5] = [
    Exporter {
        written: Timing::OnRequest,
        ..format("text", "a table for the terminal", "comparison.txt", document::terminal)
    },
    format("markdown", "Markdown for the page of a job", "summary.md", document::markdown),
    format(
        "comment",
        "a comment of at most 13 lines for a pull request, beside folded blocks",
        "comment.md",
        comment::export,
    ),
    format("page", "one HTML page with every cell's change", html::FILE, document::page),
    format("junit", "JUnit XML: regressions as failures", "junit.xml", junit::export),
];

/// One that is written with every report.
const fn format(
    name: &'static str,
    about: &'static str,
    file: &'static str,
    export: fn(&Verdicts<'_>) -> String,
) -> ComparisonExporter {
    Exporter { name, about, file, written: Timing::WithEveryReport, export }
}
