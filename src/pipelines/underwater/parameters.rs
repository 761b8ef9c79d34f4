//! Parameters of the underwater pipeline, their defaults with sources, and their ranges.

use glam::{DVec2, DVec3, UVec2};
use serde::{Deserialize, Serialize};

use super::grid::GridSettings;
use crate::Parameters;
use crate::settings::{Viewport, scaled};
use fathom_base::choices;
use fathom_base::parameter::{ParamError, check_range};
use fathom_base::settings;
use fathom_gpu::StageInfo;
use fathom_scene::{Camera, Light, SceneFile, Water};
use fathom_stages::caustics::splat::{PointSize, SplatCoverage};
use fathom_stages::photon::PhotonEstimator;

settings! {
    pub struct Params from file: SceneFile {
        // UW §4.1: 800 × 800.
        view: Viewport = Viewport { width: 800, height: 800 };
        camera: Camera = file.camera.clone();
        light: Light = file.light.clone();
        water: Water = file.water.clone();
        /// Depth of the scene's floor under the resting water.
        floor_depth_m: f64 = file.floor_depth_m => 1e-5 ..= 1e5, "m";
        shadow: ShadowMap = ShadowMap::from(file);
        surface: WaterBuffers = WaterBuffers::default();
        /// Whether photons start only in the rectangle through which light reaches the water in view; else in all of the light's frustum,
        /// which follows the camera's: UW §3.1.
        photons_fitted: bool = true;
        caustics: Caustics = Caustics::from(file);
        godrays: Godrays = Godrays::from(file);
        compose: UnderwaterPicture = UnderwaterPicture::from(file);
    }
}

settings! {
    /// The light's depth, which photons look up.
    pub struct ShadowMap from file: SceneFile {
        /// Texels per side. UW gives none; 1024 resolves 1 cm in a 10 m scene.
        size: u32 = 1024 => 1 ..= 1_000_000, "px";
        /// Step of depth between neighbouring texels that counts as an edge: across it the estimator does not interpolate.
        /// Tuned on scene tank, where it is 10 cm, and a share of the scene.
        edge_m: f64 = 0.1 * file.tank_scale() => 0.0 ..= 1e4, "m";
    }
}

settings! {
    /// The water's surface as it is drawn.
    pub struct WaterBuffers {
        /// Size of the reflection and refraction buffers relative to the viewport.
        scale: f64 = 0.5 => 0.01 ..= 4.0, "1";
        /// Quads per side of the grid that draws the water.
        cells: u32 = 128 => 1 ..= 8192, "1";
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum IntensityRule {
    /// The paper's rule: the intensity of a primitive does not depend on its size, and all photons are alike.
    Paper,
    /// Energy divided by the splat's area (the line's width), so that the sum over the buffer is the energy drawn. A point
    /// light's photons are weighted by their solid angle. Splats carry light over the picture's border: with 5 px in a buffer of 7 × 3 pixels
    /// the sum is 0.91 of the flux that lands in view of scene plane from above, where light goes on beyond the picture 1.00, and 0.38 where
    /// the horizon is seen.
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

choices!(IntensityRule, Splatting, SubdivisionMode);

settings! {
    /// How the picture is made.
    pub struct UnderwaterPicture from file: SceneFile {
        /// Radiance is mapped by 1 − exp(−exposure × radiance). With 0.4, white in full light of 9.2 W/sr (UW §4.1) is shown at
        /// 85 % and focused light stands above it.
        exposure: f64 = 0.4 => 0.0 ..= 1e6, "1";
        /// Whether caustics are added to the picture as they are in their buffer: UW §3.3 and §3.5. Else they light what is seen.
        add_caustics: bool = false;
        /// Taps of the optional screen-space ambient occlusion; 0 turns it off.
        occlusion_taps: u32 = 0 => 0 ..= 256, "1";
        /// Radius of the taps' disc at the surface: a share of the scene, 50 cm in scene tank.
        occlusion_radius_m: f64 = 0.5 * file.tank_scale() => 1e-6 ..= 1e5, "m";
    }
}

/// What distinguishes the stages of one photon grid from those of another.
pub(super) struct PhotonPath {
    pub(super) grid_sized_by: &'static str,
    pub(super) buffer_sized_by: &'static str,
    pub(super) trace: &'static StageInfo,
    pub(super) grid: GridSettings,
    pub(super) conserving: bool,
    pub(super) filter: bool,
}

/// Declares the settings of a photon grid and of how it is drawn. Each grid has its own number of cells, and all have what follows it.
macro_rules! photon_settings {
    (
        $(#[doc = $about:tt])*
        $group:ident of $name:ident, from $file:ident, $scale:literal of the viewport;
        { $($grid:tt)* }
        { $($drawn:tt)* }
    ) => {
        settings! {
            $(#[doc = $about])*
            pub struct $group from $file: SceneFile {
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
                /// and the ray ρ off the vertical. 0 takes as many as reach 1/4000 of the depth in the light's frustum, at least 6 and at most 64. Under 72° is
                /// the limit at index 1.33: beyond it the factor is above 1, and no number of iterations converges.
                iterations: u32 = 0 => 0 ..= 1000, "1";
                /// Of `secant`: longest step of the search along the ray, in texels of the light's depth. What is narrower can be passed. Steps
                /// are never longer in cells of up to 144 photons over a light's depth of 1024 texels a side, and of up to 36 over one of 4096.
                step_px: f64 = 4.0 => 0.5 ..= 1024.0, "px";
                /// Of `paper`: first estimate d0 of the path under water. UW gives none. A share of the scene, 1 m in scene tank.
                start_m: f64 = $file.tank_scale() => 0.0 ..= 1e4, "m";
                /// Residual below which a photon counts as converged: a share of the scene, 1 cm in scene tank.
                tolerance_m: f64 = 0.01 * $file.tank_scale() => 0.0 ..= 1e3, "m";
                /// Whether photons are tested against the water mask. UW §3 step 2b.
                mask: bool = true;
                $($drawn)*
            }
        }

        impl $group {
            pub fn grid_settings(&self) -> GridSettings {
                GridSettings {
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
                    trace: &fathom_stages::$name::trace::INFO,
                    grid: self.grid_settings(),
                    conserving: self.intensity == IntensityRule::Conserving,
                    filter: self.filter,
                }
            }

            /// Pixels of the buffer: as set, or scaled with the viewport.
            fn buffer_size(&self, view: &Viewport) -> [u32; 2] {
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
    Caustics of caustics, from file, 0.64 of the viewport;
    {
        /// Cells per side of the photon grid. UW §4.1: 200.
        grid: u32 = 200 => 1 ..= 16384, "1";
    }
    {
        /// Pixels of the buffer; 0 × 0 scales it with the viewport by 0.64. UW §4.1: 512 × 512 at 800 × 800.
        buffer: [u32; 2] = [0, 0] => 0 ..= 1_000_000, "px";
        /// Side of a splat at the far plane. UW §4.1: 5.
        point_size_min_px: f64 = 5.0 => 0.1 ..= 1024.0, "px";
        /// Side of a splat at the near plane, not less than at the far one. UW §4.1: 20.
        point_size_max_px: f64 = 20.0 => 0.1 ..= 1024.0, "px";
        /// Where a splat is drawn. UW's squares lie over silhouettes.
        coverage: SplatCoverage = SplatCoverage::Surface;
        /// How far splats are drawn towards the camera before the depth test, so that the floor they lie on does not hide
        /// half of them; with the coverage `surface` also how far behind a splat its surface may lie. Tuned on scene tank, where it is 30 cm,
        /// and a share of the scene.
        depth_bias_m: f64 = 0.3 * file.tank_scale() => 0.0 ..= 1e5, "m";
        /// How much a photon adds.
        intensity: IntensityRule = IntensityRule::Paper;
        /// What adds photons up. The sums are the same; which is faster depends on the adapter and on the size of splats. On
        /// lavapipe compute takes 0.4 of the time at 5 px and 0.8 at 20 px.
        splatting: Splatting = Splatting::Compute;
        /// Whether the buffer is smoothed.
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
    Godrays of godrays, from file, 0.16 of the viewport;
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
        /// Scattering coefficient that scales the composed godrays: less than the attenuation, 0.1 where that is 0.13.
        scattering_per_m: f64 = 0.1 * (file.water.attenuation_per_m / 0.13) => 0.0 ..= 1e3, "1/m";
        /// How much a photon adds.
        intensity: IntensityRule = IntensityRule::Paper;
        /// Whether the buffer is smoothed.
        filter: bool = true;
        /// UW §3.5 gives neither taps nor radius.
        filter_taps: u32 = 16 => 1 ..= 1024, "1";
        /// Radius of the disc.
        filter_radius_px: f64 = 1.5 => 0.0 ..= 256.0, "px";
    }
}

impl Parameters for Params {
    fn check_consistent(&self) -> Result<(), ParamError> {
        self.caustics.consistent()?;
        self.godrays.consistent()?;
        let (min, max) = (self.caustics.point_size_min_px, self.caustics.point_size_max_px);
        check_range("caustics.point_size_max_px", max, min, 1024.0)
    }

    fn upscaled(&self, factor: u32) -> Option<Self> {
        let mut larger = self.clone();
        larger.caustics.buffer = self.caustics_buffer();
        larger.godrays.buffer = self.godrays_buffer();
        larger.view = self.view.upscaled(factor);
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

    pub(super) fn point_size(&self) -> PointSize {
        let sizes_px = [self.caustics.point_size_min_px, self.caustics.point_size_max_px];
        PointSize::new(sizes_px[0], sizes_px[1], self.camera.z_near_m, self.camera.z_far_m)
    }

    /// Distance from the camera to what it looks at.
    pub(super) fn middle_m(&self) -> f64 {
        DVec3::from(self.camera.target_m).distance(self.camera.position())
    }

    /// Shares of the picture that a splat in the middle of the view and a line cover, the larger of the two.
    pub(super) fn photon_reach(&self) -> DVec2 {
        let share = |side_px: f64, buffer: [u32; 2]| side_px / UVec2::from(buffer).as_dvec2();
        let splat = share(self.point_size().size_px(self.middle_m()), self.caustics_buffer());
        splat.max(share(self.godrays.line_width_px, self.godrays_buffer()))
    }
}
