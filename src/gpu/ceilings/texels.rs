//! Kernels that read textures. Eight neighbouring texels add up to a known sum: see `shaders/ceilings/texels.wgsl`.

use super::invocations::{Answer, Code, Invocations, floats, invocations};
use super::kernel::{all_are, format, is_unorm};
use crate::{Gpu, GpuError};
use fathom_record::ceilings::TexelFormat;

/// Edge of the textures in texels: small enough for the first caches.
const EDGE: u32 = 64;
/// Values repeat along each axis after so many texels.
const PERIOD: u32 = 8;
/// Look-ups of an invocation in a turn, and texels of a gather.
const LOOK_UPS: u32 = PERIOD;
const GATHERED: u32 = 4;
/// Sum of a period's values.
const SUM: u32 = PERIOD * (PERIOD - 1) / 2;
/// Share by which sums of 32-bit floats may be off.
const TOLERANCE: f64 = 2e-3;
/// The same of a filter. Some drivers filter 8-bit texels in whole numbers and round up after each axis, lavapipe among them.
const FILTER_TOLERANCE: f64 = 2e-2;
/// Texels of 8 bits are multiples of this, so that such rounding is small.
const UNORM_STEP: u32 = 32;
/// Sums stay exact enough.
const MOST_TURNS: u32 = 1 << 18;

/// Texels loaded one by one.
pub(super) fn load(gpu: &Gpu, of: TexelFormat) -> Result<Invocations, GpuError> {
    let image = view(&texture(gpu, of, 1));
    kernel(gpu, of, ("load", 1, TOLERANCE), vec![(2, wgpu::BindingResource::TextureView(&image))])
}

/// Texels gathered by four.
pub(super) fn gather(gpu: &Gpu, of: TexelFormat) -> Result<Invocations, GpuError> {
    let image = view(&texture(gpu, of, 1));
    let nearest = sampler(gpu, wgpu::FilterMode::Nearest);
    let reads = vec![
        (2, wgpu::BindingResource::TextureView(&image)),
        (3, wgpu::BindingResource::Sampler(&nearest)),
    ];
    kernel(gpu, of, ("gather", GATHERED, TOLERANCE), reads)
}

/// Trilinear look-ups in a volume.
pub(super) fn sample(gpu: &Gpu, of: TexelFormat) -> Result<Invocations, GpuError> {
    let volume = view(&texture(gpu, of, EDGE));
    let linear = sampler(gpu, wgpu::FilterMode::Linear);
    let reads = vec![
        (4, wgpu::BindingResource::TextureView(&volume)),
        (5, wgpu::BindingResource::Sampler(&linear)),
    ];
    kernel(gpu, of, ("sample", 1, FILTER_TOLERANCE), reads)
}

fn kernel(
    gpu: &Gpu,
    of: TexelFormat,
    (entry, texels, tolerance): (&str, u32, f64),
    reads: Vec<(u32, wgpu::BindingResource<'_>)>,
) -> Result<Invocations, GpuError> {
    let defs = [("EDGE", EDGE as i32)];
    let code = Code { path: "ceilings/texels", entry, defs: &defs, reads, within: 0 };
    let answer: Answer = Box::new(move |turns, results| {
        let expected = f64::from(SUM * texels) * f64::from(turns) / unit(of);
        all_are(floats(&results), expected, tolerance)
    });
    let per_turn = f64::from(invocations(gpu)) * f64::from(LOOK_UPS * texels);
    Invocations::new(gpu, code, per_turn, MOST_TURNS, answer)
}

/// What a texel's value is divided by in its format.
fn unit(of: TexelFormat) -> f64 {
    if is_unorm(of) { 255.0 / f64::from(UNORM_STEP) } else { 1.0 }
}

/// A picture, or a volume of as many slices.
fn texture(gpu: &Gpu, of: TexelFormat, slices: u32) -> wgpu::Texture {
    use wgpu::util::DeviceExt as _;
    let flat = slices == 1;
    let descriptor = wgpu::TextureDescriptor {
        label: Some("ceiling"),
        size: wgpu::Extent3d { width: EDGE, height: EDGE, depth_or_array_layers: slices },
        mip_level_count: 1,
        sample_count: 1,
        dimension: if flat { wgpu::TextureDimension::D2 } else { wgpu::TextureDimension::D3 },
        format: format(of),
        usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
        view_formats: &[],
    };
    let rows = (0..slices).flat_map(|z| (0..EDGE).map(move |y| y + z));
    let values = rows.flat_map(|row| (0..EDGE).map(move |x| (x + row) % PERIOD));
    let bytes: Vec<u8> = values.flat_map(|value| texel(of, value)).collect();
    gpu.device.create_texture_with_data(&gpu.queue, &descriptor, Default::default(), &bytes)
}

/// The bytes of a texel all of whose channels have this value.
fn texel(of: TexelFormat, value: u32) -> Vec<u8> {
    let float = (value as f32).to_le_bytes();
    let half = half::f16::from_f32(value as f32).to_le_bytes();
    match of {
        TexelFormat::R8Unorm => vec![(value * UNORM_STEP) as u8],
        TexelFormat::Rgba8Unorm => vec![(value * UNORM_STEP) as u8; 4],
        TexelFormat::R16Float => half.to_vec(),
        TexelFormat::Rgba16Float => half.repeat(4),
        TexelFormat::R32Float | TexelFormat::Depth32Float => float.to_vec(),
        TexelFormat::Rgba32Float => float.repeat(4),
    }
}

fn view(texture: &wgpu::Texture) -> wgpu::TextureView {
    texture.create_view(&Default::default())
}

/// Textures repeat, so that every place has all its neighbours.
fn sampler(gpu: &Gpu, filter: wgpu::FilterMode) -> wgpu::Sampler {
    let repeat = wgpu::AddressMode::Repeat;
    gpu.device.create_sampler(&wgpu::SamplerDescriptor {
        label: Some("ceiling"),
        address_mode_u: repeat,
        address_mode_v: repeat,
        address_mode_w: repeat,
        mag_filter: filter,
        min_filter: filter,
        ..Default::default()
    })
}
