//! Tables that scroll within the page where they are too wide for it.

use maud::{Markup, html};

/// A table with the markup of its columns' heads and of its rows; `about` says in a few words what it holds.
pub fn table(about: &str, class: &str, heads: &Markup, rows: &Markup) -> Markup {
    let class = Some(class).filter(|class| !class.is_empty());
    html! {
        div.scroll tabindex="0" role="region" aria-label=(about) {
            table class=[class] {
                thead { tr { (heads) } }
                tbody { (rows) }
            }
        }
    }
}

/// Heads of columns of words.
pub fn words(titles: &[&str]) -> Markup {
    html! { @for title in titles { th scope="col" { (title) } } }
}

/// Heads of columns of numbers.
pub fn numbers(titles: &[&str]) -> Markup {
    html! { @for title in titles { th.number scope="col" { (title) } } }
}

/// The head of the column that names the run, where there are several.
pub fn run(is_overlay: bool) -> Markup {
    html! { @if is_overlay { (words(&["Run"])) } }
}
