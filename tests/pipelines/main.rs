//! Whole pipelines on the adapter at hand: what they draw, what they tell, what they ask for, and the checks of their stages.

mod capacity;
mod hsao;
mod verify;
mod volume_ao;
mod voxelize;

use fathom::gpu::{Gpu, Options, Pixels};
use fathom::pipelines::{Kind, params};
use fathom::scene::{Scene, SceneFile};
use serde_json::Value;

/// Paths of parameters with their values.
type Set<'a> = [(&'a str, Value)];

fn gpu() -> Gpu {
    Gpu::open(&Options::default())
        .expect("a Vulkan driver: `make test` installs lavapipe where there is none")
}

/// The scene, and the pipeline's parameters with some of them set, which the adapter can take.
fn prepared(gpu: &Gpu, kind: &Kind, scene: &str, set: &Set<'_>) -> (Scene, Value) {
    let file = SceneFile::load(scene).unwrap();
    let mut tree = (kind.defaults)(&file);
    for (path, value) in set {
        params::set(&mut tree, path, value.clone()).unwrap();
    }
    let scene = Scene::build(&(kind.scene_file)(&file, &tree).unwrap()).unwrap();
    gpu.check(&(kind.demand)(&tree, &scene).unwrap()).unwrap();
    (scene, tree)
}

/// Mean of the first channel.
fn mean(image: &Pixels) -> f64 {
    let first = image.data.iter().step_by(image.channels as usize);
    first.map(|v| f64::from(*v)).sum::<f64>() / f64::from(image.width * image.height)
}
