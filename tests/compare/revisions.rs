//! Which revision `fathom compare --base` builds, of what, and what of it is told. The base's program is a script, or one that says a word
//! in place of a greeting.

use std::process::Command;

use super::bisect::{Commits, LOCK, MANIFEST};
use super::builds::CELLS;
use super::common::{Ends, git, holds};
use super::script::{Script, hello};

const SAYS: &str = "fn main() {
    println!(\"WORD {}\", option_env!(\"HOW\").unwrap_or_default());
    std::io::stdin().lines().for_each(drop);
}
";

/// Commits of a program that says its number.
fn saying(commits: usize) -> Commits {
    Commits::with_commits(commits, |place, number| {
        place.write("Cargo.toml", MANIFEST);
        place.write("Cargo.lock", LOCK);
        place.write("main.rs", SAYS.replace("WORD", &format!("word {number}")));
        place.write(".gitignore", "/target\n/out*\n");
    })
}

/// What the base says, which is no greeting.
#[track_caller]
fn says(compare: &mut Command, word: &str) {
    compare.ends(2).error(&format!("the base build: it answered garbage to `hello`: `{word}"));
}

#[test]
fn the_base_is_where_the_branches_part_unless_it_is_asked_for_exactly() {
    let history = saying(2);
    history.git(&["branch", "other"]);
    history.git(&["reset", "--quiet", "--hard", "HEAD~1"]);
    history.git(&["commit", "--quiet", "--allow-empty", "--message=Ours"]);
    says(&mut history.fathom("compare --base other"), "word 0");
    says(&mut history.fathom("compare --base-exact other"), "word 1");
    // Cargo asks the variable again.
    says(history.fathom("compare --base other").env("HOW", "here"), "word 0 here");
    history.git(&["checkout", "--quiet", "--orphan", "apart"]);
    history.git(&["commit", "--quiet", "--message=Apart"]);
    let reason = "have no common ancestor here; --base-exact REV names a base by itself";
    history.fathom("compare --base other").refused(reason);
}

#[test]
fn a_hook_of_git_commits_what_it_was_told_to() {
    let history = saying(1);
    let cache = history.1.path().display();
    let fathom = env!("CARGO_BIN_EXE_fathom");
    let hook = format!(
        "#!/bin/sh\nXDG_CACHE_HOME='{cache}' '{fathom}' compare --base HEAD 2>told; exit 0\n"
    );
    let hook = history.0.write(".git/hooks/pre-commit", hook);
    Command::new("chmod").arg("+x").arg(hook).ends(0);
    for (number, words) in [(1, "commit --quiet -am x"), (2, "commit --quiet -m x main.rs")] {
        let text = history.0.read("main.rs") + "// More.\n";
        history.0.write("main.rs", &text);
        git(history.0.path("")).args(words.split(' ')).ends(0);
        holds(&history.0.read("told"), &["garbage to `hello`: `word 0"]);
        let committed = git(history.0.path("")).args(["show", "HEAD:main.rs"]).answer();
        assert_eq!(committed, text, "{number}");
    }
}

/// The head's list of cells lacks one of the base's and has another.
#[test]
fn the_first_line_names_commits_ways_to_build_and_cells_of_one_side() {
    let says = |commit: &str, profile: &str| {
        let build = format!(
            r#""build":{{"commit":"{commit}","dirty":true,"with":{{"profile":"{profile}"}}}},"notes""#
        );
        hello(1, r#""time""#).replace("\"notes\"", &build)
    };
    let history = Commits::built(&hello(1, r#""time""#));
    let third = "[[sweep]]\nid = \"three\"\n";
    history.0.write("cells.toml", CELLS.to_owned() + third);
    history.git(&["commit", "--quiet", "-am", "Three"]);
    history.0.write("cells.toml", CELLS.replace("id = \"two\"", "id = \"four\""));
    Script { hello: says(&"ab".repeat(20), "debug"), ..Script::default() }
        .write(&history.0.path(""), "head");
    let words = "compare --head-bin ./head --cells-file cells.toml --gates time --launches 10 --pairs 2 --out";
    let names = "removed: two a, two b, three a, three b; new: four a, four b";
    let output = history.fathom(format!("{words} out --base HEAD")).ends(0);
    let first = format!("HEAD (0) → ./head (0, abababababab with changed files); {names}");
    assert_eq!(output.out.lines().next(), Some(&*first));

    // What no gate measures here is on neither list.
    let encoded = |cells: &str| cells.replace("\"b\"]", "\"b\", \"encode:a\"]");
    let base = Script { hello: says(&"cd".repeat(20), "release"), ..Script::default() };
    base.write(&history.0.path(""), "base");
    history.0.write("base.toml", encoded(CELLS) + third);
    history.0.write("cells.toml", encoded(&history.0.read("cells.toml")));
    let words = words.replace("--gates time", "--gates instructions,time");
    let base = "other --base-bin ./base --base-cells-file base.toml";
    history.fathom(format!("{words} {base}")).ends(0);
    let names = format!(
        "cdcdcdcdcdcd with changed files → abababababab with changed files; built differently: profile release → debug; {names}"
    );
    let comment = history.0.read("other/comment.md");
    holds(comment.lines().next().unwrap(), &["fathom compare: no regression", &names]);
    let junit = history.0.read("other/junit.xml");
    holds(junit.lines().nth(1).unwrap(), &[&names]);
}
