//! Small good inputs of every kind, from which the bad ones are made.

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD as BASE64;
use fathom::experiments::Experiment;
use fathom::history::{History, NewRun, Origin};
use fathom::record::Record;
use fathom::record::comparison::{Gate, Side, Skip};

use super::common::{Place, lines, reference};
use super::files::{GLTF, fan, glb, stl};
use super::stored::{BYTES, Stored, TRACE};

type Seeds = Vec<Vec<u8>>;

fn all<const N: usize>(texts: [&str; N]) -> Seeds {
    texts.iter().map(|text| text.as_bytes().to_vec()).collect()
}

/// A scene with objects, water and a volume, for every pipeline.
pub const SCENE: &str = r#"name = "s"
description = "small"
floor_depth_m = 3.0
camera = { position_m = [0.0, -1.2, 5.5], target_m = [0.0, -2.2, 0.0], fov_y_deg = 60.0, z_near_m = 0.1, z_far_m = 11.0 }
light = { kind = "directional", direction = [0.4, -1.0, -0.35] }
water = { model = "circular", amplitude_m = 0.05, wavelength_m = 1.5, noise = 0.1, half_size_m = [10.0, 10.0] }
volume = { generator = "smoke", cells = [8, 6, 8], fit_m = 2.0, translate_m = [0.0, 0.1, 0.0], reduce = 1, window = [0.1, 0.9] }
[[object]]
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

/// The raw volume of [`scenes`]: twelve cells of 16 bits.
pub const RAW: [u8; 24] =
    *b"\0\0\xa0\x0f\x40\x1f\xe0\x2e\x80\x3e\x20\x4e\xc0\x5d\x60\x6d\0\x7d\xa0\x8c\x40\x9c\xe0\xab";

pub fn scenes() -> Seeds {
    let (before, rest) = SCENE.split_once("volume = ").unwrap();
    let raw = "volume = { file = \"a.raw\", cells = [2, 3, 2], format = \"u16\", spacing_m = [0.1, 0.2, 0.3], up = \"z\" }";
    let raw = format!("{before}{raw}\n{}", rest.split_once('\n').unwrap().1);
    all([
        SCENE,
        &raw,
        "base = \"plane\"\nwithout = [\"floor\"]\nname = \"d\"\n[water]\namplitude_m = 0.2\n",
    ])
}

pub fn raw_volumes() -> Seeds {
    vec![RAW.to_vec()]
}

pub fn experiments() -> Seeds {
    let ids = ["vao-view", "uw-photons", "vao-skipping"];
    ids.map(|id| Experiment::builtin_text(id).unwrap().into_bytes()).into()
}

pub fn gates() -> Seeds {
    all([include_str!("../../benches/gates.toml")])
}

/// The shortest cell of a real run, with the run's other lines that concern it.
pub fn records() -> Seeds {
    let text = reference();
    let shortest = |part: &str| {
        text.lines().filter(|line| line.contains(part)).min_by_key(|line| line.len()).unwrap()
    };
    let cell = shortest("\"status\":\"measured\"");
    let id = serde_json::from_str::<serde_json::Value>(cell).unwrap()["experiment"].clone();
    let experiment = format!("\"record\":\"experiment\",\"id\":{id}");
    let kinds =
        ["\"record\":\"run\"", &experiment, "\"status\":\"measured\"", "\"record\":\"end\""];
    all([&(kinds.map(shortest).join("\n") + "\n"), cell])
}

/// A comparison with lines of every kind, and a part of it.
pub fn comparisons() -> Seeds {
    let mut comparison = Stored::new(&[TRACE, "tank godrays/trace"])
        .configuration(BYTES + 1, 0.01)
        .same(TRACE)
        .check(("caustics/trace", "landing"), 0.1, 0.2)
        .fault(Gate::Time, Side::Head, Some(TRACE), false);
    comparison.header.skipped = vec![Skip { gate: Gate::Instructions, reason: "none".into() }];
    let records = comparison.lines().into_iter().map(Record::from);
    let part = lines(records.clone().step_by(3));
    vec![lines(records).into(), part.into()]
}

pub fn objs() -> Seeds {
    all([
        "mtllib absent.mtl\no quad\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nusemtl stone\nf 1/1 2/1\\\n 3/1 4/1 # a\nv 0.2 0.7 0\nf 1 2 3 5 4\n",
        "v 0 0 0 1\nv 1 0 0 1 0 0\nv 0 1 0\nvn 0 0 2\nvn 0 1 0\ng a\nf 1//1 2//1 3//1\r\ng b\nf -1//-1 -2//-2 -3//1\nl 1 2\np 1\n",
    ])
}

pub fn plys() -> Seeds {
    let head = "ply\nformat binary_big_endian 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n";
    let binary = [head.as_bytes(), &[0x3f; 36], &[3, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 2]].concat();
    let text = all([
        "ply\nformat ascii 1.0\ncomment made by hand\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\nproperty float confidence\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0 1\n1 0 0 1\n1 1 0 1\n0 1 0 1\n4 0 1 2 3\n",
    ]);
    [text, vec![binary]].concat()
}

pub fn stls() -> Seeds {
    let text = b"solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\nendsolid a\n";
    vec![text.to_vec(), stl(b"solid", &[[[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]; 2], 1)]
}

pub fn glbs() -> Seeds {
    let nodes = r#"{"children":[1],"scale":[1,-2,3]},{"mesh":0,"rotation":[0,1,0,0]}"#;
    let sparse = r#"4,0],"sparse":{"count":1,"indices":{"bufferView":1,"componentType":5121},"values":{"bufferView":1}}}"#;
    let changes = [("", ""), (r#"{"mesh":0}"#, nodes), ("4,0]}", sparse)];
    changes.map(|(part, other)| glb(&GLTF.replace(part, other), &fan())).into()
}

pub fn gltfs() -> Seeds {
    let embedded = format!("data:;base64,{}", BASE64.encode(fan()));
    let with = |uri| GLTF.replace("\"buffers\":[{", &format!("\"buffers\":[{{\"uri\":\"{uri}\","));
    [&*embedded, "./a.raw"].map(|uri| with(uri).into_bytes()).into()
}

/// Requests to a worker and its replies.
pub fn messages() -> Seeds {
    all([
        r#"{"message":"prepare","id":"tank","pipeline":"underwater","scene":"tank","params":{"caustics.grid":50}}"#,
        r#"{"message":"sample","config":"a","stage":"caustics/trace","frames":3}"#,
        r#"{"message":"sample","ns":[1.5,2.0],"machine":null}"#,
        r#"{"message":"exact","stages":[{"name":"a","work":{"photons":3},"counters":{"x":1}}],"allocated_bytes":7,"errors":{"e":null},"quantities":{"q":0.5},"notes":[]}"#,
        r#"{"message":"checks","checks":[{"stage":"a","what":"b","unit":"m","measured":null,"tolerance":0.1,"sound":true}]}"#,
    ])
}

/// The bytes of a history of twelve runs a day apart, enough of them to be searched.
pub fn histories() -> Seeds {
    let place = Place::new();
    let path = place.path("history.sqlite");
    let mut history = History::open_or_make(&path).unwrap();
    let records = String::from_utf8(records().remove(0)).unwrap();
    for day in 0..12 {
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
    vec![std::fs::read(path).unwrap()]
}
