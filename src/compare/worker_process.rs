//! Worker processes: started under set conditions, asked within a time limit, and ended for certain.

use std::collections::BTreeSet;
use std::ffi::OsString;
use std::io::{BufRead, BufReader, Read, Write};
use std::path::{Path, PathBuf};
use std::process::{ChildStdin, Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::time::{Duration, Instant};

use serde_json::Value;
use thiserror::Error;

use super::environment::{self, Environment};
use super::protocol::{Greeting, PROTOCOL, Reply, RequestKind, WorkerRequest};
use fathom_base::process::{ProcessTree, StderrReader};
use fathom_base::quiet;
pub use fathom_base::quiet::{Quiet, allowed_cores};
use fathom_base::text::excerpt;
use fathom_gpu as gpu;
use fathom_gpu::ClockPlan;
use fathom_record::MachineState;
use fathom_record::comparison::CellId;

/// Runs the command of a worker that is no build of fathom.
const SHELL: &str = "sh";
/// A reply longer than this is garbage. The longest of fathom's own have some 50 KiB. Of one reply come lines of records, which are
/// 4.5 times as long where numbers are written out, and may have 8 MiB.
const MAX_REPLY_BYTES: u64 = 1 << 20;
/// Replies that wait to be read. A worker that writes more than was asked for is blocked.
const REPLIES_AHEAD: usize = 1;
/// Shortest plausible time of a frame, a picosecond: ratios to a time of 0 have no logarithm.
const SHORTEST_NS: f64 = 1e-3;
/// What a sample may be longer than its request: as the audit allows of timestamps, which another clock counts.
const CLOCK_TOLERANCE: f64 = 1.15;
/// A worker that was asked to end is killed after this.
const SHUTDOWN_TIMEOUT: Duration = Duration::from_secs(2);
/// A reply that takes longer than this is announced as being waited for.
const LONG: Duration = Duration::from_secs(5);
/// How long an interruption may go unnoticed while a reply is waited for.
const SLICE: Duration = Duration::from_millis(100);

/// Why a worker gave no answer that could be used.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum WorkerFault {
    #[error("{} cannot be started: {reason}", program.display())]
    Start { program: PathBuf, reason: String },
    #[error("it ended with {status}{}", after_colon(.stderr))]
    Ended { status: String, stderr: String },
    #[error("it gave no answer to `{request}` within {seconds} s{}", after_colon(.stderr))]
    Silent { request: RequestKind, seconds: u64, stderr: String },
    #[error("it answered garbage to `{request}`: {excerpt}")]
    Garbage { request: RequestKind, excerpt: String },
    #[error("it speaks version {theirs} of the worker protocol, this build version {PROTOCOL}")]
    OtherProtocol { theirs: u32 },
    #[error("it does not know `{0}`")]
    Unsupported(String),
    /// The worker says why; it goes on unless this is fatal.
    #[error("{reason}")]
    Refused {
        reason: String,
        fatal: bool,
        /// Its build lacks what it was asked for.
        absent: bool,
    },
    /// This process was told to end while the reply was waited for.
    #[error("interrupted")]
    Interrupted,
}

fn after_colon(stderr: &str) -> String {
    if stderr.is_empty() { String::new() } else { format!(": {stderr}") }
}

impl WorkerFault {
    /// A fault after which the worker cannot be used.
    pub(super) fn fatal(reason: String) -> Self {
        Self::Refused { reason, fatal: true, absent: false }
    }

    /// The build does not know what it was asked for.
    pub fn is_absence(&self) -> bool {
        matches!(self, Self::Refused { absent: true, .. })
    }

    pub fn is_alive(&self) -> bool {
        matches!(self, Self::Refused { fatal: false, .. } | Self::Unsupported(_))
    }
}

/// How long a worker may take before it counts as hung: for opening the device, an audit, preparing a configuration, exact figures.
const REPLY_TIMEOUT: Duration = Duration::from_secs(180);
/// The same for a sample, in which a stage of milliseconds runs a few times.
const SAMPLE_TIMEOUT: Duration = Duration::from_secs(30);

/// How a reply is waited for.
#[derive(Clone, Copy)]
pub struct ReplyWait<'a> {
    /// The worker is killed as soon as this becomes true.
    pub interrupted: Option<&'a AtomicBool>,
    /// Takes a line when a reply takes long.
    pub report: &'a dyn Fn(&str),
}

impl ReplyWait<'_> {
    /// Nothing interrupts the wait, and long waits are not reported.
    pub const SILENT: ReplyWait<'static> = ReplyWait { interrupted: None, report: &|_| {} };

    pub fn is_interrupted(&self) -> bool {
        self.interrupted.is_some_and(|flag| flag.load(Ordering::Relaxed))
    }
}

/// How to start a worker.
#[derive(Clone, Debug, Default)]
pub struct WorkerStart {
    /// What to call the worker in messages.
    pub name: String,
    /// A build of fathom.
    pub program: PathBuf,
    /// A command of the shell in its place: any program that speaks the worker protocol (`docs/worker-protocol.md`).
    pub command: Option<String>,
    /// A command that runs it, such as `valgrind` with its options; empty for none.
    pub wrapper: Vec<OsString>,
    pub gpu: gpu::Options,
    pub quiet: Option<Quiet>,
    /// What the processes of its side alone are given. Its length moves the stack, as [`Quiet::padding`] does; that is drawn from
    /// a whole page, so sides whose environments differ in length have noise of it and no bias.
    pub environment: Environment,
    /// Where its driver keeps compiled shaders, if apart from those of all other programs.
    pub shader_cache: Option<PathBuf>,
    /// The commit that its program is to be built of.
    pub commit: Option<String>,
    /// The audited clock of a hardware adapter: both sides must read the same one.
    pub clock: Option<ClockPlan>,
}

impl WorkerStart {
    pub fn new(program: &Path) -> Self {
        Self { name: "a".to_owned(), program: program.to_owned(), ..Self::default() }
    }

    /// A worker that is started by a command of the shell.
    pub fn from_command(text: &str) -> Self {
        Self { command: Some(text.to_owned()), ..Self::new(Path::new(SHELL)) }
    }

    fn command(&self) -> Command {
        let program = self.program.as_os_str().to_owned();
        let mut words = self.wrapper.iter().cloned().chain([program]);
        let mut command = Command::new(words.next().unwrap_or_default());
        command.args(words);
        if let Some(text) = &self.command {
            command.args(["-c", text]);
        } else {
            command.arg("worker").args(self.gpu.to_args());
        }
        if let Some(quiet) = &self.quiet {
            quiet::apply(&mut command, quiet);
        }
        command.envs(&self.environment);
        let cache = self.shader_cache.as_deref();
        command.envs(environment::cache_variables(&self.environment, cache));
        command
    }
}

/// A running worker. Dropping it kills it and all that it has started.
pub struct WorkerProcess {
    name: String,
    tree: ProcessTree,
    /// None after the last request.
    requests: Option<ChildStdin>,
    replies: Receiver<std::io::Result<String>>,
    errors: Option<StderrReader>,
    request: RequestKind,
}

impl WorkerProcess {
    /// Starts a process and greets it; [`Self::greet`] takes the answer.
    pub fn start(start: &WorkerStart) -> Result<Self, WorkerFault> {
        let mut worker = Self::spawn(start)?;
        worker.send(&WorkerRequest::Hello { protocol: PROTOCOL, clock: start.clock })?;
        Ok(worker)
    }

    /// Starts a process and waits for what it says of itself.
    pub fn open(
        start: &WorkerStart,
        waiting: &ReplyWait<'_>,
    ) -> Result<(Self, Greeting), WorkerFault> {
        let mut worker = Self::start(start)?;
        let greeting = worker.greet(waiting)?;
        Ok((worker, greeting))
    }

    /// Starts a process. It has said nothing yet.
    ///
    /// Whatever ends this process ends the worker and its group.
    pub fn spawn(start: &WorkerStart) -> Result<Self, WorkerFault> {
        let mut command = start.command();
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut tree = ProcessTree::spawn(&mut command).map_err(|error| WorkerFault::Start {
            program: command.get_program().into(),
            reason: error.to_string(),
        })?;
        let (sender, replies) = sync_channel(REPLIES_AHEAD);
        if let Some(output) = tree.child.stdout.take() {
            std::thread::spawn(move || read_replies(output, &sender));
        }
        let errors = tree.child.stderr.take().map(StderrReader::start);
        let (requests, request) = (tree.child.stdin.take(), RequestKind::Hello);
        Ok(Self { name: start.name.clone(), tree, requests, replies, errors, request })
    }

    /// Sends a request; [`Self::receive`] takes its reply, so that two workers can prepare at the same time.
    pub fn send(&mut self, request: &WorkerRequest) -> Result<(), WorkerFault> {
        if let Ok(Ok(unasked)) = self.replies.try_recv() {
            return Err(self.garbage(&unasked));
        }
        self.request = request.into();
        let line = serde_json::to_string(request).unwrap_or_default() + "\n";
        let requests = self.requests.as_mut();
        let sent = requests.is_some_and(|requests| requests.write_all(line.as_bytes()).is_ok());
        if sent { Ok(()) } else { Err(self.exit_fault()) }
    }

    /// The reply to the last request, of its kind. After a fault that does not [go on](WorkerFault::is_alive) the worker is dead.
    pub fn receive(&mut self, waiting: &ReplyWait<'_>) -> Result<Reply, WorkerFault> {
        let is_sample = self.request == RequestKind::Sample;
        let patience = if is_sample { SAMPLE_TIMEOUT } else { REPLY_TIMEOUT };
        let asked = Instant::now();
        let mut told = false;
        loop {
            let remaining = patience.saturating_sub(asked.elapsed());
            match self.replies.recv_timeout(remaining.min(SLICE)) {
                Ok(Ok(line)) => return self.read(&line),
                Ok(Err(error)) => return Err(self.garbage(&error.to_string())),
                Err(RecvTimeoutError::Disconnected) => return Err(self.exit_fault()),
                Err(RecvTimeoutError::Timeout) => {}
            }
            if waiting.is_interrupted() {
                self.tree.kill();
                return Err(WorkerFault::Interrupted);
            }
            if asked.elapsed() >= patience {
                let (request, seconds) = (self.request, patience.as_secs());
                return Err(WorkerFault::Silent { request, seconds, stderr: self.last_words() });
            }
            if asked.elapsed() >= LONG && !std::mem::replace(&mut told, true) {
                let (name, process, asked) = (&self.name, self.tree.id(), self.request);
                let patience_s = patience.as_secs();
                (waiting.report)(&format!(
                    "waiting for the {name} worker (process {process}) to answer `{asked}`, for at most {patience_s} s"
                ));
            }
        }
    }

    fn read(&mut self, line: &str) -> Result<Reply, WorkerFault> {
        if self.request == RequestKind::Hello
            && let Some(theirs) = parse_protocol(line).filter(|theirs| *theirs != PROTOCOL)
        {
            self.tree.kill();
            return Err(WorkerFault::OtherProtocol { theirs });
        }
        match serde_json::from_str(line) {
            Ok(Reply::Fault { reason, fatal, absent }) => {
                if fatal {
                    self.tree.kill();
                }
                Err(WorkerFault::Refused { reason: excerpt(&reason), fatal, absent })
            }
            Ok(Reply::Unsupported { message }) => Err(WorkerFault::Unsupported(excerpt(&message))),
            Ok(reply) if answers(&reply, self.request) => Ok(reply),
            _ => Err(self.garbage(line)),
        }
    }

    pub fn ask(
        &mut self,
        request: &WorkerRequest,
        waiting: &ReplyWait<'_>,
    ) -> Result<Reply, WorkerFault> {
        self.send(request)?;
        self.receive(waiting)
    }

    /// What the worker says of itself, if it speaks this protocol.
    pub fn greet(&mut self, waiting: &ReplyWait<'_>) -> Result<Greeting, WorkerFault> {
        match self.receive(waiting)? {
            Reply::Hello(greeting) => Ok(*greeting),
            other => Err(self.unexpected(&other)),
        }
    }

    /// Times of so many frames of a cell, ns, and the state of the adapter after them. Times that cannot be are the worker's fault.
    pub fn sample(
        &mut self,
        cell: &CellId,
        frames: u32,
        waiting: &ReplyWait<'_>,
    ) -> Result<(Vec<f64>, Option<MachineState>), WorkerFault> {
        let (config, stage) = (cell.configuration().to_owned(), cell.stage().to_owned());
        let asked = Instant::now();
        let reply = self.ask(&WorkerRequest::Sample { config, stage, frames }, waiting)?;
        let request_ns = asked.elapsed().as_secs_f64() * 1e9;
        let fault = match &reply {
            Reply::Sample { ns, .. } => implausibility(ns, frames, request_ns),
            _ => None,
        };
        match (reply, fault) {
            (Reply::Sample { ns, machine }, None) => Ok((ns, machine.map(|state| *state))),
            (other, fault) => Err(match (self.unexpected(&other), fault) {
                (WorkerFault::Garbage { request, excerpt }, Some(fault)) => {
                    WorkerFault::Garbage { request, excerpt: format!("{excerpt}: {fault}") }
                }
                (garbage, _) => garbage,
            }),
        }
    }

    /// The fault of a reply of the wrong kind. The worker is killed: it is not to be trusted.
    pub fn unexpected(&mut self, reply: &Reply) -> WorkerFault {
        let line = serde_json::to_string(reply).unwrap_or_default();
        self.garbage(&line)
    }

    /// Moves all threads of the worker to one core.
    pub fn pin(&self, core: usize) {
        quiet::pin(self.tree.id(), core);
    }

    fn garbage(&mut self, line: &str) -> WorkerFault {
        self.tree.kill();
        let excerpt = excerpt(line.trim_end());
        WorkerFault::Garbage { request: self.request, excerpt: format!("`{excerpt}`") }
    }

    fn exit_fault(&mut self) -> WorkerFault {
        self.requests = None;
        let status = self.tree.status_within(SHUTDOWN_TIMEOUT).ok().flatten();
        let status = status.map_or("its output closed".to_owned(), |status| status.to_string());
        WorkerFault::Ended { status, stderr: self.last_words() }
    }

    /// What it has written to its standard error. It is dead afterwards.
    fn last_words(&mut self) -> String {
        self.tree.kill();
        self.errors.take().map(StderrReader::finish).unwrap_or_default().to_string()
    }

    /// The files that a worker of a command runs.
    pub fn files(&self) -> BTreeSet<PathBuf> {
        self.tree.files()
    }

    /// Asks the worker to end, and kills it after `SHUTDOWN_TIMEOUT`.
    pub fn quit(self) {
        self.quit_within(SHUTDOWN_TIMEOUT);
    }

    /// The same with another timeout, for what the driver has to finish.
    pub fn quit_within(mut self, timeout: Duration) {
        if self.send(&WorkerRequest::Quit).is_ok() {
            self.requests = None;
            // Whatever it does, it is gone after this.
            let _ = self.tree.status_within(timeout);
        }
    }
}

/// Why these cannot be the times of so many frames, taken one after the other within a request that took so long by this process's clock.
fn implausibility(ns: &[f64], frames: u32, request_ns: f64) -> Option<String> {
    // On one core no process has more CPU time than the wall has; where none can be chosen it may have that of all.
    let cores = if allowed_cores().is_empty() {
        std::thread::available_parallelism().map_or(1, usize::from)
    } else {
        1
    };
    let longest_ns = CLOCK_TOLERANCE * request_ns * cores as f64;
    if ns.len() != frames as usize {
        return Some(format!("{} times of {frames} frames", ns.len()));
    }
    let wrong = ns.iter().find(|ns| !(SHORTEST_NS..=longest_ns).contains(*ns))?;
    Some(format!("{wrong:e} ns, in a request that took {request_ns:.3e} ns"))
}

/// The reply is of the kind that was asked for.
fn answers(reply: &Reply, asked: RequestKind) -> bool {
    use RequestKind as Asked;
    match reply {
        Reply::Hello(_) => asked == Asked::Hello,
        Reply::Clock { .. } => asked == Asked::Clock,
        Reply::Prepared { .. } => asked == Asked::Prepare,
        Reply::Sample { .. } => asked == Asked::Sample,
        Reply::Exact(_) => asked == Asked::Exact,
        Reply::Fingerprint { .. } => asked == Asked::Fingerprint,
        Reply::Checks { .. } => asked == Asked::Checks,
        Reply::Instructions { .. } => asked == Asked::Instructions,
        Reply::Fault { .. } | Reply::Unsupported { .. } => true,
    }
}

/// The version that a greeting names, whatever else of it this build can read.
fn parse_protocol(line: &str) -> Option<u32> {
    let greeting: Value = serde_json::from_str(line).ok()?;
    let version = greeting.get("protocol")?.as_u64()?;
    Some(u32::try_from(version).unwrap_or(u32::MAX))
}

/// Sends each line until the output ends or the receiver is gone.
fn read_replies(output: impl Read, replies: &SyncSender<std::io::Result<String>>) {
    let mut output = BufReader::new(output);
    loop {
        let mut line = String::new();
        let read = output.by_ref().take(MAX_REPLY_BYTES).read_line(&mut line);
        let (reply, last) = match read {
            Ok(0) => return,
            Ok(_) => (Ok(line), false),
            Err(error) => (Err(error), true),
        };
        if replies.send(reply).is_err() || last {
            return;
        }
    }
}

#[cfg(test)]
mod tests {
    use std::ffi::OsStr;

    use super::*;

    #[test]
    fn times_are_finite_and_above_0_and_no_longer_than_their_request() {
        let request_ns = 1e6;
        for ns in [SHORTEST_NS, 1.0, 1e6] {
            assert_eq!(implausibility(&[ns], 1, request_ns), None);
        }
        for ns in [0.0, -0.0, -1.0, 5e-324, f64::NAN, f64::INFINITY, 1.8e19] {
            for place in 0..2 {
                let mut frames = [1e5; 2];
                frames[place] = ns;
                assert!(implausibility(&frames, 2, request_ns).is_some(), "{ns}");
            }
        }
        assert!(implausibility(&[1e5], 2, request_ns).is_some(), "one is missing");
        assert!(implausibility(&[1.1e6], 1, request_ns).is_none(), "clocks differ by a little");
        if cfg!(target_os = "linux") {
            assert!(implausibility(&[1.2e6], 1, request_ns).is_some());
        }
    }

    /// Every gate starts its workers so, under callgrind too.
    #[test]
    fn a_worker_is_given_its_sides_environment_beside_fathoms_own() {
        let start = WorkerStart {
            wrapper: vec!["valgrind".into()],
            quiet: Some(Quiet::default()),
            environment: [("A".to_owned(), "1".to_owned())].into(),
            ..WorkerStart::new(Path::new("fathom"))
        };
        let command = start.command();
        assert_eq!(command.get_program(), "valgrind");
        let set: Vec<_> = command.get_envs().collect();
        assert!(set.contains(&(OsStr::new("A"), Some(OsStr::new("1")))), "{set:?}");
        assert!(set.contains(&(OsStr::new(quiet::PADDING), Some(OsStr::new("")))), "{set:?}");
    }
}
