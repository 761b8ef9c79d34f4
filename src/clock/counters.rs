//! Shader invocations counted by the adapter, in a frame of its own that is never a timed one.

use std::collections::{BTreeMap, BTreeSet};

use super::frame::{FrameMode, Recorder};
use super::queries::QueryResults;
use super::{Device, DeviceError, TimedStage};
use fathom_record::PassKind;
use fathom_record::ceilings::TargetRecord;

const COUNTED: wgpu::PipelineStatisticsTypes = wgpu::PipelineStatisticsTypes::all();
/// Names of the counters in the order of their bits, which is that of the results.
const NAMES: [&str; 5] = [
    "vertex_invocations",
    "clipper_invocations",
    "clipper_primitives",
    "fragment_invocations",
    "compute_invocations",
];

/// One stage's passes, and what the adapter counted in them.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct StageCounters {
    pub name: &'static str,
    /// Those that are not zero; none where the adapter does not count.
    pub counters: BTreeMap<String, u64>,
    pub passes: BTreeSet<PassKind>,
    pub targets: BTreeSet<TargetRecord>,
}

/// Runs one frame of at most `max_passes` compute and render passes and counts the shader invocations
/// of each stage.
pub fn count<S: TimedStage + ?Sized>(
    gpu: &Device,
    stages: &[&S],
    max_passes: u32,
) -> Result<Vec<StageCounters>, DeviceError> {
    let counts = gpu.features.contains(wgpu::Features::PIPELINE_STATISTICS_QUERY) && max_passes > 0;
    gpu.catch(|| {
        let set = counts.then(|| {
            gpu.device.create_query_set(&wgpu::QuerySetDescriptor {
                label: Some("pipeline statistics"),
                ty: wgpu::QueryType::PipelineStatistics(COUNTED),
                count: max_passes,
            })
        });
        let mut recorder = Recorder::default();
        recorder.record(gpu, FrameMode::Counted { set: set.as_ref(), max_passes }, stages)?;
        recorder.run(gpu)?;
        let count = u64::from(recorder.queries) * NAMES.len() as u64;
        let results = match (&set, recorder.queries) {
            (None, _) | (_, 0) => Vec::new(),
            (Some(set), queries) => QueryResults::new(gpu, "pipeline statistics", count).read(
                gpu,
                count,
                |encoder, resolved| encoder.resolve_query_set(set, 0..queries, resolved, 0),
            )?,
        };
        Ok(sum(stages, &recorder, &results))
    })
}

fn sum<S: TimedStage + ?Sized>(
    stages: &[&S],
    recorder: &Recorder,
    results: &[u64],
) -> Vec<StageCounters> {
    let empty = |stage: &&S| StageCounters { name: stage.name(), ..StageCounters::default() };
    let mut counted: Vec<StageCounters> = stages.iter().map(empty).collect();
    for pass in &recorder.passes {
        counted[pass.stage].passes.insert(pass.kind);
        counted[pass.stage].targets.extend(pass.targets.iter().cloned());
        let Some(query) = pass.query.map(|query| query as usize * NAMES.len()) else {
            continue;
        };
        for (name, value) in NAMES.iter().zip(results.iter().skip(query)) {
            if *value > 0 {
                *counted[pass.stage].counters.entry((*name).to_owned()).or_default() += value;
            }
        }
    }
    counted
}
