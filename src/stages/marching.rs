//! What `ao/march` and `ao/query` share: rays marched through a volume for the occlusion of surface points. VAO §3, §5.

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::slices::{Slice, most_turns, slices};
use super::voxels::Voxels;
use crate::prelude::*;
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

fathom_base::choices!(Attenuation);

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Estimator {
    /// Mean of ρ over cosine-distributed directions: Eq. 1 without bias.
    Unbiased,
    /// Mean of (n·r) ρ over directions uniform in the hemisphere: VAO §3 step 3c, half of Eq. 1.
    Paper,
}

fathom_base::choices!(Estimator);

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
}

fathom_base::choices!(Guard);

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Step {
    /// r_max / N_samples: VAO §5.1.
    Paper,
    /// A number of voxels, as often as r_max holds it.
    Voxel,
}

fathom_base::choices!(Step);

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Sampling {
    /// Every ray on its own.
    Random,
    /// A golden-ratio lattice, shifted by a hash of the pixel.
    Stratified,
}

fathom_base::choices!(Sampling);

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Storage {
    /// R8 texture, filtered by the sampler.
    Texture,
    /// One bit a voxel, filtered by hand.
    Bits,
}

fathom_base::choices!(Storage);

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Occluder {
    /// The first sample above the threshold blocks the ray: VAO §5.1.
    Binary,
    /// Samples are opacities and are gathered along the ray: Eq. 7 with Eq. 4's rejection, no ρ.
    Opacity,
}

fathom_base::choices!(Occluder);

/// Where a hit is taken to lie.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Hit {
    /// At the sample that exceeds the threshold: VAO §5.1.
    Sample,
    /// Where V, taken as linear between that sample and the one before, crosses the threshold.
    Between,
    /// The same between fifths of a step, wherever V can exceed the threshold within the step: a wall one voxel thick exceeds
    /// a high threshold over less than a step.
    Peak,
}

fathom_base::choices!(Hit);

/// How rays are marched.
#[derive(Clone, Debug, PartialEq)]
pub struct Marching {
    /// N_dir.
    pub rays: u32,
    /// N_samples; it sets the step of [`Step::Paper`].
    pub samples: u32,
    /// Step of [`Step::Voxel`], voxels.
    pub step_voxels: f64,
    pub r_max_m: f64,
    /// V_thres. Above 1 no sample ends a ray.
    pub threshold: f64,
    /// Draws other directions at every pixel; 0 and up.
    pub seed: u32,
    /// From the surface along its normal to where rays begin, voxels.
    pub offset_voxels: f64,
    pub attenuation: Attenuation,
    pub estimator: Estimator,
    pub guard: Guard,
    /// Whether each ray's samples are moved along it by a random share of a step.
    pub jitter: bool,
    pub step: Step,
    pub sampling: Sampling,
    pub storage: Storage,
    pub skipping: bool,
    pub occluder: Occluder,
    pub hit: Hit,
}

shader_struct! {
    /// `March` in `shaders/shared/marching.wgsl`.
    pub struct MarchUniforms {
        pub r_max: f32,
        pub step: f32,
        pub guard: f32,
        pub offset: f32,
        pub threshold: f32,
        pub rays: u32,
        pub seed: u32,
    }
}

/// Parts of a step that the shader samples V at in turns of a loop: `PARTS` in `shaders/shared/marching.wgsl`.
const PARTS: u64 = 4;

impl Guard {
    /// Length of the guard in voxels: along the ray, or above the plane for [`Guard::Variable`].
    pub fn voxels(self) -> f64 {
        match self {
            Guard::None => 0.0,
            Guard::Voxel => 3f64.sqrt(),
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
    pub fn step_in(&self, grid: &Grid) -> f64 {
        match self.step {
            Step::Paper => self.r_max_voxels(grid) / f64::from(self.samples),
            Step::Voxel => self.step_voxels,
        }
    }

    /// Samples of a ray at most: the part of it that lies within the grid is no longer than the grid's diagonal.
    pub fn samples_in(&self, grid: &Grid) -> f64 {
        let diagonal = DVec3::from(grid.cells.map(f64::from)).length();
        (self.r_max_voxels(grid).min(diagonal) / self.step_in(grid)).ceil()
    }

    /// Turns of the shader's loops for a ray at most, the ones that find a loop's end included.
    pub fn turns_of_ray(&self, grid: &Grid) -> u64 {
        // Rounding of the ray's ends may add a sample.
        let samples = self.samples_in(grid) as u64 + 1;
        let within = if self.hit == Hit::Peak { samples.saturating_mul(PARTS) } else { 0 };
        1 + (samples + 1).saturating_add(within)
    }

    pub fn uniforms(&self, grid: &Grid) -> MarchUniforms {
        MarchUniforms {
            r_max: self.r_max_voxels(grid) as f32,
            step: self.step_in(grid) as f32,
            guard: self.guard.voxels() as f32,
            offset: self.offset_voxels as f32,
            threshold: self.threshold as f32,
            rays: self.rays,
            seed: self.seed,
        }
    }

    /// The definitions that choose the shader's code.
    pub fn defs(&self) -> Vec<(&'static str, i32)> {
        let chosen = [
            ("UNIFORM", self.estimator == Estimator::Paper),
            ("RANDOM", self.sampling == Sampling::Random),
            ("HARD", self.attenuation == Attenuation::Hard),
            ("GUARD", self.guard == Guard::Variable),
            ("BITS", self.storage == Storage::Bits),
            ("SKIPPING", self.skipping),
            ("OPACITY", self.occluder == Occluder::Opacity),
            ("BETWEEN", self.hit != Hit::Sample),
            ("PEAK", self.hit == Hit::Peak),
            ("JITTER", self.jitter),
        ];
        chosen.map(|(name, on)| (name, i32::from(on))).to_vec()
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
            let of_ray = self.turns_of_ray(&voxels.grid);
            let slices = slices(self.rays, of_ray, 0);
            resources.turns("samples of a ray", most_turns(&slices, of_ray, 0));
            slices
        };
        let slices: Vec<Vec<Slice>> = volumes.iter().map(of_volume).collect();
        let sliced = slices.iter().any(|slices| slices.len() > 1);
        let groups = |(voxels, slices): (&Voxels, Vec<Slice>)| -> Vec<Group> {
            // A pass of a screen goes through all volumes, so that each needs its own.
            let sums = sliced.then(|| resources.storage("sums over rays", points * 4));
            let uniforms = resources.uniform("marching", &self.uniforms(&voxels.grid));
            let sampler = resources.linear_sampler("marching");
            let group = |slice: &Slice| {
                let slice = sliced.then(|| resources.loop_settings("marching", slice));
                let Voxels { uniforms: grid, texture, bits, .. } = voxels;
                Group::new(&[&uniforms, grid, texture, &sampler, bits]).and(&slice).and(&sums)
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
    pub volumes: Vec<Vec<Group>>,
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
    use fathom_embedded::{Folders, SHADERS};
    use fathom_gpu::link;

    fn marching() -> Marching {
        Marching {
            rays: 4,
            samples: 8,
            step_voxels: 0.5,
            r_max_m: 1.0,
            threshold: 0.5,
            seed: 0,
            offset_voxels: 0.0,
            attenuation: Attenuation::Linear,
            estimator: Estimator::Unbiased,
            guard: Guard::Variable,
            jitter: false,
            step: Step::Paper,
            sampling: Sampling::Stratified,
            storage: Storage::Texture,
            skipping: false,
            occluder: Occluder::Binary,
            hit: Hit::Sample,
        }
    }

    #[test]
    fn steps_are_r_max_by_samples_or_voxels() {
        let grid = Grid::around(DVec3::ZERO, 3.2, 32).unwrap();
        let mut marching = marching();
        assert!((marching.step_in(&grid) - 1.25).abs() < 1e-12);
        assert_eq!(marching.samples_in(&grid), 8.0);
        marching.step = Step::Voxel;
        assert_eq!(marching.step_in(&grid), 0.5);
        assert_eq!(marching.samples_in(&grid), 20.0);
    }

    #[test]
    fn a_ray_longer_than_the_grid_samples_only_what_lies_within() {
        let grid = Grid::around(DVec3::ZERO, 3.2, 32).unwrap();
        let mut marching = marching();
        marching.step = Step::Voxel;
        marching.r_max_m = 1e4;
        // 32 √3 = 55.4 voxels, two samples each.
        assert_eq!(marching.samples_in(&grid), 111.0);
        marching.step = Step::Paper;
        assert_eq!(marching.samples_in(&grid), 1.0);
    }

    #[test]
    fn every_definition_links_on_its_own() {
        let names = marching().defs().into_iter().map(|(name, _)| name);
        for name in names.chain(["COUNT", "SLICED"]) {
            for value in [0, 1] {
                for shader in ["ao/march", "ao/query"] {
                    link(&Folders::of(SHADERS), shader, &[(name, value)])
                        .unwrap_or_else(|e| panic!("{name}: {e}"));
                }
            }
        }
    }
}
