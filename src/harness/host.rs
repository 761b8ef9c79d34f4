//! What a cell costs the CPU: encoding, submission, making of pipelines.

use super::subject::Subject;
use fathom_base::statistics::estimate;
use fathom_gpu::{FrameTimer, Gpu, GpuError, HostCost, MadePipelines};
use fathom_pipelines::AnyPipeline;
use fathom_record::{HostCosts, PipelineCreation, StageEncoding};

/// Frames that are encoded and submitted: enough for an interval at 95 % (six are the least).
const FRAMES: usize = 15;

/// The costs of a cell that was built in this process while `made` pipelines were made.
pub fn costs(
    gpu: &Gpu,
    timer: &mut FrameTimer,
    (subject, pipeline): (&Subject, &AnyPipeline),
    made: MadePipelines,
) -> Result<HostCosts, GpuError> {
    let stages = pipeline.stages();
    let frame = |_| timer.host_cost(gpu, &stages);
    let frames: Vec<HostCost> = (0..FRAMES).map(frame).collect::<Result<_, _>>()?;
    let estimated =
        |ns: &dyn Fn(&HostCost) -> f64| estimate(&frames.iter().map(ns).collect::<Vec<f64>>());
    let encoding = |(place, stage): (usize, &&fathom_gpu::Stage)| StageEncoding {
        stage: stage.name().into(),
        encode: estimated(&|frame| frame.stages_ns[place]),
    };
    let (again, of_all) = gpu.time_all_pipelines(|| subject.build(gpu));
    drop(again?);
    // Otherwise cells before this one have made some of them.
    let is_first = made.count == of_all.count;
    Ok(HostCosts {
        stages: stages.iter().enumerate().map(encoding).collect(),
        encode: estimated(&|frame| frame.frame_ns),
        submit: estimated(&|frame| frame.submit_ns),
        creation: is_first.then_some(PipelineCreation {
            pipelines: made.count,
            first_ns: made.ns,
            again_ns: of_all.ns,
        }),
    })
}
