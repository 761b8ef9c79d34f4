//! `fathom fleet`: the shards of a run as tasks of a batch system.
//!
//! The batch system places and starts the tasks. Each runs `fathom run --shard I/N` into a folder that all machines share. What is
//! known of a shard lies in that folder alone: its records, and the exit status that its task wrote last. So a fleet that is
//! killed is gone on with, and a task that dies anywhere loses no cell that was measured.

pub mod script;
pub mod shards;
pub mod slurm;

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use anyhow::{Context, anyhow, bail};
use serde::{Deserialize, Serialize};

use self::shards::{Folder, Progress, Shard};
use self::slurm::Slurm;
use fathom_base::folder;
use fathom_base::text;
use fathom_record::{FolderLock, MOST_SHARDS};

/// Time between two looks at the queue.
const LOOK_INTERVAL: Duration = Duration::from_secs(2);
/// A task that has left the queue and whose folder says nothing is taken for dead after this: a shared folder shows files of
/// other machines late.
const GRACE: Duration = Duration::from_secs(6);
/// The same for a task that the queue has not shown yet: some sites answer `squeue` from a copy that is a minute old.
const UNSEEN_GRACE: Duration = Duration::from_secs(120);
/// Slurm may be out of reach for so long.
const LONGEST_SILENCE: Duration = Duration::from_secs(600);
/// Interrupted tasks are given so long to write what they have.
const LONGEST_END: Duration = Duration::from_secs(60);
/// Name of the file that says what a fleet's folder is.
const FLEET: &str = "fleet.json";
/// Version of that file.
const FORMAT: u32 = 2;

/// Batch systems.
#[derive(Clone, Copy, clap::ValueEnum)]
pub enum Engine {
    /// Slurm, by its own commands
    Slurm,
}

/// What a fleet is asked to do.
#[derive(clap::Args)]
pub struct Options {
    /// Batch system
    pub engine: Engine,
    /// Parts that the run is divided into, each a task [default: as many as there are nodes]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=i64::from(MOST_SHARDS)))]
    pub shards: Option<u32>,
    #[command(flatten)]
    pub slurm: slurm::Options,
    /// How often to resubmit a shard that failed or was killed
    #[arg(long, default_value_t = 2)]
    pub retries: u32,
    /// Folder of the shards and of the merged run, in `merged`; all nodes must see it
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Continue the fleet of the folder
    #[arg(long)]
    pub resume: bool,
    /// `run` and its arguments
    #[arg(last = true, required = true, value_name = "COMMAND")]
    pub command: Vec<String>,
}

/// What the folder of a fleet says of it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Stored {
    format: u32,
    shards: u32,
    run: Vec<String>,
}

/// What came of the shards.
pub struct Followed {
    /// Folders of those that measured something, or could have.
    pub folders: Vec<PathBuf>,
    /// Shards that did not end, each with what there is to say of it.
    pub failed: Vec<String>,
    pub interrupted: bool,
}

/// Submits the shards, tasks that start `program`, and follows them to their end. The folder is an absolute path.
pub fn run(
    options: &Options,
    program: &Path,
    interrupted: &AtomicBool,
) -> anyhow::Result<Followed> {
    let Engine::Slurm = options.engine;
    let shards = options.shards.map_or_else(|| Slurm::node_count(&options.slurm), Ok)?;
    if shards > MOST_SHARDS {
        bail!("{shards} shards are more than {MOST_SHARDS}");
    }
    let mut fleet = Fleet::open(options, shards, program, interrupted)?;
    let looked = fleet.look();
    if !fleet.is_interrupted() {
        looked?;
    }
    fleet.follow()?;
    Ok(fleet.end())
}

struct Fleet<'a> {
    options: &'a Options,
    slurm: Slurm<'a>,
    stored: Stored,
    /// The fleet's folder and the program, of whose paths every character reaches a task.
    out: &'a str,
    program: &'a str,
    shards: Vec<Shard>,
    progress: Progress,
    interrupted: &'a AtomicBool,
    _lock: FolderLock,
}

impl<'a> Fleet<'a> {
    fn open(
        options: &'a Options,
        shards: u32,
        program: &'a Path,
        interrupted: &'a AtomicBool,
    ) -> anyhow::Result<Self> {
        let [out, program] = [&options.out, program].map(usable);
        let (out, program) = (out?, program?);
        let _lock = FolderLock::take(&options.out, &fathom_record::output::holder())?;
        // The same folder has the same jobs under each of its names.
        let folder = options.out.canonicalize().unwrap_or_else(|_| options.out.clone());
        let mut slurm = Slurm::find(&options.slurm, &folder)?;
        slurm.interrupted = Some(interrupted);
        let run = options.command[1..].to_vec();
        let stored = Stored { format: FORMAT, shards, run };
        if options.resume {
            check_resumed(&options.out, &stored)?;
        } else if folder::is_there(&options.out.join(FLEET)) {
            bail!(
                "{} holds a fleet already: continue it with --resume, or choose another folder with --out",
                options.out.display()
            );
        }
        Folder::prepare(&options.out, shards).map_err(unwritable(&options.out))?;
        let shard = |number| Shard::new(Folder::of(&options.out, number), number);
        let shards = (1..=shards).map(shard).collect();
        let progress = Progress::default();
        Ok(Self { options, slurm, stored, out, program, shards, progress, interrupted, _lock })
    }

    fn is_interrupted(&self) -> bool {
        self.interrupted.load(Ordering::Relaxed)
    }

    /// Takes over what queue and folders say, and submits the shards that are neither done nor in the queue.
    fn look(&mut self) -> anyhow::Result<()> {
        let queue = self.slurm.queue()?;
        for shard in &mut self.shards {
            if let Some(event) = shard.look(&queue) {
                self.progress.say(&event);
            }
        }
        let due = self.shards.iter().filter(|shard| shard.is_due(self.options.retries));
        let due: Vec<u32> = due.map(|shard| shard.number).collect();
        if due.is_empty() { Ok(()) } else { self.submit(&due) }
    }

    fn submit(&mut self, due: &[u32]) -> anyhow::Result<()> {
        let Stored { shards, run, .. } = &self.stored;
        let script = script::text(self.program, run, *shards, self.out);
        let script = write(&self.options.out, script::NAME, script.as_bytes())?;
        let job = self.slurm.submit(&script, due, &Folder::logs(self.out))?;
        let stored = serde_json::to_vec_pretty(&self.stored).unwrap_or_default();
        write(&self.options.out, FLEET, &stored)?;
        for shard in &mut self.shards {
            if due.contains(&shard.number) {
                shard.submitted(job);
            }
        }
        let told = format!("{} of {shards} shards submitted as job {job}", due.len());
        self.progress.say(&told);
        Ok(())
    }

    /// Looks until every shard is done or given up, or the fleet is interrupted. Slurm may fail for a while.
    fn follow(&mut self) -> anyhow::Result<()> {
        let mut heard = Instant::now();
        while !self.is_interrupted() {
            match self.look() {
                Ok(()) => heard = Instant::now(),
                Err(_) if self.is_interrupted() => break,
                Err(error) if heard.elapsed() > LONGEST_SILENCE => return Err(error),
                Err(error) => self.progress.say(&format!("{error}; trying again")),
            }
            self.progress.show(&mut self.shards);
            if self.shards.iter().all(|shard| shard.is_over(self.options.retries)) {
                return Ok(());
            }
            let start = Instant::now();
            while start.elapsed() < LOOK_INTERVAL && !self.is_interrupted() {
                std::thread::sleep(Duration::from_millis(100));
            }
        }
        self.cancel()
    }

    /// Removes what waits, and ends what runs with what it has measured.
    fn cancel(&mut self) -> anyhow::Result<()> {
        self.progress.say("cancelling the jobs; what is measured is kept");
        self.slurm.interrupted = None;
        // Jobs that another process submitted are known from the queue.
        let _ = self.slurm.queue();
        self.slurm.interrupt()?;
        let start = Instant::now();
        while start.elapsed() < LONGEST_END {
            match self.slurm.queue() {
                Ok(queue) if queue.is_empty() => return Ok(()),
                _ => std::thread::sleep(Duration::from_millis(500)),
            }
        }
        Ok(self.slurm.cancel(&[])?)
    }

    fn end(mut self) -> Followed {
        self.progress.bar.finish_and_clear();
        for shard in &mut self.shards {
            shard.read_ending();
        }
        let failed = self.shards.iter().filter_map(Shard::failure).collect();
        let with_records = self.shards.iter().filter(|shard| shard.folder.header().is_some());
        Followed {
            folders: with_records.map(|shard| shard.folder.path()).collect(),
            failed,
            interrupted: self.is_interrupted(),
        }
    }
}

/// A path that means the same to this process, to a shell and to Slurm.
fn usable(path: &Path) -> anyhow::Result<&str> {
    let plain = |c: char| c != '\\' && !c.is_control();
    let text = path.to_str().filter(|text| text.chars().all(plain));
    text.with_context(|| {
        format!(
            "{} cannot be a fleet's folder or program: Slurm and its scripts take no path that is not UTF-8 or holds a backslash or a control character",
            text::line(&path.to_string_lossy())
        )
    })
}

fn unwritable(path: &Path) -> impl Fn(std::io::Error) -> anyhow::Error {
    move |source| anyhow!("cannot write {}: {source}", path.display())
}

/// Writes a file of a fleet's folder, all or nothing.
fn write(out: &Path, name: &str, bytes: &[u8]) -> anyhow::Result<PathBuf> {
    let path = out.join(name);
    folder::write(&path, bytes).map_err(unwritable(&path))?;
    Ok(path)
}

/// The folder holds the fleet that is asked for.
fn check_resumed(out: &Path, asked: &Stored) -> anyhow::Result<()> {
    let nothing =
        |reason: String| anyhow!("{} holds no fleet to continue: {FLEET}: {reason}", out.display());
    let json = folder::Folder::open(out)
        .and_then(|folder| folder.plain(FLEET, fathom_base::input::MAX_TEXT)?.text())
        .map_err(|error| nothing(error.to_string()))?;
    let stored: Stored = serde_json::from_str(&json).map_err(|error| nothing(error.to_string()))?;
    if stored != *asked {
        let run = stored.run.iter().map(|word| text::shell(word)).collect::<Vec<_>>();
        bail!(
            "{} holds a fleet for {} shards of `run {}`: continue it with the same command",
            out.display(),
            stored.shards,
            run.join(" ")
        );
    }
    Ok(())
}
