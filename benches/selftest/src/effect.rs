//! What a changed shader does to the outputs of stages, at random settings.

use anyhow::Result;
use fathom::Catalog;
use fathom::gpu::Gpu;
use fathom::harness::dump::read;
use fathom::harness::subject::{Subject, Subjects};
use fathom::parameter;
use fathom::pipelines::draw::{self, Random};
use fathom::pipelines::{KINDS, PipelineKind};
use fathom::scene::SceneFile;
use itertools::Itertools;
use serde_json::Value;

use crate::mutants::{Outcome, linked_files};

/// Each pipeline is tried with those with which it can be built.
const SCENES: &str = "tank port specular engine ball planar_pool glass smoke cornell slab";
/// Draws of settings of each pipeline and scene; the first are the defaults.
const DRAWS: u32 = 4;
/// No more frames are tried of a fault.
const MAX_FRAMES: usize = 24;
/// As foreseen.
const MAX_FRAME_S: f64 = 1.0;
/// A change of an output: RMS as a share of its range; and a difference of so much of the range in so large a share of its values.
const MIN_RMS: f64 = 0.005;
const MIN_DIFFERENCE: f64 = 0.02;
const MIN_SHARE: f64 = 0.005;
/// Small frames.
const COMMON: &str = "view.width=96 view.height=72 shadow.size=256 voxel.resolution=48 ao.rays=24 transfer.grid=40 caustics.grid=48";

/// The first output that a change of a file alters, or what was tried: each pipeline in turn at its defaults or at drawn settings.
pub fn of(own: &Gpu, changed: &Gpu, file: &str) -> Result<Outcome> {
    let mut subjects = Subjects::new(&Catalog::builtin()).silent();
    let mut tried = 0;
    for (seed, scene) in (0..DRAWS).cartesian_product(SCENES.split(' ')) {
        for kind in KINDS {
            let Some(subject) = draw(&mut subjects, own, kind, scene, seed) else { continue };
            if !holds(&subject, file)? {
                continue;
            }
            if let Some(effect) = difference([own, changed], &subject)? {
                let settings = if seed == 0 { "defaults" } else { &format!("settings {seed}") };
                let place = format!("{} {scene}, {settings}", kind.name);
                return Ok(Outcome::Survived(format!("{place}: {effect}")));
            }
            tried += 1;
        }
        if tried >= MAX_FRAMES {
            break;
        }
    }
    Ok(Outcome::Equivalent(format!("{tried} frames")))
}

/// Whether a stage's shader is linked of a file: it bears the stage's name, which may end in an axis.
fn holds(subject: &Subject, file: &str) -> Result<bool> {
    let mut shaders = subject.plan()?.stages.into_iter().map(|stage| stage.name.split('-').next());
    Ok(shaders.any(|shader| shader.is_some_and(|shader| linked_files(shader).contains(file))))
}

/// A pipeline with small frames, at its defaults (seed 0) or at drawn settings; none where it cannot be built.
fn draw(
    subjects: &mut Subjects,
    gpu: &Gpu,
    kind: &PipelineKind,
    scene: &str,
    seed: u32,
) -> Option<Subject> {
    let mut file = SceneFile::load(scene).ok()?;
    for volume in file.volume.iter_mut().filter(|volume| volume.generator.is_some()) {
        volume.cells = [40; 3];
    }
    let mut tree = (kind.defaults)(&file);
    for (path, size) in COMMON.split(' ').filter_map(|setting| setting.split_once('=')) {
        let size: Value = size.parse().ok()?;
        let extents = parameter::get(&tree, path).and_then(Value::as_array).map(Vec::len);
        let size = extents.map_or(size.clone(), |extents| vec![size; extents].into());
        // Not every pipeline has it.
        let _ = parameter::set(&mut tree, path, size);
    }
    if seed > 0 {
        tree = draw::parameters(kind, tree, &mut Random::new(seed));
    }
    let value = |path: String| Some((path.clone(), parameter::get(&tree, &path)?.clone()));
    let set: Vec<(String, Value)> =
        parameter::leaves(&tree).into_iter().filter_map(value).collect();
    let subject = subjects.subject(kind.name, scene, &set).ok()?;
    let forecast_s = subject.forecast_s(&gpu.capacity).ok()?.ok()?;
    (forecast_s < MAX_FRAME_S).then_some(subject)
}

/// The first output that differs, in words.
fn difference([own, changed]: [&Gpu; 2], subject: &Subject) -> Result<Option<String>> {
    let outputs = |gpu: &Gpu| -> Result<Vec<(String, Vec<f32>)>> {
        let pipeline = subject.build(gpu)?;
        let stages = pipeline.stages();
        gpu.run(&stages)?;
        gpu.run(&pipeline.presenting())?;
        let all = stages.iter().flat_map(|stage| stage.dumps.iter().map(move |dump| (stage, dump)));
        all.map(|(stage, dump)| Ok((format!("{} {}", stage.name(), dump.name), read(gpu, dump)?.1)))
            .collect()
    };
    let before = outputs(own)?;
    let after = match outputs(changed) {
        Ok(after) => after,
        Err(error) => return Ok(Some(error.to_string())),
    };
    let changes = |after: &[(String, Vec<f32>)]| -> Vec<Option<String>> {
        before.iter().zip(after).map(|(before, after)| change(&before.1, &after.1)).collect()
    };
    let found = changes(&after);
    if found.iter().all(Option::is_none) {
        return Ok(None);
    }
    // What differs from frame to frame is no effect.
    let noise = changes(&outputs(own)?);
    let mut differs = before.iter().zip(found).zip(noise).filter(|(_, noise)| noise.is_none());
    Ok(differs.find_map(|((before, found), _)| Some(format!("{} {}", before.0, found?))))
}

/// How an output differs from another one, if it does.
fn change(before: &[f32], after: &[f32]) -> Option<String> {
    let finite = || before.iter().copied().filter(|value| value.is_finite()).map(f64::from);
    let range = finite().fold(f64::MIN, f64::max) - finite().fold(f64::MAX, f64::min);
    if before.len() != after.len() {
        return Some("has another size".to_owned());
    }
    let differences =
        before.iter().zip(after).filter(|(a, b)| a.to_bits() != b.to_bits()).map(|(a, b)| {
            let difference = (f64::from(*a) - f64::from(*b)).abs() / range.max(1e-30);
            if difference.is_finite() { difference.min(1.0) } else { 1.0 }
        });
    let differences = differences.collect::<Vec<f64>>();
    let count = before.len().max(1) as f64;
    let rms = (differences.iter().map(|d| d * d).sum::<f64>() / count).sqrt();
    let share = differences.iter().filter(|d| **d >= MIN_DIFFERENCE).count() as f64 / count;
    let differs = rms > MIN_RMS || share > MIN_SHARE;
    let [rms, share] = [rms, share].map(|part| 100.0 * part);
    differs.then(|| format!("RMS {rms:.2} % of its range, {share:.1} % of values by 2 % or more"))
}
