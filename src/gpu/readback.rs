//! Buffers and textures read back to the CPU.

use half::f16;
use half::slice::{HalfBitsSliceExt as _, HalfFloatSliceExt as _};

use super::{DeviceError, Gpu, GpuError};

/// A texture's texels as floats, row by row from the top, the channels of a texel together.
#[derive(Clone, Debug, PartialEq)]
pub struct Pixels {
    pub width: u32,
    pub height: u32,
    /// 1 or 4.
    pub channels: u32,
    /// `width × height × channels` values; unsigned normalised formats are in 0…1.
    pub data: Vec<f32>,
}

impl Pixels {
    /// The channels of one texel. Panics outside the texture.
    pub fn texel(&self, x: u32, y: u32) -> &[f32] {
        assert!(x < self.width && y < self.height, "texel ({x}, {y}) is outside");
        let start = (y as usize * self.width as usize + x as usize) * self.channels as usize;
        &self.data[start..start + self.channels as usize]
    }
}

/// Size of a texture in GPU memory, all its levels, layers and samples, in bytes. Formats whose texel
/// size wgpu does not tell count as 4 bytes.
pub fn texture_bytes(texture: &wgpu::Texture) -> u64 {
    let texel = u64::from(texture.format().block_copy_size(None).unwrap_or(4));
    let size = texture.size();
    let levels = (0..texture.mip_level_count()).map(|level| {
        let at = |extent: u32| u64::from((extent >> level).max(1));
        let depth = match texture.dimension() {
            wgpu::TextureDimension::D3 => at(size.depth_or_array_layers),
            _ => u64::from(size.depth_or_array_layers),
        };
        at(size.width).saturating_mul(at(size.height)).saturating_mul(depth)
    });
    let texels = levels.fold(0u64, u64::saturating_add);
    texels.saturating_mul(texel * u64::from(texture.sample_count()))
}

/// All bytes of a buffer, which must have been made with `COPY_SRC`.
pub fn read_buffer(gpu: &Gpu, buffer: &wgpu::Buffer) -> Result<Vec<u8>, GpuError> {
    gpu.catch(|| {
        let staging = staging(gpu, buffer.size());
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        encoder.copy_buffer_to_buffer(buffer, 0, &staging, 0, buffer.size());
        gpu.queue.submit([encoder.finish()]);
        Ok(gpu.map(&staging, buffer.size(), <[u8]>::to_vec)?)
    })
}

fn staging(gpu: &Gpu, bytes: u64) -> wgpu::Buffer {
    gpu.buffer("read-back", bytes, wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST)
}

/// The first level and layer of a texture, which must have been made with `COPY_SRC` and have one of
/// the formats R32Float, Rgba32Float, R16Float, Rgba16Float, R8Unorm, Rgba8Unorm, Depth32Float.
pub fn read_texture(gpu: &Gpu, texture: &wgpu::Texture) -> Result<Pixels, GpuError> {
    let size = [texture.width(), texture.height(), 1];
    let (channels, data) = read_texels(gpu, texture, 0, size)?;
    Ok(Pixels { width: size[0], height: size[1], channels, data })
}

/// A volume's texels as floats: x runs fastest, then y, then z; the channels of a texel together.
#[derive(Clone, Debug, PartialEq)]
pub struct Texels {
    /// Along x, y and z.
    pub cells: [u32; 3],
    /// 1 or 4.
    pub channels: u32,
    /// Unsigned normalised formats are in 0…1.
    pub data: Vec<f32>,
}

/// One level of a 3-D texture, under the same conditions as [`read_texture`].
pub fn read_volume(gpu: &Gpu, texture: &wgpu::Texture, level: u32) -> Result<Texels, GpuError> {
    let depth = texture.depth_or_array_layers();
    let cells = [texture.width(), texture.height(), depth].map(|n| (n >> level).max(1));
    let (channels, data) = read_texels(gpu, texture, level, cells)?;
    Ok(Texels { cells, channels, data })
}

fn read_texels(
    gpu: &Gpu,
    texture: &wgpu::Texture,
    level: u32,
    size: [u32; 3],
) -> Result<(u32, Vec<f32>), GpuError> {
    let layout = TexelLayout::from_format(texture.format())?;
    let bytes = texel_bytes(gpu, texture, level, size, layout.bytes)?;
    Ok((layout.channels, (layout.decode)(&bytes)))
}

fn texel_bytes(
    gpu: &Gpu,
    texture: &wgpu::Texture,
    level: u32,
    size: [u32; 3],
    texel: u32,
) -> Result<Vec<u8>, GpuError> {
    let row = size[0] * texel;
    let pitch = row.next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
    let bytes = u64::from(pitch) * u64::from(size[1]) * u64::from(size[2]);
    gpu.catch(|| {
        let staging = staging(gpu, bytes);
        copy_to(gpu, texture, level, size, &staging, pitch);
        Ok(gpu.map(&staging, bytes, |padded| {
            let rows = padded.chunks_exact(pitch as usize).map(|padded| &padded[..row as usize]);
            rows.collect::<Vec<_>>().concat()
        })?)
    })
}

fn copy_to(
    gpu: &Gpu,
    texture: &wgpu::Texture,
    level: u32,
    size: [u32; 3],
    staging: &wgpu::Buffer,
    pitch: u32,
) {
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    let layout = wgpu::TexelCopyBufferLayout {
        offset: 0,
        bytes_per_row: Some(pitch),
        rows_per_image: Some(size[1]),
    };
    let from = wgpu::TexelCopyTextureInfo { mip_level: level, ..texture.as_image_copy() };
    encoder.copy_texture_to_buffer(
        from,
        wgpu::TexelCopyBufferInfo { buffer: staging, layout },
        wgpu::Extent3d { width: size[0], height: size[1], depth_or_array_layers: size[2] },
    );
    gpu.queue.submit([encoder.finish()]);
}

/// How a texel lies in memory.
#[derive(Clone, Copy)]
struct TexelLayout {
    /// Of a texel.
    bytes: u32,
    channels: u32,
    decode: fn(&[u8]) -> Vec<f32>,
}

impl TexelLayout {
    fn from_format(format: wgpu::TextureFormat) -> Result<Self, GpuError> {
        use wgpu::TextureFormat as Format;
        let float: fn(&[u8]) -> Vec<f32> = bytemuck::pod_collect_to_vec;
        let half: fn(&[u8]) -> Vec<f32> = |bytes| {
            bytemuck::pod_collect_to_vec::<u8, u16>(bytes).reinterpret_cast::<f16>().to_f32_vec()
        };
        let unorm: fn(&[u8]) -> Vec<f32> =
            |bytes| bytes.iter().map(|byte| f32::from(*byte) / 255.0).collect();
        let (bytes, channels, decode) = match format {
            Format::R32Float | Format::Depth32Float => (4, 1, float),
            Format::Rgba32Float => (16, 4, float),
            Format::R16Float => (2, 1, half),
            Format::Rgba16Float => (8, 4, half),
            Format::R8Unorm => (1, 1, unorm),
            Format::Rgba8Unorm => (4, 4, unorm),
            other => {
                let reason = format!("textures of format {other:?} are not read");
                return Err(DeviceError::ReadBack(reason).into());
            }
        };
        Ok(Self { bytes, channels, decode })
    }
}
