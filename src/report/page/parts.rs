//! What sections are made of: tables, marked words, settings of cells.

use itertools::Itertools;
use maud::{Markup, html};
use serde_json::Value;

use fathom_experiments::{Verdict, label_text, words as terms};

/// A table that scrolls within the page where it is too wide for it, with the markup of its columns' heads and of its rows; `about`
/// says in a few words what it holds.
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

/// How a reader takes a word: by a colour and a mark beside it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tone {
    Bad,
    Open,
    Neutral,
    Good,
}

impl Tone {
    /// Its class of CSS, and its mark.
    fn look(self) -> [&'static str; 2] {
        match self {
            Tone::Bad => ["bad", "✕"],
            Tone::Open => ["open", "?"],
            Tone::Neutral => ["none", "–"],
            Tone::Good => ["good", "✓"],
        }
    }

    pub fn of(verdict: Verdict) -> Tone {
        match verdict {
            Verdict::Contradicted => Tone::Bad,
            Verdict::NearBound | Verdict::Inconclusive => Tone::Open,
            Verdict::NotRun => Tone::Neutral,
            Verdict::Supported => Tone::Good,
        }
    }

    pub fn mark(self) -> &'static str {
        self.look()[1]
    }

    pub fn class(self) -> &'static str {
        self.look()[0]
    }

    pub fn chip(self, word: &str) -> Markup {
        let [class, mark] = self.look();
        html! { span.chip.(class) { span aria-hidden="true" { (mark) " " } (word) } }
    }
}

/// The values of a cell's axes: `samples per ray 16, method: mesh`.
pub fn setting_words<'a>(axes: impl IntoIterator<Item = (&'a String, &'a Value)>) -> String {
    let one = |(name, value): (&'a String, &'a Value)| {
        let label = terms::parameter(name);
        let (words, unit, text) = (label.words, label.unit.symbol(), label_text(value));
        match value {
            Value::Number(_) => format!("{words} {text} {unit}").trim_end().to_owned(),
            Value::Bool(on) => format!("{words}: {}", if *on { "on" } else { "off" }),
            _ => format!("{words}: {text}"),
        }
    };
    axes.into_iter().map(one).join(", ")
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn numbers_stand_behind_their_names_and_names_behind_a_colon() {
        let axes = json!({ "ao.samples": 16, "ao.skipping": true, "godrays.line_width_px": 2.5, "method": "mesh" });
        assert_eq!(
            setting_words(axes.as_object().unwrap()),
            "samples per ray 16, skipping of empty space: on, line width of godrays 2.5 px, method: mesh"
        );
    }
}
