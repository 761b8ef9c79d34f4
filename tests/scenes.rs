//! The built-in scenes, and scene files that cannot be used.

use fathom::scene::{Scene, SceneFile};
use glam::{DVec3, Vec3};

/// Every scene with the size it should have, assets or stand-ins alike.
#[test]
fn every_scene_loads_at_its_size() {
    for name in Scene::names() {
        let scene = Scene::load(name).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(scene.name, name);
        assert!(!scene.description.is_empty());
        let expected = match name {
            "plane" => 2..=2,
            "dragon_large" => 202_000..=260_000,
            "bunny" | "dragon_medium" => 60_000..=120_000,
            "atrium" => 60_000..=80_000,
            _ => 5_000..=60_000,
        };
        let count = scene.triangle_count();
        assert!(expected.contains(&count), "{name}: {count}");
    }
}

#[test]
fn the_scenes_are_those_of_the_paper_and_of_the_meshes() {
    let expected = [
        "atrium",
        "bunny",
        "dragon_large",
        "dragon_medium",
        "dragon_small",
        "plane",
        "port",
        "smoke",
        "storage",
        "tank",
    ];
    assert_eq!(Scene::names(), expected);
}

#[test]
fn loading_twice_gives_the_same_scene() {
    for name in ["tank", "port", "storage"] {
        assert_eq!(Scene::load(name).unwrap(), Scene::load(name).unwrap());
    }
}

/// Normals agree with winding: on the same side of each triangle, save where a surface is sharply
/// bent.
#[test]
fn normals_and_winding_agree_in_procedural_scenes() {
    for name in ["plane", "tank", "port", "storage"] {
        let scene = Scene::load(name).unwrap();
        for object in &scene.objects {
            let mesh = &object.mesh;
            let against = (0..mesh.triangle_count())
                .filter(|&t| {
                    let [a, b, c] = mesh.triangle(t);
                    let face = (b - a).cross(c - a);
                    let sum: DVec3 = mesh.indices[3 * t..3 * t + 3]
                        .iter()
                        .map(|i| Vec3::from(mesh.normals[*i as usize]).as_dvec3())
                        .sum();
                    face.dot(sum) < 0.0
                })
                .count();
            let share = against as f64 / mesh.triangle_count() as f64;
            assert!(share < 0.01, "{name}/{}: {share}", object.name);
        }
    }
}

/// The camera stands in the scene's bounds, sees geometry in front of it, and the light's position
/// and rays start above the water.
#[test]
fn cameras_and_lights_are_placed_sensibly() {
    for name in ["plane", "tank", "port", "storage", "atrium", "bunny"] {
        let scene = Scene::load(name).unwrap();
        assert!(scene.bounds.contains(scene.camera.middle()), "{name}");
        let frame = scene.light.frame(&scene.camera, 1.0, &scene.bounds);
        assert!(frame.emitted_w > 0.0, "{name}");
        for (x, y) in [(0.0, 0.0), (-0.9, 0.9), (0.9, -0.9)] {
            let (origin, direction) = frame.ray(x, y);
            assert!(origin.y > scene.water.amplitude_m, "{name}: {origin}");
            assert!(direction.y < 0.0, "{name}");
        }
    }
}

#[test]
fn the_floor_follows_its_depth() {
    for name in ["plane", "tank", "port", "storage"] {
        let mut file = SceneFile::load(name).unwrap();
        let shallow = Scene::build(&file).unwrap();
        file.floor_depth_m += 1.5;
        let deep = Scene::build(&file).unwrap();
        assert_eq!(deep.floor_depth_m, shallow.floor_depth_m + 1.5);
        assert!(
            (deep.bounds.min.y - shallow.bounds.min.y + 1.5).abs() < 1e-4,
            "{name}"
        );
        assert!(
            (deep.bounds.max.y - shallow.bounds.max.y).abs() < 1e-4,
            "{name}"
        );
    }
}

#[test]
fn unknown_scenes_get_the_nearest_name() {
    let error = Scene::load("tnk").unwrap_err().to_string();
    assert!(error.contains("did you mean `tank`?"), "{error}");
    let error = Scene::load("no/such/file.toml").unwrap_err().to_string();
    assert!(error.contains("no/such/file.toml"), "{error}");
}

#[test]
fn unusable_values_are_named() {
    let broken = |change: fn(&mut SceneFile)| {
        let mut file = SceneFile::load("tank").unwrap();
        change(&mut file);
        let error = Scene::build(&file).unwrap_err().to_string();
        assert_eq!(error.lines().count(), 1, "{error}");
        error
    };
    assert!(broken(|f| f.floor_depth_m = -1.0).contains("floor_depth_m"));
    assert!(broken(|f| f.floor_depth_m = f64::NAN).contains("floor_depth_m"));
    assert!(broken(|f| f.camera.z_near_m = 99.0).contains("camera.z_near_m"));
    assert!(broken(|f| f.objects.clear()).contains("neither an [[object]] nor a [volume]"));
    assert!(broken(|f| f.objects[1].generator = Some("statu".into())).contains("`statue`"));
    assert!(broken(|f| f.objects[1].generator = None).contains("needs one of"));
    assert!(broken(|f| f.objects[1].transform.scale = 0.0).contains("transform.scale"));
    assert!(broken(|f| f.objects[1].material.albedo[0] = f32::NAN).contains("albedo"));
    assert!(broken(|f| f.objects[1].params = [("x".to_owned(), 1.0)].into()).contains("`x`"));
}

#[test]
fn scene_files_survive_a_round_trip_and_reach_meshes_beside_them() {
    let folder = tempfile::tempdir().unwrap();
    let mut file = SceneFile::load("plane").unwrap();
    file.objects[0].generator = None;
    file.objects[0].params.clear();
    file.objects[0].file = Some("floor.obj".into());
    let path = folder.path().join("mine.toml");
    std::fs::write(&path, toml::to_string(&file).unwrap()).unwrap();
    let name = path.to_string_lossy();
    let error = Scene::load(&name).unwrap_err().to_string();
    assert!(error.contains("floor.obj"), "{error}");
    std::fs::write(
        folder.path().join("floor.obj"),
        "v 0 0 0\nv 0 0 1\nv 1 0 0\nf 1 2 3\n",
    )
    .unwrap();
    assert_eq!(Scene::load(&name).unwrap().triangle_count(), 1);
}
