//! What cases run on: uploads of a reference's inputs, small scenes, and read-back as f64 images.

use glam::{DVec3, UVec2};

use super::Result;
use fathom_gpu::{
    ColorTarget, DepthTarget, Gpu, GpuError, StageScope, Targets, TimedStage, read_buffer,
    read_texture,
};
use fathom_reference::image::Image;
use fathom_reference::quantities::{StoredPhoton, stored_photons};
use fathom_scene::{Camera, LightKind, Scene};
use fathom_stages::frame::{Shared, View};
use fathom_stages::gbuffer::GbufferTextures;
use fathom_stages::geometry::Geometry;
use fathom_stages::kit::{self, Resources};
use fathom_stages::photon::{Photon, Photons};
use fathom_stages::scene::gbuffer;

/// The device, and what is made on it.
pub struct Rig<'g> {
    pub gpu: &'g Gpu,
    pub resources: Resources<'g>,
}

/// What the stages over a scene share.
pub struct Stand {
    pub view: View,
    pub shared: Shared,
    pub geometry: Geometry,
}

impl<'g> Rig<'g> {
    pub fn new(gpu: &'g Gpu) -> Self {
        Self { gpu, resources: Resources::new(gpu) }
    }

    /// Runs stages as one frame and waits for it.
    pub fn run(&self, stages: &[&dyn TimedStage]) -> Result<(), GpuError> {
        self.gpu.run(stages)
    }

    pub fn stand(&self, scene: &Scene, size_px: [u32; 2]) -> Stand {
        let view = view(scene, size_px);
        let shared = Shared::new(&self.resources, &view);
        Stand { view, shared, geometry: Geometry::new(&self.resources, scene) }
    }

    /// The scene's G-buffer, drawn.
    pub fn gbuffer(&self, stand: &Stand) -> Result<GbufferTextures> {
        let Stand { view, shared, geometry } = stand;
        let size_px = view.size_px.to_array();
        let gbuffer = gbuffer::new(&self.resources, shared, geometry, size_px)?;
        self.run(&[&gbuffer])?;
        Ok(gbuffer.left)
    }

    /// One channel of a texture in f64.
    pub fn channel(&self, texture: &wgpu::Texture, channel: usize) -> Result<Image> {
        let pixels = read_texture(self.gpu, texture)?;
        let stride = pixels.channels as usize;
        let data = pixels.data.iter().skip(channel).step_by(stride);
        let data = data.map(|v| f64::from(*v)).collect();
        Ok(Image::from_data(pixels.width, pixels.height, data)?)
    }

    /// Three channels of a texture as vectors, in rows.
    pub fn vectors(&self, texture: &wgpu::Texture) -> Result<Vec<DVec3>> {
        let pixels = read_texture(self.gpu, texture)?;
        let vector = |texel: &[f32]| DVec3::new(texel[0].into(), texel[1].into(), texel[2].into());
        let texels = pixels.data.chunks_exact(pixels.channels as usize);
        Ok(texels.map(vector).collect())
    }

    pub fn read_photons(&self, photons: &Photons) -> Result<Vec<StoredPhoton>, GpuError> {
        Ok(stored_photons(&read_buffer(self.gpu, &photons.buffer)?))
    }

    /// What a buffer holds.
    pub fn read<T: bytemuck::Pod>(&self, buffer: &wgpu::Buffer) -> Result<Vec<T>, GpuError> {
        Ok(bytemuck::pod_collect_to_vec(&read_buffer(self.gpu, buffer)?))
    }

    /// A buffer of these words.
    pub fn words(&self, words: &[u32]) -> kit::Buffer {
        let buffer = self.resources.storage("verify words", 4 * words.len() as u64);
        self.gpu.queue.write_buffer(&buffer, 0, bytemuck::cast_slice(words));
        buffer
    }

    /// A buffer of so many ones, as 32-bit floats.
    pub fn ones(&self, count: u32) -> kit::Buffer {
        self.words(&vec![1.0f32.to_bits(); count as usize])
    }

    /// A photon buffer with this content.
    pub fn photons(&self, photons: &[Photon]) -> Photons {
        let buffer = Photons::new(&self.resources, "verify photons", photons.len() as u32);
        self.gpu.queue.write_buffer(&buffer.buffer, 0, bytemuck::cast_slice(photons));
        buffer
    }

    /// A texture with one 32-bit float per texel, from an image.
    pub fn grey(&self, image: &Image) -> wgpu::Texture {
        let data: Vec<f32> = image.data().iter().map(|v| *v as f32).collect();
        let bytes = bytemuck::cast_slice(&data);
        self.texture(image.size(), wgpu::TextureFormat::R32Float, bytes)
    }

    /// A texture of one colour throughout, in 16-bit floats so that it can be filtered everywhere.
    pub fn constant(&self, size: [u32; 2], color: [f32; 4]) -> Result<wgpu::Texture, GpuError> {
        let texture =
            self.resources.target("verify constant", size, wgpu::TextureFormat::Rgba16Float);
        let [r, g, b, a] = color.map(f64::from);
        let clear = Clear { view: kit::view(&texture), to: To::Color(wgpu::Color { r, g, b, a }) };
        self.run(&[&clear])?;
        Ok(texture)
    }

    /// Makes a texture grey throughout.
    pub fn fill(&self, texture: &wgpu::Texture, grey: f64) -> Result<(), GpuError> {
        let to = To::Color(wgpu::Color { r: grey, g: grey, b: grey, a: 1.0 });
        self.run(&[&Clear { view: kit::view(texture), to }])
    }

    /// A depth texture of one value throughout.
    pub fn depth(&self, size: [u32; 2], depth: f64) -> Result<wgpu::Texture, GpuError> {
        let texture = self.resources.target("verify depth", size, kit::DEPTH_FORMAT);
        let clear = Clear { view: kit::view(&texture), to: To::Depth(depth as f32) };
        self.run(&[&clear])?;
        Ok(texture)
    }

    fn texture(&self, size: [u32; 2], format: wgpu::TextureFormat, bytes: &[u8]) -> wgpu::Texture {
        use wgpu::util::DeviceExt;
        self.gpu.device.create_texture_with_data(
            &self.gpu.queue,
            &wgpu::TextureDescriptor {
                label: Some("verify input"),
                size: wgpu::Extent3d { width: size[0], height: size[1], depth_or_array_layers: 1 },
                mip_level_count: 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format,
                usage: wgpu::TextureUsages::TEXTURE_BINDING,
                view_formats: &[],
            },
            wgpu::util::TextureDataOrder::LayerMajor,
            bytes,
        )
    }
}

/// Clears a target and draws nothing.
struct Clear {
    view: wgpu::TextureView,
    to: To,
}

enum To {
    Color(wgpu::Color),
    Depth(f32),
}

impl TimedStage for Clear {
    fn name(&self) -> &'static str {
        "verify/clear"
    }

    fn encode(&self, scope: &mut StageScope<'_>) {
        let view = &self.view;
        let color = |to| [ColorTarget { view, clear: Some(to), slice: None }];
        let depth = |to| DepthTarget { view, clear: Some(to), read_only: false };
        match self.to {
            To::Color(to) => scope.render(&Targets { color: &color(to), depth: None }, |_| ()),
            To::Depth(to) => scope.render(&Targets { color: &[], depth: Some(depth(to)) }, |_| ()),
        }
    }
}

/// Scene `plane` under flat water, lit at a slant, so that refraction shifts every photon. The light's
/// frustum is narrow enough that no photon passes beside the floor.
pub fn flat_plane(kind: LightKind) -> Result<Scene> {
    let mut scene = Scene::load("plane")?;
    scene.water.amplitude_m = 0.0;
    scene.light.kind = kind;
    scene.light.direction = [0.4, -1.0, 0.25];
    scene.light.position_m = [1.5, 6.0, -1.0];
    scene.light.half_extent_m = 3.0;
    Ok(scene)
}

/// What a frame of a scene is seen from. The edge threshold is the pipeline's default.
pub fn view(scene: &Scene, size_px: [u32; 2]) -> View {
    View {
        camera: scene.camera.clone(),
        light: scene.light.clone(),
        water: scene.water.clone(),
        bounds: scene.bounds,
        size_px: UVec2::from(size_px),
        edge_m: 0.1,
    }
}

/// A camera at a round place in the middle of things, for synthetic photons.
pub fn level_camera() -> Camera {
    Camera::new([0.0, -1.0, 0.0], [0.0, -1.0, -4.0], 60.0, [0.1, 20.0])
}

/// The view of synthetic photons: [`level_camera`] in scene `plane`.
pub fn synthetic_view(size_px: [u32; 2], gamma_per_m: f64) -> Result<View> {
    let mut scene = flat_plane(LightKind::Directional)?;
    scene.camera = level_camera();
    scene.water.attenuation_per_m = gamma_per_m;
    Ok(view(&scene, size_px))
}

/// A photon as the GPU has it; f64 twins are taken from its rounded numbers.
pub fn photon(entry: DVec3, hit: DVec3, distance_m: f64) -> Photon {
    Photon {
        entry_m: entry.as_vec3(),
        residual_m: 0.0,
        hit_m: hit.as_vec3(),
        distance_m: distance_m as f32,
    }
}

/// The largest of errors; not a number where one is none or there is nothing to compare, so that no check passes by it.
pub fn largest(errors: impl IntoIterator<Item = f64>) -> f64 {
    let worse = |a: f64, b: f64| if a.is_nan() || b.is_nan() { f64::NAN } else { a.max(b) };
    errors.into_iter().reduce(worse).map_or(f64::NAN, |most| worse(most, 0.0))
}

pub use fathom_base::statistics::mean;

/// Repeatable noise in 0…1, as f32 holds it.
pub fn noise(size: [u32; 2], seed: u32) -> Image {
    let mut random = Random::new(seed);
    Image::of(size, |_, _| f64::from(random.number() as f32))
}

/// Repeatable numbers in 0…1.
pub struct Random(u32);

impl Random {
    pub fn new(seed: u32) -> Self {
        Self(seed)
    }

    pub fn number(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(1);
        f64::from(fathom_reference::filter::pcg(self.0)) / 4_294_967_296.0
    }

    pub fn within(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.number()
    }
}
