//! The fixture's run, and pages of records, for tests.

use std::sync::LazyLock;

use maud::Markup;

use crate::Report;
use crate::page::{Page, PageRun};
use fathom_experiments::fixtures;
use fathom_record::Record;

/// The fixture's run.
pub fn view() -> Report<'static> {
    static RECORDS: LazyLock<Vec<Record>> = LazyLock::new(fixtures::run);
    Report::new(&RECORDS, None)
}

/// A page of these runs, called `one`, `two`.
pub fn page<'a>(views: &[&'a Report<'a>]) -> Page<'a> {
    let labels = ["one", "two"].into_iter().zip(views);
    Page::new(labels.map(|(label, view)| PageRun { label: label.to_owned(), view }).collect())
}

/// A section of the page of one run; empty where it has none.
pub fn written(write: fn(&Page<'_>) -> Option<Markup>, records: &[Record]) -> String {
    write(&page(&[&Report::new(records, None)])).map_or_else(String::new, Markup::into_string)
}

/// A section of the page on which the fixture's run stands twice.
pub fn overlaid(write: fn(&Page<'_>) -> Option<Markup>) -> String {
    let view = view();
    write(&page(&[&view, &view])).map_or_else(String::new, Markup::into_string)
}
