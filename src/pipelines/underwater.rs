//! Underwater caustics and godrays: Papadopoulos and Papaioannou, *Realistic Real-time Underwater Caustics and Godrays* (UW).

mod explain;
mod frame_caustics;
mod grid;
mod landing;
mod measure;
mod parameters;

use glam::{UVec2, Vec2};

use super::Pipeline;
use super::settings::{self, VIEWPORT, begin, scaled};
use fathom_gpu::GpuError;
use fathom_gpu::kit::Resources;
use fathom_scene::Scene;
use fathom_stages::caustics;
use fathom_stages::caustics::filter::GuidedUniforms;
use fathom_stages::caustics::splat::{self, SplatStyle, SplatUniforms};
use fathom_stages::compose::{self, ComposeInputs, ComposeUniforms};
use fathom_stages::geometry::Geometry;
use fathom_stages::godrays::filter::FilterUniforms;
use fathom_stages::godrays::lines::LinesUniforms;
use fathom_stages::lit_scene;
use fathom_stages::photon::{self, Photons, TraceUniforms};
use fathom_stages::picture::Picture;
use fathom_stages::splatting::{PHOTONS_PER_INSTANCE, SplatSums};
use fathom_stages::uniforms::{Shared, View};
use fathom_stages::water;
use fathom_stages::{Stage, godrays, scene, shadow};

pub use grid::GridSettings;
use parameters::PhotonPath;
pub use parameters::{IntensityRule, Params, Splatting, SubdivisionMode};

/// Photons through the water's surface, splats and light shafts.
pub struct Underwater {
    pub params: Params,
    pub view: View,
    pub caustics: PhotonStages,
    pub godrays: PhotonStages,
    image: wgpu::Texture,
    plan: ViewPlan,
}

/// What the stages of a photon grid leave: traced, drawn, filtered.
pub struct PhotonStages {
    pub photons: Photons,
    pub drawn: SplatSums,
    filtered: Option<wgpu::Texture>,
    /// The stage that leaves what the picture is composed of.
    pub last: &'static str,
}

impl PhotonStages {
    /// What the picture is composed of.
    pub fn texture(&self) -> &wgpu::Texture {
        self.filtered.as_ref().unwrap_or(&self.drawn.texture)
    }
}

impl Pipeline for Underwater {
    const NAME: &'static str = "underwater";
    const ABOUT: &'static str = "underwater caustics and godrays (UW): photons through the water's surface, splats and light shafts";
    type Params = Params;

    fn new(resources: &Resources<'_>, scene: &Scene, params: &Params) -> Result<Self, GpuError> {
        scene.needs_objects(Self::NAME).map_err(GpuError::Unusable)?;
        let view = view(params, scene);
        let plan = ViewPlan::new(params, &view);
        let shared = &begin(resources, &view);
        let geometry = &Geometry::new(resources, scene);

        let of_light = &resources.with_size_hint("shadow.size");
        let depth = shadow::depth::new(of_light, shared, geometry, params.shadow.size)?;
        let depth = of_light.push(depth);
        let cells = params.surface.cells;
        let mask = shadow::mask::new(of_light, shared, &depth, cells)?;
        let mask_texture = mask.texture().clone();
        if params.caustics.mask || params.godrays.mask {
            of_light.push(mask);
        }
        let light = (&depth, &mask_texture);

        let of_view = &resources.with_size_hint(VIEWPORT);
        let size_px = view.size_px.to_array();
        let gbuffer = of_view.push(scene::gbuffer::new(of_view, shared, geometry, size_px)?);
        let of_surface = &resources.with_size_hint("view × surface.scale");
        let surface_px = scaled(size_px, params.surface.scale);
        let lit = |info| lit_scene::new(of_surface, info, shared, geometry, surface_px);
        let reflection = of_surface.push(lit(&water::reflection::INFO)?);
        let refraction = of_surface.push(lit(&water::refraction::INFO)?);

        let depth = &gbuffer.depth;
        let [caustics, godrays] = photon_grids(resources, shared, light, depth, params, &plan)?;
        let composed = ComposeInputs {
            picture: Picture::new(&gbuffer, params.compose.exposure, 0.0),
            caustics: caustics.texture(),
            godrays: godrays.texture(),
            reflection: &reflection,
            refraction: &refraction,
        };
        let conserving = params.caustics.intensity == IntensityRule::Conserving;
        let (settings, added) = (&plan.compose, params.compose.add_caustics);
        let compose = compose::new(of_view, shared, &composed, settings, conserving, added)?;
        let image = of_view.push(compose);
        Ok(Self { params: params.clone(), view, caustics, godrays, image, plan })
    }
}

/// Caustics and godrays. `light` is the light's depth and mask, `seen` the camera's depth.
fn photon_grids(
    resources: &Resources<'_>,
    shared: &Shared,
    light: (&wgpu::Texture, &wgpu::Texture),
    seen: &wgpu::Texture,
    params: &Params,
    plan: &ViewPlan,
) -> Result<[PhotonStages; 2], GpuError> {
    let path = params.caustics.path();
    let guide = GuidedUniforms {
        taps: params.caustics.filter_taps,
        radius_px: params.caustics.filter_radius_px as f32,
        depth_share: params.caustics.filter_depth_share as f32,
    };
    let filter = |of: &Resources<'_>, drawn: &SplatSums| {
        caustics::filter::new(of, drawn, shared, seen, &guide)
    };
    let caustics = photon_stages(
        resources,
        shared,
        light,
        path,
        &plan.traces[0],
        &filter,
        |of, photons, conserving| {
            let (settings, params) = (&plan.splat, &params.caustics);
            let (coverage, max_px) = (params.coverage, params.point_size_max_px);
            let style = SplatStyle { conserving, coverage, typical_px: plan.splat_px, max_px };
            match params.splatting {
                Splatting::Compute => splat::scatter(of, shared, photons, seen, settings, style),
                Splatting::Raster => splat::raster(of, shared, photons, seen, settings, style),
            }
        },
    )?;
    let path = params.godrays.path();
    let settings = FilterUniforms {
        taps: params.godrays.filter_taps,
        radius_px: params.godrays.filter_radius_px as f32,
    };
    let filter = |of: &Resources<'_>, drawn: &SplatSums| godrays::filter::new(of, drawn, &settings);
    let godrays = photon_stages(
        resources,
        shared,
        light,
        path,
        &plan.traces[1],
        &filter,
        |of, photons, conserving| {
            let (settings, length_px) = (&plan.lines, plan.line_px);
            godrays::lines::new(of, shared, photons, seen, settings, conserving, length_px)
        },
    )?;
    Ok([caustics, godrays])
}

/// Makes the stage that smooths what another has drawn.
type Smoothing<'a> =
    dyn Fn(&Resources<'_>, &SplatSums) -> Result<Stage<wgpu::Texture>, GpuError> + 'a;

/// `draw` makes the stage that draws the photons, and `filter` makes the one that smooths the result.
fn photon_stages(
    resources: &Resources<'_>,
    shared: &Shared,
    light: (&wgpu::Texture, &wgpu::Texture),
    path: PhotonPath,
    uniforms: &TraceUniforms,
    filter: &Smoothing<'_>,
    draw: impl FnOnce(&Resources<'_>, &Photons, bool) -> Result<Stage<SplatSums>, GpuError>,
) -> Result<PhotonStages, GpuError> {
    let PhotonPath { grid, conserving, .. } = path;
    let of_grid = &resources.with_size_hint(path.grid_sized_by);
    let (info, dynamic) = (path.trace, grid.mode == SubdivisionMode::Dynamic);
    let trace = photon::tracing(of_grid, info, shared, light, uniforms, dynamic, conserving)?;
    let photons = of_grid.push(trace);
    let of_buffer = &resources.with_size_hint(path.buffer_sized_by);
    let draw = draw(of_buffer, &photons, conserving)?;
    let mut last = draw.name();
    let drawn = of_buffer.push(draw);
    let filter = path.filter.then(|| filter(of_buffer, &drawn)).transpose()?;
    let filtered = filter.map(|filter| {
        last = filter.name();
        of_buffer.push(filter)
    });
    Ok(PhotonStages { photons, drawn, filtered, last })
}

/// What the frame is seen from, for these parameters.
pub fn view(params: &Params, scene: &Scene) -> View {
    View {
        water: params.water.clone(),
        edge_m: params.shadow.edge_m,
        photon_reach: params.photon_reach(),
        photons_fitted: params.photons_fitted,
        ..settings::view(&params.view, &params.camera, &params.light, scene)
    }
}

/// Uniforms of the camera-space stages, and the sizes that their declared work rests on.
struct ViewPlan {
    /// Of caustics and of godrays.
    traces: [TraceUniforms; 2],
    splat: SplatUniforms,
    /// Side of a splat in the middle of the scene.
    splat_px: f64,
    lines: LinesUniforms,
    /// Length of a vertical line through all of the water, seen across.
    line_px: f64,
    compose: ComposeUniforms,
}

impl ViewPlan {
    fn new(params: &Params, view: &View) -> Self {
        let flux_w = [params.caustics.intensity, params.godrays.intensity]
            .map(|intensity| grid_flux_w(view, intensity));
        let middle_m = params.middle_m();
        let [caustics, godrays] = [params.caustics_buffer(), params.godrays_buffer()];
        let pixel = |buffer: [u32; 2]| view.pixel_tangent(buffer) * middle_m;
        let splat_px = params.point_size().size_px(middle_m);
        let grids = [params.caustics.grid_settings(), params.godrays.grid_settings()];
        let photons = [grids[0].photons(), grids[1].photons()];
        let lines = LinesUniforms {
            size_px: as_vec2(godrays),
            square_px: view.square_px(godrays).as_vec2(),
            width_px: params.godrays.line_width_px as f32,
            phase_k: params.godrays.phase_k as f32,
            photon_w: (flux_w[1] / photons[1] as f64) as f32,
            photons_per_instance: PHOTONS_PER_INSTANCE,
            photons: photons[1] as u32,
        };
        let caustics_scale = match params.caustics.intensity {
            // A splat of side s in the middle of the view covers this area, which turns flux into irradiance there.
            IntensityRule::Paper => 1.0 / (splat_px * pixel(caustics)).powi(2),
            IntensityRule::Conserving => view.pixel_tangent(caustics),
        };
        let width_m = pixel(godrays)
            * match params.godrays.intensity {
                IntensityRule::Paper => params.godrays.line_width_px,
                IntensityRule::Conserving => 1.0,
            };
        Self {
            traces: grids.map(|grid| grid.uniforms(view, params.shadow.size)),
            splat: splat_uniforms(params, flux_w[0] / photons[0] as f64, photons[0] as u32),
            splat_px,
            lines,
            line_px: params.floor_depth_m / pixel(godrays),
            compose: ComposeUniforms {
                caustics_scale: caustics_scale as f32,
                godrays_scale: (params.godrays.scattering_per_m / width_m) as f32,
                occlusion_taps: params.compose.occlusion_taps,
                occlusion_radius_m: params.compose.occlusion_radius_m as f32,
                water_cells: params.surface.cells,
                depth_share: params.caustics.filter_depth_share as f32,
            },
        }
    }
}

/// Of splats of this many photons of this flux; the steps of their sum follow from the least and the greatest that one adds.
fn splat_uniforms(params: &Params, photon_w: f64, photons: u32) -> SplatUniforms {
    let (caustics, size) = (&params.caustics, params.point_size());
    let sides_px = [caustics.point_size_max_px, caustics.point_size_min_px];
    let [near, max] = sides_px.map(|side_px| {
        photon_w
            * match caustics.intensity {
                IntensityRule::Paper => 1.0,
                IntensityRule::Conserving => side_px.powi(-2),
            }
    });
    let min = near * (-params.water.attenuation_per_m * params.floor_depth_m).exp();
    SplatUniforms {
        size_px: as_vec2(params.caustics_buffer()),
        size_a_px: size.a_px as f32,
        size_b_px_m: size.b_px_m as f32,
        photon_w: photon_w as f32,
        depth_bias_m: caustics.depth_bias_m as f32,
        steps: splat::steps([min, max]),
        photons,
        photons_per_instance: PHOTONS_PER_INSTANCE,
    }
}

/// Flux that the photons of a grid share. The paper's rule shares the light's flux evenly; `conserving` weights the photons
/// of a point light by their solid angle.
fn grid_flux_w(view: &View, intensity: IntensityRule) -> f64 {
    match intensity {
        IntensityRule::Paper => view.light_frame().emitted_w,
        IntensityRule::Conserving => view.weighted_flux_w(),
    }
}

fn as_vec2(size: [u32; 2]) -> Vec2 {
    UVec2::from(size).as_vec2()
}
