//! `scene/deform` against f64, vertex by vertex.

use crate::prelude::*;
use fathom_reference::deform::Moment;
use fathom_scene::Motion;
use fathom_stages::scene::deform;

const STAGE: &str = "scene/deform";
/// Curved, flat and upright objects.
const SCENE: &str = "tank";
const CYCLES: f64 = 3.4;
const AMPLITUDE: f64 = 0.15;
/// WGSL bounds the error of sine and cosine by 2⁻¹¹ within half a turn: at 5 m from the axis that is 2.4 mm. Drivers do far better.
const POSITION_M: f64 = 2.5e-3;
/// Radians: the same bound, and the lean of the normals that a twist multiplies it with.
const NORMAL: f64 = 5e-3;

pub fn cases() -> Vec<Case> {
    let motions = [(Motion::Spin, "spin"), (Motion::Twist, "twist"), (Motion::Wave, "wave")];
    let what = |(_, name): (Motion, &str)| name.to_owned();
    Case::each(STAGE, motions, what, check).collect()
}

/// A vertex's position and normal.
type VertexPair = [DVec3; 2];

fn check(rig: &Rig<'_>, (motion, name): (Motion, &str)) -> Checks {
    let scene = Scene::load(SCENE)?;
    let geometry = Geometry::new(rig, &scene);
    rig.run(&[&deform::new(rig, &geometry, &scene, motion, CYCLES, AMPLITUDE)?])?;
    let words: Vec<f32> = rig.read(&geometry.vertices)?;
    let vector = |v: &[f32]| Vec3::from_slice(v).as_dvec3();
    let found: Vec<VertexPair> =
        words.chunks_exact(7).map(|v| [vector(&v[..3]), vector(&v[3..6])]).collect();

    // Largest distance of positions, and of normals.
    let off = |cycles: f64| {
        let moved = |object| move_object(object, motion, cycles);
        let twin: Vec<VertexPair> = scene.objects.iter().flat_map(moved).collect();
        [0, 1].map(|k| largest(found.iter().zip(&twin).map(|(a, b)| a[k].distance(b[k]))))
    };
    let (measured, control) = (off(CYCLES), off(CYCLES + 0.02));
    let perturbed = "time moved by 0.02 cycles";
    Ok(vec![
        Check::new(rig, format!("{name}: largest distance from the f64 twin"))
            .within((POSITION_M, "m"), measured[0])
            .control(perturbed, control[0]),
        Check::new(rig, format!("{name}: largest difference of the normal from the f64 twin"))
            .within((NORMAL, "1"), measured[1])
            .control(perturbed, control[1]),
    ])
}

fn move_object(object: &Object, motion: Motion, cycles: f64) -> Vec<VertexPair> {
    let mesh = &object.mesh;
    let moment = Moment::new(mesh, motion, cycles, AMPLITUDE);
    let vertex = |(position, normal): (&[f32; 3], &[f32; 3])| {
        let [position, normal] = [position, normal].map(|v| Vec3::from(*v).as_dvec3());
        let normal = normal.normalize();
        [moment.position(position, normal), moment.normal(position, normal)]
    };
    mesh.positions.iter().zip(&mesh.normals).map(vertex).collect()
}
