//! Photons in GPU memory, and the dispatch that `caustics/trace` and `godrays/trace` share.

use bytemuck::{Pod, Zeroable};
use encase::ShaderType;
use glam::{DVec3, Vec2};

use super::frame::{Shared, View};
use super::kit::{self, Bind, Group, Resources};
use super::{Column, Output, OutputData};
use crate::gpu::{GpuError, StageScope};
use crate::record::Work;
use crate::scene::LightKind;

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

/// How much of its share of the light's flux a photon carries under water: host twin of `angular_weight` and `entered`
/// in `shaders/shared/photon.wgsl`.
#[derive(Clone, Debug, PartialEq)]
pub struct PhotonEnergy {
    kind: LightKind,
    position: DVec3,
    forward: DVec3,
    refractive_index: f64,
    fresnel: bool,
    /// Photons are weighted by solid angle, as `conserving` intensity has it.
    solid_angle: bool,
}

impl PhotonEnergy {
    /// Of a view's light and water, with the paper's rule that all photons are alike.
    pub fn new(view: &View) -> Self {
        let frame = view.light_frame();
        Self {
            kind: frame.kind,
            position: frame.position,
            forward: frame.forward,
            refractive_index: view.water.refractive_index,
            fresnel: view.water.fresnel,
            solid_angle: false,
        }
    }

    /// 0 for a photon that never enters the water.
    pub fn weight(&self, photon: &Photon) -> f64 {
        if photon.residual_m == MISSED {
            return 0.0;
        }
        let entry = photon.entry_m.as_dvec3();
        let incident = match self.kind {
            LightKind::Directional => self.forward,
            LightKind::Point => (entry - self.position).normalize_or(self.forward),
        };
        let cosine = incident.dot(self.forward);
        let solid_angle =
            if self.solid_angle && self.kind == LightKind::Point { cosine.powi(3) } else { 1.0 };
        solid_angle * self.transmittance(incident, direction(photon))
    }

    /// Fresnel's for unpolarised light, from the directions alone: the normal lies along incident − n · refracted.
    fn transmittance(&self, incident: DVec3, refracted: DVec3) -> f64 {
        let n = self.refractive_index;
        let normal = (incident - n * refracted).normalize_or_zero();
        if !self.fresnel || n - 1.0 < 1e-4 || refracted == DVec3::ZERO {
            return 1.0;
        }
        let (cos_i, cos_t) = (incident.dot(normal).abs(), refracted.dot(normal).abs());
        let s = (cos_i - n * cos_t) / (cos_i + n * cos_t);
        let p = (n * cos_i - cos_t) / (n * cos_i + cos_t);
        1.0 - 0.5 * (s * s + p * p)
    }
}

/// Unit direction from entry to hit; 0 where the two are one.
fn direction(photon: &Photon) -> DVec3 {
    (photon.hit_m.as_dvec3() - photon.entry_m.as_dvec3()).normalize_or_zero()
}

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
        Self { buffer: resources.storage(label, Self::bytes(u64::from(count))), count }
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
    energy: PhotonEnergy,
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
        let shader = gpu.shader(name, &[("SIDE", side), shared.water_def()])?;
        let uniforms = resources.uniform(name, &settings);
        let photons = Photons::new(resources, name, settings.photons());
        let texels = gpu
            .device
            .create_sampler(&wgpu::SamplerDescriptor { label: Some(name), ..Default::default() });
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
            energy: shared.photon_energy().clone(),
            photons,
        })
    }

    /// The same with weights in its output that follow the rule of what draws the photons.
    #[must_use]
    pub fn weighted(mut self, conserving: bool) -> Self {
        self.energy.solid_angle = conserving;
        self
    }

    /// Moves the photons within their shares of the cells; `offset` in 0…1, the middle is 0.5.
    pub fn set_offset(&self, queue: &wgpu::Queue, offset: Vec2) {
        let settings = TraceUniforms { offset, ..self.settings.clone() };
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
                    let (energy, tolerance_m) = (self.energy.clone(), self.settings.tolerance_m);
                    move |floats| row(floats, &energy, tolerance_m)
                }),
            },
        }]
    }
}

/// The columns of a stored photon: entry, direction, hit, distance, residual, converged, weight.
fn row(stored: &[f32], energy: &PhotonEnergy, tolerance_m: f32) -> Vec<f32> {
    let photon: &Photon = bytemuck::from_bytes(bytemuck::cast_slice(stored));
    let converged = (0.0..=tolerance_m).contains(&photon.residual_m);
    let mut row = Vec::with_capacity(13);
    for place in [photon.entry_m, direction(photon).as_vec3(), photon.hit_m] {
        row.extend(place.to_array());
    }
    row.extend([
        photon.distance_m,
        photon.residual_m,
        f32::from(u8::from(converged)),
        energy.weight(photon) as f32,
    ]);
    row
}

fn columns() -> Vec<Column> {
    let column = |name, unit, meaning| Column { name, unit, meaning };
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
        column("converged", "1", "1 where the residual is within the tolerance"),
        column(
            "weight",
            "1",
            "share of photons.flux_w that enters the water with this photon; 0: never enters the water",
        ),
    ]
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;

    fn energy(fresnel: bool) -> PhotonEnergy {
        PhotonEnergy {
            kind: LightKind::Point,
            position: DVec3::new(1.0, 4.0, 0.0),
            forward: DVec3::NEG_Y,
            refractive_index: 1.33,
            fresnel,
            solid_angle: false,
        }
    }

    fn columns_of(photon: &Photon, energy: &PhotonEnergy, tolerance_m: f32) -> Vec<f32> {
        row(bytemuck::cast_slice(bytemuck::bytes_of(photon)), energy, tolerance_m)
    }

    #[test]
    fn a_row_holds_direction_convergence_and_weight() {
        let photon = Photon {
            entry_m: Vec3::new(1.0, 0.0, 0.0),
            residual_m: 0.005,
            hit_m: Vec3::new(1.0, -2.0, 0.0),
            distance_m: 2.0,
        };
        let expected = [1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 1.0, -2.0, 0.0, 2.0, 0.005, 1.0, 1.0];
        assert_eq!(columns_of(&photon, &energy(false), 0.01), expected);
        assert_eq!(columns_of(&photon, &energy(false), 0.001)[11], 0.0);
        assert_eq!(columns().len(), expected.len());
        let straight = f64::from(columns_of(&photon, &energy(true), 0.01)[12]);
        assert!((straight - (1.0 - (0.33f64 / 2.33).powi(2))).abs() < 1e-6);
    }

    #[test]
    fn a_slanted_photon_weighs_its_solid_angle_where_energy_is_conserved() {
        let entry = DVec3::new(4.0, 0.0, 0.0);
        let sin_t = 0.6 / 1.33;
        let down = DVec3::new(sin_t, -(1.0 - sin_t * sin_t).sqrt(), 0.0);
        let photon = Photon {
            entry_m: entry.as_vec3(),
            residual_m: 0.0,
            hit_m: (entry + down * 2.0).as_vec3(),
            distance_m: 2.0,
        };
        let conserving = PhotonEnergy { solid_angle: true, ..energy(false) };
        assert!((conserving.weight(&photon) - 0.8f64.powi(3)).abs() < 1e-9);
        assert_eq!(energy(false).weight(&photon), 1.0);
    }

    #[test]
    fn a_photon_beside_the_water_has_no_direction_or_weight_and_is_not_converged() {
        let photon =
            Photon { entry_m: Vec3::ONE, residual_m: MISSED, hit_m: Vec3::ONE, distance_m: 0.0 };
        let row = columns_of(&photon, &energy(true), 0.01);
        assert_eq!(row[3..6], [0.0; 3]);
        assert_eq!(row[11..], [0.0; 2]);
    }
}
