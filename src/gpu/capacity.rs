//! What an adapter and the machine it runs on can take, known before anything is allocated.

use super::limits::Demand;
use fathom_record::{Adapter, Work};

/// Share of the available memory that one pipeline may take on a software adapter: the driver's own memory, compiled
/// shaders and references need some, and other processes may ask for more meanwhile.
const MEMORY_SHARE: f64 = 0.5;
/// Longest frame that is rendered, and longest that a scene is made, where the adapter is software; estimated from the work.
const LONGEST_FRAME_S: f64 = 30.0;
/// The same for a published figure, which is drawn once, at the paper's size.
const LONGEST_FIGURE_S: f64 = 180.0;
/// Host threads of the machine on which the costs below were taken.
const COST_THREADS: f64 = 2.0;
/// Costs of a unit of work on lavapipe, ns: the medians of the stages that are dominated by it, in the reference run
/// `reports/llvmpipe`. They are good enough to distinguish seconds from minutes.
const TRIANGLE_NS: f64 = 150.0;
const FRAGMENT_NS: f64 = 40.0;
const FETCH_NS: f64 = 5.5;
const BYTE_NS: f64 = 0.5;

/// Limits of an adapter, and of the machine where the adapter is software.
#[derive(Clone, Debug, Default)]
pub struct Capacity {
    pub limits: wgpu::Limits,
    /// Memory that a pipeline and the copies of its results may take, bytes; none where the adapter has its own.
    pub memory_bytes: Option<u64>,
    /// The longest frame that is rendered, seconds; none on a GPU.
    pub frame_s: Option<f64>,
    /// Fragment shaders write no storage.
    pub read_only_fragments: bool,
    /// Threads that a software adapter can use.
    pub threads: usize,
}

impl From<wgpu::Limits> for Capacity {
    /// The limits alone.
    fn from(limits: wgpu::Limits) -> Self {
        Self { limits, ..Self::default() }
    }
}

impl Capacity {
    /// The capacity of an opened adapter. With `allow_large` only its limits count.
    pub(super) fn new(limits: wgpu::Limits, adapter: &Adapter, allow_large: bool) -> Self {
        let bounded = adapter.software && !allow_large;
        let share = |bytes: u64| (bytes as f64 * MEMORY_SHARE) as u64;
        Self {
            limits,
            memory_bytes: available_bytes().filter(|_| bounded).map(share),
            frame_s: bounded.then_some(LONGEST_FRAME_S),
            threads: adapter.host_threads,
            ..Self::default()
        }
    }

    /// The same for frames of published figures.
    #[must_use]
    pub fn for_figures(&self) -> Self {
        Self { frame_s: self.frame_s.map(|_| LONGEST_FIGURE_S), ..self.clone() }
    }

    /// Fails where a demand exceeds it, with the numbers and what to do.
    pub fn check(&self, demand: &Demand) -> Result<(), String> {
        self.check_step(demand, "a frame")
    }

    /// The same for making a scene.
    pub fn check_scene(&self, demand: &Demand) -> Result<(), String> {
        self.check_step(demand, "making the scene")
    }

    fn check_step(&self, demand: &Demand, step: &str) -> Result<(), String> {
        demand.check(self)?;
        self.check_memory(demand)?;
        self.check_time(demand, step)
    }

    fn check_memory(&self, demand: &Demand) -> Result<(), String> {
        let asked = demand.bytes();
        match (self.memory_bytes, demand.largest()) {
            (Some(allowed), Some((what, bytes))) if asked > allowed => Err(format!(
                "{what}: asks {} of {} of memory; a software adapter takes it from the process, which may have {} (half of \
                 what is available): make it smaller, or give --allow-large",
                gibibytes(bytes),
                gibibytes(asked),
                gibibytes(allowed)
            )),
            _ => Ok(()),
        }
    }

    fn check_time(&self, demand: &Demand, step: &str) -> Result<(), String> {
        let costs = demand.work().iter();
        let times = costs.map(|(what, work)| (what, self.time_s(work)));
        let times: Vec<(&String, f64)> = times.collect();
        let frame_s: f64 = times.iter().map(|(_, time_s)| time_s).sum();
        let longest = times.iter().max_by(|a, b| a.1.total_cmp(&b.1));
        match (self.frame_s, longest) {
            (Some(allowed_s), Some((what, _))) if frame_s > allowed_s => Err(format!(
                "{what}: {step} would take about {} on this software adapter, which is given {allowed_s:.0} s: make it smaller, \
                 or give --allow-large",
                duration(frame_s)
            )),
            _ => Ok(()),
        }
    }

    /// Rough time of a frame on a software adapter, seconds.
    pub fn frame_time_s(&self, demand: &Demand) -> f64 {
        demand.work().iter().map(|(_, work)| self.time_s(work)).sum()
    }

    /// Rough time of this work on a software adapter, seconds.
    fn time_s(&self, work: &Work) -> f64 {
        let costs = [
            (work.triangles, TRIANGLE_NS),
            (work.fragments, FRAGMENT_NS),
            (work.texel_fetches, FETCH_NS),
            (work.bytes_read.saturating_add(work.bytes_written), BYTE_NS),
        ];
        let ns: f64 = costs.iter().map(|(count, ns)| *count as f64 * ns).sum();
        ns * 1e-9 * COST_THREADS / self.threads.max(1) as f64
    }
}

fn gibibytes(bytes: u64) -> String {
    format!("{:.1} GiB", bytes as f64 / f64::from(1 << 30))
}

/// To one significant digit: the estimate is no better.
fn duration(seconds: f64) -> String {
    let (value, unit) = match seconds {
        s if s < 120.0 => (s, "s"),
        s if s < 7200.0 => (s / 60.0, "minutes"),
        s => (s / 3600.0, "hours"),
    };
    let scale = 10_f64.powf(value.log10().floor());
    format!("{:.0} {unit}", (value / scale).round() * scale)
}

/// Memory that a process can take without swapping, within the limit of its control group; known on Linux only.
#[cfg(target_os = "linux")]
fn available_bytes() -> Option<u64> {
    use procfs::Current;
    let machine = procfs::Meminfo::current().ok()?.mem_available?;
    let number = |path: &str| std::fs::read_to_string(path).ok()?.trim().parse::<u64>().ok();
    let group = number("/sys/fs/cgroup/memory.max")
        .zip(number("/sys/fs/cgroup/memory.current"))
        .map(|(max, current)| max.saturating_sub(current));
    Some(group.map_or(machine, |group| group.min(machine)))
}

#[cfg(not(target_os = "linux"))]
fn available_bytes() -> Option<u64> {
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    fn software() -> Capacity {
        Capacity {
            memory_bytes: Some(4 << 30),
            frame_s: Some(30.0),
            threads: 2,
            ..Capacity::default()
        }
    }

    #[test]
    fn memory_beyond_the_budget_names_the_largest_part_and_what_to_do() {
        let mut demand = Demand::new();
        demand
            .holds("shadow.size", 1 << 30)
            .holds("view.width × view.height", 2 << 30)
            .copies("view.width × view.height", 2 << 30);
        let message = software().check(&demand).unwrap_err();
        assert_eq!(
            message,
            "view.width × view.height: asks 4.0 GiB of 5.0 GiB of memory; a software adapter takes it from the process, which \
             may have 4.0 GiB (half of what is available): make it smaller, or give --allow-large"
        );
        let limits_alone = Capacity::from(wgpu::Limits::default());
        assert_eq!(limits_alone.check(&demand), Ok(()));
        assert_eq!(software().check(Demand::new().holds("a", 4 << 30)), Ok(()));
        let mut endless = Demand::new();
        assert!(software().check(endless.holds("a", u64::MAX).copies("a", u64::MAX)).is_err());
    }

    #[test]
    fn a_frame_of_minutes_is_foreseen() {
        let fetches = |texel_fetches| Work { texel_fetches, ..Work::default() };
        let mut demand = Demand::new();
        demand.takes("ao.rays", fetches(60_000_000_000)).takes("filter", fetches(1_000));
        let message = software().check(&demand).unwrap_err();
        assert_eq!(
            message,
            "ao.rays: a frame would take about 6 minutes on this software adapter, which is given 30 s: make it smaller, or \
             give --allow-large"
        );
        let many_cores = Capacity { threads: 64, ..software() };
        assert_eq!(many_cores.check(&demand), Ok(()));
        let mut more = Demand::new();
        assert_eq!(software().check(more.takes("ao.rays", fetches(1_000_000_000))), Ok(()));
    }
}
