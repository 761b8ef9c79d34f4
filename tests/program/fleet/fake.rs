//! Slurm's commands as scripts that lag, lie or hang.

use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::process::Command;

use super::{begin, ended};
use crate::common::{Ends, Place, holds, signal, wait_until};

/// Numbers its jobs from 41 and keeps the arguments of each.
const SBATCH: &str = r#"[ "$1" != --version ] || exit 0
job=$(($(cat job 2>/dev/null || echo 40) + 1))
printf '%s\n' "$@" >arguments
echo $job | tee job
"#;
const SCANCEL: &str = "printf '%s\\n' \"$@\" >>cancelled\n";
/// Counts its calls.
const COUNT: &str = "calls=$(($(cat calls 2>/dev/null || echo 0) + 1)); echo $calls >calls\n";

/// A folder with these commands, of which `squeue` does what it is told.
fn fake(squeue: &str) -> Place {
    let place = Place::new();
    let commands = [("sbatch", SBATCH), ("scancel", SCANCEL), ("squeue", squeue)];
    for (name, does) in commands {
        let path =
            place.write(name, format!("#!/bin/sh\ncd '{}'\n{does}", place.path("").display()));
        fs::set_permissions(&path, fs::Permissions::from_mode(0o755)).unwrap();
    }
    place
}

fn fleet(place: &Place, out: &str, options: &str) -> Command {
    let path = format!("{}:/usr/bin:/bin", place.path("").display());
    let mut fleet = place.fathom(format!("fleet slurm --shards 1 {options} --out"));
    fleet.arg(out).args(["--", "run", "uw-default"]).env("PATH", path);
    fleet
}

/// The queue shows nothing of the job, the status of an earlier one is still there, and the task ends at the fourth look.
#[test]
fn a_late_queue_and_an_earlier_status_cost_one_submission() {
    let place = fake(&format!("{COUNT}[ $calls -lt 4 ] || echo 0 41 >out/shards/1.status\n"));
    place.write("out/shards/1.status", "2 7\n");
    let told = fleet(&place, "out", "").output().unwrap();
    let told = String::from_utf8(told.stderr).unwrap();
    holds(&told, &["shard 1 is done"]);
    assert_eq!(told.matches("submitted as job").count(), 1, "{told}");
    assert_eq!(place.read("job"), "41\n");
}

/// The folder names job 13; the queue shows the fleet's own until it is cancelled.
#[test]
fn only_the_fleets_own_jobs_are_cancelled() {
    let place =
        fake("[ -e cancelled ] || [ ! -e job ] || sed -n 's/^--comment=/41|1|n1|/p' arguments\n");
    let forged = r#"{"format": 2, "shards": 1, "run": ["uw-default"], "jobs": [13]}"#;
    place.write("out/fleet.json", forged);
    let log = place.path("log");
    let running = begin(fleet(&place, "out", "--resume"), &log);
    wait_until("the task", || place.read("log").contains("runs on n1"));
    signal("-INT", running.id());
    let told = ended(running, 130, &log);
    let arguments = place.read("arguments");
    let name = arguments.lines().find_map(|line| line.strip_prefix("--job-name=")).unwrap();
    assert!(name.starts_with("fathom-"), "{name}");
    let of_pending = format!("--quiet\n--name={name}\n--state=PENDING\n41\n");
    let of_running = format!("--quiet\n--name={name}\n--batch\n--signal=TERM\n41\n");
    assert_eq!(place.read("cancelled"), of_pending + &of_running, "{told}");
}

#[test]
fn a_job_with_another_comment_is_neither_followed_nor_cancelled() {
    let place = fake("echo '13|1|n1|(null)'\n");
    let reason = "but the comment `(null)` of another: it is left alone";
    fleet(&place, "out", "").refused(reason);
    assert!(!place.path("job").exists() && !place.path("cancelled").exists());
}

#[test]
fn an_interrupt_ends_the_wait_for_a_queue_that_hangs() {
    let hangs = "[ $calls -ne 2 ] || { echo $$ >hung; exec sleep 3600; }\n";
    let place = fake(&format!("{COUNT}{hangs}"));
    let log = place.path("log");
    let running = begin(fleet(&place, "out", ""), &log);
    wait_until("a queue that hangs", || {
        fs::read(place.path("hung")).is_ok_and(|text| !text.is_empty())
    });
    signal("-INT", running.id());
    let told = ended(running, 130, &log);
    assert!(!told.contains("did not end within"), "{told}");
    assert!(!Path::new("/proc").join(place.read("hung").trim()).exists(), "{told}");
    holds(&place.read("cancelled"), &["41"]);
}

#[test]
fn folders_that_slurm_would_take_for_others_are_refused() {
    let place = fake("");
    for name in ["a\nb", "a\\b", "a\u{1b}[2J"] {
        fleet(&place, name, "").refused("a backslash or a control character");
        assert!(!place.path(name).exists() && !place.path("a").exists());
    }
}
