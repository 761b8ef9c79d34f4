//! Figures read back from a frame, and occlusion at given points.

use std::collections::BTreeMap;

use super::{Params, Solids, VolumeAo};
use crate::gpu::{Gpu, GpuError, read_buffer, read_texture};
use crate::pipelines::settings::Update;
use crate::scene::Scene;
use crate::stages::ao::march;
use crate::stages::ao::query::{Point, Query};
use crate::stages::kit::Resources;

impl VolumeAo {
    /// Samples are counted by a shader that does nothing else, over the last frame's G-buffer and volumes.
    pub(super) fn measured_quantities(&self, gpu: &Gpu) -> Result<BTreeMap<String, f64>, GpuError> {
        let depth = read_texture(gpu, &self.gbuffer.depth)?.data;
        let covered = depth.iter().filter(|z| **z < 1.0).count();
        let covered_share = covered as f64 / depth.len() as f64;
        let buffer_px = self.params.buffer_px();
        let counts =
            march::count(gpu, &self.shared, self.volumes(), &self.seen, &self.marching, buffer_px)?;
        // Per pixel of the occlusion buffer that shows geometry.
        let pixels = covered_share * f64::from(buffer_px[0]) * f64::from(buffer_px[1]);
        let per_pixel = |count: u64| count as f64 / pixels.max(1.0);
        // Of several volumes, the one with the largest voxels.
        let grids = self.volumes().iter().map(|voxels| voxels.grid);
        let coarsest = grids.max_by(|a, b| a.voxel_m.total_cmp(&b.voxel_m));
        let mut figures = vec![
            ("covered_share", covered_share),
            ("samples_per_pixel_mean", per_pixel(counts.samples)),
            ("r_max_m", self.marching.r_max_m),
        ];
        if self.marching.skipping {
            figures.push(("lookups_per_pixel_mean", per_pixel(counts.lookups)));
        }
        if let Some(grid) = coarsest {
            figures.push(("r_max_voxels", self.marching.r_max_voxels(&grid)));
            figures.push(("step_voxels", self.marching.step_in(&grid)));
        }
        let named = figures.into_iter();
        Ok(named.map(|(name, value)| (name.to_owned(), value)).collect())
    }
}

/// A at points of a scene, by the pipeline's settings for volumes and rays; what concerns the picture plays no part. One
/// point at least.
///
/// # Errors
/// What the GPU reports, and a scene or settings that give no grid.
pub fn occlusion_at(
    gpu: &Gpu,
    scene: &Scene,
    params: &Params,
    points: &[Point],
) -> Result<Vec<f32>, GpuError> {
    let resources = &Resources::new(gpu);
    let solids = Solids::new(resources, scene, params, Update::Once)?;
    let volumes = &solids.voxelization.volumes;
    let query = Query::new(resources, volumes, points, &params.ao.marching(scene))?;
    gpu.run(&[&query])?;
    let visibility: Vec<f32> = bytemuck::pod_collect_to_vec(&read_buffer(gpu, &query.visibility)?);
    Ok(visibility.iter().map(|v| 1.0 - v).collect())
}
