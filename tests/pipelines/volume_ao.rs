//! The volume ambient occlusion pipeline as a whole: its variants.

use fathom::gpu::{Gpu, Pixels, read_texture};
use fathom::pipelines::volume_ao::VolumeAo;
use fathom::pipelines::{BuiltPipeline, PipelineInstance};

use super::{built, gpu, mean, prepared};

type Built = BuiltPipeline<VolumeAo>;

/// With a small picture and a small volume.
fn draw_small(gpu: &Gpu, scene: &str, set: &str) -> Built {
    let small = "view.width=48 view.height=40 voxel.resolution=32 shadow.size=64 ao.rays=16";
    let (scene, params) = prepared::<VolumeAo>(gpu, scene, &format!("{small} {set}"));
    built::<VolumeAo>(gpu, &scene, &params)
}

fn visibility_of(gpu: &Gpu, pipeline: &Built) -> Pixels {
    read_texture(gpu, &pipeline.buffers.raw.1).unwrap()
}

#[test]
fn variants_agree_where_they_must() {
    let gpu = gpu();
    let run = |set: &str| draw_small(&gpu, "ball", set);
    let plain = run("");
    let visibility = visibility_of(&gpu, &plain);
    assert!((0.5..0.99).contains(&mean(&visibility)));
    let image = read_texture(&gpu, plain.image()).unwrap();
    assert_eq!([image.width, image.height], [48, 40]);

    let once = run("voxel.update=once");
    assert_eq!(visibility_of(&gpu, &once).data, visibility.data);
    let [fills, kept] =
        [&plain, &once].map(|of| of.stages().iter().any(|stage| stage.name() == "voxel/unpack"));
    assert!(fills && !kept);

    let skipping = run("ao.skipping=true");
    assert_eq!(visibility_of(&gpu, &skipping).data, visibility.data);
    let [taken, all] = [&skipping, &plain].map(|of| of.all_quantities(&gpu).unwrap());
    assert!(taken["samples_per_pixel_mean"] < 0.75 * all["samples_per_pixel_mean"], "{taken:?}");
    assert!(taken["lookups_per_pixel_mean"] > 0.0);

    let half = visibility_of(&gpu, &run("ao.scale=0.5 ao.filter=false"));
    assert_eq!([half.width, half.height], [24, 20]);
    assert!((mean(&half) - mean(&visibility)).abs() < 0.02);

    let paper = run("ao.estimator=paper");
    let [halved, whole] = [mean(&visibility_of(&gpu, &paper)), mean(&visibility)].map(|v| 1.0 - v);
    assert!((halved / whole - 0.5).abs() < 0.1, "{halved} of {whole}");
}

#[test]
fn volumes_of_objects_multiply_and_glass_lets_light_through() {
    let gpu = gpu();
    // The volume of all crates has few voxels: near contacts the default's high threshold would miss most of what there is.
    let crates = "voxel.method=slicemap ao.threshold=0.55 ao.offset_voxels=0.25 \
        ao.r_max_m=0.5 objects=4";
    let each = draw_small(&gpu, "crates", &format!("voxel.per_object=true {crates}"));
    assert_eq!(each.volumes.len(), 4);
    let all = draw_small(&gpu, "crates", crates);
    let [each, all] = [&each, &all].map(|d| 1.0 - mean(&visibility_of(&gpu, d)));
    assert!(each > 0.0 && all > 0.0 && (each / all - 1.0).abs() < 1.0, "{each} {all}");

    let glass = |occluder: &str, method: &str| {
        let set = format!("ao.occluder={occluder} voxel.method={method}");
        1.0 - mean(&visibility_of(&gpu, &draw_small(&gpu, "glass", &set)))
    };
    let [clear, opaque] = [glass("opacity", "max_alpha"), glass("opacity", "overlap")];
    assert!(clear > 0.0 && clear < opaque, "{clear} {opaque}");
}
