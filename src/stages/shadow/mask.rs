//! `shadow/mask`: the water surface as the light sees it first. UW §3 step 2b.

use crate::frame::Shared;
use crate::kit::{self, Bind, Group, Raster, RenderSpec, Resources};
use crate::shader_struct;
use crate::{Column, Output, Stage, StageInfo};
use fathom_gpu::{ColorTarget, DepthTarget, GpuError, StageScope, Targets};
use fathom_record::Work;

pub const INFO: StageInfo = StageInfo {
    name: "shadow/mask",
    about: "water surface visible from the light; photons that land elsewhere are dropped",
    source: "UW §3 step 2b",
};

shader_struct! {
    /// `Mask` in `shaders/shadow/mask.wgsl`.
    pub struct MaskUniforms {
        pub cells: u32,
    }
}

pub struct Mask {
    raster: Raster,
    groups: Vec<wgpu::BindGroup>,
    cells: u32,
    mask: wgpu::Texture,
    view: wgpu::TextureView,
    depth_view: wgpu::TextureView,
}

impl Mask {
    /// `depth` is the light's depth; the water is a grid of `cells`² quads.
    pub fn new(
        resources: &Resources<'_>,
        shared: &Shared,
        depth: &wgpu::Texture,
        cells: u32,
    ) -> Result<Self, GpuError> {
        let settings = resources.uniform(INFO.name, &MaskUniforms { cells });
        let group = Group::new(resources.gpu, INFO.name, &[Bind::Uniform(&settings)]);
        let format = wgpu::TextureFormat::R8Unorm;
        let (groups, targets) = ([&shared.group, &group], [kit::opaque(format)]);
        let defs = [shared.water_def()];
        let spec = RenderSpec {
            depth: Some(kit::depth_state(wgpu::CompareFunction::Less, false)),
            ..RenderSpec::new(INFO.name, (INFO.name, &defs[..]), &groups, &targets)
        };
        let raster = Raster::new(resources, &spec)?;
        let mask = resources.target(INFO.name, [depth.width(), depth.height()], format);
        let (view, depth_view) = (kit::view(&mask), kit::view(depth));
        Ok(Self { raster, groups: kit::bare(&groups), cells, view, depth_view, mask })
    }

    pub fn texture(&self) -> &wgpu::Texture {
        &self.mask
    }
}

impl Stage for Mask {
    fn info(&self) -> &'static StageInfo {
        &INFO
    }

    fn encode(&self, scope: &mut StageScope<'_>) {
        let clear = Some(wgpu::Color::BLACK);
        let targets = Targets {
            color: &[ColorTarget { view: &self.view, clear, slice: None }],
            depth: Some(DepthTarget { view: &self.depth_view, clear: None, read_only: true }),
        };
        scope.render(&targets, |pass| {
            self.raster.bind(pass);
            kit::bind_groups(pass, &self.groups);
            pass.draw(0..self.cells * self.cells * 6, 0..1);
        });
    }

    fn work(&self) -> Work {
        let texels = kit::pixels(&self.mask);
        Work {
            triangles: u64::from(self.cells) * u64::from(self.cells) * 2,
            bytes_read: texels * 4,
            bytes_written: texels,
            ..Work::default()
        }
    }

    /// Where there is no water, no depth is compared.
    fn least_work(&self) -> Work {
        Work { bytes_read: 0, ..self.work() }
    }

    fn outputs(&self) -> Vec<Output> {
        let meaning = "1 where the light meets the water first; row 0 is ndc y = +1 of the light";
        let column = Column::new("water", "1", "1 water, 0 other");
        vec![Output::texture("mask", meaning, vec![column], &self.mask)]
    }
}
