//! Ambient occlusion of a measured cell against rays cast from the same points, as figures and as a picture.

use std::sync::{Arc, Mutex, PoisonError};

use glam::DVec3;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::settings::{Animation, Attenuation};
use super::{
    ErrorPicture, Errors, Judge, JudgeError, Judging, PixelComparison, ReferenceCache, share,
    to_map,
};
use fathom_base::statistics::mean;
use fathom_gpu::{Gpu, GpuError, Pixels, read_texture};
use fathom_record::{ErrorFigure, ErrorSpan, PictureScale};
use fathom_reference::cache::AnswerKey;
use fathom_reference::deform::Moment;
use fathom_reference::occlusion::{self as reference, occlusion, occlusion_through};
use fathom_reference::rays::{Hit, PixelRays, Tracer};
use fathom_scene::{Camera, Material, Motion, Object, Scene};
use fathom_stages::gbuffer::GBuffer;
use image::{Rgb, RgbImage};

/// Rays of the reference at each of them: a low-discrepancy set whose own error is below 0.01.
const RAYS: u32 = 256;
/// The same for a picture.
const PICTURE_POINTS: usize = 10_000;
const PICTURE_RAYS: u32 = 96;
/// Points of a figure's panel.
const PANEL_POINTS: usize = 40_000;
/// Occlusion beyond that of the reference from which a point counts as falsely occluded: three standard deviations of 50 rays are 0.21 at
/// most.
const FALSE_POSITIVE: f64 = 0.2;
/// Error that a picture shows in full colour.
const PICTURE_FULL: f64 = 0.25;
/// Greatest difference between the depth buffer and the ray cast through the pixel's centre, share of the distance: where it is
/// more, the rasterizer drew another triangle than the ray met, at an edge.
const DEPTH_TOLERANCE: f64 = 2e-3;

/// What a pipeline of ambient occlusion leaves behind in a frame, and what its reference depends on.
pub struct OcclusionBuffers {
    pub gbuffer: GBuffer,
    /// The stage that computes occlusion, and its visibility, 1 − A.
    pub raw: (&'static str, wgpu::Texture),
    /// The stage that filters it and brings it to the viewport's size, and what it leaves.
    pub filtered: Option<(&'static str, wgpu::Texture)>,
    pub camera: Camera,
    /// Distance up to which geometry occludes, metres.
    pub r_max_m: f64,
    pub model: RayModel,
    /// Which moment of the geometry's motion is seen.
    pub animation: Animation,
}

/// What rays make of the surfaces they meet: the reference casts them by the same model.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum RayModel {
    /// The first surface counts, by its distance. VAO Eq. 1.
    First(Attenuation),
    /// All surfaces within r_max count by their opacities, at any distance. VAO Eq. 3.
    Through,
    /// The same with all surfaces taken for opaque.
    ThroughOpaque,
}

/// A seen point, the pixel of the viewport that sees it, and the occlusion there by ray casting.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct JudgedPoint {
    pixel: [u32; 2],
    occlusion: f64,
}

type JudgedPoints = Arc<Vec<JudgedPoint>>;

type MomentTracer = (Arc<Scene>, Animation, Arc<Tracer>);

/// The last scene's hierarchy and digest.
#[derive(Default)]
pub struct GeometryCache {
    /// Of the last scene at a moment.
    tracer: Mutex<Option<MomentTracer>>,
    /// Of the last scene's geometry.
    digest: Mutex<Option<(Arc<Scene>, String)>>,
}

/// What a frame left of the surfaces that are seen.
struct SeenSurfaces {
    depth: Pixels,
    normal: Pixels,
    /// Without what it says of the scene's objects.
    question: OcclusionQuery,
}

/// What of a cell the reference depends on.
#[derive(Clone, Debug)]
struct OcclusionQuery {
    /// Objects whose surfaces are judged: those that one cannot see through.
    opaque: Vec<bool>,
    /// What the reference's rays take each object's opacity for.
    alphas: Vec<f64>,
    camera: Camera,
    size_px: [u32; 2],
    r_max_m: f64,
    model: RayModel,
    animation: Animation,
    /// The occlusion buffer's size; its texels are where occlusion is computed.
    buffer_px: [u32; 2],
}

impl OcclusionBuffers {
    /// What the image is composed with.
    pub fn visibility(&self) -> &wgpu::Texture {
        self.filtered.as_ref().map_or(&self.raw.1, |(_, texture)| texture)
    }

    /// Errors `ao_rmse` and `ao_bias` of the buffer as computed, `ao_filtered_rmse` and `ao_filtered_bias` after the filter
    /// where there is one, the means `ao_mean` and `ao_reference_mean`, and the share of points that are falsely occluded. All in units of A, 0 open to 1 closed, over points
    /// of opaque surfaces, against rays that are cast by the same model.
    pub(super) fn judge(&self, gpu: &Gpu) -> Result<Judging, GpuError> {
        let seen = self.read_seen(gpu)?;
        let read = |(stage, texture): &(&'static str, _)| -> Result<_, GpuError> {
            Ok((*stage, read_texture(gpu, texture)?))
        };
        let ((stage, raw), filtered) = (read(&self.raw)?, self.filtered.as_ref().map(read));
        let filtered = filtered.transpose()?;
        Ok(Box::new(move |judge| {
            let (question, points) = seen.points(judge, judge.max_points, RAYS)?;
            let errors_of = |buffer: &Pixels| errors(&question, &points, buffer);
            let errors = errors_of(&raw);
            let false_positives = errors.iter().filter(|error| **error > FALSE_POSITIVE).count();
            let raw = figures("ao", stage, &errors);
            let mean = mean(points.iter().map(|point| point.occlusion));
            let quantities = [
                ("ao_mean", mean + raw[1].value),
                ("ao_reference_mean", mean),
                ("ao_false_positive_rate", share(false_positives, points.len())),
            ];
            let mut judged = Errors { quantities: to_map(quantities), ..Errors::default() };
            if let Some((stage, buffer)) = filtered {
                let filtered = figures("ao_filtered", stage, &errors_of(&buffer)).into_iter();
                let after = filtered.zip(&raw).map(|(error, raw)| error.with_prefix(&raw.name));
                judged.errors.extend(after);
            }
            judged.errors.extend(raw);
            Ok(judged)
        }))
    }

    /// The signed error of the buffer that the image is composed with: red where it is too dark, blue where too light,
    /// in full colour from ±0.25 on, grey where nothing is drawn or compared.
    pub(super) fn error_picture(&self, gpu: &Gpu) -> Result<Judging<ErrorPicture>, GpuError> {
        let (seen, shown) = (self.read_seen(gpu)?, read_texture(gpu, self.visibility())?);
        Ok(Box::new(move |judge| {
            let (question, points) = seen.points(judge, PICTURE_POINTS, PICTURE_RAYS)?;
            let errors = errors(&question, &points, &shown);
            let picture = paint(&question, &points, &errors, color);
            Ok((picture, PictureScale::OcclusionError(ErrorSpan::new(PICTURE_FULL, errors))))
        }))
    }

    /// Cast visibility 1 − A in place of the buffer's, and the error's picture as above; both over a lattice of points.
    pub(super) fn compare_pixels(
        &self,
        gpu: &Gpu,
        scene: &Scene,
    ) -> Result<PixelComparison, GpuError> {
        let (seen, shown) = (self.read_seen(gpu)?, read_texture(gpu, self.visibility())?);
        let (scene, references) = (Arc::new(scene.clone()), ReferenceCache::default());
        let points = seen.points(&Judge::new(&scene, &references), PANEL_POINTS, PICTURE_RAYS);
        let (question, points) = points.map_err(|error| GpuError::Unusable(error.to_string()))?;
        let cast: Vec<f64> = points.iter().map(|point| point.occlusion).collect();
        let grey = |a: f64| [(255.0 * (1.0 - a)).round() as u8; 3];
        Ok(PixelComparison {
            exact: paint(&question, &points, &cast, grey),
            error: paint(&question, &points, &errors(&question, &points, &shown), color),
        })
    }

    fn read_seen(&self, gpu: &Gpu) -> Result<SeenSurfaces, GpuError> {
        let depth = read_texture(gpu, &self.gbuffer.depth)?;
        let question = OcclusionQuery {
            opaque: Vec::new(),
            alphas: Vec::new(),
            camera: self.camera.clone(),
            size_px: [depth.width, depth.height],
            r_max_m: self.r_max_m,
            model: self.model,
            animation: self.animation.clone(),
            buffer_px: [self.raw.1.width(), self.raw.1.height()],
        };
        Ok(SeenSurfaces { depth, normal: read_texture(gpu, &self.gbuffer.normal)?, question })
    }
}

impl SeenSurfaces {
    fn points(
        &self,
        judge: &Judge<'_>,
        max: usize,
        rays: u32,
    ) -> Result<(OcclusionQuery, JudgedPoints), JudgeError> {
        let (question, Self { depth, normal, .. }) = (self.question(judge.scene), self);
        let content = judge.question("occlusion", &(&question, max, rays));
        let of_texels = |all: AnswerKey, one: &Pixels| all.with(bytemuck::cast_slice(&one.data));
        let content = [depth, normal].into_iter().fold(content, of_texels);
        let points = judge.references.kept_answer(content, || {
            let tracer = judge.references.geometry.tracer(judge.scene, &question.animation);
            cast(&question, &tracer, depth, normal, max, rays)
        });
        if points.is_empty() {
            return Err(JudgeError::Nothing);
        }
        Ok((question, points))
    }

    fn question(&self, scene: &Scene) -> OcclusionQuery {
        let materials = || scene.objects.iter().map(|object| &object.material);
        let alpha = |material: &Material| match self.question.model {
            RayModel::Through => f64::from(material.alpha),
            RayModel::First(_) | RayModel::ThroughOpaque => 1.0,
        };
        OcclusionQuery {
            opaque: materials().map(Material::is_opaque).collect(),
            alphas: materials().map(alpha).collect(),
            ..self.question.clone()
        }
    }
}

impl GeometryCache {
    pub(super) fn digest(&self, scene: &Arc<Scene>) -> String {
        let mut held = self.digest.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((known, digest)) = &*held
            && Arc::ptr_eq(known, scene)
        {
            return digest.clone();
        }
        let digest = digest(scene);
        *held = Some((Arc::clone(scene), digest.clone()));
        digest
    }

    pub(super) fn tracer(&self, scene: &Arc<Scene>, animation: &Animation) -> Arc<Tracer> {
        let mut held = self.tracer.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((known, moment, tracer)) = &*held
            && Arc::ptr_eq(known, scene)
            && moment == animation
        {
            return Arc::clone(tracer);
        }
        let tracer = Arc::new(match animation.motion() {
            Some(motion) => {
                let moved = |object| move_object(object, motion, animation);
                Tracer::new(&scene.objects.iter().map(moved).collect::<Vec<_>>())
            }
            None => Tracer::new(&scene.objects),
        });
        *held = Some((Arc::clone(scene), animation.clone(), Arc::clone(&tracer)));
        tracer
    }
}

/// The attenuation as the reference has it.
pub fn exact(attenuation: Attenuation) -> reference::Obscurity {
    match attenuation {
        Attenuation::Hard => reference::Obscurity::Hard,
        Attenuation::Linear => reference::Obscurity::Linear,
    }
}

/// Of every triangle of a scene, what it is of, and the box around them.
fn digest(scene: &Scene) -> String {
    let of_object = |content: AnswerKey, object: &Object| {
        let mesh = &object.mesh;
        content
            .with(bytemuck::cast_slice(&mesh.positions))
            .with(bytemuck::cast_slice(&mesh.normals))
            .with(bytemuck::cast_slice(&mesh.indices))
            .with(format!("{:?}", object.material).as_bytes())
    };
    let bounds = AnswerKey::new("scene").with(format!("{:?}", scene.solid_bounds()).as_bytes());
    scene.objects.iter().fold(bounds, of_object).digest()
}

/// The object at a moment, by the f64 twin of `scene/deform`. Its normals stay as they were: rays need none.
fn move_object(object: &Object, motion: Motion, animation: &Animation) -> Object {
    let moment = Moment::new(&object.mesh, motion, animation.cycles(), animation.amplitude);
    let mut moved = object.clone();
    let wide = |v: [f32; 3]| DVec3::from(v.map(f64::from));
    for (position, normal) in moved.mesh.positions.iter_mut().zip(&object.mesh.normals) {
        let normal = wide(*normal).normalize_or_zero();
        *position = moment.position(wide(*position), normal).as_vec3().to_array();
    }
    moved
}

impl OcclusionQuery {
    /// A by casting.
    fn occlusion(&self, tracer: &Tracer, position: DVec3, normal: DVec3, rays: u32) -> f64 {
        let r_max_m = self.r_max_m;
        match self.model {
            RayModel::First(by) => occlusion(tracer, position, normal, r_max_m, exact(by), rays),
            RayModel::Through | RayModel::ThroughOpaque => {
                occlusion_through(tracer, position, normal, r_max_m, &self.alphas, rays)
            }
        }
    }

    /// What a pixel shows: the first opaque surface, as the G-buffer has it.
    fn first_hit(&self, camera_rays: &PixelRays, tracer: &Tracer, x: u32, y: u32) -> Option<Hit> {
        let (origin, direction, length_m) = camera_rays.ray(x, y);
        let mut from_m = 0.0;
        loop {
            let hit = tracer.cast(origin, direction, from_m, length_m)?;
            if self.opaque[hit.object] {
                return Some(hit);
            }
            from_m = hit.distance_m;
        }
    }

    /// Pixel of the viewport whose depth and normal a texel of the occlusion buffer is computed from.
    fn pixel(&self, texel: [u32; 2]) -> [u32; 2] {
        std::array::from_fn(|i| {
            let share = (f64::from(texel[i]) + 0.5) / f64::from(self.buffer_px[i]);
            (share * f64::from(self.size_px[i])) as u32
        })
    }
}

/// Places of a picture, `step` pixels apart, row by row.
pub(super) fn lattice([width, height]: [u32; 2], step: f64) -> impl Iterator<Item = [u32; 2]> {
    let along = move |side: u32| {
        let places = (0..side).map(move |i| ((f64::from(i) + 0.5) * step) as u32);
        places.take_while(move |place| *place < side)
    };
    along(height).flat_map(move |y| along(width).map(move |x| [x, y]))
}

/// Casts the reference at a lattice of the seen points. Positions are where exact rays through the pixels meet the geometry;
/// normals are those of the G-buffer, which the judged stages use too.
fn cast(
    question: &OcclusionQuery,
    tracer: &Tracer,
    depth: &Pixels,
    normal: &Pixels,
    max: usize,
    rays: u32,
) -> Vec<JudgedPoint> {
    let seen = |texel: &[u32; 2]| {
        let [x, y] = question.pixel(*texel);
        depth.texel(x, y)[0] < 1.0
    };
    let all = lattice(question.buffer_px, 1.0).filter(seen).count();
    let step = (all as f64 / max as f64).sqrt().max(1.0);
    let texels: Vec<[u32; 2]> = lattice(question.buffer_px, step).filter(seen).collect();
    let [width, height] = question.size_px;
    let camera_rays = PixelRays::new(&question.camera, width, height);
    let point = |texel: [u32; 2]| {
        let pixel = question.pixel(texel);
        let [x, y] = pixel;
        let hit = question.first_hit(&camera_rays, tracer, x, y)?;
        let (x_px, y_px) = (f64::from(x) + 0.5, f64::from(y) + 0.5);
        let drawn = camera_rays.unproject(x_px, y_px, f64::from(depth.texel(x, y)[0]));
        let distance = hit.position.distance(question.camera.position());
        let same = hit.position.distance(drawn) <= DEPTH_TOLERANCE * distance;
        let n = normal.texel(x, y);
        let n = DVec3::new(n[0].into(), n[1].into(), n[2].into()).try_normalize()?;
        same.then(|| JudgedPoint {
            pixel,
            occlusion: question.occlusion(tracer, hit.position, n, rays),
        })
    };
    texels.into_par_iter().filter_map(point).collect()
}

/// Occlusion of the buffer less that of the reference.
fn errors(question: &OcclusionQuery, points: &[JudgedPoint], buffer: &Pixels) -> Vec<f64> {
    let extent = [buffer.width, buffer.height];
    let error = |point: &JudgedPoint| {
        let [x, y]: [u32; 2] = std::array::from_fn(|i| {
            let middle = 2 * u64::from(point.pixel[i]) + 1;
            (middle * u64::from(extent[i]) / (2 * u64::from(question.size_px[i]))) as u32
        });
        1.0 - f64::from(buffer.texel(x, y)[0]) - point.occlusion
    };
    points.iter().map(error).collect()
}

/// RMS and mean of the errors of a stage's buffer.
pub(super) fn figures(name: &str, stage: &'static str, errors: &[f64]) -> [ErrorFigure; 2] {
    let bias = mean(errors.iter().copied());
    let square = mean(errors.iter().map(|error| error * error));
    [("rmse", square.sqrt()), ("bias", bias)]
        .map(|(figure, value)| ErrorFigure::new(format!("{name}_{figure}"), value, "1", stage))
}

/// Blue over white to red for −0.25 … 0.25.
fn color(error: f64) -> [u8; 3] {
    signed_color(error / PICTURE_FULL)
}

/// Blue over white to red for −1 … 1.
pub(super) fn signed_color(share: f64) -> [u8; 3] {
    let share = share.clamp(-1.0, 1.0);
    let faded = (255.0 * (1.0 - share.abs())).round() as u8;
    if share > 0.0 { [255, faded, faded] } else { [faded, faded, 255] }
}

/// Paints each point's value over the pixels that are nearest to it on the lattice.
fn paint(
    question: &OcclusionQuery,
    points: &[JudgedPoint],
    values: &[f64],
    color: impl Fn(f64) -> [u8; 3],
) -> RgbImage {
    const NOTHING: Rgb<u8> = Rgb([190; 3]);
    let [width, height] = question.size_px;
    let apart = |axis: usize| {
        let mut places: Vec<u32> = points.iter().map(|point| point.pixel[axis]).collect();
        places.sort_unstable();
        places.dedup();
        // Where a whole row is missing the gap is wide: the median tells the lattice's.
        let mut steps: Vec<u32> = places.windows(2).map(|pair| pair[1] - pair[0]).collect();
        steps.sort_unstable();
        steps.get(steps.len() / 2).map_or(1, |step| step + 1)
    };
    let block = [apart(0), apart(1)];
    let mut picture = RgbImage::from_pixel(width, height, NOTHING);
    for (point, value) in points.iter().zip(values) {
        let start: [u32; 2] = std::array::from_fn(|i| point.pixel[i].saturating_sub(block[i] / 2));
        for y in start[1]..(start[1] + block[1]).min(height) {
            for x in start[0]..(start[0] + block[0]).min(width) {
                picture.put_pixel(x, y, Rgb(color(*value)));
            }
        }
    }
    picture
}

#[cfg(any(test, feature = "fixtures"))]
pub mod fixtures;
#[cfg(test)]
mod tests;
