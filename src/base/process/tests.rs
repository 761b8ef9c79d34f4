use std::path::Path;

use super::*;

fn shell(script: &str) -> Command {
    let mut command = Command::new("sh");
    command.args(["-c", script]);
    command
}

fn ran(script: &str, limits: Limits<'_>) -> Result<String, ProcessError> {
    run(&mut shell(script), limits, &mut |_| ())
}

#[test]
fn an_answer_is_given_and_complaints_are_told_line_by_line() {
    let mut told = Vec::new();
    let script = "echo a; printf 'b\\n\\nc\\033[2J' >&2";
    let answer = run(&mut shell(script), Limits::TOOL, &mut |line| told.push(line.to_owned()));
    assert_eq!(answer.unwrap(), "a\n");
    assert_eq!(told, ["b", "c�[2J"]);
}

#[test]
fn a_failure_tells_the_complaint_or_else_the_status() {
    let told = |script: &str| ran(script, Limits::TOOL).unwrap_err().to_string();
    assert_eq!(told("echo one >&2; echo two >&2; exit 3"), "one; two");
    assert_eq!(told("exit 3"), "exit status: 3");
    assert_eq!(told("kill -SEGV $$"), "signal: 11 (SIGSEGV)");
    let absent = run(&mut Command::new("/no/such/program"), Limits::TOOL, &mut |_| ());
    assert!(matches!(absent, Err(ProcessError::Start(_))), "{absent:?}");
}

#[test]
fn what_hangs_floods_or_is_interrupted_is_killed_and_said_so() {
    let short = Limits { time: Some(Duration::from_millis(10)), interrupted: None };
    for endless in ["exec sleep 3600", "exec >&- 2>&-; exec sleep 3600", "sleep 3600 & wait"] {
        let hung = ran(endless, short).unwrap_err().to_string();
        assert_eq!(hung, "it did not end within 0.01 s and was killed");
    }
    let flooded = ran("exec yes", Limits::default()).unwrap_err();
    assert!(matches!(flooded, ProcessError::Flooded), "{flooded}");
    let flag = AtomicBool::new(true);
    let limits = Limits { time: None, interrupted: Some(&flag) };
    let interrupted = ran("exec yes >&2", limits).unwrap_err();
    assert!(matches!(interrupted, ProcessError::Interrupted), "{interrupted}");
}

#[test]
fn of_endless_complaints_the_last_lines_are_kept() {
    let one_line = StderrReader::start(io::repeat(b'x').take(100 << 20)).finish().to_string();
    assert_eq!(one_line, "x".repeat(MAX_LINE) + "…");
    let many: String = (0..100_000).map(|line| format!("{line}\n")).collect();
    let heard = StderrReader::start(io::Cursor::new(many)).finish();
    let lines: Vec<&String> = heard.lines().collect();
    assert_eq!((lines.len(), lines[0].as_str(), lines[19].as_str()), (20, "99980", "99999"));
}

/// Starts a process in a session of its own, whose parent ends, and then does what `then` says.
#[cfg(target_os = "linux")]
fn leaving(number: &Path, then: &str) -> Command {
    let number = number.display();
    shell(&format!(
        "(setsid sh -c 'echo $$ >{number}.part; mv {number}.part {number}; exec sleep 3600' &)\n\
         while [ ! -e {number} ]; do sleep 0.01; done\n{then}"
    ))
}

#[cfg(target_os = "linux")]
fn is_gone(number: &Path) -> bool {
    let number = std::fs::read_to_string(number).unwrap();
    !Path::new("/proc").join(number.trim()).exists()
}

#[cfg(target_os = "linux")]
#[test]
fn nothing_that_a_command_started_outlives_it() {
    let folder = tempfile::tempdir().unwrap();
    let number = folder.path().join("ended");
    run(&mut leaving(&number, "exit 0"), Limits::TOOL, &mut |_| ()).unwrap();
    assert!(is_gone(&number));
    let number = folder.path().join("killed");
    let mut tree = ProcessTree::spawn(&mut leaving(&number, "exec sleep 3600")).unwrap();
    while !number.exists() {
        std::thread::sleep(POLL);
    }
    assert!(!is_gone(&number));
    tree.kill();
    assert!(is_gone(&number));
}

/// Its own process is pinned and asked for its state, not its guardian's.
#[cfg(target_os = "linux")]
#[test]
fn the_number_is_the_commands() {
    let mut command = shell("echo $$; exec cat");
    command.stdin(Stdio::piped()).stdout(Stdio::piped());
    let mut tree = ProcessTree::spawn(&mut command).unwrap();
    let mut told = String::new();
    let id = tree.id();
    drop(tree.stdin.take());
    tree.stdout.take().unwrap().read_to_string(&mut told).unwrap();
    assert_eq!(told.trim(), id.to_string());
}
