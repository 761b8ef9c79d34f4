//! Names and messages as text that is safe where it goes: terminals, Markdown, XML, CSV, names of files.
//!
//! Ids, titles, cells, scenes, adapters, notes and reasons come from files that anyone may have written, and from drivers.
//! Each output has one function here, and everything that is written passes through it.

use std::borrow::Cow;
use std::fmt::Display;

use itertools::Itertools as _;
use sha2::{Digest, Sha256};

/// Characters that a message repeats of what a file, a worker or an argument says.
const EXCERPT: usize = 200;
/// Longest id of an experiment, so that file names made of it stay below the 255 bytes that file systems take.
pub const ID_LENGTH: usize = 64;
/// Widest column of a table: `format!` pads to 65,535 characters at most.
const COLUMN_WIDTH: usize = 1000;
/// Characters of a name that a file's name keeps.
const STEM_LENGTH: usize = 120;
/// Bytes of the hash that tells shortened and replaced names apart: 64 bits.
const HASH_BYTES: usize = 8;

/// Characters that terminals obey, that reorder what is read (Unicode TR 36 §2.7), or that XML 1.0 §2.2 forbids.
fn is_hidden(c: char) -> bool {
    c.is_control()
        || matches!(
            c,
            '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}' | '\u{feff}' | '\u{fffe}' | '\u{ffff}'
        )
}

/// The text on one line: line breaks and tabs become spaces, hidden characters become `�`.
pub fn line(text: &str) -> String {
    let breaks = ['\n', '\r', '\t', '\u{2028}', '\u{2029}'];
    text.chars().map(|c| if breaks.contains(&c) { ' ' } else { shown(c) }).collect()
}

/// The text on one line, of a long one the beginning.
pub fn excerpt(text: &str) -> String {
    match text.char_indices().nth(EXCERPT) {
        Some((end, _)) => line(&text[..end]) + "…",
        None => line(text),
    }
}

/// What a parser says of a file. It may repeat all of it, but not in what it expected.
pub fn fault(error: impl Display) -> String {
    let error = error.to_string();
    let (found, expected) = error.split_at(error.rfind(", expected ").unwrap_or(error.len()));
    excerpt(found) + &line(expected)
}

/// A message on one line. Long words of it and what is long between backticks are not fathom's own, but for its commands: they are cut.
pub fn message(text: &str) -> String {
    let words = |text: &str| text.split(' ').map(excerpt).join(" ");
    let text = line(text);
    if !text.matches('`').count().is_multiple_of(2) {
        return words(&text);
    }
    let parts = text.split('`').enumerate();
    let is_foreign = |n, part: &str| n % 2 == 1 && !part.starts_with("fathom ");
    parts.map(|(n, part)| if is_foreign(n, part) { excerpt(part) } else { words(part) }).join("`")
}

fn shown(c: char) -> char {
    if is_hidden(c) { char::REPLACEMENT_CHARACTER } else { c }
}

/// The same with line feeds and tabs kept: for texts of several lines, whose names have passed through [`line()`].
pub fn block<'a>(text: impl Into<Cow<'a, str>>) -> String {
    let text = text.into();
    let shown = |c| if ['\n', '\t'].contains(&c) { c } else { shown(c) };
    // Mostly nothing changes, and a page may be too large to be copied.
    if text.chars().all(|c| shown(c) == c) {
        return text.into_owned();
    }
    text.chars().map(shown).collect()
}

/// Text that Markdown shows as it is, within a paragraph, a heading, a list or a table. Code between backticks stays code.
pub fn markdown(text: &str) -> String {
    let text = line(text);
    let paired = text.matches('`').count().is_multiple_of(2);
    let mut escaped = String::with_capacity(text.len());
    let (mut before, mut in_code) = (' ', false);
    let mut rest = text.chars().peekable();
    while let Some(c) = rest.next() {
        let after = rest.peek().copied().unwrap_or(' ');
        match c {
            '<' => escaped += "&lt;",
            '&' => escaped += "&amp;",
            '|' => escaped.extend(['\\', c]),
            '`' if paired => {
                in_code = !in_code;
                escaped.push(c);
            }
            c if in_code => escaped.push(c),
            '\\' | '*' | '[' | ']' | '~' => escaped.extend(['\\', c]),
            '`' => escaped.extend(['\\', c]),
            // Within a word an underscore marks no emphasis (CommonMark 0.31 §6.2).
            '_' if !(before.is_alphanumeric() && after.is_alphanumeric()) => {
                escaped.extend(['\\', c]);
            }
            c => escaped.push(c),
        }
        before = c;
    }
    at_line_start(escaped)
}

/// Escapes what begins a heading, a quotation or a list at the start of a line.
fn at_line_start(mut text: String) -> String {
    let start = text.len() - text.trim_start().len();
    let digits = text[start..].chars().take_while(char::is_ascii_digit);
    let number = digits.count();
    let marker = start + number;
    let after = text[marker..].chars().nth(1);
    let ends = after.is_none_or(char::is_whitespace);
    let marks = match text[marker..].chars().next() {
        Some('#' | '>' | '=') => number == 0,
        Some('+' | '-') => number == 0 && (ends || after == Some('-')),
        Some('.' | ')') => number > 0 && ends,
        _ => false,
    };
    if marks {
        text.insert(marker, '\\');
    }
    text
}

/// A name as code in Markdown, outside tables.
pub fn code(name: &str) -> String {
    let name = line(name);
    let longest = name.split(|c| c != '`').map(str::len).max().unwrap_or(0);
    let fence = "`".repeat(longest + 1);
    let padding = if longest > 0 { " " } else { "" };
    format!("{fence}{padding}{name}{padding}{fence}")
}

/// A block of code in Markdown, whose fence is longer than any within it.
pub fn fenced(language: &str, code: &str) -> String {
    let longest = code.split(|c| c != '`').map(str::len).max().unwrap_or(0);
    let fence = "`".repeat(longest.max(2) + 1);
    format!("{fence}{language}\n{}\n{fence}\n", code.trim_end_matches('\n'))
}

/// A word of a command for a POSIX shell: in quotes where it holds more than plain characters.
pub fn shell(word: &str) -> String {
    let word = line(word);
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_./=,:+@%".contains(c);
    if !word.is_empty() && word.chars().all(plain) {
        return word;
    }
    format!("'{}'", word.replace('\'', "'\\''"))
}

/// A path of a file as the target of a link in Markdown.
pub fn link(path: &str) -> String {
    percent_encoded(path, |c| c.is_ascii_alphanumeric() || "-._~/=,+".contains(c))
}

/// Names as one that differs where one of them does, with a space between them: what a name holds of spaces is percent-encoded.
pub fn key<'a>(names: impl IntoIterator<Item = &'a str>) -> String {
    let is_plain = |c: char| c != '%' && !c.is_whitespace() && !is_hidden(c);
    names.into_iter().map(|name| percent_encoded(name, is_plain)).collect::<Vec<_>>().join(" ")
}

fn percent_encoded(text: &str, is_plain: impl Fn(char) -> bool) -> String {
    let encoded = |c: char| match is_plain(c) {
        true => c.to_string(),
        false => c.to_string().bytes().map(|byte| format!("%{byte:02X}")).collect(),
    };
    text.chars().map(encoded).collect()
}

/// A field of a table for spreadsheets. What one would take for a formula gets an apostrophe in front, as OWASP advises
/// (*CSV Injection*); numbers stay as they are.
pub fn spreadsheet(field: &str) -> String {
    let field = line(field);
    let formula = field.trim_start().starts_with(['=', '+', '-', '@']);
    if formula && field.parse::<f64>().is_err() { format!("'{field}") } else { field }
}

/// The stem of a file's name: different for different names, also where a file system does not tell `A` from `a`, and
/// without anything that leads to another folder. Lower-case letters, digits and `.-_=,` stay; other characters become
/// `_`, and `~` with a hash of the name follows, as after a name that is too long.
pub fn file_stem(name: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || ".-_=,".contains(c);
    let as_it_is = |c: char| plain(c) && !c.is_ascii_uppercase();
    let fits = name.len() <= STEM_LENGTH && !name.is_empty() && !name.starts_with('.');
    if fits && name.chars().all(as_it_is) {
        return name.to_owned();
    }
    let kept = |c: char| if plain(c) { c } else { '_' };
    let shown: String = name.chars().map(kept).take(STEM_LENGTH).collect();
    let hash = Sha256::digest(name.as_bytes());
    format!("{}~{}", shown.trim_start_matches('.'), hex::encode(&hash[..HASH_BYTES]))
}

/// Whether an experiment's id can name files and stand in every table.
pub fn check_id(id: &str) -> Result<(), String> {
    let plain = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-';
    if id.is_empty() || !id.chars().all(plain) {
        return Err(format!("id `{}` must be lower-case letters, digits and `-`", line(id)));
    }
    if id.len() > ID_LENGTH {
        return Err(format!("id `{id}` has {} characters, at most {ID_LENGTH}", id.len()));
    }
    Ok(())
}

/// Rows whose cells stand below one another, but for the last and those wider than `COLUMN_WIDTH`.
pub fn columns<R: AsRef<[String]>>(rows: &[R]) -> Vec<String> {
    let rows = || rows.iter().map(AsRef::as_ref);
    let width = |cell: &str| cell.chars().count().min(COLUMN_WIDTH);
    let widest = |column: usize| rows().map(|row| width(&row[column])).max();
    let count = rows().map(<[String]>::len).min().unwrap_or(0);
    let widths: Vec<usize> = (0..count).map(|column| widest(column).unwrap_or(0)).collect();
    let row = |row: &[String]| {
        let padded = row.iter().zip(&widths);
        let padded =
            padded.map(|(cell, widest)| format!("{cell}{}", " ".repeat(widest - width(cell))));
        padded.collect::<Vec<_>>().join("  ").trim_end().to_owned()
    };
    rows().map(row).collect()
}

/// Likeness of two names from which on one may be meant by the other, 0 … 1 (Jaro–Winkler).
const ALIKE: f64 = 0.7;
/// That of two names that differ by one slip of typing. Jaro–Winkler finds nothing alike in short ones, such as `rnu` and `run`.
const SLIP: f64 = 0.9;
/// That of a name and its beginning.
const BEGINNING: f64 = 0.98;
/// Below this length every name is a slip away from many others.
const SHORTEST_SLIP: usize = 3;

/// How many names an error lists.
const MOST_LISTED: usize = 24;

/// The end of an error of an unknown name: `; did you mean …?`, or all names where they are few.
pub fn did_you_mean<'a>(name: &str, candidates: impl IntoIterator<Item = &'a str>) -> String {
    let all: Vec<&str> = candidates.into_iter().collect();
    match nearest(name, all.iter().copied()) {
        Some(near) => format!("; did you mean `{}`?", line(&near)),
        None if (1..=MOST_LISTED).contains(&all.len()) => {
            format!("; there are {}", line(&all.join(", ")))
        }
        None => String::new(),
    }
}

/// The candidate most like `name`, where one is like it at all. A dotted path may be meant by its last part.
pub fn nearest<'a>(name: &str, candidates: impl IntoIterator<Item = &'a str>) -> Option<String> {
    let last = |path: &str| path.rsplit('.').next().unwrap_or_default().to_owned();
    let likeness = |candidate: &str| {
        let tail = strsim::jaro_winkler(&last(name), &last(candidate));
        let is_slip = strsim::osa_distance(name, candidate) <= 1;
        let slip = match name.chars().count() >= SHORTEST_SLIP {
            true if candidate.starts_with(name) => BEGINNING,
            true if is_slip => SLIP,
            _ => 0.0,
        };
        strsim::jaro_winkler(name, candidate).max(0.95 * tail).max(slip)
    };
    let rated = candidates.into_iter().map(|candidate| (likeness(candidate), candidate));
    let alike = rated.filter(|(likeness, _)| *likeness > ALIKE);
    let best = alike.max_by(|a, b| a.0.total_cmp(&b.0));
    best.map(|(_, candidate)| candidate.to_owned())
}

/// What a stage's name begins with, up to the stroke: `caustics` of `caustics/trace`.
pub fn family(stage: &str) -> &str {
    stage.split('/').next().unwrap_or(stage)
}

/// The families of some stages, each once.
pub fn families<'a>(stages: impl IntoIterator<Item = &'a str>) -> Vec<&'a str> {
    stages.into_iter().map(family).unique().collect()
}

/// A key that sorts sizes within names as numbers: `n=8` before `n=16`, `0.25` before `0.5`.
pub fn sort_key(name: &str) -> String {
    let mut key = String::new();
    for (is_number, run) in &name.chars().chunk_by(char::is_ascii_digit) {
        let run: String = run.collect();
        key += &if is_number && !key.ends_with('.') { format!("{run:0>20}") } else { run };
    }
    key
}

/// `2.50` as `2.5`, `1.00` as `1`.
pub fn trim_zeros(text: &str) -> &str {
    if text.contains('.') && !text.contains('e') {
        text.trim_end_matches('0').trim_end_matches('.')
    } else {
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_within_names_sort_as_numbers() {
        let names = ["n=0.25,m=8", "n=0.5", "n=8,m=2", "n=8,m=16", "n=16", "n=128x64"];
        assert!(names.is_sorted_by_key(|name| sort_key(name)));
    }

    #[test]
    fn slips_of_typing_are_found_in_short_names_too() {
        for (name, candidates, expected) in [
            ("rnu", ["render", "run"], Some("run")),
            ("cvs", ["junit", "csv"], Some("csv")),
            ("xyz", ["render", "run"], None),
            ("caustics.gird", ["caustics.grid", "grid.size"], Some("caustics.grid")),
            ("voxel.res", ["voxel.axes", "voxel.resolution"], Some("voxel.resolution")),
        ] {
            assert_eq!(nearest(name, candidates).as_deref(), expected, "{name}");
        }
    }

    #[test]
    fn families_stand_once_and_in_their_order() {
        assert_eq!(
            families(["ao/march", "hsao/march", "ao/compose", "compose"]),
            ["ao", "hsao", "compose"]
        );
    }

    #[test]
    fn hidden_characters_show_and_line_breaks_do_not_break() {
        assert_eq!(line("a\u{1b}[2Jb\nc\td\u{9b}e\u{202e}f"), "a�[2Jb c d�e�f");
        assert_eq!(block("a\u{7}\nb"), "a�\nb");
        assert_eq!(line("Größe × 2 – 日本"), "Größe × 2 – 日本");
    }

    #[test]
    fn messages_repeat_no_more_than_the_beginning_of_what_others_say() {
        let (long, cut) = ("é".repeat(90_000), "é".repeat(EXCERPT) + "…");
        let own = "mesh, ".repeat(EXCERPT);
        for of in ["no `X`; there are OWN", "OWN X ` c", "X"] {
            let of = of.replace("OWN", &own);
            assert_eq!(message(&of.replace('X', &long)), of.replace('X', &cut));
        }
        assert_eq!(message(&format!("`{own}`")), format!("`{}…`", &own[..EXCERPT]));
        let error = serde_json::from_str::<u8>(&format!("\"{long}\"")).unwrap_err();
        assert!(fault(&error).contains("éé…, expected u8 at line 1 column "));
    }

    #[test]
    fn markdown_shows_names_as_they_are() {
        assert_eq!(markdown("<b>&amp;|x"), "&lt;b>&amp;amp;\\|x");
        assert_eq!(markdown("caustics_photon_error_p99_m"), "caustics_photon_error_p99_m");
        assert_eq!(markdown("_a_ *b*"), "\\_a\\_ \\*b\\*");
        assert_eq!(markdown("![x](http://y)\\"), "!\\[x\\](http://y)\\\\");
        assert_eq!(markdown("`a.b` and `c`"), "`a.b` and `c`");
        assert_eq!(markdown("`[a_]` [b]"), "`[a_]` \\[b\\]");
        assert_eq!(markdown("a ` b"), "a \\` b");
    }

    #[test]
    fn nothing_begins_a_block_of_markdown() {
        let escaped = ["# a", "> a", "- a", "--- a", "1. a", "12) a", "===", "+"];
        for text in escaped {
            assert_ne!(markdown(text), text);
            assert_eq!(markdown(text).replacen('\\', "", 1), text);
        }
        for text in ["-0.5 a", "+5 %", "1.5 ms", "a # b", "2 cells"] {
            assert_eq!(markdown(text), text);
        }
    }

    #[test]
    fn code_holds_backticks() {
        assert_eq!(code("a=<b>"), "`a=<b>`");
        assert_eq!(code("a``b`c\n"), "``` a``b`c  ```");
    }

    #[test]
    fn keys_of_different_names_differ() {
        assert_eq!(key(["uw-default", "n=1,µ=2", "ao/march"]), "uw-default n=1,µ=2 ao/march");
        let rows: [&[&str]; 9] = [
            &["own", "base ao/march"],
            &["own", "base", "ao/march"],
            &["own base", "ao/march"],
            &["own", "base%20ao/march"],
            &["own", "base\u{a0}ao/march"],
            &["own", "base\tao/march"],
            &["own", "base\u{1b}ao/march"],
            &["own", "", "base ao/march"],
            &["own", "base ao/march", ""],
        ];
        let keys: std::collections::BTreeSet<_> =
            rows.iter().map(|row| key(row.iter().copied())).collect();
        assert_eq!(keys.len(), rows.len(), "{keys:?}");
    }

    #[test]
    fn columns_are_as_wide_as_their_widest_cell_up_to_a_limit() {
        for length in [3, 70_000] {
            let rows = [["µ".repeat(length), "b".into()], ["a".into(), "c".into()]];
            let padding = " ".repeat(length.min(COLUMN_WIDTH) - 1);
            let expected = [format!("{}  b", "µ".repeat(length)), format!("a{padding}  c")];
            assert!(columns(&rows) == expected, "{length}");
        }
    }

    #[test]
    fn links_lead_nowhere_else() {
        assert_eq!(link("renders/a_n=1,m=2~error.png"), "renders/a_n=1,m=2~error.png");
        assert_eq!(link("a](b) \"é"), "a%5D%28b%29%20%22%C3%A9");
    }

    #[test]
    fn fields_of_spreadsheets_are_no_formulas() {
        for formula in ["=1+2", "@SUM(A1,A2)", "+x"] {
            assert_eq!(spreadsheet(formula), format!("'{formula}"));
        }
        assert_eq!(spreadsheet("\t=1"), "' =1");
        assert_eq!(spreadsheet("-0.5"), "-0.5");
    }

    #[test]
    fn file_stems_are_safe_and_distinct() {
        assert_eq!(file_stem("scene=port,n=1.5"), "scene=port,n=1.5");
        let long = ["a".repeat(300), format!("{}b", "a".repeat(299))];
        let mut names =
            vec!["", ".", "..", "../../x", "/etc/x", "a/b", "a_b", "A_b", "a\\b", "a\u{0}b", "é"];
        names.extend(long.iter().map(String::as_str));
        let mut stems: Vec<String> = names.iter().map(|name| file_stem(name)).collect();
        for stem in &stems {
            assert!(!stem.starts_with('.') && stem.len() < 150, "{stem}");
            let safe = |c: char| c.is_ascii_alphanumeric() || "-._=,~".contains(c);
            assert!(stem.chars().all(safe), "{stem}");
        }
        stems.iter_mut().for_each(|stem| stem.make_ascii_lowercase());
        stems.sort();
        stems.dedup();
        assert_eq!(stems.len(), names.len());
    }

    #[test]
    fn ids_are_plain_and_short() {
        assert_eq!(check_id("uw-default"), Ok(()));
        for id in ["", "../x", "A", "a b", "a\u{1b}", &"a".repeat(65)] {
            let fault = check_id(id).unwrap_err();
            assert!(!fault.contains('\u{1b}'), "{fault}");
        }
    }
}
