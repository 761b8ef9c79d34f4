//! GPU benchmark of published real-time rendering pipelines, on a clock that is audited first.
//!
//! Dependency rule (kept by `tests/dependency_rule.rs`):
//! `main → compare → report, harness → experiments → pipelines → stages → scene, gpu`;
//! `embedded`, `text` and `input` import nothing, `tell` only `text`, `record` only these two, `statistics` only `record`, `reference` only
//! `scene`; `report` never imports `gpu`;
//! a stage never imports a sibling stage.
//!
//! Conventions, stated once: right-handed world, +Y up, metres, water at rest is the plane y = 0,
//! seconds, depth range 0 (near) … 1 (far), clip space y up, light directions point the way the
//! light travels, CPU geometry and references in f64, GPU in f32, angles in degrees in parameters.

pub mod cli;
pub mod compare;
pub mod embedded;
pub mod experiments;
pub mod exporters;
pub mod gpu;
pub mod harness;
pub mod input;
pub mod parameter;
pub mod pipelines;
pub mod record;
pub mod reference;
pub mod report;
pub mod scene;
pub mod stages;
pub mod statistics;
pub mod tell;
pub mod text;

pub use harness::catalog::Catalog;
