//! Work of the CPU alone, on other cores while a hardware adapter measures. A software driver needs the cores itself: there are no
//! workers then, and what is handed over is done at once.

use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::mpsc::{self, Receiver, RecvTimeoutError, Sender};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

type Task<T> = Box<dyn FnOnce() -> T + Send>;

/// Tasks on their way, and what those that are done have given.
pub struct Beside<T> {
    tasks: Sender<Task<T>>,
    done: Receiver<(thread::Result<T>, f64)>,
    workers: usize,
    pending: usize,
    /// Of the tasks that are done: how many, and their time, seconds.
    finished: (usize, f64),
}

impl<T: Send + 'static> Beside<T> {
    /// Threads that live as long as this. References are computed by rayon's own threads, so that one may wait for another's answer.
    pub fn new(workers: usize) -> Self {
        let (tasks, waiting) = mpsc::channel::<Task<T>>();
        let (sender, done) = mpsc::channel();
        let waiting = Arc::new(Mutex::new(waiting));
        for _ in 0..workers {
            let (waiting, sender) = (Arc::clone(&waiting), sender.clone());
            let next = move || waiting.lock().unwrap_or_else(PoisonError::into_inner).recv();
            thread::spawn(move || {
                while let Ok(task) = next() {
                    let start = Instant::now();
                    let result = catch_unwind(AssertUnwindSafe(task));
                    // Nobody waits for what comes after the end of the run.
                    let _ = sender.send((result, start.elapsed().as_secs_f64()));
                }
            });
        }
        Self { tasks, done, workers, pending: 0, finished: (0, 0.0) }
    }

    /// Hands a task over; what it gives, where there are no workers.
    pub fn run(&mut self, task: impl FnOnce() -> T + Send + 'static) -> Option<T> {
        if self.workers == 0 {
            return Some(task());
        }
        self.pending += 1;
        self.tasks.send(Box::new(task)).expect("workers end with this");
        None
    }

    /// What a task has given, if one is done within this time. A panic of it goes on here.
    pub fn next(&mut self, within: Duration) -> Option<T> {
        match self.done.recv_timeout(if self.pending > 0 { within } else { Duration::ZERO }) {
            Ok((result, took_s)) => {
                self.pending -= 1;
                self.finished = (self.finished.0 + 1, self.finished.1 + took_s);
                Some(result.unwrap_or_else(|panic| resume_unwind(panic)))
            }
            Err(RecvTimeoutError::Timeout | RecvTimeoutError::Disconnected) => None,
        }
    }

    pub fn is_idle(&self) -> bool {
        self.pending == 0
    }

    /// Foreseen until all is done that was handed over, seconds.
    pub fn backlog_s(&self) -> f64 {
        backlog_s(self.pending, self.workers, self.finished)
    }
}

/// Of tasks that take as long as those that are finished: how many, and their time.
pub fn backlog_s(pending: usize, workers: usize, (finished, took_s): (usize, f64)) -> f64 {
    pending.div_ceil(workers.max(1)) as f64 * took_s / finished.max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_task_is_done_once_and_a_panic_goes_on_where_it_is_waited_for() {
        for workers in [0, 1, 3] {
            let mut beside = Beside::new(workers);
            let at_once: Vec<u32> = (0..20).filter_map(|n| beside.run(move || n)).collect();
            assert_eq!(at_once.len(), if workers == 0 { 20 } else { 0 });
            let mut later = Vec::new();
            while !beside.is_idle() {
                later.extend(beside.next(Duration::from_secs(1)));
            }
            later.extend(at_once);
            later.sort_unstable();
            assert_eq!(later, (0..20).collect::<Vec<_>>());
        }
        let mut beside = Beside::<u32>::new(1);
        beside.run(|| panic!("in a task"));
        let waited = catch_unwind(AssertUnwindSafe(|| beside.next(Duration::MAX)));
        assert_eq!(waited.unwrap_err().downcast_ref(), Some(&"in a task"));
        assert_eq!(
            [(9, 3), (10, 3), (4, 0)].map(|(n, of)| backlog_s(n, of, (2, 1.0))),
            [1.5, 2.0, 2.0]
        );
    }
}
