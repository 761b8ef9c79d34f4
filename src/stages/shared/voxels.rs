//! Voxel volumes in GPU memory, as the families `voxel` and `ao` share them.

use glam::{UVec3, Vec3};

use crate::prelude::*;
use fathom_scene::Grid;

shader_struct! {
    pub struct GridUniforms {
        pub origin_m: Vec3,
        /// Edge of a voxel.
        pub voxel_m: f32,
        pub cells: UVec3,
        /// Words of the bit volume.
        pub words: u32,
    }
}

impl GridUniforms {
    pub fn new(grid: &Grid) -> Self {
        Self {
            origin_m: grid.origin_m.as_vec3(),
            voxel_m: grid.voxel_m as f32,
            cells: UVec3::from(grid.cells),
            words: grid.words() as u32,
        }
    }
}

/// A grid of voxels in GPU memory, as bits and as a texture.
#[derive(Clone)]
pub struct Voxels {
    pub grid: Grid,
    /// [`GridUniforms`].
    pub uniforms: Buffer,
    /// A bit for each voxel in the order of [`Grid::index`].
    pub bits: Buffer,
    /// The same as `R8Unorm`, 0 or 1, or opacities; levels above the first are the pyramid.
    pub texture: wgpu::Texture,
}

impl Voxels {
    /// An empty volume; `pyramid` adds all levels.
    pub fn new(resources: &Resources<'_>, label: &str, grid: &Grid, pyramid: bool) -> Self {
        let longest = grid.cells.into_iter().max().unwrap_or(1);
        let levels = if pyramid { longest.ilog2() + 1 } else { 1 };
        resources.indexed(label, grid.count());
        Self {
            grid: *grid,
            uniforms: resources.uniform(label, &GridUniforms::new(grid)),
            bits: resources.storage(label, grid.words() * 4),
            texture: resources.volume(label, grid.cells, wgpu::TextureFormat::R8Unorm, levels),
        }
    }

    /// Fills bits and first level of the texture from the host: one value 0 … 255 per voxel in the order of [`Grid::index`];
    /// a bit is set where the value is not 0.
    pub fn write(&self, resources: &Resources<'_>, values: &[u8]) {
        let mut words = vec![0u32; self.grid.words() as usize];
        for (index, _) in values.iter().enumerate().filter(|(_, value)| **value > 0) {
            words[index / 32] |= 1 << (index % 32);
        }
        resources.gpu.queue.write_buffer(&self.bits, 0, bytemuck::cast_slice(&words));
        resources.write_level(&self.texture, 0, values);
    }
}
