//! Child processes with limits: of their time, and of what is kept of their words. Each has a process group of its own, which ends with it.

use std::collections::{BTreeSet, VecDeque};
use std::fmt;
use std::io::{self, BufReader, Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command, ExitStatus, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, SyncSender, sync_channel};
use std::sync::{Mutex, OnceLock};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use itertools::Itertools;
use thiserror::Error;

use crate::input::{LineEnd, next_line};
use crate::text;

/// Longest time of a tool that may check out a repository or download 200 MB, more than any asset's package, at 3 Mbit/s.
const TOOL_TIME: Duration = Duration::from_secs(600);
/// Bytes that are kept of a line of complaint, and lines: together 10 KiB.
const MAX_LINE: usize = 512;
const LAST_LINES: usize = 20;
/// Lines that may wait to be told. A process that writes more waits for its reader.
const LINES_AHEAD: usize = 64;
/// How long an interruption or the end of a time limit may go unnoticed.
const SLICE: Duration = Duration::from_millis(100);
/// Time between two looks whether a process has ended.
const POLL: Duration = Duration::from_millis(2);
/// How long a killed process is waited for: one within a call of the system that does not end outlasts its kill.
const SHUTDOWN_TIMEOUT: Duration = Duration::from_secs(10);

/// Keeps a list of groups until its input ends, which it does with the process that writes it; then it ends them.
#[cfg(unix)]
const END_GROUPS: &str = r#"groups=" "
while read -r sign group; do
    case $sign in
    +) groups="$groups$group " ;;
    -) groups="${groups%% "$group" *} ${groups#* "$group" }" ;;
    esac
done
for group in $groups; do kill -9 "-$group"; done"#;

/// A child with the processes of its group. They end when this is dropped.
pub struct ProcessTree {
    pub child: Child,
    /// Number of its group, until that is killed.
    group: Option<u32>,
}

impl ProcessTree {
    /// Starts a command. It lies outside the terminal's foreground group: Ctrl-C reaches this process alone.
    pub fn spawn(command: &mut Command) -> io::Result<Self> {
        for name in git_variables().lines() {
            command.env_remove(name);
        }
        #[cfg(unix)]
        std::os::unix::process::CommandExt::process_group(command, 0);
        let child = command.spawn()?;
        watch('+', child.id());
        Ok(Self { group: Some(child.id()), child })
    }

    pub fn id(&self) -> u32 {
        self.child.id()
    }

    /// The programs that its group runs, each with its script: the first argument that is a file. None outside Linux.
    #[cfg(target_os = "linux")]
    pub fn files(&self) -> BTreeSet<PathBuf> {
        let is_own = |process: &procfs::process::Process| {
            process.stat().is_ok_and(|stat| Some(stat.pgrp as u32) == self.group)
        };
        let all = procfs::process::all_processes().into_iter().flatten().flatten();
        let files = all.filter(is_own).flat_map(|process| {
            let (arguments, folder) = (process.cmdline().unwrap_or_default(), process.cwd());
            let folder = folder.unwrap_or_default();
            let paths = arguments.iter().skip(1).map(|argument| folder.join(argument));
            let script = paths.filter(|path| path.is_file()).take(1);
            process.exe().into_iter().chain(script).collect::<Vec<_>>()
        });
        files.collect()
    }

    #[cfg(not(target_os = "linux"))]
    pub fn files(&self) -> BTreeSet<PathBuf> {
        BTreeSet::new()
    }

    /// Its status, if it ends within this time.
    pub fn status_within(&mut self, limit: Duration) -> io::Result<Option<ExitStatus>> {
        let start = Instant::now();
        loop {
            match self.child.try_wait()? {
                None if start.elapsed() < limit => std::thread::sleep(POLL),
                status => return Ok(status),
            }
        }
    }

    /// Ends it and its group, of which some may outlive it.
    pub fn kill(&mut self) {
        self.child.stdin = None;
        if let Some(group) = self.group.take() {
            kill_group(group);
            watch('-', group);
            let _ = self.child.kill();
            let _ = self.status_within(SHUTDOWN_TIMEOUT);
        }
    }
}

/// The variables in which git names the repository and the index of its caller, a hook. No child may take them for its own.
fn git_variables() -> &'static str {
    static NAMES: OnceLock<String> = OnceLock::new();
    NAMES.get_or_init(|| {
        let names = Command::new("git").args(["rev-parse", "--local-env-vars"]).output();
        names.map_or_else(|_| String::new(), |names| String::from_utf8_lossy(&names.stdout).into())
    })
}

/// Says that a group has begun (+) or ended (-) to a shell that ends those left when this process is killed.
#[cfg(unix)]
fn watch(sign: char, group: u32) {
    static WATCHER: OnceLock<Option<Mutex<ChildStdin>>> = OnceLock::new();
    let start = || {
        let mut shell = Command::new("sh");
        shell.args(["-c", END_GROUPS]).stdin(Stdio::piped());
        shell.stdout(Stdio::null()).stderr(Stdio::null());
        std::os::unix::process::CommandExt::process_group(&mut shell, 0);
        shell.spawn().ok()?.stdin.map(Mutex::new)
    };
    if let Some(Ok(mut watcher)) = WATCHER.get_or_init(start).as_ref().map(Mutex::lock) {
        let _ = watcher.write_all(format!("{sign} {group}\n").as_bytes());
    }
}

#[cfg(not(unix))]
fn watch(_: char, _: u32) {}

#[cfg(unix)]
fn kill_group(group: u32) {
    // SAFETY: it takes two numbers.
    unsafe {
        libc::killpg(group as libc::pid_t, libc::SIGKILL);
    }
}

#[cfg(not(unix))]
fn kill_group(_: u32) {}

impl Drop for ProcessTree {
    fn drop(&mut self) {
        self.kill();
    }
}

/// Why a command gave no answer.
#[derive(Debug, Error)]
pub enum ProcessError {
    #[error("it cannot be started: {0}")]
    Start(io::Error),
    #[error("it did not end within {} s and was killed", .0.as_secs_f64())]
    Hung(Duration),
    #[error("it was interrupted")]
    Interrupted,
    #[error("{}", failure(.status, .complaint))]
    Failed { status: ExitStatus, complaint: Excerpt },
    #[error(transparent)]
    Io(io::Error),
}

fn failure(status: &ExitStatus, complaint: &Excerpt) -> String {
    let complaint = complaint.to_string();
    if complaint.is_empty() { status.to_string() } else { complaint }
}

/// What ends a command early.
#[derive(Clone, Copy, Default)]
pub struct Limits<'a> {
    pub time: Option<Duration>,
    pub interrupted: Option<&'a AtomicBool>,
}

impl Limits<'_> {
    pub const TOOL: Limits<'static> = Limits { time: Some(TOOL_TIME), interrupted: None };

    fn check(&self, start: Instant) -> Result<(), ProcessError> {
        match (self.time, self.interrupted) {
            (_, Some(flag)) if flag.load(Ordering::Relaxed) => Err(ProcessError::Interrupted),
            (Some(time), _) if start.elapsed() >= time => Err(ProcessError::Hung(time)),
            _ => Ok(()),
        }
    }
}

enum ChildStream {
    Stderr(String),
    Stdout(io::Result<Vec<u8>>),
}

/// Runs a command to its end and gives its standard output, if it ended well. `tell` takes each line of its standard error.
pub fn run(
    command: &mut Command,
    limits: Limits<'_>,
    tell: &mut dyn FnMut(&str),
) -> Result<String, ProcessError> {
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let start = Instant::now();
    let mut tree = ProcessTree::spawn(command).map_err(ProcessError::Start)?;
    let (sender, said) = sync_channel(LINES_AHEAD);
    listen(&mut tree, sender);
    let (mut answer, mut complaint) = (Vec::new(), Excerpt::default());
    loop {
        limits.check(start)?;
        match said.recv_timeout(SLICE) {
            Ok(ChildStream::Stderr(line)) => {
                tell(&line);
                complaint.add(line);
            }
            Ok(ChildStream::Stdout(read)) => answer = read.map_err(ProcessError::Io)?,
            // What it has left behind may hold its output open.
            Err(RecvTimeoutError::Timeout) if matches!(tree.child.try_wait(), Ok(Some(_))) => {
                tree.kill();
            }
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => break,
        }
    }
    // It may have closed its output before its end.
    let status = loop {
        match tree.status_within(SLICE).map_err(ProcessError::Io)? {
            Some(status) => break status,
            None => limits.check(start)?,
        }
    };
    if !status.success() {
        return Err(ProcessError::Failed { status, complaint });
    }
    Ok(String::from_utf8_lossy(&answer).into_owned())
}

/// What a tool prints, without white space around it.
pub fn run_for_stdout(command: &mut Command) -> Result<String, ProcessError> {
    run(command, Limits::TOOL, &mut |_| ()).map(|text| text.trim().to_owned())
}

/// What git prints in a folder, without white space around it; else its complaint, of which one line.
pub fn git(folder: &Path, arguments: &[&str]) -> Result<String, String> {
    run_for_stdout(Command::new("git").arg("-C").arg(folder).args(arguments)).map_err(|error| {
        let ProcessError::Failed { status, complaint } = error else {
            return format!("git: {error}");
        };
        let is_cause = |line: &&String| line.starts_with("fatal: ") || line.starts_with("error: ");
        let cause = complaint.lines().find(is_cause).or(complaint.lines().next());
        cause.map_or(format!("git: {status}"), |line| line.trim().to_owned())
    })
}

/// A file that grows beyond the limit of the shell (`ulimit -f`) is an error of its write, and does not end this process or a child.
pub fn take_size_limit_as_error() {
    #[cfg(unix)]
    // SAFETY: no handler is installed; the signal is ignored from now on.
    unsafe {
        libc::signal(libc::SIGXFSZ, libc::SIG_IGN);
    }
}

/// Reads both outputs in threads.
fn listen(tree: &mut ProcessTree, said: SyncSender<ChildStream>) {
    if let Some(mut output) = tree.child.stdout.take() {
        let said = said.clone();
        std::thread::spawn(move || {
            let mut bytes = Vec::new();
            let read = output.read_to_end(&mut bytes);
            said.send(ChildStream::Stdout(read.map(|_| bytes)))
        });
    }
    if let Some(output) = tree.child.stderr.take() {
        std::thread::spawn(move || {
            each_line(output, |line| said.send(ChildStream::Stderr(line)).is_ok());
        });
    }
}

/// Hands on the lines that hold anything, of long ones the beginning, until `take` wants no more.
fn each_line(output: impl Read, mut take: impl FnMut(String) -> bool) {
    let (mut source, mut bytes) = (BufReader::new(output), Vec::new());
    while let Ok(Some(end)) = next_line(&mut source, MAX_LINE, &mut bytes) {
        let mut line = text::line(String::from_utf8_lossy(&bytes).trim_end());
        if end == LineEnd::TooLong {
            line.push('…');
        }
        if !line.is_empty() && !take(line) {
            return;
        }
    }
}

/// The last lines that a process has written to its standard error.
#[derive(Clone, Debug, Default)]
pub struct Excerpt(VecDeque<String>);

impl Excerpt {
    fn add(&mut self, line: String) {
        if self.0.len() == LAST_LINES {
            self.0.pop_front();
        }
        self.0.push_back(line);
    }

    pub fn lines(&self) -> impl DoubleEndedIterator<Item = &String> {
        self.0.iter()
    }
}

impl fmt::Display for Excerpt {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.lines().map(|line| line.trim()).format("; "))
    }
}

/// A thread that reads all that a process complains of and keeps an excerpt.
pub struct StderrReader(JoinHandle<Excerpt>);

impl StderrReader {
    pub fn start(output: impl Read + Send + 'static) -> Self {
        Self(std::thread::spawn(move || {
            let mut excerpt = Excerpt::default();
            each_line(output, |line| {
                excerpt.add(line);
                true
            });
            excerpt
        }))
    }

    /// What there was, of a process that has ended. Empty where something else still holds its pipe.
    pub fn finish(self) -> Excerpt {
        let start = Instant::now();
        while !self.0.is_finished() && start.elapsed() < SHUTDOWN_TIMEOUT {
            std::thread::sleep(POLL);
        }
        if self.0.is_finished() { self.0.join().unwrap_or_default() } else { Excerpt::default() }
    }
}

#[cfg(all(test, unix))]
mod tests;
