//! `examples/vulkan_worker`: a worker in C++ with Vulkan.

use std::path::{Path, PathBuf};
use std::process::Command;

use fathom::compare::store::Comparison;

use super::common::{Ends, Place, holds};

/// Built by make, which needs g++, glslang and the headers of Vulkan and nlohmann-json.
fn vulkan_worker(place: &Place) -> PathBuf {
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/vulkan_worker");
    let mut make = Command::new("make");
    make.arg("-C").arg(source).arg(format!("OUT={}", place.path("").display())).ends(0);
    place.path("vulkan_worker")
}

/// By the turns that the shader has counted. Of times no more is asked than that they are there.
#[test]
fn a_program_in_cpp_is_compared_by_vulkan_alone() {
    let place = Place::new();
    let worker = vulkan_worker(&place);
    let cells = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/vulkan_worker/cells.toml");
    let compared = |options: &str, [base, head]: [&str; 2]| {
        let mut compare = place.fathom(format!("compare --pairs 2 {options} --cells-file"));
        compare.arg(&cells).args(["--base-cmd", &format!("'{}' {base}", worker.display())]);
        compare.args(["--head-cmd", &format!("'{}' {head}", worker.display())]);
        compare
    };
    let equal = compared("--launches 10 --out equal", ["--counted", "--counted"]).ends(0);
    holds(&equal.out, &["no regression", "2 same", "vulkan_worker 1.0"]);
    let slower = compared("--launches 10 --out slower", ["--counted", "--counted --work 1.05"]);
    holds(&{ slower }.ends(1).out, &["regression", "2 slower", "+5.0 %"]);
    // Two launches are too few for a verdict.
    compared("--launches 2 --out cpu", ["", ""]).ends(3);
    let stored = Comparison::read(&place.path("cpu")).unwrap();
    assert!(stored.faults.is_empty() && stored.launches.len() == 2, "{:?}", stored.faults);
    // What those of a software driver are worth is not for this test to say.
    let asked = compared("--launches 1 --out timestamps", ["--timestamps"; 2]).output().unwrap();
    assert!([2, 3].contains(&asked.status.code().unwrap()));
    let stored = Comparison::read(&place.path("timestamps")).unwrap();
    assert!(stored.faults.iter().all(|fault| fault.reason.contains("timestamps")));
    compared("--launches 2 --out other", ["", "--wrok 2"]).refused("the head build: it ended with");
}
