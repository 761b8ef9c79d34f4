//! `caustics/mesh`: the light's grid refracted as triangles, a caustic mesh.
//!
//! The corners are the photons that `caustics/trace` has found. Four neighbours make two triangles. The light that enters the water through
//! the triangle of their entries lands in the triangle of their hits: irradiance is flux over area (Nishita and Nakamae, *Method of
//! Displaying Optical Effects within Water using Accumulation Buffer*, 1994). Wallace's *WebGL Water* (2010) takes the same ratio on a grid of
//! the surface. The cosine at the receiver is in the area. The mesh is drawn in the camera's view, on the pixels whose surface it lies on.
//!
//! Not drawn are
//! - triangles with a photon that misses the water or meets nothing;
//! - triangles whose longest edge is more than `most_stretch` times as long as before refraction: their corners lie on different surfaces, and no
//!   light lands between them. Their flux is lost, a dark rim of a cell at silhouettes that the light sees;
//! - the outermost half cell of the grid, where photons have no neighbours.

use glam::Vec2;

use crate::photon::Photons;
use crate::prelude::*;
use crate::splatting::{Sums, summing};

pub const INFO: StageInfo = StageInfo {
    name: "caustics/mesh",
    about: "neighbouring photons as triangles, irradiance by the ratio of areas, added up in a float target",
    source: "Nishita and Nakamae 1994; Wallace 2010",
};

shader_struct! {
    /// `Mesh` in `shaders/caustics/mesh.wgsl`.
    pub struct MeshUniforms {
        pub size_px: Vec2,
        /// Cells per side of the light's grid.
        pub grid: u32,
        pub strength: f32,
        pub depth_bias_m: f32,
        pub most_stretch: f32,
    }
}

/// Vertices of four neighbours.
const VERTICES: u32 = 6;

/// Of cells with `side`² photons each. `scene_depth` is the camera's.
///
/// # Errors
/// What the GPU reports.
pub fn new(
    resources: &Resources<'_>,
    shared: &Shared,
    (photons, scene_depth): (&Photons, &wgpu::Texture),
    settings: &MeshUniforms,
    side: u32,
) -> Result<Stage<Sums>, GpuError> {
    let uniforms = resources.uniform(INFO.name, settings);
    let groups = [&shared.group, &Group::new(&[&uniforms, photons, scene_depth])];
    let defs = [("SIDE", side as i32), shared.fresnel_def()];
    let targets = [kit::additive(kit::accumulation_format(resources.gpu))];
    let spec = RenderSpec::new((INFO.name, &defs), &groups, &targets);
    let size_px = settings.size_px.as_uvec2().to_array();
    let pass = Pass::new(resources, &spec, size_px, wgpu::Color::BLACK)?;
    // Squares of four neighbours in a row, and rows of them.
    let squares = (settings.grid * side).saturating_sub(1);
    let count = u64::from(squares).pow(2);
    // A mesh without folds that fills the view draws each pixel once.
    let work = Work {
        photons: count,
        primitives: 2 * count,
        // Each vertex reads the three photons of its triangle.
        bytes_read: Photons::bytes(count * u64::from(VERTICES) * 3),
        ..pass.work(1, 4)
    };
    // The mesh may lie outside the view; a photon that several vertices read counts once.
    let least = Work {
        primitives: 2 * count,
        bytes_read: Photons::bytes(count),
        bytes_written: pass.pixels() * 4,
        ..Work::default()
    };
    let column = Column::new(
        "irradiance",
        "W/m²",
        "what the photons bring to the surface seen, attenuated, by the ratio of areas",
    );
    let stage = pass.drawing(&INFO, work, move |pass| pass.draw(0..squares * VERTICES, 0..squares));
    Ok(summing(stage.at_least(least), column))
}
