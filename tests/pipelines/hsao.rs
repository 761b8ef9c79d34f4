//! The pipelines of occlusion from depth as wholes.

use std::collections::BTreeMap;

use fathom::gpu::{Gpu, Pixels, read_texture};
use fathom::pipelines::Pipeline;
use fathom::pipelines::gtao::Gtao;
use fathom::pipelines::hsao::Hsao;

use super::{built, gpu, mean, prepared};

const SIZE: [u32; 2] = [48, 40];

/// A frame of scene `tank` with some parameters set: its picture and its figures.
fn frame<P: Pipeline>(gpu: &Gpu, set: &str) -> (Pixels, BTreeMap<String, f64>) {
    let [width, height] = SIZE;
    let set = format!("view.width={width} view.height={height} {set}");
    let (scene, params) = prepared::<P>(gpu, "tank", &set);
    let pipeline = built::<P>(gpu, &scene, &params);
    let image = read_texture(gpu, pipeline.image()).unwrap();
    (image, pipeline.all_quantities(gpu).unwrap())
}

#[test]
fn samples_are_bounded_and_pictures_show_what_is_asked() {
    let gpu = gpu();
    let shown = |set: &str| frame::<Hsao>(&gpu, &format!("compose.show=occlusion {set}"));

    let (picture, figures) = frame::<Hsao>(&gpu, "");
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
    let (floor, figures) = frame::<Hsao>(&gpu, "objects=1");
    assert!(figures["covered_share"] > 0.0 && mean(&floor) != mean(&picture));
}

#[test]
fn slices_are_gathered_as_asked() {
    let gpu = gpu();
    let shown = |set: &str| frame::<Gtao>(&gpu, &format!("compose.show=occlusion {set}"));
    let (bits, figures) = shown("");
    assert_eq!(figures["samples_per_pixel_most"], 18.0);
    assert!((12.0..=18.0).contains(&figures["samples_per_pixel"]));
    // Horizons take all that is behind a surface for solid; falling, they take less.
    let dark = |set: &str| 1.0 - mean(&shown(&format!("gtao.steps=12 {set}")).0);
    let solid = dark("gtao.occluders=horizons");
    assert!(dark("gtao.thickness_share=0.05") < 0.9 * solid && solid > 0.05);
    assert!(dark("gtao.occluders=horizons gtao.fall=0.3") < 0.9 * solid);
    for same in ["gtao.scale=0.5", "gtao.window=square", "gtao.seed=5"] {
        let (picture, _) = shown(same);
        assert_eq!([picture.width, picture.height], SIZE);
        assert!((mean(&picture) - mean(&bits)).abs() < 0.02 && picture != bits, "{same}");
    }
}
