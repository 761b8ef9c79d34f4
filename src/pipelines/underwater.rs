//! Underwater caustics and godrays: Papadopoulos and Papaioannou, *Realistic Real-time Underwater Caustics and Godrays* (UW).

mod explain;
mod measure;
mod parameters;

use std::collections::BTreeMap;

use glam::{DVec3, UVec2, Vec2};
use serde_json::Value;

use super::settings::{self, DEPTH_BYTES, GBUFFER_BYTES, IMAGE_BYTES, VIEWPORT, pass_demand};
use super::{Kind, Pipeline};
use crate::gpu::{Demand, Gpu, GpuError};
use crate::record::Work;
use crate::scene::{LightKind, Scene, SceneFile};
use crate::stages::caustics::splat::{PointSize, SplatUniforms};
use crate::stages::compose::{self, ComposeUniforms};
use crate::stages::frame::{Frame, Shared, View};
use crate::stages::geometry::Geometry;
use crate::stages::godrays::lines::LinesUniforms;
use crate::stages::kit::Resources;
use crate::stages::photon::{self, Photons};
use crate::stages::splatting::PHOTONS_PER_INSTANCE;
use crate::stages::{self, Stage, caustics, godrays, scene, shadow, water};

pub use measure::{blended_fragments, photons_at, read_photons};
pub use parameters::{Intensity, Params, PhotonGrid, SubdivisionMode};

pub const KIND: Kind = Kind {
    name: "underwater",
    about: "underwater caustics and godrays (UW): photons through the water's surface, splats and light shafts",
    stages: &[
        stages::frame::INFO,
        stages::shadow::depth::INFO,
        stages::shadow::mask::INFO,
        stages::scene::gbuffer::INFO,
        stages::water::reflection::INFO,
        stages::water::refraction::INFO,
        stages::caustics::trace::INFO,
        stages::caustics::splat::INFO,
        stages::caustics::filter::INFO,
        stages::godrays::trace::INFO,
        stages::godrays::lines::INFO,
        stages::godrays::filter::INFO,
        stages::compose::INFO,
    ],
    defaults: |file| Params::from_scene(file).to_value(),
    scene_file,
    demand,
    build: |gpu, scene, params| {
        let params = Params::from_value(params).map_err(GpuError::Unusable)?;
        Ok(Box::new(Underwater::new(gpu, scene, params)?))
    },
};

fn scene_file(file: &SceneFile, params: &Value) -> Result<SceneFile, String> {
    let params = Params::from_value(params)?;
    Ok(SceneFile {
        floor_depth_m: params.floor_depth_m,
        camera: params.camera,
        light: params.light,
        water: params.water,
        ..file.clone()
    })
}

fn demand(params: &Value, scene: &Scene) -> Result<Demand, String> {
    scene.needs_objects("underwater")?;
    let params = Params::from_value(params)?;
    let size_px = [params.view.width, params.view.height];
    let surface_px = size_px.map(|side| scaled(side, params.surface.scale));
    let shadow = [params.shadow.size; 2];
    let view_bytes = GBUFFER_BYTES + IMAGE_BYTES;
    let compose = COMPOSE_FETCHES + u64::from(params.compose.occlusion_taps);
    let mut demand = pass_demand(size_px, VIEWPORT, view_bytes, compose)
        .and(pass_demand(shadow, "shadow.size", DEPTH_BYTES + MASK_BYTES, 0))
        .and(pass_demand(surface_px, "view × surface.scale", SURFACE_BYTES, 0))
        .and(settings::picture_demand(size_px))
        .and(settings::shared_demand())
        .and(settings::geometry_demand(scene))
        .color_targets("scene/gbuffer", 2, 12);
    if let Some(tile) = &scene.water.tile {
        let [columns, rows] = tile.size().map(u64::from);
        demand = demand.texture_2d("water.height_map", columns, rows);
    }
    let grids = [
        (
            "caustics",
            &params.caustics.grid_settings(),
            params.caustics_buffer(),
            (params.caustics.filter, params.caustics.filter_taps),
        ),
        (
            "godrays",
            &params.godrays.grid_settings(),
            params.godrays_buffer(),
            (params.godrays.filter, params.godrays.filter_taps),
        ),
    ];
    for (name, grid, buffer_px, (filtered, taps)) in grids {
        let groups = u64::from(photon::workgroups(grid.grid));
        let photons = format!("{name}.grid × {name}.subdivision");
        let taps = if filtered { u64::from(taps) } else { 0 };
        let targets = 1 + u64::from(filtered);
        let bytes = targets * ACCUMULATION_BYTES + DEPTH_BYTES;
        demand = demand
            .and(pass_demand(buffer_px, &format!("{name}.buffer"), bytes, taps))
            .storage(&photons, Photons::bytes(grid.photons()))
            .holds(&photons, Photons::bytes(grid.photons()))
            .takes(&photons, tracing(grid))
            .dispatch(&format!("{name}/trace"), [groups, groups, 1]);
    }
    Ok(demand)
}

/// Texel fetches of a pixel of the final composition without its occlusion, as it declares them.
const COMPOSE_FETCHES: u64 = 11;
/// Bytes of a pixel of reflection and refraction: each a colour of four half floats and a depth.
const SURFACE_BYTES: u64 = 2 * (8 + 4);
/// Bytes of a texel of the shadow map's mask.
const MASK_BYTES: u64 = 1;
/// Bytes of a pixel in which light is summed.
const ACCUMULATION_BYTES: u64 = 4;

/// Every photon looks up four depth texels an iteration, and is drawn once.
fn tracing(grid: &PhotonGrid) -> Work {
    let photons = grid.photons();
    Work {
        triangles: photons,
        texel_fetches: photons.saturating_mul(4 * u64::from(grid.iterations)),
        ..Work::default()
    }
}

/// The stages of a frame, in order.
pub struct Underwater {
    pub params: Params,
    pub view: View,
    frame: Frame,
    shadow_depth: shadow::depth::Depth,
    shadow_mask: shadow::mask::Mask,
    gbuffer: scene::gbuffer::Gbuffer,
    reflection: water::reflection::Reflection,
    refraction: water::refraction::Refraction,
    caustics_trace: caustics::trace::Trace,
    caustics_splat: caustics::splat::Splat,
    caustics_filter: Option<caustics::filter::Filter>,
    godrays_trace: godrays::trace::Trace,
    godrays_lines: godrays::lines::Lines,
    godrays_filter: Option<godrays::filter::Filter>,
    compose: compose::Compose,
    plan: Plan,
    allocated_bytes: u64,
}

impl Underwater {
    /// Builds all resources and pipelines; `scene` gives the geometry, `params` all else.
    pub fn new(gpu: &Gpu, scene: &Scene, params: Params) -> Result<Self, GpuError> {
        let resources = &Resources::new(gpu);
        let view = view(&params, scene);
        let plan = Plan::new(&params, &view);
        let shared = Shared::new(resources, &view);
        let geometry = Geometry::new(resources, scene);

        let size_px = [params.view.width, params.view.height];
        let shadow_depth =
            shadow::depth::Depth::new(resources, &shared, &geometry, params.shadow.size)?;
        let cells = params.surface.cells;
        let shadow_mask =
            shadow::mask::Mask::new(resources, &shared, shadow_depth.texture(), cells)?;
        let gbuffer = scene::gbuffer::Gbuffer::new(resources, &shared, &geometry, size_px)?;
        let surface_px = size_px.map(|side| scaled(side, params.surface.scale));
        let reflection =
            water::reflection::Reflection::new(resources, &shared, &geometry, surface_px)?;
        let refraction =
            water::refraction::Refraction::new(resources, &shared, &geometry, surface_px)?;

        let conserving = params.caustics.intensity == Intensity::Conserving;
        let light = (shadow_depth.texture(), shadow_mask.texture());
        let grid = params.caustics.grid_settings();
        let caustics_trace = caustics::trace::Trace::new(
            resources,
            &shared,
            light,
            grid.uniforms(),
            grid.is_dynamic(),
        )?
        .weighted(conserving);
        let caustics_splat = caustics::splat::Splat::new(
            resources,
            &shared,
            (&caustics_trace.0.photons, &gbuffer.depth),
            &plan.splat,
            conserving,
            plan.splat_px,
        )?;
        let caustics_filter = params
            .caustics
            .filter
            .then(|| {
                let settings = params.caustics.filter_uniforms();
                let column = caustics::splat::column(conserving);
                let source = (caustics_splat.texture(), column);
                caustics::filter::Filter::new(resources, source, &settings)
            })
            .transpose()?;

        let grid = params.godrays.grid_settings();
        let godrays_trace = godrays::trace::Trace::new(
            resources,
            &shared,
            light,
            grid.uniforms(),
            grid.is_dynamic(),
        )?
        .weighted(params.godrays.intensity == Intensity::Conserving);
        let godrays_lines = godrays::lines::Lines::new(
            resources,
            &shared,
            (&godrays_trace.0.photons, &gbuffer.depth),
            &plan.lines,
            params.godrays.intensity == Intensity::Conserving,
            plan.line_px,
        )?;
        let godrays_filter = params
            .godrays
            .filter
            .then(|| {
                let settings = params.godrays.filter_uniforms();
                let conserving = params.godrays.intensity == Intensity::Conserving;
                let source = (godrays_lines.texture(), godrays::lines::column(conserving));
                godrays::filter::Filter::new(resources, source, &settings)
            })
            .transpose()?;

        let inputs = compose::Inputs {
            albedo: &gbuffer.albedo,
            normal: &gbuffer.normal,
            depth: &gbuffer.depth,
            caustics: caustics_filter
                .as_ref()
                .map_or(caustics_splat.texture(), |filter| filter.texture()),
            godrays: godrays_filter
                .as_ref()
                .map_or(godrays_lines.texture(), |filter| filter.texture()),
            reflection: reflection.texture(),
            refraction: refraction.texture(),
        };
        let compose =
            compose::Compose::new(resources, &shared, &inputs, plan.compose.clone(), conserving)?;
        Ok(Self {
            frame: Frame::new(view.clone(), &shared),
            params,
            view,
            shadow_depth,
            shadow_mask,
            gbuffer,
            reflection,
            refraction,
            caustics_trace,
            caustics_splat,
            caustics_filter,
            godrays_trace,
            godrays_lines,
            godrays_filter,
            compose,
            plan,
            allocated_bytes: resources.allocated_bytes(),
        })
    }
}

impl Pipeline for Underwater {
    fn stages(&self) -> Vec<&dyn Stage> {
        let mut stages: Vec<&dyn Stage> = vec![&self.frame, &self.shadow_depth];
        if self.params.caustics.mask || self.params.godrays.mask {
            stages.push(&self.shadow_mask);
        }
        stages.extend([
            &self.gbuffer as &dyn Stage,
            &self.reflection,
            &self.refraction,
            &self.caustics_trace,
            &self.caustics_splat,
        ]);
        stages.extend(self.caustics_filter.iter().map(|filter| filter as &dyn Stage));
        stages.extend([&self.godrays_trace as &dyn Stage, &self.godrays_lines]);
        stages.extend(self.godrays_filter.iter().map(|filter| filter as &dyn Stage));
        stages.push(&self.compose);
        stages
    }

    fn allocated_bytes(&self) -> u64 {
        self.allocated_bytes
    }

    fn image(&self) -> &wgpu::Texture {
        self.compose.texture()
    }

    fn quantities(&self, gpu: &Gpu) -> Result<BTreeMap<String, f64>, GpuError> {
        self.measured_quantities(gpu)
    }

    fn context(&self, stage: &str) -> Value {
        self.explained(stage)
    }
}

/// What the frame is seen from, for these parameters.
pub fn view(params: &Params, scene: &Scene) -> View {
    View {
        camera: params.camera.clone(),
        light: params.light.clone(),
        water: params.water.with_tile_of(&scene.water),
        bounds: scene.bounds,
        size_px: UVec2::new(params.view.width, params.view.height),
        edge_m: params.shadow.edge_m,
    }
}

fn scaled(side: u32, scale: f64) -> u32 {
    ((f64::from(side) * scale).round() as u32).max(1)
}

/// Uniforms of the camera-space stages, and the sizes that their declared work rests on.
struct Plan {
    splat: SplatUniforms,
    /// Side of a splat in the middle of the scene.
    splat_px: f64,
    lines: LinesUniforms,
    /// Length of a vertical line through all of the water, seen across.
    line_px: f64,
    compose: ComposeUniforms,
}

impl Plan {
    fn new(params: &Params, view: &View) -> Self {
        let flux_w = [params.caustics.intensity, params.godrays.intensity]
            .map(|intensity| grid_flux_w(params, view, intensity));
        let target = DVec3::from(params.camera.target_m);
        let middle_m = target.distance(DVec3::from(params.camera.position_m));
        let [caustics, godrays] = [params.caustics_buffer(), params.godrays_buffer()];
        let pixel = |buffer: [u32; 2]| view.pixel_tangent(buffer[1]) * middle_m;
        let size = PointSize::new(
            params.caustics.point_size_min_px,
            params.caustics.point_size_max_px,
            params.camera.z_near_m,
            params.camera.z_far_m,
        );
        let splat_px = size.at(middle_m);
        let photons =
            [params.caustics.grid_settings(), params.godrays.grid_settings()].map(|g| g.photons());
        let splat = SplatUniforms {
            size_px: as_vec2(caustics),
            size_a_px: size.a_px as f32,
            size_b_px_m: size.b_px_m as f32,
            photon_w: (flux_w[0] / photons[0] as f64) as f32,
            depth_bias_m: params.caustics.depth_bias_m as f32,
            photons_per_instance: PHOTONS_PER_INSTANCE,
            photons: photons[0] as u32,
        };
        let lines = LinesUniforms {
            size_px: as_vec2(godrays),
            width_px: params.godrays.line_width_px as f32,
            phase_k: params.godrays.phase_k as f32,
            photon_w: (flux_w[1] / photons[1] as f64) as f32,
            photons_per_instance: PHOTONS_PER_INSTANCE,
            photons: photons[1] as u32,
        };
        // A splat of side s in the middle of the view covers this area, which turns flux into irradiance there.
        let caustics_scale = match params.caustics.intensity {
            Intensity::Paper => 1.0 / (splat_px * pixel(caustics)).powi(2),
            Intensity::Conserving => view.pixel_tangent(caustics[1]),
        };
        let width_m = pixel(godrays)
            * match params.godrays.intensity {
                Intensity::Paper => params.godrays.line_width_px,
                Intensity::Conserving => 1.0,
            };
        Self {
            splat,
            splat_px,
            lines,
            line_px: params.floor_depth_m / pixel(godrays),
            compose: ComposeUniforms {
                size_px: view.size_px.as_vec2(),
                caustics_scale: caustics_scale as f32,
                godrays_scale: (params.godrays.scattering_per_m / width_m) as f32,
                exposure: params.compose.exposure as f32,
                occlusion_taps: params.compose.occlusion_taps,
                occlusion_radius_m: params.compose.occlusion_radius_m as f32,
                water_cells: params.surface.cells,
            },
        }
    }
}

/// Flux that the photons of a grid share. The paper's rule shares the light's flux evenly; `conserving` weights the photons
/// of a point light by their solid angle (`angular_weight` in `shaders/shared/photon.wgsl`), which is cos³θ of
/// intensity × area of the frustum at unit distance.
fn grid_flux_w(params: &Params, view: &View, intensity: Intensity) -> f64 {
    let frame = view.light_frame();
    match (intensity, frame.kind) {
        (Intensity::Conserving, LightKind::Point) => {
            let scale = frame.projection.x_axis.x * frame.projection.y_axis.y;
            params.light.intensity_w_sr * 4.0 / scale.abs()
        }
        _ => frame.emitted_w,
    }
}

fn as_vec2(size: [u32; 2]) -> Vec2 {
    UVec2::from(size).as_vec2()
}
