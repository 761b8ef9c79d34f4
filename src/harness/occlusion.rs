//! Ambient occlusion of a measured cell against rays cast from the same points, as figures and as a picture.

use std::collections::{BTreeMap, HashMap};
use std::path::Path;
use std::rc::Rc;

use glam::DVec3;
use rayon::prelude::*;
use serde_json::Value;
use thiserror::Error;

use super::picture::PictureError;
use super::readout::{self, ReadoutError};
use super::subject::Subject;
use crate::gpu::{Gpu, Pixels};
use crate::pipelines::Pipeline;
use crate::pipelines::params::get;
use crate::reference::ReferenceError;
use crate::reference::occlusion::{Attenuation, occlusion};
use crate::reference::rays::{PixelRays, Tracer};
use crate::scene::{Camera, Scene};

/// Stages that leave an occlusion buffer (visibility 1 − A), as computed and as filtered and brought to the viewport.
pub(super) const RAW: [&str; 2] = ["ao/march", "hsao/march"];
pub(super) const FILTERED: [&str; 2] = ["ao/bilateral", "hsao/filter"];

/// Points that figures rest on at most: an RMS over so many independent errors is known to 2 %.
const MOST_POINTS: usize = 1_500;
/// Rays of the reference at each of them: a low-discrepancy set whose own error is below 0.01.
const RAYS: u32 = 256;
/// The same for a picture.
const PICTURE_POINTS: usize = 10_000;
const PICTURE_RAYS: u32 = 96;
/// Error that a picture shows in full colour.
const PICTURE_FULL: f64 = 0.25;
/// Greatest difference between the depth buffer and the ray cast through the pixel's centre, share of the distance: where it is
/// more, the rasterizer drew another triangle than the ray met, at an edge.
const DEPTH_TOLERANCE: f64 = 2e-3;

#[derive(Debug, Error)]
pub enum OcclusionError {
    #[error(transparent)]
    Readout(#[from] ReadoutError),
    #[error(transparent)]
    Reference(#[from] ReferenceError),
    #[error(transparent)]
    Picture(#[from] PictureError),
    #[error("no {0} among the parameters")]
    Param(&'static str),
    #[error("the geometry moves, and the reference knows it at rest only")]
    Moving,
    #[error("no surface is seen")]
    Nothing,
}

/// A seen point, the pixel of the viewport that sees it, and the occlusion there by ray casting.
#[derive(Clone, Debug, PartialEq)]
struct Point {
    pixel: [u32; 2],
    occlusion: f64,
}

/// Answers of the reference, each computed once, and the last scene's hierarchy.
#[derive(Default)]
pub struct Known {
    points: HashMap<String, Rc<Vec<Point>>>,
    tracer: Option<(Rc<Scene>, Rc<Tracer>)>,
}

/// What of a cell the reference depends on.
struct Question {
    /// Objects whose surfaces are judged: those that one cannot see through.
    opaque: Vec<bool>,
    /// Whether rays end at surfaces, as those of the reference do, all of them opaque.
    comparable: bool,
    camera: Camera,
    size_px: [u32; 2],
    r_max_m: f64,
    attenuation: Attenuation,
    /// The occlusion buffer's size; its texels are where occlusion is computed.
    buffer_px: [u32; 2],
}

impl Known {
    /// `ao_rmse` and `ao_bias` of the buffer as computed, `ao_filtered_rmse` and `ao_filtered_bias` after the filter where
    /// there is one, and the means `ao_mean` and `ao_reference_mean`. All in units of A, 0 open to 1 closed, over points of
    /// opaque surfaces; `ao_mean` alone where rays pass through transparent ones.
    pub(super) fn cell_errors(
        &mut self,
        gpu: &Gpu,
        subject: &Subject,
        pipeline: &dyn Pipeline,
    ) -> Result<BTreeMap<String, f64>, OcclusionError> {
        let (question, points) = self.points(gpu, subject, pipeline, MOST_POINTS, RAYS)?;
        let raw = readout::image(gpu, pipeline, &RAW, None)?;
        let mut quantities = figures("ao", &errors(&question, &points, &raw));
        let mean = points.iter().map(|point| point.occlusion).sum::<f64>() / points.len() as f64;
        let seen = mean + quantities["ao_bias"];
        if !question.comparable {
            return Ok(BTreeMap::from([("ao_mean".to_owned(), seen)]));
        }
        if readout::texture(pipeline, &FILTERED, None).is_some() {
            let filtered = readout::image(gpu, pipeline, &FILTERED, None)?;
            quantities.extend(figures("ao_filtered", &errors(&question, &points, &filtered)));
        }
        quantities.insert("ao_mean".into(), seen);
        quantities.insert("ao_reference_mean".into(), mean);
        Ok(quantities)
    }

    /// Writes the signed error of the buffer that the image is composed with: red where it is too dark, blue where too light,
    /// in full colour from ±0.25 on, grey where nothing is drawn or compared.
    pub fn error_picture(
        &mut self,
        gpu: &Gpu,
        subject: &Subject,
        pipeline: &dyn Pipeline,
        path: &Path,
    ) -> Result<(), OcclusionError> {
        let (question, points) =
            self.points(gpu, subject, pipeline, PICTURE_POINTS, PICTURE_RAYS)?;
        let stages = [FILTERED, RAW].concat();
        let buffer = readout::image(gpu, pipeline, &stages, None)?;
        let errors = errors(&question, &points, &buffer);
        Ok(paint(&question, &points, &errors, path)?)
    }

    fn points(
        &mut self,
        gpu: &Gpu,
        subject: &Subject,
        pipeline: &dyn Pipeline,
        most: usize,
        rays: u32,
    ) -> Result<(Question, Rc<Vec<Point>>), OcclusionError> {
        let raw = readout::texture(pipeline, &RAW, None)
            .ok_or_else(|| ReadoutError::NoTexture(RAW.join(", ")))?;
        let question = Question::new(subject, [raw.width(), raw.height()])?;
        let key = question.key(subject, most, rays);
        if let Some(points) = self.points.get(&key) {
            return Ok((question, Rc::clone(points)));
        }
        let depth = readout::image(gpu, pipeline, &["scene/gbuffer"], Some("depth"))?;
        let normal = readout::image(gpu, pipeline, &["scene/gbuffer"], Some("normal"))?;
        let tracer = self.tracer(&subject.scene)?;
        let points = Rc::new(cast(&question, &tracer, (&depth, &normal), most, rays));
        if points.is_empty() {
            return Err(OcclusionError::Nothing);
        }
        self.points.insert(key, Rc::clone(&points));
        Ok((question, points))
    }

    fn tracer(&mut self, scene: &Rc<Scene>) -> Result<Rc<Tracer>, ReferenceError> {
        if let Some((known, tracer)) = &self.tracer
            && Rc::ptr_eq(known, scene)
        {
            return Ok(Rc::clone(tracer));
        }
        let tracer = Rc::new(Tracer::new(&scene.objects)?);
        self.tracer = Some((Rc::clone(scene), Rc::clone(&tracer)));
        Ok(tracer)
    }
}

impl Question {
    fn new(subject: &Subject, buffer_px: [u32; 2]) -> Result<Question, OcclusionError> {
        let params = &subject.params;
        let leaf = |path: &'static str| get(params, path).ok_or(OcclusionError::Param(path));
        let of_group = |name: &'static str| {
            let group = params.get("ao").or(params.get("hsao"));
            group.and_then(|group| group.get(name))
        };
        let number = |name: &'static str| {
            let value = of_group(name).and_then(Value::as_f64);
            value.ok_or(OcclusionError::Param(name))
        };
        if get(params, "animation.deform").is_some_and(|deform| deform != "none") {
            return Err(OcclusionError::Moving);
        }
        let camera: Camera = serde_json::from_value(leaf("camera")?.clone())
            .map_err(|_| OcclusionError::Param("camera"))?;
        let side = |path| {
            let side = leaf(path)?.as_u64().and_then(|side| u32::try_from(side).ok());
            side.ok_or(OcclusionError::Param(path))
        };
        let fixed_m = number("r_max_m")?;
        let share = number("r_max_share")?;
        let alphas = subject.scene.objects.iter().map(|o| o.material.alpha);
        let opaque: Vec<bool> = alphas.map(|alpha| alpha >= 1.0).collect();
        let through = of_group("occluder").is_some_and(|occluder| occluder == "opacity");
        Ok(Question {
            comparable: !through || opaque.iter().all(|opaque| *opaque),
            opaque,
            camera,
            size_px: [side("view.width")?, side("view.height")?],
            r_max_m: match fixed_m > 0.0 {
                true => fixed_m,
                false => share * subject.scene.solid_bounds().size().max_element(),
            },
            attenuation: match of_group("attenuation").and_then(Value::as_str) {
                Some("hard") => Attenuation::Hard,
                _ => Attenuation::Linear,
            },
            buffer_px,
        })
    }

    /// What tells questions apart. Scenes differ by name and by the parameters that shape them.
    fn key(&self, subject: &Subject, most: usize, rays: u32) -> String {
        let shaping = ["objects", "floor_depth_m"].map(|path| get(&subject.params, path));
        format!(
            "{} {:?} {shaping:?} {:?} {:?} {:?} {} {:?} {most} {rays}",
            subject.scene_name,
            subject.scene.stand_ins,
            self.camera,
            self.size_px,
            self.buffer_px,
            self.r_max_m,
            self.attenuation,
        )
    }

    /// Pixel of the viewport whose depth and normal a texel of the occlusion buffer is computed from.
    fn pixel(&self, texel: [u32; 2]) -> [u32; 2] {
        std::array::from_fn(|i| {
            let share = (f64::from(texel[i]) + 0.5) / f64::from(self.buffer_px[i]);
            (share * f64::from(self.size_px[i])) as u32
        })
    }
}

/// Casts the reference at a lattice of the seen points. Positions are where exact rays through the pixels meet the geometry;
/// normals are those of the G-buffer, which the judged stages use too.
fn cast(
    question: &Question,
    tracer: &Tracer,
    (depth, normal): (&Pixels, &Pixels),
    most: usize,
    rays: u32,
) -> Vec<Point> {
    let [width, height] = question.buffer_px;
    let seen = |texel: &[u32; 2]| {
        let [x, y] = question.pixel(*texel);
        depth.texel(x, y)[0] < 1.0
    };
    let lattice = |step: f64| {
        let along = move |side: u32| {
            let places = (0..side).map(move |i| ((f64::from(i) + 0.5) * step) as u32);
            places.take_while(move |place| *place < side)
        };
        along(height).flat_map(move |y| along(width).map(move |x| [x, y]))
    };
    let all = lattice(1.0).filter(seen).count();
    let step = (all as f64 / most as f64).sqrt().max(1.0);
    let texels: Vec<[u32; 2]> = lattice(step).filter(seen).collect();
    let [width, height] = question.size_px;
    let camera_rays = PixelRays::new(&question.camera, width, height);
    let point = |texel: [u32; 2]| {
        let pixel = question.pixel(texel);
        let [x, y] = pixel;
        let (hit, _) = camera_rays.cast(tracer, x, y)?;
        let (x_px, y_px) = (f64::from(x) + 0.5, f64::from(y) + 0.5);
        let drawn = camera_rays.unproject(x_px, y_px, f64::from(depth.texel(x, y)[0]));
        let distance = hit.position.distance(question.camera.position());
        if !question.opaque[hit.object] {
            return None;
        }
        let same = hit.position.distance(drawn) <= DEPTH_TOLERANCE * distance;
        let n = normal.texel(x, y);
        let n = DVec3::new(n[0].into(), n[1].into(), n[2].into()).try_normalize()?;
        same.then(|| Point {
            pixel,
            occlusion: occlusion(
                tracer,
                hit.position,
                n,
                question.r_max_m,
                question.attenuation,
                rays,
            ),
        })
    };
    texels.into_par_iter().filter_map(point).collect()
}

/// Occlusion of the buffer less that of the reference.
fn errors(question: &Question, points: &[Point], buffer: &Pixels) -> Vec<f64> {
    let extent = [buffer.width, buffer.height];
    let error = |point: &Point| {
        let [x, y]: [u32; 2] = std::array::from_fn(|i| {
            (u64::from(point.pixel[i]) * u64::from(extent[i]) / u64::from(question.size_px[i]))
                as u32
        });
        1.0 - f64::from(buffer.texel(x, y)[0]) - point.occlusion
    };
    points.iter().map(error).collect()
}

fn figures(name: &str, errors: &[f64]) -> BTreeMap<String, f64> {
    let count = errors.len() as f64;
    let bias = errors.iter().sum::<f64>() / count;
    let square = errors.iter().map(|error| error * error).sum::<f64>() / count;
    BTreeMap::from([(format!("{name}_rmse"), square.sqrt()), (format!("{name}_bias"), bias)])
}

/// Blue over white to red for −0.25 … 0.25.
fn color(error: f64) -> [u8; 3] {
    let share = (error / PICTURE_FULL).clamp(-1.0, 1.0);
    let faded = (255.0 * (1.0 - share.abs())).round() as u8;
    if share > 0.0 { [255, faded, faded] } else { [faded, faded, 255] }
}

/// Paints each point's error over the pixels that are nearest to it on the lattice.
fn paint(
    question: &Question,
    points: &[Point],
    errors: &[f64],
    path: &Path,
) -> Result<(), PictureError> {
    const NOTHING: [u8; 3] = [190; 3];
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
    let mut picture = image::RgbImage::from_pixel(width, height, image::Rgb(NOTHING));
    for (point, error) in points.iter().zip(errors) {
        let start: [u32; 2] = std::array::from_fn(|i| point.pixel[i].saturating_sub(block[i] / 2));
        for y in start[1]..(start[1] + block[1]).min(height) {
            for x in start[0]..(start[0] + block[0]).min(width) {
                picture.put_pixel(x, y, image::Rgb(color(*error)));
            }
        }
    }
    picture.save(path).map_err(|source| PictureError::Write { path: path.to_owned(), source })
}

#[cfg(test)]
pub(super) mod tests;
