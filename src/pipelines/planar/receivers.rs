//! Whether a scene is a rectangular pool and nothing in it, so that its floor and walls are all that photons can meet.

use glam::DVec3;

use fathom_reference::pool::{Basin, Face};
use fathom_scene::{Bounds, Object, Scene};

/// A triangle this near to a plane lies on it, as a share of the pool's shorter side: far above the rounding of 32-bit corners, and too
/// little to be seen. A millimetre in scene planar_pool.
const SLACK: f64 = 2.5e-4;
/// Share of a face that triangles cover at least; the rest is rounding.
const COVERED: f64 = 0.999;

/// One line that says what is wrong with the scene, and which parameters give the pool.
pub fn check(scene: &Scene, basin: &Basin) -> Result<(), String> {
    let unfit = |what: String| {
        let name = &scene.name;
        Err(format!(
            "scene `{name}` is no empty rectangular pool: {what}; pipeline planar lights the floor at floor_depth_m and walls at the \
             borders of water.center_m and water.half_size_m (as in scene planar_pool)"
        ))
    };
    if let Some(object) = scene.objects.iter().find(|object| stands_inside(object, basin)) {
        return unfit(format!("object `{}` reaches into it", object.name));
    }
    match Face::ALL.into_iter().find(|face| !is_covered(&scene.objects, basin, *face)) {
        Some(Face::Floor) => unfit(format!("its floor is not at y = {} m", -basin.floor_depth_m)),
        Some(face) => {
            let corner = basin.rectangle(face).corner;
            let (axis, at) = if face.normal().x != 0.0 { ("x", corner.x) } else { ("z", corner.z) };
            unfit(format!("it has no wall at {axis} = {at} m"))
        }
        None => Ok(()),
    }
}

fn slack_m(basin: &Basin) -> f64 {
    let [half_x, half_z] = basin.half_size_m;
    2.0 * SLACK * half_x.min(half_z)
}

fn triangles(object: &Object) -> impl Iterator<Item = [DVec3; 3]> {
    (0..object.mesh.triangle_count()).map(|index| object.mesh.triangle(index))
}

/// Whether the box around a triangle reaches into the water at rest.
fn stands_inside(object: &Object, basin: &Basin) -> bool {
    let floor = basin.rectangle(Face::Floor);
    let far = floor.at([1.0, 1.0]).with_y(0.0);
    let (min, max) = (floor.corner + slack_m(basin), far - slack_m(basin));
    triangles(object).any(|corners| {
        let around = Bounds::around(corners);
        around.min.cmplt(max).all() && around.max.cmpgt(min).all()
    })
}

/// Whether the triangles on the plane of a face, which may go on beyond it, have its area at least.
fn is_covered(objects: &[Object], basin: &Basin, face: Face) -> bool {
    let rectangle = basin.rectangle(face);
    let off_m = |corner: DVec3| (corner - rectangle.corner).dot(face.normal()).abs();
    let on_plane = objects
        .iter()
        .flat_map(triangles)
        .filter(|corners| corners.iter().all(|corner| off_m(*corner) < slack_m(basin)));
    let area = |[a, b, c]: [DVec3; 3]| 0.5 * (b - a).cross(c - a).length();
    on_plane.map(area).sum::<f64>() >= COVERED * rectangle.area_m2()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn judged(name: &str, change: impl Fn(&mut Scene)) -> Result<(), String> {
        let mut scene = Scene::load(name).unwrap();
        change(&mut scene);
        check(&scene, &Basin::of(&scene.water, scene.floor_depth_m))
    }

    #[test]
    fn an_empty_pool_suits_and_others_are_refused_in_one_line() {
        assert_eq!(judged("planar_pool", |_| ()), Ok(()));
        for (name, told) in
            [("tank", "object `statue` reaches into it"), ("plane", "no wall at x = -10 m")]
        {
            let fault = judged(name, |_| ()).unwrap_err();
            assert!(fault.contains(told) && !fault.contains('\n'), "{fault}");
        }
    }

    #[test]
    fn a_pool_of_another_size_or_place_is_refused() {
        let faults = [
            judged("planar_pool", |scene| scene.water.half_size_m[1] -= 0.01),
            judged("planar_pool", |scene| scene.water.center_m[0] += 0.01),
            judged("planar_pool", |scene| scene.floor_depth_m += 0.01),
        ];
        for (fault, told) in
            faults.into_iter().zip(["no wall at z", "no wall at x", "floor is not at y"])
        {
            let fault = fault.unwrap_err();
            assert!(fault.contains(told) || fault.contains("reaches into it"), "{fault}");
        }
    }
}
