//! The GPU layer, scenes and whole pipelines on the adapter at hand: what they draw, what they tell, what they ask for, and the checks of their stages.

mod capacity;
#[path = "../common/mod.rs"]
mod common;
mod gpu;
mod hsao;
mod promises;
mod scenes;
mod stage_lists;
mod verify;
mod volume_ao;
mod voxelize;

use common::gpu;
use fathom::gpu::{Gpu, Pixels};
use fathom::parameter;
use fathom::pipelines::{BuiltPipeline, Pipeline, PipelineKind};
use fathom::scene::{Scene, SceneFile};

/// The scene, and the pipeline's parameters with some of them set, which the adapter can take.
fn prepared<P: Pipeline>(gpu: &Gpu, scene: &str, set: &str) -> (Scene, P::Params) {
    let file = SceneFile::load(scene).unwrap();
    let mut tree = parameter::tree(&P::Params::from(&file));
    for (path, value) in common::sets(set) {
        parameter::set(&mut tree, &path, value).unwrap();
    }
    let params: P::Params = fathom::pipelines::read(&tree).unwrap();
    let scene = Scene::build(&fathom::pipelines::apply(&params, &file).unwrap()).unwrap();
    gpu.check(&(PipelineKind::new::<P>().plan)(&tree, &scene).unwrap().demand).unwrap();
    (scene, params)
}

fn built<P: Pipeline>(gpu: &Gpu, scene: &Scene, params: &P::Params) -> BuiltPipeline<P> {
    let pipeline = gpu.catch(|| BuiltPipeline::<P>::new(gpu, scene, params)).unwrap();
    gpu.run(&pipeline.stages()).unwrap();
    pipeline
}

/// Mean of the first channel.
fn mean(image: &Pixels) -> f64 {
    let first = image.data.iter().step_by(image.channels as usize);
    first.map(|v| f64::from(*v)).sum::<f64>() / f64::from(image.width * image.height)
}
