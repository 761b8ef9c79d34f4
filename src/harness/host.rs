//! What a cell costs the CPU: encoding and submission.

use fathom_base::statistics::estimate;
use fathom_gpu::{EncodeCost, FrameTimer, Gpu, GpuError};
use fathom_pipelines::AnyPipeline;
use fathom_record::{HostCosts, StageEncoding};

/// Frames that are encoded: enough for an interval at 95 %.
const ENCODINGS: usize = 15;

/// The costs of a cell. `submits_ns` are those of its untimed frames.
pub fn costs(
    gpu: &Gpu,
    timer: &mut FrameTimer,
    pipeline: &AnyPipeline,
    submits_ns: &[f64],
) -> Result<HostCosts, GpuError> {
    let stages = pipeline.stages();
    let encode = |_| timer.encode_cost(gpu, &stages);
    let frames: Vec<EncodeCost> = (0..ENCODINGS).map(encode).collect::<Result<_, _>>()?;
    let estimated =
        |ns: &dyn Fn(&EncodeCost) -> f64| estimate(&frames.iter().map(ns).collect::<Vec<f64>>());
    let encoding = |(place, stage): (usize, &&fathom_gpu::Stage)| StageEncoding {
        stage: stage.name().into(),
        encode: estimated(&|frame| frame.stages_ns[place]),
    };
    Ok(HostCosts {
        stages: stages.iter().enumerate().map(encoding).collect(),
        encode: estimated(&|frame| frame.frame_ns),
        // The first untimed frame belongs to the warm-up.
        submit: estimate(&submits_ns[submits_ns.len().min(1)..]),
    })
}
