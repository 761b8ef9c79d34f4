//! Slurm's commands as scripts that lag, lie or hang.

use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use tempfile::TempDir;

use super::cluster::wait;
use super::{begin, ended, signal};
use crate::common::fathom;

/// Numbers its jobs from 41 and keeps the arguments of each.
const SBATCH: &str = r#"[ "$1" != --version ] || exit 0
job=$(($(cat job 2>/dev/null || echo 40) + 1))
printf '%s\n' "$@" >arguments
echo $job | tee job
"#;
const SCANCEL: &str = "printf '%s\\n' \"$@\" >>cancelled\n";
/// Counts its calls.
const COUNT: &str = "calls=$(($(cat calls 2>/dev/null || echo 0) + 1)); echo $calls >calls\n";

struct Fake {
    folder: TempDir,
}

impl Fake {
    /// `squeue` is what that command does.
    fn new(squeue: &str) -> Self {
        let folder = TempDir::new().unwrap();
        let commands = [("sbatch", SBATCH), ("scancel", SCANCEL), ("squeue", squeue)];
        for (name, does) in commands {
            let path = folder.path().join(name);
            let place = folder.path().display();
            fs::write(&path, format!("#!/bin/sh\ncd '{place}'\n{does}")).unwrap();
            fs::set_permissions(&path, fs::Permissions::from_mode(0o755)).unwrap();
        }
        Self { folder }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn read(&self, name: &str) -> String {
        fs::read_to_string(self.path(name)).unwrap_or_default()
    }

    fn fleet(&self, out: &Path, options: &[&str]) -> Command {
        let mut fleet = fathom();
        let path = format!("{}:/usr/bin:/bin", self.folder.path().display());
        fleet.env("PATH", path).args(["fleet", "slurm", "--shards", "1"]).args(options);
        fleet.arg("--out").arg(out).args(["--", "run", "uw-default"]);
        fleet
    }
}

#[track_caller]
fn refused(output: &Output, reason: &str) {
    let told = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{told}");
    assert!(told.contains(reason) && told.lines().count() == 1, "{told}");
}

/// The queue shows nothing of the job, the status of an earlier one is still there, and the task ends at the fourth look.
#[test]
fn a_late_queue_and_an_earlier_status_cost_one_submission() {
    let fake = Fake::new(&format!("{COUNT}[ $calls -lt 4 ] || echo 0 41 >out/shards/1.status\n"));
    let out = fake.path("out");
    fs::create_dir_all(out.join("shards")).unwrap();
    fs::write(out.join("shards/1.status"), "2 7\n").unwrap();
    let told = fake.fleet(&out, &[]).output().unwrap();
    let told = String::from_utf8_lossy(&told.stderr).into_owned();
    assert!(told.contains("shard 1 is done"), "{told}");
    assert_eq!(told.matches("submitted as job").count(), 1, "{told}");
    assert_eq!(fake.read("job"), "41\n");
}

/// The folder names job 13; the queue shows the fleet's own until it is cancelled.
#[test]
fn only_the_fleets_own_jobs_are_cancelled() {
    let fake = Fake::new(
        "[ -e cancelled ] || [ ! -e job ] || sed -n 's/^--comment=/41|1|n1|/p' arguments\n",
    );
    let out = fake.path("out");
    fs::create_dir(&out).unwrap();
    let forged = r#"{"format": 2, "shards": 1, "run": ["uw-default"], "jobs": [13]}"#;
    fs::write(out.join("fleet.json"), forged).unwrap();
    let log = fake.path("log");
    let running = begin(fake.fleet(&out, &["--resume"]), &log);
    wait("the task", || fs::read_to_string(&log).is_ok_and(|told| told.contains("runs on n1")));
    signal(&running, "-INT");
    let told = ended(running, 130, &log);
    let cancelled = fake.read("cancelled");
    let name = fake.read("arguments");
    let name = name.lines().find_map(|line| line.strip_prefix("--job-name=")).unwrap();
    assert!(name.starts_with("fathom-"), "{name}");
    let words: Vec<&str> = cancelled.lines().collect();
    let named = format!("--name={name}");
    let expected = ["--quiet", &named, "--state=PENDING", "41"];
    assert_eq!(words[..4], expected, "{told}");
    let expected = ["--quiet", &named, "--batch", "--signal=TERM", "41"];
    assert_eq!(words[4..], expected, "{told}");
}

#[test]
fn a_job_with_another_comment_is_neither_followed_nor_cancelled() {
    let fake = Fake::new("echo '13|1|n1|(null)'\n");
    let output = fake.fleet(&fake.path("out"), &[]).output().unwrap();
    refused(&output, "but the comment `(null)` of another: it is left alone");
    assert!(!fake.path("job").exists() && !fake.path("cancelled").exists());
}

#[test]
fn an_interrupt_ends_the_wait_for_a_queue_that_hangs() {
    let hangs = "[ $calls -ne 2 ] || { echo $$ >hung; exec sleep 3600; }\n";
    let fake = Fake::new(&format!("{COUNT}{hangs}"));
    let log = fake.path("log");
    let running = begin(fake.fleet(&fake.path("out"), &[]), &log);
    wait("a queue that hangs", || !fake.read("hung").is_empty());
    signal(&running, "-INT");
    let told = ended(running, 130, &log);
    assert!(!told.contains("did not end within"), "{told}");
    let hung = fake.read("hung");
    assert!(!Path::new("/proc").join(hung.trim()).exists(), "{told}");
    assert!(fake.read("cancelled").contains("41"), "{told}");
}

#[test]
fn folders_that_slurm_would_take_for_others_are_refused() {
    let fake = Fake::new("");
    for name in ["a\nb", "a\\b", "a\u{1b}[2J"] {
        let output = fake.fleet(&fake.path(name), &[]).output().unwrap();
        refused(&output, "a backslash or a control character");
        assert!(!fake.path(name).exists() && !fake.path("a").exists());
    }
}
