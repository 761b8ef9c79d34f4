//! What stages are built with: resources whose sizes are declared once, bind groups, passes.

mod bind;
mod pass;
mod resources;
mod shader_struct;

use crate::Gpu;

pub use bind::{Bind, Bindings, Layer, Nearest, Resource};
pub use pass::{
    Canvas, Code, Depth, Dispatch, DrawPass, Raster, RenderSpec, draw_fullscreen,
    linear_workgroups, pixels, size_px, square_workgroups,
};
pub use resources::{Buffer, PipelineParts, Resources, When};
pub(crate) use shader_struct::host_module;
pub use shader_struct::{ShaderStruct, SharedStruct, WgslType, host_bytes};

pub fn view(texture: &wgpu::Texture) -> wgpu::TextureView {
    texture.create_view(&wgpu::TextureViewDescriptor::default())
}

/// One layer of a texture of several.
pub fn layer_view(texture: &wgpu::Texture, layer: u32) -> wgpu::TextureView {
    texture.create_view(&wgpu::TextureViewDescriptor {
        dimension: Some(wgpu::TextureViewDimension::D2),
        base_array_layer: layer,
        array_layer_count: Some(1),
        ..Default::default()
    })
}

pub const DEPTH_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;

fn depth_state(compare: wgpu::CompareFunction, write: bool) -> wgpu::DepthStencilState {
    wgpu::DepthStencilState {
        format: DEPTH_FORMAT,
        depth_write_enabled: Some(write),
        depth_compare: Some(compare),
        stencil: wgpu::StencilState::default(),
        bias: wgpu::DepthBiasState::default(),
    }
}

/// A colour target written as it is.
pub fn opaque(format: wgpu::TextureFormat) -> wgpu::ColorTargetState {
    wgpu::ColorTargetState { format, blend: None, write_mask: wgpu::ColorWrites::ALL }
}

/// A colour target that a render pass must have, and to which nothing is written.
pub fn unwritten_target(format: wgpu::TextureFormat) -> wgpu::ColorTargetState {
    wgpu::ColorTargetState { write_mask: wgpu::ColorWrites::empty(), ..opaque(format) }
}

/// A colour target that adds up what is drawn.
pub fn additive(format: wgpu::TextureFormat) -> wgpu::ColorTargetState {
    let add = wgpu::BlendComponent {
        src_factor: wgpu::BlendFactor::One,
        dst_factor: wgpu::BlendFactor::One,
        operation: wgpu::BlendOperation::Add,
    };
    wgpu::ColorTargetState {
        blend: Some(wgpu::BlendState { color: add, alpha: add }),
        ..opaque(format)
    }
}

/// A colour target that what is drawn multiplies.
pub fn multiplicative(format: wgpu::TextureFormat) -> wgpu::ColorTargetState {
    let multiply = wgpu::BlendComponent {
        src_factor: wgpu::BlendFactor::Zero,
        dst_factor: wgpu::BlendFactor::Src,
        operation: wgpu::BlendOperation::Add,
    };
    wgpu::ColorTargetState {
        blend: Some(wgpu::BlendState {
            color: multiply,
            alpha: wgpu::BlendComponent { dst_factor: wgpu::BlendFactor::SrcAlpha, ..multiply },
        }),
        ..opaque(format)
    }
}

/// Format of targets that sum thousands of small contributions: 32-bit where the adapter blends it.
pub fn accumulation_format(gpu: &Gpu) -> wgpu::TextureFormat {
    if sums_are_short(gpu) { wgpu::TextureFormat::R16Float } else { wgpu::TextureFormat::R32Float }
}

/// Such sums are 16-bit floats.
pub fn sums_are_short(gpu: &Gpu) -> bool {
    !gpu.features.contains(wgpu::Features::FLOAT32_BLENDABLE)
}
