//! What `godrays/lines` is, and `caustics/splat` where the rasterizer draws it: quads pulled from the photon buffer, drawn over the
//! camera's depth and added up.

use crate::photon::Photons;
use crate::prelude::*;
use fathom_gpu::kit::Raster;

/// Photons drawn by one instance of the index pattern: 16,384 vertices, so that 16-bit indices do, and few instances
/// even for millions of photons.
pub const PHOTONS_PER_INSTANCE: u32 = 4096;

/// How a family draws its photons.
pub struct SplatDrawing<'a> {
    pub uniforms: &'a Buffer,
    pub size_px: [u32; 2],
    /// What else the shader is compiled with.
    pub def: Option<(&'a str, i32)>,
    /// Energy is divided by the area drawn; else each pixel gets all of it.
    pub conserving: bool,
    /// Fragments of a frame, for the declared work.
    pub fragments: u64,
    /// What the sum is.
    pub column: Column,
}

/// What is drawn of photons, added up.
#[derive(Clone)]
pub struct SplatSums {
    pub texture: wgpu::Texture,
    /// What the texels hold.
    pub column: Column,
}

/// The stage, which leaves sums of this column.
pub(crate) fn summing(stage: Stage<wgpu::Texture>, column: Column) -> Stage<SplatSums> {
    let meaning = "what the photons add up to, before the low-pass";
    let stage = stage.dump_as("intensity", meaning, vec![column.clone()]);
    let texture = stage.output.clone();
    stage.with_output(SplatSums { texture, column })
}

/// The stage `info`.
pub(crate) fn new(
    resources: &Resources<'_>,
    info: &'static StageInfo,
    shared: &Shared,
    photons: &Photons,
    scene_depth: &wgpu::Texture,
    drawing: SplatDrawing<'_>,
) -> Result<Stage<SplatSums>, GpuError> {
    let SplatDrawing { uniforms, size_px, def, conserving, fragments, column } = drawing;
    let format = kit::accumulation_format(resources.gpu);
    let depth = resources.target(info.name, size_px, kit::DEPTH_FORMAT);
    let mut defs = vec![("CONSERVING", i32::from(conserving)), shared.fresnel_def()];
    defs.extend(def);
    let groups = [&shared.group, &Bindings::new(&[uniforms, photons, scene_depth])];
    let targets = [kit::additive(format)];
    let tested = Depth {
        compare: wgpu::CompareFunction::LessEqual,
        clear: Some(1.0),
        ..Depth::behind(&depth)
    };
    let spec = RenderSpec {
        depth: Some(tested),
        ..RenderSpec::new((info.name, &defs[..]), &groups, &targets)
    };
    let raster = Raster::new(resources, &spec)?;
    let depths = RenderSpec {
        vertex: "depth_vertex",
        fragment: Some("depth_fragment"),
        targets: &[kit::unwritten_target(format)],
        depth: Some(Depth { compare: wgpu::CompareFunction::Always, write: true, ..tested }),
        ..spec
    };
    let pass = DrawPass::new(resources, &depths, size_px, wgpu::Color::BLACK)?;
    let (pixels, count) = (pass.pixels(), u64::from(photons.count));
    let work = Work {
        photons: count,
        primitives: count * 2,
        fragments,
        bytes_read: Photons::bytes(count),
        bytes_written: fragments * 4 + pixels * 8,
        ..Work::default()
    };
    // Splats may lie outside the picture.
    let min_work = Work { fragments: 0, bytes_written: pixels * 4, ..work };
    let quads = quads(resources, photons.count);
    let stage = pass.drawing(info, work, move |pass| {
        kit::draw_fullscreen(pass);
        raster.follow(pass);
        quads(pass);
    });
    Ok(summing(stage.with_min_work(min_work), column))
}

/// Draws a quad for each photon.
pub(crate) fn quads(
    resources: &Resources<'_>,
    photons: u32,
) -> impl Fn(&mut wgpu::RenderPass<'_>) + 'static {
    let indices = index_pattern(resources);
    move |pass| {
        pass.set_index_buffer(indices.slice(..), wgpu::IndexFormat::Uint16);
        let instances = photons.div_ceil(PHOTONS_PER_INSTANCE);
        pass.draw_indexed(0..PHOTONS_PER_INSTANCE * 6, 0, 0..instances);
    }
}

/// Two triangles for each of [`PHOTONS_PER_INSTANCE`] quads.
fn index_pattern(resources: &Resources<'_>) -> Buffer {
    let indices: Vec<u16> = (0..PHOTONS_PER_INSTANCE as u16)
        .flat_map(|quad| [0, 1, 2, 2, 1, 3].map(|corner| quad * 4 + corner))
        .collect();
    resources.filled("quad indices", bytemuck::cast_slice(&indices), wgpu::BufferUsages::INDEX)
}
