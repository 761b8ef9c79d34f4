//! Every stage agrees with its f64 reference, and every control disagrees.

use fathom::Catalog;
use fathom::gpu::{Gpu, Options};
use fathom::harness::verify::{CheckTable, FinishedCase, Verified, verify};
use fathom::pipelines::PipelineInstance;
use fathom::pipelines::scalar_ao::ScalarAo;
use fathom::record::{Feature, Mask};
use fathom::verify::rig::Rig;
use fathom::verify::{Case, Check, Control};
use glam::DVec3;
use strum::IntoEnumIterator;

use super::common::holds;
use super::{built, gpu, prepared};

/// In two halves at once: they would end long after all other tests.
#[test]
fn every_check_is_sound() {
    let half = |first: usize| {
        let cases: Vec<Case> =
            Catalog::builtin().cases().into_iter().skip(first).step_by(2).collect();
        assert_eq!(sound(&gpu(), &cases, None).skipped, []);
    };
    std::thread::scope(|scope| drop([0, 1].map(|first| scope.spawn(move || half(first)))));
}

/// The second software driver. The loader chooses a driver once per process.
#[cfg(feature = "nightly")]
#[test]
fn every_check_is_sound_on_swiftshader() {
    let mut child = super::common::this_program("verify::child_checks");
    let drivers = ["VK_DRIVER_FILES", "VK_ICD_FILENAMES"];
    child.envs(drivers.map(|name| (name, "/usr/lib/chromium/vk_swiftshader_icd.json")));
    let output = child.env("WGPU_BACKEND", "vulkan").env_remove("WGPU_ADAPTER_NAME").output();
    let output = output.unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

/// Without what browsers lack.
#[cfg(feature = "nightly")]
#[test]
fn every_check_is_sound_in_strict_compliance_with_webgpu() {
    let mut child = super::common::this_program("verify::child_checks");
    let output = child.env("WGPU_STRICT_WEBGPU_COMPLIANCE", "1").output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

#[cfg(feature = "nightly")]
#[test]
#[ignore = "run by `every_check_is_sound_on_swiftshader`"]
fn child_checks() {
    every_check_is_sound();
}

/// All checks with this in their names, sound.
#[track_caller]
fn sound(gpu: &Gpu, cases: &[Case], filter: Option<&str>) -> Verified {
    let done = |case: FinishedCase<'_>| println!("{case}");
    let verified = verify(gpu, cases, filter, done);
    let verified = verified.expect("all cases run");
    println!("{}", CheckTable(&verified.checks));
    let unsound = verified.checks.iter().filter(|check| !check.is_sound());
    let unsound: Vec<_> = unsound.cloned().collect();
    assert!(unsound.is_empty(), "{}\n{}", gpu.adapter.title(), CheckTable(&unsound));
    verified
}

#[test]
fn a_check_is_sound_only_with_a_control_that_fails() {
    let check = |measured: f64, control: f64| {
        let check = Check::new(&Rig::new(Gpu::planner().unwrap(), "a/b"), "error");
        check.within((0.1, "m"), measured).control("index 1.34", control)
    };
    let (good, failed, blind) = (check(0.05, 0.2), check(0.2, 0.3), check(0.0, 0.0));
    assert!(good.is_sound() && !failed.is_sound() && !blind.is_sound());
    assert!(!check(f64::NAN, 0.2).passed && !check(0.05, f64::NAN).is_sound());
    assert!(!Check { control: Control::default(), ..good.clone() }.is_sound());
    let table = CheckTable(&[good.with("p99_m", 1.234e-6), failed, blind]).to_string();
    holds(&table, &["ok     a/b", "FAILED a/b", "BLIND  a/b", "0.0500", "p99_m 1.23e-6"]);
}

#[test]
fn every_stage_of_the_registry_has_a_case() {
    let cases = Catalog::builtin().cases();
    for info in fathom::stages::REGISTRY {
        let (covered, name) = (cases.iter().any(|case| case.stage == info.name), info.name);
        assert!(covered, "{name} has no check: add one under src/verify and a line in its cases");
    }
}

/// With the limits and features that every adapter of WebGPU has, a tenth of the checks: 16-bit sums of splats, lines and points, and others.
#[test]
fn checks_are_sound_with_the_default_limits() {
    let without = Feature::iter().collect();
    let limits = Some(wgpu::Limits::defaults());
    let options = Options { limits, mask: Mask { without }, ..Options::default() };
    let gpu = Gpu::open(&options).unwrap();
    let sums = ["sum of many", "transmission of lines", "pool off the centre"];
    let voxels = ["voxel/slicemap", "the slices' voxels", "voxel/alpha", "voxel/mips"];
    for part in [&sums[..], &voxels, &["hsao", "scene/deform"]].concat() {
        let cases = Catalog::builtin().cases();
        assert_eq!(sound(&gpu, &cases, Some(part)).skipped.len(), 0, "{part}");
    }
}

/// Every mode of `scalar_ao` on a small cloud: its figures lie within what the algorithm allows.
#[test]
fn scalar_fields_give_their_figures() {
    let gpu = gpu();
    for (mode, covered_least) in [("isosurface", 0.02), ("direct", 0.05), ("positional", 0.05)] {
        let small = "view.width=32 view.height=24 volume.reduce=8";
        let set = format!("{small} scalar.mode={mode} scalar.rays=3 scalar.samples=4");
        let (scene, params) = prepared::<ScalarAo>(&gpu, "smoke", &set);
        let pipeline = built::<ScalarAo>(&gpu, &scene, &params);
        let figures = pipeline.all_quantities(&gpu).unwrap();

        let cells = scene.volume.as_ref().unwrap().cells;
        assert_eq!(cells, [25, 16, 25]);
        let levels = [25 * 16 * 25, 12 * 8 * 12, 6 * 4 * 6, 3 * 2 * 3, 1];
        let texels: u32 = if mode == "isosurface" { levels[0] } else { levels.iter().sum() };
        // Values of a generator are not whole steps of 8 bits: two bytes each.
        assert_eq!(figures["volume_bytes"], f64::from(2 * texels), "{mode}");
        let covered = figures["covered_share"];
        assert!(covered > covered_least && covered < 0.9, "{mode}: {figures:?}");
        assert_eq!(figures["r_max_m"], 0.5);
        assert!((figures["step_voxels"] - 0.5 / 4.0 / 0.08).abs() < 1e-6, "{figures:?}");
        // Look-ups of a view step: the value, and in media those of A, its start and a gradient.
        let steps = DVec3::from(cells.map(f64::from)).length() + 1.0;
        let most = match mode {
            "isosurface" => steps + 9.0 + 6.0 + 12.0,
            _ => steps * (1.0 + 12.0 + 1.0 + 6.0),
        };
        assert!(figures["samples_per_pixel_most"] <= most, "{mode}: {figures:?}");
        assert!(figures["samples_per_pixel"] > 1.0, "{mode}: {figures:?}");
        let visibility = figures["visibility_mean"];
        assert!(visibility > 0.1 && visibility < 0.999, "{mode}: {figures:?}");
    }
}
