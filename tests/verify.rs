//! Every stage agrees with its f64 reference, and every control disagrees, on the adapter at hand.

use fathom::gpu::{Gpu, Options};
use fathom::harness::verify::{Table, VerifyError, verify};

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
