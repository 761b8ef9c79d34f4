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
//! let subject = Subjects::new(&Catalog::builtin()).subject("hsao", "tank", &set)?;
//! let pipeline = subject.build(&gpu)?;
//! let mut timer = FrameTimer::new(&gpu, clock.plan, MAX_PASSES)?;
//! // The first frame compiles the shaders.
//! timer.run_stages(&gpu, &pipeline.stages())?;
//! for stage in timer.time_stages(&gpu, &pipeline.stages())?.stages {
//!     println!("{}: {:.3} ms", stage.stage, stage.ns_or_resolution() / 1e6);
//! }
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! Each folder of `src` is a crate, and this one re-exports them. Cargo keeps the direction of their imports: a lower crate does not know a
//! higher one (`ARCHITECTURE.md` has the table). A stage imports no stage of another family, which a test of `fathom-stages` keeps.
//!
//! Conventions, stated once: right-handed world, +Y up, metres, water at rest is the plane y = 0,
//! seconds, depth range 0 (near) … 1 (far), clip space y up, light directions point the way the
//! light travels, CPU geometry and references in f64, GPU in f32, angles in degrees in parameters.

#![warn(clippy::dbg_macro, clippy::print_stderr, clippy::print_stdout)]

pub mod cli;
pub mod exporters;

pub use fathom_base::{
    choices, embedded, folder, input, npy, parameter, print, private, process, quiet, settings,
    statistics, text, visits,
};
pub use fathom_clock as clock;
pub use fathom_compare as compare;
pub use fathom_experiments as experiments;
pub use fathom_experiments::words;
pub use fathom_gpu as gpu;
pub use fathom_gpu::shader_struct;
pub use fathom_harness as harness;
pub use fathom_harness::catalog::Catalog;
pub use fathom_history as history;
pub use fathom_judge as judge;
pub use fathom_pipelines as pipelines;
pub use fathom_record as record;
pub use fathom_reference as reference;
pub use fathom_report as report;
pub use fathom_scene as scene;
pub use fathom_stages as stages;
pub use fathom_verify as verify;
