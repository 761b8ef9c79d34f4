//! Shader invocations counted by the adapter, in a frame of its own that is never a timed one.

use std::collections::BTreeMap;

use super::frame::{FrameMode, Recorder};
use super::queries::QueryResults;
use super::{Device, DeviceError, TimedStage};

const COUNTED: wgpu::PipelineStatisticsTypes = wgpu::PipelineStatisticsTypes::all();
/// Names of the counters in the order of their bits, which is that of the results.
const NAMES: [&str; 5] = [
    "vertex_invocations",
    "clipper_invocations",
    "clipper_primitives",
    "fragment_invocations",
    "compute_invocations",
];

/// What the adapter counted in one stage's passes. Counters that are zero are left out.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StageCounters {
    pub name: &'static str,
    pub counters: BTreeMap<String, u64>,
}

/// Runs one frame of at most `max_passes` compute and render passes and counts the shader invocations
/// of each stage. `None` where the adapter does not count.
pub fn count<S: TimedStage + ?Sized>(
    gpu: &Device,
    stages: &[&S],
    max_passes: u32,
) -> Result<Option<Vec<StageCounters>>, DeviceError> {
    if !gpu.features.contains(wgpu::Features::PIPELINE_STATISTICS_QUERY) || max_passes == 0 {
        return Ok(None);
    }
    gpu.catch(|| {
        let set = gpu.device.create_query_set(&wgpu::QuerySetDescriptor {
            label: Some("pipeline statistics"),
            ty: wgpu::QueryType::PipelineStatistics(COUNTED),
            count: max_passes,
        });
        let mut recorder = Recorder::default();
        recorder.record(gpu, FrameMode::Counted { set: &set, max_passes }, stages)?;
        recorder.run(gpu)?;
        let count = u64::from(recorder.queries) * NAMES.len() as u64;
        let results = match recorder.queries {
            0 => Vec::new(),
            queries => QueryResults::new(gpu, "pipeline statistics", count).read(
                gpu,
                count,
                |encoder, resolved| encoder.resolve_query_set(&set, 0..queries, resolved, 0),
            )?,
        };
        Ok(Some(sum(stages, &recorder, &results)))
    })
}

fn sum<S: TimedStage + ?Sized>(
    stages: &[&S],
    recorder: &Recorder,
    results: &[u64],
) -> Vec<StageCounters> {
    let empty = |stage: &&S| StageCounters { name: stage.name(), counters: BTreeMap::new() };
    let mut counted: Vec<StageCounters> = stages.iter().map(empty).collect();
    for pass in &recorder.passes {
        let Some(query) = pass.query.map(|query| query as usize * NAMES.len()) else {
            continue;
        };
        for (name, value) in NAMES.iter().zip(&results[query..]) {
            if *value > 0 {
                *counted[pass.stage].counters.entry((*name).to_owned()).or_default() += value;
            }
        }
    }
    counted
}
