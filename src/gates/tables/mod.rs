//! Reports of a comparison: functions of its verdicts alone.

mod bencher;
mod benchmark;
mod junit;
mod markdown;
mod page;
mod rows;
mod terminal;

pub use bencher::EXPORTER as BENCHER;
pub use benchmark::EXPORTER as BENCHMARK;
pub use junit::EXPORTER as JUNIT;
pub use markdown::EXPORTER as MARKDOWN;
pub use page::{EXPORTER as PAGE, on_page};
pub use terminal::EXPORTER as TERMINAL;

use super::verdict::Verdicts;
use fathom_report::Exporter;

/// A format of verdicts: it makes the text of its file.
pub type ComparisonExporter = Exporter<fn(&Verdicts<'_>) -> String>;
