//! Pieces of a picture, put together one below the other and side by side.

use maud::{Markup, PreEscaped, html};

use fathom_base::text;

/// Width of every picture.
pub const WIDTH_PX: f64 = 980.0;
/// Left of titles and text.
pub const MARGIN_PX: f64 = 16.0;
/// A line of small type, and where its letters stand in it.
const LINE_PX: f64 = 17.0;
const BASE_PX: f64 = 12.0;

const SHEET: &str = include_str!("plots.css");

/// What is drawn from its upper left corner on.
#[derive(Clone)]
pub struct Drawing {
    pub height_px: f64,
    pub content: Markup,
}

impl Drawing {
    pub fn new(height_px: f64, content: Markup) -> Drawing {
        Drawing { height_px, content }
    }

    pub fn space(height_px: f64) -> Drawing {
        Drawing::new(height_px, html! {})
    }

    /// Lines of small type.
    pub fn lines(x_px: f64, lines: &[String]) -> Drawing {
        let content = html! {
            @for (row, line) in lines.iter().enumerate() {
                text.small x=(x_px) y=(LINE_PX * row as f64 + BASE_PX) { (line) }
            }
        };
        Drawing::new(LINE_PX * lines.len() as f64, content)
    }

    /// What the vertical axis of a chart shows, above it.
    pub fn y_title(top_px: f64, title: &str) -> Markup {
        html! { text x=(MARGIN_PX) y=(top_px - 10.0) { (title) } }
    }

    /// One below the other.
    pub fn column(parts: impl IntoIterator<Item = Drawing>) -> Drawing {
        let mut height_px = 0.0;
        let mut content = String::new();
        for part in parts {
            content +=
                &html! { g transform=(format!("translate(0 {height_px})")) { (part.content) } }.0;
            height_px += part.height_px;
        }
        Drawing::new(height_px, PreEscaped(content))
    }

    /// In rows of so many, each so wide.
    pub fn grid(parts: &[Drawing], columns: usize, width_px: f64) -> Drawing {
        Drawing::column(parts.chunks(columns).map(|row| {
            let height_px = row.iter().map(|part| part.height_px).fold(0.0, f64::max);
            let content = html! {
                @for (column, part) in row.iter().enumerate() {
                    g transform=(format!("translate({} 0)", width_px * column as f64)) { (part.content) }
                }
            };
            Drawing::new(height_px, content)
        }))
    }

    /// The file of a picture, which needs no font, no script and no other file.
    pub fn svg(&self) -> String {
        let height_px = self.height_px;
        let markup = html! {
            svg.fathom-plot xmlns="http://www.w3.org/2000/svg" width=(WIDTH_PX) height=(height_px) viewBox={ "0 0 " (WIDTH_PX) " " (height_px) } {
                style { (PreEscaped(SHEET)) }
                rect.ground width=(WIDTH_PX) height=(height_px) {}
                (self.content)
            }
        };
        // Marks of XML are escaped; what XML cannot hold at all is left to do.
        text::block(markup.into_string()) + "\n"
    }
}
