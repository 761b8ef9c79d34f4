//! What is told of a comparison: functions of its verdicts alone.

mod bencher;
mod benchmark;
mod junit;
mod markdown;
mod rows;
mod terminal;

use super::verdict::Verdicts;

/// A way to tell verdicts.
pub struct Format {
    /// On the command line.
    pub name: &'static str,
    pub about: &'static str,
    /// Its file in the comparison's folder; the terminal's table has none.
    pub file: Option<&'static str>,
    pub write: fn(&Verdicts<'_>) -> String,
}

/// Every format. Adding one costs a file and a line.
pub const FORMATS: &[Format] =
    &[terminal::FORMAT, markdown::FORMAT, junit::FORMAT, bencher::FORMAT, benchmark::FORMAT];

pub fn find(name: &str) -> Option<&'static Format> {
    FORMATS.iter().find(|format| format.name == name)
}
/// What goes to a pull request or a job's page.
pub fn markdown(verdicts: &Verdicts<'_>) -> String {
    (markdown::FORMAT.write)(verdicts)
}
