//! Jobs of continuous integration: `action.yml` and `ci/gitlab.yml`, their scripts run as they stand.
//! Stand-ins are cargo, which hands out the program that is built already, dpkg, to which everything is installed, and the servers.

use std::collections::BTreeMap;
use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::process::{Command, Stdio};

use serde_json::{Value, json};

use super::common::{CommandOutput, Ends, Place, holds};
use super::jobs_server::{BOT, Mood, Server};

const ROOT: &str = env!("CARGO_MANIFEST_DIR");
/// Names and values of the environment.
type Variables = Vec<(&'static str, String)>;

const WORKER: &str = "python3 worker.py --counted";
/// As many as find a slowdown in two cells.
const LAUNCHES: &str = "8";
const MARK: &str = "<!-- fathom compare: compare -->";

fn root() -> &'static Path {
    Path::new(ROOT)
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

/// A project with a worker, and the program's own checkout, from which a job takes scripts.
struct Project {
    place: Place,
    server: Server,
}

impl Project {
    fn new() -> Self {
        let place = Place::new();
        let worker = fs::read(root().join("examples/own_worker/worker.py")).unwrap();
        place.write("project/worker.py", worker);
        place.write("project/.gitignore", "compare\n");
        place.write("fathom/Cargo.toml", "");
        for script in ["setup.sh", "ci/compare.sh", "ci/comment.sh"] {
            let text = fs::read_to_string(root().join("scripts").join(script)).unwrap();
            executable(&place, &format!("fathom/scripts/{script}"), &text);
        }
        executable(&place, "bin/dpkg-query", "#!/bin/sh\necho 'install ok installed'\n");
        let program = env!("CARGO_BIN_EXE_fathom");
        let cargo = format!(
            "#!/bin/sh\n[ \"$1 $2 $3\" = 'build --release --locked' ] && [ -e \"$5\" ] || exit 9\n\
             mkdir -p \"$7/release\" && ln -sf '{program}' \"$7/release/fathom\"\n"
        );
        executable(&place, "bin/cargo", &cargo);
        let project = Self { place, server: Server::start() };
        project.git("fathom", "init --quiet");
        project.commit("fathom");
        project.git("project", "init --quiet");
        project.commit("project");
        project
    }

    fn git(&self, folder: &str, words: &str) {
        let mut git = Command::new("git");
        git.args(["-c", "user.name=t", "-c", "user.email=t@t", "-c", "commit.gpgsign=false"]);
        let output = git.args(words.split(' ')).current_dir(self.place.path(folder)).ends(0);
        drop(output);
    }

    fn commit(&self, folder: &str) {
        self.git(folder, "add --all");
        self.git(folder, "commit --quiet --allow-empty --message change");
    }

    /// A commit after which the worker makes so many times as many turns.
    fn slower(&self, times: f64) {
        let worker = self.place.read("project/worker.py");
        let slower =
            worker.replace("type=float, default=1.0", &format!("type=float, default={times}"));
        assert_ne!(slower, worker);
        self.place.write("project/worker.py", slower);
        self.commit("project");
    }

    /// A script of the shell in the project, with the variables of a job and none of the job that runs these tests.
    fn script(&self, script: &str, variables: &[(&str, String)]) -> Command {
        let mut command = Command::new("bash");
        command.args(["--noprofile", "--norc", "-eo", "pipefail", "-c", script]);
        let foreign = |name: &str| {
            ["GITHUB_", "CI_", "FATHOM_", "GITLAB_"].iter().any(|p| name.starts_with(p))
        };
        for (name, _) in std::env::vars().filter(|(name, _)| foreign(name) || name == "CI") {
            command.env_remove(name);
        }
        let path =
            format!("{}:{}", self.place.path("bin").display(), std::env::var("PATH").unwrap());
        command.env("PATH", path).env("CI", "true").current_dir(self.place.path("project"));
        command.envs(variables.iter().map(|(name, value)| (*name, value)));
        command
    }

    fn path(&self, name: &str) -> String {
        self.place.path(name).display().to_string()
    }

    /// What GitHub tells each step of a job.
    fn github(&self) -> Variables {
        let event = json!({ "pull_request": { "number": 7 } });
        let event = self.place.write("event.json", event.to_string()).display().to_string();
        vec![
            ("GITHUB_API_URL", format!("{}/github", self.server.url)),
            ("GITHUB_REPOSITORY", "o/r".to_owned()),
            ("GITHUB_EVENT_PATH", event),
            ("GITHUB_SERVER_URL", "https://example.invalid".to_owned()),
            ("GITHUB_RUN_ID", "5".to_owned()),
            ("GITHUB_ACTION_PATH", self.path("fathom")),
            ("GITHUB_STEP_SUMMARY", self.path("summary.md")),
        ]
    }

    fn gitlab(&self) -> Variables {
        vec![
            ("GITLAB_CI", "true".to_owned()),
            ("CI_API_V4_URL", format!("{}/gitlab", self.server.url)),
            ("CI_PROJECT_ID", "1".to_owned()),
            ("CI_PROJECT_DIR", self.path("project")),
            ("CI_MERGE_REQUEST_IID", "7".to_owned()),
            ("CI_JOB_URL", "https://example.invalid/job".to_owned()),
            ("FATHOM_TOKEN", "secret".to_owned()),
        ]
    }

    /// Runs the steps of `action.yml` as a workflow that hands in these settings; the job's status, what was printed, and the output.
    fn action(&self, with: &Value) -> (i32, String, String) {
        let action = yaml(&root().join("action.yml"));
        let mut known = expression_values(&action, with);
        let (mut failed, mut printed) = (0, String::new());
        for step in action["runs"]["steps"].as_array().unwrap() {
            let Some(script) = step["run"].as_str() else { continue };
            assert!(!script.contains("${{"), "text of others in a script: {script}");
            let is_run = match step["if"].as_str() {
                None => failed == 0,
                Some("always() && inputs.comment == 'true'") => known["inputs.comment"] == "true",
                Some(other) => panic!("{other}"),
            };
            if !is_run {
                continue;
            }
            let env = step["env"].as_object().cloned().unwrap_or_default();
            let value = |value: &Value| evaluated(value.as_str().unwrap(), &known);
            let output = self.place.write("output", "").display().to_string();
            let mut variables: Vec<(&str, String)> = self.github();
            variables.push(("GITHUB_OUTPUT", output));
            variables.extend(env.iter().map(|(name, text)| (name.as_str(), value(text))));
            let ended = self.script(script, &variables).output().unwrap();
            printed += &String::from_utf8_lossy(&[ended.stdout, ended.stderr].concat());
            failed = if failed == 0 { ended.status.code().unwrap() } else { failed };
            let output = self.place.read("output");
            if let (Some(id), Some((name, text))) =
                (step["id"].as_str(), output.trim().split_once('='))
            {
                known.insert(format!("steps.{id}.outputs.{name}"), text.to_owned());
            }
        }
        (failed, printed, evaluated(action["outputs"]["status"]["value"].as_str().unwrap(), &known))
    }

    /// Runs a job of GitLab; its status and what was printed.
    fn job(&self, job: &Value, own: &[(&str, &str)]) -> (i32, String) {
        let mut variables = self.gitlab();
        let of_job = job["variables"].as_object().unwrap();
        let plain = |value: &Value| {
            value.as_str().map_or_else(|| value.to_string(), |text| text.replace("$$", "$"))
        };
        variables.extend(of_job.iter().map(|(name, value)| (name.as_str(), plain(value))));
        variables.extend(own.iter().map(|(name, value)| (*name, (*value).to_owned())));
        let [before, after] = ["script", "after_script"].map(|part| {
            let lines = job[part].as_array().unwrap().iter().map(|line| line.as_str().unwrap());
            self.script(&lines.collect::<Vec<_>>().join("\n"), &variables).output().unwrap()
        });
        assert_eq!(after.status.code(), Some(0), "{}", String::from_utf8_lossy(&after.stderr));
        let printed = [before.stdout, before.stderr, after.stdout, after.stderr].concat();
        (before.status.code().unwrap(), String::from_utf8_lossy(&printed).into_owned())
    }

    /// The only comment of the bot, of at most 15 lines.
    #[track_caller]
    fn comment(&self) -> String {
        let [comment] = self.server.comments_by(BOT).try_into().unwrap();
        assert!(comment.lines().count() <= 15 && comment.starts_with(MARK), "{comment}");
        comment
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
    let link = "https://example.invalid/a";
    let handed = [("github.token", "secret"), ("steps.keep.outputs.artifact-url", link)];
    inputs.extend(handed.map(|(name, value)| (name.to_owned(), value.to_owned())));
    inputs
}

/// `${{ NAME }}` is all that a value may be.
fn evaluated(text: &str, known: &BTreeMap<String, String>) -> String {
    let Some(name) = text.strip_prefix("${{ ").and_then(|rest| rest.strip_suffix(" }}")) else {
        assert!(!text.contains("${{"), "{text}");
        return text.to_owned();
    };
    let text = known.get(name).unwrap_or_else(|| panic!("{name} is not known")).clone();
    evaluated(&text, known)
}

fn with() -> Value {
    json!({ "command": WORKER, "cells-file": "cells.toml", "launches": LAUNCHES })
}

/// A project whose cells are those of the example.
fn compared() -> Project {
    let project = Project::new();
    let cells = fs::read(root().join("examples/own_worker/cells.toml")).unwrap();
    project.place.write("project/cells.toml", cells);
    project.commit("project");
    project
}

#[test]
fn the_action_tells_a_slower_head_in_one_comment() {
    let project = compared();
    project.server.say("somebody", &format!("{MARK}\nmine"));
    let (status, printed, output) = project.action(&with());
    assert_eq!((status, output.as_str()), (0, "0"), "{printed}");
    holds(
        &project.comment(),
        &["fathom compare: no regression", "2 cells: 2 same", "(https://example.invalid/a)"],
    );
    holds(&project.place.read("summary.md"), &["fathom compare: no regression"]);

    project.slower(1.05);
    fs::remove_dir_all(project.place.path("project/compare")).unwrap();
    let (status, printed, output) = project.action(&with());
    assert_eq!((status, output.as_str()), (1, "1"), "{printed}");
    let comment = project.comment();
    holds(
        &comment,
        &["fathom compare: regression", "2 cells: 2 slower", "`short sum`: slower: time +5.0 %"],
    );
    assert!(comment.find("quiet: ") < comment.find("`short sum`"), "{comment}");
    assert_eq!(project.server.comments_by("somebody"), [format!("{MARK}\nmine")]);
    // Nothing of the base's checkout is left.
    let worktrees = project.script("git worktree list", &[]).answer();
    assert_eq!(worktrees.lines().count(), 1, "{worktrees}");
}

#[test]
fn what_the_action_is_told_not_to_do_it_does_not() {
    let project = compared();
    project.slower(1.05);
    let mut with = with();
    with["comment"] = json!("false");
    with["threshold"] = json!("0.2");
    with["cells"] = json!("short");
    let (status, printed, output) = project.action(&with);
    assert_eq!((status, output.as_str()), (0, "0"), "{printed}");
    assert!(project.server.now().headers.is_empty());

    // Names of others are never a part of a command.
    let project = compared();
    let evil = "x$(touch evil)`touch evil`\"; touch evil; '";
    for name in ["base", "cells", "gates", "threshold", "name"] {
        let mut with = self::with();
        with[name] = json!(evil);
        let (status, ..) = project.action(&with);
        assert_eq!(status, if name == "name" { 0 } else { 2 }, "{name}");
        assert!(!project.place.path("project/evil").exists(), "{name}");
        let _ = fs::remove_dir_all(project.place.path("project/compare"));
    }
    holds(&project.server.comments_by(BOT)[0], &["nothing was measured"]);

    let mut with = self::with();
    with["base"] = json!("HEAD~7");
    let (status, printed, output) = compared().action(&with);
    assert_eq!((status, output.as_str()), (2, "2"));
    holds(&printed, &["error: there is no revision HEAD~7", "fetch-depth: 0"]);
}

#[test]
fn an_inconclusive_comparison_fails_where_that_is_asked() {
    let project = compared();
    executable(&project.place, "fathom/target/release/fathom", "#!/bin/sh\nexit 3\n");
    let run = |variables: &[(&str, &str)], status| {
        let variables: Vec<_> =
            variables.iter().map(|(name, value)| (*name, (*value).to_owned())).collect();
        let script = project.path("fathom/scripts/ci/compare.sh");
        project.script(&format!("'{script}'"), &variables).ends(status).err
    };
    holds(&run(&[], 0), &["note: inconclusive"]);
    holds(&run(&[("GITLAB_CI", "true")], 3), &["note: inconclusive"]);
    run(&[("FATHOM_FAIL_ON_INCONCLUSIVE", "true")], 1);
}

#[test]
fn the_job_of_gitlab_does_the_same() {
    let project = compared();
    project.slower(1.05);
    let job = yaml(&root().join("ci/gitlab.yml"))["fathom-compare"].clone();
    let fathom = project.path("fathom");
    let own = [
        ("FATHOM_REPOSITORY", fathom.as_str()),
        ("FATHOM_COMMAND", WORKER),
        ("FATHOM_CELLS_FILE", "cells.toml"),
        ("FATHOM_LAUNCHES", LAUNCHES),
    ];
    let (status, printed) = project.job(&job, &own);
    assert_eq!(status, 1, "{printed}");
    let link = "(https://example.invalid/job/artifacts/browse/compare)";
    holds(&project.comment(), &["2 cells: 2 slower", link]);
    assert!(
        project.server.now().headers.iter().all(|head| head.contains("PRIVATE-TOKEN: secret\r\n"))
    );
    let junit = job["artifacts"]["reports"]["junit"].as_str().unwrap();
    holds(&project.place.read(format!("project/{junit}")), &["<failure"]);
    // The base of a merge request is the one that GitLab names.
    let own = [
        &own[..],
        &[("CI_MERGE_REQUEST_EVENT_TYPE", "detached"), ("CI_MERGE_REQUEST_DIFF_BASE_SHA", "HEAD")],
    ]
    .concat();
    fs::remove_dir_all(project.place.path("project/compare")).unwrap();
    let (status, printed) = project.job(&job, &own);
    assert_eq!(status, 0, "{printed}");
    holds(&project.comment(), &["2 cells: 2 same", link]);
}

/// The comment's script after a comparison that said `words`, with the variables of a job but for some.
fn commented(project: &Project, variables: &[(&str, String)], words: &str) -> CommandOutput {
    project.place.write("project/compare/comment.md", format!("### {words}\n"));
    let script = root().join("scripts/ci/comment.sh");
    let mut command = project.script(&format!("'{}'", script.display()), variables);
    command.stdin(Stdio::null()).ends(0)
}

#[test]
fn a_comment_is_found_among_many_and_updated() {
    for of_gitlab in [false, true] {
        let project = Project::new();
        let mut variables = if of_gitlab { project.gitlab() } else { project.github() };
        variables.push(("FATHOM_TOKEN", "secret".to_owned()));
        for number in 0..150 {
            project.server.say(if number % 2 == 0 { "a" } else { BOT }, "other words");
        }
        project.server.say("a", MARK);
        for words in ["first", "second"] {
            commented(&project, &variables, words);
            let served = project.server.now();
            assert_eq!(served.comments.len(), 152, "{words}");
            let last = served.comments[151]["body"].as_str().unwrap();
            holds(last, &[MARK, words, "[Every cell and the records](https://example.invalid/"]);
            assert_eq!(served.comments[150]["body"], MARK);
        }
        // What the revision itself holds is not sent.
        project.git("project", "add --force compare/comment.md");
        commented(&project, &variables, "not ours");
        project.git("project", "rm --quiet --force --cached compare/comment.md");
        let last = project.server.now().comments[151]["body"].to_string();
        assert!(last.contains("nothing was measured") && !last.contains("not ours"), "{last}");
        // Another name, another comment.
        variables.push(("FATHOM_NAME", "of the GPU".to_owned()));
        commented(&project, &variables, "third");
        assert_eq!(project.server.now().comments.len(), 153);
        holds(&project.server.comments_by(BOT)[76], &["<!-- fathom compare: of_the_GPU -->"]);
        if of_gitlab {
            // The job's token is sent as such, and is of who began the job.
            variables.retain(|(name, _)| *name != "FATHOM_TOKEN");
            variables.push(("CI_JOB_TOKEN", "of the job".to_owned()));
            commented(&project, &variables, "fourth");
            let served = project.server.now();
            assert!(served.headers.last().unwrap().contains("JOB-TOKEN: of the job\r\n"));
            assert_eq!(served.comments.len(), 153);
        }
    }
}

#[test]
fn what_keeps_a_comment_from_being_written_is_a_note() {
    for of_gitlab in [false, true] {
        let project = Project::new();
        let all = || {
            let mut all = if of_gitlab { project.gitlab() } else { project.github() };
            all.push(("FATHOM_TOKEN", "secret".to_owned()));
            all
        };
        let without = |name: &str| all().into_iter().filter(|(known, _)| *known != name).collect();
        let changed = |name: &'static str, value: &str| -> Vec<(&str, String)> {
            all()
                .into_iter()
                .map(|(known, old)| (known, if known == name { value.to_owned() } else { old }))
                .collect()
        };
        let [request, api] = match of_gitlab {
            true => ["CI_MERGE_REQUEST_IID", "CI_API_V4_URL"],
            false => ["GITHUB_EVENT_PATH", "GITHUB_API_URL"],
        };
        // A port that was free a moment ago.
        let free = std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
        let cases: [(&str, Mood, Variables); 7] = [
            ("the server's answer is no object of JSON", Mood::Garbles, all()),
            (
                "403: the token may not write here, as in a request from a fork",
                Mood::Forbids,
                all(),
            ),
            ("the server answered 503", Mood::Down, all()),
            ("the server cannot be reached", Mood::Well, changed(api, &format!("http://{free}"))),
            ("there is no token", Mood::Well, without("FATHOM_TOKEN")),
            ("this job is not of a", Mood::Well, without(request)),
            ("neither a job of GitHub Actions nor of GitLab", Mood::Well, without(api)),
        ];
        for (reason, mood, variables) in cases {
            project.server.now().mood = mood;
            let CommandOutput { err, out } = commented(&project, &variables, "words");
            assert_eq!((err.lines().count(), out.as_str()), (1, ""), "{err}{out}");
            holds(&err, &["note: no comment was written: ", reason]);
        }
        assert!(project.server.now().comments.is_empty());
    }
}

#[test]
fn scripts_of_jobs_are_sound() {
    let scripts = ["setup.sh", "slurm.sh", "weight.sh", "ci/compare.sh", "ci/comment.sh"]
        .map(|script| root().join("scripts").join(script));
    let checked = Command::new("shellcheck").args(&scripts).output().expect("shellcheck");
    assert!(checked.status.success(), "{}", String::from_utf8_lossy(&checked.stdout));
}
