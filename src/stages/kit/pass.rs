//! Compute and render pipelines, and the two passes that most stages consist of.

use super::layout::check;
use super::{Group, Resources, view};
use crate::geometry::{Geometry, Part};
use fathom_gpu::{
    CodeKey, ColorTarget, DepthTarget, GpuError, GroupKey, KernelKey, RasterKey, Shader,
    StageScope, StructLayout, Targets, compilation_options,
};

/// A shader by its path and the values that it is compiled with.
#[derive(Clone, Copy)]
pub struct Code<'a> {
    pub path: &'a str,
    pub defs: &'a [(&'a str, i32)],
}

impl Code<'_> {
    fn key(&self) -> CodeKey {
        let defs = self.defs.iter().map(|(name, value)| ((*name).to_owned(), *value));
        CodeKey { path: self.path.to_owned(), defs: defs.collect() }
    }
}

impl<'a> From<&'a str> for Code<'a> {
    fn from(path: &'a str) -> Self {
        Self { path, defs: &[] }
    }
}

impl<'a> From<(&'a str, &'a [(&'a str, i32)])> for Code<'a> {
    fn from((path, defs): (&'a str, &'a [(&'a str, i32)])) -> Self {
        Self { path, defs }
    }
}

/// The linked shader, its structs compared with those of the groups.
fn shader(
    resources: &Resources<'_>,
    code: Code<'_>,
    groups: &[&Group],
) -> Result<Shader, GpuError> {
    let shader = resources.gpu.shader(code.path, code.defs)?;
    let hosts: Vec<(u32, u32, &StructLayout)> = (0..)
        .zip(groups)
        .flat_map(|(number, group)| group.structs.iter().map(move |(i, s)| (number, *i, &**s)))
        .collect();
    check(&shader, &hosts)?;
    Ok(shader)
}

fn group_keys(groups: &[&Group]) -> Vec<GroupKey> {
    groups.iter().map(|group| group.key.clone()).collect()
}

fn pipeline_layout(
    resources: &Resources<'_>,
    label: &str,
    groups: &[&Group],
) -> wgpu::PipelineLayout {
    let layouts: Vec<_> = groups.iter().map(|g| Some(&g.layout)).collect();
    resources.gpu.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: Some(label),
        bind_group_layouts: &layouts,
        immediate_size: 0,
    })
}

const PLANNED: &str = "a planned pipeline is never run";

/// A compute pipeline with entry point `main`.
pub struct Kernel {
    pipeline: Option<wgpu::ComputePipeline>,
}

impl Kernel {
    /// It also runs with other groups of the same layouts.
    pub fn new<'a>(
        resources: &Resources<'_>,
        label: &str,
        code: impl Into<Code<'a>>,
        groups: &[&Group],
    ) -> Result<Self, GpuError> {
        let gpu = resources.gpu;
        if gpu.is_planner() {
            return Ok(Self { pipeline: None });
        }
        let code = code.into();
        let make = |shader: Shader| {
            let descriptor = wgpu::ComputePipelineDescriptor {
                label: Some(label),
                layout: Some(&pipeline_layout(resources, label, groups)),
                module: &shader.module,
                entry_point: Some("main"),
                compilation_options: compilation_options(),
                cache: None,
            };
            gpu.device.create_compute_pipeline(&descriptor)
        };
        let shader = shader(resources, code, groups)?;
        let key = KernelKey { code: code.key(), groups: group_keys(groups) };
        Ok(Self { pipeline: Some(gpu.kernel(key, || make(shader))) })
    }

    pub fn bind(&self, pass: &mut wgpu::ComputePass<'_>) {
        pass.set_pipeline(self.pipeline.as_ref().expect(PLANNED));
    }

    /// Binds the kernel and dispatches it.
    pub fn run(&self, pass: &mut wgpu::ComputePass<'_>, dispatch: &Dispatch) {
        self.bind(pass);
        dispatch.run(pass);
    }
}

/// Bind groups and a number of workgroups.
pub struct Dispatch {
    groups: Vec<wgpu::BindGroup>,
    workgroups: [u32; 3],
}

impl Dispatch {
    pub fn new(
        resources: &Resources<'_>,
        label: &str,
        groups: &[&Group],
        workgroups: [u32; 3],
    ) -> Self {
        resources.dispatch(label, workgroups);
        Self { groups: groups.iter().map(|g| g.group.clone()).collect(), workgroups }
    }

    pub fn run(&self, pass: &mut wgpu::ComputePass<'_>) {
        for (number, group) in (0..).zip(&self.groups) {
            pass.set_bind_group(number, group, &[]);
        }
        let [x, y, z] = self.workgroups;
        pass.dispatch_workgroups(x, y, z);
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

/// What distinguishes one render pipeline from another. No culling.
#[derive(Clone)]
pub struct RenderSpec<'a> {
    pub label: &'a str,
    pub code: Code<'a>,
    pub vertex: &'a str,
    pub fragment: Option<&'a str>,
    pub groups: &'a [&'a Group],
    pub buffers: &'a [wgpu::VertexBufferLayout<'a>],
    pub targets: &'a [wgpu::ColorTargetState],
    pub depth: Option<wgpu::DepthStencilState>,
    pub topology: wgpu::PrimitiveTopology,
}

impl<'a> RenderSpec<'a> {
    /// Triangles, entry points `vertex` and `fragment`, no vertex buffers, no depth.
    pub fn new(
        label: &'a str,
        code: impl Into<Code<'a>>,
        groups: &'a [&'a Group],
        targets: &'a [wgpu::ColorTargetState],
    ) -> Self {
        Self {
            label,
            code: code.into(),
            vertex: "vertex",
            fragment: Some("fragment"),
            groups,
            buffers: &[],
            targets,
            depth: None,
            topology: wgpu::PrimitiveTopology::TriangleList,
        }
    }
}

impl RenderSpec<'_> {
    fn key(&self) -> RasterKey {
        let buffers = self.buffers.iter();
        RasterKey {
            code: self.code.key(),
            groups: group_keys(self.groups),
            vertex: self.vertex.to_owned(),
            fragment: self.fragment.map(str::to_owned),
            buffers: buffers
                .map(|b| (b.array_stride, b.step_mode, b.attributes.to_vec()))
                .collect(),
            targets: self.targets.to_vec(),
            depth: self.depth.clone(),
            topology: self.topology,
        }
    }
}

/// A render pipeline.
pub struct Raster {
    pipeline: Option<wgpu::RenderPipeline>,
}

impl Raster {
    pub fn new(resources: &Resources<'_>, spec: &RenderSpec<'_>) -> Result<Self, GpuError> {
        let formats: Vec<_> = spec.targets.iter().map(|target| target.format).collect();
        resources.color_targets(spec.label, &formats);
        if resources.gpu.is_planner() {
            return Ok(Self { pipeline: None });
        }
        let shader = shader(resources, spec.code, spec.groups)?;
        let make = || Self::make(resources, spec, &shader.module);
        Ok(Self { pipeline: Some(resources.gpu.raster(spec.key(), make)) })
    }

    fn make(
        resources: &Resources<'_>,
        spec: &RenderSpec<'_>,
        module: &wgpu::ShaderModule,
    ) -> wgpu::RenderPipeline {
        let targets: Vec<_> = spec.targets.iter().cloned().map(Some).collect();
        let buffers: Vec<_> = spec.buffers.iter().cloned().map(Some).collect();
        resources.gpu.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some(spec.label),
            layout: Some(&pipeline_layout(resources, spec.label, spec.groups)),
            vertex: wgpu::VertexState {
                module,
                entry_point: Some(spec.vertex),
                compilation_options: compilation_options(),
                buffers: &buffers,
            },
            primitive: wgpu::PrimitiveState { topology: spec.topology, ..Default::default() },
            depth_stencil: spec.depth.clone(),
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

    pub fn bind(&self, pass: &mut wgpu::RenderPass<'_>) {
        pass.set_pipeline(self.pipeline.as_ref().expect(PLANNED));
    }
}

/// Binds groups in their order.
pub fn bind_groups(pass: &mut wgpu::RenderPass<'_>, groups: &[wgpu::BindGroup]) {
    for (number, group) in (0..).zip(groups) {
        pass.set_bind_group(number, group, &[]);
    }
}

/// The bind groups alone.
pub fn bare(groups: &[&Group]) -> Vec<wgpu::BindGroup> {
    groups.iter().map(|g| g.group.clone()).collect()
}

/// Pixels of a texture's first level.
pub fn pixels(texture: &wgpu::Texture) -> u64 {
    u64::from(texture.width()) * u64::from(texture.height())
}

/// A pass that computes every pixel of its targets: one triangle covers them.
pub struct ScreenPass {
    raster: Raster,
    groups: Vec<wgpu::BindGroup>,
    pub targets: Vec<wgpu::Texture>,
    views: Vec<wgpu::TextureView>,
    clear: wgpu::Color,
}

impl ScreenPass {
    /// A target of `size_px` for each state; all are cleared to `clear` first.
    pub fn new(
        resources: &Resources<'_>,
        spec: &RenderSpec<'_>,
        size_px: [u32; 2],
        clear: wgpu::Color,
    ) -> Result<Self, GpuError> {
        let target =
            |state: &wgpu::ColorTargetState| resources.target(spec.label, size_px, state.format);
        let targets: Vec<_> = spec.targets.iter().map(target).collect();
        Ok(Self {
            raster: Raster::new(resources, spec)?,
            groups: bare(spec.groups),
            views: targets.iter().map(view).collect(),
            targets,
            clear,
        })
    }

    /// The first target.
    pub fn texture(&self) -> &wgpu::Texture {
        &self.targets[0]
    }

    pub fn pixels(&self) -> u64 {
        pixels(self.texture())
    }

    pub fn encode(&self, scope: &mut StageScope<'_>) {
        self.encode_with(scope, |pass| pass.draw(0..3, 0..1));
    }

    /// With other draws in place of the triangle.
    pub fn encode_with(
        &self,
        scope: &mut StageScope<'_>,
        draw: impl FnOnce(&mut wgpu::RenderPass<'_>),
    ) {
        let color = self.colors(Some(self.clear));
        scope.render(&Targets { color: &color, depth: None }, |pass| self.draw(pass, draw));
    }

    /// So many passes, at least one, each onto what the one before it has left. `draw` is given the pass's place.
    pub fn encode_series(
        &self,
        scope: &mut StageScope<'_>,
        passes: usize,
        mut draw: impl FnMut(usize, &mut wgpu::RenderPass<'_>),
    ) {
        let (cleared, kept) = (self.colors(Some(self.clear)), self.colors(None));
        let targets =
            |number| Targets { color: if number == 0 { &cleared } else { &kept }, depth: None };
        let targets: Vec<_> = (0..passes).map(targets).collect();
        scope.render_series(&targets, |number, pass| self.draw(pass, |pass| draw(number, pass)));
    }

    fn colors(&self, clear: Option<wgpu::Color>) -> Vec<ColorTarget<'_>> {
        self.views.iter().map(|view| ColorTarget { view, clear, slice: None }).collect()
    }

    fn draw(&self, pass: &mut wgpu::RenderPass<'_>, draw: impl FnOnce(&mut wgpu::RenderPass<'_>)) {
        self.raster.bind(pass);
        bind_groups(pass, &self.groups);
        draw(pass);
    }
}

/// A pass that draws all opaque geometry with a depth test.
pub struct ScenePass {
    raster: Raster,
    groups: Vec<wgpu::BindGroup>,
    geometry: Geometry,
    pub colors: Vec<wgpu::Texture>,
    pub depth: wgpu::Texture,
    views: Vec<wgpu::TextureView>,
    depth_view: wgpu::TextureView,
}

impl ScenePass {
    /// A colour target of `size_px` for each format, cleared to transparent black, and a depth target. Without colours only positions
    /// are read.
    pub fn new<'a>(
        resources: &Resources<'_>,
        label: &'a str,
        groups: &'a [&'a Group],
        geometry: &Geometry,
        formats: &[wgpu::TextureFormat],
        size_px: [u32; 2],
    ) -> Result<Self, GpuError> {
        let states: Vec<_> = formats.iter().map(|format| super::opaque(*format)).collect();
        let depth_only = formats.is_empty();
        let spec = RenderSpec {
            fragment: (!depth_only).then_some("fragment"),
            buffers: &[Geometry::layout(depth_only)],
            depth: Some(super::depth_state(wgpu::CompareFunction::Less, true)),
            ..RenderSpec::new(label, label, groups, &states)
        };
        let raster = Raster::new(resources, &spec)?;
        let target = |format: &wgpu::TextureFormat| resources.target(label, size_px, *format);
        let colors: Vec<_> = formats.iter().map(target).collect();
        let depth = resources.target(label, size_px, super::DEPTH_FORMAT);
        Ok(Self {
            raster,
            groups: bare(groups),
            geometry: geometry.clone(),
            views: colors.iter().map(view).collect(),
            depth_view: view(&depth),
            colors,
            depth,
        })
    }

    pub fn encode(&self, scope: &mut StageScope<'_>) {
        let clear = Some(wgpu::Color::TRANSPARENT);
        let color: Vec<_> =
            self.views.iter().map(|view| ColorTarget { view, clear, slice: None }).collect();
        let depth = DepthTarget { view: &self.depth_view, clear: Some(1.0), read_only: false };
        scope.render(&Targets { color: &color, depth: Some(depth) }, |pass| {
            self.raster.bind(pass);
            bind_groups(pass, &self.groups);
            self.geometry.draw(pass, Part::Opaque);
        });
    }

    /// Every opaque triangle, and `texel_bytes` for each pixel of the targets.
    pub fn work(&self, texel_bytes: u64) -> fathom_record::Work {
        let triangles = self.geometry.triangles_of(Part::Opaque);
        fathom_record::Work {
            triangles,
            // Where nothing is drawn, nothing is read.
            bytes_read: if triangles > 0 { self.geometry.bytes() } else { 0 },
            bytes_written: pixels(&self.depth) * texel_bytes,
            ..Default::default()
        }
    }

    /// The same without the geometry's bytes, as other parts than the opaque one have some of them.
    pub fn least_work(&self, texel_bytes: u64) -> fathom_record::Work {
        fathom_record::Work { bytes_read: 0, ..self.work(texel_bytes) }
    }
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
