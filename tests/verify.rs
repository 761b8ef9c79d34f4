//! Every stage agrees with its f64 reference, and every control disagrees, on the adapter at hand.

use fathom::gpu::{ClockPlan, Encode, FrameTimer, Gpu, Options, SubmitCost};
use fathom::harness::landing::photon_quantities;
use fathom::harness::verify::{Table, VerifyError, verify};
use fathom::pipelines::Pipeline;
use fathom::pipelines::underwater::{Params, Underwater};
use fathom::scene::{Scene, SceneFile};

fn gpu() -> Gpu {
    Gpu::open(&Options::default())
        .expect("a Vulkan driver: `make test` installs lavapipe where there is none")
}

#[test]
fn every_check_is_sound() {
    let checks = verify(&gpu(), None).expect("all cases run");
    println!("{}", Table(&checks));
    let unsound: Vec<_> = checks
        .iter()
        .filter(|check| !check.is_sound())
        .cloned()
        .collect();
    assert!(unsound.is_empty(), "\n{}", Table(&unsound));
}

#[test]
fn an_unknown_filter_names_the_stages() {
    let error = verify(&gpu(), Some("cuastics")).unwrap_err();
    assert!(matches!(error, VerifyError::NoMatch { .. }));
    assert!(error.to_string().contains("caustics/trace"), "{error}");
}

#[test]
fn photons_of_a_built_pipeline_have_their_errors() {
    let gpu = gpu();
    let file = SceneFile::load("plane").unwrap();
    let scene = Scene::build(&file).unwrap();
    let mut params = Params::from_scene(&file);
    (params.view.width, params.view.height) = (200, 160);
    params.caustics.grid = 120;
    params.caustics.offset = [0.3, 0.8];
    params.godrays.grid = 20;
    let pipeline = Underwater::new(&gpu, &scene, params.clone()).unwrap();
    let stages: Vec<&dyn Encode> = pipeline
        .stages()
        .into_iter()
        .map(|stage| stage as &dyn Encode)
        .collect();
    let mut timer = FrameTimer::new(&gpu, ClockPlan::fenced(SubmitCost::default()), 64).unwrap();
    timer.untimed(&gpu, &stages).unwrap();
    let figures = photon_quantities(&gpu, &scene, &params, &pipeline).unwrap();
    for name in ["caustics", "godrays"] {
        assert!(
            figures[&format!("{name}_photon_error_median_m")] < 1e-4,
            "{figures:?}"
        );
        assert!(
            figures[&format!("{name}_photon_miss_rate")] < 0.1,
            "{figures:?}"
        );
    }
    params.caustics.offset = [0.5, 0.5];
    let moved = photon_quantities(&gpu, &scene, &params, &pipeline).unwrap();
    assert!(
        moved["caustics_photon_error_median_m"] > 1e-3,
        "the reference follows the offset"
    );
}
