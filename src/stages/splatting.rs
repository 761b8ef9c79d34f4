//! What `godrays/lines` is, and `caustics/splat` where the rasterizer draws it: quads pulled from the photon buffer, drawn over the
//! camera's depth and added up.

use super::frame::Shared;
use super::kit::{self, Bind, Buffer, Group, Raster, RenderSpec, Resources};
use super::photon::Photons;
use super::{Column, Output, Stage, StageInfo};
use fathom_gpu::{ColorTarget, DepthTarget, GpuError, StageScope, Targets};
use fathom_record::Work;

/// Photons drawn by one instance of the index pattern: 16,384 vertices, so that 16-bit indices do, and few instances
/// even for millions of photons.
pub const PHOTONS_PER_INSTANCE: u32 = 4096;

/// How a family draws its photons.
pub struct Drawing<'a> {
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

pub struct Additive {
    info: &'static StageInfo,
    depth_raster: Raster,
    raster: Raster,
    groups: Vec<wgpu::BindGroup>,
    indices: Buffer,
    photons: u32,
    fragments: u64,
    column: Column,
    target: wgpu::Texture,
    target_view: wgpu::TextureView,
    depth_view: wgpu::TextureView,
}

impl Additive {
    /// The stage `info`.
    pub(super) fn new(
        resources: &Resources<'_>,
        info: &'static StageInfo,
        shared: &Shared,
        (photons, scene_depth): (&Photons, &wgpu::Texture),
        drawing: Drawing<'_>,
    ) -> Result<Self, GpuError> {
        let Drawing { uniforms, size_px, def, conserving, fragments, column } = drawing;
        let gpu = resources.gpu;
        let binds =
            [Bind::Uniform(uniforms), Bind::Read(&photons.buffer), Bind::Depth(scene_depth)];
        let group = Group::new(gpu, info.name, &binds);
        let format = kit::accumulation_format(gpu);
        let target = resources.target(info.name, size_px, format);
        let depth = resources.target(info.name, size_px, kit::DEPTH_FORMAT);
        let mut defs = vec![("CONSERVING", i32::from(conserving)), shared.fresnel_def()];
        defs.extend(def);
        let (groups, targets) = ([&shared.group, &group], [kit::additive(format)]);
        let spec = RenderSpec {
            depth: Some(kit::depth_state(wgpu::CompareFunction::LessEqual, false)),
            ..RenderSpec::new(info.name, (info.name, &defs[..]), &groups, &targets)
        };
        let write_mask = wgpu::ColorWrites::empty();
        let unwritten = [wgpu::ColorTargetState { write_mask, ..kit::opaque(format) }];
        let depth_spec = RenderSpec {
            vertex: "depth_vertex",
            fragment: Some("depth_fragment"),
            targets: &unwritten,
            depth: Some(kit::depth_state(wgpu::CompareFunction::Always, true)),
            ..spec.clone()
        };
        Ok(Self {
            info,
            depth_raster: Raster::new(resources, &depth_spec)?,
            raster: Raster::new(resources, &spec)?,
            groups: kit::bare(&groups),
            indices: index_pattern(resources),
            photons: photons.count,
            fragments,
            column,
            target_view: kit::view(&target),
            depth_view: kit::view(&depth),
            target,
        })
    }
}

/// A stage that adds up what it draws of each photon.
pub trait Accumulated: Stage {
    /// The sums.
    fn texture(&self) -> &wgpu::Texture;
    /// What the texels hold.
    fn column(&self) -> Column;
    /// Both.
    fn source(&self) -> (&wgpu::Texture, Column) {
        (self.texture(), self.column())
    }
}

/// The sums, for dumps.
pub(super) fn output(drawn: &impl Accumulated) -> Output {
    let meaning = "what the photons add up to, before the low-pass";
    Output::texture("intensity", meaning, vec![drawn.column()], drawn.texture())
}

impl Accumulated for Additive {
    fn texture(&self) -> &wgpu::Texture {
        &self.target
    }

    fn column(&self) -> Column {
        self.column.clone()
    }
}

impl Stage for Additive {
    fn info(&self) -> &'static StageInfo {
        self.info
    }

    fn encode(&self, scope: &mut StageScope<'_>) {
        let clear = Some(wgpu::Color::BLACK);
        let targets = Targets {
            color: &[ColorTarget { view: &self.target_view, clear, slice: None }],
            depth: Some(DepthTarget { view: &self.depth_view, clear: Some(1.0), read_only: false }),
        };
        scope.render(&targets, |pass| {
            kit::bind_groups(pass, &self.groups);
            self.depth_raster.bind(pass);
            pass.draw(0..3, 0..1);
            self.raster.bind(pass);
            pass.set_index_buffer(self.indices.slice(..), wgpu::IndexFormat::Uint16);
            let instances = self.photons.div_ceil(PHOTONS_PER_INSTANCE);
            pass.draw_indexed(0..PHOTONS_PER_INSTANCE * 6, 0, 0..instances);
        });
    }

    fn work(&self) -> Work {
        let photons = u64::from(self.photons);
        Work {
            photons,
            primitives: photons * 2,
            fragments: self.fragments,
            bytes_read: Photons::bytes(photons),
            bytes_written: self.fragments * 4 + kit::pixels(&self.target) * 8,
            ..Work::default()
        }
    }

    /// Splats may lie outside the picture.
    fn least_work(&self) -> Work {
        Work { fragments: 0, bytes_written: kit::pixels(&self.target) * 4, ..self.work() }
    }

    fn outputs(&self) -> Vec<Output> {
        vec![output(self)]
    }
}

/// Two triangles for each of [`PHOTONS_PER_INSTANCE`] quads.
pub(super) fn index_pattern(resources: &Resources<'_>) -> Buffer {
    let indices: Vec<u16> = (0..PHOTONS_PER_INSTANCE as u16)
        .flat_map(|quad| [0, 1, 2, 2, 1, 3].map(|corner| quad * 4 + corner))
        .collect();
    resources.filled("quad indices", bytemuck::cast_slice(&indices), wgpu::BufferUsages::INDEX)
}
