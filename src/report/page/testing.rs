//! Pages of records, for tests of their sections.

use maud::Markup;

use super::{Page, PageRun};
use crate::ReportView;
use fathom_record::Record;

/// A page of these runs, called `one`, `two`.
pub fn page<'a>(views: &[&'a ReportView<'a>]) -> Page<'a> {
    let labels = ["one", "two"].into_iter().zip(views);
    Page::new(labels.map(|(label, view)| PageRun { label: label.to_owned(), view }).collect())
}

/// A section of the page of one run; empty where it has none.
pub fn written(write: fn(&Page<'_>) -> Option<Markup>, records: &[Record]) -> String {
    write(&page(&[&ReportView::new(records, None)])).map_or_else(String::new, Markup::into_string)
}

/// A section of the page on which a run stands twice.
pub fn overlaid(write: fn(&Page<'_>) -> Option<Markup>, records: &[Record]) -> String {
    let view = ReportView::new(records, None);
    write(&page(&[&view, &view])).map_or_else(String::new, Markup::into_string)
}
