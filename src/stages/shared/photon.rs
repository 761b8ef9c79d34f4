//! Photons in GPU memory, and the dispatch that `caustics/trace` and `godrays/trace` share.

use bytemuck::{Pod, Zeroable};
use glam::{DVec3, Vec2};
use serde::{Deserialize, Serialize};

use crate::prelude::*;
use crate::uniforms::View;
use fathom_gpu::kit::{Resource, square_workgroups};
use fathom_gpu::{Gpu, MAX_ITERATIONS, read_buffer};
use fathom_scene::LightKind;

pub(crate) const fn info(name: &'static str, source: &'static str) -> StageInfo {
    let about = "photon grid: water intersection, refraction, image-space estimator";
    StageInfo { name, about, source }
}

shader_struct! {
    /// A traced photon.
    #[repr(C)]
    #[derive(Copy, Pod, Zeroable)]
    pub struct Photon {
        /// Where it meets the water.
        pub entry_m: glam::Vec3,
        /// See [`Photon::fate`].
        pub fate: u32,
        /// Where it lands.
        pub hit_m: glam::Vec3,
        /// From entry to hit.
        pub distance_m: f32,
    }
}

/// Fates of photons that have not landed, as in the shader: the upper bit tells them from a residual.
pub const MISSED: u32 = 0x8000_0001;
pub const OUTSIDE: u32 = 0x8000_0002;
pub const STILL_BOUNCING: u32 = 0x8000_0003;

/// What becomes of a photon.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Fate {
    /// It lands so far from what the light sees there.
    Landed { residual_m: f32 },
    /// It never enters the water.
    MissedWater,
    /// It left the light's frustum, or meets nothing.
    LeftLight,
    /// It is still between mirrors or glass after the most bounces.
    StillBouncing,
}

impl Photon {
    pub fn fate(&self) -> Fate {
        match self.fate {
            MISSED => Fate::MissedWater,
            OUTSIDE => Fate::LeftLight,
            STILL_BOUNCING => Fate::StillBouncing,
            bits => Fate::Landed { residual_m: f32::from_bits(bits) },
        }
    }

    /// What dumps hold of its fate: its residual, or a negative number.
    pub fn residual_column(&self) -> f32 {
        match self.fate() {
            Fate::Landed { residual_m } => residual_m,
            Fate::MissedWater => -1.0,
            Fate::LeftLight => -2.0,
            Fate::StillBouncing => -3.0,
        }
    }

    pub fn has_landed(&self) -> bool {
        matches!(self.fate(), Fate::Landed { .. })
    }

    pub fn entry(&self) -> DVec3 {
        self.entry_m.as_dvec3()
    }

    pub fn hit(&self) -> DVec3 {
        self.hit_m.as_dvec3()
    }
}

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
    /// Of a view's light and water, by the rule of `conserving` intensity, or by the paper's, that all photons are alike.
    pub fn new(view: &View, solid_angle: bool) -> Self {
        let frame = view.light_frame();
        Self {
            kind: frame.kind,
            position: frame.position,
            forward: frame.forward,
            refractive_index: view.water.refractive_index,
            fresnel: view.water.fresnel,
            solid_angle,
        }
    }

    /// 0 for a photon that never enters the water.
    pub fn weight(&self, photon: &Photon) -> f64 {
        if photon.fate() == Fate::MissedWater {
            return 0.0;
        }
        let entry = photon.entry();
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
    (photon.hit() - photon.entry()).normalize_or_zero()
}

/// Cells per side of a workgroup, as in the shaders.
const WORKGROUP: u32 = 8;

/// A buffer of photons and how many it holds.
#[derive(Clone)]
pub struct Photons {
    pub buffer: Buffer,
    pub count: u32,
    /// Entries of each ray, one after the other.
    pub per_ray: u32,
}

impl Photons {
    pub fn bytes(count: u64) -> u64 {
        count * size_of::<Photon>() as u64
    }

    pub fn new(resources: &Resources<'_>, label: &str, count: u32) -> Self {
        Self::of_rays(resources, label, count, 1)
    }

    /// Room for `per_ray` entries of each of `rays`.
    pub fn of_rays(resources: &Resources<'_>, label: &str, rays: u32, per_ray: u32) -> Self {
        let count = rays.saturating_mul(per_ray);
        Self { buffer: resources.struct_storage::<Photon>(label, count.into()), count, per_ray }
    }

    /// Those of the last frame.
    ///
    /// # Errors
    /// What the GPU reports.
    pub fn read(&self, gpu: &Gpu) -> Result<Vec<Photon>, GpuError> {
        Ok(bytemuck::pod_collect_to_vec(&read_buffer(gpu, &self.buffer)?))
    }
}

impl Bind for Photons {
    fn resource(&self) -> Resource {
        self.buffer.resource()
    }
}

/// How it is found where a photon lands.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PhotonEstimator {
    /// The first crossing of the refracted ray and the light's depth: linear search and regula falsi. In light of any angle.
    Secant,
    /// The iteration of Shah and Konttinen, as in the paper. It diverges in slanted light.
    Paper,
}

fathom_base::choices!(PhotonEstimator);

/// Steps of a search and crossings of a ray that are refined, as many as there is always room for: as in `shaders/shared/estimator.wgsl`.
const MIN_STEPS: u32 = 128;
const MIN_REFINED: u32 = 4;

impl PhotonEstimator {
    /// Turns of loops that a photon has room for at least.
    pub fn min_iterations(self, iterations: u32) -> u32 {
        match self {
            PhotonEstimator::Secant => MIN_STEPS + MIN_REFINED * iterations,
            PhotonEstimator::Paper => iterations,
        }
    }

    /// Places looked up in the light's depth for a photon whose way covers `across_px` texels of it, about: the search ends where the
    /// photon lands, and the way's begin and two steps of regula falsi come to it.
    pub fn lookups(self, iterations: u32, across_px: f64, step_px: f64) -> u32 {
        match self {
            PhotonEstimator::Secant => {
                ((across_px / step_px).ceil() as u32).max(1) + iterations.min(2) + 1
            }
            PhotonEstimator::Paper => iterations,
        }
    }
}

shader_struct! {
    pub struct TraceUniforms {
        /// Cells per side of the grid.
        pub grid: u32,
        /// Photons per side of a cell, where the loop bound is a run-time value.
        pub side: u32,
        /// PAPER, or another for the first crossing.
        pub estimator: u32,
        pub iterations: u32,
        /// 1: photons are tested against the water mask.
        pub masked: u32,
        /// Place of a photon within its share of the cell, 0…1; the middle is 0.5.
        pub offset: Vec2,
        /// The paper's first estimate d0 of the distance from the surface.
        pub start_m: f32,
        /// Residual up to which a photon counts as converged; only the host asks.
        pub tolerance_m: f32,
        /// Share of its part of the cell in which a photon is strewn; 0: the grid is regular.
        pub jitter: f32,
        /// Longest step of the search for the first crossing, in texels of the light's depth.
        pub step_px: f32,
        /// Height below which there is nothing.
        pub bottom_m: f32,
        /// Places looked up for a photon, about; only the host asks.
        pub lookups: u32,
        /// Most turns of loops of a search: more than `FEWEST_REFINED` crossings take. [`tracing`] sets it.
        pub search_iterations: u32,
    }
}

impl TraceUniforms {
    pub fn photons(&self) -> u32 {
        self.grid * self.grid * self.side * self.side
    }

    /// With as many turns as steps along the longest path of the light's depth and a refined crossing every second step take, so far as an
    /// invocation has room for them.
    fn with_search(&self, shadow_px: u32, entry: u64) -> Self {
        if self.estimator == PhotonEstimator::Paper as u32 {
            return Self { search_iterations: self.iterations, ..self.clone() };
        }
        let fewest = PhotonEstimator::Secant.min_iterations(self.iterations);
        let diagonal_px = f64::from(shadow_px) * std::f64::consts::SQRT_2;
        let steps = (diagonal_px / f64::from(self.step_px)).ceil() as u32;
        let whole = steps.saturating_add((steps / 2).saturating_mul(self.iterations));
        let side = u64::from(self.side);
        let room = (MAX_ITERATIONS / (side * side)).saturating_sub(entry + 5);
        let search_iterations = fewest.max(whole.min(room as u32));
        Self { search_iterations, ..self.clone() }
    }

    /// Turns of loops of a cell at most, where a photon's entry into the water takes `entry`.
    fn loop_bound(&self, entry: u64) -> u64 {
        let photon = entry + u64::from(self.search_iterations) + 2;
        let side = u64::from(self.side);
        (side * (side * photon + 2)).saturating_add(1)
    }
}

/// What `caustics/trace` and `godrays/trace` are: the stage `info`. `depth` and `mask` are the light's. With `dynamic` the shader takes its
/// loop bound from the settings. With `conserving` the weights in the output follow the rule of what draws the photons.
pub fn tracing(
    resources: &Resources<'_>,
    info: &'static StageInfo,
    shared: &Shared,
    (depth, mask): (&wgpu::Texture, &wgpu::Texture),
    settings: &TraceUniforms,
    dynamic: bool,
    conserving: bool,
) -> Result<Stage<Photons>, GpuError> {
    let name = info.name;
    let settings = &settings.with_search(depth.width(), shared.entry_iterations);
    let iterations = settings.loop_bound(shared.entry_iterations);
    resources.iterations(&format!("{name}, subdivision × iterations"), iterations);
    let side = if dynamic { 0 } else { settings.side as i32 };
    let defs = [("SIDE", side), shared.water_def()];
    let uniforms = resources.uniform(name, settings);
    let photons = Photons::new(resources, name, settings.photons());
    let texels = resources.nearest_sampler(name);
    let groups = [&shared.group, &Bindings::new(&[&uniforms, depth, mask, &photons, &texels])];
    let workgroups = square_workgroups([settings.grid; 2], WORKGROUP);
    let dispatch = Dispatch::new(resources, (name, &defs), &groups, workgroups)?;
    let count = u64::from(photons.count);
    let work = Work {
        photons: count,
        // Four depth texels a place.
        texel_fetches: count * 4 * u64::from(settings.lookups),
        bytes_written: Photons::bytes(count),
        ..Work::default()
    };
    // The search ends where a photon has landed.
    let min_work = Work { texel_fetches: 0, ..work };
    let energy = PhotonEnergy::new(&shared.view, conserving);
    let tolerance_m = settings.tolerance_m;
    let rows = (&*photons.buffer, size_of::<Photon>() / 4, photons.count);
    let row = move |floats: &[f32]| row(floats, &energy, tolerance_m);
    let output = StageDump::rows("photons", "traced photons, cell by cell", columns(), rows, row);
    let stage = Dispatch::stage([dispatch], info, work).with_min_work(min_work);
    Ok(stage.dump(output).with_output(photons))
}

/// The columns of a stored photon: entry, direction, hit, distance, residual, converged, weight.
fn row(stored: &[f32], energy: &PhotonEnergy, tolerance_m: f32) -> Vec<f32> {
    let photon: &Photon = bytemuck::from_bytes(bytemuck::cast_slice(stored));
    let residual_m = photon.residual_column();
    let converged = (0.0..=tolerance_m).contains(&residual_m);
    let mut row = Vec::with_capacity(13);
    for place in [photon.entry_m, direction(photon).as_vec3(), photon.hit_m] {
        row.extend(place.to_array());
    }
    row.extend([
        photon.distance_m,
        residual_m,
        f32::from(u8::from(converged)),
        energy.weight(photon) as f32,
    ]);
    row
}

fn columns() -> Vec<Column> {
    let entry = ["entry_x_m", "entry_y_m", "entry_z_m"];
    let direction = ["direction_x", "direction_y", "direction_z"];
    let refracted = "unit direction after refraction; 0 for a photon that never enters the water";
    let residual = "distance of the landing point from the surface that the light sees there; -1: never enters the water, -2: left the light's frustum or meets nothing";
    let weight =
        "share of photons.flux_w that enters the water with this photon; 0: never enters the water";
    let mut columns = Column::many(entry, "m", "where the photon meets the water");
    columns.extend(Column::many(direction, "1", refracted));
    columns.extend(Column::many(["hit_x_m", "hit_y_m", "hit_z_m"], "m", "where the photon lands"));
    columns.extend([
        Column::new("distance_m", "m", "from entry to landing point"),
        Column::new("residual_m", "m", residual),
        Column::new("converged", "1", "1 where the residual is within the tolerance"),
        Column::new("weight", "1", weight),
    ]);
    columns
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
            fate: 0.005f32.to_bits(),
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
    fn a_photon_beside_the_water_has_no_direction_or_weight_and_is_not_converged() {
        let photon = Photon { entry_m: Vec3::ONE, fate: MISSED, hit_m: Vec3::ONE, distance_m: 0.0 };
        let row = columns_of(&photon, &energy(true), 0.01);
        assert_eq!(row[3..6], [0.0; 3]);
        assert_eq!(row[11..], [0.0; 2]);
    }
}
