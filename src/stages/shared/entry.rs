//! How a ray finds where it enters the water: host twin of `meet_water` in `shaders/shared/photon.wgsl`.

use fathom_scene::{LightFrame, Water, WaterModel, shortest_wave_m};

/// Largest slope of the water times the tangent of the ray's angle to the vertical at which a ray is taken to meet the waves once: its height
/// above them then falls all the way. At 1 a ray can touch a wave a second time.
const NEWTON_SLOPE: f64 = 0.5;
/// Marching steps per wave. A dip between two steps is then followed by a parabola to (2π/16)⁴/384 = 6e-5 of its amplitude.
const STEPS_PER_WAVE: f64 = 16.0;
/// Lattice cells of the finest noise octave in one noise tile (two octaves over 8 cells). Two cells make a wave.
const FINEST_NOISE_CELLS: f64 = 16.0;
const CELLS_PER_WAVE: f64 = 2.0;
/// Room above crests and below troughs, so that a search begins in the air also with rounding.
const BOUND_ROOM: f64 = 1.001;
/// Most steps of a search: 64 of them cross four waves.
const MAX_STEPS: u64 = 64;
/// Loop iterations of a search at most: the rest of [`fathom_gpu::MAX_ITERATIONS`] is for what follows in the same invocation.
const MAX_SEARCH_ITERATIONS: u64 = 40_000;
/// As in the shader.
pub(crate) const REFINEMENTS: u64 = 8;

/// How rays search for the surface of a water.
pub struct EntrySearch {
    pub bound_m: f64,
    /// Horizontal length of a step.
    pub step_m: f64,
    pub steps: u64,
    /// Tangent of the angle to the vertical up to which Newton's method is enough.
    pub newton_slant: f64,
}

impl EntrySearch {
    pub fn new(water: &Water) -> Self {
        Self {
            bound_m: water.bound_m() * BOUND_ROOM,
            step_m: shortest_m(water) / STEPS_PER_WAVE,
            steps: (MAX_SEARCH_ITERATIONS / step_iterations(water)).min(MAX_STEPS),
            newton_slant: (NEWTON_SLOPE / water.steepest()).min(f64::from(f32::MAX)),
        }
    }

    /// Turns of loops for any photon of a light, at most.
    pub fn loop_bound(&self, water: &Water, light: &LightFrame) -> u64 {
        let slant = slant(light);
        let height = 1 + water_iterations(water);
        if slant <= self.newton_slant {
            return 1 + REFINEMENTS * height;
        }
        let steps = (2.0 * self.bound_m * slant / self.step_m).ceil() as u64;
        height + steps.clamp(1, self.steps) * step_iterations(water) + 1 + REFINEMENTS * height + 1
    }
}

/// Turns of loops that a height of the water takes.
pub fn water_iterations(water: &Water) -> u64 {
    match water.model {
        WaterModel::Circular | WaterModel::Directional => 0,
        WaterModel::Waves => water.waves.len() as u64 + 1,
    }
}

/// Two heights of the water: at the step's end, and where the ray is lowest between.
pub(crate) fn step_iterations(water: &Water) -> u64 {
    1 + 2 * water_iterations(water)
}

/// Length of the shortest wave, metres.
fn shortest_m(water: &Water) -> f64 {
    match water.model {
        WaterModel::Waves => shortest_wave_m(&water.waves),
        _ if water.noise == 0.0 => water.wavelength_m,
        _ => water.wavelength_m.min(CELLS_PER_WAVE * water.noise_tile_m / FINEST_NOISE_CELLS),
    }
}

/// Largest tangent to the vertical of a light's rays: at a corner of its frustum.
fn slant(light: &LightFrame) -> f64 {
    let corners = [[-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0], [1.0, 1.0]];
    let tangents = corners.map(|[x, y]| {
        let direction = light.ray(x, y).1;
        direction.x.hypot(direction.z) / (-direction.y).max(f64::MIN_POSITIVE)
    });
    tangents.into_iter().fold(0.0, f64::max)
}
