//! Figures read back from a frame, and occlusion at given points.

use super::{Params, VolumeAo, voxelize};
use crate::occlusion::OcclusionBuffers;
use crate::settings::Update;
use crate::{CountedReads, Pipeline, PipelineInstance, to_map};
use fathom_gpu::kit::{Resources, When};
use fathom_gpu::{Gpu, GpuError, read_buffer, read_texture};
use fathom_record::ceilings::Reads;
use fathom_scene::Scene;
use fathom_stages::ao::march;
use fathom_stages::ao::query::{self, SurfacePoint};
use fathom_stages::counters;
use fathom_stages::geometry::Geometry;
use std::collections::BTreeMap;

impl PipelineInstance for VolumeAo {
    fn image(&self) -> &wgpu::Texture {
        &self.composed.image
    }

    fn shows_visibility(&self) -> bool {
        self.composed.shows_occlusion
    }

    fn quantities(&self, gpu: &Gpu) -> Result<BTreeMap<String, f64>, GpuError> {
        // Of several volumes, the one with the largest voxels.
        let grids = self.volumes.iter().map(|voxels| voxels.grid);
        let coarsest = grids.max_by(|a, b| a.voxel_m.total_cmp(&b.voxel_m));
        let mut figures =
            vec![("covered_share", self.covered_share(gpu)?), ("r_max_m", self.marching.r_max_m)];
        if let Some(grid) = coarsest {
            figures.push(("r_max_voxels", self.marching.r_max_voxels(&grid)));
            figures.push(("step_voxels", self.marching.step_voxels(&grid)));
        }
        Ok(to_map(figures))
    }

    /// By a shader that does nothing else, over the last frame's G-buffer and volumes; per pixel of the occlusion buffer that shows
    /// geometry.
    fn counted_reads(&self, gpu: &Gpu) -> Result<Option<CountedReads>, GpuError> {
        let (gbuffer, raw) = (&self.buffers.gbuffer, &self.buffers.raw.1);
        let buffer_px = [raw.width(), raw.height()];
        let seen = (gbuffer, self.view_projection);
        let shared = &self.seen.shared;
        let (volumes, marching) = (&self.volumes, &self.marching);
        let [samples, lookups, _fragments] = counters::count(gpu, |resources, counters| {
            march::new(resources, shared, volumes, seen, marching, buffer_px, Some(counters))
        })?;
        let pixels = self.covered_share(gpu)? * f64::from(buffer_px[0]) * f64::from(buffer_px[1]);
        let per_pixel = |count: u64| count as f64 / pixels.max(1.0);
        let mut figures = vec![
            ("samples_per_pixel_mean", per_pixel(samples)),
            ("reads_per_pixel_mean", per_pixel(samples + lookups)),
        ];
        if self.marching.skipping {
            figures.push(("lookups_per_pixel_mean", per_pixel(lookups)));
        }
        // Each sample is a texel at least.
        let reads = Reads { texels: 0, volume_texels: samples + lookups };
        let stage = march::INFO.name;
        Ok(Some(CountedReads { stage, reads, quantities: to_map(figures) }))
    }

    fn occlusion(&self) -> Option<&OcclusionBuffers> {
        Some(&self.buffers)
    }
}

impl VolumeAo {
    /// Of the picture's pixels, those that show geometry.
    fn covered_share(&self, gpu: &Gpu) -> Result<f64, GpuError> {
        let depth = read_texture(gpu, &self.buffers.gbuffer.depth)?.data;
        let covered = depth.iter().filter(|z| **z < 1.0).count();
        Ok(covered as f64 / depth.len() as f64)
    }
}

/// A at points of a scene, one at least: by the pipeline's settings for volumes and rays; what concerns the picture plays no part.
///
/// # Errors
/// What the GPU reports, and a scene or settings that give no grid.
pub fn occlusion_at(
    gpu: &Gpu,
    scene: &Scene,
    params: &Params,
    points: &[SurfacePoint],
) -> Result<Vec<f32>, GpuError> {
    let resources = Resources::new(gpu);
    scene.needs_objects(VolumeAo::NAME).map_err(GpuError::Unusable)?;
    let geometry = Geometry::new(&resources, scene);
    let volumes = voxelize(&resources, &geometry, scene, params, Update::Once)?;
    let query = query::new(&resources, &volumes, points, &params.marching(scene))?;
    let visibility = resources.push_as(query, When::Once);
    resources.into_parts().run_once(gpu)?;
    let visibility: Vec<f32> = bytemuck::pod_collect_to_vec(&read_buffer(gpu, &visibility)?);
    Ok(visibility.iter().map(|v| 1.0 - v).collect())
}
