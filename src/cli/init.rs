//! `fathom init`: what a project needs to compare its pull requests: cells of its worker, and a job that compares them.

use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, bail, ensure};
use clap::{Args, ValueEnum};

use super::commands::{INTERRUPT, Outcome, watch_interrupts};
use crate::compare::launch::{Waiting, WorkerProcess, WorkerStart};
use crate::compare::protocol::{GateConfiguration, Reply, WorkerRequest};
use crate::experiments::Experiment;
use crate::folder::{self, Folder};
use crate::{tell, text};

const CELLS: &str = "performance/cells.toml";
const GITHUB: &str = ".github/workflows/performance.yml";
const GITLAB: &str = "performance/gitlab-ci.yml";
/// The job of GitLab, and the lines after which its other variables belong.
const TEMPLATE: &str = include_str!("../../ci/gitlab.yml");
const VARIABLES: &str = "  variables:\n    GIT_DEPTH: 0\n";
/// The cell's name, and what the worker is asked to prepare.
const CELL: &str = "default";

#[derive(Clone, Copy, ValueEnum)]
enum Ci {
    Github,
    Gitlab,
}

#[derive(Args)]
pub struct InitArgs {
    /// Folder of the project, the top level of its repository
    #[arg(default_value = ".")]
    folder: PathBuf,
    /// Simple command that starts a worker in a checkout of the project (docs/worker-protocol.md). It is asked for its stages
    #[arg(long)]
    command: String,
    /// Commands that build a checkout before that
    #[arg(long, value_name = "COMMANDS")]
    build: Option<String>,
    /// Where the job takes fathom from: OWNER/REPOSITORY@REVISION of GitHub, or URL@REVISION for a job of GitLab
    #[arg(long, value_name = "PLACE@REVISION")]
    fathom: String,
    /// Whose job to write
    #[arg(long, value_enum, default_value = "github")]
    ci: Ci,
    /// Pipeline that the worker is asked for; one with a single pipeline may ignore it
    #[arg(long, default_value = CELL)]
    pipeline: String,
    /// Scene that the worker is asked for
    #[arg(long, default_value = CELL)]
    scene: String,
}

pub fn init(args: &InitArgs) -> Outcome {
    let (job, job_text) = args.job()?;
    for name in [CELLS, job] {
        let path = args.folder.join(name);
        ensure!(!folder::is_there(&path), already(&path));
    }
    watch_interrupts()?;
    let cells = args.cells(&args.stages()?)?;
    for (name, text) in [(CELLS, cells), (job, job_text)] {
        write(&args.folder, name, &text)?;
        tell::answer(args.folder.join(name).display());
    }
    if matches!(args.ci, Ci::Gitlab) {
        tell::note(format!("add to .gitlab-ci.yml: include: {{ local: {GITLAB} }}"));
    }
    Ok(ExitCode::SUCCESS)
}

fn already(path: &Path) -> String {
    format!("{} is there already, and nothing was written", path.display())
}

fn write(folder: &Path, name: &str, text: &str) -> anyhow::Result<()> {
    let path = folder.join(name);
    let written = || {
        let parent = Path::new(name).parent().unwrap_or(Path::new(""));
        Folder::open(folder)?.make_beneath(parent)?;
        Folder::open(folder)?.create_new(name)?.write_all(text.as_bytes())
    };
    written().map_err(|error: std::io::Error| match error.kind() {
        ErrorKind::AlreadyExists => anyhow::Error::msg(already(&path)),
        _ => anyhow::Error::new(error).context(format!("cannot write {}", path.display())),
    })
}

/// A string of TOML and of YAML: both take those of JSON.
fn quoted(text: &str) -> anyhow::Result<String> {
    ensure!(!text.chars().any(char::is_control), "`{}` has a line break", text::line(text));
    Ok(serde_json::to_string(text)?)
}

impl InitArgs {
    /// What the worker has, in its order.
    fn stages(&self) -> anyhow::Result<Vec<String>> {
        let folder = self.folder.to_str().context("the folder's name is no text")?;
        let command = format!("cd {} && exec {}", text::shell(folder), self.command);
        let flags = [&INTERRUPT];
        let waiting = Waiting { interrupted: &flags, ..Waiting::PLAINLY };
        let (mut worker, _) = WorkerProcess::open(&WorkerStart::of_command(&command), &waiting)?;
        let (pipeline, scene) = (self.pipeline.clone(), self.scene.clone());
        let id = CELL.to_owned();
        let configuration = GateConfiguration { id, pipeline, scene, ..Default::default() };
        let reply = worker.ask(&WorkerRequest::Prepare { configuration }, &waiting)?;
        let Reply::Prepared { stages } = reply else {
            return Err(worker.unexpected(&reply).into());
        };
        worker.quit();
        ensure!(!stages.is_empty(), "the worker has no stage to compare");
        Ok(stages.into_iter().map(|stage| stage.name).collect())
    }

    fn cells(&self, stages: &[String]) -> anyhow::Result<String> {
        let stages: Vec<String> =
            stages.iter().map(|stage| quoted(stage)).collect::<Result<_, _>>()?;
        let [pipeline, scene] = [quoted(&self.pipeline)?, quoted(&self.scene)?];
        let stages = stages.join(", ");
        let cells = format!(
            "# What `fathom compare` measures: each stage of each [sweep]. Parameters go to the worker as they are:\n\
             # `params.size = 512`. Add sweeps for other sizes, and take out stages that are too short to time.\n\
             id = \"performance\"\ntitle = \"Stages that are compared\"\nsource = \"none\"\n\
             pipeline = {pipeline}\nscene = {scene}\nstages = [{stages}]\n\n[[sweep]]\nid = \"{CELL}\"\n"
        );
        Experiment::parse("performance", &cells).context("the worker's stages make no cells")?;
        Ok(cells)
    }

    /// The file of the job, and its text.
    fn job(&self) -> anyhow::Result<(&'static str, String)> {
        let place = self.fathom.rsplit_once('@').filter(|(place, revision)| {
            let is_word = |word: &str| !word.is_empty() && !word.contains(char::is_whitespace);
            is_word(place) && is_word(revision)
        });
        let Some((place, revision)) = place else {
            bail!("--fathom is a place and a revision: OWNER/REPOSITORY@REVISION, or URL@REVISION");
        };
        Ok(match self.ci {
            Ci::Github => (GITHUB, self.github(place, revision)?),
            Ci::Gitlab => (GITLAB, self.gitlab(place, revision)?),
        })
    }

    fn github(&self, place: &str, revision: &str) -> anyhow::Result<String> {
        // An expression would be evaluated by GitHub.
        let commands = [Some(&self.command), self.build.as_ref()];
        let is_expression = |command: &&String| command.contains("${{");
        ensure!(
            !commands.into_iter().flatten().any(|c| is_expression(&c)),
            "a command holds `${{{{`"
        );
        let settings = self.settings("          ", |name| name.to_owned(), str::to_owned)?;
        let uses = quoted(&format!("{place}@{revision}"))?;
        Ok(format!(
            "# Compares each pull request with its base, and writes one comment.\n\
             name: performance\non: pull_request\n\
             permissions:\n  contents: read\n  pull-requests: write\n\
             concurrency:\n  group: performance-${{{{ github.ref }}}}\n  cancel-in-progress: true\n\
             jobs:\n  compare:\n    runs-on: ubuntu-24.04\n    timeout-minutes: 60\n    steps:\n\
             \x20     - uses: actions/checkout@v4\n        with:\n          fetch-depth: 0\n          persist-credentials: false\n\
             \x20     - uses: {uses}\n        with:\n{settings}"
        ))
    }

    fn gitlab(&self, place: &str, revision: &str) -> anyhow::Result<String> {
        let variable = |name: &str| format!("FATHOM_{}", name.to_uppercase().replace('-', "_"));
        // GitLab expands variables in variables.
        let value = |text: &str| text.replace('$', "$$");
        let settings = self.settings("    ", variable, value)?;
        let [place, revision] = [quoted(&value(place))?, quoted(&value(revision))?];
        let settings = format!(
            "{VARIABLES}    FATHOM_REPOSITORY: {place}\n    FATHOM_REVISION: {revision}\n{settings}"
        );
        Ok(TEMPLATE.replacen(VARIABLES, &settings, 1))
    }

    /// What both jobs set, a line each.
    fn settings(
        &self,
        indent: &str,
        name: impl Fn(&str) -> String,
        value: impl Fn(&str) -> String,
    ) -> anyhow::Result<String> {
        let settings = [
            ("command", Some(self.command.as_str())),
            ("build", self.build.as_deref()),
            ("cells-file", Some(CELLS)),
        ];
        let given = settings.into_iter().filter_map(|(of, text)| Some((of, text?)));
        let line = |(of, text)| Ok(format!("{indent}{}: {}\n", name(of), quoted(&value(text))?));
        given.map(line).collect()
    }
}
