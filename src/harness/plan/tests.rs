use serde_json::json;

use super::*;
use crate::catalog::Catalog;
use crate::views;
use fathom_reference::rays::Tracer;
use fathom_scene::Camera;

const SWEEP: &str = r#"
id = "sweep"
title = "t"
source = "s"
pipeline = "underwater"
scene = "plane"

[params]
caustics.grid = 20
godrays.grid = 12
view.width = 64
view.height = 48

[profile.quick.params]
godrays.grid = 11

[[sweep]]
[[sweep.axis]]
name = "caustics.buffer"
values = [[32, 32], [64, 64]]
"#;

fn experiments() -> Vec<Experiment> {
    let plain =
        SWEEP.replace("sweep\"", "plain\"").replace("[[sweep]]", "").replace("[[sweep.axis]]", "");
    let plain = plain.split("name = ").next().unwrap().to_owned();
    vec![Experiment::parse("sweep", SWEEP).unwrap(), Experiment::parse("plain", &plain).unwrap()]
}

fn request(sets: &[(&str, Value)]) -> Request {
    let sets = sets.iter().map(|(path, value)| ((*path).to_owned(), value.clone())).collect();
    Request { sets, ..Request::default() }
}

fn planned(request: &Request) -> Result<Vec<PlannedExperiment>> {
    let profile = fathom_record::Profile::Quick;
    let capacity = wgpu::Limits::default().into();
    plan(experiments(), request, profile, &capacity, &Catalog::builtin(), &|| Ok(()))
}

#[test]
fn planning_ends_with_the_time_budget() {
    let (capacity, catalog) = (wgpu::Limits::default().into(), Catalog::builtin());
    let asked = std::cell::Cell::new(0);
    let in_time = || {
        asked.set(asked.get() + 1);
        anyhow::ensure!(asked.get() < 2, "over");
        Ok(())
    };
    let profile = fathom_record::Profile::Quick;
    let ended = plan(experiments(), &request(&[]), profile, &capacity, &catalog, &in_time);
    assert_eq!((ended.err().unwrap().to_string(), asked.get()), ("over".to_owned(), 2));
}

#[test]
fn the_last_of_default_experiment_profile_set_and_axis_counts() {
    let request = request(&[("view.height", json!(40)), ("water.amplitude_m", json!(0))]);
    let planned = planned(&request).unwrap();
    let params = &planned[0].cells[1].subject.params;
    assert_eq!(params["shadow"]["size"], 1024, "the pipeline's default");
    assert_eq!(params["view"]["width"], 64, "the experiment's");
    assert_eq!(params["godrays"]["grid"], 11, "the profile's");
    assert_eq!(params["view"]["height"], 40, "--set's");
    assert_eq!(params["water"]["amplitude_m"], 0.0, "a whole number passes for a real one");
    assert_eq!(params["caustics"]["buffer"], json!([64, 64]), "the axis's");
    let file = fathom_scene::SceneFile::load("plane").unwrap();
    assert_eq!(params["floor_depth_m"], file.floor_depth_m, "the scene's");
}

#[test]
fn geometry_is_made_once_for_equal_scenes_and_follows_the_parameters() {
    let two = planned(&request(&[])).unwrap();
    let scene = |cell: usize| &two[0].cells[cell].subject.scene;
    assert!(std::sync::Arc::ptr_eq(scene(0), scene(1)));
    let deeper = planned(&request(&[("floor_depth_m", json!(7.5))])).unwrap();
    assert_eq!(deeper[0].cells[0].subject.scene.floor_depth_m, 7.5);
}

#[test]
fn cells_beyond_a_limit_are_skipped_with_the_numbers_and_the_others_stay() {
    let request = Request {
        axes: vec![("caustics.buffer".into(), vec!["[32,32]".into(), "[20000,32]".into()])],
        ..Request::default()
    };
    // The other experiment lacks that axis, which is its own matter.
    let planned = planned(&request).unwrap();
    let [fits, beyond] = &planned[0].cells[..] else {
        panic!("two cells");
    };
    assert_eq!(fits.skip, None);
    let reason = beyond.skip.as_deref().unwrap();
    assert!(reason.contains("20000") && reason.contains("8192"), "{reason}");
    let record = beyond.record(Outcome::Skipped { reason: reason.to_owned() });
    assert_eq!(record.cell, "caustics.buffer=20000x32");
}

/// Degrees between the places at which a turned camera's path is tried.
const PATH_STEP_DEG: f64 = 2.0;

/// A camera that is turned about its target meets no surface on its way: one that starts inside a room stays inside.
#[test]
fn every_view_is_seen_from_within_its_scene() {
    let catalog = Catalog::builtin();
    let ids = Experiment::ids(&catalog.experiments);
    let all = ids.iter().map(|id| Experiment::load_from(&catalog.experiments, id).unwrap());
    let with_views: Vec<Experiment> = all.filter(|e| e.views.is_some()).collect();
    assert!(!with_views.is_empty());
    let limits = wgpu::Limits::default().into();
    for profile in [fathom_record::Profile::Quick, fathom_record::Profile::Paper] {
        let request = Request::default();
        let planned =
            plan(with_views.clone(), &request, profile, &limits, &catalog, &|| Ok(())).unwrap();
        for (experiment, cell) in
            planned.iter().flat_map(|e| e.cells.iter().map(|c| (&e.experiment, c)))
        {
            let turns_deg = experiment.views.as_ref().unwrap().turns_deg.for_profile(profile);
            let own = cell.subject.camera();
            let tracer = Tracer::new(&cell.subject.scene.objects);
            for angle_deg in turns_deg {
                let met = met_on_path(&tracer, &own, *angle_deg);
                assert_eq!(met, None, "{} turned by {angle_deg}", cell.plan.cell);
            }
            let last = cell.views.as_ref().unwrap().last().unwrap();
            let expected = views::rotated(&own, *turns_deg.last().unwrap());
            assert_eq!(last[0].camera(), expected);
        }
    }
}

/// Angle at which a camera that is turned about its target meets a surface.
fn met_on_path(tracer: &Tracer, camera: &Camera, angle_deg: f64) -> Option<f64> {
    let steps = (angle_deg.abs() / PATH_STEP_DEG).ceil();
    let at = |step: f64| views::rotated(camera, angle_deg * step / steps).position();
    let mut path = (0..steps as u32).map(f64::from);
    let met = path.find(|&step| {
        let step_vector = at(step + 1.0) - at(step);
        tracer.cast(at(step), step_vector.normalize(), 0.0, step_vector.length()).is_some()
    });
    met.map(|step| angle_deg * step / steps)
}

#[test]
fn a_camera_that_leaves_its_room_is_found() {
    let scene = fathom_scene::Scene::load("robot_room").unwrap();
    let tracer = Tracer::new(&scene.objects);
    // As the scene has it, the camera stands in a corner.
    assert!(met_on_path(&tracer, &scene.camera, 20.0).is_some());
    assert_eq!(met_on_path(&tracer, &scene.camera, 1.0), None);
}
