//! The built-in scenes, and scene files that cannot be used.

use fathom::scene::assets::ASSETS;
use fathom::scene::{Bounds, Grid, LightKind, Scene, SceneFile};
use glam::{DVec3, Vec3};

/// The scene of a built-in file with a change.
fn changed(name: &str, change: impl FnOnce(&mut SceneFile)) -> Scene {
    let mut file = SceneFile::load(name).unwrap_or_else(|e| panic!("{e}"));
    change(&mut file);
    Scene::build(&file).unwrap_or_else(|e| panic!("{e}"))
}

/// The scene with a coarse volume, where it has one: quick to make.
fn load(name: &str) -> Scene {
    changed(name, |file| file.volume.iter_mut().for_each(|volume| volume.reduce = 8))
}

/// The scene as it is where no asset can be had.
fn with_stand_ins(name: &str) -> Scene {
    changed(name, |file| {
        for object in &mut file.objects {
            if let Some(name) = object.asset.take() {
                let asset = ASSETS.iter().find(|a| a.name == name).expect("a known asset");
                object.generator = Some(asset.stand_in.0.to_owned());
                object.params = asset.stand_in.1.iter().map(|&(n, v)| (n.to_owned(), v)).collect();
            }
        }
    })
}

/// Triangles of meshes that the papers count, each with the fewest and the most it should have, assets or stand-ins alike.
const COUNTED: [(&str, usize, usize); 9] = [
    ("buddha", 90_000, 110_000),
    ("bunny_dry", 60_000, 75_000),
    ("dragon_large", 202_000, 260_000),
    ("glass_dragon_large", 200_000, 205_000),
    ("glass_dragon_medium", 45_000, 50_000),
    ("glass_dragon_small", 11_000, 11_250),
    ("glass_teapot", 2_249, 2_269),
    ("glass_teapot_small", 540, 600),
    ("sponza", 60_000, 80_000),
];

/// Scenes above the water, lit by a point light: an object on level ground. SPT Fig. 11, 12 and Table 1.
const ABOVE: [(&str, usize, usize); 3] =
    [("bunny_shadow", 60_000, 75_000), ("teapot", 2_249, 2_269), ("tree_shadow", 20_000, 60_000)];

/// Scenes of a volume, with the cells of the paper or of the scan.
const VOLUMES: [(&str, [u32; 3]); 3] =
    [("bonsai", [160, 160, 160]), ("engine", [256, 128, 256]), ("smoke", [200, 128, 200])];

const RAYS: [(f64, f64); 3] = [(0.0, 0.0), (-0.9, 0.9), (0.9, -0.9)];
const WET: &str = "atrium bunny cornell diving_pool dolphin dragon_large dragon_medium dragon_small plane planar_pool pool port specular storage tank";

/// Where there is water, light comes from above it.
#[test]
fn every_scene_loads_and_is_lit_and_seen() {
    for name in Scene::names() {
        let scene = load(&name);
        assert!(scene.name == name && !scene.description.is_empty(), "{name}");
        assert!(scene.volume.is_some() || scene.triangle_count() >= 2, "{name}");
        let seen = scene.camera.view_projection(1.0).project_point3(scene.solid_bounds().center());
        let is_seen = seen.abs().truncate().max_element() < 1.0 && (0.0..1.0).contains(&seen.z);
        assert!(is_seen || scene.bounds.contains(scene.camera.middle()), "{name}: {seen}");
        let frame = scene.light.frame(&scene.camera, 1.0, &scene.bounds, &scene.water);
        assert!(frame.emitted_w > 0.0, "{name}");
        let rays: &[_] = if WET.split(' ').any(|wet| wet == name) { &RAYS } else { &[] };
        for &(x, y) in rays {
            let (origin, direction) = frame.ray(x, y);
            assert!(origin.y > scene.water.amplitude_m && direction.y < 0.0, "{name}: {origin}");
        }
    }
    for (name, fewest, most) in COUNTED {
        let count = load(name).triangle_count();
        assert!((fewest..=most).contains(&count), "{name}: {count}");
    }
}

/// Their ground hides the water, the light stands above everything, and the camera sees all of the object and of its shadow.
#[test]
fn scenes_above_the_water_show_an_object_and_its_whole_shadow() {
    for (name, fewest, most) in ABOVE {
        for scene in [load(name), with_stand_ins(name)] {
            let count = scene.triangle_count();
            assert!((fewest..=most).contains(&count), "{name}: {count}");
            assert_eq!(scene.light.kind, LightKind::Point);
            let [ground, object] = &scene.objects[..] else { panic!("{name}") };
            let (ground, bounds) = (ground.mesh.bounds(), object.mesh.bounds());
            assert!(ground.size().y == 0.0 && ground.min.y > scene.water.bound_m(), "{name}");
            assert!((bounds.min.y - ground.min.y).abs() < 0.02, "{name}: {bounds:?}");
            let [half_x, half_z] = scene.water.half_size_m;
            for corner in [[half_x, half_z], [-half_x, -half_z]] {
                assert!(ground.contains(DVec3::new(corner[0], ground.min.y, corner[1])), "{name}");
            }
            for place in &object.mesh.positions {
                is_seen_with_its_shadow(&scene, Vec3::from(*place).as_dvec3(), ground.min.y);
            }
        }
    }
}

/// Panics if the camera does not see a place below the light, or the place's shadow on level ground.
fn is_seen_with_its_shadow(scene: &Scene, place: DVec3, ground_m: f64) {
    let light = DVec3::from(scene.light.position_m);
    assert!(light.y > place.y, "{}: {place}", scene.name);
    let shadow = light.lerp(place, (light.y - ground_m) / (light.y - place.y));
    for seen in [place, shadow] {
        let ndc = scene.camera.view_projection(800.0 / 600.0).project_point3(seen);
        assert!(ndc.abs().truncate().max_element() < 1.0, "{}: {seen} at {ndc}", scene.name);
        assert!((0.0..1.0).contains(&ndc.z), "{}: {seen} at {ndc}", scene.name);
    }
}

/// SPT Fig. 10: only the top of the bunny stands out of the water, and the camera looks down on it from above.
#[test]
fn the_bunny_in_the_cornell_box_is_half_under_water() {
    for scene in [load("cornell"), with_stand_ins("cornell")] {
        let bunny = scene.objects.last().expect("objects");
        assert_eq!(bunny.name, "bunny");
        let bounds = bunny.mesh.bounds();
        let above = bounds.max.y / bounds.size().y;
        assert!((0.05..0.45).contains(&above), "{bounds:?}");
    }
    let scene = load("cornell");
    assert!(scene.camera.position().y > scene.water.bound_m() && scene.camera.direction().y < 0.0);
    // Light comes through the opening in the ceiling to all of the water, and not farther.
    let light = DVec3::from(scene.light.position_m);
    let ceiling = scene.objects.iter().filter(|o| o.name.starts_with("ceiling"));
    let ceiling: Vec<Bounds> = ceiling.map(|o| o.mesh.bounds()).collect();
    let is_lit = |place: DVec3| {
        ceiling.iter().all(|slab| {
            let y = slab.center().y;
            !slab.contains(light.lerp(place, (light.y - y) / (light.y - place.y)).with_y(y))
        })
    };
    let [x, z] = scene.water.half_size_m;
    for (x, z) in [(x, z), (-x, z), (x, -z), (-x, -z)] {
        let corner = DVec3::new(x, 0.0, z);
        assert!(is_lit(0.95 * corner) && !is_lit(1.3 * corner), "{corner}");
    }
}

/// The room fills a volume of 128 × 104 × 107 voxels, as in VAO Fig. 11.
#[test]
fn the_room_has_the_proportions_of_the_papers() {
    let grid = Grid::fit(&load("room").solid_bounds(), 128).unwrap();
    assert_eq!(grid.cells, [128, 104, 107]);
}

/// The floor comes first, then ten crates: those of VAO Fig. 12 are added one by one. Each stands on what came before.
#[test]
fn crates_are_stacked_in_the_order_of_the_file() {
    let scene = load("crates");
    let bounds: Vec<Bounds> = scene.objects.iter().map(|o| o.mesh.bounds()).collect();
    assert_eq!(bounds.len(), 11);
    for (i, crate_) in bounds.iter().enumerate().skip(1) {
        let foot = crate_.center().with_y(crate_.min.y);
        let carried = bounds[..i].iter().any(|below| {
            let near = (below.max.y - foot.y).abs() < 1e-3;
            near && below.contains(foot.with_y(below.max.y))
        });
        assert!(carried, "{}", scene.objects[i].name);
    }
}

#[test]
fn glass_has_opaque_and_transparent_objects() {
    let scene = load("glass");
    let (clear, opaque): (Vec<_>, Vec<_>) =
        scene.objects.iter().partition(|o| o.material.alpha < 1.0);
    assert!(clear.len() >= 3 && opaque.len() >= 3);
    assert!(clear.iter().all(|o| o.material.alpha > 0.0));
}

/// Volumes have the cells of the paper, asset or stand-in alike, and lie where the camera looks.
#[test]
fn volume_scenes_have_their_cells_and_are_seen() {
    for (name, cells) in VOLUMES {
        let scene = load(name);
        let volume = scene.volume.as_ref().expect("a volume");
        assert_eq!(volume.cells, cells.map(|n| n.div_ceil(8)), "{name}");
        volume.validate().unwrap_or_else(|e| panic!("{name}: {e}"));
        let filled = volume.data.iter().filter(|v| **v > 0.1).count();
        assert!(filled * 100 > volume.data.len(), "{name}: {filled} cells");
        let bounds = volume.bounds();
        assert_eq!(scene.solid_bounds(), bounds);
        assert_eq!(scene.bounds.union(bounds), scene.bounds);
        assert!(!bounds.contains(scene.camera.position()), "{name}");
        assert!(scene.needs_objects("underwater").is_err());
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
    std::fs::write(folder.path().join("floor.obj"), "v 0 0 0\nv 0 0 1\nv 1 0 0\nf 1 2 3\n")
        .unwrap();
    assert_eq!(Scene::load(&name).unwrap().triangle_count(), 1);
}
