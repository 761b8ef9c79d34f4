//! `voxel/view`: full voxels as cubes, seen from the camera. VAO Fig. 2.

use crate::frame::Shared;
use crate::kit::{self, Bind, Group, Raster, RenderSpec, Resources};
use crate::voxels::Voxels;
use crate::{Column, Output, Stage, StageInfo};
use fathom_gpu::{ColorTarget, DepthTarget, GpuError, StageScope, Targets};
use fathom_record::Work;

pub const INFO: StageInfo = StageInfo {
    name: "voxel/view",
    about: "full voxels as cubes, a ray a pixel; draws the picture and is no part of a frame",
    source: "VAO Fig. 2",
};

const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8Unorm;
const BACKGROUND: wgpu::Color = wgpu::Color { r: 0.93, g: 0.94, b: 0.96, a: 1.0 };

pub struct CubeView {
    raster: Raster,
    shared: wgpu::BindGroup,
    groups: Vec<Group>,
    color: wgpu::Texture,
    depth: wgpu::Texture,
    views: [wgpu::TextureView; 2],
}

impl CubeView {
    pub fn new(
        resources: &Resources<'_>,
        shared: &Shared,
        volumes: &[Voxels],
        size_px: [u32; 2],
    ) -> Result<Self, GpuError> {
        let group = |voxels: &Voxels| {
            let binds = [Bind::Uniform(&voxels.uniforms), Bind::Read(&voxels.bits)];
            Group::new(resources.gpu, INFO.name, &binds)
        };
        let groups: Vec<Group> = volumes.iter().map(group).collect();
        let layout: Vec<&Group> = [&shared.group].into_iter().chain(groups.first()).collect();
        let targets = [kit::opaque(FORMAT)];
        let spec = RenderSpec {
            depth: Some(kit::depth_state(wgpu::CompareFunction::Less, true)),
            ..RenderSpec::new(INFO.name, INFO.name, &layout, &targets)
        };
        let raster = Raster::new(resources, &spec)?;
        let color = resources.target(INFO.name, size_px, FORMAT);
        let depth = resources.target(INFO.name, size_px, kit::DEPTH_FORMAT);
        Ok(Self {
            raster,
            shared: shared.group.group.clone(),
            groups,
            views: [kit::view(&color), kit::view(&depth)],
            color,
            depth,
        })
    }

    pub fn texture(&self) -> &wgpu::Texture {
        &self.color
    }

    pub fn depth(&self) -> &wgpu::Texture {
        &self.depth
    }
}

impl Stage for CubeView {
    fn info(&self) -> &'static StageInfo {
        &INFO
    }

    fn encode(&self, scope: &mut StageScope<'_>) {
        let [color, depth] = &self.views;
        let targets = Targets {
            color: &[ColorTarget { view: color, clear: Some(BACKGROUND), slice: None }],
            depth: Some(DepthTarget { view: depth, clear: Some(1.0), read_only: false }),
        };
        scope.render(&targets, |pass| {
            self.raster.bind(pass);
            pass.set_bind_group(0, &self.shared, &[]);
            for group in &self.groups {
                pass.set_bind_group(1, &group.group, &[]);
                pass.draw(0..3, 0..1);
            }
        });
    }

    fn work(&self) -> Work {
        let pixels = kit::pixels(&self.color);
        Work {
            fragments: pixels * self.groups.len() as u64,
            bytes_written: pixels * 8,
            ..Work::default()
        }
    }

    /// Where there is no voxel, nothing is drawn.
    fn least_work(&self) -> Work {
        Work { fragments: 0, ..self.work() }
    }

    fn outputs(&self) -> Vec<Output> {
        let meaning = "the voxels as cubes";
        vec![Output::texture("cubes", meaning, Column::display("display value"), &self.color)]
    }
}
