//! Parameters of the underwater pipeline, their defaults with sources, and their ranges.

use glam::Vec2;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::scene::{Camera, Light, SceneFile, Water};
use crate::stages::low_pass::FilterUniforms;
use crate::stages::photon::TraceUniforms;

/// Everything that can be set. The dotted paths of `--set` are these fields' names.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Params {
    pub view: Viewport,
    pub camera: Camera,
    pub light: Light,
    pub water: Water,
    /// Depth of the scene's floor under the resting water, metres.
    pub floor_depth_m: f64,
    pub shadow: ShadowMap,
    pub surface: Surface,
    pub caustics: Caustics,
    pub godrays: Godrays,
    pub compose: Composition,
}

/// Pixels of the main viewport. UW §4.1: 800 × 800.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Viewport {
    pub width: u32,
    pub height: u32,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ShadowMap {
    /// Texels per side. UW gives none; 1024 resolves 1 cm in a 10 m scene.
    pub size: u32,
    /// Step of depth between neighbouring texels that counts as an edge, metres: across it the estimator does
    /// not interpolate. Tuned on scene tank.
    pub edge_m: f64,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Surface {
    /// Size of the reflection and refraction buffers relative to the viewport.
    pub scale: f64,
    /// Quads per side of the grid that draws the water.
    pub cells: u32,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Intensity {
    /// The paper's rule: the intensity of a primitive does not depend on its size, and all photons are alike.
    Paper,
    /// Energy divided by the splat's area (the line's width), so that the sum over the buffer is the energy drawn. A point
    /// light's photons are weighted by their solid angle.
    Conserving,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SubdivisionMode {
    /// Loop bound known when the shader is compiled.
    Static,
    /// Loop bound read at run time. UW §4.1: costs up to 50 %.
    Dynamic,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Caustics {
    /// Cells per side of the photon grid. UW §4.1: 200.
    pub grid: u32,
    /// Photons per cell, a square number. UW §4.2: 4.
    pub subdivision: u32,
    pub subdivision_mode: SubdivisionMode,
    /// Place of each photon in its share of the cell, 0 … 1; the middle is 0.5.
    pub offset: [f64; 2],
    /// Iterations of the estimator. UW gives none: errors shrink by about the square of the sine between ray and light
    /// at each, so that 6 reach below a millimetre on smooth floors.
    pub iterations: u32,
    /// First estimate d0 of the path under water, metres. UW gives none.
    pub start_m: f64,
    /// Residual below which a photon counts as converged, metres.
    pub tolerance_m: f64,
    /// Whether photons are tested against the water mask. UW §3 step 2b.
    pub mask: bool,
    /// Pixels of the buffer; 0 × 0 scales it with the viewport by 0.64. UW §4.1: 512 × 512 at 800 × 800.
    pub buffer: [u32; 2],
    /// UW §4.1: 5 and 20 px.
    pub point_size_min_px: f64,
    pub point_size_max_px: f64,
    /// How far splats are drawn towards the camera before the depth test, so that the floor they lie on does not hide
    /// half of them, metres. Tuned on scene tank.
    pub depth_bias_m: f64,
    pub intensity: Intensity,
    pub filter: bool,
    /// UW §3.5 gives neither taps nor radius.
    pub filter_taps: u32,
    pub filter_radius_px: f64,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Godrays {
    /// Cells per side of the photon grid. UW §4.1: 100.
    pub grid: u32,
    pub subdivision: u32,
    pub subdivision_mode: SubdivisionMode,
    pub offset: [f64; 2],
    pub iterations: u32,
    pub start_m: f64,
    pub tolerance_m: f64,
    pub mask: bool,
    /// Pixels of the buffer; 0 × 0 scales it with the viewport by 0.16. UW §4.1: 128 × 128 at 800 × 800.
    pub buffer: [u32; 2],
    /// Width of the lines. UW §4.2 gives 12 px for a 460 × 272 buffer and no default; 2 px leaves shafts apart in a
    /// 128 × 128 buffer. Tuned on scene tank.
    pub line_width_px: f64,
    /// Schlick's k of the phase function. UW gives none; 0.5 scatters forward, yet leaves shafts seen from the side.
    pub phase_k: f64,
    /// Scattering coefficient that scales the composed godrays, 1/m. Tuned on scene tank.
    pub scattering_per_m: f64,
    pub intensity: Intensity,
    pub filter: bool,
    pub filter_taps: u32,
    pub filter_radius_px: f64,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Composition {
    /// Radiance is mapped by 1 − exp(−exposure × radiance).
    pub exposure: f64,
    /// Taps of the optional screen-space ambient occlusion; 0 turns it off.
    pub occlusion_taps: u32,
    pub occlusion_radius_m: f64,
}

impl Default for Viewport {
    fn default() -> Self {
        Self { width: 800, height: 800 }
    }
}

impl Default for ShadowMap {
    fn default() -> Self {
        Self { size: 1024, edge_m: 0.1 }
    }
}

impl Default for Surface {
    fn default() -> Self {
        Self { scale: 0.5, cells: 128 }
    }
}

impl Default for Caustics {
    fn default() -> Self {
        Self {
            grid: 200,
            subdivision: 4,
            subdivision_mode: SubdivisionMode::Static,
            offset: [0.5, 0.5],
            iterations: 6,
            start_m: 1.0,
            tolerance_m: 0.01,
            mask: true,
            buffer: [0, 0],
            point_size_min_px: 5.0,
            point_size_max_px: 20.0,
            depth_bias_m: 0.3,
            intensity: Intensity::Paper,
            filter: true,
            filter_taps: 16,
            filter_radius_px: 3.0,
        }
    }
}

impl Default for Godrays {
    fn default() -> Self {
        Self {
            grid: 100,
            subdivision: 4,
            subdivision_mode: SubdivisionMode::Static,
            offset: [0.5, 0.5],
            iterations: 6,
            start_m: 1.0,
            tolerance_m: 0.01,
            mask: true,
            buffer: [0, 0],
            line_width_px: 2.0,
            phase_k: 0.5,
            scattering_per_m: 0.2,
            intensity: Intensity::Paper,
            filter: true,
            filter_taps: 16,
            filter_radius_px: 1.5,
        }
    }
}

impl Default for Composition {
    fn default() -> Self {
        Self { exposure: 1.0, occlusion_taps: 0, occlusion_radius_m: 0.5 }
    }
}

/// The photon-grid part that caustics and godrays share.
#[derive(Clone, Debug, PartialEq)]
pub struct PhotonGrid {
    pub grid: u32,
    pub subdivision: u32,
    pub mode: SubdivisionMode,
    pub offset: [f64; 2],
    pub iterations: u32,
    pub start_m: f64,
    pub tolerance_m: f64,
    pub mask: bool,
}

impl PhotonGrid {
    pub fn photons(&self) -> u64 {
        u64::from(self.grid) * u64::from(self.grid) * u64::from(self.subdivision)
    }

    /// Photons per side of a cell.
    pub fn side(&self) -> u32 {
        self.subdivision.isqrt()
    }

    pub fn is_dynamic(&self) -> bool {
        self.mode == SubdivisionMode::Dynamic
    }

    pub fn uniforms(&self) -> TraceUniforms {
        TraceUniforms {
            grid: self.grid,
            side: self.side(),
            iterations: self.iterations,
            masked: u32::from(self.mask),
            offset: Vec2::new(self.offset[0] as f32, self.offset[1] as f32),
            start_m: self.start_m as f32,
            tolerance_m: self.tolerance_m as f32,
        }
    }

    fn validate(&self, name: &str) -> Result<(), String> {
        within(name, "grid", f64::from(self.grid), 1.0, 16384.0)?;
        let side = self.side();
        if side == 0 || side * side != self.subdivision {
            return Err(format!(
                "{name}.subdivision is {}: it must be a square number (1, 4, 9, 16 …)",
                self.subdivision
            ));
        }
        within(name, "subdivision", f64::from(self.subdivision), 1.0, 256.0)?;
        within(name, "iterations", f64::from(self.iterations), 1.0, 1000.0)?;
        within(name, "start_m", self.start_m, 0.0, 1e4)?;
        if self.photons() > u64::from(u32::MAX / 8) {
            return Err(format!(
                "{name}.grid² × {name}.subdivision is {}: more photons than can be indexed",
                self.photons()
            ));
        }
        self.offset.iter().try_for_each(|&o| within(name, "offset", o, 0.0, 1.0))
    }
}

fn within(group: &str, name: &str, value: f64, low: f64, high: f64) -> Result<(), String> {
    if (low..=high).contains(&value) {
        Ok(())
    } else {
        Err(format!("{group}.{name} is {value}: it must lie within {low} … {high}"))
    }
}

macro_rules! shared_settings {
    ($group:ty, $scale:expr) => {
        impl $group {
            pub fn grid_settings(&self) -> PhotonGrid {
                PhotonGrid {
                    grid: self.grid,
                    subdivision: self.subdivision,
                    mode: self.subdivision_mode,
                    offset: self.offset,
                    iterations: self.iterations,
                    start_m: self.start_m,
                    tolerance_m: self.tolerance_m,
                    mask: self.mask,
                }
            }

            pub fn filter_uniforms(&self) -> FilterUniforms {
                FilterUniforms { taps: self.filter_taps, radius_px: self.filter_radius_px as f32 }
            }

            /// Pixels of the buffer: as set, or scaled with the viewport.
            fn buffer_size(&self, view: &Viewport) -> [u32; 2] {
                match self.buffer {
                    [0, 0] => [view.width, view.height]
                        .map(|side| ((f64::from(side) * $scale).round() as u32).max(1)),
                    size => size,
                }
            }

            fn validate(&self, name: &str) -> Result<(), String> {
                self.grid_settings().validate(name)?;
                if (self.buffer[0] == 0) != (self.buffer[1] == 0) {
                    return Err(format!(
                        "{name}.buffer is {:?}: both sides must be set, or none",
                        self.buffer
                    ));
                }
                within(name, "tolerance_m", self.tolerance_m, 0.0, 1e3)?;
                within(name, "filter_taps", f64::from(self.filter_taps), 1.0, 1024.0)?;
                within(name, "filter_radius_px", self.filter_radius_px, 0.0, 256.0)
            }
        }
    };
}

// Scale factors of the buffers to the viewport: UW §4.1 (512 / 800 and 128 / 800).
shared_settings!(Caustics, 0.64);
shared_settings!(Godrays, 0.16);

impl Params {
    /// Defaults with what the scene file says of camera, light, water and floor.
    pub fn from_scene(file: &SceneFile) -> Self {
        Self {
            view: Viewport::default(),
            camera: file.camera.clone(),
            light: file.light.clone(),
            water: file.water.clone(),
            floor_depth_m: file.floor_depth_m,
            shadow: ShadowMap::default(),
            surface: Surface::default(),
            caustics: Caustics::default(),
            godrays: Godrays::default(),
            compose: Composition::default(),
        }
    }

    pub fn to_value(&self) -> Value {
        serde_json::to_value(self).expect("parameters are plain numbers and names")
    }

    /// Reads and checks a parameter tree.
    ///
    /// # Errors
    /// One line naming the parameter and its range.
    pub fn from_value(value: &Value) -> Result<Self, String> {
        let params: Self = serde_path_to_error::deserialize(value)
            .map_err(|error| format!("{}: {}", error.path(), error.inner()))?;
        params.validate()?;
        Ok(params)
    }

    fn validate(&self) -> Result<(), String> {
        self.camera.validate()?;
        self.light.validate()?;
        self.water.validate()?;
        within("view", "width", f64::from(self.view.width), 1.0, 1e6)?;
        within("view", "height", f64::from(self.view.height), 1.0, 1e6)?;
        within("shadow", "size", f64::from(self.shadow.size), 1.0, 1e6)?;
        within("shadow", "edge_m", self.shadow.edge_m, 0.0, 1e4)?;
        within("surface", "scale", self.surface.scale, 0.01, 4.0)?;
        within("surface", "cells", f64::from(self.surface.cells), 1.0, 8192.0)?;
        self.caustics.validate("caustics")?;
        let sizes = (self.caustics.point_size_min_px, self.caustics.point_size_max_px);
        within("caustics", "point_size_min_px", sizes.0, 0.1, 1024.0)?;
        within("caustics", "point_size_max_px", sizes.1, sizes.0, 1024.0)?;
        within("caustics", "depth_bias_m", self.caustics.depth_bias_m, 0.0, 100.0)?;
        self.godrays.validate("godrays")?;
        within("godrays", "line_width_px", self.godrays.line_width_px, 0.1, 1024.0)?;
        within("godrays", "phase_k", self.godrays.phase_k, -0.99, 0.99)?;
        within("godrays", "scattering_per_m", self.godrays.scattering_per_m, 0.0, 1e3)?;
        within("compose", "exposure", self.compose.exposure, 0.0, 1e6)?;
        within("compose", "occlusion_taps", f64::from(self.compose.occlusion_taps), 0.0, 256.0)?;
        within("compose", "occlusion_radius_m", self.compose.occlusion_radius_m, 1e-3, 1e3)
    }

    pub fn caustics_buffer(&self) -> [u32; 2] {
        self.caustics.buffer_size(&self.view)
    }

    pub fn godrays_buffer(&self) -> [u32; 2] {
        self.godrays.buffer_size(&self.view)
    }
}
