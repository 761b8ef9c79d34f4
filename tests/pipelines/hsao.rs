//! The horizon-split pipeline as a whole.

use std::collections::BTreeMap;

use fathom::gpu::{Gpu, Pixels, read_texture};
use fathom::pipelines::Pipeline;
use fathom::pipelines::hsao::Hsao;
use serde_json::json;

use super::{Set, built, gpu, mean, prepared};

const SIZE: [u32; 2] = [48, 40];

/// A frame of scene `tank` with some parameters set: its picture and its figures.
fn frame(gpu: &Gpu, set: &Set<'_>) -> (Pixels, BTreeMap<String, f64>) {
    let size = [("view.width", json!(SIZE[0])), ("view.height", json!(SIZE[1]))];
    let (scene, params) = prepared::<Hsao>(gpu, "tank", &[&size, set].concat());
    let pipeline = built::<Hsao>(gpu, &scene, &params);
    let image = read_texture(gpu, pipeline.image()).unwrap();
    (image, pipeline.quantities(gpu).unwrap())
}

#[test]
fn samples_are_bounded_and_pictures_show_what_is_asked() {
    let gpu = gpu();
    let occlusion = ("compose.show", json!("occlusion"));

    let (picture, figures) = frame(&gpu, &[]);
    assert_eq!([picture.width, picture.height], SIZE);
    assert_eq!(figures["samples_per_pixel_most"], 400.0);
    assert!((100.0..=400.0).contains(&figures["samples_per_pixel"]));
    assert!((0.3..=1.0).contains(&figures["covered_share"]));

    let (open, figures) = frame(&gpu, &[occlusion.clone(), ("hsao.rays", json!(0))]);
    assert_eq!(figures["samples_per_pixel_most"], 256.0);
    let (split, _) = frame(&gpu, std::slice::from_ref(&occlusion));
    assert!(mean(&split) < mean(&open) && mean(&open) < 1.0);

    // Half of the size and a quarter of the pixels; the picture is as large, and as dark.
    let half = ("hsao.scale", json!(0.5));
    let (small, _) = frame(&gpu, &[occlusion.clone(), half.clone()]);
    assert_eq!([small.width, small.height], SIZE);
    assert!((mean(&small) - mean(&split)).abs() < 0.02);
    let (coarse, _) = frame(&gpu, &[occlusion.clone(), half, ("hsao.filter", json!(false))]);
    assert!((mean(&coarse) - mean(&split)).abs() < 0.03);

    let near = [occlusion, ("hsao.r_max_m", json!(0.01))];
    assert!(mean(&frame(&gpu, &near).0) > mean(&split));
    let (floor, figures) = frame(&gpu, &[("objects", json!(1))]);
    assert!(figures["covered_share"] > 0.0 && mean(&floor) != mean(&picture));
}
