//! Photons in GPU memory, and the dispatch that `caustics/trace` and `godrays/trace` share.

use bytemuck::{Pod, Zeroable};
use encase::ShaderType;
use glam::Vec2;

use super::frame::Shared;
use super::kit::{self, Bind, Group, Resources};
use super::{Column, Output, OutputData};
use crate::gpu::{GpuError, StageScope};
use crate::record::Work;

/// A traced photon: host twin of `Photon` in `shaders/shared/photon.wgsl`, metres.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable, ShaderType)]
pub struct Photon {
    /// Where it meets the water.
    pub entry_m: glam::Vec3,
    /// Distance between estimate and seen surface in the last iteration, or [`MISSED`] or [`OUTSIDE`].
    pub residual_m: f32,
    /// Where it lands.
    pub hit_m: glam::Vec3,
    /// From entry to hit.
    pub distance_m: f32,
}

/// Residual of a photon that never enters the water.
pub const MISSED: f32 = -1.0;
/// Residual of a photon that left the light's frustum, or looks past everything the light sees.
pub const OUTSIDE: f32 = -2.0;

/// Cells per side of a workgroup, as in the shaders.
const WORKGROUP: u32 = 8;

/// A buffer of photons and how many it holds.
#[derive(Clone)]
pub struct Photons {
    pub buffer: wgpu::Buffer,
    pub count: u32,
}

impl Photons {
    pub fn bytes(count: u64) -> u64 {
        count * size_of::<Photon>() as u64
    }

    pub fn new(resources: &Resources<'_>, label: &str, count: u32) -> Self {
        Self {
            buffer: resources.storage(label, Self::bytes(u64::from(count))),
            count,
        }
    }
}

/// Host twin of `Trace` in `shaders/shared/photon.wgsl`.
#[derive(Clone, Debug, PartialEq, ShaderType)]
pub struct TraceUniforms {
    pub grid: u32,
    pub side: u32,
    pub iterations: u32,
    pub masked: u32,
    pub offset: Vec2,
    pub start_m: f32,
    /// Residual up to which a photon counts as converged.
    pub tolerance_m: f32,
}

impl TraceUniforms {
    pub fn photons(&self) -> u32 {
        self.grid * self.grid * self.side * self.side
    }
}

/// Dispatch groups per side that a grid needs.
pub fn workgroups(grid: u32) -> u32 {
    grid.div_ceil(WORKGROUP)
}

pub struct Tracing {
    pipeline: wgpu::ComputePipeline,
    shared: wgpu::BindGroup,
    group: Group,
    settings: TraceUniforms,
    uniforms: wgpu::Buffer,
    pub photons: Photons,
}

impl Tracing {
    /// `name` is the stage's, and names its shader. With `dynamic` the shader takes its loop bound from the settings.
    pub fn new(
        resources: &Resources<'_>,
        shared: &Shared,
        name: &'static str,
        (depth, mask): (&wgpu::Texture, &wgpu::Texture),
        settings: TraceUniforms,
        dynamic: bool,
    ) -> Result<Self, GpuError> {
        let gpu = resources.gpu;
        let side = if dynamic { 0 } else { settings.side as i32 };
        let shader = gpu.shader(name, &[("SIDE", side)])?;
        let uniforms = resources.uniform(name, &settings);
        let photons = Photons::new(resources, name, settings.photons());
        let texels = gpu.device.create_sampler(&wgpu::SamplerDescriptor {
            label: Some(name),
            ..Default::default()
        });
        let group = Group::new(
            gpu,
            name,
            &[
                Bind::Uniform(&uniforms),
                Bind::Depth(depth),
                Bind::Texels(mask),
                Bind::Write(&photons.buffer),
                Bind::NearestSampler(&texels),
            ],
        );
        Ok(Self {
            pipeline: kit::compute_pipeline(gpu, name, &shader, &[&shared.group, &group]),
            shared: shared.group.group.clone(),
            group,
            settings,
            uniforms,
            photons,
        })
    }

    /// Moves the photons within their shares of the cells; `offset` in 0…1, the middle is 0.5.
    pub fn set_offset(&self, queue: &wgpu::Queue, offset: Vec2) {
        let settings = TraceUniforms {
            offset,
            ..self.settings.clone()
        };
        queue.write_buffer(&self.uniforms, 0, &kit::host_bytes(&settings));
    }

    pub fn encode(&self, scope: &mut StageScope<'_>) {
        let groups = workgroups(self.settings.grid);
        scope.compute(|pass| {
            pass.set_pipeline(&self.pipeline);
            pass.set_bind_group(0, &self.shared, &[]);
            pass.set_bind_group(1, &self.group.group, &[]);
            pass.dispatch_workgroups(groups, groups, 1);
        });
    }

    pub fn work(&self) -> Work {
        let photons = u64::from(self.photons.count);
        Work {
            photons,
            // Four depth texels an iteration.
            texel_fetches: photons * 4 * u64::from(self.settings.iterations),
            bytes_written: Photons::bytes(photons),
            ..Work::default()
        }
    }

    pub fn outputs(&self) -> Vec<Output> {
        vec![Output {
            name: "photons".into(),
            meaning: "traced photons, cell by cell".into(),
            columns: columns(),
            data: OutputData::Buffer {
                buffer: self.photons.buffer.clone(),
                stride_floats: (size_of::<Photon>() / 4) as u32,
                count: self.photons.count,
                row: Box::new({
                    let tolerance_m = self.settings.tolerance_m;
                    move |floats| row(floats, tolerance_m)
                }),
            },
        }]
    }
}

/// The columns of a stored photon: entry, direction, hit, distance, residual, converged.
fn row(stored: &[f32], tolerance_m: f32) -> Vec<f32> {
    let photon: &Photon = bytemuck::from_bytes(bytemuck::cast_slice(stored));
    let direction = (photon.hit_m - photon.entry_m).normalize_or_zero();
    let converged = (0.0..=tolerance_m).contains(&photon.residual_m);
    let mut row = Vec::with_capacity(12);
    for place in [photon.entry_m, direction, photon.hit_m] {
        row.extend(place.to_array());
    }
    row.extend([
        photon.distance_m,
        photon.residual_m,
        f32::from(u8::from(converged)),
    ]);
    row
}

fn columns() -> Vec<Column> {
    let column = |name, unit, meaning| Column {
        name,
        unit,
        meaning,
    };
    let entry = "where the photon meets the water";
    let direction = "unit direction after refraction; 0 for a photon that never enters the water";
    let hit = "where the photon lands";
    vec![
        column("entry_x_m", "m", entry),
        column("entry_y_m", "m", entry),
        column("entry_z_m", "m", entry),
        column("direction_x", "1", direction),
        column("direction_y", "1", direction),
        column("direction_z", "1", direction),
        column("hit_x_m", "m", hit),
        column("hit_y_m", "m", hit),
        column("hit_z_m", "m", hit),
        column("distance_m", "m", "from entry to landing point"),
        column(
            "residual_m",
            "m",
            "distance of the last estimate from the surface seen by the light; -1: never enters the water, -2: left the light's frustum or meets nothing",
        ),
        column(
            "converged",
            "1",
            "1 where the residual is within the tolerance",
        ),
    ]
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;

    #[test]
    fn a_row_holds_direction_and_convergence() {
        let photon = Photon {
            entry_m: Vec3::new(1.0, 0.0, 0.0),
            residual_m: 0.005,
            hit_m: Vec3::new(1.0, -2.0, 0.0),
            distance_m: 2.0,
        };
        let floats: &[f32] = bytemuck::cast_slice(bytemuck::bytes_of(&photon));
        let expected = [
            1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 1.0, -2.0, 0.0, 2.0, 0.005, 1.0,
        ];
        assert_eq!(row(floats, 0.01), expected);
        assert_eq!(row(floats, 0.001)[11], 0.0);
        assert_eq!(columns().len(), expected.len());
    }

    #[test]
    fn a_photon_beside_the_water_has_no_direction_and_is_not_converged() {
        let photon = Photon {
            entry_m: Vec3::ONE,
            residual_m: MISSED,
            hit_m: Vec3::ONE,
            distance_m: 0.0,
        };
        let floats: &[f32] = bytemuck::cast_slice(bytemuck::bytes_of(&photon));
        assert_eq!(row(floats, 0.01)[3..6], [0.0; 3]);
        assert_eq!(row(floats, 0.01)[11], 0.0);
    }
}
