//! Sheets of figures: a page of pictures with their captions.

use std::path::Path;

use maud::{DOCTYPE, Markup, PreEscaped, html};

use super::figures::{PaperFigure, RenderedPanel, panel_file};

const STYLE: &str = "body { font: 16px/1.4 sans-serif; margin: 1rem; color-scheme: light dark; }
.panels { display: grid; gap: 1rem; } figure { margin: 0; } img { max-width: 100%; }
figcaption { contain: inline-size; }";

/// A figure's part of a page, with the files of its panels.
pub fn section(figure: &PaperFigure, panels: &[RenderedPanel]) -> Markup {
    html! {
        section {
            h2 { (figure.source) ": " (figure.title) }
            p { (with_code(&figure.about)) }
            div.panels style={ "grid-template-columns: repeat(" (figure.columns) ", max-content)" } {
                @for (number, RenderedPanel { caption, picture, shows_visibility }) in panels.iter().enumerate() {
                    figure {
                        img src=(panel_file(Path::new(""), figure, number).display()) width=(picture.width())
                            height=(picture.height()) alt=(caption);
                        figcaption { (with_code(caption)) @if *shows_visibility { " (black is A = 1, white A = 0)" } }
                    }
                }
            }
        }
    }
}

/// Words with what stands between backticks as code.
fn with_code(words: &str) -> Markup {
    html! {
        @for (place, piece) in words.split('`').enumerate() {
            @if place % 2 == 1 { code { (piece) } } @else { (piece) }
        }
    }
}

/// The page of these parts.
pub fn page(title: &str, sections: &[Markup]) -> String {
    let page = html! {
        (DOCTYPE)
        html lang="en" {
            head { meta charset="utf-8"; title { (title) } style { (PreEscaped(STYLE)) } }
            body { @for section in sections { (section) } }
        }
    };
    page.into_string()
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::RgbImage;

    #[test]
    fn a_sheet_shows_every_panel_with_its_caption_and_what_greys_mean() {
        let text = "id = \"f-1\"\ntitle = \"A & B\"\nsource = \"s\"\nabout = \"see `b/c`\"\n[[panel]]\ncaption = \"c\"";
        let figure: PaperFigure = toml::from_str(text).unwrap();
        let panel = |shows_visibility| RenderedPanel {
            picture: RgbImage::new(40, 20),
            shows_visibility,
            caption: format!("greys: {shows_visibility}"),
        };
        let text = page("f-1", &[section(&figure, &[panel(false), panel(true)])]);
        assert!(text.contains("<p>see <code>b/c</code></p>"), "{text}");
        assert!(text.contains("A &amp; B") && text.contains("repeat(2, max-content)"), "{text}");
        for part in [
            "f-1-a.png\" width=\"40\" height=\"20\"",
            "f-1-b.png",
            ">greys: false</",
            ">greys: true (black is A = 1",
        ] {
            assert_eq!(text.matches(part).count(), 1, "{part}: {text}");
        }
    }
}
