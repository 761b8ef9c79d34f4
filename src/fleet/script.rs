//! What a task of a job array runs.

use super::shards::{SHARDS, STATUS};

/// Name of the script in the fleet's folder.
pub const NAME: &str = "job.sh";

/// A POSIX shell script. It goes on with a shard whose folder has records, hands a termination on to fathom and waits for it,
/// and writes fathom's exit status and the job beside the folder.
pub fn text(program: &str, run: &[String], shards: u32, out: &str) -> String {
    let run: Vec<String> = run.iter().map(|word| quoted(word)).collect();
    let (run, program, out) = (run.join(" "), quoted(program), quoted(out));
    format!(
        r#"#!/bin/sh
# Written by `fathom fleet slurm`. Each task of the array measures a shard of the run.
folder={out}/{SHARDS}/$SLURM_ARRAY_TASK_ID
status_file=$folder.{STATUS}
rm -f "$status_file"
# A task outlives the daemon of its node: what it still writes is waited for.
if [ -e "$folder/.lock" ] && command -v flock >/dev/null; then flock "$folder/.lock" true; fi
set -- --shard "$SLURM_ARRAY_TASK_ID/{shards}" --out "$folder"
[ ! -e "$folder/records.jsonl" ] || set -- "$@" --resume
trap 'kill -TERM "$child" 2>/dev/null' INT TERM
{program} run {run} "$@" &
child=$!
wait "$child"
status=$?
# A signal ends `wait` before fathom has ended.
while kill -0 "$child" 2>/dev/null; do
    wait "$child"
    status=$?
done
new=$(mktemp "$status_file.XXXXXX") && echo "$status $SLURM_ARRAY_JOB_ID" >"$new" && chmod a+r "$new" && mv "$new" "$status_file"
exit "$status"
"#
    )
}

/// A word for a POSIX shell, byte for byte.
fn quoted(word: &str) -> String {
    format!("'{}'", word.replace('\'', "'\\''"))
}

#[cfg(all(test, unix))]
mod tests {
    use std::fs;
    use std::os::unix::fs::PermissionsExt;
    use std::path::Path;
    use std::process::{Child, Command, Stdio};
    use std::time::Duration;

    use super::*;

    /// Of the run: all that a shell may take for something else.
    const HOSTILE: &str = "a='$(touch x)' \"b\"\\\n#SBATCH --comment=x\r\t \u{1b}[2J*?~!é`touch y`";

    /// A program in fathom's place: writes its arguments, one a line, and does what `then` says.
    fn task(then: &str) -> (tempfile::TempDir, Command) {
        let folder = tempfile::tempdir().unwrap();
        let program = folder.path().join("fa thom'");
        let arguments = folder.path().join("arguments");
        let text = format!("#!/bin/sh\nprintf '%s\\n' \"$@\" >{}\n{then}\n", arguments.display());
        fs::write(&program, text).unwrap();
        fs::set_permissions(&program, fs::Permissions::from_mode(0o755)).unwrap();
        let run = ["uw-default", "--cell", HOSTILE].map(str::to_owned);
        let out = folder.path().join("o ut");
        fs::create_dir_all(out.join(SHARDS)).unwrap();
        let script = folder.path().join(NAME);
        let [program, out] = [&program, &out].map(|path| path.to_str().unwrap());
        fs::write(&script, super::text(program, &run, 8, out)).unwrap();
        let mut command = Command::new("sh");
        command.env("SLURM_ARRAY_TASK_ID", "3").env("SLURM_ARRAY_JOB_ID", "12");
        command.arg(script).current_dir(folder.path());
        (folder, command)
    }

    fn wait_for(file: &Path, running: &mut Child) {
        while !file.exists() {
            assert_eq!(running.try_wait().unwrap(), None, "it ended");
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    fn status(folder: &tempfile::TempDir) -> Option<String> {
        fs::read_to_string(folder.path().join("o ut/shards/3.status")).ok()
    }

    #[test]
    fn arguments_arrive_as_they_are_and_the_status_is_written() {
        let (folder, mut task) = task("exit 7");
        assert_eq!(task.status().unwrap().code(), Some(7));
        assert_eq!(status(&folder).as_deref(), Some("7 12\n"));
        let told = fs::read_to_string(folder.path().join("arguments")).unwrap();
        let out = folder.path().join("o ut/shards/3");
        let wanted =
            format!("run\nuw-default\n--cell\n{HOSTILE}\n--shard\n3/8\n--out\n{}\n", out.display());
        assert_eq!(told, wanted);
        assert!(!["x", "y"].iter().any(|name| folder.path().join(name).exists()));
        // With records it goes on.
        fs::create_dir(&out).unwrap();
        fs::write(out.join("records.jsonl"), "").unwrap();
        task.status().unwrap();
        let told = fs::read_to_string(folder.path().join("arguments")).unwrap();
        assert!(told.ends_with("--resume\n"), "{told}");
    }

    #[test]
    fn a_termination_is_handed_on() {
        let (folder, mut task) = task(
            "trap 'sleep 0.3; exit 130' TERM\n>ready\nwhile [ -e ready ]; do sleep 0.05; done",
        );
        let mut running = task.stderr(Stdio::null()).spawn().unwrap();
        wait_for(&folder.path().join("ready"), &mut running);
        Command::new("kill").args(["-TERM", &running.id().to_string()]).status().unwrap();
        assert_eq!(running.wait().unwrap().code(), Some(130));
        assert_eq!(status(&folder).as_deref(), Some("130 12\n"));
    }

    #[test]
    fn one_that_is_killed_leaves_no_status() {
        let (folder, mut task) = task("while [ -e arguments ]; do sleep 0.05; done");
        let old = folder.path().join("o ut/shards/3.status");
        fs::write(&old, "0 12\n").unwrap();
        let mut running = task.spawn().unwrap();
        wait_for(&folder.path().join("arguments"), &mut running);
        running.kill().unwrap();
        running.wait().unwrap();
        assert_eq!(status(&folder), None);
    }
}
