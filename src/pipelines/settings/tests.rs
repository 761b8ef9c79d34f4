use super::*;

fn scene() -> Scene {
    Scene::load("bunny_dry").unwrap()
}

fn grids(voxel: &Voxel, deform: Deform) -> Result<Vec<Grid>, String> {
    let scene = scene();
    let animation = Animation { deform, ..Animation::default() };
    voxel.grids(&scene, &animation).map_err(|error| error.to_string())
}

#[test]
fn grids_are_of_the_scene_of_its_objects_or_set_by_hand() {
    let mut voxel = Voxel::default();
    let [whole] = grids(&voxel, Deform::None).unwrap()[..] else {
        panic!("a scene has one grid");
    };
    assert_eq!(whole.cells.into_iter().max(), Some(128));
    voxel.per_object = true;
    let objects = grids(&voxel, Deform::None).unwrap();
    assert_eq!(objects.len(), scene().objects.len());
    assert!(objects[1].voxel_m < whole.voxel_m);
    voxel.cells = [3, 2, 1];
    voxel.voxel_m = 0.5;
    voxel.origin_m = whole.bounds().center().to_array();
    assert!(grids(&voxel, Deform::None).unwrap_err().contains("voxel.per_object"));
    voxel.per_object = false;
    assert_eq!(grids(&voxel, Deform::None).unwrap()[0].cells, [3, 2, 1]);
}

#[test]
fn grids_beside_the_scene_are_errors_that_name_the_parameters() {
    let mut voxel = Voxel { cells: [4; 3], origin_m: [50.0; 3], voxel_m: 0.1, ..Voxel::default() };
    let error = grids(&voxel, Deform::None).unwrap_err();
    assert!(error.starts_with("voxel.cells, voxel.origin_m and voxel.voxel_m place"), "{error}");
    assert_eq!(error.lines().count(), 1);
    // A grid whose border touches the scene may hold some of it.
    let scene = scene().solid_bounds();
    voxel.origin_m = scene.max.to_array();
    assert!(grids(&voxel, Deform::None).is_ok());
    voxel.origin_m = (scene.max + 1e-6).to_array();
    assert!(grids(&voxel, Deform::None).is_err());
}

#[test]
fn moving_objects_have_room_at_all_times() {
    let rest = Bounds { min: DVec3::new(-1.0, 0.0, 2.0), max: DVec3::new(3.0, 4.0, 5.0) };
    for deform in [Deform::None, Deform::Spin, Deform::Twist, Deform::Wave] {
        let animation = Animation { deform, ..Animation::default() };
        let room = animation.motion_bounds(&rest);
        assert!(room.min.cmple(rest.min).all() && room.max.cmpge(rest.max).all());
        assert_eq!(room == rest, deform == Deform::None);
    }
    let spin = Animation { deform: Deform::Spin, ..Animation::default() };
    // Half the diagonal of the foot, 4 m × 3 m, to each side of its middle.
    let room = spin.motion_bounds(&rest);
    assert_eq!((room.min.x, room.max.z), (1.0 - 2.5, 3.5 + 2.5));
    assert_eq!((room.min.y, room.max.y), (0.0, 4.0));
}
