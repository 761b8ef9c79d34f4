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

use crate::frame::Shared;
use crate::kit::{self, Bind, Group, Raster, RenderSpec, Resources};
use crate::photon::Photons;
use crate::shader_struct;
use crate::splatting::{self, Accumulated};
use crate::{Column, Output, Stage, StageInfo};
use fathom_gpu::{ColorTarget, GpuError, StageScope, Targets};
use fathom_record::Work;

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

pub struct Mesh {
    raster: Raster,
    groups: Vec<wgpu::BindGroup>,
    /// Squares of four neighbours in a row, and rows of them.
    squares: u32,
    target: wgpu::Texture,
    view: wgpu::TextureView,
}

impl Mesh {
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
    ) -> Result<Self, GpuError> {
        let uniforms = resources.uniform(INFO.name, settings);
        let binds =
            [Bind::Uniform(&uniforms), Bind::Read(&photons.buffer), Bind::Depth(scene_depth)];
        let groups = [&shared.group, &Group::new(resources.gpu, INFO.name, &binds)];
        let format = kit::accumulation_format(resources.gpu);
        let target = resources.target(INFO.name, settings.size_px.as_uvec2().to_array(), format);
        let defs = [("SIDE", side as i32), shared.fresnel_def()];
        let targets = [kit::additive(format)];
        let spec = RenderSpec::new(INFO.name, (INFO.name, &defs[..]), &groups, &targets);
        Ok(Self {
            raster: Raster::new(resources, &spec)?,
            groups: kit::bare(&groups),
            squares: (settings.grid * side).saturating_sub(1),
            view: kit::view(&target),
            target,
        })
    }
}

impl Accumulated for Mesh {
    fn texture(&self) -> &wgpu::Texture {
        &self.target
    }

    fn column(&self) -> Column {
        Column {
            name: "irradiance",
            unit: "W/m²",
            meaning: "what the photons bring to the surface seen, attenuated, by the ratio of areas",
        }
    }
}

impl Stage for Mesh {
    fn info(&self) -> &'static StageInfo {
        &INFO
    }

    fn encode(&self, scope: &mut StageScope<'_>) {
        let clear = Some(wgpu::Color::BLACK);
        let color = [ColorTarget { view: &self.view, clear, slice: None }];
        scope.render(&Targets { color: &color, depth: None }, |pass| {
            self.raster.bind(pass);
            kit::bind_groups(pass, &self.groups);
            pass.draw(0..self.squares * VERTICES, 0..self.squares);
        });
    }

    fn work(&self) -> Work {
        let squares = u64::from(self.squares).pow(2);
        // A mesh without folds that fills the view draws each pixel once.
        let fragments = kit::pixels(&self.target);
        Work {
            photons: squares,
            primitives: 2 * squares,
            fragments,
            texel_fetches: fragments,
            // Each vertex reads the three photons of its triangle.
            bytes_read: Photons::bytes(squares * u64::from(VERTICES) * 3),
            bytes_written: fragments * 4,
            ..Work::default()
        }
    }

    /// The mesh may lie outside the view; a photon that several vertices read counts once.
    fn least_work(&self) -> Work {
        let squares = u64::from(self.squares).pow(2);
        let pixels = kit::pixels(&self.target);
        Work {
            primitives: 2 * squares,
            bytes_read: Photons::bytes(squares),
            bytes_written: pixels * 4,
            ..Work::default()
        }
    }

    fn outputs(&self) -> Vec<Output> {
        vec![splatting::output(self)]
    }
}
