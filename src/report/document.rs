//! A document: parts in their order. Three writers turn them into text for a terminal, Markdown and HTML.

use std::collections::HashSet;

use maud::{Markup, PreEscaped, html};

use fathom_base::text;
use fathom_experiments::Verdict;

/// Judgement that a word carries: a colour and a mark beside it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tone {
    Bad,
    Open,
    Neutral,
    Good,
}

impl Tone {
    /// Its class of CSS, and its mark.
    pub fn look(self) -> [&'static str; 2] {
        match self {
            Tone::Bad => ["bad", "✕"],
            Tone::Open => ["open", "?"],
            Tone::Neutral => ["none", "–"],
            Tone::Good => ["good", "✓"],
        }
    }

    pub fn from_verdict(verdict: Verdict) -> Tone {
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

    pub fn chip(self, word: &str) -> Markup {
        let [class, mark] = self.look();
        html! { span.chip.(class) { span aria-hidden="true" { (mark) " " } (word) } }
    }
}

/// Words with their look.
#[derive(Clone)]
pub enum Span {
    Words(String),
    Bold(String),
    Faint(String),
    Code(String),
    Link {
        words: String,
        to: String,
    },
    Chip(Tone, String),
    /// An experiment, with the file that holds its plots: a page has them itself.
    Experiment {
        id: String,
        file: Option<String>,
    },
    /// Seen on a page alone.
    Drawn(Markup),
}

/// A sentence, or a field of a table.
#[derive(Clone, Default)]
pub struct Line(pub Vec<Span>);

impl From<String> for Line {
    fn from(words: String) -> Line {
        Span::Words(words).into()
    }
}

impl From<&str> for Line {
    fn from(words: &str) -> Line {
        words.to_owned().into()
    }
}

impl From<Span> for Line {
    fn from(span: Span) -> Line {
        Line(vec![span])
    }
}

impl Line {
    pub fn and(mut self, more: impl Into<Line>) -> Line {
        self.0.extend(more.into().0);
        self
    }

    fn plain(&self) -> String {
        let words = self.0.iter().map(|span| match span {
            Span::Words(words) | Span::Bold(words) | Span::Faint(words) | Span::Code(words) => {
                words
            }
            Span::Link { words, .. } | Span::Chip(_, words) => words,
            Span::Experiment { id, .. } => id,
            Span::Drawn(_) => "",
        });
        text::line(&words.collect::<String>())
    }

    pub fn markdown(&self) -> String {
        self.markdown_with(text::code)
    }

    fn markdown_with(&self, code: impl Fn(&str) -> String) -> String {
        let spans = self.0.iter().map(|span| match span {
            Span::Words(words) | Span::Faint(words) | Span::Chip(_, words) => text::markdown(words),
            Span::Bold(words) => format!("**{}**", text::markdown(words)),
            Span::Code(words) => code(words),
            Span::Link { words, to } => format!("[{}]({})", text::markdown(words), text::link(to)),
            Span::Experiment { id, file: Some(file) } => {
                format!("[{}]({})", text::markdown(id), text::link(file))
            }
            Span::Experiment { id, .. } => text::markdown(id),
            Span::Drawn(_) => String::new(),
        });
        spans.collect()
    }

    pub fn html(&self) -> Markup {
        html! {
            @for span in &self.0 {
                @match span {
                    Span::Words(words) => (with_code(words)),
                    Span::Bold(words) => strong { (words) },
                    Span::Faint(words) => span.faint { (with_code(words)) },
                    Span::Code(words) => code { (words) },
                    Span::Link { words, to } => a href=(to) { (words) },
                    Span::Chip(tone, words) => (tone.chip(words)),
                    Span::Experiment { id, .. } => a.source href={ "#plot-" (id) } { (id) },
                    Span::Drawn(markup) => (markup),
                }
            }
        }
    }
}

/// Words with what stands between backticks as code.
fn with_code(words: &str) -> Markup {
    let pieces: Vec<&str> = words.split('`').collect();
    let is_code = |index: usize| index % 2 == 1 && index + 1 < pieces.len();
    html! {
        @for (index, piece) in pieces.iter().enumerate() {
            @if is_code(index) { code { (piece) } }
            @else if index % 2 == 1 { "`" (piece) }
            @else { (piece) }
        }
    }
}

pub enum Block {
    /// Of a document's largest parts.
    Title(Line),
    Heading(Line),
    Paragraph(Line),
    List(Vec<Line>),
    Table(Table),
    /// Lines of a difference as they are.
    Diff(String),
    /// A picture as SVG, in the text of a page alone.
    Chart(String),
    /// What a reader of a page opens.
    Fold(Line, Vec<Block>),
    /// The same of a page's main matter, which links lead to by its id.
    Topic(String, Line, Vec<Block>),
    /// Side by side, as many as there is room for.
    Grid(Vec<Vec<Block>>),
}

impl Block {
    /// The same with at most so many rows or items and without what is folded, and words on where the rest is.
    pub fn truncate(self, max_count: usize, place: &Line) -> Vec<Block> {
        let more_on =
            |more: usize| Line::from(format!("… and {more} more on the ")).and(place.clone());
        match self {
            Block::Table(mut table) => {
                let more = table.rows.len().saturating_sub(max_count);
                table.rows.truncate(max_count);
                let words = (more > 0).then(|| Block::Paragraph(more_on(more)));
                std::iter::once(Block::Table(table)).chain(words).collect()
            }
            Block::List(mut lines) => {
                let more = lines.len().saturating_sub(max_count);
                lines.truncate(max_count);
                lines.extend((more > 0).then(|| more_on(more)));
                vec![Block::List(lines)]
            }
            Block::Fold(line, _) | Block::Topic(_, line, _) => {
                vec![Block::Paragraph(line.and(": on the ").and(place.clone()))]
            }
            part => vec![part],
        }
    }

    pub fn paragraph(words: impl Into<Line>) -> Block {
        Block::Paragraph(words.into())
    }

    pub fn list<T: Into<Line>>(items: impl IntoIterator<Item = T>) -> Block {
        Block::List(items.into_iter().map(Into::into).collect())
    }
}

/// A field of a table. A page sorts by its value.
#[derive(Clone)]
pub struct Field {
    pub line: Line,
    pub value: Option<f64>,
}

impl<T: Into<Line>> From<T> for Field {
    fn from(line: T) -> Field {
        Field { line: line.into(), value: None }
    }
}

#[derive(Clone, Copy, PartialEq, Eq)]
pub enum ColumnKind {
    Words,
    /// Wide.
    Sentences,
    Numbers,
    /// Seen on a page alone.
    Drawings,
}

impl ColumnKind {
    /// Of CSS.
    fn class(self) -> Option<&'static str> {
        match self {
            ColumnKind::Numbers => Some("number"),
            ColumnKind::Sentences => Some("claim"),
            _ => None,
        }
    }
}

pub struct Table {
    /// What it holds, in a few words.
    about: String,
    columns: Vec<(String, ColumnKind)>,
    pub rows: Vec<Vec<Field>>,
    /// Of CSS.
    class: &'static str,
}

impl Table {
    /// With columns of words.
    pub fn new<S: Into<String>>(
        about: impl Into<String>,
        columns: impl IntoIterator<Item = S>,
    ) -> Table {
        let columns = columns.into_iter().map(|title| (title.into(), ColumnKind::Words)).collect();
        Table { about: about.into(), columns, rows: Vec::new(), class: "" }
    }

    /// Makes columns with these titles those of another kind.
    pub fn with(mut self, kind: ColumnKind, titles: &[&str]) -> Table {
        let titles: HashSet<&str> = titles.iter().copied().collect();
        let columns = self.columns.iter_mut();
        columns.filter(|(title, _)| titles.contains(title.as_str())).for_each(|c| c.1 = kind);
        self
    }

    pub fn with_class(self, class: &'static str) -> Table {
        Table { class, ..self }
    }

    pub fn with_rows<F: Into<Field>, R: IntoIterator<Item = F>>(
        mut self,
        rows: impl IntoIterator<Item = R>,
    ) -> Table {
        self.rows.extend(rows.into_iter().map(|row| row.into_iter().map(Into::into).collect()));
        self
    }

    /// The head and every row, without what only a page shows.
    fn texts(&self, write: impl Fn(&Line) -> String) -> Vec<Vec<String>> {
        let shown = |(_, kind): &&(String, ColumnKind)| *kind != ColumnKind::Drawings;
        let head = self.columns.iter().filter(shown);
        let head = head.map(|(title, _)| write(&title.as_str().into())).collect();
        let rows = self.rows.iter().map(|row| {
            let fields = row.iter().zip(&self.columns).filter(|(_, column)| shown(column));
            fields.map(|(field, _)| write(&field.line)).collect()
        });
        std::iter::once(head).chain(rows).collect()
    }

    /// With an empty line after it.
    pub fn markdown(&self) -> String {
        // A bar divides fields, also within code.
        let code = |words: &str| text::code(words).replace('|', "\\|");
        let mut lines = self.texts(|line| line.markdown_with(code)).into_iter();
        let row = |fields: Vec<String>| format!("| {} |\n", fields.join(" | "));
        let head = lines.next().unwrap_or_default();
        let rule = format!("{}|\n", "|---".repeat(head.len()));
        row(head) + &rule + &lines.map(row).collect::<String>() + "\n"
    }

    fn html(&self) -> Markup {
        let class = Some(self.class).filter(|class| !class.is_empty());
        html! {
            div.scroll tabindex="0" role="group" aria-label=(self.about) {
                table class=[class] {
                    thead { tr { @for (title, kind) in &self.columns {
                        th class=[kind.class()] scope="col" { (title) }
                    } } }
                    tbody { @for row in &self.rows { tr {
                        @for (field, (_, kind)) in row.iter().zip(&self.columns) {
                            td class=[kind.class()] data-v=[field.value] { (field.line.html()) }
                        }
                    } } }
                }
            }
        }
    }
}

/// Text for a terminal: columns in step, and nothing folded.
pub fn terminal(parts: &[Block]) -> String {
    let write = |part: &Block| match part {
        Block::Title(line) | Block::Heading(line) => format!("\n{}\n", line.plain()),
        Block::Paragraph(line) => line.plain() + "\n",
        Block::List(lines) if lines.is_empty() => String::new(),
        Block::List(lines) => {
            let lines = lines.iter().map(|line| line.plain() + "\n");
            std::iter::once("\n".to_owned()).chain(lines).collect()
        }
        Block::Table(table) => {
            format!("\n{}\n", text::columns(&table.texts(Line::plain)).join("\n"))
        }
        Block::Chart(_) => String::new(),
        Block::Diff(lines) => format!("\n{lines}"),
        Block::Fold(_, parts) | Block::Topic(_, _, parts) => terminal(parts),
        Block::Grid(cells) => cells.iter().map(|parts| terminal(parts)).collect(),
    };
    parts.iter().map(write).collect()
}

pub fn markdown(parts: &[Block]) -> String {
    let write = |part: &Block| match part {
        Block::Title(line) => format!("## {}\n\n", line.markdown()),
        Block::Heading(line) => format!("### {}\n\n", line.markdown()),
        Block::Paragraph(line) => line.markdown() + "\n\n",
        Block::List(lines) if lines.is_empty() => String::new(),
        Block::List(lines) => {
            let items = lines.iter().map(|line| format!("- {}\n", line.markdown()));
            items.collect::<String>() + "\n"
        }
        Block::Table(table) => table.markdown(),
        Block::Diff(lines) => text::fenced("diff", lines) + "\n",
        Block::Chart(_) => String::new(),
        Block::Grid(cells) => cells.iter().map(|parts| markdown(parts)).collect(),
        Block::Fold(line, parts) | Block::Topic(_, line, parts) => format!(
            "<details><summary>{}</summary>\n\n{}</details>\n\n",
            line.markdown(),
            markdown(parts)
        ),
    };
    parts.iter().map(write).collect()
}

/// For a section of a page, which is left out where it has no parts.
pub fn html_if_any(parts: Vec<Block>) -> Option<Markup> {
    (!parts.is_empty()).then(|| html(&parts))
}

pub fn html(parts: &[Block]) -> Markup {
    html! {
        @for part in parts {
            @match part {
                Block::Title(line) | Block::Heading(line) => h3 { (line.html()) },
                Block::Paragraph(line) => p { (line.html()) },
                Block::List(lines) => @if !lines.is_empty() { ul { @for line in lines { li { (line.html()) } } } },
                Block::Table(table) => (table.html()),
                Block::Diff(lines) => div.scroll tabindex="0" role="group" aria-label="Difference" { pre { (lines) } },
                Block::Chart(svg) => div.scroll tabindex="0" role="group" aria-label="Chart" { (PreEscaped(svg)) },
                Block::Fold(line, parts) => details { summary { (line.html()) } (html(parts)) },
                Block::Topic(id, line, parts) => details.plot #(id) { summary { (line.html()) } (html(parts)) },
                Block::Grid(cells) => div.multiples { @for parts in cells { div { (html(parts)) } } },
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every kind of part and of span, with names that mean something to each writer.
    #[test]
    fn three_writers_say_the_same() {
        let chip = Line::from(Span::Chip(Tone::Bad, "a|b".to_owned()));
        let drawn = Field::from(Span::Drawn(html! { svg {} }));
        let table = Table::new("Rows", ["name", "strip", "n"])
            .with(ColumnKind::Drawings, &["strip"])
            .with(ColumnKind::Numbers, &["n"])
            .with_rows([[chip.into(), drawn, Field { value: Some(2.0), ..Field::from("<2>") }]]);
        let link = Span::Link { words: "page".to_owned(), to: "index.html".to_owned() };
        let parts = [
            Block::Heading("What".into()),
            Block::paragraph(Line::from("see ").and(link)),
            Block::Fold("all".into(), vec![Block::Table(table), Block::list(["*one*\n"])]),
        ];
        for (written, expected) in [
            (terminal(&parts), "\nWhat\nsee page\n\nname  n\na|b   <2>\n\n*one* \n"),
            (
                markdown(&parts),
                "### What\n\nsee [page](index.html)\n\n<details><summary>all</summary>\n\n| name | n |\n|---|---|\n| a\\|b | &lt;2> |\n\n- \\*one\\* \n\n</details>\n\n",
            ),
        ] {
            assert_eq!(written, expected);
        }
        let page = html(&parts).into_string();
        for expected in [
            "<h3>What</h3><p>see <a href=\"index.html\">page</a></p><details><summary>all</summary>",
            "<td class=\"number\" data-v=\"2\">&lt;2&gt;</td>",
            "<td><svg></svg></td>",
        ] {
            assert!(page.contains(expected), "{page}");
        }
    }
}
