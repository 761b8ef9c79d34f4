//! `fathom verify`: every stage on a small case against its f64 reference.
//!
//! A case feeds a stage with the reference's own inputs where it can, so that errors stay local, and
//! compares what comes out. Beside each comparison runs a control: the same comparison with one value
//! perturbed, which must exceed the tolerance. A check whose control passes says nothing.
//!
//! Traced effects are rows of `effects.toml`, which the pipelines' own `judge` decides. Closed forms and laws have a file per family of
//! stages; adding a case adds a function there and a line in its `cases`.

mod ao_compose;
mod bilateral;
mod camera;
mod compose;
mod deform;
mod effects;
mod filters;
mod fresnel;
mod glass;
mod gtao;
mod hsao;
mod ldi;
mod light;
mod lines;
mod occlusion;
mod picture;
mod planar;
mod prelude;
mod refraction;
pub mod rig;
mod scalar;
mod shadow_rays;
mod shafts;
mod splats;
mod sprites;
pub mod statistics;
mod transfer;
mod voxel;

use std::fmt;
use std::time::{Duration, Instant};

use serde::Serialize;

use fathom_base::text::{did_you_mean, families};
use fathom_gpu::{Gpu, GpuError};
use fathom_scene::SceneError;
use rig::Rig;

/// Why a verification could not be carried out. A check that fails is no error.
#[derive(Debug, thiserror::Error)]
pub enum VerifyError {
    #[error(transparent)]
    Gpu(#[from] GpuError),
    #[error(transparent)]
    Scene(#[from] SceneError),
    #[error("no check matches `{filter}`{}; there are checks of {}", .hint, .families.join(", "))]
    NoMatch { filter: String, hint: String, families: Vec<&'static str> },
    #[error("{stage}: {what}")]
    Invalid { stage: &'static str, what: String },
}

pub type Result<T, E = VerifyError> = std::result::Result<T, E>;

/// What a case finds.
pub type Checks = Result<Vec<Check>>;

/// One comparison and its control.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Check {
    pub stage: &'static str,
    /// What is compared, and its statistic.
    pub what: String,
    /// Unit of `measured` and `tolerance`; `1` for ratios.
    pub unit: &'static str,
    pub measured: f64,
    pub tolerance: f64,
    pub passed: bool,
    pub control: Control,
    /// Further figures that are reported and not judged: `name → value`, the unit in the name.
    pub figures: Vec<(String, f64)>,
}

/// The same comparison with one value perturbed.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Control {
    pub perturbed: String,
    pub measured: f64,
    pub has_failed: bool,
}

impl Check {
    /// A comparison of the stage that a case judges: what is compared, and its statistic. It is not sound until it is given what was
    /// measured and a control.
    pub fn new(rig: &Rig<'_>, what: impl Into<String>) -> Check {
        Check {
            stage: rig.stage,
            what: what.into(),
            unit: "",
            measured: f64::NAN,
            tolerance: f64::NAN,
            passed: false,
            control: Control::default(),
            figures: Vec::new(),
        }
    }

    /// What was measured, and the tolerance up to which it passes, with its unit. What is not a number does not pass.
    #[must_use]
    pub fn within(self, (tolerance, unit): (f64, &'static str), measured: f64) -> Check {
        Check { tolerance, unit, measured, passed: measured <= tolerance, ..self }
    }

    /// The same measured with one value perturbed: it must exceed the tolerance. What is not a number does not.
    #[must_use]
    pub fn control(self, perturbed: impl Into<String>, measured: f64) -> Check {
        let has_failed = measured > self.tolerance;
        let control = Control { perturbed: perturbed.into(), measured, has_failed };
        Check { control, ..self }
    }

    /// Adds a figure that is reported and not judged.
    #[must_use]
    pub fn with(mut self, name: impl Into<String>, value: f64) -> Check {
        self.figures.push((name.into(), value));
        self
    }

    /// The comparison passed and its control failed.
    pub fn is_sound(&self) -> bool {
        self.passed && self.control.has_failed
    }
}

impl From<Check> for Vec<Check> {
    fn from(check: Check) -> Self {
        vec![check]
    }
}

type CaseFn = dyn Fn(&Rig<'_>) -> Checks;

/// A case: one run on the GPU that yields one or more checks of a stage.
pub struct Case {
    pub stage: &'static str,
    what: String,
    run: Box<CaseFn>,
}

impl Case {
    pub fn new<C: Into<Vec<Check>>>(
        stage: &'static str,
        what: impl Into<String>,
        run: impl Fn(&Rig<'_>) -> Result<C> + 'static,
    ) -> Case {
        Case { stage, what: what.into(), run: Box::new(move |rig| run(rig).map(Into::into)) }
    }

    /// A case for each of some subjects.
    pub fn each<T: Copy + 'static, C: Into<Vec<Check>>>(
        stage: &'static str,
        of: impl IntoIterator<Item = T>,
        what: impl Fn(T) -> String,
        run: impl Fn(&Rig<'_>, T) -> Result<C> + Copy + 'static,
    ) -> impl Iterator<Item = Case> {
        of.into_iter().map(move |one| Case::new(stage, what(one), move |rig| run(rig, one)))
    }

    fn matches(&self, filter: &str) -> bool {
        let filter = filter.to_lowercase();
        self.stage.contains(&filter) || self.what.to_lowercase().contains(&filter)
    }
}

/// A case that this adapter cannot run.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SkippedCase {
    pub stage: &'static str,
    pub what: String,
    /// What the adapter lacks.
    pub reason: String,
}

/// What cases found.
#[derive(Clone, Debug, Default)]
pub struct Verified {
    pub checks: Vec<Check>,
    pub skipped: Vec<SkippedCase>,
}

/// Every case of fathom's own stages, in frame order.
pub fn cases() -> Vec<Case> {
    let families = [
        light::cases(),
        deform::cases(),
        voxel::cases(),
        camera::cases(),
        occlusion::cases(),
        bilateral::cases(),
        ao_compose::cases(),
        hsao::cases(),
        gtao::cases(),
        effects::cases(),
        glass::cases(),
        splats::cases(),
        lines::cases(),
        fresnel::cases(),
        filters::cases(),
        compose::cases(),
        ldi::cases(),
        transfer::cases(),
        sprites::cases(),
        shafts::cases(),
        shadow_rays::cases(),
        refraction::cases(),
        planar::cases(),
        scalar::cases(),
    ];
    families.into_iter().flatten().collect()
}

pub struct FinishedCase<'a> {
    pub case: &'a Case,
    /// From 1.
    pub number: usize,
    pub total: usize,
    pub took: Duration,
}

impl fmt::Display for FinishedCase<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { case, number, total, took } = self;
        write!(f, "{number} of {total}: {} {}, {:.1} s", case.stage, case.what, took.as_secs_f64())
    }
}

/// Runs those of `all` cases whose stage or name contains `filter` (all without one), and tells `each` when it has ended. A check
/// that fails is no error, and a case that needs more than the adapter has is skipped.
pub fn verify(
    gpu: &Gpu,
    all: &[Case],
    filter: Option<&str>,
    each: impl FnMut(FinishedCase<'_>),
) -> Result<Verified> {
    let chosen: Vec<&Case> =
        all.iter().filter(|case| filter.is_none_or(|f| case.matches(f))).collect();
    if chosen.is_empty() {
        let filter = filter.unwrap_or_default().to_owned();
        let stages = || all.iter().map(|case| case.stage);
        let families = families(stages());
        let hint = did_you_mean(&filter, families.iter().copied().chain(stages()));
        return Err(VerifyError::NoMatch { filter, hint, families });
    }
    run_all(gpu, &chosen, each)
}

/// Runs the cases of these stages; none for a stage that has none. A check that fails is no error.
pub fn verify_stages(gpu: &Gpu, all: &[Case], stages: &[String]) -> Result<Vec<Check>> {
    let chosen: Vec<&Case> =
        all.iter().filter(|case| stages.iter().any(|stage| stage == case.stage)).collect();
    Ok(run_all(gpu, &chosen, |_| ())?.checks)
}

/// Runs each case so that what the GPU reports late becomes this case's error.
fn run_all(gpu: &Gpu, cases: &[&Case], mut each: impl FnMut(FinishedCase<'_>)) -> Result<Verified> {
    let mut verified = Verified::default();
    for (number, case) in (1..).zip(cases) {
        let begin = Instant::now();
        let rig = Rig::new(gpu, case.stage);
        let mut results = Ok(Vec::new());
        let ran = gpu.catch(|| {
            results = (case.run)(&rig);
            Ok(())
        });
        if let Some(reason) = rig.exceeded_limit(&gpu.capacity) {
            let (stage, what) = (case.stage, case.what.clone());
            verified.skipped.push(SkippedCase { stage, what, reason });
        } else {
            ran?;
            verified.checks.extend(results?);
        }
        each(FinishedCase { case, number, total: cases.len(), took: begin.elapsed() });
    }
    Ok(verified)
}

/// A table of checks for people, one line each, figures below.
pub struct CheckTable<'a>(pub &'a [Check]);

impl fmt::Display for CheckTable<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let width = |text: fn(&Check) -> &str, min: usize| {
            let widths = self.0.iter().map(|check| text(check).chars().count());
            widths.fold(min, usize::max)
        };
        let (stage, what) = (width(|c| c.stage, 5), width(|c| &c.what, 5));
        writeln!(
            f,
            "{:6} {:stage$} {:what$} {:>10} {:>10} {:4} control: must exceed the tolerance",
            "", "stage", "check", "measured", "tolerance", "unit"
        )?;
        for check in self.0 {
            let verdict = match (check.passed, check.control.has_failed) {
                (true, true) => "ok",
                (false, _) => "FAILED",
                (true, false) => "BLIND",
            };
            writeln!(
                f,
                "{verdict:6} {:stage$} {:what$} {:>10} {:>10} {:4} {} → {}",
                check.stage,
                check.what,
                short(check.measured),
                short(check.tolerance),
                check.unit,
                check.control.perturbed,
                short(check.control.measured),
            )?;
            for (name, value) in &check.figures {
                writeln!(f, "{:6} {:stage$}   {name} {}", "", "", short(*value))?;
            }
        }
        Ok(())
    }
}

/// Three digits, with an exponent where plain digits would be long.
fn short(value: f64) -> String {
    if value == 0.0 || (1e-3..1e4).contains(&value.abs()) {
        let digits = if value == 0.0 { 0.0 } else { value.abs().log10().floor() };
        let decimals = (2.0 - digits).clamp(0.0, 5.0) as usize;
        format!("{value:.decimals$}")
    } else {
        format!("{value:.2e}")
    }
}
