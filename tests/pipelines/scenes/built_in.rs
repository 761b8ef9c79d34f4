//! The built-in scenes, and scene files that cannot be used.

use fathom::scene::{Scene, SceneFile};
use glam::{DVec3, Vec3};

/// The scene of a built-in file with a change.
fn changed(name: &str, change: impl FnOnce(&mut SceneFile)) -> Scene {
    let mut file = SceneFile::load(name).unwrap_or_else(|e| panic!("{e}"));
    change(&mut file);
    Scene::build(&file).unwrap_or_else(|e| panic!("{e}"))
}

const RAYS: [(f64, f64); 3] = [(0.0, 0.0), (-0.9, 0.9), (0.9, -0.9)];
const WET: &str = "atrium bunny cornell diving_pool dolphin dragon_large dragon_medium dragon_small plane planar_pool pool port specular storage tank";

/// Where there is water, light comes from above it.
#[test]
fn every_scene_loads_and_is_lit_and_seen() {
    for name in Scene::names() {
        // With a coarse volume, where it has one: quick to make.
        let scene = changed(&name, |file| file.volume.iter_mut().for_each(|v| v.reduce = 8));
        assert!(scene.name == name && !scene.description.is_empty(), "{name}");
        assert!(scene.volume.is_some() || scene.triangle_count() >= 2, "{name}");
        let seen = scene.camera.view_projection(1.0).project_point3(scene.solid_bounds().center());
        let is_seen = seen.abs().truncate().max_element() < 1.0 && (0.0..1.0).contains(&seen.z);
        assert!(is_seen || scene.bounds.contains(scene.camera.middle()), "{name}: {seen}");
        let frame = scene.light.frame(&scene.camera, 1.0, &scene.bounds, &scene.water, false);
        assert!(frame.emitted_w > 0.0, "{name}");
        let rays: &[_] = if WET.split(' ').any(|wet| wet == name) { &RAYS } else { &[] };
        for &(x, y) in rays {
            let (origin, direction) = frame.ray(x, y);
            assert!(origin.y > scene.water.amplitude_m && direction.y < 0.0, "{name}: {origin}");
        }
    }
}

/// Normals agree with winding: on the same side of each triangle, save where a surface is sharply
/// bent.
#[test]
fn normals_and_winding_agree_in_procedural_scenes() {
    let names = "plane tank port storage bricks crates glass level robot_room room thicket \
                 dolphin diving_pool teapot tree_shadow";
    for name in names.split(' ') {
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

#[test]
fn the_floor_follows_its_depth() {
    for name in ["plane", "tank", "port", "storage"] {
        let shallow = changed(name, |_| ());
        let deep = changed(name, |file| file.floor_depth_m += 1.5);
        assert_eq!(deep.floor_depth_m, shallow.floor_depth_m + 1.5);
        assert!((deep.bounds.min.y - shallow.bounds.min.y + 1.5).abs() < 1e-4, "{name}");
        // The room above the water is a share of the scene.
        assert!((deep.bounds.max.y - shallow.bounds.max.y).abs() < 0.1, "{name}");
    }
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
    assert!(broken(|f| f.objects[1].params = [("x".to_owned(), 1.into())].into()).contains("`x`"));
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
    std::fs::write(folder.path().join("floor.obj"), "v 0 0 0\nv 0 0 1\nv 1 0 0\nf 1 2 3\n")
        .unwrap();
    assert_eq!(Scene::load(&name).unwrap().triangle_count(), 1);
}
