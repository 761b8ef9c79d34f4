//! Splats by the rasterizer and by a compute shader, and light that does not depend on the shape of the buffers that it is gathered in.

use fathom::gpu::{Gpu, read_texture};
use fathom::pipelines::underwater::{IntensityRule, Params, Underwater};
use fathom::pipelines::{BuiltPipeline, PipelineInstance};
use fathom::stages::splatting::SplatSums;
use rand::seq::IndexedRandom;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

use super::draws;
use crate::{built, gpu, prepared};

/// What the stage has added up in each pixel.
fn texels(gpu: &Gpu, sums: &SplatSums) -> Vec<f64> {
    let data = read_texture(gpu, &sums.texture).unwrap().data;
    data.into_iter().map(f64::from).collect()
}

/// Settings that a pipeline's splats depend on: some lie beyond the picture, others over all of it.
fn splats(random: &mut Pcg64) -> (&'static str, String) {
    let mut between = |low: f64, high: f64| low * (high / low).powf(random.random_range(0.0..1.0));
    let [width, height, rows, columns] = [(); 4].map(|()| between(2.0, 120.0).round());
    let small_px = between(0.1, 40.0);
    let large_px = between(small_px, 1024.0);
    let lens =
        format!("camera.fov_y_deg={} camera.z_near_m={}", between(15.0, 120.0), between(0.01, 0.5));
    let (bias_m, gamma_per_m) = (between(0.01, 3.0), between(0.01, 1.0));
    let grid = between(2.0, 24.0).round();
    let intensity = ["paper", "conserving"].choose(random).unwrap();
    let fresnel = random.random_bool(0.5);
    let scene = ["plane", "pool", "tank"].choose(random).unwrap();
    let few =
        "shadow.size=128 surface.cells=4 surface.scale=0.1 godrays.grid=1 caustics.filter=false";
    let set = format!(
        "{few} {lens} view.width={width} view.height={height} caustics.buffer=[{columns},{rows}] caustics.grid={grid} \
         caustics.point_size_min_px={small_px} caustics.point_size_max_px={large_px} caustics.depth_bias_m={bias_m} \
         water.attenuation_per_m={gamma_per_m} water.fresnel={fresnel} caustics.intensity={intensity}"
    );
    (scene, set)
}

#[test]
fn the_rasterizers_splats_are_those_of_the_compute_shader() {
    const BOUND: f64 = 1e-3;
    let gpu = gpu();
    let mut of_squares = 0.0_f64;
    for seed in 0..draws() {
        let (scene, set) = splats(&mut Pcg64::seed_from_u64(seed));
        let drawn = |splatting: &str, coverage: &str| {
            let how = format!("{set} caustics.splatting={splatting} caustics.coverage={coverage}");
            let (scene, params) = prepared::<Underwater>(&gpu, scene, &how);
            let pipeline =
                gpu.catch(|| BuiltPipeline::<Underwater>::new(&gpu, &scene, &params)).unwrap();
            let stages = pipeline.stages();
            let last = stages.iter().position(|stage| stage.name() == "caustics/splat").unwrap();
            gpu.run(&stages[..=last]).unwrap();
            texels(&gpu, &pipeline.caustics.drawn)
        };
        let [surface, square] = ["surface", "square"].map(|coverage| {
            let [raster, compute] =
                ["raster", "compute"].map(|splatting| drawn(splatting, coverage));
            let off = difference(&raster, &compute);
            assert!(off <= BOUND, "draw {seed}, {scene}, {coverage}: off by {off}: {set}");
            compute
        });
        of_squares = of_squares.max(difference(&square, &surface));
    }
    assert!(of_squares > 10.0 * BOUND, "squares and surfaces look alike: {of_squares}");
}

/// Σ |difference| / Σ.
fn difference(found: &[f64], exact: &[f64]) -> f64 {
    let off: f64 = found.iter().zip(exact).map(|(a, b)| (a - b).abs()).sum();
    off / exact.iter().sum::<f64>().max(f64::MIN_POSITIVE)
}

/// Mean over the picture of the irradiance of a level floor seen from above, over the exact one, and of the light shafts' radiance.
fn seen_from_above(pipeline: &BuiltPipeline<Underwater>, gpu: &Gpu, params: &Params) -> [f64; 2] {
    let scale = |stage: &str, what: &str| pipeline.context(stage)[what]["scale"].as_f64().unwrap();
    let mean = |sums: &SplatSums| {
        let texels = texels(gpu, sums);
        texels.iter().sum::<f64>() / texels.len() as f64
    };
    let per_m2 = match params.caustics.intensity {
        IntensityRule::Paper => scale("caustics/splat", "irradiance"),
        IntensityRule::Conserving => (scale("caustics/splat", "irradiance") * FLOOR_M).powi(-2),
    };
    let irradiance = mean(&pipeline.caustics.drawn) * per_m2 / params.light.intensity_w_sr;
    [irradiance, mean(&pipeline.godrays.drawn) * scale("godrays/lines", "radiance")]
}

/// From the camera to the floor.
const FLOOR_M: f64 = 6.0;

#[test]
fn brightness_does_not_depend_on_the_shape_of_a_buffer() {
    const BOUND: f64 = 0.02;
    let gpu = gpu();
    let view = "camera.position_m=[0,3,0] camera.target_m=[0,-3,0] camera.up=[0,0,-1] camera.fov_y_deg=8 \
         light.direction=[0,-1,0] water.amplitude_m=0 water.attenuation_per_m=0 shadow.size=128 surface.cells=4 caustics.grid=60";
    let shapes = [
        "[48,48]", "[120,96]", "[50,200]", "[200,50]", "[38,31]", "[7,3]", "[9,90]", "[300,20]",
        "[33,17]", "[0,0]",
    ];
    for intensity in ["paper", "conserving"] {
        let (mut shafts, mut by_height) = (None, 0.0_f64);
        for buffer in shapes {
            let size = if buffer == "[0,0]" { [101, 7] } else { [48, 48] };
            let set = format!(
                "{view} view.width={} view.height={} caustics.buffer={buffer} godrays.buffer={buffer} caustics.intensity={intensity} \
                 godrays.intensity={intensity}",
                size[0], size[1]
            );
            let (scene, params) = prepared::<Underwater>(&gpu, "plane", &set);
            let pipeline = built::<Underwater>(&gpu, &scene, &params);
            let [irradiance, radiance] = seen_from_above(&pipeline, &gpu, &params);
            assert!((irradiance - 1.0).abs() < BOUND, "{intensity}, {buffer}: {irradiance}");
            let [columns, rows] = params.caustics_buffer().map(f64::from);
            let squeezed = columns / rows * f64::from(size[1]) / f64::from(size[0]);
            by_height = by_height.max((irradiance / squeezed - 1.0).abs());
            // Lines shorter than a pixel leave out the few middles of pixels.
            if buffer != "[7,3]" && buffer != "[0,0]" {
                let first = *shafts.get_or_insert(radiance);
                assert!(
                    (radiance / first - 1.0).abs() < BOUND,
                    "{intensity}, {buffer}: {radiance}"
                );
            }
        }
        assert!(by_height > 1.0, "pixels as wide as high would do: {by_height}");
    }
}
