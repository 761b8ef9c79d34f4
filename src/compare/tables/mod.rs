//! Reports of a comparison: functions of its verdicts alone.

mod bencher;
mod benchmark;
mod junit;
mod markdown;
mod page;
mod rows;
mod terminal;

pub use bencher::FORMAT as BENCHER;
pub use benchmark::FORMAT as BENCHMARK;
pub use junit::FORMAT as JUNIT;
pub use markdown::FORMAT as MARKDOWN;
pub use page::{FORMAT as PAGE, on_page};
pub use terminal::FORMAT as TERMINAL;

use super::verdict::Verdicts;

/// A report of verdicts.
pub struct Format {
    /// On the command line.
    pub name: &'static str,
    pub about: &'static str,
    /// Its file in the comparison's folder; the terminal's table has none.
    pub file: Option<&'static str>,
    pub write: fn(&Verdicts<'_>) -> String,
}
