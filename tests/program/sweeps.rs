//! `fathom sweep` over a mesh of one's own, as a user meets it.

use crate::common::{Ends, Place, cells, holds, measured};
use crate::files::{GLTF, fan, glb};

#[test]
fn a_sweep_over_a_mesh_prints_tables_and_leaves_its_experiment() {
    let place = Place::new();
    let elsewhere = Place::new();
    let mesh = elsewhere.write("own.glb", glb(GLTF, &fan())).display().to_string();
    let sizes = "--set view.width=40 --set view.height=30 --set shadow.size=64 --set ao.rays=4 --camera 10,40";
    let sweep =
        format!("sweep volume_ao --scene {mesh} --axis voxel.resolution=8,16,32 --precision 1");
    let output = place.fathom(format!("{sweep} {sizes} --budget 10m --out out")).answer();
    let expected = [
        "times over voxels along the longest side",
        "growth over voxels along the longest side",
        "RMS error of occlusion",
        "More than 50 % of the frame",
        "3 cells measured, 0 skipped, 0 failed",
    ];
    holds(&output, &expected);
    assert!(!output.contains("NaN"), "{output}");
    let cells = cells(&place.path("out"));
    let mut errors = cells.iter().flat_map(|cell| &measured(cell).errors);
    assert!(errors.all(|error| error.value.is_finite()), "{output}");
    let page = place.read("out/index.html");
    holds(&page, &["id=\"sizes\"", "growth over voxels"]);
    assert!(!page.contains("href=\"#claims\""), "there is no such section");
    holds(&place.read("out/cells.csv"), &["axis:voxel.resolution"]);
    let private = elsewhere.path("").display().to_string();
    for name in ["records.jsonl", "index.html", "cells.csv", "summary.md"] {
        assert!(!place.read(format!("out/{name}")).contains(&private), "{name} tells {private}");
    }
    let again = place.fathom("run out/sweep.toml --out out --resume --precision 1").answer();
    holds(&again, &["0 cells measured, 0 skipped, 0 failed, 3 kept"]);
}
