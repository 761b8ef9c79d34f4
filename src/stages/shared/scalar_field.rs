//! A scalar field in GPU memory, as the stages of family `scalar` sample it.

mod pyramid;

use glam::{DVec3, Vec3};

use crate::prelude::*;
use fathom_gpu::texture_bytes;
use fathom_scene::Volume;

shader_struct! {
    pub struct FieldUniforms {
        pub origin_m: Vec3,
        /// v_s: edge of the cube that has a cell's volume.
        pub voxel_m: f32,
        pub size_m: Vec3,
        /// Half a cell's diagonal, h of VAO Eq. 2.
        pub guard_m: f32,
        /// Edges of a cell.
        pub spacing_m: Vec3,
    }
}

/// v_s of a field whose cells need not be cubes: edge of the cube of a cell's volume, metres.
pub fn voxel_m(spacing_m: DVec3) -> f64 {
    spacing_m.element_product().cbrt()
}

/// h of VAO Eq. 2: half a cell's diagonal, s_v √3 / 2 for cubes, metres.
pub fn guard_m(spacing_m: DVec3) -> f64 {
    spacing_m.length() / 2.0
}

/// Level of the average pyramid whose cells are as long as a stratum, 0 where a voxel is longer. VAO §5.2.3.
pub fn pyramid_level(stratum_m: f64, voxel_m: f64) -> f64 {
    (stratum_m / voxel_m).log2().max(0.0)
}

/// A field as a texture: `R8Unorm` where its values are whole steps of 8 bits, else `R16Float`.
///
/// Its content and its pyramid of averages are made on the host when it is built: scalar fields do not change from frame to
/// frame, and no frame pays for them.
pub struct ScalarField {
    pub uniforms: Buffer,
    pub texture: wgpu::Texture,
    pub sampler: wgpu::Sampler,
    pub voxel_m: f64,
    pub diagonal_m: f64,
}

impl ScalarField {
    /// `with_pyramid`: with all levels of averages.
    pub fn new(resources: &Resources<'_>, volume: &Volume, with_pyramid: bool) -> Self {
        let levels = if with_pyramid { pyramid::levels(volume.cells) } else { 1 };
        let format = format_of(&volume.data);
        let texture = resources.volume("volume cells", volume.cells, format, levels);
        resources.host_copies("volume cells", size_of_val(volume.data.as_slice()) as u64);
        if !resources.gpu.is_planner() {
            write_levels(resources, &texture, volume);
        }
        let sampler = resources.level_sampler("scalar field");
        let bounds = volume.bounds();
        let uniforms = FieldUniforms {
            origin_m: volume.origin_m.as_vec3(),
            voxel_m: voxel_m(volume.spacing_m) as f32,
            size_m: bounds.size().as_vec3(),
            guard_m: guard_m(volume.spacing_m) as f32,
            spacing_m: volume.spacing_m.as_vec3(),
        };
        Self {
            uniforms: resources.uniform("scalar field", &uniforms),
            texture,
            sampler,
            voxel_m: voxel_m(volume.spacing_m),
            diagonal_m: bounds.size().length(),
        }
    }

    /// GPU memory of the field, all levels.
    pub fn bytes(&self) -> u64 {
        texture_bytes(&self.texture)
    }
}

/// 8 bits where they hold the values as they are.
fn format_of(values: &[f32]) -> wgpu::TextureFormat {
    let fits = |v: &f32| {
        let steps = v * 255.0;
        (steps - steps.round()).abs() < 1e-3
    };
    if values.iter().all(fits) {
        wgpu::TextureFormat::R8Unorm
    } else {
        wgpu::TextureFormat::R16Float
    }
}

/// The volume and its averages, level by level.
fn write_levels(resources: &Resources<'_>, texture: &wgpu::Texture, volume: &Volume) {
    let mut finer = (volume.cells, volume.data.clone());
    for level in 0..texture.mip_level_count() {
        if level > 0 {
            finer = pyramid::coarser(finer.0, &finer.1);
        }
        resources.write_level(texture, level, &texels(texture.format(), &finer.1));
    }
}

fn texels(format: wgpu::TextureFormat, values: &[f32]) -> Vec<u8> {
    match format {
        wgpu::TextureFormat::R8Unorm => values.iter().map(|v| (v * 255.0).round() as u8).collect(),
        _ => values.iter().flat_map(|v| half::f16::from_f32(*v).to_le_bytes()).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn eight_bits_hold_what_came_from_a_byte() {
        let bytes: Vec<f32> = (0..=255).map(|b| b as f32 / 255.0).collect();
        assert_eq!(format_of(&bytes), wgpu::TextureFormat::R8Unorm);
        assert_eq!(format_of(&[0.0, 0.5]), wgpu::TextureFormat::R16Float);
    }

    #[test]
    fn voxels_of_cubes_and_of_bricks() {
        let cube = DVec3::splat(0.2);
        assert!((voxel_m(cube) - 0.2).abs() < 1e-12);
        assert!((guard_m(cube) - 0.2 * 3f64.sqrt() / 2.0).abs() < 1e-12);
        assert!((voxel_m(DVec3::new(1.0, 2.0, 4.0)) - 2.0).abs() < 1e-12);
        assert_eq!(pyramid_level(0.05, 0.1), 0.0);
        assert_eq!(pyramid_level(0.4, 0.1), 2.0);
    }
}
