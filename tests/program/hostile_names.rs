//! One set of hostile names through everything that is written of records: Markdown, SVG, CSV, terminal, JUnit, JSON.

use std::path::Path;
use std::process::Output;

use crate::common::fathom;
use crate::common::hostile::{HOSTILE, PICTURE, records};
use serde_json::Value;

#[track_caller]
fn plain(name: &str, text: &str) {
    let hidden = text.chars().find(|c| {
        (c.is_control() && !['\n', '\t'].contains(c))
            || ('\u{202a}'..='\u{202e}').contains(c)
            || ['\u{fffe}', '\u{ffff}'].contains(c)
    });
    assert_eq!(hidden, None, "{name}");
}

fn printed(output: &Output) -> String {
    let streams = [&output.stdout, &output.stderr];
    let text = streams.map(|stream| String::from_utf8(stream.clone()).unwrap());
    text.concat()
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

fn names(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).unwrap();
    let names = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap());
    let mut names: Vec<String> = names.collect();
    names.sort();
    names
}

#[test]
fn reports_show_hostile_names_as_text() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("a/b");
    std::fs::create_dir_all(out.join("renders")).unwrap();
    std::fs::write(out.join(PICTURE), "").unwrap();
    std::fs::write(out.join("records.jsonl"), records()).unwrap();
    let output = fathom().arg("report").arg(&out).output().unwrap();
    let told = printed(&output);
    assert_eq!(output.status.code(), Some(0), "{told}");
    plain("the terminal", &told);
    // One line of standard error for each record whose id is none, on standard output one for each file.
    let refused = told.lines().filter(|line| line.contains("must be lower-case"));
    assert_eq!(refused.count(), 1 + HOSTILE.len(), "{told}");
    assert_eq!(names(folder.path()), ["a"]);
    assert_eq!(names(&folder.path().join("a")), ["b"]);
    let files = ["cells.csv", "index.html", "own.svg", "records.jsonl", "renders", "summary.md"];
    assert_eq!(names(&out), files);
    let read = |name: &str| std::fs::read_to_string(out.join(name)).unwrap();

    let summary = read("summary.md");
    markdown_is_sound(&summary);
    for expected in ["&lt;script>", "a\\|b", "own.svg"] {
        assert!(summary.contains(expected), "{expected}");
    }
    assert!(!summary.contains("gone.png"));
    let svg = read("own.svg");
    xml_is_sound("own.svg", &svg);
    for expected in ["&lt;script&gt;", "thgir"] {
        assert!(svg.contains(expected), "{expected}");
    }

    let page = read("index.html");
    plain("index.html", &page);
    assert!(page.contains("&lt;script&gt;alert(1)&lt;/script&gt;"));
    assert_eq!(page.matches("<script").count(), 2);

    let csv = read("cells.csv");
    plain("cells.csv", &csv.replace("\r\n", "\n"));
    let mut reader = csv::ReaderBuilder::new().from_reader(csv.as_bytes());
    let mut rows = 0;
    for row in reader.records() {
        let row = row.unwrap();
        rows += 1;
        assert_eq!(row.len(), 38);
        for field in &row {
            let formula = field.starts_with(['=', '+', '-', '@']);
            assert!(!formula || field.parse::<f64>().is_ok(), "{field}");
        }
    }
    assert_eq!(rows, 4 * HOSTILE.len());
}

#[test]
fn tables_of_a_comparison_show_hostile_names_as_text() {
    let folder = tempfile::tempdir().unwrap();
    let [base, head] = ["base.jsonl", "head.jsonl"].map(|name| folder.path().join(name));
    std::fs::write(&base, records()).unwrap();
    // More work: regressions, which every table names.
    std::fs::write(&head, records().replace("\"photons\":100", "\"photons\":200")).unwrap();
    let out = folder.path().join("out");
    let mut compare = fathom();
    compare.arg("compare").args([&base, &head]).arg("--out");
    let output = compare.arg(&out).output().unwrap();
    let told = printed(&output);
    assert_eq!(output.status.code(), Some(1), "{told}");
    plain("the terminal", &told);
    assert!(told.contains("<script>alert(1)</script>") && told.contains("costlier"), "{told}");
    assert!(!told.lines().any(|line| line.starts_with("# heading")), "{told}");
    for format in ["markdown", "junit", "bencher", "benchmark"] {
        let mut command = fathom();
        command.arg("compare").arg("--replay").arg(&out);
        let output = command.args(["--format", format]).output().unwrap();
        plain(format, &printed(&output));
    }
    let read = |name: &str| std::fs::read_to_string(out.join(name)).unwrap();
    markdown_is_sound(&read("summary.md"));
    xml_is_sound("junit.xml", &read("junit.xml"));
    for name in ["bencher.json", "benchmark.json"] {
        let value: Value = serde_json::from_str(&read(name)).unwrap();
        assert!(value.as_object().map_or_else(|| value.as_array().unwrap().len(), |o| o.len()) > 0);
    }
}

#[test]
fn pictures_of_different_cells_have_different_names() {
    use fathom::harness::output::picture_path;
    use fathom::record::PictureKind::{Error, Image};
    let mut names: Vec<String> = HOSTILE
        .iter()
        .chain(&["a/b", "A/B", "a b", "x~error"])
        .flat_map(|cell| [Image, Error].map(|shows| picture_path("own", cell, shows)))
        .chain([picture_path("own-x", "y", Image), picture_path("own", "x_y", Image)])
        .collect();
    let count = names.len();
    for path in &names {
        let name = path.strip_prefix("renders/").unwrap();
        assert!(!name.contains(['/', '\\', '\0']) && name.len() < 255, "{name}");
    }
    names.sort();
    names.dedup();
    assert_eq!(names.len(), count);
    assert_eq!(picture_path("uw-default", "base", Image), "renders/uw-default_base.png");
}
