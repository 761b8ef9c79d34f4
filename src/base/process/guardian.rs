//! A process between this one and a command, which ends all that the command has started.
//!
//! It is a fork of this process that only waits. Orphans among its descendants become its children
//! (`prctl(2)`, `PR_SET_CHILD_SUBREAPER`), also those in sessions of their own. When the command has ended, when the
//! thread that started it is gone, or when it is asked to, it kills its children until there are none, and then ends
//! as the command did.
//!
//! Between fork and end it makes calls of the system only: it allocates nothing and takes no lock.

use std::io;
use std::os::unix::process::CommandExt;
use std::process::Command;

use nix::libc::{self, c_int, pid_t};
use nix::sys::prctl;
use nix::sys::signal::{SigSet, Signal, kill};
use nix::unistd::{ForkResult, Pid, fork, setpgid};

/// Asks it to end all. It gets the same where its parent is gone.
const END: Signal = Signal::SIGTERM;
/// `proc_pid_task_children(5)`: the children of the calling thread, the oldest first.
const CHILDREN: &std::ffi::CStr = c"/proc/thread-self/children";
/// Added to a signal's number in an exit status, as shells do.
const SIGNALLED: c_int = 128;

/// Puts a guardian before this command.
pub fn set(command: &mut Command) {
    let parent = std::process::id();
    // SAFETY: only system calls are made; nothing is allocated and no lock is taken.
    unsafe {
        command.pre_exec(move || part(parent));
    }
}

/// The process of the command that this guardian has started, while there is one.
pub fn guarded_child(guardian: u32) -> Option<u32> {
    let children = format!("/proc/{guardian}/task/{guardian}/children");
    std::fs::read_to_string(children).ok()?.split(' ').next()?.parse().ok()
}

/// Asks a guardian that was not yet waited for to end all.
pub fn end(guardian: u32) {
    if let Ok(guardian) = i32::try_from(guardian) {
        let _ = kill(Pid::from_raw(guardian), END);
    }
}

/// Returns in the command's process; the guardian stays here.
fn part(parent: u32) -> io::Result<()> {
    let before = SigSet::thread_get_mask()?;
    SigSet::all().thread_block()?;
    prctl::set_pdeathsig(END)?;
    if u32::try_from(Pid::parent().as_raw()) != Ok(parent) {
        return Err(io::ErrorKind::Interrupted.into());
    }
    prctl::set_child_subreaper(true)?;
    // SAFETY: see above.
    match unsafe { fork() }? {
        ForkResult::Parent { child } => guard(child),
        ForkResult::Child => {
            prctl::set_pdeathsig(Signal::SIGKILL)?;
            setpgid(Pid::from_raw(0), Pid::from_raw(0))?;
            Ok(before.thread_set_mask()?)
        }
    }
}

fn guard(command: Pid) -> ! {
    close_all();
    let _ = prctl::set_name(c"fathom-guard");
    let status = exit_status(command.as_raw());
    while each_child(kill_one) && poll_child(0).is_some() {}
    leave(status)
}

/// The command's status; none where it is to be killed.
fn exit_status(command: pid_t) -> Option<c_int> {
    let mut awaited = SigSet::empty();
    awaited.add(Signal::SIGCHLD);
    awaited.add(END);
    loop {
        match poll_child(libc::WNOHANG)? {
            (0, _) if awaited.wait() == Ok(END) => return None,
            (child, status) if child == command => return Some(status),
            // An orphan has ended, or a child may have.
            _ => {}
        }
    }
}

/// A child that has ended and its status, number 0 where none has; none where there is no child.
fn poll_child(options: c_int) -> Option<(pid_t, c_int)> {
    let mut status = 0;
    // SAFETY: the status lies on the stack.
    let child = unsafe { libc::waitpid(-1, &mut status, options) };
    (child >= 0).then_some((child, status))
}

fn kill_one(child: pid_t) {
    let _ = kill(Pid::from_raw(child), Signal::SIGKILL);
}

/// False where the system does not tell them, or there is none.
fn each_child(act: impl Fn(pid_t)) -> bool {
    let mut digits = [0u8; 4096];
    let (mut number, mut any) = (0, false);
    // SAFETY: the name ends with a NUL, and no more is read than the buffer holds.
    let file = unsafe { libc::open(CHILDREN.as_ptr(), libc::O_RDONLY | libc::O_CLOEXEC) };
    loop {
        // SAFETY: as above. A file that could not be opened cannot be read.
        let read = unsafe { libc::read(file, digits.as_mut_ptr().cast(), digits.len()) };
        let Some(read) = usize::try_from(read).ok().filter(|read| *read > 0) else { break };
        for byte in digits.iter().take(read) {
            if byte.is_ascii_digit() {
                number = number * 10 + pid_t::from(*byte - b'0');
            } else if number > 0 {
                act(std::mem::take(&mut number));
                any = true;
            }
        }
    }
    // SAFETY: it is this function's own.
    unsafe { libc::close(file) };
    any
}

/// Lets go of every file of this process: pipes, which would not end, and locks of folders.
fn close_all() {
    // SAFETY: nothing of this process is used any more that has a file.
    unsafe {
        // Linux 5.9.
        if libc::syscall(libc::SYS_close_range, 0, libc::c_uint::MAX, 0) < 0 {
            let most = libc::sysconf(libc::_SC_OPEN_MAX).clamp(1024, 1 << 20);
            for file in 0..most as c_int {
                libc::close(file);
            }
        }
    }
}

/// Ends as the command did, but writes no second core.
fn leave(status: Option<c_int>) -> ! {
    let signal = match status {
        Some(status) if libc::WIFEXITED(status) => {
            // SAFETY: it does not return.
            unsafe { libc::_exit(libc::WEXITSTATUS(status)) }
        }
        Some(status) => libc::WTERMSIG(status),
        None => libc::SIGKILL,
    };
    let none = libc::rlimit { rlim_cur: 0, rlim_max: 0 };
    // SAFETY: the set and the limit lie on the stack.
    unsafe {
        libc::setrlimit(libc::RLIMIT_CORE, &none);
        libc::signal(signal, libc::SIG_DFL);
        let mut set = std::mem::zeroed();
        libc::sigemptyset(&mut set);
        libc::sigaddset(&mut set, signal);
        libc::sigprocmask(libc::SIG_UNBLOCK, &set, std::ptr::null_mut());
        libc::kill(libc::getpid(), signal);
        libc::_exit(SIGNALLED + signal)
    }
}
