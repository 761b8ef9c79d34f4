//! `hsao/march`: horizon-split ambient occlusion over the depth buffer. Dimitrov, Bavoil and Sainz, I3D 2008, with the
//! changes of VAO §6.

use encase::ShaderType;
use glam::Vec2;

use crate::gpu::{ColorTarget, Gpu, GpuError, StageScope, Targets, read_buffer};
use crate::record::Work;
use crate::stages::bilateral::{VISIBILITY_FORMAT, visibility_output};
use crate::stages::frame::Shared;
use crate::stages::kit::{self, Bind, Group, RenderSpec, Resources};
use crate::stages::{Output, Stage, StageInfo};

pub const INFO: StageInfo = StageInfo {
    name: "hsao/march",
    about: "horizon-split ambient occlusion: horizons in the depth buffer, rays marched above them",
    source: "VAO §6; Dimitrov, Bavoil and Sainz, I3D 2008",
};

/// Partial sums of each counter, so that fragments do not queue for one.
const SLOTS: usize = 64;

/// Host twin of `March` in `shaders/hsao/march.wgsl`.
#[derive(Clone, Debug, PartialEq, ShaderType)]
pub struct MarchUniforms {
    pub size_px: Vec2,
    pub r_max_m: f32,
    pub layer_m: f32,
    pub directions: u32,
    pub steps: u32,
    pub rays: u32,
    pub ray_steps: u32,
}

impl MarchUniforms {
    /// Samples of depth that a pixel takes at most. Rays end early at hits and at the picture's border.
    pub fn samples_per_pixel(&self) -> u64 {
        u64::from(self.directions) * u64::from(self.steps)
            + u64::from(self.rays) * u64::from(self.ray_steps)
    }
}

/// What the camera sees.
#[derive(Clone)]
pub struct Inputs {
    pub depth: wgpu::Texture,
    pub normal: wgpu::Texture,
}

pub struct March {
    pipeline: wgpu::RenderPipeline,
    shared: wgpu::BindGroup,
    group: Group,
    samples_per_pixel: u64,
    target: wgpu::Texture,
    view: wgpu::TextureView,
}

impl March {
    /// The occlusion buffer has `settings.size_px` pixels; it may be smaller than the viewport. `hard`: occluders weigh the
    /// same at any distance up to r_max.
    pub fn new(
        resources: &Resources<'_>,
        shared: &Shared,
        inputs: &Inputs,
        settings: &MarchUniforms,
        hard: bool,
    ) -> Result<Self, GpuError> {
        Self::build(resources, shared, inputs, settings, hard, None)
    }

    fn build(
        resources: &Resources<'_>,
        shared: &Shared,
        inputs: &Inputs,
        settings: &MarchUniforms,
        hard: bool,
        counters: Option<&wgpu::Buffer>,
    ) -> Result<Self, GpuError> {
        let gpu = resources.gpu;
        let defs = [("HARD", i32::from(hard)), ("COUNT", i32::from(counters.is_some()))];
        let shader = gpu.shader(INFO.name, &defs)?;
        let settings_buffer = resources.loop_settings(INFO.name, settings);
        let mut binds = vec![
            Bind::Read(&settings_buffer),
            Bind::Depth(&inputs.depth),
            Bind::Texels(&inputs.normal),
        ];
        binds.extend(counters.map(Bind::Write));
        let group = Group::new(gpu, INFO.name, &binds);
        let pipeline = kit::render_pipeline(
            gpu,
            &RenderSpec {
                label: INFO.name,
                shader: &shader,
                vertex: "vertex",
                fragment: Some("fragment"),
                groups: &[&shared.group, &group],
                buffers: &[],
                targets: &[kit::opaque(VISIBILITY_FORMAT)],
                depth: None,
            },
        );
        let size_px = settings.size_px.as_uvec2().to_array();
        let target = resources.target(INFO.name, size_px, VISIBILITY_FORMAT);
        Ok(Self {
            pipeline,
            shared: shared.group.group.clone(),
            group,
            samples_per_pixel: settings.samples_per_pixel(),
            view: kit::view(&target),
            target,
        })
    }

    /// Visibility 1 − A, 1 where nothing was drawn.
    pub fn texture(&self) -> &wgpu::Texture {
        &self.target
    }
}

/// What a frame's marching takes, counted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Counts {
    /// Samples of depth.
    pub samples: u64,
    /// Fragments where something was drawn.
    pub fragments: u64,
}

/// Marches once more, with a shader that counts. The arguments are those of [`March::new`].
pub fn count(
    gpu: &Gpu,
    shared: &Shared,
    inputs: &Inputs,
    settings: &MarchUniforms,
    hard: bool,
) -> Result<Counts, GpuError> {
    let resources = Resources::new(gpu);
    let counters = resources.storage("hsao/march counters", (2 * SLOTS * 4) as u64);
    let march = March::build(&resources, shared, inputs, settings, hard, Some(&counters))?;
    gpu.run(&[&march])?;
    let words: Vec<u32> = bytemuck::pod_collect_to_vec(&read_buffer(gpu, &counters)?);
    let (samples, fragments) = words.split_at(SLOTS);
    let sum = |slots: &[u32]| slots.iter().map(|n| u64::from(*n)).sum();
    Ok(Counts { samples: sum(samples), fragments: sum(fragments) })
}

impl Stage for March {
    fn name(&self) -> &'static str {
        INFO.name
    }

    fn encode(&self, scope: &mut StageScope<'_>) {
        let targets = Targets {
            color: &[ColorTarget {
                view: &self.view,
                clear: Some(wgpu::Color::WHITE),
                slice: None,
            }],
            depth: None,
        };
        scope.render(&targets, |pass| {
            pass.set_pipeline(&self.pipeline);
            pass.set_bind_group(0, &self.shared, &[]);
            pass.set_bind_group(1, &self.group.group, &[]);
            pass.draw(0..3, 0..1);
        });
    }

    /// Samples at most: the depth and normal of each pixel, and those of its directions and rays.
    fn work(&self) -> Work {
        let pixels = u64::from(self.target.width()) * u64::from(self.target.height());
        Work {
            fragments: pixels,
            texel_fetches: pixels * (2 + self.samples_per_pixel),
            bytes_written: pixels * 2,
            ..Work::default()
        }
    }

    fn outputs(&self) -> Vec<Output> {
        vec![visibility_output("visibility", &self.target)]
    }
}
