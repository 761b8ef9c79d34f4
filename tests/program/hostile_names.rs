//! One set of hostile names through everything that is written of records: Markdown, SVG, CSV, terminal, JUnit, JSON.

use crate::common::hostile::{HOSTILE, PICTURE, records};
use crate::common::{Ends, Place, holds, lines, names, write_records};
use fathom::record::comparison::{
    CellId, Compared, ComparisonEnd, ComparisonHeader, ExactFigures, Gate, GateSettings,
    InstructionCounts, Side,
};
use fathom::record::{Record, Work};
use itertools::Itertools;

#[track_caller]
fn plain(name: &str, text: &str) {
    let hidden = text.chars().find(|c| {
        (c.is_control() && !['\n', '\t'].contains(c))
            || ('\u{202a}'..='\u{202e}').contains(c)
            || ['\u{fffe}', '\u{ffff}'].contains(c)
    });
    assert_eq!(hidden, None, "{name}");
}

/// A line of Markdown without its code, in which a mark of HTML is text (CommonMark 0.31 §6.1).
fn without_code(line: &str) -> String {
    let mut outside = String::new();
    let mut rest = line;
    while let Some(start) = rest.find(['`', '\\']) {
        outside += &rest[..start];
        rest = &rest[start..];
        let fence = rest.len() - rest.trim_start_matches('`').len();
        let run = |text: &str| text.len() - text.trim_start_matches('`').len();
        let close = (fence..rest.len()).find(|at| {
            let bytes = rest.as_bytes();
            bytes[*at] == b'`' && bytes[at - 1] != b'`' && run(&rest[*at..]) == fence
        });
        let skipped = match (fence, close) {
            // A backslash and what it escapes.
            (0, _) => 1 + rest[1..].chars().next().map_or(0, char::len_utf8),
            (_, Some(close)) => close + fence,
            (_, None) => fence,
        };
        if fence == 0 {
            outside += &rest[..skipped];
        }
        rest = &rest[skipped..];
    }
    outside + rest
}

#[track_caller]
fn markdown_is_sound(text: &str) {
    plain("Markdown", text);
    let mut rest = text.to_owned();
    for own in ["<details><summary>", "</summary>", "</details>"] {
        rest = rest.replace(own, "");
    }
    for line in rest.lines() {
        let outside = without_code(line);
        assert!(!outside.contains('<'), "{line}");
        assert!(!outside.replace("\\]", "").contains("](http"), "{line}");
    }
    assert!(!rest.contains("\n# heading"));
    let columns = |line: &str| line.replace("\\\\", "").replace("\\|", "").matches('|').count();
    let mut above: Option<&str> = None;
    for line in text.lines() {
        let table = line.starts_with('|');
        if let Some(above) = above.filter(|_| table) {
            assert_eq!(columns(above), columns(line), "{above}\n{line}");
        }
        above = Some(line).filter(|_| table);
    }
}

#[track_caller]
fn xml_is_sound(name: &str, text: &str) {
    plain(name, text);
    let mut reader = quick_xml::Reader::from_str(text);
    reader.config_mut().check_end_names = true;
    let mut open = 0;
    loop {
        match reader.read_event().unwrap_or_else(|fault| panic!("{name}: {fault}")) {
            quick_xml::events::Event::Start(_) => open += 1,
            quick_xml::events::Event::End(_) => open -= 1,
            quick_xml::events::Event::Eof => break,
            _ => {}
        }
    }
    assert_eq!(open, 0, "{name}");
    assert!(!text.contains("<script"), "{name}");
}

#[test]
fn reports_show_hostile_names_as_text() {
    let place = Place::new();
    place.write(format!("a/b/{PICTURE}"), "");
    place.write("a/b/records.jsonl", records());
    let output = place.fathom("report a/b").ends(0);
    plain("the terminal", &format!("{}{}", output.out, output.err));
    // The records whose ids are none.
    let refused =
        format!("must be lower-case letters, digits and `-` (and {} more)", HOSTILE.len());
    assert_eq!(output.err.matches(&refused).count(), 1, "{}", output.err);
    assert_eq!(names(&place.path("")), ["a"]);
    assert_eq!(names(&place.path("a")), ["b"]);
    let files = ["cells.csv", "index.html", "own.svg", "records.jsonl", "renders", "summary.md"];
    assert_eq!(names(&place.path("a/b")), files);

    let summary = place.read("a/b/summary.md");
    markdown_is_sound(&summary);
    holds(&summary, &["&lt;script>", "a\\|b", "own.svg"]);
    assert!(!summary.contains("gone.png"));
    let svg = place.read("a/b/own.svg");
    xml_is_sound("own.svg", &svg);
    holds(&svg, &["&lt;script&gt;", "thgir"]);

    let page = place.read("a/b/index.html");
    plain("index.html", &page);
    holds(&page, &["&lt;script&gt;alert(1)&lt;/script&gt;"]);
    assert_eq!(page.matches("<script").count(), 2);

    let csv = place.read("a/b/cells.csv");
    plain("cells.csv", &csv.replace("\r\n", "\n"));
    let mut reader = csv::Reader::from_reader(csv.as_bytes());
    let head = reader.headers().unwrap();
    let columns = 56 + head.iter().filter(|name| name.starts_with("axis:")).count();
    let mut rows = 0;
    for row in reader.records() {
        let row = row.unwrap();
        rows += 1;
        assert_eq!(row.len(), columns);
        for field in &row {
            let formula = field.starts_with(['=', '+', '-', '@']);
            assert!(!formula || field.parse::<f64>().is_ok(), "{field}");
        }
    }
    assert_eq!(rows, 5 * HOSTILE.len());
}

#[test]
fn a_history_shows_hostile_names_as_text() {
    let place = Place::new();
    let path = place.write("run/records.jsonl", records());
    let mut sound = fathom::record::read_good(&path).unwrap().records;
    sound[0].try_as_run_mut().unwrap().started_at = "2026-02-03T04:05:06Z".to_owned();
    place.write("run/records.jsonl", lines(sound));
    let sql = "x'); DROP TABLE fathom_run; --\" ../../up \u{1b}[31m";
    let mut add = place.fathom("history add run --db history.sqlite");
    add.args(["--branch", sql, "--machine", sql, "--commit", "c0ffee"]).ends(0);
    for words in ["list", "changes", "show --out page"] {
        plain(words, &place.fathom(format!("history {words} --db history.sqlite")).answer());
    }
    let page = place.read("page/index.html");
    plain("the page", &page);
    assert_eq!(page.matches("<script").count(), 2);
    let mut names = names(&place.path(""));
    names.retain(|name| !name.starts_with("history.sqlite"));
    assert_eq!(names, ["page", "run"]);
}

/// Of configurations with these names, whose head has more work.
fn comparison() -> Vec<Record> {
    let cells: Vec<CellId> = HOSTILE.iter().map(|name| CellId::new(name, "compose")).collect();
    let settings =
        GateSettings { gates: vec![Gate::Exact, Gate::Instructions], ..Default::default() };
    let header = ComparisonHeader { cells: cells.clone(), settings, ..Default::default() };
    let sides = [(Side::Base, 100), (Side::Head, 200)].into_iter().cartesian_product(cells);
    let figures = sides.flat_map(|((side, photons), cell)| {
        let work = Work { photons, ..Work::default() };
        let counts = vec![photons; 3];
        [
            Compared::Instructions(InstructionCounts {
                side,
                cell: cell.clone(),
                counts,
                second: false,
            }),
            Compared::Exact(ExactFigures { side, cell, work, counters: Default::default() }),
        ]
    });
    let end = Compared::End(ComparisonEnd { wall_s: 1.0, interrupted: false });
    let header = Compared::Header(Box::new(header));
    std::iter::once(header).chain(figures).chain([end]).map(Record::from).collect()
}

#[test]
fn tables_of_a_comparison_show_hostile_names_as_text() {
    let place = Place::new();
    place.write("base.jsonl", records());
    // More work: regressions, which every table names.
    place.write("head.jsonl", records().replace("\"photons\":100", "\"photons\":200"));
    let changes = place.fathom("compare base.jsonl head.jsonl").ends(1);
    holds(&changes.out, &["exact figures of 19 cells: worse"]);
    write_records(&place.path("out"), &comparison());
    let tables = place.fathom("compare --replay out").ends(1);
    for told in [changes, tables].map(|told| told.out + &told.err) {
        plain("the terminal", &told);
        holds(&told, &["<script>alert(1)</script>"]);
        assert!(!told.lines().any(|line| line.starts_with("# heading")), "{told}");
    }
    for format in ["markdown", "junit"] {
        let output = place.fathom(format!("compare --replay out --format {format}")).output();
        let output = output.unwrap();
        plain(format, &String::from_utf8([output.stdout, output.stderr].concat()).unwrap());
    }
    markdown_is_sound(&place.read("out/summary.md"));
    markdown_is_sound(&place.read("out/comment.md"));
    xml_is_sound("junit.xml", &place.read("out/junit.xml"));
}
