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
fn what_hangs_or_is_interrupted_is_killed_and_said_so() {
    let short = Limits { time: Some(Duration::from_millis(10)), interrupted: None };
    for endless in ["exec sleep 3600", "exec >&- 2>&-; exec sleep 3600", "sleep 3600 & wait"] {
        let hung = ran(endless, short).unwrap_err().to_string();
        assert_eq!(hung, "it did not end within 0.01 s and was killed");
    }
    let flag = AtomicBool::new(true);
    let limits = Limits { time: None, interrupted: Some(&flag) };
    let interrupted = ran("exec yes >&2", limits).unwrap_err();
    assert!(matches!(interrupted, ProcessError::Interrupted), "{interrupted}");
}

#[test]
fn of_endless_complaints_the_last_lines_are_kept() {
    let many: String = (0..100_000).map(|line| format!("{line}\n")).collect();
    let heard = StderrReader::start(io::Cursor::new(many)).finish();
    let lines: Vec<&String> = heard.lines().collect();
    assert_eq!((lines.len(), lines[0].as_str(), lines[19].as_str()), (20, "99980", "99999"));
}

/// Whether the process whose number a file holds has ended, if only as a zombie of a parent that does not ask.
#[cfg(target_os = "linux")]
fn is_gone(number: &Path) -> bool {
    let number = std::fs::read_to_string(number).unwrap();
    let stat = std::fs::read_to_string(Path::new("/proc").join(number.trim()).join("stat"));
    stat.is_ok_and(|stat| stat.contains(") Z ")) || !Path::new("/proc").join(number.trim()).exists()
}

/// In a hook of git.
#[test]
fn no_child_is_given_gits_variables() {
    let mut env = Command::new("env");
    env.envs(["GIT_DIR", "GIT_INDEX_FILE", "GIT_WORK_TREE"].map(|name| (name, "of the caller")));
    let told = run_for_stdout(&mut env).unwrap();
    assert!(!told.contains("of the caller"), "{told}");
}

/// A command that ends leaves a process behind that holds its output open.
#[cfg(target_os = "linux")]
#[test]
fn what_a_command_leaves_behind_ends_with_it() {
    let folder = tempfile::tempdir().unwrap();
    let number = folder.path().join("left");
    let left = format!("sleep 3600 & echo $! >{}", number.display());
    ran(&left, Limits::TOOL).unwrap();
    while !is_gone(&number) {
        std::thread::sleep(POLL);
    }
}
