//! Other work on the machine while a gate runs.

use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

use fathom::process::ProcessTree;

/// A process that runs `fathom verify`, rendering and casting rays, over and over, and keeps a core busy: of two, the one that
/// is left or the one that is measured on. It ends when this is dropped.
pub struct Load {
    stopped: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Load {
    pub fn start(program: &Path) -> Self {
        let stopped = Arc::new(AtomicBool::new(false));
        let (seen, program) = (Arc::clone(&stopped), program.to_owned());
        let thread = std::thread::spawn(move || {
            while !seen.load(Ordering::Relaxed) {
                keep_busy(&program, &seen);
            }
        });
        Self { stopped, thread: Some(thread) }
    }
}

impl Drop for Load {
    fn drop(&mut self) {
        self.stopped.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
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
        .env("LP_NUM_THREADS", "0")
        .env("RAYON_NUM_THREADS", "1")
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null());
    let Ok(mut tree) = ProcessTree::spawn(&mut command) else {
        return std::thread::sleep(Duration::from_millis(100));
    };
    while matches!(tree.status_within(Duration::from_millis(20)), Ok(None)) {
        if stopped.load(Ordering::Relaxed) {
            return;
        }
    }
}
