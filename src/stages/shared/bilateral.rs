//! What `ao/bilateral`, `gtao/filter` and `hsao/filter` share: a joint bilateral filter and up-scaling. VAO §6.

use glam::Vec2;
use serde::{Deserialize, Serialize};

use crate::prelude::*;
use fathom_base::choices;

/// Format of ambient-occlusion buffers: visibility 1 − A, 1 where nothing was drawn.
pub const VISIBILITY_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::R16Float;

/// From this `normal_sigma` on normals are not read: as in `shaders/shared/bilateral.wgsl`.
pub const NO_NORMALS: f32 = 1000.0;

shader_struct! {
    pub struct BilateralUniforms {
        /// Pixels of the viewport.
        pub size_px: Vec2,
        /// Texels of the buffer that is filtered.
        pub source_px: Vec2,
        /// Metres that a pixel of the viewport spans at 1 m.
        pub pixel_tangent: f32,
        pub taps: u32,
        /// Radius of the disc and standard deviation of its Gaussian, texels of the buffer that is filtered.
        pub radius_px: f32,
        pub sigma_px: f32,
        /// Standard deviation of a tap's distance from the pixel's tangent plane along the view, over the pixel's view depth.
        pub depth_sigma: f32,
        /// Standard deviation of the distance between the unit normals of a tap and of the pixel; from NO_NORMALS on they are not read.
        pub normal_sigma: f32,
    }
}

/// What a pixel's value is filtered over.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Window {
    /// A disc on the surface. VAO §6.
    Disc,
    /// The 4 × 4 nearest texels of the buffer. GTAO §4.3.
    Square,
}

choices!(Window);

/// Texels of [`Window::Square`].
const SQUARE_TAPS: u32 = 16;

/// The stage `info`. `visibility` has any size up to the viewport's; each of its texels belongs to the depth texel behind
/// its middle (`texel_behind` in `shaders/shared/screen.wgsl`). The result has the size of the camera's depth and normals.
pub fn new(
    resources: &Resources<'_>,
    info: &'static StageInfo,
    shared: &Shared,
    visibility: &wgpu::Texture,
    depth: &wgpu::Texture,
    normal: &wgpu::Texture,
    (settings, window): (&BilateralUniforms, Window),
) -> Result<Stage<wgpu::Texture>, GpuError> {
    let square = window == Window::Square;
    let taps = if square { SQUARE_TAPS } else { settings.taps };
    let settings = &BilateralUniforms { taps, ..*settings };
    let defs = [("SQUARE", i32::from(square))];
    let filter = resources.loop_settings(info.name, settings);
    let own = Bindings::new(&[&filter, visibility, depth, normal]);
    let (groups, targets) = ([&shared.group, &own], [kit::opaque(VISIBILITY_FORMAT)]);
    let spec = RenderSpec::new((info.name, &defs), &groups, &targets);
    let pass = DrawPass::new(resources, &spec, kit::size_px(depth), wgpu::Color::WHITE)?;
    // The pixel's normal, its depth and its four neighbours'; depth, visibility and, where they count, normal at each tap.
    let of_tap = if settings.normal_sigma < NO_NORMALS { 3 } else { 2 };
    let work = pass.work(6 + of_tap * u64::from(settings.taps), 2);
    // The background is not filtered.
    let min_work = pass.work(1, 2);
    Ok(visible(pass.stage(info, work).with_min_work(min_work), "filtered"))
}

/// The stage with its buffer of [`VISIBILITY_FORMAT`] as an output.
pub fn visible(stage: Stage<wgpu::Texture>, name: &str) -> Stage<wgpu::Texture> {
    let column = Column::new("visibility", "1", "share of the ambient light that arrives");
    let meaning = "visibility 1 − A of VAO Eq. 1; 1 where nothing was drawn";
    stage.dump_as(name, meaning, vec![column])
}
