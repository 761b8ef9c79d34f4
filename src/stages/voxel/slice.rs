//! `voxel/slice`: the scene drawn into frusta one slice thin, a pass per slice and axis, and the OR of the axes. VAO §4.1.
//!
//! Every pass draws the whole geometry, and its near and far planes cut the slice out. The paper makes volumes so ahead of
//! rendering.

use super::slicemap::Axis;
use super::{Part, bit_volumes};
use crate::gpu::{ColorTarget, GpuError, StageScope, Targets};
use crate::record::Work;
use crate::scene::Grid;
use crate::stages::geometry::Geometry;
use crate::stages::kit::{self, Bind, Group, RenderSpec, Resources};
use crate::stages::{Output, Stage, StageInfo};

pub const INFO: StageInfo = StageInfo {
    name: "voxel/slice",
    about: "the whole geometry drawn into each slice of three volumes, and their OR",
    source: "VAO §4.1",
};

const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::R8Unorm;

/// Workgroups of the OR: an invocation for a word of the bit volume.
pub fn workgroups(grid: &Grid) -> [u32; 3] {
    kit::linear_workgroups(grid.words())
}

struct Volume {
    grid: Group,
    gather: Group,
    part: Part,
    /// Along x, y and z.
    views: [wgpu::TextureView; 3],
}

pub struct Slice {
    /// Along x, y and z.
    draw: [wgpu::RenderPipeline; 3],
    gather: wgpu::ComputePipeline,
    geometry: Geometry,
    volumes: Vec<Volume>,
}

impl Slice {
    pub fn new(
        resources: &Resources<'_>,
        geometry: &Geometry,
        parts: &[Part],
    ) -> Result<Self, GpuError> {
        let gpu = resources.gpu;
        let volumes: Vec<Volume> = parts.iter().map(|part| Volume::new(resources, part)).collect();
        let grid: Vec<&Group> = volumes.iter().take(1).map(|v| &v.grid).collect();
        let both: Vec<&Group> = volumes.iter().take(1).flat_map(|v| [&v.grid, &v.gather]).collect();
        let draw = |axis: Axis| -> Result<wgpu::RenderPipeline, GpuError> {
            let spec = RenderSpec {
                label: INFO.name,
                shader: &gpu.shader(INFO.name, &[("AXIS", axis as i32)])?,
                vertex: "vertex",
                fragment: Some("fragment"),
                groups: &grid,
                buffers: &[Geometry::layout(true)],
                targets: &[kit::opaque(FORMAT)],
                depth: None,
            };
            Ok(kit::render_pipeline(gpu, &spec))
        };
        let shader = gpu.shader(INFO.name, &[])?;
        Ok(Self {
            draw: [draw(Axis::X)?, draw(Axis::Y)?, draw(Axis::Z)?],
            gather: kit::compute_pipeline(gpu, INFO.name, &shader, &both),
            geometry: geometry.clone(),
            volumes,
        })
    }
}

impl Volume {
    fn new(resources: &Resources<'_>, part: &Part) -> Self {
        let (gpu, voxels) = (resources.gpu, &part.voxels);
        let textures =
            Axis::ALL.map(|axis| resources.volume(INFO.name, axis.turned(&voxels.grid), FORMAT, 1));
        let [x, y, z] = &textures;
        let binds = [Bind::Volume(x), Bind::Volume(y), Bind::Volume(z), Bind::Write(&voxels.bits)];
        Self {
            grid: Group::new(gpu, INFO.name, &[Bind::Uniform(&voxels.uniforms)]),
            gather: Group::new(gpu, INFO.name, &binds),
            part: part.clone(),
            views: textures.each_ref().map(kit::view),
        }
    }

    fn slices(&self, axis: Axis) -> u32 {
        axis.turned(&self.part.voxels.grid)[2]
    }
}

impl Stage for Slice {
    fn name(&self) -> &'static str {
        INFO.name
    }

    fn encode(&self, scope: &mut StageScope<'_>) {
        let mut slices = Vec::new();
        for volume in &self.volumes {
            for axis in Axis::ALL {
                slices.extend((0..volume.slices(axis)).map(|slice| (volume, axis, slice)));
            }
        }
        let color: Vec<[ColorTarget<'_>; 1]> = slices
            .iter()
            .map(|(volume, axis, slice)| {
                [ColorTarget {
                    view: &volume.views[*axis as usize],
                    clear: Some(wgpu::Color::BLACK),
                    slice: Some(*slice),
                }]
            })
            .collect();
        let targets: Vec<Targets<'_>> =
            color.iter().map(|color| Targets { color, depth: None }).collect();
        scope.render_series(&targets, |number, pass| {
            let (volume, axis, slice) = slices[number];
            pass.set_pipeline(&self.draw[axis as usize]);
            pass.set_bind_group(0, &volume.grid.group, &[]);
            let part = volume.part.indices.clone();
            self.geometry.draw_instances(pass, part, slice..slice + 1);
        });
        scope.compute(|pass| {
            pass.set_pipeline(&self.gather);
            for volume in &self.volumes {
                let [x, y, z] = workgroups(&volume.part.voxels.grid);
                pass.set_bind_group(0, &volume.grid.group, &[]);
                pass.set_bind_group(1, &volume.gather.group, &[]);
                pass.dispatch_workgroups(x, y, z);
            }
        });
    }

    fn work(&self) -> Work {
        let passes = |v: &Volume| Axis::ALL.iter().map(|a| u64::from(v.slices(*a))).sum::<u64>();
        let texels: u64 = self.volumes.iter().map(|v| v.part.voxels.grid.count()).sum();
        let drawn = self.volumes.iter().map(|v| passes(v) * v.part.triangles());
        Work {
            triangles: drawn.sum(),
            texel_fetches: 3 * texels,
            bytes_written: 3 * texels + texels / 8,
            ..Work::default()
        }
    }

    fn outputs(&self) -> Vec<Output> {
        bit_volumes(self.volumes.iter().map(|v| &v.part.voxels))
    }
}
