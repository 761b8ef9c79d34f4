//! How much ambient occlusion at one surface point changes with the viewer. VAO §6.1, Fig. 9.

use glam::{DQuat, DVec3};
use serde_json::{Value, json};
use thiserror::Error;

use super::executor::encodable;
use super::occlusion::{FILTERED, RAW};
use super::readout::{self, ReadoutError};
use super::subject::Subject;
use crate::gpu::{FrameTimer, Gpu, GpuError, Pixels};
use crate::pipelines::Pipeline;
use crate::reference::rays::PixelRays;
use crate::scene::Camera;

/// Points of the cell's own view that are looked up in the others at most.
const MOST_POINTS: usize = 4_000;
/// A pixel of another view sees the point when what it shows lies this near, in footprints of a pixel there: half a pixel's
/// diagonal on a surface seen at up to 75 degrees.
const NEAR_FOOTPRINTS: f64 = 2.7;
/// Cosine between the normals of a point and of what is taken for it in another view: a point beside an edge is not taken for
/// one around it.
const SAME_NORMAL: f64 = 0.9;

#[derive(Debug, Error)]
pub enum ViewsError {
    #[error(transparent)]
    Gpu(#[from] GpuError),
    #[error(transparent)]
    Readout(#[from] ReadoutError),
    #[error("no camera among the parameters")]
    Camera,
    #[error("no point is seen in two views")]
    Nothing,
}

/// The subject with its camera turned about the vertical through its target; unchanged where it has no camera. The geometry
/// is shared: pipelines take the camera from the parameters.
pub fn turned(subject: &Subject, turn_deg: f64) -> Subject {
    let mut turned = subject.clone();
    let Some(camera) = camera(&subject.params) else {
        return turned;
    };
    let target = DVec3::from(camera.target_m);
    let turn = DQuat::from_axis_angle(DVec3::from(camera.up).normalize(), turn_deg.to_radians());
    let position = target + turn * (camera.position() - target);
    turned.params["camera"]["position_m"] = json!(position.to_array());
    turned
}

fn camera(params: &Value) -> Option<Camera> {
    serde_json::from_value(params.get("camera")?.clone()).ok()
}

/// What a view sees.
struct Shot {
    rays: PixelRays,
    /// Size of a pixel at a distance of 1 m.
    footprint: f64,
    depth: Pixels,
    normal: Pixels,
    /// Visibility 1 − A.
    visibility: Pixels,
}

/// How values at the same points differ between views.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spread {
    /// RMS over the points of the standard deviation over the views.
    pub std: f64,
    /// Points that at least two views see.
    pub points: usize,
}

/// Spread of the last frame's occlusion, as the image is composed with it, over the cell's own view and the `others`.
pub fn spread(
    gpu: &Gpu,
    timer: &mut FrameTimer,
    (subject, cell): (&Subject, &dyn Pipeline),
    others: &[Subject],
) -> Result<Spread, ViewsError> {
    let own = Shot::new(gpu, subject, cell)?;
    let points = own.points();
    let mut values: Vec<Vec<f64>> = points.iter().map(|point| vec![point.occlusion]).collect();
    for other in others {
        let pipeline = other.build(gpu)?;
        timer.untimed(gpu, &encodable(pipeline.as_ref()))?;
        let shot = Shot::new(gpu, other, pipeline.as_ref())?;
        for (point, values) in points.iter().zip(&mut values) {
            values.extend(shot.find(point));
        }
    }
    let variances: Vec<f64> = values
        .iter()
        .filter_map(|values| variance(values))
        .collect();
    match variances.len() {
        0 => Err(ViewsError::Nothing),
        points => Ok(Spread {
            std: (variances.iter().sum::<f64>() / points as f64).sqrt(),
            points,
        }),
    }
}

/// Unbiased; none for less than two values.
fn variance(values: &[f64]) -> Option<f64> {
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    let square: f64 = values.iter().map(|value| (value - mean).powi(2)).sum();
    (values.len() > 1).then(|| square / (count - 1.0))
}

struct Point {
    position: DVec3,
    normal: DVec3,
    occlusion: f64,
}

impl Shot {
    fn new(gpu: &Gpu, subject: &Subject, pipeline: &dyn Pipeline) -> Result<Shot, ViewsError> {
        let gbuffer = |name| readout::image(gpu, pipeline, &["scene/gbuffer"], Some(name));
        let camera = camera(&subject.params).ok_or(ViewsError::Camera)?;
        let depth = gbuffer("depth")?;
        let opening = 2.0 * (camera.fov_y_deg.to_radians() / 2.0).tan();
        Ok(Shot {
            rays: PixelRays::new(&camera, depth.width, depth.height),
            footprint: opening / f64::from(depth.height),
            normal: gbuffer("normal")?,
            visibility: readout::image(gpu, pipeline, &[FILTERED, RAW].concat(), None)?,
            depth,
        })
    }

    /// A lattice of what it sees.
    fn points(&self) -> Vec<Point> {
        let (width, height) = (self.depth.width, self.depth.height);
        let pixels = f64::from(width) * f64::from(height);
        let step = (pixels / MOST_POINTS as f64).sqrt().ceil().max(1.0) as usize;
        let along = |side: u32| (0..side).skip(step / 2).step_by(step);
        let lattice = along(height).flat_map(|y| along(width).map(move |x| (x, y)));
        lattice.filter_map(|(x, y)| self.at(x, y)).collect()
    }

    /// What a pixel shows.
    fn at(&self, x: u32, y: u32) -> Option<Point> {
        let depth = f64::from(self.depth.texel(x, y)[0]);
        let normal = self.normal.texel(x, y);
        let normal = DVec3::new(normal[0].into(), normal[1].into(), normal[2].into());
        let (u, v) = (f64::from(x) + 0.5, f64::from(y) + 0.5);
        let scaled = |at: u32, from: u32, to: u32| u64::from(at) * u64::from(to) / u64::from(from);
        let (width, height) = (self.visibility.width, self.visibility.height);
        let texel = (
            scaled(x, self.depth.width, width) as u32,
            scaled(y, self.depth.height, height) as u32,
        );
        (depth < 1.0).then(|| Point {
            position: self.rays.unproject(u, v, depth),
            normal: normal.normalize_or_zero(),
            occlusion: 1.0 - f64::from(self.visibility.texel(texel.0, texel.1)[0]),
        })
    }

    /// The occlusion at a point of another view, where this one sees it too.
    fn find(&self, point: &Point) -> Option<f64> {
        let at = self.rays.project(point.position)?;
        let inside = |place: f64, side: u32| (0.0..f64::from(side)).contains(&place);
        if !inside(at.x_px, self.depth.width) || !inside(at.y_px, self.depth.height) {
            return None;
        }
        let shown = self.at(at.x_px as u32, at.y_px as u32)?;
        let near = NEAR_FOOTPRINTS * self.footprint * at.w;
        let same = shown.position.distance(point.position) <= near
            && shown.normal.dot(point.normal) >= SAME_NORMAL;
        same.then_some(shown.occlusion)
    }
}
