//! Layers of depth and rays through them: settings and stages that the pipelines of screen-space photon tracing share. Krüger,
//! Bürger and Westermann (SPT) §2.

use serde::{Deserialize, Serialize};

use super::settings::TransferGrid;
use fathom_base::choices;
use fathom_base::parameter::ParamError;
use fathom_base::settings;
use fathom_gpu::kit::Resources;
use fathom_gpu::{Gpu, GpuError};
use fathom_scene::SceneFile;
use fathom_stages::geometry::Geometry;
use fathom_stages::photon::Photons;
use fathom_stages::screen_ray::{HitTest, RayInputs, WalkRules};
use fathom_stages::transfer::bounce;
use fathom_stages::transfer::map::{self, TransferMap};
use fathom_stages::uniforms::Shared;
use fathom_stages::{StageInfo, rays, shadow};

settings! {
    /// How the picture is made.
    pub struct Composition {
        /// Radiance is mapped by 1 − exp(−exposure × radiance). As in pipeline underwater.
        exposure: f64 = 0.4 => 0.0 ..= 1e6, "1";
    }
}

settings! {
    /// The layered depth image. SPT §2.2.
    pub struct LayeredDepth {
        /// Layers. SPT §2.2: "usually sufficient to only consider up to eight depth layers".
        layers: u32 = 8 => 1 ..= 64, "1";
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum WalkMethod {
    /// A line for each photon, and a reduction of its row. SPT §2.1.
    Lines,
    /// An invocation walks each ray.
    March,
    /// A pixel shader walks each ray, a pixel each. SPT §2.1: about half as fast in 2006.
    Pixel,
}

choices!(WalkMethod);

impl WalkMethod {
    /// The stage that finds hits.
    pub fn info(self) -> &'static StageInfo {
        match self {
            Self::Lines => &rays::rasterize::INFO,
            Self::March | Self::Pixel => &rays::march::INFO,
        }
    }
}

settings! {
    /// How rays are followed. SPT §2.1.
    pub struct RaySettings from file: SceneFile {
        /// What walks the rays. All find the same hits.
        method: WalkMethod = WalkMethod::Lines;
        /// What counts as a hit. `tolerance` is the paper's, and loses rays whose depth changes by more than twice the tolerance
        /// from pixel to pixel.
        test: HitTest = HitTest::Crossing;
        /// Distance that counts as a hit with the test `tolerance`. SPT §5: 0.01, of an unknown unit. Read as a share of the scene's view depth,
        /// its camera's far plane: `spt-tolerance` and `spt-shadows` have the reading as metres beside it.
        tolerance_m: f64 = 0.01 * file.camera.z_far_m => 1e-6 ..= 1e3, "m";
        /// Nothing is hit nearer to a ray's start than this.
        start_m: f64 = 0.0 => 0.0 ..= 1e3, "m";
        /// Fewest pixels of a ray's line. SPT §2.1 enforces a minimum and does not give it.
        least_px: u32 = 8 => 1 ..= 4096, "px";
        /// Most rows of the target that lines are drawn into; 0: as many as the adapter has. More photons take several passes.
        rows: u32 = 0 => 0 ..= 1_000_000, "1";
    }
}

/// Most rows by default: 8192 × 801 texels are 25 MiB.
pub(super) const ROWS: u32 = 8192;

/// Most tiles: each is two passes of a frame, of which 2,048 are timed.
pub(super) const MAX_TILES: u64 = 1024;

impl RaySettings {
    /// For photons of so many ways, of which so many intersections are kept.
    pub fn walking(&self, gpu: &Gpu, path_segments: u32, max_hits: u32) -> WalkRules {
        let most_rows = gpu.limits.max_texture_dimension_2d;
        WalkRules {
            test: self.test,
            in_glass: None,
            tolerance_m: self.tolerance_m,
            start_m: self.start_m,
            min_steps: self.least_px,
            rows: if self.rows == 0 { most_rows.min(ROWS) } else { self.rows },
            path_segments,
            max_hits,
            longest_px: None,
        }
    }
    /// Refuses more tiles than a frame can time; `sizes` names what gives the number of rays.
    ///
    /// # Errors
    /// One line that names the parameters.
    pub fn fits(&self, rays: u32, ways: u32, sizes: &str) -> Result<(), ParamError> {
        let rows = if self.rows == 0 { ROWS } else { self.rows };
        let tiles = u64::from(rays.div_ceil(rows)) * u64::from(ways);
        if self.method == WalkMethod::Lines && tiles > MAX_TILES {
            return Err(ParamError::Unfit(format!(
                "{sizes} and rays.rows give {tiles} tiles of rays: at most {MAX_TILES} are drawn"
            )));
        }
        Ok(())
    }
}

/// Pushes the stages that find where photons enter the water: the light's depth, of `shadow_px` texels a side, the mask of the water, drawn
/// as `cells`² quads, and the transfer map.
pub fn transfers(
    resources: &Resources<'_>,
    shared: &Shared,
    geometry: &Geometry,
    shadow_px: u32,
    cells: u32,
    transfer: &TransferGrid,
) -> Result<TransferMap, GpuError> {
    let of_light = &resources.with_size_hint("shadow.size");
    let depth = shadow::depth::new(of_light, shared, geometry, shadow_px)?;
    let depth = of_light.push(depth);
    let mask = shadow::mask::new(of_light, shared, &depth, cells)?;
    let mask = of_light.push(mask);
    let of_grid = &resources.with_size_hint("transfer.grid");
    let map = map::new(of_grid, shared, &mask, &transfer.uniforms())?;
    Ok(of_grid.push(map))
}

/// Pushes the stages that find where rays end, and those behind mirrors and glass where rays have several ways.
pub fn trace(
    of_rays: &Resources<'_>,
    shared: &Shared,
    traced: &RayInputs<'_>,
    method: WalkMethod,
) -> Result<Photons, GpuError> {
    let (photons, tiles) = match method {
        WalkMethod::Lines => {
            let of_tile = &of_rays.with_size_hint("view × rays.rows");
            let drawn = rays::rasterize::new(of_tile, shared, traced)?;
            let drawn = of_tile.push(drawn);
            let reduce = rays::reduce::new(of_tile, &drawn, traced)?;
            (of_tile.push(reduce), traced.tiles())
        }
        WalkMethod::March => (of_rays.push(rays::march::new(of_rays, shared, traced)?), 1),
        WalkMethod::Pixel => (of_rays.push(rays::march::drawn(of_rays, shared, traced)?), 1),
    };
    if traced.walking.path_segments > 1 {
        of_rays.push(bounce::new(of_rays, shared, traced, &photons, tiles)?);
    }
    Ok(photons)
}
