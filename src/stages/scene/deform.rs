//! `scene/deform`: geometry in motion, each object about its own foot: vertices at rest to those of a moment, with normals.
//!
//! `spin` turns an object about its vertical axis. `twist` swings it, the further the higher: the top by `amplitude` turns.
//! `wave` moves vertices along their normals by `amplitude` of the object's height, one wave over the height, travelling up.
//! The paper's dynamic geometry (VAO §4.2) is animated characters; these motions touch every vertex as theirs does.

use glam::Vec3;

use crate::geometry::Geometry;
use crate::prelude::*;
use fathom_scene::{Motion, Scene};

pub const INFO: StageInfo = StageInfo {
    name: "scene/deform",
    about: "vertices and normals of moving geometry: spin, twist or wave of each object",
    source: "VAO §4.2",
};

/// Floats of a vertex: position, normal, material.
const STRIDE: usize = 7;

shader_struct! {
    pub struct DeformUniforms {
        pub vertices: u32,
        /// Cycles since time 0, their whole part left out.
        pub cycles: f32,
        /// Share of an object's height, or turns.
        pub amplitude: f32,
    }
}

shader_struct! {
    pub struct PivotUniforms {
        /// Middle of the object's foot.
        pub foot_m: Vec3,
        pub height_m: f32,
    }
}

/// The middle of an object's foot, and its height.
fn pivots(scene: &Scene) -> Vec<PivotUniforms> {
    scene
        .objects
        .iter()
        .map(|object| {
            let bounds = object.mesh.bounds();
            PivotUniforms {
                foot_m: bounds.center().with_y(bounds.min.y).as_vec3(),
                height_m: bounds.size().y as f32,
            }
        })
        .collect()
}

/// Rewrites the vertices of `geometry`, which must hold those of `scene`, at rest, when this is called. `cycles` is time ×
/// frequency.
pub fn new(
    resources: &Resources<'_>,
    geometry: &Geometry,
    scene: &Scene,
    motion: Motion,
    cycles: f64,
    amplitude: f64,
) -> Result<Stage, GpuError> {
    let count = geometry.vertices();
    let uniforms = DeformUniforms {
        vertices: count as u32,
        cycles: cycles.rem_euclid(1.0) as f32,
        amplitude: amplitude as f32,
    };
    let uniforms = resources.uniform(INFO.name, &uniforms);
    let storage = wgpu::BufferUsages::STORAGE;
    let pivots = resources.structs("pivots", &pivots(scene), wgpu::BufferUsages::empty());
    let bytes = geometry.vertices.size();
    let rest = || Geometry::vertex_bytes(scene);
    let rest = resources.filled_by("vertices at rest", bytes, storage, rest);
    let group = Bindings::new(&[&uniforms, &pivots, &rest, &geometry.vertices]);
    let (defs, workgroups) = ([("MOTION", motion as i32)], kit::linear_workgroups(count));
    let dispatch = Dispatch::new(resources, (INFO.name, &defs), &[&group], workgroups)?;
    let work = Work {
        bytes_read: count * STRIDE as u64 * 4,
        // The material stays.
        bytes_written: count * 6 * 4,
        ..Work::default()
    };
    let mut columns = Column::many(["x", "y", "z"], "m", "position");
    columns.extend(Column::many(["nx", "ny", "nz"], "1", "unit normal"));
    let rows = (&*geometry.vertices, STRIDE, count as u32);
    let row = |vertex: &[f32]| vertex[..6].to_vec();
    let output = StageDump::rows("vertices", "vertices of this moment", columns, rows, row);
    Ok(Dispatch::stage([dispatch], &INFO, work).dump(output))
}
