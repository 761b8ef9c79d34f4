//! Ambient occlusion in scalar fields and participating media: Papaioannou, Menexi and Papadopoulos, *Real-time Volume-based
//! Ambient Occlusion* (VAO), §5.2.

mod parameters;
#[cfg(test)]
mod tests;

use std::collections::BTreeMap;

use glam::UVec2;
use serde_json::Value;

use super::settings::{self, Attenuation, IMAGE_BYTES, VIEWPORT, pass_demand};
use super::{Kind, Pipeline};
use crate::gpu::{Demand, Gpu, GpuError, read_texture};
use crate::scene::{Scene, SceneFile, Volume};
use crate::stages::frame::{Frame, Shared, View};
use crate::stages::kit::Resources;
use crate::stages::ray_cast::{self, RayCast};
use crate::stages::scalar_field::{self, ScalarField};
use crate::stages::{self, Stage, scalar};

pub use parameters::{Law, Mode, Params, Scalar, Stop};

pub const KIND: Kind = Kind {
    name: "scalar_ao",
    about: "ambient occlusion in scalar fields (VAO §5.2): an isosurface, direct volume rendering, or smoke",
    stages: &[
        stages::frame::INFO,
        stages::scalar::isosurface::INFO,
        stages::scalar::direct::INFO,
        stages::scalar::positional::INFO,
    ],
    defaults: |file| Params::from_scene(file).to_value(),
    scene_file,
    demand,
    build: |gpu, scene, params| {
        let params = Params::from_value(params).map_err(GpuError::Limit)?;
        Ok(Box::new(ScalarAo::new(gpu, scene, params)?))
    },
};

/// Step between neighbouring texels of the light's depth: this pipeline has no shadow map, and the shared uniforms take any.
const UNUSED_EDGE_M: f64 = 0.1;

fn scene_file(file: &SceneFile, params: &Value) -> Result<SceneFile, String> {
    let params = Params::from_value(params)?;
    let volume = file.volume.as_ref().map(|v| params.volume.put_into(v));
    Ok(SceneFile {
        volume: volume.transpose()?,
        floor_depth_m: params.floor_depth_m,
        camera: params.camera,
        light: params.light,
        ..file.clone()
    })
}

fn volume_of(scene: &Scene) -> Result<&Volume, String> {
    scene.volume.as_ref().ok_or_else(|| {
        format!(
            "scene `{}` has no volume: pipeline scalar_ao needs one, such as engine, smoke, bonsai or head",
            scene.name
        )
    })
}

fn longest_m(scene: &Scene) -> f64 {
    scene.solid_bounds().size().max_element()
}

fn demand(params: &Value, scene: &Scene) -> Result<Demand, String> {
    let params = Params::from_value(params)?;
    let volume = volume_of(scene)?;
    volume.validate().map_err(|fault| format!("volume `{}`: {fault}", volume.name))?;
    params.scalar.suits(volume, longest_m(scene))?;
    let [targets, bytes] = ray_cast::COLOR_TARGETS;
    let size_px = [params.view.width, params.view.height];
    let normal_bytes = if params.scalar.mode == Mode::Isosurface { NORMAL_BYTES } else { 0 };
    let (field_bytes, pyramid) = (scalar_field::bytes(volume), params.scalar.needs_pyramid());
    // All levels above the first have a seventh of its texels.
    let pyramid_bytes = u64::from(pyramid) * field_bytes / 7;
    let fetches = params.scalar.typical_fetches(volume);
    Ok(pass_demand(size_px, VIEWPORT, IMAGE_BYTES + RESULT_BYTES + normal_bytes, fetches)
        .and(settings::picture_demand(size_px))
        .and(settings::shared_demand())
        .texture_3d("volume cells", volume.cells.map(u64::from))
        .holds("volume cells", field_bytes + pyramid_bytes)
        .copies("volume cells", size_of_val(volume.data.as_slice()) as u64)
        .color_targets("scalar/isosurface", targets, bytes))
}

/// Bytes of a pixel of a ray cast's results and of its normals.
const RESULT_BYTES: u64 = 16;
const NORMAL_BYTES: u64 = 8;

enum Cast {
    Isosurface(scalar::isosurface::Isosurface),
    Direct(scalar::direct::Direct),
    Positional(scalar::positional::Positional),
}

impl Cast {
    fn new(
        resources: &Resources<'_>,
        shared: &Shared,
        field: &ScalarField,
        params: &Params,
        r_max_m: f64,
    ) -> Result<Self, GpuError> {
        let settings = &params.scalar;
        let size_px = [params.view.width, params.view.height];
        let march = &settings.uniforms(size_px, field.voxel_m, r_max_m);
        let (beer, rejection) = (settings.law == Law::Beer, settings.rejection);
        let at_isosurface = settings.stop == Stop::Isosurface;
        let linear = settings.attenuation == Attenuation::Linear;
        Ok(match settings.mode {
            Mode::Isosurface => Cast::Isosurface(scalar::isosurface::Isosurface::new(
                resources,
                shared,
                field,
                march,
                at_isosurface,
                linear,
            )?),
            Mode::Direct => Cast::Direct(scalar::direct::Direct::new(
                resources, shared, field, march, beer, rejection,
            )?),
            Mode::Positional => Cast::Positional(scalar::positional::Positional::new(
                resources, shared, field, march, beer, rejection,
            )?),
        })
    }

    fn stage(&self) -> &dyn Stage {
        match self {
            Cast::Isosurface(stage) => stage,
            Cast::Direct(stage) => stage,
            Cast::Positional(stage) => stage,
        }
    }

    fn pass(&self) -> &RayCast {
        match self {
            Cast::Isosurface(scalar::isosurface::Isosurface(pass))
            | Cast::Direct(scalar::direct::Direct(pass))
            | Cast::Positional(scalar::positional::Positional(pass)) => pass,
        }
    }
}

/// The stages of a frame, and the field they march through.
pub struct ScalarAo {
    pub params: Params,
    frame: Frame,
    cast: Cast,
    field: ScalarField,
    r_max_m: f64,
    allocated_bytes: u64,
}

impl ScalarAo {
    /// Builds all resources and pipelines; `scene` gives the volume, `params` all else.
    pub fn new(gpu: &Gpu, scene: &Scene, params: Params) -> Result<Self, GpuError> {
        let volume = volume_of(scene).map_err(GpuError::Limit)?;
        let resources = &Resources::new(gpu);
        let view = view(&params, scene);
        let shared = Shared::new(resources, &view);
        let field = ScalarField::new(resources, volume, params.scalar.needs_pyramid());
        let r_max_m = params.scalar.reach_m(longest_m(scene));
        let cast = Cast::new(resources, &shared, &field, &params, r_max_m)?;
        Ok(Self {
            frame: Frame::new(view, &shared),
            cast,
            field,
            r_max_m,
            allocated_bytes: resources.allocated_bytes(),
            params,
        })
    }

    /// Visibility, opacity, distance and look-ups of each pixel: see [`RayCast::result`].
    pub fn result(&self) -> &wgpu::Texture {
        &self.cast.pass().result
    }
}

impl Pipeline for ScalarAo {
    fn stages(&self) -> Vec<&dyn Stage> {
        vec![&self.frame, self.cast.stage()]
    }

    fn allocated_bytes(&self) -> u64 {
        self.allocated_bytes
    }

    fn image(&self) -> &wgpu::Texture {
        &self.cast.pass().image
    }

    fn quantities(&self, gpu: &Gpu) -> Result<BTreeMap<String, f64>, GpuError> {
        let pixels = read_texture(gpu, self.result())?;
        let texels =
            || pixels.data.chunks_exact(4).map(|t| [t[0], t[1], t[2], t[3]].map(f64::from));
        let count = texels().count() as f64;
        let covered = || texels().filter(|[_, opacity, ..]| *opacity > 0.0);
        let covered_count = covered().count() as f64;
        let look_ups: f64 = texels().map(|[.., look_ups]| look_ups).sum();
        let most = texels().fold(0.0, |most: f64, [.., look_ups]| most.max(look_ups));
        let visibility: f64 = covered().map(|[visibility, ..]| visibility).sum();
        let settings = &self.params.scalar;
        let step_m = self.r_max_m / f64::from(settings.samples);
        let mut figures = vec![
            ("samples_per_pixel", look_ups / count),
            ("samples_per_pixel_most", most),
            ("covered_share", covered_count / count),
            ("r_max_m", self.r_max_m),
            ("step_voxels", step_m / self.field.voxel_m),
            ("voxel_m", self.field.voxel_m),
            ("volume_bytes", self.field.bytes() as f64),
        ];
        if covered_count > 0.0 {
            figures.push((
                "samples_per_covered_pixel",
                covered().map(|[.., n]| n).sum::<f64>() / covered_count,
            ));
            figures.push(("visibility_mean", visibility / covered_count));
        }
        Ok(figures.into_iter().map(|(name, value)| (name.to_owned(), value)).collect())
    }
}

/// What the frame is seen from, for these parameters.
pub fn view(params: &Params, scene: &Scene) -> View {
    View {
        camera: params.camera.clone(),
        light: params.light.clone(),
        water: scene.water.clone(),
        bounds: scene.bounds,
        size_px: UVec2::new(params.view.width, params.view.height),
        edge_m: UNUSED_EDGE_M,
    }
}
