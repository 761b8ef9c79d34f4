//! `compose`: the final image from all buffers, the water surface drawn over it. UW §3.5.

use crate::picture::Picture;
use crate::prelude::*;
use fathom_gpu::kit::Raster;

pub const INFO: StageInfo = StageInfo {
    name: "compose",
    about: "additive composition, water surface, optional screen-space ambient occlusion",
    source: "UW §3.5",
};

shader_struct! {
    pub struct ComposeUniforms {
        /// Irradiance for a unit of the caustics buffer, 1/m² (paper intensity), or the side at 1 m of a square with
        /// the area of that buffer's pixel (conserving intensity).
        pub caustics_scale: f32,
        /// Radiance for a unit of the godray buffer, 1/m², for lines across the sight at the distance of the camera's target.
        pub godrays_scale: f32,
        /// Taps of the ambient occlusion; 0: none.
        pub occlusion_taps: u32,
        pub occlusion_radius_m: f32,
        /// Cells per side of the water grid.
        pub water_cells: u32,
        /// Share of a pixel's view depth within which a texel of caustics or godrays lies on the pixel's surface.
        pub depth_share: f32,
    }
}

pub struct ComposeInputs<'a> {
    pub picture: Picture<'a>,
    pub caustics: &'a wgpu::Texture,
    pub godrays: &'a wgpu::Texture,
    pub reflection: &'a wgpu::Texture,
    pub refraction: &'a wgpu::Texture,
}

/// The stage leaves the picture. Caustics light what is seen, or are `added` as they are.
pub fn new(
    resources: &Resources<'_>,
    shared: &Shared,
    composed: &ComposeInputs<'_>,
    settings: &ComposeUniforms,
    conserving: bool,
    added: bool,
) -> Result<Stage<wgpu::Texture>, GpuError> {
    let occlusion = i32::from(settings.occlusion_taps > 0);
    let defs = [
        ("ADDED", i32::from(added)),
        ("CONSERVING", i32::from(conserving)),
        ("OCCLUSION", occlusion),
        shared.water_def(),
    ];
    let uniforms = resources.loop_settings(INFO.name, settings);
    let sampler = resources.linear_sampler(INFO.name);
    let ComposeInputs { picture, caustics, godrays, reflection, refraction } = composed;
    let own: [&dyn Bind; 6] = [&uniforms, *caustics, *godrays, *reflection, *refraction, &sampler];
    let own = picture.group(resources, INFO.name, &own);
    let depth = &picture.gbuffer.depth;
    let groups = [&shared.group, &own];
    let targets = [kit::opaque(wgpu::TextureFormat::Rgba8Unorm)];
    let screen = RenderSpec {
        vertex: "screen_vertex",
        fragment: Some("screen_fragment"),
        depth: Some(Depth { compare: wgpu::CompareFunction::Always, ..Depth::behind(depth) }),
        ..RenderSpec::new((INFO.name, &defs), &groups, &targets)
    };
    let water =
        RenderSpec { vertex: "water_vertex", fragment: Some("water_fragment"), ..screen.clone() };
    let water = Raster::new(resources, &water)?;
    let pass = DrawPass::new(resources, &screen, picture.size_px(), wgpu::Color::BLACK)?;
    // Three G-buffer texels, and four each of godrays and of caustics with the depth behind each.
    let texels = 3 + 2 * (2 * 4) + u64::from(settings.occlusion_taps);
    let quads = settings.water_cells * settings.water_cells;
    let triangles = u64::from(quads) * 2;
    let work = Work { triangles, ..pass.work(texels, 4) };
    // Only the depth is read everywhere.
    let min_work = Work { triangles, ..pass.work(1, 4) };
    let draw = move |pass: &mut wgpu::RenderPass<'_>| {
        kit::draw_fullscreen(pass);
        water.follow(pass);
        pass.draw(0..quads * 6, 0..1);
    };
    Ok(pass.drawing(&INFO, work, draw).with_min_work(min_work).image())
}
