use std::collections::BTreeMap;
use std::sync::Mutex;

use serde_json::{Value, json};

use super::*;
use crate::fixtures::{OWN, own};
use fathom_base::parameter;
use fathom_pipelines as pipelines;
use fathom_record::Profile;
use fathom_scene::SceneFile;

const SWEPT: &str = r#"
[params]
a.b = 1
"c.d" = 2.5

[profile.quick.params]
a.b = 7

[[sweep]]
params = { e = true }
[[sweep.axis]]
name = "caustics.grid"
quick = [10, 20]
paper = [100, 200, 400]
[[sweep.axis]]
name = "size"
values = [
  { label = "small", set = { view.width = 8, view.height = 6 } },
  { label = "port", set = { view.width = 80, scene = "port" } },
]
"#;

/// A plot that lacks the axis of its bars.
const BARS: &str = "\n[[plot]]\ntitle = \"t\"\nkind = \"bars\"\ny = [\"frame\"]";

fn message(result: Result<impl std::fmt::Debug, ExperimentError>) -> String {
    result.unwrap_err().to_string()
}

#[test]
fn published_figures_meet_cells_at_the_published_size() {
    for id in Experiment::builtin_ids() {
        let experiment = Experiment::load(&id).unwrap();
        let cells = experiment.cells(Profile::Paper, &[], &[]).unwrap();
        for published in &experiment.published {
            let filter = flatten(&published.filter);
            let met = cells.iter().any(|cell| {
                filter.iter().all(|(name, wanted)| {
                    let set = cell.overrides.iter().find(|(path, _)| path == name);
                    let value = cell.axes.get(name).or(set.map(|(_, value)| value));
                    value.is_some_and(|value| same(value, wanted))
                })
            });
            assert!(met, "{id}: no cell for {filter:?}");
        }
    }
}

/// All parameters of a cell. Most cells have the same scene.
fn tree(cell: &CellPlan) -> Value {
    static DEFAULTS: Mutex<BTreeMap<[String; 2], Value>> = Mutex::new(BTreeMap::new());
    let kind = pipelines::KINDS.iter().find(|kind| kind.name == cell.pipeline).unwrap();
    let defaults = || (kind.defaults)(&SceneFile::load(&cell.scene).unwrap());
    let key = [cell.pipeline.clone(), cell.scene.clone()];
    let mut tree = DEFAULTS.lock().unwrap().entry(key).or_insert_with(defaults).clone();
    for (path, value) in &cell.overrides {
        parameter::set(&mut tree, path, value.clone()).unwrap();
    }
    tree
}

/// Each names what else could make it true; a paper's also its words, where its balance counts, and what would break it. A paper's method
/// names parameters that cells have.
#[test]
fn every_builtin_claim_tells_its_grounds() {
    let ids = Experiment::builtin_ids();
    let experiments = ids.iter().map(|id| Experiment::load(id).unwrap());
    let mut lacking = Vec::new();
    for experiment in experiments {
        for claim in &experiment.claim {
            let of_paper = [
                claim.balance.is_some(),
                claim.printed.is_some(),
                !claim.broken_by.what.is_empty(),
            ];
            let is_grounded = claim.source.is_none() || of_paper == [true; 3];
            if claim.otherwise.is_empty() || !is_grounded {
                lacking.push(format!("{}: {}", experiment.id, claim.id));
            }
        }
        let trees: Vec<Value> =
            experiment.cells(Profile::Quick, &[], &[]).unwrap().iter().map(tree).collect();
        let method = flatten(&experiment.method);
        let known = |path: &str| trees.iter().any(|tree| parameter::get(tree, path).is_some());
        assert!(method.iter().all(|(path, _)| known(path)), "{}: {method:?}", experiment.id);
        let follows = |tree: &Value| {
            let found = |path: &str| parameter::get(tree, path);
            let has_some =
                method.is_empty() || method.iter().any(|(path, _)| found(path).is_some());
            let is_same = |(path, wanted): &(String, Value)| {
                found(path).is_none_or(|value| same(value, wanted))
            };
            // A cell of another pipeline, which has none of these parameters, does not count.
            has_some && method.iter().all(is_same)
        };
        assert!(trees.iter().any(follows), "{}: no cell runs its method", experiment.id);
    }
    assert!(lacking.is_empty(), "claims without grounds: {lacking:#?}");
}

#[test]
fn sweeps_multiply_axes_and_tables_move_parameters_together() {
    let cells = own(SWEPT).cells(Profile::Quick, &[], &[]).unwrap();
    let keys: Vec<&str> = cells.iter().map(|cell| cell.cell.as_str()).collect();
    assert_eq!(
        keys,
        [
            "caustics.grid=10,size=small",
            "caustics.grid=10,size=port",
            "caustics.grid=20,size=small",
            "caustics.grid=20,size=port",
        ]
    );
    assert_eq!(cells[0].scene, "tank");
    assert_eq!(cells[1].scene, "port");
    let set = |path: &str| {
        let mut all = cells[0].overrides.iter();
        all.find(|(known, _)| known == path).map(|(_, value)| value.clone())
    };
    assert_eq!(set("a.b"), Some(json!(7)), "profile over base");
    assert_eq!(set("c.d"), Some(json!(2.5)));
    assert_eq!(set("e"), Some(json!(true)));
    assert_eq!(set("view.height"), Some(json!(6)));
    assert_eq!(cells[0].axes["size"], json!("small"));
}

#[test]
fn sets_reach_every_cell_and_the_reference() {
    let sets = [parse_set("water.time_s=1.5").unwrap()];
    let experiment = Experiment::load("uw-filter").unwrap();
    for cell in experiment.cells(Profile::Quick, &[], &sets).unwrap() {
        let reference = cell.reference.unwrap();
        assert!(cell.overrides.contains(&sets[0]));
        assert!(reference.overrides.contains(&sets[0]));
        let grid = ("caustics.grid".to_owned(), json!(400));
        assert!(reference.overrides.contains(&grid));
    }
}

#[test]
fn repetitions_keep_the_cell_but_for_the_place_of_its_grids() {
    let experiment = Experiment::load("uw-filter").unwrap();
    let own = experiment.repetitions.clone().unwrap();
    let cells = experiment.cells(Profile::Quick, &[], &[]).unwrap();
    let without = |overrides: &[(String, Value)], names: &[String]| {
        let kept = overrides.iter().filter(|(path, _)| !names.contains(path));
        kept.cloned().collect::<Vec<_>>()
    };
    let places = |cell: &CellPlan| {
        let runs = cell.repetitions.clone().unwrap();
        assert_eq!(runs.repeated.len(), *own.count.for_profile(Profile::Quick) as usize);
        let place = |overrides: &Vec<(String, Value)>| {
            assert_eq!(without(overrides, &own.vary), without(&cell.overrides, &own.vary));
            let of = |name: &String| overrides.iter().find(|(path, _)| path == name).unwrap();
            let [first, rest @ ..] = own.vary.as_slice() else { panic!("nothing varies") };
            assert!(rest.iter().all(|name| of(name).1 == of(first).1));
            of(first).1.clone()
        };
        runs.repeated.iter().map(place).collect::<Vec<_>>()
    };
    let first = places(&cells[0]);
    assert!(first.iter().enumerate().all(|(i, place)| !first[..i].contains(place)));
    assert!(cells.iter().all(|cell| places(cell) == first));
}

#[test]
fn tables_by_name_share_figures_and_set_parameters() {
    let text = r#"
        [sweep.z]
        axis.viewport = { sets = ["view.width", "view.height"], values = [[8, 6]] }
        axis.grid = { sets = ["caustics.grid"], values = [5, 7] }
        [sweep.a]
        [[published]]
        comparison = "about"
        hardware = "h"
        figures = [{ where = { grid = 5 }, fps = 3 }, { where = { grid = 7 }, fps = 4 }]
        [claim.z]
        text = "x"
        test.within = { y = "fps", low = 1 }
        [claim.a]
        text = "x"
        test.within = { y = "fps", low = 2 }
    "#;
    let experiment = own(text);
    let cells = experiment.cells(Profile::Quick, &[], &[]).unwrap();
    let keys: Vec<&str> = cells.iter().map(|cell| cell.cell.as_str()).collect();
    assert_eq!(keys, ["z,viewport=8x6,grid=5", "z,viewport=8x6,grid=7", "a"]);
    for (path, value) in [("view.width", 8), ("view.height", 6), ("caustics.grid", 7)] {
        assert!(cells[1].overrides.contains(&(path.to_owned(), json!(value))), "{path}");
    }
    let shared: Vec<_> = experiment.published.iter().map(|of| (&of.hardware, of.fps)).collect();
    assert!(shared.len() == 2 && shared[0].0 == shared[1].0 && shared[0].1 != shared[1].1);
    assert!(experiment.claim.iter().map(|claim| &*claim.id).eq(["z", "a"]));
}

#[test]
fn wrong_names_and_values_are_told_with_the_nearest_right_one() {
    let experiment = own(SWEPT);
    let cells = |axis: &str| experiment.cells(Profile::Quick, &[parse_axis(axis).unwrap()], &[]);
    let unknown = message(Experiment::load("uw-photon"));
    assert_eq!(unknown, "unknown experiment `uw-photon`; did you mean `uw-photons`?");
    assert_eq!(
        message(cells("caustics.gird=5")),
        "experiment `own` has no axis `caustics.gird`; did you mean `caustics.grid`?"
    );
    assert_eq!(
        message(cells("caustics.grid=many")),
        "axis `caustics.grid` of `own`: `many` is not a number, as `10` is"
    );
    let label = message(cells("size=smal"));
    assert!(label.contains("did you mean `small`?"), "{label}");
    let set = [("view.width".to_owned(), json!(5))];
    let on_axis = message(experiment.cells(Profile::Quick, &[], &set));
    assert!(on_axis.contains("swept by the axis `size`"), "{on_axis}");
}

#[test]
fn malformed_assignments_are_refused() {
    for text in
        ["", "a", "a=", "=1", "a=1,,2", "a=1..9", "a=9..1*2", "a=1..9*1", "a=0..9*2", "a=1..9+0"]
    {
        assert!(parse_axis(text).is_err(), "{text}");
    }
    for (text, expected) in [
        ("a=64..512*2", &["64", "128", "256", "512"][..]),
        ("a=8,0.1..0.35+0.1", &["8", "0.1", "0.2", "0.3"]),
        ("a=../b..c.obj,..", &["../b..c.obj", ".."]),
        ("a=5..5+1", &["5"]),
    ] {
        assert_eq!(parse_axis(text).unwrap().1, expected, "{text}");
    }
    for text in ["", "a", "a=", "=1"] {
        assert!(parse_set(text).is_err(), "{text}");
    }
    assert_eq!(parse_set("water.model=circular").unwrap().1, json!("circular"));
    assert_eq!(parse_set("a=[1,2]").unwrap().1, json!([1, 2]));
}

#[test]
fn broken_files_are_told_in_one_line() {
    let filter = Experiment::builtin_text("uw-filter").unwrap();
    let swept = format!("{OWN}{SWEPT}");
    let claim = |test: &str| format!("{swept}\n[[claim]]\nid = \"x\"\ntext = \"x\"\ntest.{test}");
    let cases = [
        ("title = \"x\"".to_owned(), "missing field"),
        (filter.replace("quick = 4", "quick = 3"), "4 to 100"),
        (filter.replace("godrays_noise", "caustics_noise"), "twice"),
        (format!("{swept}{BARS}"), "needs one y, and either over or colors"),
        (swept.replace("a.b = 1", "a.b = 1\na.b = 2"), "line"),
        (swept.replace("title =", "id = \"own\"\ntitle ="), "duplicate key `id`"),
        (swept.replace("title =", "colour = 1\ntitle ="), "unknown field `colour`"),
        (swept.replace("[10, 20]", "[]"), "empty list"),
        (swept.replace("paper = [100, 200, 400]\n", ""), "`quick` and `paper`"),
        (swept.replace("label = \"small\", ", ""), "must be { label"),
        (swept.replace("\"own\"", "\"Own!\""), "lower-case"),
        (claim(r#"ratio = { y = "stage:a", over = "none", high = 1.1 }"#), "which is no axis"),
        (claim(r#"within = { y = "speed", low = 1 }"#), "unknown measure `speed`"),
        (
            claim(r#"ratio = { y = "stage:a", over = "size", low = 0.5 }"#),
            "without a numerator needs `high`",
        ),
        (claim(r#"ratio = { y = "stage:a", numerator = 1, high = 2 }"#), "that are tables"),
        (format!("{swept}[method]\npublication = 1"), "method of publication 1 is not known"),
    ];
    own(&format!("{SWEPT}{BARS}\ncolors = \"size\""));
    for (text, expected) in cases {
        let error = message(Experiment::parse("own", &text));
        assert!(error.contains(expected), "{expected}: {error}");
        assert!(!error.contains('\n'), "{error}");
    }
}

#[test]
fn an_experiment_without_sweeps_is_one_cell() {
    let text = SWEPT.split("[[sweep]]").next().unwrap();
    let cells = own(text).cells(Profile::Paper, &[], &[]).unwrap();
    assert_eq!(cells.len(), 1);
    assert_eq!(cells[0].cell, "base");
    assert_eq!(cells[0].overrides[0], ("a.b".to_owned(), Value::from(1)));
}

#[test]
fn every_builtin_names_parameters_stages_and_scenes_that_exist() {
    let stages: Vec<&str> = fathom_stages::REGISTRY.iter().map(|stage| stage.name).collect();
    for id in Experiment::builtin_ids() {
        let experiment = Experiment::load(&id).unwrap();
        assert_eq!(experiment.id, id, "id and file name");
        let measured = experiment.measures();
        for stage in measured.iter().flat_map(|measure| measure.stages()) {
            assert!(stages.iter().any(|known| stage.covers(known)), "{id}: {stage}");
        }
        for profile in Profile::ALL {
            for cell in experiment.cells(profile, &[], &[]).unwrap() {
                let mut tree = tree(&cell);
                let reference = cell.reference.map(|reference| reference.overrides);
                let repetitions = cell.repetitions.into_iter().flat_map(|runs| runs.repeated);
                let others = reference.into_iter().chain(repetitions).flatten();
                for (path, value) in others {
                    parameter::set(&mut tree, &path, value).unwrap();
                }
                for path in measured.iter().flat_map(|measure| measure.params()) {
                    assert!(parameter::get(&tree, path).is_some(), "{id}: {path}");
                }
            }
        }
    }
}

/// The example of docs/claims.md.
#[test]
fn the_documented_experiment_is_one() {
    let page = include_str!("../../docs/claims.md");
    let (_, rest) = page.split_once("```toml\n").unwrap();
    let (text, _) = rest.split_once("```").unwrap();
    let experiment = Experiment::parse("own-photons", text).unwrap();
    for profile in Profile::ALL {
        assert_eq!(experiment.cells(profile, &[], &[]).unwrap().len(), 4);
    }
    assert!(!experiment.claim.is_empty() && !experiment.plot.is_empty());
}

#[test]
fn axes_that_set_names_are_categories_and_those_that_set_numbers_are_not() {
    for (id, axis, expected) in [
        ("vao-voxelize", "scene", true),
        ("vao-voxelize", "dragon", true),
        ("vao-voxelize", "voxel.resolution", false),
        ("vao-resolution", "method", true),
        ("vao-skipping", "ao.skipping", true),
        ("spt-photons", "photons", false),
        ("uw-buffers", "caustics.buffer", false),
        ("uw-points", "points", true),
    ] {
        let experiment = Experiment::load(id).unwrap();
        assert_eq!(experiment.is_category(axis), expected, "{id} {axis}");
    }
}

#[test]
fn a_method_by_name_has_its_values_and_those_beside_it() {
    let named = own("method = { publication = \"VAO\", ao.threshold = 0.65 }");
    let text = "[method]\nvoxel = { method = \"slicemap\", rasterizer = \"hardware\" }\n\
        ao = { step = \"paper\", hit = \"sample\", offset_voxels = 0.0, estimator = \"uniform\", \
        sampling = \"random\", threshold = 0.65 }";
    assert_eq!(named.method, own(text).method);
    assert!(!named.text.contains("publication"), "its text needs no other file");
}
