//! Conditions that keep the noise of a software driver down. A GPU needs none of them.

use std::process::Command;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::machine::Machine;
use crate::private;

pub use system::{allowed_cores, pin, randomized};

/// How the names of variables begin that fathom hands from one of its processes to another.
const OWN: &str = "FATHOM_";
/// Variable that pads a worker's environment, and with it moves its stack.
pub const PADDING: &str = "FATHOM_PADDING";
/// A page, over which the stack's place repeats itself for the caches.
pub const PADDING_BYTES: usize = 4096;
/// Variable in which a process that has begun again finds the cores that it could run on before.
const CORES: &str = "FATHOM_CORES";
/// Variable with the threads of Mesa's rasterizer. With none it works in the thread that submits. Other drivers ignore it.
const RASTERIZER_THREADS: &str = "LP_NUM_THREADS";
/// Bytes of a large page of most systems.
const LARGE_PAGE: usize = 2 << 20;
/// By how much each byte of padding moves the heap: all together by a large page, by lines of the caches and by parts of them.
const HEAP_BYTES: usize = 512 + 16;
/// Variable with the settings of the C library.
const TUNABLES: &str = "GLIBC_TUNABLES";
/// The C library keeps what is freed: a driver that gives memory back after each frame and asks for it in the next waits for
/// the kernel to clear it, for up to 0.4 of a stage's time in one process and not at all in another. Blocks beyond 32 MiB,
/// the most that can be set, still come from the kernel.
const MEMORY: &str = "glibc.malloc.arena_max=1:glibc.malloc.mmap_threshold=33554432:\
    glibc.malloc.trim_threshold=1073741824";

/// The conditions of a quiet worker.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Quiet {
    /// The only core that the worker may run on.
    pub core: Option<usize>,
    /// Bytes in the variable `FATHOM_PADDING`, fewer than a page, drawn for each launch and the same on both of its sides: a
    /// build's layout by chance becomes noise between launches and no bias, and equal builds have equal layouts.
    pub padding: usize,
    /// Freed memory stays with the process. Use for timing only: it shifts instruction counts by 0.6 %, as all threads then
    /// share what is free.
    pub keep_memory: bool,
}

/// Sets what a child inherits. What the kernel refuses shows in a worker's greeting.
pub fn apply(command: &mut Command, quiet: &Quiet) {
    command.env(RASTERIZER_THREADS, "0");
    if quiet.keep_memory {
        command.env(TUNABLES, MEMORY);
    }
    command.env(PADDING, "x".repeat(quiet.padding));
    system::prepare(command, quiet.core);
}

/// Whether fathom sets this variable itself where it measures: a value of the user's would undo the conditions of both sides.
pub fn is_own(variable: &str) -> bool {
    variable.starts_with(OWN) || [RASTERIZER_THREADS, TUNABLES].contains(&variable)
}

/// Conditions under which a process measures.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Conditions {
    /// Cores that the driver may run on; empty where that is not known.
    pub cores: Vec<usize>,
    /// Threads that Mesa's rasterizer has beside the one that submits, if that was set.
    pub rasterizer_threads: Option<String>,
    /// Whether addresses are randomized, if that is known.
    pub randomized: Option<bool>,
    /// A digest of the machine's id and host name.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub host: Option<String>,
    /// The computer. Absent on systems other than Linux.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub machine: Option<Machine>,
}

impl Conditions {
    pub fn detect() -> Self {
        Self {
            cores: allowed_cores(),
            rasterizer_threads: std::env::var(RASTERIZER_THREADS).ok(),
            randomized: randomized(),
            host: private::machine(),
            machine: Machine::detect(),
        }
    }
}

/// Starts this program again, in this process and with the same arguments: pinned to one core, with a rasterizer in the thread
/// that submits, freed memory kept and addresses not randomized. Returns where the system cannot do that, in the program that was
/// started so, and where the user has set the rasterizer's threads: then the conditions are the user's.
pub fn begin_again() {
    if [CORES, RASTERIZER_THREADS].iter().any(|name| std::env::var_os(name).is_some()) {
        return;
    }
    let cores = allowed_cores();
    // Programs that are started at the same time spread over the cores.
    let place = std::process::id() as usize % cores.len().max(1);
    let (Some(core), Ok(program)) = (cores.get(place), std::env::current_exe()) else {
        return;
    };
    let mut command = Command::new(program);
    command.args(std::env::args_os().skip(1));
    command.env(RASTERIZER_THREADS, "0");
    if std::env::var_os(TUNABLES).is_none() {
        command.env(TUNABLES, MEMORY);
    }
    let list: Vec<String> = cores.iter().map(ToString::to_string).collect();
    command.env(CORES, list.join(","));
    system::replace(command, *core);
}

/// The cores that this program could run on before it began again, else now.
pub fn cores_before() -> Vec<usize> {
    let Ok(list) = std::env::var(CORES) else { return allowed_cores() };
    list.split(',').filter_map(|core| core.parse().ok()).collect()
}

/// Lets the calling thread run on all cores that the program could run on before it began again.
pub fn use_all_cores() {
    system::allow(&cores_before());
}

/// In a worker, before it does anything: what it will allocate begins so far behind the boundary of a large page, wherever the
/// program's own data end. When only the stack was moved, a build with an unrelated function was 1.9 % faster than its base in one
/// stage and 1.2 % in another, gate after gate.
pub fn pad_heap() {
    let Some(padding) = std::env::var_os(PADDING) else {
        return;
    };
    let probe = Vec::<u8>::with_capacity(LARGE_PAGE);
    let beyond = probe.as_ptr() as usize % LARGE_PAGE;
    drop(std::hint::black_box(probe));
    let block = Vec::<u8>::with_capacity(LARGE_PAGE - beyond + padding.len() * HEAP_BYTES);
    std::mem::forget(std::hint::black_box(block));
}

#[cfg(target_os = "linux")]
mod system {
    use std::os::unix::process::CommandExt;
    use std::process::Command;

    use nix::sched::{CpuSet, sched_getaffinity, sched_setaffinity};
    use nix::sys::personality::{self, Persona};
    use nix::unistd::Pid;

    /// The program will find its addresses not randomized, and itself on one core if one is named.
    pub fn prepare(command: &mut Command, core: Option<usize>) {
        let core = core.and_then(single_core);
        let prepare = move || {
            if let Ok(persona) = personality::get() {
                let _ = personality::set(persona | Persona::ADDR_NO_RANDOMIZE);
            }
            if let Some(core) = &core {
                let _ = sched_setaffinity(Pid::from_raw(0), core);
            }
            Ok(())
        };
        // SAFETY: only system calls are made; nothing is allocated and no lock is taken.
        unsafe {
            command.pre_exec(prepare);
        }
    }

    /// Becomes this program; returns only where that fails.
    pub fn replace(mut command: Command, core: usize) {
        prepare(&mut command, Some(core));
        // It is called what the user called it.
        command.arg0(std::env::args_os().next().unwrap_or_default());
        // Whatever the reason is, the program goes on without it, and its records say so.
        let _ = command.exec();
    }

    /// Lets the calling thread run on these cores.
    pub fn allow(cores: &[usize]) {
        let mut set = CpuSet::new();
        let pinned = cores.iter().filter(|core| set.set(**core).is_ok()).count();
        if pinned > 0 {
            let _ = sched_setaffinity(Pid::from_raw(0), &set);
        }
    }

    /// Moves all threads of a process to one core.
    pub fn pin(process: u32, core: usize) {
        let Some(set) = single_core(core) else { return };
        let Ok(tasks) = std::fs::read_dir(format!("/proc/{process}/task")) else {
            return;
        };
        let names = tasks.flatten().map(|task| task.file_name());
        for thread in names.filter_map(|name| name.to_str()?.parse().ok()) {
            // One that has just ended needs no core.
            let _ = sched_setaffinity(Pid::from_raw(thread), &set);
        }
    }

    /// Cores that this process may run on; empty where that is not known.
    pub fn allowed_cores() -> Vec<usize> {
        let Ok(set) = sched_getaffinity(Pid::from_raw(0)) else { return Vec::new() };
        (0..CpuSet::count()).filter(|core| set.is_set(*core).unwrap_or(false)).collect()
    }

    /// This process's addresses are randomized.
    pub fn randomized() -> Option<bool> {
        let persona = personality::get().ok()?;
        Some(!persona.contains(Persona::ADDR_NO_RANDOMIZE))
    }

    fn single_core(core: usize) -> Option<CpuSet> {
        let mut set = CpuSet::new();
        set.set(core).ok().map(|()| set)
    }
}

#[cfg(not(target_os = "linux"))]
mod system {
    use std::process::Command;

    pub fn prepare(_: &mut Command, _: Option<usize>) {}

    pub fn replace(_: Command, _: usize) {}

    pub fn allow(_: &[usize]) {}

    pub fn pin(_: u32, _: usize) {}

    pub fn allowed_cores() -> Vec<usize> {
        Vec::new()
    }

    pub fn randomized() -> Option<bool> {
        None
    }
}
