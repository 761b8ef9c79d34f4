//! What `ao/march` and `ao/query` share: rays marched through a volume for the occlusion of surface points. VAO §3, §5.

use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::prelude::*;
use crate::slices::{Slice, loop_bound, slices};
use crate::voxels::Voxels;
use fathom_base::{choices, settings};
use fathom_scene::Grid;

/// ρ(d) on (0, r_max]. VAO Eq. 1 leaves it open.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Attenuation {
    /// 1 − d / r_max.
    Linear,
    /// 1.
    Hard,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Estimator {
    /// Mean of ρ over cosine-distributed directions: Eq. 1 without bias.
    Unbiased,
    /// Mean of (n·r) ρ over directions uniform in the hemisphere: VAO §3 step 3c, half of Eq. 1.
    Paper,
    /// Twice that: the paper's directions, and Eq. 1 without bias.
    Uniform,
}

/// Where the first sample of a ray lies. VAO §5.1, Fig. 3.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Guard {
    /// At the surface: Fig. 3a.
    None,
    /// A voxel's diagonal along the ray: Fig. 3b.
    Voxel,
    /// Seven voxels along the ray: Fig. 3c.
    SevenVoxels,
    /// Half a voxel's diagonal above the surface's plane: Eq. 2 with h = s_v √3 / 2, Fig. 3d.
    Variable,
    /// A whole one: h_max = s_v √3, the worst case of §5.1.
    VariableDiagonal,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StepLength {
    /// r_max / N_samples: VAO §5.1.
    Paper,
    /// A number of voxels, as often as r_max holds it.
    Voxel,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Sampling {
    /// Every ray on its own.
    Random,
    /// A golden-ratio lattice, shifted by a hash of the pixel.
    Stratified,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Occluder {
    /// The first sample above the threshold blocks the ray: VAO §5.1.
    Binary,
    /// Samples are opacities and are gathered along the ray: Eq. 7 with Eq. 4's rejection, no ρ.
    Opacity,
}

/// Where a hit is taken to lie.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum HitPoint {
    /// At the sample that exceeds the threshold: VAO §5.1.
    Sample,
    /// Where V, taken as linear between fifths of a step, crosses the threshold. They are sampled wherever V can exceed the threshold
    /// within the step: a wall one voxel thick exceeds a high threshold over less than a step.
    Peak,
}

choices!(Attenuation, Estimator, Guard, StepLength, Sampling, Occluder, HitPoint);

/// Default of r_max over the scene's longest side. VAO gives none; tuned on scenes bunny_dry, dragon_dry and sponza.
pub const R_MAX_SHARE: f64 = 0.25;

settings! {
    /// How rays are marched from surface points. Stages take it with the distance that rays reach: `r_max_m` is not 0.
    pub struct Marching {
        /// N_dir. With 8 samples each, 50 rays take the 400 samples of VAO Fig. 8.
        rays: u32 = 50 => 1 ..= 65536, "1";
        /// N_samples where `step` is `paper`. VAO §6.3: 8 to 12.
        samples: u32 = 8 => 1 ..= 65536, "1";
        /// Distance up to which geometry occludes; 0: `r_max_share`.
        r_max_m: f64 = 0.0 => 0.0 ..= 1e4, "m";
        /// The same as a share of the scene's longest side.
        r_max_share: f64 = R_MAX_SHARE => 1e-3 ..= 4.0, "1";
        /// How occluders weigh by their distance.
        attenuation: Attenuation = Attenuation::Linear;
        /// What the rays' mean estimates.
        estimator: Estimator = Estimator::Unbiased;
        /// V_thres. VAO §6.5: 0.2 to 0.8, for volumes from slicemaps. The default is for the thicker shells of `voxel.method`
        /// overlap, which leave no gap at any slant. It was chosen from the map of errors, by the worst orientation and scene:
        /// docs/volume-ao.md.
        /// Above 1 no sample ends a ray: each takes all its samples, as memory is measured by.
        threshold: f64 = 0.9 => 0.01 ..= 2.0, "1";
        /// Where the first sample of a ray lies.
        guard: Guard = Guard::Variable;
        /// Whether each ray's samples are moved along it by a random share of a step, which turns bands into noise. VAO §5.2.3.
        jitter: bool = false;
        /// What the step follows.
        step: StepLength = StepLength::Voxel;
        /// Step where `step` is `voxel`. At more than one, rays pass through walls of one voxel. The default was chosen from the map of
        /// errors, by the worst orientation and scene: docs/volume-ao.md.
        step_voxels: f64 = 1.0 => 0.01 ..= 100.0, "voxels";
        /// How far along its normal a surface's rays begin. It keeps coarse or curved surfaces from
        /// occluding themselves at low thresholds. VAO has none: 0. The default was chosen from the map of errors, by the worst
        /// orientation and scene: docs/volume-ao.md.
        offset_voxels: f64 = 0.1 => 0.0 ..= 100.0, "voxels";
        /// How far look-ups of the volume are moved along each of its axes: VAO §6.1's small offset to the texture indexing, whose length
        /// and direction are not told.
        shift_voxels: f64 = 0.0 => -1.0 ..= 1.0, "voxels";
        /// Where a hit is taken to lie. The default was chosen from the map of errors, by the worst orientation and scene:
        /// docs/volume-ao.md.
        hit: HitPoint = HitPoint::Peak;
        /// How directions are drawn.
        sampling: Sampling = Sampling::Stratified;
        /// Draws other directions at every pixel.
        seed: u32 = 0 => 0 ..= 4_294_967_295u32, "1";
        /// Whether rays leave empty cells of an occupancy pyramid in one go. VAO §6.3.
        skipping: bool = false;
        /// What a sample above the threshold does.
        occluder: Occluder = Occluder::Binary;
        /// Size of the occlusion buffer relative to the viewport. VAO §6.2: ½ in Fig. 11.
        scale: f64 = 1.0 => 0.05 ..= 1.0, "1";
        /// Whether the buffer is smoothed and brought to the viewport's size.
        filter: bool = true;
    }
}

shader_struct! {
    pub struct MarchUniforms {
        pub r_max: f32,
        pub step: f32,
        /// First sample, or its distance from the surface's plane.
        pub guard: f32,
        /// From the surface along its normal to where rays begin.
        pub offset: f32,
        /// Look-ups of the volume are moved by this along each of its axes.
        pub shift: f32,
        /// Above 1 no sample ends a ray.
        pub threshold: f32,
        pub rays: u32,
        pub seed: u32,
    }
}

/// Samples between two at the ends of a step, each a turn of the loop: `PARTS` − 1 in `shaders/shared/marching.wgsl`.
const BETWEEN: u64 = 4;

impl Guard {
    /// Length of the guard in voxels: along the ray, or above the plane where it varies.
    pub fn voxels(self) -> f64 {
        match self {
            Guard::None => 0.0,
            Guard::Voxel | Guard::VariableDiagonal => 3f64.sqrt(),
            Guard::SevenVoxels => 7.0,
            Guard::Variable => 3f64.sqrt() / 2.0,
        }
    }
}

impl Marching {
    pub fn r_max_voxels(&self, grid: &Grid) -> f64 {
        self.r_max_m / grid.voxel_m
    }

    /// Distance of neighbouring samples of a ray, voxels.
    pub fn step_voxels(&self, grid: &Grid) -> f64 {
        match self.step {
            StepLength::Paper => self.r_max_voxels(grid) / f64::from(self.samples),
            StepLength::Voxel => self.step_voxels,
        }
    }

    /// Samples of a ray at most: the part of it that lies within the grid is no longer than the grid's diagonal.
    pub fn samples_in(&self, grid: &Grid) -> f64 {
        let diagonal = DVec3::from(grid.cells.map(f64::from)).length();
        (self.r_max_voxels(grid).min(diagonal) / self.step_voxels(grid)).ceil()
    }

    /// Turns of the shader's loops for a ray at most, the ones that find a loop's end included.
    pub fn ray_iterations(&self, grid: &Grid) -> u64 {
        // One more lies behind the volume, and rounding of the ray's ends may add another.
        let samples = self.samples_in(grid) as u64 + 2;
        let within = if self.hit == HitPoint::Peak { samples.saturating_mul(BETWEEN) } else { 0 };
        1 + (samples + 1).saturating_add(within)
    }

    pub fn uniforms(&self, grid: &Grid) -> MarchUniforms {
        MarchUniforms {
            r_max: self.r_max_voxels(grid) as f32,
            step: self.step_voxels(grid) as f32,
            guard: self.guard.voxels() as f32,
            offset: self.offset_voxels as f32,
            shift: self.shift_voxels as f32,
            threshold: self.threshold as f32,
            rays: self.rays,
            seed: self.seed,
        }
    }

    /// The definitions that choose the shader's code.
    pub fn defs(&self) -> Vec<(&'static str, i32)> {
        let chosen = [
            ("RANDOM", self.sampling == Sampling::Random),
            ("HARD", self.attenuation == Attenuation::Hard),
            ("GUARD", matches!(self.guard, Guard::Variable | Guard::VariableDiagonal)),
            ("SKIPPING", self.skipping),
            ("OPACITY", self.occluder == Occluder::Opacity),
            ("PEAK", self.hit == HitPoint::Peak),
            ("JITTER", self.jitter),
        ];
        let weight = match self.estimator {
            Estimator::Unbiased => 0,
            Estimator::Paper => 1,
            Estimator::Uniform => 2,
        };
        let chosen = chosen.map(|(name, on)| (name, i32::from(on)));
        [("UNIFORM", weight)].into_iter().chain(chosen).collect()
    }

    /// The passes of the marching stages over so many points.
    ///
    /// # Errors
    /// There is no volume.
    pub fn passes(
        &self,
        resources: &Resources<'_>,
        volumes: &[Voxels],
        points: u64,
    ) -> Result<MarchPasses, GpuError> {
        if volumes.is_empty() {
            return Err(GpuError::Limit("there is no volume to march through".into()));
        }
        let of_volume = |voxels: &Voxels| {
            let of_ray = self.ray_iterations(&voxels.grid);
            let slices = slices(self.rays, of_ray);
            resources.iterations("samples of a ray", loop_bound(&slices, of_ray));
            slices
        };
        let slices: Vec<Vec<Slice>> = volumes.iter().map(of_volume).collect();
        let sliced = slices.iter().any(|slices| slices.len() > 1);
        let groups = |(voxels, slices): (&Voxels, Vec<Slice>)| -> Vec<Bindings> {
            // A pass of a screen goes through all volumes, so that each needs its own.
            let sums = sliced.then(|| resources.storage("sums over rays", points * 4));
            let uniforms = resources.uniform("marching", &self.uniforms(&voxels.grid));
            let sampler = resources.linear_sampler("marching");
            let group = |slice: &Slice| {
                let slice = sliced.then(|| resources.loop_settings("marching", slice));
                let Voxels { uniforms: grid, texture, .. } = voxels;
                Bindings::new(&[&uniforms, grid, texture, &sampler]).and(&slice).and(&sums)
            };
            slices.iter().map(group).collect()
        };
        Ok(MarchPasses { sliced, volumes: volumes.iter().zip(slices).map(groups).collect() })
    }
}

/// Passes of a marching stage: one for each slice of the rays through each volume.
pub struct MarchPasses {
    /// Some volume has several.
    sliced: bool,
    /// Bind group 1 of each volume's passes.
    pub volumes: Vec<Vec<Bindings>>,
}

impl MarchPasses {
    /// What the shader is compiled with beside [`Marching::defs`].
    pub fn def(&self) -> (&'static str, i32) {
        ("SLICED", i32::from(self.sliced))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use fathom_base::embedded::{Folders, SHADERS};
    use fathom_gpu::link;

    fn marching() -> Marching {
        Marching {
            rays: 4,
            step_voxels: 0.5,
            r_max_m: 1.0,
            threshold: 0.5,
            offset_voxels: 0.0,
            step: StepLength::Paper,
            hit: HitPoint::Sample,
            ..Marching::default()
        }
    }

    #[test]
    fn a_ray_longer_than_the_grid_samples_only_what_lies_within() {
        let grid = Grid::around(DVec3::ZERO, 3.2, 32).unwrap();
        let mut marching = marching();
        marching.step = StepLength::Voxel;
        marching.r_max_m = 1e4;
        // 32 √3 = 55.4 voxels, two samples each.
        assert_eq!(marching.samples_in(&grid), 111.0);
        marching.step = StepLength::Paper;
        assert_eq!(marching.samples_in(&grid), 1.0);
    }

    #[test]
    fn every_definition_links_on_its_own() {
        let names = marching().defs().into_iter().map(|(name, _)| name);
        for name in names.chain(["COUNT", "SLICED"]) {
            for value in [0, 1] {
                for shader in ["ao/march", "ao/query"] {
                    link(&Folders::new(SHADERS), shader, &[(name, value)])
                        .unwrap_or_else(|e| panic!("{name}: {e}"));
                }
            }
        }
    }
}
