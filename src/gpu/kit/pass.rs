//! Compute and render pipelines with what they bind, and the passes that stages consist of.

use super::{Bindings, Resources, depth_state, layer_view, view};
use crate::pipelines::{CodeKey, GroupKey, KernelKey, RasterKey};
use crate::shader::compilation_options;
use crate::{
    ColorTarget, Demand, DepthTarget, GpuError, Shader, Stage, StageInfo, StageScope, Targets,
};
use fathom_record::Work;
use fathom_record::ceilings::Drawing;

/// A shader by its path and the values that it is compiled with.
#[derive(Clone, Copy)]
pub struct Code<'a> {
    pub path: &'a str,
    pub defs: &'a [(&'a str, i32)],
    /// Of a compute pipeline.
    pub entry: &'a str,
}

impl Code<'_> {
    fn key(&self) -> CodeKey {
        CodeKey::new(self.path, self.defs)
    }
}

impl<'a> From<&'a str> for Code<'a> {
    fn from(path: &'a str) -> Self {
        Self { path, defs: &[], entry: "main" }
    }
}

impl<'a, const N: usize> From<(&'a str, &'a [(&'a str, i32); N])> for Code<'a> {
    fn from((path, defs): (&'a str, &'a [(&'a str, i32); N])) -> Self {
        Self { path, defs, entry: "main" }
    }
}

impl<'a> From<(&'a str, &'a [(&'a str, i32)])> for Code<'a> {
    fn from((path, defs): (&'a str, &'a [(&'a str, i32)])) -> Self {
        Self { path, defs, entry: "main" }
    }
}

/// A linked shader with the groups that it binds.
struct Linked {
    shader: Shader,
    groups: Vec<wgpu::BindGroup>,
    layouts: Vec<wgpu::BindGroupLayout>,
    keys: Vec<GroupKey>,
}

impl Linked {
    fn new(
        resources: &Resources<'_>,
        code: Code<'_>,
        stages: wgpu::ShaderStages,
        groups: &[&Bindings],
    ) -> Result<Self, GpuError> {
        let shader = resources.gpu.shader(code.path, code.defs)?;
        if shader.bindings.iter().any(|of| of.is_written_by_fragments(stages)) {
            let refused = Demand::new().fragment_writes(code.path).check(&resources.gpu.capacity);
            refused.map_err(GpuError::Limit)?;
        }
        let (mut bound, mut layouts, mut keys) = (Vec::new(), Vec::new(), Vec::new());
        for (number, group) in (0..).zip(groups) {
            let group = group.bound(&resources.gpu.device, &shader, stages, number)?;
            bound.push(group.group);
            layouts.push(group.layout);
            keys.push(group.key);
        }
        Ok(Self { shader, groups: bound, layouts, keys })
    }

    fn layout(&self, resources: &Resources<'_>) -> wgpu::PipelineLayout {
        let layouts: Vec<_> = self.layouts.iter().map(Some).collect();
        resources.gpu.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some(&self.shader.path),
            bind_group_layouts: &layouts,
            immediate_size: 0,
        })
    }
}

const PLANNED: &str = "a planned pipeline is never run";

/// A compute pipeline, its groups and a number of workgroups.
pub struct Dispatch {
    /// None on a planner.
    pipeline: Option<(wgpu::ComputePipeline, Vec<wgpu::BindGroup>)>,
    workgroups: [u32; 3],
}

impl Dispatch {
    pub fn new<'a>(
        resources: &Resources<'_>,
        code: impl Into<Code<'a>>,
        groups: &[&Bindings],
        workgroups: [u32; 3],
    ) -> Result<Self, GpuError> {
        let (gpu, code) = (resources.gpu, code.into());
        resources.dispatch(code.path, workgroups);
        resources.binds(code.path, groups);
        if gpu.is_planner() {
            gpu.plan_shader(code.key());
            return Ok(Self { pipeline: None, workgroups });
        }
        let linked = Linked::new(resources, code, wgpu::ShaderStages::COMPUTE, groups)?;
        let entry = code.entry.to_owned();
        let key = KernelKey { code: code.key(), entry, groups: linked.keys.clone() };
        let make = || {
            let descriptor = wgpu::ComputePipelineDescriptor {
                label: Some(code.path),
                layout: Some(&linked.layout(resources)),
                module: &linked.shader.module,
                entry_point: Some(code.entry),
                compilation_options: compilation_options(),
                cache: None,
            };
            gpu.device.create_compute_pipeline(&descriptor)
        };
        Ok(Self { pipeline: Some((gpu.kernel(key, make), linked.groups)), workgroups })
    }

    pub fn run(&self, pass: &mut wgpu::ComputePass<'_>) {
        let (pipeline, groups) = self.pipeline.as_ref().expect(PLANNED);
        pass.set_pipeline(pipeline);
        for (number, group) in (0..).zip(groups) {
            pass.set_bind_group(number, group, &[]);
        }
        let [x, y, z] = self.workgroups;
        pass.dispatch_workgroups(x, y, z);
    }

    /// A stage of one pass with these dispatches.
    pub fn stage(dispatches: impl Into<Vec<Self>>, info: &'static StageInfo, work: Work) -> Stage {
        let dispatches = dispatches.into();
        Stage::new(info, work, move |scope| Self::pass(&dispatches, scope))
    }

    /// A pass with these dispatches.
    pub fn pass(dispatches: &[Self], scope: &mut StageScope<'_>) {
        scope.compute(|pass| dispatches.iter().for_each(|dispatch| dispatch.run(pass)));
    }
}

/// Invocations of a workgroup of a linear dispatch, as in `shaders/shared/dispatch.wgsl`.
const LINEAR_GROUP: u64 = 64;
/// Workgroups along x before a linear dispatch takes a second row: within every adapter's limit of 65,535.
const LINEAR_GROUPS_X: u64 = 32_768;

/// Workgroups for so many invocations, spread over two dimensions.
pub fn linear_workgroups(invocations: u64) -> [u32; 3] {
    let groups = invocations.div_ceil(LINEAR_GROUP);
    let rows = groups.div_ceil(LINEAR_GROUPS_X).max(1);
    [groups.min(LINEAR_GROUPS_X) as u32, u32::try_from(rows).unwrap_or(u32::MAX), 1]
}

/// Workgroups of `side`² invocations for so many pixels.
pub fn square_workgroups(size_px: [u32; 2], side: u32) -> [u32; 3] {
    let [x, y] = size_px.map(|pixels| pixels.div_ceil(side));
    [x, y, 1]
}

/// What distinguishes one render pipeline from another, and what it binds.
#[derive(Clone)]
pub struct RenderSpec<'a> {
    /// The stage's name.
    pub label: &'a str,
    pub code: Code<'a>,
    pub vertex: &'a str,
    pub fragment: Option<&'a str>,
    pub groups: &'a [&'a Bindings],
    pub buffers: &'a [wgpu::VertexBufferLayout<'a>],
    pub targets: &'a [wgpu::ColorTargetState],
    pub depth: Option<Depth<'a>>,
    pub topology: wgpu::PrimitiveTopology,
    pub cull_mode: Option<wgpu::Face>,
}

/// How depth is tested, and against which.
#[derive(Clone, Copy)]
pub struct Depth<'a> {
    pub texture: &'a wgpu::Texture,
    pub layer: u32,
    pub compare: wgpu::CompareFunction,
    pub write: bool,
    /// What the pass begins with; else what is there.
    pub clear: Option<f32>,
}

impl<'a> Depth<'a> {
    /// The nearest is kept, from the far plane on.
    pub fn nearest(texture: &'a wgpu::Texture) -> Self {
        let compare = wgpu::CompareFunction::Less;
        Self { texture, layer: 0, compare, write: true, clear: Some(1.0) }
    }

    /// What the texture holds hides what lies behind it.
    pub fn behind(texture: &'a wgpu::Texture) -> Self {
        Self { write: false, clear: None, ..Self::nearest(texture) }
    }
}

impl<'a> RenderSpec<'a> {
    /// Triangles, none culled, entry points `vertex` and `fragment`, no vertex buffers, no depth.
    pub fn new(
        code: impl Into<Code<'a>>,
        groups: &'a [&'a Bindings],
        targets: &'a [wgpu::ColorTargetState],
    ) -> Self {
        let code = code.into();
        Self {
            label: code.path,
            code,
            vertex: "vertex",
            fragment: Some("fragment"),
            groups,
            buffers: &[],
            targets,
            depth: None,
            topology: wgpu::PrimitiveTopology::TriangleList,
            cull_mode: None,
        }
    }

    fn primitive(&self) -> wgpu::PrimitiveState {
        let Self { topology, cull_mode, .. } = *self;
        wgpu::PrimitiveState { topology, cull_mode, ..Default::default() }
    }

    fn key(&self, groups: &[GroupKey]) -> RasterKey {
        let buffers = self.buffers.iter();
        RasterKey {
            code: self.code.key(),
            groups: groups.to_vec(),
            vertex: self.vertex.to_owned(),
            fragment: self.fragment.map(str::to_owned),
            buffers: buffers
                .map(|b| (b.array_stride, b.step_mode, b.attributes.to_vec()))
                .collect(),
            targets: self.targets.to_vec(),
            depth: self.depth.map(|depth| depth_state(depth.compare, depth.write)),
            primitive: self.primitive(),
        }
    }
}

/// A render pipeline and its groups.
pub struct Raster(Option<(wgpu::RenderPipeline, Vec<wgpu::BindGroup>)>);

impl Raster {
    pub fn new(resources: &Resources<'_>, spec: &RenderSpec<'_>) -> Result<Self, GpuError> {
        let formats: Vec<_> = spec.targets.iter().map(|target| target.format).collect();
        resources.color_targets(spec.label, &formats);
        resources.binds(spec.code.path, spec.groups);
        if resources.gpu.is_planner() {
            resources.gpu.plan_shader(spec.code.key());
            return Ok(Self(None));
        }
        let stages = wgpu::ShaderStages::VERTEX_FRAGMENT;
        let linked = Linked::new(resources, spec.code, stages, spec.groups)?;
        let make = || Self::make(resources, spec, &linked);
        Ok(Self(Some((resources.gpu.raster(spec.key(&linked.keys), make), linked.groups))))
    }

    fn make(
        resources: &Resources<'_>,
        spec: &RenderSpec<'_>,
        linked: &Linked,
    ) -> wgpu::RenderPipeline {
        let module = &linked.shader.module;
        let targets: Vec<_> = spec.targets.iter().cloned().map(Some).collect();
        let buffers: Vec<_> = spec.buffers.iter().cloned().map(Some).collect();
        resources.gpu.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some(spec.label),
            layout: Some(&linked.layout(resources)),
            vertex: wgpu::VertexState {
                module,
                entry_point: Some(spec.vertex),
                compilation_options: compilation_options(),
                buffers: &buffers,
            },
            primitive: spec.primitive(),
            depth_stencil: spec.depth.map(|depth| depth_state(depth.compare, depth.write)),
            multisample: wgpu::MultisampleState::default(),
            fragment: spec.fragment.map(|entry| wgpu::FragmentState {
                module,
                entry_point: Some(entry),
                compilation_options: compilation_options(),
                targets: &targets,
            }),
            multiview_mask: None,
            cache: None,
        })
    }

    /// Follows a pipeline of the same code and groups, which stay bound. llvmpipe draws all that it has got so far when a texture that is
    /// also its depth target is bound again.
    pub fn follow(&self, pass: &mut wgpu::RenderPass<'_>) {
        let (pipeline, _) = self.0.as_ref().expect(PLANNED);
        pass.set_pipeline(pipeline);
    }

    pub fn bind(&self, pass: &mut wgpu::RenderPass<'_>) {
        let (pipeline, groups) = self.0.as_ref().expect(PLANNED);
        pass.set_pipeline(pipeline);
        for (number, group) in (0..).zip(groups) {
            pass.set_bind_group(number, group, &[]);
        }
    }
}

/// Pixels of a texture's first level.
pub fn pixels(texture: &wgpu::Texture) -> u64 {
    u64::from(texture.width()) * u64::from(texture.height())
}

/// Width and height of a texture's first level.
pub fn size_px(texture: &wgpu::Texture) -> [u32; 2] {
    [texture.width(), texture.height()]
}

/// The targets that passes draw into.
pub struct Canvas {
    pub textures: Vec<wgpu::Texture>,
    colors: Vec<(wgpu::TextureView, Option<wgpu::Color>, Drawing)>,
    depth: Option<(wgpu::TextureView, DepthUse)>,
}

fn drawing(target: &wgpu::ColorTargetState) -> Drawing {
    match target.blend {
        _ if target.write_mask.is_empty() => Drawing::Unwritten,
        None => Drawing::Opaque,
        Some(_) => Drawing::Blended,
    }
}

/// What a pass begins with, and whether it writes depth.
type DepthUse = (Option<f32>, bool);

impl Canvas {
    /// A target of `size_px` for each of a pipeline's, cleared to `clear` first.
    pub fn new(
        resources: &Resources<'_>,
        spec: &RenderSpec<'_>,
        size_px: [u32; 2],
        clear: impl Into<Option<wgpu::Color>>,
    ) -> Self {
        let clear = clear.into();
        let target = |state: &wgpu::ColorTargetState| {
            let texture = resources.target(spec.label, size_px, state.format);
            (view(&texture), clear, texture)
        };
        Self::over(spec, spec.targets.iter().map(target).collect())
    }

    /// Over textures that are there: the view that is drawn into, and what the pass clears it to, if it does.
    pub fn over(
        spec: &RenderSpec<'_>,
        targets: Vec<(wgpu::TextureView, Option<wgpu::Color>, wgpu::Texture)>,
    ) -> Self {
        let drawn = targets
            .into_iter()
            .zip(spec.targets)
            .map(|((view, clear, texture), state)| ((view, clear, drawing(state)), texture));
        let (colors, textures) = drawn.unzip();
        let view = |depth: Depth<'_>| layer_view(depth.texture, depth.layer);
        let depth = spec.depth.map(|depth| (view(depth), (depth.clear, depth.write)));
        Self { textures, colors, depth }
    }

    pub fn render(&self, scope: &mut StageScope<'_>, draw: impl FnOnce(&mut wgpu::RenderPass<'_>)) {
        scope.render(&self.targets(&self.colors(true)), draw);
    }

    /// So many passes, at least one, each onto what the one before it has left. `draw` is given the pass's place.
    pub fn series(
        &self,
        scope: &mut StageScope<'_>,
        passes: usize,
        draw: impl FnMut(usize, &mut wgpu::RenderPass<'_>),
    ) {
        let (cleared, kept) = (self.colors(true), self.colors(false));
        let targets = |number| self.targets(if number == 0 { &cleared } else { &kept });
        let targets: Vec<_> = (0..passes).map(targets).collect();
        scope.render_series(&targets, draw);
    }

    fn colors(&self, first: bool) -> Vec<ColorTarget<'_>> {
        let colors = self.colors.iter().map(|(view, clear, drawing)| ColorTarget {
            view,
            clear: clear.filter(|_| first),
            slice: None,
            drawing: *drawing,
        });
        colors.collect()
    }

    fn targets<'a>(&'a self, color: &'a [ColorTarget<'a>]) -> Targets<'a> {
        let depth = self.depth.as_ref();
        let depth = depth.map(|(view, (clear, write))| DepthTarget {
            view,
            clear: *clear,
            read_only: clear.is_none() && !write,
        });
        Targets { color, depth }
    }
}

pub struct DrawPass {
    raster: Raster,
    canvas: Canvas,
}

impl DrawPass {
    /// Into new targets: see [`Canvas::new`].
    pub fn new(
        resources: &Resources<'_>,
        spec: &RenderSpec<'_>,
        size_px: [u32; 2],
        clear: impl Into<Option<wgpu::Color>>,
    ) -> Result<Self, GpuError> {
        let canvas = Canvas::new(resources, spec, size_px, clear);
        Ok(Self { raster: Raster::new(resources, spec)?, canvas })
    }

    /// Into textures that are there: see [`Canvas::over`].
    pub fn over(
        resources: &Resources<'_>,
        spec: &RenderSpec<'_>,
        targets: Vec<(wgpu::TextureView, Option<wgpu::Color>, wgpu::Texture)>,
    ) -> Result<Self, GpuError> {
        Ok(Self { raster: Raster::new(resources, spec)?, canvas: Canvas::over(spec, targets) })
    }

    /// Onto what a texture holds.
    pub fn onto(
        resources: &Resources<'_>,
        spec: &RenderSpec<'_>,
        texture: &wgpu::Texture,
    ) -> Result<Self, GpuError> {
        Self::over(resources, spec, vec![(view(texture), None, texture.clone())])
    }

    /// The first target.
    pub fn texture(&self) -> &wgpu::Texture {
        &self.canvas.textures[0]
    }

    pub fn textures(&self) -> &[wgpu::Texture] {
        &self.canvas.textures
    }

    pub fn pixels(&self) -> u64 {
        pixels(self.texture())
    }

    /// Work of computing every pixel from so many texels, and of writing so many bytes for it.
    pub fn work(&self, texels: u64, bytes: u64) -> Work {
        let fragments = self.pixels();
        Work {
            fragments,
            texel_fetches: fragments * texels,
            bytes_written: fragments * bytes,
            ..Work::default()
        }
    }

    pub fn render(&self, scope: &mut StageScope<'_>, draw: impl FnOnce(&mut wgpu::RenderPass<'_>)) {
        self.canvas.render(scope, |pass| {
            self.raster.bind(pass);
            draw(pass);
        });
    }

    /// A stage that computes every pixel of the targets: one triangle covers them. It leaves the first target.
    pub fn stage(self, info: &'static StageInfo, work: Work) -> Stage<wgpu::Texture> {
        self.drawing(info, work, draw_fullscreen)
    }

    /// The same with other draws in place of the triangle.
    pub fn drawing(
        self,
        info: &'static StageInfo,
        work: Work,
        draw: impl Fn(&mut wgpu::RenderPass<'_>) + 'static,
    ) -> Stage<wgpu::Texture> {
        let texture = self.texture().clone();
        Stage::new(info, work, move |scope| self.render(scope, &draw)).with_output(texture)
    }
}

/// Covers the targets with one triangle.
pub fn draw_fullscreen(pass: &mut wgpu::RenderPass<'_>) {
    pass.draw(0..3, 0..1);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn linear_dispatches_reach_all_within_the_limits() {
        for invocations in [0, 1, 64, 65, 1 << 21, (1 << 21) + 1, 1 << 28] {
            let [x, y, _] = linear_workgroups(invocations).map(u64::from);
            assert!(x * y * LINEAR_GROUP >= invocations && x <= 65_535 && y <= 65_535);
        }
    }
}
