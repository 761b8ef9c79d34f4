//! What cases run on: uploads of a reference's inputs, small scenes, and read-back as f64 images.

pub use fathom_pipelines::draw::Random;
use std::ops::Deref;

use glam::{DVec2, DVec3, UVec2};

use super::{Result, VerifyError};
use fathom_gpu::kit::{self, Resources};
use fathom_gpu::{
    ColorTarget, DepthTarget, Drawing, Gpu, GpuError, StageScope, Targets, TimedStage, read_buffer,
    read_texture,
};
use fathom_pipelines::{BuiltPipeline, PipelineInstance, caustics_image};
use fathom_reference::image::Image;
use fathom_reference::picture::PictureLight;
use fathom_reference::rays::{Hit, PixelRays, Tracer};
use fathom_scene::{Camera, LightKind, Mesh, Object, Scene, WaterModel, Wave};
use fathom_stages::gbuffer::GBuffer;
use fathom_stages::geometry::Geometry;
use fathom_stages::photon::{Photon, Photons};
use fathom_stages::scene::gbuffer;
use fathom_stages::uniforms::{Shared, View};

/// Of a sum of 16-bit floats: what an addition loses at most, where it is cut off and not rounded. Their significands have 11 bits.
pub const SHORT_STEP: f64 = 1.0 / 1024.0;

/// The device, what is made on it, and the stage that a case judges.
pub struct Rig<'g> {
    resources: Resources<'g>,
    pub stage: &'static str,
}

impl<'g> Deref for Rig<'g> {
    type Target = Resources<'g>;

    fn deref(&self) -> &Resources<'g> {
        &self.resources
    }
}

/// A scene, what its stages share, and what is exact in it.
pub struct Fixture {
    pub scene: Scene,
    pub view: View,
    pub shared: Shared,
    pub geometry: Geometry,
    pub tracer: Tracer,
    /// Of the camera's pixels.
    pub rays: PixelRays,
}

impl Fixture {
    /// What a pixel shows exactly.
    pub fn hit(&self, (x, y): (u32, u32)) -> Option<Hit> {
        Some(self.rays.cast(&self.tracer, x, y)?.0)
    }

    /// What light the picture is in without photons.
    pub fn light(&self) -> PictureLight {
        PictureLight::new(&self.scene.camera, &self.scene.light, &self.scene.water)
    }

    /// Whether a place appears on the picture, hidden or not.
    pub fn in_view(&self, place: DVec3) -> bool {
        let inside = |at: f64, side: u32| (0.0..=f64::from(side)).contains(&at);
        let UVec2 { x, y } = self.view.size_px;
        self.rays.project(place).is_some_and(|on| inside(on.x_px, x) && inside(on.y_px, y))
    }
}

impl<'g> Rig<'g> {
    pub fn new(gpu: &'g Gpu, stage: &'static str) -> Self {
        Self { resources: Resources::new(gpu), stage }
    }

    /// What stages draw of photons adds up in 16-bit floats.
    pub fn sums_are_short(&self) -> bool {
        kit::sums_are_short(self.gpu)
    }

    /// Why a case cannot be carried out.
    pub fn invalid(&self, what: &dyn ToString) -> VerifyError {
        VerifyError::Invalid { stage: self.stage, what: what.to_string() }
    }

    /// Why a case cannot be carried out: this is missing.
    pub fn empty(&self, what: &str) -> VerifyError {
        self.invalid(&format!("nothing to compare in check `{what}`"))
    }

    /// Runs stages as one frame and waits for it.
    pub fn run(&self, stages: &[&dyn TimedStage]) -> Result<(), GpuError> {
        self.gpu.run(stages)
    }

    /// Runs a pipeline's stages up to and including one.
    pub fn run_until<P: PipelineInstance + ?Sized>(
        &self,
        pipeline: &BuiltPipeline<P>,
        last: &str,
    ) -> Result<(), GpuError> {
        let stages = pipeline.stages();
        let end = stages.iter().position(|stage| stage.name() == last);
        self.gpu.run(&stages[..end.map_or(stages.len(), |i| i + 1)])
    }

    pub fn fixture(&self, scene: Scene, size_px: [u32; 2]) -> Result<Fixture> {
        let view = view(&scene, size_px);
        Ok(Fixture {
            shared: Shared::new(self, &view),
            geometry: Geometry::new(self, &scene),
            tracer: Tracer::new(&scene.objects),
            rays: rays(&view),
            view,
            scene,
        })
    }

    /// Two walls beside each other that face the camera, at these distances and with these normals; and a depth between theirs.
    pub fn two_walls(
        &self,
        size_px: [u32; 2],
        walls_m: [f64; 2],
        normals: [DVec3; 2],
    ) -> Result<(Fixture, f64)> {
        let mut scene = flat_plane(LightKind::Directional)?;
        scene.camera = Camera::new([0.0; 3], [0.0, 0.0, -1.0], 40.0, [0.1, 20.0]);
        let wall = |wall: usize| {
            let middle = DVec3::new([-10.02, 0.0][wall], 0.0, -walls_m[wall]);
            let mut mesh = Mesh::parallelogram(middle, DVec3::X * 10.0, DVec3::Y * 10.0);
            mesh.normals.fill(normals[wall].as_vec3().to_array());
            Object::new("wall", mesh)
        };
        scene.objects = [0, 1].map(wall).into();
        let fixture = self.fixture(scene, size_px)?;
        let depth = depth_ahead(&fixture.view, 0.5 * (walls_m[0] + walls_m[1]));
        Ok((fixture, depth))
    }

    /// The scene's G-buffer, drawn.
    pub fn gbuffer(&self, fixture: &Fixture) -> Result<GBuffer> {
        let Fixture { view, shared, geometry, .. } = fixture;
        let gbuffer = gbuffer::new(self, shared, geometry, view.size_px.to_array())?;
        self.run(&[&gbuffer])?;
        Ok(gbuffer.output)
    }

    /// One channel of what a stage draws, as the last of some.
    pub fn draw(
        &self,
        stages: &[&dyn TimedStage],
        target: &wgpu::Texture,
        channel: usize,
    ) -> Result<Image> {
        self.run(stages)?;
        self.channel(target, channel)
    }

    /// One channel of a texture in f64.
    pub fn channel(&self, texture: &wgpu::Texture, channel: usize) -> Result<Image> {
        Ok(caustics_image::channel(&read_texture(self.gpu, texture)?, channel))
    }

    /// What a buffer holds.
    pub fn read<T: bytemuck::Pod>(&self, buffer: &wgpu::Buffer) -> Result<Vec<T>, GpuError> {
        Ok(bytemuck::pod_collect_to_vec(&read_buffer(self.gpu, buffer)?))
    }

    /// A buffer of these words.
    pub fn words(&self, words: &[u32]) -> kit::Buffer {
        let buffer = self.storage("verify words", 4 * words.len() as u64);
        self.gpu.queue.write_buffer(&buffer, 0, bytemuck::cast_slice(words));
        buffer
    }

    /// A photon buffer with this content.
    pub fn photons(&self, photons: &[Photon]) -> Photons {
        let buffer = Photons::new(self, "verify photons", photons.len() as u32);
        self.gpu.queue.write_buffer(&buffer.buffer, 0, bytemuck::cast_slice(photons));
        buffer
    }

    /// A texture with one 32-bit float per texel, from an image.
    pub fn grey(&self, image: &Image) -> wgpu::Texture {
        let texels = || image.data().iter().map(|v| *v as f32).collect();
        self.fixed_texture("verify input", image.size(), wgpu::TextureFormat::R32Float, texels)
    }

    /// A texture of a format that is of one colour throughout.
    pub fn constant_texture(
        &self,
        size: [u32; 2],
        format: wgpu::TextureFormat,
        color: wgpu::Color,
    ) -> Result<wgpu::Texture, GpuError> {
        let texture = self.target("verify constant", size, format);
        let color = ColorTarget {
            view: &kit::view(&texture),
            clear: Some(color),
            slice: None,
            drawing: Drawing::Opaque,
        };
        self.run(&[&ClearedTargets(Targets { color: &[color], depth: None })])?;
        Ok(texture)
    }

    /// A depth texture of one value throughout.
    pub fn depth(&self, size: [u32; 2], depth: f64) -> Result<wgpu::Texture, GpuError> {
        let texture = self.target("verify depth", size, kit::DEPTH_FORMAT);
        let (view, clear) = (&kit::view(&texture), Some(depth as f32));
        let depth = Some(DepthTarget { view, clear, read_only: false });
        self.run(&[&ClearedTargets(Targets { color: &[], depth })])?;
        Ok(texture)
    }
}

/// Draws nothing on targets, which are cleared.
struct ClearedTargets<'a>(Targets<'a>);

impl TimedStage for ClearedTargets<'_> {
    fn name(&self) -> &'static str {
        "verify/clear"
    }

    fn encode(&self, scope: &mut StageScope<'_>) {
        scope.render(&self.0, |_| ());
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

/// The port with waves across each other, seen from so far above the water or below it. A directional light shines into the camera, a point light
/// stands near.
pub fn shore(kind: LightKind, height_m: f64) -> Result<Scene> {
    let mut scene = Scene::load("port")?;
    // Without what is as small as a pixel, and with an open horizon.
    let is_kept = |name: &str| {
        ["stone", "bollard", "rope", "back quay"].iter().all(|part| !name.contains(part))
    };
    scene.objects.retain(|object| is_kept(&object.name));
    scene.light.kind = kind;
    scene.light.direction = [-0.1, -0.3, 0.95];
    scene.light.position_m = [3.0, 2.5, -1.0];
    // So near the surface that what is seen is on both sides of it.
    scene.camera = Camera::new([2.0, height_m, 3.5], [1.0, 0.0, -3.0], 70.0, [0.3, 26.0]);
    let wave = |direction, wavelength_m, phase_rad| Wave {
        direction,
        wavelength_m,
        amplitude_m: 0.05,
        phase_rad,
    };
    scene.water.model = WaterModel::Waves;
    scene.water.waves = vec![wave([1.0, 0.3], 1.1, 0.4), wave([0.2, 1.0], 1.9, 2.0)];
    scene.water.half_size_m = [6.0, 5.0];
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
        edge_m: 0.1 * scene.solid_bounds().tank_scale(),
        photon_reach: DVec2::ZERO,
        photons_fitted: true,
    }
}

/// Rays through the pixels of a view.
pub fn rays(view: &View) -> PixelRays {
    PixelRays::new(&view.camera, view.size_px.x, view.size_px.y)
}

/// The middle of a pixel, in pixels.
pub fn middle((x, y): (u32, u32)) -> DVec2 {
    DVec2::new(x.into(), y.into()) + 0.5
}

/// Device depth in the middle of a view, at a distance ahead.
pub fn depth_ahead(view: &View, distance_m: f64) -> f64 {
    let place = view.camera.position() + view.camera.direction() * distance_m;
    rays(view).project(place).map_or(1.0, |place| place.depth)
}

/// Area of a plane, by a point of it and its normal, that a pixel shows.
pub fn area_shown(rays: &PixelRays, (x, y): (u32, u32), (middle, normal): (DVec3, DVec3)) -> f64 {
    let on_plane = |x: u32, y: u32| {
        let (origin, direction, _) = rays.ray_at(x.into(), y.into());
        origin + direction * ((middle - origin).dot(normal) / direction.dot(normal))
    };
    let diagonal = on_plane(x + 1, y + 1) - on_plane(x, y);
    0.5 * diagonal.cross(on_plane(x, y + 1) - on_plane(x + 1, y)).length()
}

/// The view of synthetic photons: scene `plane` from a round place in the middle of things.
pub fn synthetic_view(size_px: [u32; 2], gamma_per_m: f64) -> Result<View> {
    let mut scene = flat_plane(LightKind::Directional)?;
    scene.camera = Camera::new([0.0, -1.0, 0.0], [0.0, -1.0, -4.0], 60.0, [0.1, 20.0]);
    scene.water.attenuation_per_m = gamma_per_m;
    Ok(view(&scene, size_px))
}

/// A photon as the GPU has it; f64 twins are taken from its rounded numbers.
pub fn photon(entry: DVec3, hit: DVec3, distance_m: f64) -> Photon {
    Photon {
        entry_m: entry.as_vec3(),
        fate: 0,
        hit_m: hit.as_vec3(),
        distance_m: distance_m as f32,
    }
}

pub use crate::statistics::largest;

/// Repeatable noise in 0…1, as f32 holds it.
pub fn noise(size: [u32; 2], seed: u32) -> Image {
    let mut random = Random::new(seed);
    Image::from_fn(size, |_, _| f64::from(random.number() as f32))
}
