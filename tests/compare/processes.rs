//! What builds start beside their answers.

use std::fs;
use std::path::Path;

use super::builds::Builds;
use super::common::{Ends, wait_until};
use super::script::{Script, hello, sample};

/// A greeting that first starts a process in a session of its own and writes its number down.
fn forking(log: &Path) -> String {
    let (log, greeting) = (log.display(), hello(1, r#""exact","checks","time""#));
    format!(
        "(setsid sh -c 'echo $$ >>{log}; exec sleep 3600' >/dev/null 2>&1 &)\n\
         while [ ! -e {log} ]; do sleep 0.01; done; {greeting}"
    )
}

fn is_any_left(log: &Path) -> bool {
    let numbers = fs::read_to_string(log).unwrap();
    numbers.lines().any(|number| Path::new("/proc").join(number).exists())
}

#[cfg(target_os = "linux")]
#[test]
fn processes_that_a_base_forked_do_not_outlive_fathom() {
    let builds = Builds::without_builds();
    let log = builds.path("log");
    builds.build("base", &Script { hello: forking(&log), ..Script::default() });
    let sample = sample("200");
    let held = format!("{}; {sample}", builds.waits());
    let instead = [("\"sample\"", held.as_str())];
    builds.build("head", &Script { instead: &instead, ..Script::default() });
    builds.release();
    builds.command("").ends(0);
    assert!(!is_any_left(&log));

    // However fathom ends.
    fs::remove_file(&log).unwrap();
    fs::remove_dir_all(builds.path("out")).unwrap();
    builds.hold();
    let mut running = builds.command("").spawn().unwrap();
    wait_until("a forked process", || log.exists());
    running.kill().unwrap();
    running.wait().unwrap();
    wait_until("the end of what was forked", || !is_any_left(&log));
}
