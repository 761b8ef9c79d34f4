//! Textures and buffers. One declaration gives the limits that an adapter must have, the bytes, and the allocation.

use std::cell::RefCell;
use std::ops::Deref;
use std::rc::Rc;

use encase::internal::WriteInto;
use encase::{ShaderType, StorageBuffer};

use super::{Bindings, Nearest, ShaderStruct, host_bytes};
use crate::{Binding, Capacity, Demand, Gpu, GpuError, Stage, texture_bytes};
use fathom_record::Work;

/// Bytes of a buffer on a planner: enough for every binding.
const PLANNED_BYTES: u64 = 4096;

/// Makes the textures and buffers of a pipeline, collects its stages in frame order, and counts what all of it needs.
///
/// The same code plans a pipeline: on [`Gpu::planner`] nothing is allocated and no shader is compiled, and the count says what the
/// pipeline would need on a device.
#[derive(Clone)]
pub struct Resources<'g> {
    pub gpu: &'g Gpu,
    account: Rc<RefCell<PipelineTotals>>,
    sized_by: Option<Rc<str>>,
    for_pictures: bool,
}

#[derive(Default)]
struct PipelineTotals {
    demand: Demand,
    stages: Vec<Rc<Stage>>,
    once: Vec<Rc<Stage>>,
}

/// When a stage runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum When {
    EveryFrame,
    /// When the pipeline is made, and in no frame.
    Once,
    /// When the pipeline is made, and in every frame.
    Both,
}

/// What a pipeline runs, and what it needs.
pub struct PipelineParts {
    /// In frame order.
    pub stages: Vec<Rc<Stage>>,
    /// Run once, when the pipeline is made.
    pub once: Vec<Rc<Stage>>,
    pub demand: Demand,
}

/// A buffer and its size; on a planner, the size that it would have.
#[derive(Clone)]
pub struct Buffer {
    raw: wgpu::Buffer,
    bytes: u64,
    /// The struct that it holds, alone or in an array, where that is known.
    structure: Option<String>,
}

impl Buffer {
    /// Bytes.
    pub fn size(&self) -> u64 {
        self.bytes
    }

    /// Whether a shader's binding holds the same struct, as far as both are known.
    pub(super) fn may_be(&self, binding: &Binding) -> bool {
        let [host, shader] = [&self.structure, &binding.structure];
        host.is_none() || shader.is_none() || host == shader
    }

    /// The wgpu buffer, for holders that outlive the resources.
    pub fn raw(&self) -> wgpu::Buffer {
        self.raw.clone()
    }
}

impl Deref for Buffer {
    type Target = wgpu::Buffer;

    fn deref(&self) -> &wgpu::Buffer {
        &self.raw
    }
}

impl<'g> Resources<'g> {
    pub fn new(gpu: &'g Gpu) -> Self {
        Self { gpu, account: Rc::default(), sized_by: None, for_pictures: false }
    }

    /// Shares this account. These parameters give the size of what is made through it; messages name them.
    #[must_use]
    pub fn with_size_hint(&self, parameters: &str) -> Self {
        Self { sized_by: Some(parameters.into()), ..self.clone() }
    }

    /// Shares this account. What is made through it does not count as the pipeline's memory: only pictures need it.
    #[must_use]
    pub fn for_pictures(&self) -> Self {
        Self { for_pictures: true, ..self.clone() }
    }

    /// Bytes of all textures and buffers so far.
    pub fn allocated_bytes(&self) -> u64 {
        self.account.borrow().demand.allocated_bytes()
    }

    pub fn exceeded_limit(&self, capacity: &Capacity) -> Option<String> {
        self.account.borrow().demand.check(capacity).err()
    }

    /// The stages, and what all of it needs.
    pub fn into_parts(self) -> PipelineParts {
        let mut account = self.account.borrow_mut();
        let PipelineTotals { demand, stages, once } = std::mem::take(&mut *account);
        PipelineParts { stages, once, demand }
    }

    /// The next stage of the frame; what it leaves.
    pub fn push<L>(&self, stage: Stage<L>) -> L {
        self.push_as(stage, When::EveryFrame)
    }

    /// A stage with the time at which it runs; what it leaves.
    pub fn push_as<L>(&self, stage: Stage<L>, when: When) -> L {
        let (stage, left) = stage.split();
        self.note(stage.name(), |demand, name| demand.takes(name, stage.work));
        let (stage, mut account) = (Rc::new(stage), self.account.borrow_mut());
        if when != When::Once {
            account.stages.push(stage.clone());
        }
        if when != When::EveryFrame {
            account.once.push(stage);
        }
        left
    }

    /// Work of a frame in addition to what its stages declare, for the estimate of its time.
    pub fn add_work(&self, label: &str, work: Work) {
        self.note(label, |demand, name| demand.takes(name, work));
    }

    /// Adds to the account, under the parameters that give the size, or under the label.
    fn note(&self, label: &str, add: impl for<'d> FnOnce(&'d mut Demand, &str) -> &'d mut Demand) {
        add(&mut self.account.borrow_mut().demand, self.sized_by.as_deref().unwrap_or(label));
    }

    /// The host needs this many bytes to make these resources or to read them back.
    pub fn host_copies(&self, label: &str, bytes: u64) {
        self.note(label, |demand, what| demand.copies(what, bytes));
    }

    /// Shaders index this many things.
    pub fn indexed(&self, label: &str, count: u64) {
        self.note(label, |demand, what| demand.indexed(what, count));
    }

    /// An invocation makes so many turns of its loops at most, those that find a loop's end included. The label names what gives them.
    pub fn iterations(&self, label: &str, count: u64) {
        self.account.borrow_mut().demand.iterations(label, count);
    }

    /// A stage's fragment shader writes storage, which not every adapter lets it do.
    pub fn fragment_writes(&self, stage: &str) {
        self.note(stage, |demand, _| demand.fragment_writes(stage));
    }

    pub(super) fn dispatch(&self, label: &str, workgroups: [u32; 3]) {
        self.note(label, |demand, what| demand.dispatch(what, workgroups.map(u64::from)));
    }

    /// The message names the shader: no parameter changes what it binds.
    pub(super) fn binds(&self, shader: &str, groups: &[&Bindings]) {
        let count = groups.iter().map(|group| group.storage_buffers()).sum();
        self.account.borrow_mut().demand.storage_buffers(shader, count);
    }

    pub(super) fn color_targets(&self, label: &str, formats: &[wgpu::TextureFormat]) {
        let bytes = formats.iter().map(|f| u64::from(f.target_pixel_byte_cost().unwrap_or(16)));
        let bytes: u64 = bytes.sum();
        // The message names the stage, because no parameter changes this.
        let demand = &mut self.account.borrow_mut().demand;
        demand.color_targets(label, formats.len() as u64, bytes);
    }

    /// A texture that passes draw into, shaders read, and the host can read back.
    pub fn target(
        &self,
        label: &str,
        size: [u32; 2],
        format: wgpu::TextureFormat,
    ) -> wgpu::Texture {
        self.layers(label, size, format, 1)
    }

    /// A texture of several layers that passes draw into one by one, shaders read, and the host can read back.
    pub fn layers(
        &self,
        label: &str,
        [width, height]: [u32; 2],
        format: wgpu::TextureFormat,
        layers: u32,
    ) -> wgpu::Texture {
        let usage = wgpu::TextureUsages::RENDER_ATTACHMENT
            | wgpu::TextureUsages::TEXTURE_BINDING
            | wgpu::TextureUsages::COPY_SRC;
        let size = wgpu::Extent3d { width, height, depth_or_array_layers: layers };
        self.texture(label, (wgpu::TextureDimension::D2, size), format, usage, 1)
    }

    /// A texture that compute shaders write, shaders read, and the host can read back.
    pub fn image(&self, label: &str, size: [u32; 2], format: wgpu::TextureFormat) -> wgpu::Texture {
        let usage = wgpu::TextureUsages::STORAGE_BINDING
            | wgpu::TextureUsages::TEXTURE_BINDING
            | wgpu::TextureUsages::COPY_SRC;
        self.texture(label, (wgpu::TextureDimension::D2, flat(size)), format, usage, 1)
    }

    /// A texture of 32-bit floats with fixed content.
    pub fn fixed_texture(
        &self,
        label: &str,
        size: [u32; 2],
        format: wgpu::TextureFormat,
        texels: impl FnOnce() -> Vec<f32>,
    ) -> wgpu::Texture {
        let usage = wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST;
        let size = (wgpu::TextureDimension::D2, flat(size));
        let texture = self.texture(label, size, format, usage, 1);
        if !self.gpu.is_planner() {
            self.write_level(&texture, 0, bytemuck::cast_slice(&texels()));
        }
        texture
    }

    /// A volume of texels that shaders sample, slices of which passes can draw into, and that can be filled by copying
    /// and read back.
    pub fn volume(
        &self,
        label: &str,
        [width, height, depth_or_array_layers]: [u32; 3],
        format: wgpu::TextureFormat,
        levels: u32,
    ) -> wgpu::Texture {
        let usage = wgpu::TextureUsages::RENDER_ATTACHMENT
            | wgpu::TextureUsages::TEXTURE_BINDING
            | wgpu::TextureUsages::COPY_DST
            | wgpu::TextureUsages::COPY_SRC;
        let size = wgpu::Extent3d { width, height, depth_or_array_layers };
        self.texture(label, (wgpu::TextureDimension::D3, size), format, usage, levels)
    }

    pub(crate) fn texture(
        &self,
        label: &str,
        (dimension, size): (wgpu::TextureDimension, wgpu::Extent3d),
        format: wgpu::TextureFormat,
        usage: wgpu::TextureUsages,
        levels: u32,
    ) -> wgpu::Texture {
        let [width, height, depth] =
            [size.width, size.height, size.depth_or_array_layers].map(u64::from);
        let texture = self.gpu.device.create_texture(&wgpu::TextureDescriptor {
            label: Some(label),
            size,
            mip_level_count: levels,
            sample_count: 1,
            dimension,
            format,
            usage,
            view_formats: &[],
        });
        self.note(label, |demand, what| {
            let demand = self.hold(demand, what, texture_bytes(&texture));
            match dimension {
                wgpu::TextureDimension::D3 => demand.texture_3d(what, [width, height, depth]),
                _ => demand.texture_2d(what, width, height),
            }
        });
        texture
    }

    /// Fills one level of a texture from the host; not on a planner, whose textures hold nothing.
    pub fn write_level(&self, texture: &wgpu::Texture, level: u32, texels: &[u8]) {
        let size = texture.size().mip_level_size(level, texture.dimension());
        let texel = texture.format().block_copy_size(None).unwrap_or(4);
        self.gpu.queue.write_texture(
            wgpu::TexelCopyTextureInfo { mip_level: level, ..texture.as_image_copy() },
            texels,
            wgpu::TexelCopyBufferLayout {
                offset: 0,
                bytes_per_row: Some(size.width * texel),
                rows_per_image: Some(size.height),
            },
            size,
        );
    }

    /// A sampler that interpolates linearly within a level.
    pub fn linear_sampler(&self, label: &str) -> wgpu::Sampler {
        self.sampler(label, wgpu::FilterMode::Linear, wgpu::MipmapFilterMode::Nearest)
    }

    /// A sampler that interpolates linearly within and between levels.
    pub fn level_sampler(&self, label: &str) -> wgpu::Sampler {
        self.sampler(label, wgpu::FilterMode::Linear, wgpu::MipmapFilterMode::Linear)
    }

    /// A sampler that does not filter, for gathers.
    pub fn nearest_sampler(&self, label: &str) -> Nearest {
        Nearest(self.sampler(label, wgpu::FilterMode::Nearest, wgpu::MipmapFilterMode::Nearest))
    }

    fn sampler(
        &self,
        label: &str,
        filter: wgpu::FilterMode,
        mipmap_filter: wgpu::MipmapFilterMode,
    ) -> wgpu::Sampler {
        self.gpu.device.create_sampler(&wgpu::SamplerDescriptor {
            label: Some(label),
            mag_filter: filter,
            min_filter: filter,
            mipmap_filter,
            ..Default::default()
        })
    }

    /// A uniform buffer.
    pub fn uniform<T: ShaderStruct>(&self, label: &str, value: &T) -> Buffer {
        self.one(label, value, wgpu::BufferUsages::UNIFORM)
    }

    /// Settings that end a fragment shader's loops: a read-only storage buffer. Where a uniform ends a loop, lavapipe (Mesa 22.3)
    /// compiles its value into the shader, again for every draw: the filter of caustics took 5.0 ms with 12 taps and 0.7 ms with 24. With
    /// the taps in storage, 12 take 0.7 ms.
    pub fn loop_settings<T: ShaderStruct>(&self, label: &str, value: &T) -> Buffer {
        self.one(label, value, wgpu::BufferUsages::STORAGE)
    }

    fn one<T: ShaderStruct>(&self, label: &str, value: &T, usage: wgpu::BufferUsages) -> Buffer {
        T::assert_uniform_compat();
        Buffer { structure: Some(T::wgsl()), ..self.filled(label, &host_bytes(value), usage) }
    }

    /// A storage buffer that holds these structs.
    pub fn structs<T>(&self, label: &str, values: &[T], usage: wgpu::BufferUsages) -> Buffer
    where
        T: ShaderStruct + encase::ShaderSize,
        for<'v> &'v [T]: ShaderType + WriteInto,
    {
        let mut bytes = StorageBuffer::new(Vec::new());
        bytes.write(&values).expect("a Vec grows to whatever a shader type needs");
        let usage = usage | wgpu::BufferUsages::STORAGE;
        Buffer { structure: Some(T::wgsl()), ..self.filled(label, &bytes.into_inner(), usage) }
    }

    /// A storage buffer with room for so many structs, as [`Self::storage`] makes it.
    pub fn struct_storage<T: ShaderStruct>(&self, label: &str, count: u64) -> Buffer {
        Buffer { structure: Some(T::wgsl()), ..self.storage(label, count * T::min_size().get()) }
    }

    /// A buffer with content; it can be rewritten.
    pub fn filled(&self, label: &str, bytes: &[u8], usage: wgpu::BufferUsages) -> Buffer {
        self.filled_by(label, bytes.len() as u64, usage, || bytes.to_vec())
    }

    /// The same; the content is made only where the buffer is.
    pub fn filled_by(
        &self,
        label: &str,
        bytes: u64,
        usage: wgpu::BufferUsages,
        content: impl FnOnce() -> Vec<u8>,
    ) -> Buffer {
        let usage = usage | wgpu::BufferUsages::COPY_DST;
        if self.gpu.is_planner() {
            return self.buffer(label, bytes, usage);
        }
        self.note_buffer(label, bytes, usage);
        Buffer { raw: self.gpu.filled(label, &content(), usage), bytes, structure: None }
    }

    /// A storage buffer that shaders fill, the host can read back, and tests can fill.
    pub fn storage(&self, label: &str, bytes: u64) -> Buffer {
        let usage = wgpu::BufferUsages::STORAGE
            | wgpu::BufferUsages::COPY_SRC
            | wgpu::BufferUsages::COPY_DST;
        self.buffer(label, bytes, usage)
    }

    fn buffer(&self, label: &str, bytes: u64, usage: wgpu::BufferUsages) -> Buffer {
        self.note_buffer(label, bytes, usage);
        let size = if self.gpu.is_planner() { PLANNED_BYTES } else { bytes };
        let descriptor =
            wgpu::BufferDescriptor { label: Some(label), size, usage, mapped_at_creation: false };
        Buffer { raw: self.gpu.device.create_buffer(&descriptor), bytes, structure: None }
    }

    fn hold<'d>(&self, demand: &'d mut Demand, what: &str, bytes: u64) -> &'d mut Demand {
        if self.for_pictures { demand.copies(what, bytes) } else { demand.holds(what, bytes) }
    }

    fn note_buffer(&self, label: &str, bytes: u64, usage: wgpu::BufferUsages) {
        self.note(label, |demand, what| {
            let demand = self.hold(demand, what, bytes);
            if usage.contains(wgpu::BufferUsages::UNIFORM) {
                demand.uniform(what, bytes)
            } else if usage.contains(wgpu::BufferUsages::STORAGE) {
                demand.storage(what, bytes)
            } else {
                demand.buffer(what, bytes)
            }
        });
    }
}

impl PipelineParts {
    /// Runs the stages that run once.
    ///
    /// # Errors
    /// What the GPU reports.
    pub fn run_once(&self, gpu: &Gpu) -> Result<(), GpuError> {
        let stages: Vec<&Stage> = self.once.iter().map(AsRef::as_ref).collect();
        if stages.is_empty() || gpu.is_planner() { Ok(()) } else { gpu.run(&stages) }
    }
}

fn flat([width, height]: [u32; 2]) -> wgpu::Extent3d {
    wgpu::Extent3d { width, height, depth_or_array_layers: 1 }
}
