//! Records in which every name is hostile.

use serde_json::{Value, json};

/// Names that mean something to a terminal, a browser, a spreadsheet, an XML or Markdown reader, or a file system.
pub const HOSTILE: [&str; 14] = [
    "<script>alert(1)</script>",
    "a|b",
    "line\nbreak\r\n# heading",
    "\u{1b}[31mred\u{7}",
    "=cmd|' /C calc'!A0",
    "+1@SUM(A1)",
    "](http://evil) ![x](http://evil)",
    "\u{202e}thgir",
    "nul\u{0}\u{fffe}\u{9b}2J",
    "]]> &amp; </text>",
    "../../up",
    "/tmp/absolute",
    "`code` and `",
    "a_b",
];

/// It lies beside the records; another that they name does not.
pub const PICTURE: &str = "renders/own_](x) <b>.png";

fn estimate(median: f64) -> Value {
    json!({ "median": median, "low": 0.98 * median, "high": 1.02 * median, "n": 4 })
}

fn measured(name: &str, number: usize) -> Value {
    let ns = 1e6 * (number + 1) as f64;
    let stage = |stage: &str| {
        json!({
            "stage": stage, "clock": "timestamp", "samples_ns": [ns, ns, ns, ns], "time": estimate(ns),
            "work": { "photons": 100, "fragments": 10 },
        })
    };
    json!({
        "status": "measured",
        "stages": [stage("caustics/trace"), stage(name)],
        "frame": {
            "rounds": [1, 2, 3, 4], "sampled_at_s": [1.0, 2.0, 3.0, 4.0],
            "envelope_samples_ns": [ns, ns, ns, ns], "gap_samples_ns": [1.0, 1.0, 1.0, 1.0], "accounting_error": 0.001,
            "untimed_samples_ns": [ns, ns, ns, ns], "untimed": estimate(ns), "timing_cost": estimate(1.0),
        },
        "allocated_bytes": 1000, "quantities": { name: 0.5 }, "warm_up_frames": 3,
        "rejected": [{ "stage": name, "fault": "zero", "frames": 2 }],
        "notes": [{ "kind": "not_computed", "text": name }],
        "pictures": [{ "path": PICTURE, "shows": "image" }, { "path": "renders/gone.png", "shows": "error" }],
    })
}

fn cell(name: &str, axis: &str, number: usize, outcome: Value) -> Value {
    json!({
        "record": "cell", "experiment": "own", "cell": format!("{axis}={name},n={number}"),
        "axes": { axis: name, "n": number }, "pipeline": name, "scene": name,
        "stand_ins": [format!("{name}: absent")], "params": { name: name }, "outcome": outcome,
    })
}

/// An experiment whose every text is hostile.
fn definition(id: &str, all: &str, axis: &str) -> String {
    let plot = |kind: &str, rest: Value| {
        let mut plot = json!({ "title": all, "kind": kind, "y_title": all });
        plot.as_object_mut().unwrap().extend(rest.as_object().unwrap().clone());
        plot
    };
    let measure = format!("quantity:{}", HOSTILE[0]);
    let definition = json!({
        "id": id, "title": all, "source": all, "about": all, "pipeline": "underwater", "scene": "tank",
        "sweep": [{ "axis": [
            { "name": axis, "title": all, "values": HOSTILE },
            { "name": "n", "values": [0, 1, 2] },
        ] }],
        "published": [{ "comparison": "about", "fps": 20, "hardware": all, "note": all }],
        "claim": [{ "id": all, "text": all, "test": { "at_least": { "y": "frame", "value": 1.0 } } }],
        "plot": [
            plot("map", json!({ "columns": axis, "rows": "n", "y": ["frame"] })),
            plot("scaling", json!({ "over": "n", "x": "axis:n", "x_title": all, "y": ["frame", measure] })),
            plot("lines", json!({ "over": "n", "x": "axis:n", "y": ["frame"] })),
            plot("bars", json!({ "over": axis, "y": ["frame"] })),
            plot("stacked", json!({})),
            plot("ratios", json!({
                "over": axis, "y": ["frame"], "numerator": HOSTILE[0], "denominator": HOSTILE[1],
            })),
        ],
    });
    toml::to_string(&definition).unwrap()
}

/// Records in which every name is hostile, ids of experiments too.
pub fn records() -> String {
    let all = HOSTILE.join(" ");
    let axis = "axis <b>|\u{1b}";
    let mut lines = vec![
        json!({
            "record": "run", "schema": fathom::record::SCHEMA, "fathom_version": all, "started_at": all, "profile": "quick", "command": [all],
            "adapter": {
                "name": all, "backend": all, "device_type": all, "driver": all, "driver_info": all, "vendor_id": 0,
                "device_id": 0, "software": true, "timestamp_period_ns": 1.0, "host_threads": 2,
            },
            "shader_checks": "checked",
            "conditions": { "cores": [1], "rasterizer_threads": all, "randomized": false },
            "clocks": { "compute": "process_cpu" },
            "audit": [{
                "pass": "compute", "context": "mixed", "clock": "timestamp", "clock_ns": 1.0, "host_ns": 1.0, "ratio": 1.0, "doubling": 2.0,
                "sound": true, "reason": all,
            }],
            "submit_cost_ns": { "compute": 1.0 },
            "notes": HOSTILE.map(|name| json!({ "kind": "adapter", "text": name })),
        }),
        json!({ "record": "experiment", "id": "own", "toml": definition("own", &all, axis) }),
        json!({ "record": "experiment", "id": "../../x", "toml": definition("../../x", &all, axis) }),
        json!({ "record": "experiment", "id": "broken", "toml": all }),
    ];
    for (number, name) in HOSTILE.iter().enumerate() {
        lines.push(cell(name, axis, number % 3, measured(name, number)));
        lines.push(cell(name, axis, 7, json!({ "status": "skipped", "reason": name })));
        lines.push(cell(name, axis, 8, json!({ "status": "failed", "reason": name })));
    }
    for id in HOSTILE {
        let mut bad = cell("x", axis, 0, measured("x", 0));
        bad["experiment"] = json!(id);
        lines.push(bad);
    }
    lines.iter().map(|line| format!("{line}\n")).collect()
}
