//! `voxel/slice`: the scene drawn into frusta one slice thin, a pass per slice and axis, and the OR of the axes. VAO §4.1.
//!
//! Every pass draws the whole geometry, and its near and far planes cut the slice out. The paper makes volumes so ahead of
//! rendering.

use super::slicemap::Axis;
use super::{Part, bit_volumes};
use crate::geometry::Geometry;
use crate::kit::{self, Bind, Dispatch, Group, Kernel, Raster, RenderSpec, Resources};
use crate::{Output, Stage, StageInfo};
use fathom_gpu::{ColorTarget, GpuError, StageScope, Targets};
use fathom_record::Work;

pub const INFO: StageInfo = StageInfo {
    name: "voxel/slice",
    about: "the whole geometry drawn into each slice of three volumes, and their OR",
    source: "VAO §4.1",
};

const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::R8Unorm;

struct Volume {
    grid: Group,
    gather: Group,
    dispatch: Dispatch,
    part: Part,
    /// Along x, y and z.
    views: [wgpu::TextureView; 3],
}

pub struct Slice {
    /// Along x, y and z.
    draw: [Raster; 3],
    gather: Kernel,
    geometry: Geometry,
    volumes: Vec<Volume>,
}

impl Slice {
    pub fn new(
        resources: &Resources<'_>,
        geometry: &Geometry,
        parts: &[Part],
    ) -> Result<Self, GpuError> {
        let volumes: Vec<Volume> = parts.iter().map(|part| Volume::new(resources, part)).collect();
        let grid: Vec<&Group> = volumes.iter().take(1).map(|v| &v.grid).collect();
        let both: Vec<&Group> = volumes.iter().take(1).flat_map(|v| [&v.grid, &v.gather]).collect();
        let draw = |axis: Axis| {
            let (defs, targets) = ([("AXIS", axis as i32)], [kit::opaque(FORMAT)]);
            let spec = RenderSpec {
                buffers: &[Geometry::layout(true)],
                ..RenderSpec::new(INFO.name, (INFO.name, &defs[..]), &grid, &targets)
            };
            Raster::new(resources, &spec)
        };
        Ok(Self {
            draw: [draw(Axis::X)?, draw(Axis::Y)?, draw(Axis::Z)?],
            gather: Kernel::new(resources, INFO.name, INFO.name, &both)?,
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
        let grid = Group::new(gpu, INFO.name, &[Bind::Uniform(&voxels.uniforms)]);
        let gather = Group::new(gpu, INFO.name, &binds);
        // An invocation for a word of the bit volume.
        let workgroups = kit::linear_workgroups(voxels.grid.words());
        let dispatch = Dispatch::new(resources, INFO.name, &[&grid, &gather], workgroups);
        let views = textures.each_ref().map(kit::view);
        Self { grid, gather, dispatch, part: part.clone(), views }
    }

    fn slices(&self, axis: Axis) -> u32 {
        axis.turned(&self.part.voxels.grid)[2]
    }
}

impl Stage for Slice {
    fn info(&self) -> &'static StageInfo {
        &INFO
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
            self.draw[axis as usize].bind(pass);
            pass.set_bind_group(0, &volume.grid.group, &[]);
            let part = volume.part.indices.clone();
            self.geometry.draw_instances(pass, part, slice..slice + 1);
        });
        scope.compute(|pass| {
            for volume in &self.volumes {
                self.gather.run(pass, &volume.dispatch);
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
