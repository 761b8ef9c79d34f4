//! Stages alone in a frame: what a worker of `fathom compare` measures.
//!
//! On a software adapter a time is the CPU time that the process spends from the submission to the fence: the process *is* the GPU
//! there, timestamps of such drivers miss work (see the audit), and what other processes took from its core is not the stage's. On
//! a hardware adapter it is the audited clock's.

use super::{Device, DeviceError, FrameTimer, MachineReader, StageTime, TimedStage, audit};
use fathom_record::protocol::Reply;
use fathom_record::{ClockPlan, SubmitCost};

/// Readings of a frame before its clock is given up.
const ATTEMPTS: u32 = 20;

/// The clock of a worker. It is asked by the worker protocol ([`fathom_record::protocol`]).
pub struct StageClock {
    pub timer: FrameTimer,
    max_passes: u32,
    /// Clocks, temperature and what holds them down, where a driver tells.
    machine: Option<MachineReader>,
    /// The hardware's clock has been audited, here or in another worker.
    audited: bool,
}

impl StageClock {
    /// A clock for stages of at most `max_passes` passes, by the plan that `hello` has.
    pub fn new(
        gpu: &Device,
        known: Option<ClockPlan>,
        max_passes: u32,
    ) -> Result<Self, DeviceError> {
        let plan = known.unwrap_or(ClockPlan::fenced(SubmitCost::default()));
        Ok(Self {
            timer: FrameTimer::new(gpu, plan, max_passes)?,
            max_passes,
            machine: MachineReader::open(&gpu.adapter),
            audited: known.is_some() || gpu.adapter.software,
        })
    }

    /// The plan, after an audit where none was made. It answers `clock`.
    pub fn plan(&mut self, gpu: &Device) -> Result<ClockPlan, DeviceError> {
        if !self.audited {
            self.timer = FrameTimer::new(gpu, audit(gpu)?.plan, self.max_passes)?;
            self.audited = true;
        }
        Ok(self.timer.plan())
    }

    /// Times of so many frames with this stage alone. Answers `sample`. Stages `before` it, which fill inputs that it spends, run
    /// before each, untimed.
    pub fn sample<S: TimedStage + ?Sized>(
        &mut self,
        gpu: &Device,
        before: &[&S],
        stage: &S,
        frames: u32,
    ) -> Result<Reply, DeviceError> {
        self.plan(gpu)?;
        let read = |_| self.reading(gpu, before, stage);
        let ns = (0..frames).map(read).collect::<Result<_, _>>()?;
        let machine = self.machine.as_ref().and_then(MachineReader::read);
        Ok(Reply::Sample { ns, machine: machine.map(Box::new) })
    }

    /// Time of one frame. Readings that cannot be true are taken again.
    fn reading<S: TimedStage + ?Sized>(
        &mut self,
        gpu: &Device,
        before: &[&S],
        stage: &S,
    ) -> Result<f64, DeviceError> {
        let mut last = String::new();
        for _ in 0..ATTEMPTS {
            if !before.is_empty() {
                self.timer.run_stages(gpu, before)?;
            }
            if gpu.adapter.software {
                let time = self.timer.on_host(gpu, &[stage])?;
                let ns = time.process_ns.unwrap_or(time.wall_ns);
                if ns > 0.0 {
                    return Ok(ns);
                }
                last = format!("{ns} ns");
            } else {
                let sample = self.timer.time_stages(gpu, &[stage])?;
                match sample.faults.first() {
                    None => return check_resolved(&sample.stages[0]),
                    Some(fault) => last = fault.to_string(),
                }
            }
        }
        let name = stage.name();
        Err(DeviceError::Internal(format!(
            "{name}: no acceptable reading of the clock in {ATTEMPTS} frames; the last: {last}"
        )))
    }
}

/// The stage's time; an error where it is below what the clock can tell from none, as a ratio of such times says nothing.
fn check_resolved(sample: &StageTime) -> Result<f64, DeviceError> {
    if sample.is_resolved() {
        return Ok(sample.ns);
    }
    Err(DeviceError::Internal(format!(
        "{}: shorter than the fenced host clock's resolution of {:.3} ms: choose a larger configuration",
        sample.stage,
        sample.resolution_ns * 1e-6
    )))
}
