//! Other work on the machine while a gate runs.

use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

use crate::compare::launch::allowed_cores;

/// One process for each core runs `fathom verify`, rendering and casting rays, over and over. They end when this is
/// dropped.
pub struct Load {
    stopped: Arc<AtomicBool>,
    threads: Vec<JoinHandle<()>>,
}

impl Load {
    pub fn start(program: &Path) -> Self {
        let stopped = Arc::new(AtomicBool::new(false));
        let processes = allowed_cores().len().max(1);
        let threads = (0..processes).map(|_| {
            let (stopped, program) = (Arc::clone(&stopped), program.to_owned());
            std::thread::spawn(move || {
                while !stopped.load(Ordering::Relaxed) {
                    keep_busy(&program, &stopped);
                }
            })
        });
        Self {
            threads: threads.collect(),
            stopped,
        }
    }
}

impl Drop for Load {
    fn drop(&mut self) {
        self.stopped.store(true, Ordering::Relaxed);
        for thread in self.threads.drain(..) {
            // A thread that panicked has no process left.
            let _ = thread.join();
        }
    }
}

/// Until the process ends, or is to end.
fn keep_busy(program: &Path, stopped: &AtomicBool) {
    let mut command = Command::new(program);
    command
        .arg("verify")
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null());
    let Ok(mut child) = command.spawn() else {
        return std::thread::sleep(Duration::from_millis(100));
    };
    while running(&mut child) {
        if stopped.load(Ordering::Relaxed) {
            // It may have ended by itself.
            let _ = child.kill();
            let _ = child.wait();
            return;
        }
        std::thread::sleep(Duration::from_millis(20));
    }
}

fn running(child: &mut Child) -> bool {
    matches!(child.try_wait(), Ok(None))
}
