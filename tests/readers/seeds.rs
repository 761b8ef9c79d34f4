//! Small good inputs of every kind, from which the bad ones are made.

use std::path::Path;

use fathom::experiments::Experiment;
use fathom::history::{History, NewRun, Origin};
use fathom::record::Record;
use fathom::record::comparison::{Gate, Side, Skip};

use super::common::{Place, lines, reference};
use super::stored::{BYTES, Stored, TRACE};

type Seeds = Vec<Vec<u8>>;

fn all<const N: usize>(texts: [&str; N]) -> Seeds {
    texts.iter().map(|text| text.as_bytes().to_vec()).collect()
}

const SCENE: &str = r#"name = "s"
description = "small"
floor_depth_m = 3.0
[camera]
position_m = [0.0, -1.2, 5.5]
target_m = [0.0, -2.2, 0.0]
fov_y_deg = 60.0
z_near_m = 0.1
z_far_m = 11.0
[light]
kind = "directional"
direction = [0.4, -1.0, -0.35]
[water]
model = "circular"
amplitude_m = 0.05
wavelength_m = 1.5
noise = 0.1
half_size_m = [10.0, 10.0]
"#;

const OBJECTS: &str = r#"[[object]]
name = "floor"
generator = "plane"
params = { width_m = 20.0, depth_m = 20.0 }
material = { albedo = [0.75, 0.72, 0.65], tile_m = 1.0 }
[[object]]
name = "ball"
generator = "sphere"
params = { rows = 5 }
transform = { fit_m = 1.5, rotate_deg = [0, 30, 0], translate_m = [1, 0, 1] }
"#;

const VOLUME: &str = r#"[volume]
generator = "smoke"
cells = [8, 6, 8]
fit_m = 2.0
translate_m = [0.0, 0.1, 0.0]
reduce = 1
window = [0.1, 0.9]
"#;

const DERIVED: &str = r#"base = "plane"
without = ["floor"]
name = "d"
[water]
amplitude_m = 0.2
[[object]]
name = "k"
generator = "knot"
params = { segments = 24, sides = 3 }
"#;

pub fn scenes() -> Seeds {
    let whole = [SCENE, VOLUME, OBJECTS].concat();
    all([&[SCENE, OBJECTS].concat(), &whole, DERIVED])
}

/// A scene with objects, water and a volume, for every pipeline.
pub fn small_scene() -> String {
    [SCENE, VOLUME, OBJECTS].concat()
}

pub fn volume_scene(file: &Path, keys: &str) -> String {
    let name = file.file_name().unwrap().to_string_lossy();
    format!("{SCENE}[volume]\nfile = \"{name}\"\n{keys}\n")
}

pub fn experiments() -> Seeds {
    let ids = ["vao-view", "uw-photons", "vao-skipping"];
    ids.map(|id| Experiment::builtin_text(id).unwrap().into_bytes()).into()
}

pub fn axes() -> Seeds {
    all(["caustics.grid=100,200", "godrays.grid = 50 , 100", "caustics.grid=1"])
}

pub fn points() -> Seeds {
    all([
        "x,y,z,nx,ny,nz\n1,2,3,0,1,0\n-0.5,2e1,3,0.1,1,-1\n",
        "name,nz, ny,nx,z,y,x\n\"a, b\",0,2,0,3, 2,1\n",
    ])
}

/// The shortest cell of a real run, with the run's other lines that concern it.
pub fn records() -> Seeds {
    let text = reference();
    let shortest = |part: &str| {
        let with_it = text.lines().filter(|line| line.contains(part));
        with_it.min_by_key(|line| line.len()).unwrap()
    };
    let cell = shortest("\"status\":\"measured\"");
    let id = serde_json::from_str::<serde_json::Value>(cell).unwrap()["experiment"].clone();
    let whole = [
        shortest("\"record\":\"run\""),
        shortest(&format!("\"record\":\"experiment\",\"id\":{id}")),
        cell,
        shortest("\"record\":\"end\""),
    ];
    vec![(whole.join("\n") + "\n").into_bytes(), cell.into()]
}

/// A comparison with lines of every kind, and a part of it.
pub fn comparisons() -> Seeds {
    let other = "tank godrays/trace";
    let mut comparison = Stored::new(&[TRACE, other])
        .configuration(BYTES + 1, 0.01)
        .same(TRACE)
        .check(("caustics/trace", "landing"), 0.1, 0.2)
        .fault(Gate::Time, Side::Head, Some(other), false);
    comparison.header.skipped = vec![Skip { gate: Gate::Instructions, reason: "none".into() }];
    comparison.header.notes = vec!["a note".into()];
    let records = comparison.lines().into_iter().map(Record::from);
    let part = lines(records.clone().step_by(3));
    vec![lines(records).into(), part.into()]
}

pub fn manifests() -> Seeds {
    let manifest = |library: &str| {
        format!(
            r#"{{"file_format_version": "1.0.0", "ICD": {{"library_path": "{library}", "api_version": "1.3.0"}}}}"#
        )
    };
    ["libvulkan_lvp.so", "./icd.json", "/usr/lib/libvulkan_lvp.so"]
        .map(|library| manifest(library).into_bytes())
        .into()
}

pub fn gates() -> Seeds {
    all([
        include_str!("../../benches/gates.toml"),
        "id = \"g\"\ntitle = \"t\"\nsource = \"s\"\npipeline = \"underwater\"\nscene = \"tank\"\ncontrol = \"a caustics/trace\"\n[[sweep]]\nid = \"a\"\nstages = [\"caustics/trace\"]\nparams = { caustics.grid = 10 }\n",
    ])
}

pub fn objs() -> Seeds {
    all([
        "mtllib absent.mtl\no quad\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nusemtl stone\nf 1/1 2/1 3/1 4/1\n",
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 2\nvn 0 1 0\ng a\nf 1//1 2//1 3//1\ng b\nf -1//-1 -2//-2 -3//1\nl 1 2\np 1\n",
        "v 0 0 0 1\nv 1 0 0 1 0 0\nv 0 1 0 2\nvt 1 1\nvn 0 0 1\nf 1/1/1 2/1/1 3/1/1\r\n",
    ])
}

pub fn plys() -> Seeds {
    all([
        "ply\nformat ascii 1.0\ncomment made by hand\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\nproperty float confidence\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0 1\n1 0 0 1\n1 1 0 1\n0 1 0 1\n4 0 1 2 3\n",
    ])
}

pub fn raws() -> Seeds {
    vec![(0..12u16).flat_map(|i| (i * 4000).to_le_bytes()).collect()]
}

pub fn raw_keys() -> Seeds {
    all([
        "cells = [2, 3, 2]\nformat = \"u16\"\nspacing_m = [0.1, 0.2, 0.3]\nup = \"z\"\nreduce = 2\nwindow = [0, 44000]\nfit_m = 2.0\ntranslate_m = [0, 0, 0]\non = \"floor\"",
    ])
}

pub fn values() -> Seeds {
    all(["1", "0.5", "[64, 64]", "true", "paper", "[0.1, 0.2, 0.3]", "-3e2"])
}

/// Requests to a worker and its replies.
pub fn messages() -> Seeds {
    all([
        r#"{"message":"hello","protocol":1,"clock":null}"#,
        r#"{"message":"prepare","id":"tank","pipeline":"underwater","scene":"tank","params":{"caustics.grid":50}}"#,
        r#"{"message":"sample","config":"a","stage":"caustics/trace","frames":3}"#,
        r#"{"message":"instructions","config":"a","stage":"caustics/trace","frames":3}"#,
        r#"{"message":"checks","stages":["caustics/trace"]}"#,
        r#"{"message":"sample","ns":[1.5,2.0],"machine":null}"#,
        r#"{"message":"prepared","stages":[{"name":"caustics/trace","kind":"compute"}]}"#,
        r#"{"message":"exact","stages":[{"name":"a","work":{"photons":3},"counters":{"x":1}}],"allocated_bytes":7,"errors":{"e":null},"quantities":{"q":0.5},"notes":[]}"#,
        r#"{"message":"checks","checks":[{"stage":"a","what":"b","unit":"m","measured":null,"tolerance":0.1,"sound":true}]}"#,
        r#"{"message":"fault","reason":"no","fatal":true,"absent":false}"#,
        r#"{"message":"unsupported","request":"x"}"#,
    ])
}

/// Runs of a history, enough of them to be searched.
const RUNS: usize = 12;

/// The bytes of a history of runs a day apart.
pub fn history() -> Vec<u8> {
    let place = Place::new();
    let path = place.path("history.sqlite");
    let mut history = History::open_or_make(&path).unwrap();
    let records = String::from_utf8(records().remove(0)).unwrap();
    for day in 0..RUNS {
        // White space makes another run of it.
        place.write("run/records.jsonl", format!("{records}{}\n", " ".repeat(day)));
        let run = NewRun::read(&place.path("run"), "records.jsonl").unwrap();
        let origin = Origin {
            commit: format!("{day:040}"),
            committed_at: Some(1_700_000_000 + 86_400 * day as i64),
            branch: "main".to_owned(),
            machine: Some("m".to_owned()),
            host: None,
        };
        history.add(&run, &origin).unwrap();
    }
    drop(history);
    std::fs::read(path).unwrap()
}
