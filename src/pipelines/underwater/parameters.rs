//! Parameters of the underwater pipeline, their defaults with sources, and their ranges.

use serde::{Deserialize, Serialize};

use super::grid::PhotonGrid;
use crate::Parameters;
use crate::settings::{View, scaled};
use fathom_base::choices;
use fathom_base::parameter::{ParamError, within};
use fathom_base::settings;
use fathom_gpu::StageInfo;
use fathom_scene::{Camera, Light, SceneFile, Water};
use fathom_stages::caustics::splat::SplatCoverage;
use fathom_stages::photon::PhotonEstimator;
use fathom_stages::{caustics, godrays};

settings! {
    /// Everything that can be set. The dotted paths of `--set` are these fields' names.
    pub struct Params from file: SceneFile {
        // UW §4.1: 800 × 800.
        view: View = View { width: 800, height: 800 };
        camera: Camera = file.camera.clone();
        light: Light = file.light.clone();
        water: Water = file.water.clone();
        /// Depth of the scene's floor under the resting water.
        floor_depth_m: f64 = file.floor_depth_m => 0.01 ..= 1000.0, "m";
        shadow: ShadowMap = ShadowMap::default();
        surface: Surface = Surface::default();
        caustics: Caustics = Caustics::default();
        godrays: Godrays = Godrays::default();
        compose: Composition = Composition::default();
    }
}

settings! {
    /// The light's depth, which photons look up.
    pub struct ShadowMap {
        /// Texels per side. UW gives none; 1024 resolves 1 cm in a 10 m scene.
        size: u32 = 1024 => 1 ..= 1_000_000, "px";
        /// Step of depth between neighbouring texels that counts as an edge: across it the estimator does not interpolate.
        /// Tuned on scene tank.
        edge_m: f64 = 0.1 => 0.0 ..= 1e4, "m";
    }
}

settings! {
    /// The water's surface as it is drawn.
    pub struct Surface {
        /// Size of the reflection and refraction buffers relative to the viewport.
        scale: f64 = 0.5 => 0.01 ..= 4.0, "1";
        /// Quads per side of the grid that draws the water.
        cells: u32 = 128 => 1 ..= 8192, "1";
    }
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

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Splatting {
    /// A compute shader adds to fixed-point sums.
    Compute,
    /// The rasterizer draws squares and blends them, as in the paper.
    Raster,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum CausticMethod {
    /// Each photon as a square. UW §3.3.
    Splats,
    /// Neighbouring photons as triangles, with irradiance by the ratio of areas. Nishita and Nakamae 1994, Wallace 2010.
    Mesh,
}

choices!(CausticMethod, Intensity, Splatting, SubdivisionMode);

settings! {
    /// How the picture is made.
    pub struct Composition {
        /// Radiance is mapped by 1 − exp(−exposure × radiance). With 0.4, white in full light of 9.2 W/sr (UW §4.1) is shown at
        /// 85 % and focused light stands above it.
        exposure: f64 = 0.4 => 0.0 ..= 1e6, "1";
        /// Taps of the optional screen-space ambient occlusion; 0 turns it off.
        occlusion_taps: u32 = 0 => 0 ..= 256, "1";
        /// Radius of the taps' disc at the surface.
        occlusion_radius_m: f64 = 0.5 => 1e-3 ..= 1e3, "m";
    }
}

/// What distinguishes the stages of one photon grid from those of another.
pub(super) struct PhotonPath {
    pub(super) grid_sized_by: &'static str,
    pub(super) buffer_sized_by: &'static str,
    pub(super) trace: &'static StageInfo,
    pub(super) grid: PhotonGrid,
    pub(super) conserving: bool,
    pub(super) filter: bool,
}

/// Declares the settings of a photon grid and of how it is drawn. Each grid has its own number of cells, and all have what follows it.
macro_rules! photon_settings {
    (
        $(#[doc = $about:tt])*
        $group:ident of $name:ident, $scale:literal of the viewport;
        { $($grid:tt)* }
        { $($drawn:tt)* }
    ) => {
        settings! {
            $(#[doc = $about])*
            pub struct $group {
                $($grid)*
                /// Photons per cell, a square number. UW §4.2: 4.
                subdivision: u32 = 4 => 1 ..= 256, "1";
                /// How the shader's loop over a cell's photons is bounded.
                subdivision_mode: SubdivisionMode = SubdivisionMode::Static;
                /// Place of each photon in its share of the cell; the middle is 0.5.
                offset: [f64; 2] = [0.5, 0.5] => 0.0 ..= 1.0, "1";
                /// How much of its share of the cell a photon is strewn over at random; with 0 the grid is regular, and shows as a herringbone
                /// pattern on surfaces that the light grazes. Half breaks the pattern with less noise than the whole. Tuned on scene tank.
                jitter: f64 = 0.5 => 0.0 ..= 1.0, "1";
                /// How it is found where a photon lands.
                estimator: PhotonEstimator = PhotonEstimator::Secant;
                /// Iterations of the estimator; 0 chooses them. `secant`: steps of regula falsi at a crossing, 8 by default; the first is exact on
                /// planes. `paper`, which gives none: over a level floor each multiplies the error by sin ρ · sin(θ − ρ) / cos θ, with the light θ
                /// and the ray ρ off the vertical. 0 takes as many as reach 1 mm in the light's frustum, at least 6 and at most 64. Under 72° is
                /// the limit at index 1.33: beyond it the factor is above 1, and no number of iterations converges.
                iterations: u32 = 0 => 0 ..= 1000, "1";
                /// Of `secant`: longest step of the search along the ray, in texels of the light's depth. What is narrower can be passed. Steps
                /// are never longer in cells of up to 144 photons over a light's depth of 1024 texels a side, and of up to 36 over one of 4096.
                step_px: f64 = 4.0 => 0.5 ..= 1024.0, "px";
                /// Of `paper`: first estimate d0 of the path under water. UW gives none.
                start_m: f64 = 1.0 => 0.0 ..= 1e4, "m";
                /// Residual below which a photon counts as converged.
                tolerance_m: f64 = 0.01 => 0.0 ..= 1e3, "m";
                /// Whether photons are tested against the water mask. UW §3 step 2b.
                mask: bool = true;
                $($drawn)*
            }
        }

        impl $group {
            pub fn grid_settings(&self) -> PhotonGrid {
                PhotonGrid {
                    grid: self.grid,
                    subdivision: self.subdivision,
                    mode: self.subdivision_mode,
                    offset: self.offset,
                    jitter: self.jitter,
                    estimator: self.estimator,
                    iterations: self.iterations,
                    step_px: self.step_px,
                    start_m: self.start_m,
                    tolerance_m: self.tolerance_m,
                    mask: self.mask,
                }
            }

            pub(super) fn path(&self) -> PhotonPath {
                PhotonPath {
                    grid_sized_by: concat!(
                        stringify!($name),
                        ".grid × ",
                        stringify!($name),
                        ".subdivision"
                    ),
                    buffer_sized_by: concat!(stringify!($name), ".buffer"),
                    trace: &$name::trace::INFO,
                    grid: self.grid_settings(),
                    conserving: self.photon_intensity() == Intensity::Conserving,
                    filter: self.filter,
                }
            }

            /// Pixels of the buffer: as set, or scaled with the viewport.
            fn buffer_size(&self, view: &View) -> [u32; 2] {
                match self.buffer {
                    [0, 0] => scaled([view.width, view.height], $scale),
                    size => size,
                }
            }

            fn consistent(&self) -> Result<(), ParamError> {
                let name = stringify!($name);
                if (self.buffer[0] == 0) != (self.buffer[1] == 0) {
                    return Err(ParamError::Unfit(format!(
                        "{name}.buffer is {:?}: both sides must be set, or none",
                        self.buffer
                    )));
                }
                self.grid_settings().consistent(name)
            }
        }
    };
}

photon_settings! {
    /// Caustics: a photon grid, drawn as splats. UW §3.3.
    Caustics of caustics, 0.64 of the viewport;
    {
        /// Cells per side of the photon grid. UW §4.1: 200.
        grid: u32 = 200 => 1 ..= 16384, "1";
    }
    {
        /// Pixels of the buffer; 0 × 0 scales it with the viewport by 0.64. UW §4.1: 512 × 512 at 800 × 800.
        buffer: [u32; 2] = [0, 0] => 0 ..= 1_000_000, "px";
        /// What the photons are drawn as. Settings of points, coverage, intensity and splatting are those of splats.
        method: CausticMethod = CausticMethod::Splats;
        /// Longest edge of a drawn triangle of the mesh over its longest edge on the water's surface: a longer one joins different
        /// surfaces. In scene port the image error changes by 1 % from 2 to no limit.
        mesh_stretch: f64 = 8.0 => 1.0 ..= 1e6, "1";
        /// Side of a splat at the far plane. UW §4.1: 5.
        point_size_min_px: f64 = 5.0 => 0.1 ..= 1024.0, "px";
        /// Side of a splat at the near plane, not less than at the far one. UW §4.1: 20.
        point_size_max_px: f64 = 20.0 => 0.1 ..= 1024.0, "px";
        /// Where a splat is drawn. UW's squares lie over silhouettes.
        coverage: SplatCoverage = SplatCoverage::Surface;
        /// How far splats are drawn towards the camera before the depth test, so that the floor they lie on does not hide
        /// half of them; with the coverage `surface` also how far behind a splat its surface may lie. Of a mesh: how far before or behind
        /// it what is seen may lie. Tuned on scene tank.
        depth_bias_m: f64 = 0.3 => 0.0 ..= 100.0, "m";
        /// How much a photon adds.
        intensity: Intensity = Intensity::Paper;
        /// What adds photons up. The sums are the same; which is faster depends on the adapter and on the size of splats. On
        /// lavapipe compute takes 0.4 of the time at 5 px and 0.8 at 20 px.
        splatting: Splatting = Splatting::Compute;
        /// Whether the buffer is smoothed. A mesh has no gaps between photons: the low-pass only softens triangles smaller than a pixel, and
        /// in scene port at 200 × 150 raises the image error of 65,536 photons from 0.24 to 0.33.
        filter: bool = true;
        /// UW §3.5 gives neither taps nor radius.
        filter_taps: u32 = 16 => 1 ..= 1024, "1";
        /// Radius of the disc. Tuned on scene tank: 3 px blur the lines of light.
        filter_radius_px: f64 = 2.0 => 0.0 ..= 256.0, "px";
        /// Taps, and texels of the buffer when the picture is composed, count up to this distance from the pixel's surface along the
        /// view, as a share of its view depth. UW has no such limit. Tuned on scene tank.
        filter_depth_share: f64 = 0.05 => 0.0 ..= 1e6, "1";
    }
}

photon_settings! {
    /// Godrays: a photon grid, drawn as lines. UW §3.4.
    Godrays of godrays, 0.16 of the viewport;
    {
        /// Cells per side of the photon grid. UW §4.1: 100.
        grid: u32 = 100 => 1 ..= 16384, "1";
    }
    {
        /// Pixels of the buffer; 0 × 0 scales it with the viewport by 0.16. UW §4.1: 128 × 128 at 800 × 800.
        buffer: [u32; 2] = [0, 0] => 0 ..= 1_000_000, "px";
        /// Width of the lines. UW §4.2 gives 12 px for a 460 × 272 buffer and no default; 2 px leaves shafts apart in a
        /// 128 × 128 buffer. Tuned on scene tank.
        line_width_px: f64 = 2.0 => 0.1 ..= 1024.0, "px";
        /// Schlick's k of the phase function. UW gives none; 0.5 scatters forward, yet leaves shafts seen from the side.
        phase_k: f64 = 0.5 => -0.99 ..= 0.99, "1";
        /// Scattering coefficient that scales the composed godrays: less than the attenuation, 0.13.
        scattering_per_m: f64 = 0.1 => 0.0 ..= 1e3, "1/m";
        /// How much a photon adds.
        intensity: Intensity = Intensity::Paper;
        /// Whether the buffer is smoothed.
        filter: bool = true;
        /// UW §3.5 gives neither taps nor radius.
        filter_taps: u32 = 16 => 1 ..= 1024, "1";
        /// Radius of the disc.
        filter_radius_px: f64 = 1.5 => 0.0 ..= 256.0, "px";
    }
}

impl Caustics {
    /// How photons are weighted: a mesh conserves energy, whatever is set for splats.
    pub(super) fn photon_intensity(&self) -> Intensity {
        match self.method {
            CausticMethod::Splats => self.intensity,
            CausticMethod::Mesh => Intensity::Conserving,
        }
    }
}

/// What a texel of the caustics buffer holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum CausticsUnit {
    /// The whole flux of each photon whose splat covers it, W.
    PhotonFlux,
    /// The flux that lands in it, W.
    Flux,
    /// Irradiance of what it shows, W/m².
    Irradiance,
}

impl Caustics {
    pub(super) fn buffer_holds(&self) -> CausticsUnit {
        match (self.method, self.intensity) {
            (CausticMethod::Splats, Intensity::Paper) => CausticsUnit::PhotonFlux,
            (CausticMethod::Splats, Intensity::Conserving) => CausticsUnit::Flux,
            (CausticMethod::Mesh, _) => CausticsUnit::Irradiance,
        }
    }
}

impl Godrays {
    pub(super) fn photon_intensity(&self) -> Intensity {
        self.intensity
    }
}

impl Parameters for Params {
    fn consistent(&self) -> Result<(), ParamError> {
        self.caustics.consistent()?;
        self.godrays.consistent()?;
        let (least, most) = (self.caustics.point_size_min_px, self.caustics.point_size_max_px);
        within("caustics.point_size_max_px", most, least, 1024.0)
    }

    fn enlarged(&self, factor: u32) -> Option<Self> {
        let mut larger = self.clone();
        larger.caustics.buffer = self.caustics_buffer();
        larger.godrays.buffer = self.godrays_buffer();
        larger.view = self.view.enlarged(factor);
        Some(larger)
    }
}

impl Params {
    pub fn caustics_buffer(&self) -> [u32; 2] {
        self.caustics.buffer_size(&self.view)
    }

    pub fn godrays_buffer(&self) -> [u32; 2] {
        self.godrays.buffer_size(&self.view)
    }
}
