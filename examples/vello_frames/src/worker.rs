//! The scenes as configurations of a worker of `fathom compare`.

use std::collections::BTreeMap;
use std::error::Error;

use fathom_clock::HostClock;
use fathom_clock::record::PassKind;
use fathom_clock::record::protocol::{self, Greeting, PROTOCOL, Reply, StageKind, WorkerRequest};
use vello::Scene;

use super::{Drawing, scene};

struct Worker {
    drawing: Drawing,
    prepared: BTreeMap<String, Scene>,
    work: f64,
    counted: bool,
}

impl Worker {
    fn greeting(&self) -> Reply {
        Reply::Hello(Box::new(Greeting {
            protocol: PROTOCOL,
            fathom_version: format!("vello_frames {}", env!("CARGO_PKG_VERSION")),
            adapter: self.drawing.gpu.adapter.clone(),
            parts: vec!["time".to_owned()],
            ..Greeting::default()
        }))
    }

    /// A software driver draws in this process, so that what other processes take does not count.
    fn sample_ns(&mut self, config: &str) -> Result<f64, Box<dyn Error>> {
        let scene = self.prepared.get(config).ok_or("it is not prepared")?;
        if self.counted {
            return Ok(f64::from(scene.encoding().n_paths));
        }
        let software = self.drawing.gpu.adapter.software;
        let clock = if software { HostClock::ProcessCpu } else { HostClock::Wall };
        self.drawing.plain_ns(scene, clock)
    }

    fn answer(&mut self, request: WorkerRequest) -> Result<Reply, Box<dyn Error>> {
        match request {
            WorkerRequest::Hello { .. } => Ok(self.greeting()),
            WorkerRequest::Prepare { configuration } => {
                let scene = scene(&configuration.scene, self.work)?;
                self.prepared.insert(configuration.id.clone(), scene);
                self.sample_ns(&configuration.id)?;
                let stages = vec![StageKind { name: "vello".to_owned(), kind: PassKind::Compute }];
                Ok(Reply::Prepared { stages })
            }
            WorkerRequest::Sample { config, frames, .. } => {
                let ns = (0..frames).map(|_| self.sample_ns(&config)).collect::<Result<_, _>>()?;
                Ok(Reply::Sample { ns, machine: None })
            }
            other => Ok(other.unsupported()),
        }
    }
}

pub fn serve(work: f64, counted: bool) -> Result<(), Box<dyn Error>> {
    let (_, drawing) = Drawing::open()?;
    let mut worker = Worker { drawing, prepared: BTreeMap::new(), work, counted };
    let fault = |error: Box<dyn Error>| Reply::Fault {
        reason: error.to_string(),
        fatal: false,
        absent: false,
    };
    protocol::serve(std::io::stdin().lock(), std::io::stdout().lock(), |request| {
        worker.answer(request).unwrap_or_else(fault)
    })?;
    Ok(())
}
