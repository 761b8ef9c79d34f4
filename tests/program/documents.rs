//! Command lines that documents show: in blocks of code, in code within sentences, in files of jobs, in scripts.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

use clap::error::ErrorKind;
use fathom::process::{self, Limits, ProcessError};
use itertools::Itertools;

use super::common::{Ends, Place, git};

/// A command line of fathom.
struct CommandLine {
    document: String,
    /// It stands in a sentence, where names in capitals stand for values and what is required may lack.
    is_inline: bool,
    words: Vec<String>,
}

fn documents() -> Vec<PathBuf> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let folders = ["docs", "ci", "scripts", "scripts/ci"].map(|folder| root.join(folder));
    let entries = folders.iter().flat_map(|folder| fs::read_dir(folder).unwrap());
    let files = entries.map(|entry| entry.unwrap().path()).filter(|path| path.is_file());
    let is_text = |of: &std::ffi::OsStr| !["png", "jpg", "json"].iter().any(|other| of == *other);
    let files = files.filter(|path| path.extension().is_none_or(is_text));
    let named =
        ["README.md", "ARCHITECTURE.md", "action.yml", "Makefile"].map(|name| root.join(name));
    files.chain(named).sorted().collect()
}

/// Commands of a line of the shell, as words. What the shell puts in for a variable is a 1.
fn commands(line: &str) -> Vec<Vec<String>> {
    let (mut all, mut words, mut word) = (Vec::new(), Vec::new(), None::<String>);
    let (mut quote, mut letters) = (None, line.chars().peekable());
    while let Some(letter) = letters.next() {
        match (letter, quote) {
            (mark, Some(open)) if mark == open => quote = None,
            ('$', None | Some('"'))
                if letters.peek().is_some_and(|next| *next == '{' || next.is_alphabetic()) =>
            {
                let braced = letters.next_if_eq(&'{').is_some();
                while letters
                    .next_if(|c| if braced { *c != '}' } else { c.is_alphanumeric() || *c == '_' })
                    .is_some()
                {}
                while braced && letters.next_if_eq(&'}').is_some() {}
                word.get_or_insert_default().push('1');
            }
            (inner, Some(_)) => word.get_or_insert_default().push(inner),
            ('\'' | '"', None) => {
                quote = Some(letter);
                word.get_or_insert_default();
            }
            ('#', None) if word.is_none() => break,
            (' ' | '\t', None) => words.extend(word.take()),
            (';' | '&' | '|' | '(' | ')' | '<' | '>', None) => {
                words.extend(word.take());
                all.push(std::mem::take(&mut words));
            }
            (other, None) => word.get_or_insert_default().push(other),
        }
    }
    words.extend(word);
    all.push(words);
    all
}

/// Those of a text of the shell that call fathom, without what stands before it.
fn calls(text: &str) -> Vec<Vec<String>> {
    let is_before = |word: &String| {
        let is_key = ["-", "run:", "if", "then", "do", "!", "$"].contains(&word.as_str());
        is_key
            || word
                .split_once('=')
                .is_some_and(|(name, _)| name.chars().all(|c| c.is_ascii_alphabetic() || c == '_'))
    };
    let called = |words: Vec<String>| -> Option<Vec<String>> {
        let words: Vec<String> =
            words.into_iter().skip_while(is_before).filter(|word| word != "…").collect();
        (words.first()? == "fathom" || words[0].ends_with("/fathom")).then_some(words)
    };
    text.replace("\\\n", " ").lines().flat_map(commands).filter_map(called).collect()
}

fn shown() -> Vec<CommandLine> {
    let of_document = |path: PathBuf| {
        let text = fs::read_to_string(&path).unwrap();
        let document = path.file_name().unwrap().to_string_lossy().into_owned();
        let is_markdown = document.ends_with(".md");
        // What stands between marks of a block is every second part.
        let parts = text
            .split("```")
            .enumerate()
            .map(|(place, part)| (is_markdown && place % 2 == 0, part));
        let of_part = |(is_prose, part): (bool, &str)| -> Vec<(bool, Vec<String>)> {
            let inline =
                part.lines().flat_map(|line| line.split('`').skip(1).step_by(2)).flat_map(calls);
            let inline = inline.map(|words| (true, words));
            if is_prose {
                inline.collect()
            } else {
                calls(part).into_iter().map(|words| (false, words)).chain(inline).collect()
            }
        };
        let found: Vec<_> = parts.flat_map(of_part).collect();
        found.into_iter().map(move |(is_inline, words)| CommandLine {
            document: document.clone(),
            is_inline,
            words,
        })
    };
    documents().into_iter().flat_map(of_document).collect()
}

#[test]
fn command_lines_that_documents_show_are_understood() {
    use ErrorKind::*;
    let shown = shown();
    let (inline, blocks) = shown.iter().partition::<Vec<_>, _>(|line| line.is_inline);
    assert!(inline.len() > 80 && blocks.len() > 30, "{} and {}", inline.len(), blocks.len());
    let refused = shown.iter().filter_map(|CommandLine { document, is_inline, words }| {
        let error = fathom::cli::parse(words).err()?;
        let is_name = [
            MissingRequiredArgument,
            MissingSubcommand,
            InvalidValue,
            ValueValidation,
            WrongNumberOfValues,
            DisplayHelpOnMissingArgumentOrSubcommand,
        ];
        let is_right = matches!(error.kind(), DisplayHelp | DisplayVersion)
            || (*is_inline && is_name.contains(&error.kind()));
        (!is_right).then(|| format!("{document}: {}: {error}", words.join(" ")))
    });
    assert_eq!(refused.collect_vec(), Vec::<String>::new());
    let [good, bad] =
        ["fathom run --budget 2m # why", "A=1 x/fathom bisect --good \"$REV\" --no-such"]
            .map(calls);
    assert!(fathom::cli::parse(&good[0]).is_ok() && fathom::cli::parse(&bad[0]).is_err());
}

/// Every command of a block, in a clone of this repository, each for some seconds (`FATHOM_DOCUMENT_SECONDS`, by default 20). It may lack
/// an input that the document speaks of, and nothing else.
#[test]
#[cfg_attr(
    not(feature = "nightly"),
    ignore = "twenty seconds for each command: make test-all runs it"
)]
fn command_lines_that_documents_show_run() {
    let seconds = std::env::var("FATHOM_DOCUMENT_SECONDS").map_or(20, |text| text.parse().unwrap());
    let place = Place::new();
    let clone = ["clone", "--quiet", env!("CARGO_MANIFEST_DIR"), "clone"];
    git(place.path("")).args(clone).ends(0);
    let lacks = [
        "No such file",
        "cannot find",
        "unknown revision",
        "no experiment",
        "not found",
        "holds no",
        "no runs",
        "is absent",
        "is not installed",
        "no comparison",
        "nothing in this history fits",
        "no time in this history is a control",
    ];
    let mut failed = Vec::new();
    for CommandLine { document, words, .. } in shown().into_iter().filter(|line| !line.is_inline) {
        let mut command = Command::new(env!("CARGO_BIN_EXE_fathom"));
        // A release is checked out by its tag, on no branch.
        command.args(&words[1..]).current_dir(place.path("clone")).env("GITHUB_REF_NAME", "main");
        let limits = Limits { time: Some(Duration::from_secs(seconds)), interrupted: None };
        if let Err(ProcessError::Failed { status, complaint }) =
            process::run(&mut command, limits, &mut |_| ())
        {
            let said = complaint.to_string();
            let has_driver = words.iter().any(|word| word.contains("VK_DRIVER_FILES="));
            if status.code().is_none_or(|code| code == 2)
                && !lacks.iter().any(|reason| said.contains(reason))
                && !(has_driver && said.contains("no GPU adapter found"))
            {
                failed.push(format!("{document}: {}: {said}", words.join(" ")));
            }
        }
    }
    assert_eq!(failed, Vec::<String>::new());
}

/// Files that documents link, from where they lie, and their headings.
#[test]
fn links_of_documents_lead_somewhere() {
    let anchor = |heading: &str| {
        let kept = heading.chars().filter(|c| c.is_alphanumeric() || [' ', '-', '_'].contains(c));
        kept.collect::<String>().trim().to_lowercase().replace(' ', "-")
    };
    let mut broken = Vec::new();
    for document in documents().into_iter().filter(|path| path.extension() == Some("md".as_ref())) {
        let text = fs::read_to_string(&document).unwrap();
        let links = text.split("](").skip(1).filter_map(|rest| Some(rest.split_once(')')?.0));
        for link in links.filter(|link| !link.contains("://")) {
            let (file, place) = link.split_once('#').unwrap_or((link, ""));
            let path =
                if file.is_empty() { document.clone() } else { document.with_file_name(file) };
            let target = fs::read_to_string(&path).unwrap_or_default();
            let mut headings = target.lines().filter(|line| line.starts_with('#'));
            let is_there = headings.any(|line| anchor(line.trim_matches('#')) == place);
            if !path.exists() || !place.is_empty() && !is_there {
                broken.push(format!("{}: {link}", document.display()));
            }
        }
    }
    assert_eq!(broken, Vec::<String>::new());
}
