//! Words with a colour.

use maud::{Markup, html};

/// How a reader takes a word: by a colour and a mark beside it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tone {
    Bad,
    Open,
    Neutral,
    Good,
}

impl Tone {
    pub fn class(self) -> &'static str {
        match self {
            Tone::Bad => "bad",
            Tone::Open => "open",
            Tone::Neutral => "none",
            Tone::Good => "good",
        }
    }

    fn mark(self) -> &'static str {
        match self {
            Tone::Bad => "✕",
            Tone::Open => "?",
            Tone::Neutral => "–",
            Tone::Good => "✓",
        }
    }

    pub fn chip(self, word: &str) -> Markup {
        html! { span.chip.(self.class()) { span aria-hidden="true" { (self.mark()) " " } (word) } }
    }
}
