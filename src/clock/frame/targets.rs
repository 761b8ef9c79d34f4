//! What a render pass draws to.

use fathom_record::ceilings::{Drawing, TargetRecord};

/// WebGPU's largest number of colour targets.
const MAX_COLOR_TARGETS: usize = 8;

/// The targets of a render pass.
#[derive(Clone, Copy, Debug, Default)]
pub struct Targets<'a> {
    /// At most eight.
    pub color: &'a [ColorTarget<'a>],
    pub depth: Option<DepthTarget<'a>>,
}

impl Targets<'_> {
    pub(super) fn records(&self) -> Vec<TargetRecord> {
        let record = |target: &ColorTarget<'_>| {
            let format = format!("{:?}", target.view.texture().format()).to_lowercase();
            TargetRecord { format, drawing: target.drawing }
        };
        self.color.iter().map(record).collect()
    }
}

#[derive(Clone, Copy, Debug)]
pub struct ColorTarget<'a> {
    pub view: &'a wgpu::TextureView,
    /// Cleared to this first; otherwise what it holds is kept.
    pub clear: Option<wgpu::Color>,
    /// Slice of a volume texture; none for a two-dimensional one.
    pub slice: Option<u32>,
    /// What the pipelines that draw into it do. It is told in records alone.
    pub drawing: Drawing,
}

#[derive(Clone, Copy, Debug)]
pub struct DepthTarget<'a> {
    pub view: &'a wgpu::TextureView,
    /// Cleared to this first; otherwise what it holds is kept.
    pub clear: Option<f32>,
    /// Tested but not written; `clear` is then ignored.
    pub read_only: bool,
}

pub(super) fn open<'e>(
    encoder: &'e mut wgpu::CommandEncoder,
    label: &str,
    targets: &Targets<'_>,
    timestamp_writes: Option<wgpu::RenderPassTimestampWrites<'_>>,
) -> wgpu::RenderPass<'e> {
    let (attachments, count) = color_attachments(targets.color);
    encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        label: Some(label),
        color_attachments: &attachments[..count],
        depth_stencil_attachment: targets.depth.as_ref().map(depth_attachment),
        timestamp_writes,
        ..Default::default()
    })
}

type Attachments<'a> = [Option<wgpu::RenderPassColorAttachment<'a>>; MAX_COLOR_TARGETS];

fn color_attachments<'a>(targets: &[ColorTarget<'a>]) -> (Attachments<'a>, usize) {
    let mut attachments: Attachments<'a> = [const { None }; MAX_COLOR_TARGETS];
    assert!(targets.len() <= MAX_COLOR_TARGETS, "a render pass has at most eight colour targets");
    for (attachment, target) in attachments.iter_mut().zip(targets) {
        *attachment = Some(wgpu::RenderPassColorAttachment {
            view: target.view,
            depth_slice: target.slice,
            resolve_target: None,
            ops: wgpu::Operations {
                load: target.clear.map_or(wgpu::LoadOp::Load, wgpu::LoadOp::Clear),
                store: wgpu::StoreOp::Store,
            },
        });
    }
    (attachments, targets.len())
}

fn depth_attachment<'a>(target: &DepthTarget<'a>) -> wgpu::RenderPassDepthStencilAttachment<'a> {
    wgpu::RenderPassDepthStencilAttachment {
        view: target.view,
        depth_ops: (!target.read_only).then(|| wgpu::Operations {
            load: target.clear.map_or(wgpu::LoadOp::Load, wgpu::LoadOp::Clear),
            store: wgpu::StoreOp::Store,
        }),
        stencil_ops: None,
    }
}
