//! The volume ambient occlusion pipeline as a whole: its variants, its figures, its accuracy.

use std::collections::BTreeMap;

use fathom::gpu::{Gpu, Pixels, read_texture};
use fathom::pipelines::volume_ao::{Params, VolumeAo};
use fathom::pipelines::{BuiltPipeline, PipelineInstance};
use fathom::reference::occlusion::{Obscurity, occlusion};
use fathom::reference::rays::{PixelRays, Tracer};
use fathom::scene::Scene;
use glam::DVec3;
use rayon::prelude::*;

use super::{built, gpu, mean, prepared};

struct RenderedScene {
    scene: Scene,
    params: Params,
    pipeline: BuiltPipeline<VolumeAo>,
}

fn draw(gpu: &Gpu, scene: &str, set: &str) -> RenderedScene {
    let (scene, params) = prepared::<VolumeAo>(gpu, scene, set);
    let pipeline = built::<VolumeAo>(gpu, &scene, &params);
    RenderedScene { scene, params, pipeline }
}

impl RenderedScene {
    fn visibility(&self, gpu: &Gpu) -> Pixels {
        read_texture(gpu, &self.pipeline.buffers.raw.1).unwrap()
    }

    fn figures(&self, gpu: &Gpu) -> BTreeMap<String, f64> {
        self.pipeline.quantities(gpu).unwrap()
    }

    fn stages(&self) -> Vec<&'static str> {
        self.pipeline.stages().iter().map(|s| s.name()).collect()
    }
}

/// With a small picture and a small volume.
fn draw_small(gpu: &Gpu, scene: &str, set: &str) -> RenderedScene {
    let small = "view.width=48 view.height=40 voxel.resolution=32 shadow.size=64 ao.rays=16";
    draw(gpu, scene, &format!("{small} {set}"))
}

#[test]
fn variants_agree_where_they_must() {
    let gpu = gpu();
    let run = |set: &str| draw_small(&gpu, "ball", set);
    let plain = run("");
    let visibility = plain.visibility(&gpu);
    assert!((0.5..0.99).contains(&mean(&visibility)));
    let image = read_texture(&gpu, plain.pipeline.image()).unwrap();
    assert_eq!([image.width, image.height], [48, 40]);

    let once = run("voxel.update=once");
    assert_eq!(once.visibility(&gpu).data, visibility.data);
    assert!(plain.stages().contains(&"voxel/unpack") && !once.stages().contains(&"voxel/unpack"));

    let skipping = run("ao.skipping=true");
    assert_eq!(skipping.visibility(&gpu).data, visibility.data);
    let [taken, all] = [&skipping, &plain].map(|d| d.figures(&gpu)["samples_per_pixel_mean"]);
    assert!(taken < 0.75 * all, "{taken} of {all}");
    assert!(skipping.figures(&gpu)["lookups_per_pixel_mean"] > 0.0);

    let half = run("ao.scale=0.5 ao.filter=false").visibility(&gpu);
    assert_eq!([half.width, half.height], [24, 20]);
    assert!((mean(&half) - mean(&visibility)).abs() < 0.02);

    let paper = run("ao.estimator=paper");
    let [halved, whole] = [mean(&paper.visibility(&gpu)), mean(&visibility)].map(|v| 1.0 - v);
    assert!((halved / whole - 0.5).abs() < 0.1, "{halved} of {whole}");
}

#[test]
fn figures_say_what_is_marched() {
    let gpu = gpu();
    let set = "ao.step=paper ao.samples=8 ao.r_max_m=1.5";
    let figures = draw_small(&gpu, "ball", set).figures(&gpu);
    assert_eq!(figures["r_max_m"], 1.5);
    assert!((figures["r_max_voxels"] / figures["step_voxels"] - 8.0).abs() < 1e-9);
    let samples = figures["samples_per_pixel_mean"];
    assert!((16.0..=128.0).contains(&samples), "{samples}");
    assert!((0.3..=1.0).contains(&figures["covered_share"]));
}

#[test]
fn volumes_of_objects_multiply_and_glass_lets_light_through() {
    let gpu = gpu();
    // The volume of all crates has few voxels: near contacts the default's high threshold would miss most of what there is.
    let crates = "voxel.method=slicemap ao.threshold=0.55 ao.offset_voxels=0.25 \
        ao.r_max_m=0.5 objects=4";
    let each = draw_small(&gpu, "crates", &format!("voxel.per_object=true {crates}"));
    assert_eq!(each.pipeline.volumes.len(), 4);
    let all = draw_small(&gpu, "crates", crates);
    let [each, all] = [&each, &all].map(|d| 1.0 - mean(&d.visibility(&gpu)));
    assert!(each > 0.0 && all > 0.0 && (each / all - 1.0).abs() < 1.0, "{each} {all}");

    let glass = |occluder: &str, method: &str| {
        let set = format!("ao.occluder={occluder} voxel.method={method}");
        1.0 - mean(&draw_small(&gpu, "glass", &set).visibility(&gpu))
    };
    let [clear, opaque] = [glass("opacity", "max_alpha"), glass("opacity", "overlap")];
    assert!(clear > 0.0 && clear < opaque, "{clear} {opaque}");
}

/// RMS and mean of A less that of 256 rays cast from the same pixels.
fn error(gpu: &Gpu, drawn: &RenderedScene) -> [f64; 2] {
    let image = drawn.visibility(gpu);
    let gbuffer = &drawn.pipeline.buffers.gbuffer;
    let [depth, normal] = [&gbuffer.depth, &gbuffer.normal].map(|t| read_texture(gpu, t).unwrap());
    let rays = PixelRays::new(&drawn.params.camera, image.width, image.height);
    let tracer = Tracer::new(&drawn.scene.objects);
    let r_max_m = drawn.params.marching(&drawn.scene).r_max_m;
    let seen: Vec<usize> = (0..depth.data.len()).filter(|i| depth.data[*i] < 1.0).collect();
    assert!(seen.len() >= 1_000, "{} points", seen.len());
    let errors: Vec<f64> = seen
        .par_iter()
        .map(|i| {
            let (x, y) = (i % image.width as usize, i / image.width as usize);
            let place = rays.unproject(x as f64 + 0.5, y as f64 + 0.5, depth.data[*i].into());
            let n = [0, 1, 2].map(|k| f64::from(normal.data[4 * i + k]));
            let n = DVec3::from(n).normalize();
            let exact = occlusion(&tracer, place, n, r_max_m, Obscurity::Linear, 256);
            1.0 - f64::from(image.data[*i]) - exact
        })
        .collect();
    let mean = |values: &mut dyn Iterator<Item = f64>| values.sum::<f64>() / errors.len() as f64;
    let rms = mean(&mut errors.iter().map(|e| e * e)).sqrt();
    [rms, mean(&mut errors.iter().copied())]
}

#[test]
fn occlusion_is_close_to_ray_casting() {
    let gpu = gpu();
    let set = "view.width=56 view.height=56 voxel.resolution=128 voxel.update=once \
        shadow.size=64 ao.rays=64 ao.filter=false";
    let all = [("bunny_dry", 0.05), ("sponza", 0.05), ("dragon_dry", 0.09)];
    // `make test-all` draws them all.
    let count = if cfg!(feature = "nightly") { 3 } else { 1 };
    for (scene, limit) in all.into_iter().take(count) {
        let drawn = draw(&gpu, scene, set);
        let [rms, bias] = error(&gpu, &drawn);
        println!("{scene}: RMS error {rms:.4}, bias {bias:+.4}");
        // The limits are for the scene itself.
        let limit = if drawn.scene.stand_ins.is_empty() { limit } else { 0.1 };
        assert!(rms <= limit, "{scene}: {rms} (bias {bias})");
    }
    // A shell of voxels without a guard occludes itself: the comparison can fail.
    let blind = draw(&gpu, "bunny_dry", &format!("{set} ao.guard=none"));
    assert!(error(&gpu, &blind)[0] > 0.3);
}
