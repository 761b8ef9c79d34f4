//! The horizon-split pipeline as a whole.

use std::collections::BTreeMap;

use fathom::gpu::{Gpu, Pixels, read_texture};
use fathom::pipelines::PipelineInstance;
use fathom::pipelines::hsao::Hsao;

use super::{built, gpu, mean, prepared};

const SIZE: [u32; 2] = [48, 40];

/// A frame of scene `tank` with some parameters set: its picture and its figures.
fn frame(gpu: &Gpu, set: &str) -> (Pixels, BTreeMap<String, f64>) {
    let [width, height] = SIZE;
    let set = format!("view.width={width} view.height={height} {set}");
    let (scene, params) = prepared::<Hsao>(gpu, "tank", &set);
    let pipeline = built::<Hsao>(gpu, &scene, &params);
    let image = read_texture(gpu, pipeline.image()).unwrap();
    (image, pipeline.all_quantities(gpu).unwrap())
}

#[test]
fn samples_are_bounded_and_pictures_show_what_is_asked() {
    let gpu = gpu();
    let shown = |set: &str| frame(&gpu, &format!("compose.show=occlusion {set}"));

    let (picture, figures) = frame(&gpu, "");
    assert_eq!([picture.width, picture.height], SIZE);
    assert_eq!(figures["samples_per_pixel_most"], 400.0);
    assert!((100.0..=400.0).contains(&figures["samples_per_pixel"]));
    assert!((0.3..=1.0).contains(&figures["covered_share"]));

    let (open, figures) = shown("hsao.rays=0");
    assert_eq!(figures["samples_per_pixel_most"], 256.0);
    let (split, _) = shown("");
    assert!(mean(&split) < mean(&open) && mean(&open) < 1.0);

    // Half of the size and a quarter of the pixels; the picture is as large, and as dark.
    let (small, _) = shown("hsao.scale=0.5");
    assert_eq!([small.width, small.height], SIZE);
    assert!((mean(&small) - mean(&split)).abs() < 0.02);
    let (coarse, _) = shown("hsao.scale=0.5 hsao.filter=false");
    assert!((mean(&coarse) - mean(&split)).abs() < 0.03);

    assert!(mean(&shown("hsao.r_max_m=0.01").0) > mean(&split));
    let (floor, figures) = frame(&gpu, "objects=1");
    assert!(figures["covered_share"] > 0.0 && mean(&floor) != mean(&picture));
}
