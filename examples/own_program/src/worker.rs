//! The same program as a worker of `fathom compare`, by the worker protocol (`docs/worker-protocol.md`).

#[expect(dead_code, reason = "a stage opens the render pass by its scope")]
mod passes;

use std::collections::BTreeMap;
use std::error::Error;

use fathom_clock::record::PassKind;
use fathom_clock::record::protocol::{
    GateConfiguration, Greeting, PROTOCOL, Reply, StageKind, WorkerRequest, serve,
};
use fathom_clock::{
    ClockPlan, ColorTarget, Device, Drawing, StageClock, StageScope, Targets, TimedStage,
};
use passes::Passes;

const STAGES: [(&str, PassKind); 3] =
    [("ripple", PassKind::Compute), ("blur", PassKind::Compute), ("shade", PassKind::Render)];

/// A pass of the program. It reads what the passes before have left.
struct PassStage<'a> {
    name: &'static str,
    passes: &'a Passes,
}

impl TimedStage for PassStage<'_> {
    fn name(&self) -> &'static str {
        self.name
    }

    fn encode(&self, scope: &mut StageScope<'_>) {
        match self.name {
            "ripple" => scope.compute(|pass| self.passes.ripple(pass)),
            "blur" => scope.compute(|pass| self.passes.blur(pass)),
            _ => {
                let (view, clear) = (&self.passes.picture, Some(wgpu::Color::BLACK));
                let color = [ColorTarget { view, clear, slice: None, drawing: Drawing::Opaque }];
                let targets = Targets { color: &color, depth: None };
                scope.render(&targets, |pass| self.passes.shade(pass));
            }
        }
    }
}

struct Worker {
    gpu: Device,
    clock: StageClock,
    prepared: BTreeMap<String, Passes>,
}

impl Worker {
    fn open(plan: Option<ClockPlan>) -> Result<Self, Box<dyn Error>> {
        let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
        let adapter = pollster::block_on(instance.request_adapter(&Default::default()))?;
        let required_features = fathom_clock::features(&adapter);
        let descriptor = wgpu::DeviceDescriptor { required_features, ..Default::default() };
        let (device, queue) = pollster::block_on(adapter.request_device(&descriptor))?;
        let gpu = Device::new(&adapter, device, queue);
        let clock = StageClock::new(&gpu, plan, 1)?;
        Ok(Self { gpu, clock, prepared: BTreeMap::new() })
    }

    fn greeting(&self) -> Reply {
        Reply::Hello(Box::new(Greeting {
            protocol: PROTOCOL,
            fathom_version: format!("own_program {}", env!("CARGO_PKG_VERSION")),
            adapter: self.gpu.adapter.clone(),
            parts: vec!["time".to_owned()],
            ..Greeting::default()
        }))
    }

    fn prepare(&mut self, configuration: GateConfiguration) -> Result<Reply, Box<dyn Error>> {
        let taps = configuration.params.get("taps").and_then(|taps| taps.as_u64()).unwrap_or(16);
        let passes = Passes::new(&self.gpu.device, &self.gpu.queue, u32::try_from(taps)?);
        let stages = STAGES.map(|(name, _)| PassStage { name, passes: &passes });
        self.clock.timer.run_stages(&self.gpu, &stages.each_ref())?;
        self.prepared.insert(configuration.id, passes);
        let stages = STAGES.map(|(name, kind)| StageKind { name: name.to_owned(), kind });
        Ok(Reply::Prepared { stages: stages.into() })
    }

    fn sample(&mut self, config: &str, name: &str, frames: u32) -> Result<Reply, Box<dyn Error>> {
        let passes = self.prepared.get(config).ok_or("it is not prepared")?;
        let (name, _) =
            STAGES.into_iter().find(|(known, _)| *known == name).ok_or("no such stage")?;
        Ok(self.clock.sample(&self.gpu, &[], &PassStage { name, passes }, frames)?)
    }
}

fn answer(open: &mut Option<Worker>, request: WorkerRequest) -> Result<Reply, Box<dyn Error>> {
    if let WorkerRequest::Hello { clock, .. } = request {
        return Ok(open.insert(Worker::open(clock)?).greeting());
    }
    let worker = open.as_mut().ok_or("the first message must be `hello`")?;
    match request {
        WorkerRequest::Clock => Ok(Reply::Clock { clock: worker.clock.plan(&worker.gpu)? }),
        WorkerRequest::Prepare { configuration } => worker.prepare(configuration),
        WorkerRequest::Sample { config, stage, frames } => worker.sample(&config, &stage, frames),
        other => Ok(other.unsupported()),
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut open = None;
    let fault = |error: Box<dyn Error>| Reply::Fault {
        reason: error.to_string(),
        fatal: false,
        absent: false,
    };
    serve(std::io::stdin().lock(), std::io::stdout().lock(), |request| {
        answer(&mut open, request).unwrap_or_else(fault)
    })?;
    Ok(())
}
