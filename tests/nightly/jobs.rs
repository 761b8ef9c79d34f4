//! Jobs of continuous integration: `action.yml` and `ci/gitlab.yml`, their scripts run as they stand.
//! Stand-ins are cargo, which hands out the program that is built already, and dpkg, to which everything is installed.

use std::collections::BTreeMap;
use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::process::Command;

use serde_json::{Value, json};

use super::common::{Ends, Place, git, holds};

const WORKER: &str = "python3 worker.py --counted";
/// As many as find a slowdown in two cells.
const LAUNCHES: &str = "8";
/// Where the action leaves the text that it posts.
const COMMENT: &str = "fathom-comment.md";

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// A file of YAML, as PyYAML reads it.
fn yaml(path: &Path) -> Value {
    let script = "import json, sys, yaml; json.dump(yaml.safe_load(open(sys.argv[1])), sys.stdout)";
    let mut python = Command::new("/usr/bin/python3");
    let text = python.args(["-c", script]).arg(path).output().unwrap();
    assert!(text.status.success(), "`scripts/setup.sh test` installs PyYAML: {text:?}");
    // YAML 1.1 has `on` for true.
    serde_json::from_slice(&text.stdout).unwrap()
}

fn executable(place: &Place, name: &str, text: &str) {
    let path = place.write(name, text);
    fs::set_permissions(path, fs::Permissions::from_mode(0o755)).unwrap();
}

/// A project with a worker and its cells, and the program's own checkout, from which a job takes scripts.
struct Project(Place);

impl Project {
    fn new() -> Self {
        let place = Place::new();
        for name in ["worker.py", "cells.toml"] {
            let text = fs::read(root().join("examples/own_worker").join(name)).unwrap();
            place.write(format!("project/{name}"), text);
        }
        place.write("project/.gitignore", "compare\n");
        place.write("fathom/Cargo.toml", "");
        for script in ["setup.sh", "ci/compare.sh"] {
            let text = fs::read_to_string(root().join("scripts").join(script)).unwrap();
            executable(&place, &format!("fathom/scripts/{script}"), &text);
        }
        executable(&place, "bin/dpkg-query", "#!/bin/sh\necho 'install ok installed'\n");
        let programs = Path::new(env!("CARGO_BIN_EXE_fathom")).parent().unwrap().display();
        let cargo = format!(
            "#!/bin/sh\n[ -e Cargo.toml ] || exit 9\ncase \"$*\" in\n\
             'build --release --locked --target-dir target') name=fathom;;\n\
             'build --release --locked --bin worker') name=worker;;\n*) exit 9;;\nesac\n\
             mkdir -p target/release && ln -sf '{programs}'/$name target/release/\n"
        );
        executable(&place, "bin/cargo", &cargo);
        let project = Self(place);
        for folder in ["fathom", "project"] {
            project.git(folder, "init --quiet --initial-branch=main");
            project.commit(folder);
        }
        // The same once more: the base.
        project.commit("project");
        project
    }

    fn git(&self, folder: &str, words: &str) {
        git(self.path(folder)).args(words.split(' ')).ends(0);
    }

    fn commit(&self, folder: &str) {
        self.git(folder, "add --all");
        self.git(folder, "commit --quiet --allow-empty --message change");
    }

    /// A commit after which the worker makes so many times as many turns.
    fn slower(&self, times: f64) {
        let worker = self.0.read("project/worker.py");
        let slower =
            worker.replace("type=float, default=1.0", &format!("type=float, default={times}"));
        assert_ne!(slower, worker);
        self.0.write("project/worker.py", slower);
        self.commit("project");
    }

    /// A script of the shell in the project, without the variables of the job that runs these tests.
    fn script(&self, script: &str) -> Command {
        let mut command = Command::new("bash");
        command.args(["--noprofile", "--norc", "-eo", "pipefail", "-c", script]);
        let foreign = |name: &str| {
            ["GITHUB_", "CI_", "FATHOM_", "GITLAB_"].iter().any(|p| name.starts_with(p))
        };
        for (name, _) in std::env::vars().filter(|(name, _)| foreign(name) || name == "CI") {
            command.env_remove(name);
        }
        let path = format!("{}:{}", self.path("bin"), std::env::var("PATH").unwrap());
        command.env("PATH", path).env("CI", "true").env("XDG_CACHE_HOME", self.path("cache"));
        command.current_dir(self.path("project"));
        command
    }

    fn path(&self, name: &str) -> String {
        self.0.path(name).display().to_string()
    }

    /// Runs the steps of `action.yml` as a workflow that hands in these settings; the job's status, what was printed, and the output.
    fn action(&self, with: &Value) -> (i32, String, String) {
        self.action_in(with, &[])
    }

    /// The same with variables of the job.
    fn action_in(&self, with: &Value, job: &[(&str, &str)]) -> (i32, String, String) {
        let action = yaml(&root().join("action.yml"));
        let mut known = expression_values(&action, with);
        let (mut failed, mut printed) = (0, String::new());
        for step in action["runs"]["steps"].as_array().unwrap() {
            if step["name"] == "Comment" {
                assert_eq!(step["with"]["path"], format!("${{{{ runner.temp }}}}/{COMMENT}"));
                assert_eq!(step["continue-on-error"], true, "a comment is no gate");
            }
            let Some(script) = step["run"].as_str() else { continue };
            assert!(!script.contains("${{"), "text of others in a script: {script}");
            let is_run = match step["if"].as_str() {
                None => failed == 0,
                Some(
                    "always() && inputs.comment == 'true' && github.event_name == 'pull_request'",
                ) => known["inputs.comment"] == "true",
                Some(other) => panic!("{other}"),
            };
            if !is_run {
                continue;
            }
            let env = step["env"].as_object().cloned().unwrap_or_default();
            let value = |value: &Value| evaluated(value.as_str().unwrap(), &known);
            let output = self.0.write("output", "").display().to_string();
            let mut command = self.script(script);
            command.env("GITHUB_ACTION_PATH", self.path("fathom")).env("GITHUB_OUTPUT", output);
            command.env("GITHUB_STEP_SUMMARY", self.path("summary.md"));
            command.env("RUNNER_TEMP", self.path("")).envs(job.iter().copied());
            let ended = command.envs(env.iter().map(|(name, text)| (name, value(text)))).output();
            let ended = ended.unwrap();
            printed += &String::from_utf8_lossy(&[ended.stdout, ended.stderr].concat());
            failed = if failed == 0 { ended.status.code().unwrap() } else { failed };
            let output = self.0.read("output");
            for (name, text) in output.lines().filter_map(|line| line.split_once('=')) {
                let id = step["id"].as_str().unwrap();
                known.insert(format!("steps.{id}.outputs.{name}"), text.to_owned());
            }
        }
        (failed, printed, evaluated(action["outputs"]["status"]["value"].as_str().unwrap(), &known))
    }

    /// Runs a job of GitLab; its status and what was printed.
    fn job(&self, job: &Value, own: &[(&str, &str)]) -> (i32, String) {
        let run = |part: &str| {
            let lines = job[part].as_array().unwrap().iter().map(|line| line.as_str().unwrap());
            let mut command = self.script(&lines.collect::<Vec<_>>().join("\n"));
            command.env("GITLAB_CI", "true").env("CI_PROJECT_DIR", self.path("project"));
            command.envs(own.iter().copied()).output().unwrap()
        };
        let ended = run("script");
        // What the next job finds again.
        assert!(run("after_script").status.success());
        assert!(self.0.path("project/.fathom-cache/source/Cargo.toml").exists());
        let printed = [ended.stdout, ended.stderr].concat();
        (ended.status.code().unwrap(), String::from_utf8_lossy(&printed).into_owned())
    }
}

/// What expressions of an action may name: its inputs, with these settings in place of defaults, and what GitHub hands in.
fn expression_values(action: &Value, with: &Value) -> BTreeMap<String, String> {
    let mut inputs = BTreeMap::new();
    for (name, input) in action["inputs"].as_object().unwrap() {
        inputs.insert(format!("inputs.{name}"), input["default"].as_str().unwrap().to_owned());
    }
    for (name, value) in with.as_object().unwrap() {
        let input = inputs.insert(format!("inputs.{name}"), value.as_str().unwrap().to_owned());
        assert!(input.is_some(), "no input {name}");
    }
    let link = "https://example.invalid/a".to_owned();
    inputs.insert("steps.keep.outputs.artifact-url".to_owned(), link);
    for name in ["steps.compare.outputs.results", "github.event.before"] {
        inputs.insert(name.to_owned(), String::new());
    }
    inputs
}

/// `${{ NAME }}` is all that a value may be.
fn evaluated(text: &str, known: &BTreeMap<String, String>) -> String {
    let Some(name) = text.strip_prefix("${{ ").and_then(|rest| rest.strip_suffix(" }}")) else {
        assert!(!text.contains("${{"), "{text}");
        return text.to_owned();
    };
    known.get(name).unwrap_or_else(|| panic!("{name} is not known")).clone()
}

fn with() -> Value {
    json!({ "command": WORKER, "cells-file": "cells.toml", "launches": LAUNCHES })
}

#[test]
fn the_action_tells_a_slower_head() {
    let project = Project::new();
    let (status, printed, output) = project.action(&with());
    assert_eq!((status, output.as_str()), (0, "0"), "{printed}");
    holds(
        &project.0.read(COMMENT),
        &["fathom compare: no regression", "2 cells: 2 same", "(https://example.invalid/a)"],
    );
    holds(&project.0.read("summary.md"), &["fathom compare: no regression"]);

    // What lies there is of the earlier use.
    project.slower(1.05);
    let (status, printed, output) = project.action(&with());
    assert_eq!((status, output.as_str()), (1, "1"), "{printed}");
    let comment = project.0.read(COMMENT);
    holds(
        &comment,
        &["fathom compare: regression", "2 cells: 2 slower", "`short sum`: slower: time +5.0 %"],
    );
    assert!(comment.find("quiet: ") < comment.find("`short sum`"), "{comment}");
    // Nothing of the base's checkout is left.
    let worktrees = project.script("git worktree list").answer();
    assert_eq!(worktrees.lines().count(), 1, "{worktrees}");
}

#[test]
fn what_the_action_cannot_do_is_told_and_no_name_is_run() {
    let project = Project::new();
    // Names of others are never a part of a command.
    let evil = "x$(touch evil)`touch evil`\"; touch evil; '";
    for name in ["base", "cells", "gates", "threshold"] {
        let mut with = self::with();
        with[name] = json!(evil);
        let (status, ..) = project.action(&with);
        assert_eq!(status, 2, "{name}");
        assert!(!project.0.path("project/evil").exists(), "{name}");
    }
    let nothing = "### ⚠️ fathom compare: nothing was measured";
    assert!(project.0.read(COMMENT).starts_with(nothing));
    // Neither the results of an earlier use nor what a build writes is posted, and no status of a build is one of a comparison.
    project.action(&self::with());
    assert!(!project.0.read(COMMENT).starts_with(nothing));
    let mut with = self::with();
    with["build"] = json!("mkdir -p compare; echo not ours >compare/comment.md; exit 3");
    let (status, printed, _) = project.action(&with);
    assert_eq!(status, 2, "{printed}");
    assert!(project.0.read(COMMENT).starts_with(nothing));

    fs::remove_file(project.0.path(COMMENT)).unwrap();
    let mut with = self::with();
    with["base"] = json!("HEAD~7");
    with["comment"] = json!("false");
    let (status, printed, output) = project.action(&with);
    assert_eq!((status, output.as_str()), (2, "2"));
    holds(&printed, &["error: there is no revision HEAD~7, ", "fetch-depth: 0"]);
    assert!(!project.0.path(COMMENT).exists());

    // What the revision itself holds is not posted.
    project.0.write("project/compare/comment.md", "not ours");
    project.git("project", "add --force compare/comment.md");
    let (status, printed, _) = project.action(&self::with());
    assert_eq!(status, 2, "{printed}");
    assert!(project.0.read(COMMENT).starts_with(nothing));
}

/// The workflow of docs/ci.md in a repository of a wgpu program with a worker by `fathom-clock`. What its times say depends on the machine.
#[test]
fn the_job_of_another_wgpu_project_compares_its_workers_and_comments() {
    let docs = fs::read_to_string(root().join("docs/ci.md")).unwrap();
    let (_, section) = docs.split_once("### Another wgpu project").unwrap();
    let project = Project::new();
    let job =
        project.0.write("job.yml", section.split("```").nth(1).unwrap().trim_start_matches("yaml"));
    let steps = yaml(&job)["jobs"]["compare"]["steps"].take();
    let mut with = steps[2]["with"].clone();
    (with["launches"], with["gates"]) = (json!("1"), json!("time"));
    // No load makes one build of two look half as slow again in every launch.
    with["threshold"] = json!("0.5");
    fs::copy(root().join("examples/own_program/cells.toml"), project.0.path("project/cells.toml"))
        .unwrap();
    project.0.write("project/Cargo.toml", "[package]\nname = \"own_program\"\n");
    project.commit("project");
    project.commit("project");
    let (status, printed, output) = project.action(&with);
    assert!(status == 0 && ["0", "3"].contains(&&*output), "{status}: {printed}");
    holds(&project.0.read(COMMENT), &["fathom compare: ", "6 cells: "]);
    let page = project.0.read("project/compare/summary.md");
    holds(&page, &["ripple", "blur", "shade"]);
    let fathom = env!("CARGO_BIN_EXE_fathom");
    let refused =
        project.script(&format!("PATH=${{PATH#*:}} '{fathom}' compare --base HEAD")).ends(2).err;
    let error = refused.lines().last().unwrap();
    holds(error, &["has no program `fathom`, which is what `--base` builds", "docs/ci.md"]);
}

/// A pull request is compared with the commit where it and its target part, however the job has checked it out.
#[test]
fn a_pull_request_is_compared_with_where_it_parts_from_its_target() {
    let project = Project::new();
    let branch = |name: &str, from: &str, times: &[f64]| {
        project.git("project", &format!("checkout --quiet -b {name} {from}"));
        times.iter().for_each(|times| project.slower(*times));
        project.commit("project");
    };
    // The first commit of two is slower; the target has become faster meanwhile; a fork's target lags behind.
    branch("slower", "main", &[1.3]);
    branch("readme", "main", &[]);
    branch("faster", "main", &[0.8]);
    branch("late", "faster", &[]);
    project.git("project", "branch --force main faster");
    project.git("", "clone --quiet --mirror project upstream/repo.git");
    project.git("", "clone --quiet --mirror project fork.git");
    project.git("fork.git", "branch --force main readme~1");
    let server = format!("file://{}", project.path("upstream"));
    let job = [
        ("GITHUB_BASE_REF", "main"),
        ("GITHUB_SERVER_URL", &server),
        ("GITHUB_REPOSITORY", "repo.git"),
    ];
    for (checkout, expected) in [
        ("clone --quiet --branch slower upstream/repo.git project", "2 slower"),
        ("clone --quiet --branch readme upstream/repo.git project", "2 same"),
        ("clone --quiet --depth 1 --branch slower file://UPSTREAM/repo.git project", "2 slower"),
        ("clone --quiet --branch late fork.git project", "2 same"),
        (
            "clone --quiet --branch slower upstream/repo.git project; -C project merge --quiet origin/main -X ours -m merged",
            "2 slower",
        ),
    ] {
        fs::remove_dir_all(project.0.path("project")).unwrap();
        let checkout = checkout.replace("UPSTREAM", &project.path("upstream"));
        checkout.split("; ").for_each(|words| project.git("", words));
        let (_, printed, _) = project.action_in(&with(), &job);
        holds(&printed, &[&format!("2 cells: {expected}")]);
    }
}

#[test]
fn an_inconclusive_comparison_fails_where_that_is_asked() {
    let project = Project::new();
    executable(&project.0, "fathom/target/release/fathom", "#!/bin/sh\nexit 3\n");
    let script = format!("'{}'", project.path("fathom/scripts/ci/compare.sh"));
    holds(&project.script(&script).ends(0).err, &["note: inconclusive"]);
    holds(&project.script(&script).env("GITLAB_CI", "true").ends(3).err, &["note: inconclusive"]);
    project.script(&script).env("FATHOM_FAIL_ON_INCONCLUSIVE", "true").ends(1);
}

#[test]
fn the_job_of_gitlab_does_the_same() {
    let project = Project::new();
    project.slower(1.05);
    let job = yaml(&root().join("ci/gitlab.yml"))["fathom-compare"].clone();
    let fathom = project.path("fathom");
    let mut own = vec![
        ("FATHOM_REPOSITORY", fathom.as_str()),
        ("FATHOM_COMMAND", WORKER),
        ("FATHOM_CELLS_FILE", "cells.toml"),
        ("FATHOM_LAUNCHES", LAUNCHES),
    ];
    let (status, printed) = project.job(&job, &own);
    assert_eq!(status, 1, "{printed}");
    let junit = job["artifacts"]["reports"]["junit"].as_str().unwrap();
    holds(&project.0.read(format!("project/{junit}")), &["<failure"]);
    // The base of a merge request is the one that GitLab names.
    own.push(("CI_MERGE_REQUEST_EVENT_TYPE", "detached"));
    own.push(("CI_MERGE_REQUEST_DIFF_BASE_SHA", "HEAD"));
    let (status, printed) = project.job(&job, &own);
    assert_eq!(status, 0, "{printed}");
    assert!(!project.0.read(format!("project/{junit}")).contains("<failure"));
}

#[test]
fn scripts_of_jobs_are_sound() {
    let scripts = ["setup.sh", "slurm.sh", "weight.sh", "ci/compare.sh"]
        .map(|script| root().join("scripts").join(script));
    let checked = Command::new("shellcheck").args(&scripts).output().expect("shellcheck");
    assert!(checked.status.success(), "{}", String::from_utf8_lossy(&checked.stdout));
}
