//! GPU benchmark of published real-time rendering pipelines, on a clock that is audited first.
//!
//! The program is [`cli::main`] over a [`Catalog`]. A crate of one's own adds its pipelines, shaders, scenes, experiments, checks
//! and gate cells to the catalogue, and has every command over them: `examples/own_pipeline` is such a crate. Underneath:
//!
//! ```no_run
//! use fathom::Catalog;
//! use fathom::gpu::{FrameTimer, Gpu, Options, audit};
//! use fathom::harness::MAX_PASSES;
//! use fathom::harness::subject::Subjects;
//!
//! let gpu = Gpu::open(&Options::default())?;
//! // Which passes' timestamps can be trusted on this adapter.
//! let clock = audit(&gpu)?;
//! let set = [("view.width".to_owned(), 256.into()), ("view.height".to_owned(), 256.into())];
//! let subject = Subjects::of(&Catalog::builtin()).subject("hsao", "tank", &set)?;
//! let pipeline = subject.build(&gpu)?;
//! let mut timer = FrameTimer::new(&gpu, clock.plan, MAX_PASSES)?;
//! // The first frame compiles the shaders.
//! timer.untimed(&gpu, &pipeline.stages())?;
//! for stage in timer.timed(&gpu, &pipeline.stages())?.stages {
//!     println!("{}: {:.3} ms", stage.name, stage.at_least_resolution_ns() / 1e6);
//! }
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! Dependency rule. Between crates cargo keeps it: `fathom → fathom-reference → fathom-scene → fathom-base`. Within this crate
//! `tests/dependency_rule.rs` does:
//! `main → cli → exporters → compare → report, harness → experiments → pipelines → stages → gpu`;
//! `history` imports `report`, and only `cli` imports it; neither `report` nor `harness` imports the
//! other, and `report` never imports `gpu`; a stage never imports a sibling stage.
//!
//! Conventions, stated once: right-handed world, +Y up, metres, water at rest is the plane y = 0,
//! seconds, depth range 0 (near) … 1 (far), clip space y up, light directions point the way the
//! light travels, CPU geometry and references in f64, GPU in f32, angles in degrees in parameters.

pub mod bench;
pub mod cli;
pub mod compare;
pub mod experiments;
pub mod exporters;
pub mod fleet;
pub mod gpu;
pub mod harness;
pub mod history;
pub mod pipelines;
pub mod record;
pub mod report;
pub mod stages;
pub mod words;

pub use fathom_base::{
    choices, embedded, folder, input, npy, parameter, private, process, quiet, settings,
    statistics, tell, text,
};
pub use fathom_reference as reference;
pub use fathom_scene as scene;
pub use harness::catalog::Catalog;
