//! How much ambient occlusion at one surface point changes with the viewer. VAO §6.1, Fig. 9.

use glam::{DQuat, DVec3};
use thiserror::Error;

use super::subject::Subject;
use crate::gpu::{FrameTimer, Gpu, GpuError, Pixels, read_texture};
use crate::pipelines::AnyPipeline;
use crate::reference::rays::PixelRays;
use crate::scene::Camera;
use crate::statistics::mean;

/// Points of the cell's own view that are looked up in the others at most.
const MOST_POINTS: usize = 4_000;
/// A pixel of another view shows the point's surroundings when what it shows lies this near, in footprints of a pixel there:
/// a pixel's diagonal on a surface seen at up to 75 degrees.
const NEAR_FOOTPRINTS: f64 = 5.4;
/// Least sum of the bilinear weights of such pixels: a quarter, what is left beside a corner of something nearer.
const LEAST_WEIGHT: f64 = 0.25;
/// Cosine between the normals of a point and of what is taken for it in another view: a point beside an edge is not taken for
/// one around it.
const SAME_NORMAL: f64 = 0.9;

#[derive(Debug, Error)]
pub enum ViewsError {
    #[error(transparent)]
    Gpu(#[from] GpuError),
    #[error("the pipeline computes no occlusion")]
    NoOcclusion,
    #[error("no point is seen in two views")]
    Nothing,
}

/// The camera turned about the vertical through its target.
pub fn turned(camera: &Camera, turn_deg: f64) -> Camera {
    let target = DVec3::from(camera.target_m);
    let turn = DQuat::from_axis_angle(DVec3::from(camera.up).normalize(), turn_deg.to_radians());
    let position = target + turn * (camera.position() - target);
    Camera { position_m: position.to_array(), ..camera.clone() }
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
    cell: &dyn AnyPipeline,
    others: &[Subject],
) -> Result<Spread, ViewsError> {
    let own = Shot::new(gpu, cell)?;
    let mut seen = Seen::by(&own);
    // One at a time, as the pictures of a view are large.
    for other in others {
        let pipeline = other.build(gpu)?;
        timer.untimed(gpu, &pipeline.stages())?;
        seen.also_by(&Shot::new(gpu, pipeline.as_ref())?);
    }
    seen.spread()
}

/// Points of the cell's own view, and their occlusion in each view that sees them.
struct Seen(Vec<(SeenPoint, Vec<f64>)>);

impl Seen {
    fn by(own: &Shot) -> Self {
        let points = own.points().into_iter();
        Self(points.map(|point| (point, vec![point.occlusion])).collect())
    }

    fn also_by(&mut self, other: &Shot) {
        for (point, values) in &mut self.0 {
            values.extend(other.find(point));
        }
    }

    fn spread(&self) -> Result<Spread, ViewsError> {
        let variances: Vec<f64> =
            self.0.iter().filter_map(|(_, values)| variance(values)).collect();
        match variances.len() {
            0 => Err(ViewsError::Nothing),
            points => Ok(Spread { std: mean(variances).sqrt(), points }),
        }
    }
}

/// Unbiased; none for less than two values.
fn variance(values: &[f64]) -> Option<f64> {
    let middle = mean(values.iter().copied());
    let square: f64 = values.iter().map(|value| (value - middle).powi(2)).sum();
    (values.len() > 1).then(|| square / (values.len() - 1) as f64)
}

#[derive(Clone, Copy)]
struct SeenPoint {
    position: DVec3,
    normal: DVec3,
    occlusion: f64,
}

impl Shot {
    fn new(gpu: &Gpu, pipeline: &dyn AnyPipeline) -> Result<Shot, ViewsError> {
        let buffers = pipeline.occlusion().ok_or(ViewsError::NoOcclusion)?;
        let depth = read_texture(gpu, &buffers.gbuffer.depth)?;
        let opening = 2.0 * (buffers.camera.fov_y_deg.to_radians() / 2.0).tan();
        Ok(Shot {
            rays: PixelRays::new(&buffers.camera, depth.width, depth.height),
            footprint: opening / f64::from(depth.height),
            normal: read_texture(gpu, &buffers.gbuffer.normal)?,
            visibility: read_texture(gpu, buffers.visibility())?,
            depth,
        })
    }

    /// A lattice of what it sees.
    fn points(&self) -> Vec<SeenPoint> {
        let (width, height) = (self.depth.width, self.depth.height);
        let pixels = f64::from(width) * f64::from(height);
        let step = (pixels / MOST_POINTS as f64).sqrt().ceil().max(1.0) as usize;
        let along = |side: u32| (0..side).skip(step / 2).step_by(step);
        let lattice = along(height).flat_map(|y| along(width).map(move |x| (x, y)));
        lattice.filter_map(|(x, y)| self.at(x, y)).collect()
    }

    /// What a pixel shows.
    fn at(&self, x: u32, y: u32) -> Option<SeenPoint> {
        let depth = f64::from(self.depth.texel(x, y)[0]);
        let normal = self.normal.texel(x, y);
        let normal = DVec3::new(normal[0].into(), normal[1].into(), normal[2].into());
        let (u, v) = (f64::from(x) + 0.5, f64::from(y) + 0.5);
        let scaled = |at: u32, from: u32, to: u32| u64::from(at) * u64::from(to) / u64::from(from);
        let Pixels { width, height, .. } = self.visibility;
        let column = scaled(x, self.depth.width, width) as u32;
        let row = scaled(y, self.depth.height, height) as u32;
        (depth < 1.0).then(|| SeenPoint {
            position: self.rays.unproject(u, v, depth),
            normal: normal.normalize_or_zero(),
            occlusion: 1.0 - f64::from(self.visibility.texel(column, row)[0]),
        })
    }

    /// The occlusion at a point of another view, interpolated between the pixels here that see the same surface; none where
    /// none does.
    fn find(&self, point: &SeenPoint) -> Option<f64> {
        let at = self.rays.project(point.position)?;
        let near = NEAR_FOOTPRINTS * self.footprint * at.w;
        let (left, top) = ((at.x_px - 0.5).floor(), (at.y_px - 0.5).floor());
        let (mut sum, mut weights) = (0.0, 0.0);
        for (x, y) in [(left, top), (left + 1.0, top), (left, top + 1.0), (left + 1.0, top + 1.0)] {
            let inside = |place: f64, side: u32| (0.0..f64::from(side)).contains(&place);
            if !inside(x, self.depth.width) || !inside(y, self.depth.height) {
                continue;
            }
            let Some(shown) = self.at(x as u32, y as u32) else {
                continue;
            };
            let same = shown.position.distance(point.position) <= near
                && shown.normal.dot(point.normal) >= SAME_NORMAL;
            if same {
                let weight = (1.0 - (at.x_px - 0.5 - x).abs()) * (1.0 - (at.y_px - 0.5 - y).abs());
                sum += weight * shown.occlusion;
                weights += weight;
            }
        }
        (weights > LEAST_WEIGHT).then(|| sum / weights)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pipelines::occlusion::tests::{camera, corner, gbuffer};
    use crate::reference::image::pixels;
    use crate::reference::rays::Tracer;

    /// A view of a corner whose occlusion is a function of the place and of the view.
    fn shot(tracer: &Tracer, position_m: [f64; 3], occlusion: impl Fn(DVec3) -> f64) -> Shot {
        let camera = camera(position_m);
        let size = [96, 80];
        let [depth, normal] = gbuffer(tracer, &camera, size);
        let rays = PixelRays::new(&camera, size[0], size[1]);
        let visibility = pixels(size).map(|(x, y)| {
            let depth = f64::from(depth.texel(x, y)[0]);
            let at = rays.unproject(f64::from(x) + 0.5, f64::from(y) + 0.5, depth);
            (1.0 - occlusion(at)) as f32
        });
        Shot {
            footprint: 2.0 * (camera.fov_y_deg.to_radians() / 2.0).tan() / f64::from(size[1]),
            visibility: Pixels { data: visibility.collect(), channels: 1, ..depth },
            rays,
            depth,
            normal,
        }
    }

    /// RMS standard deviation over two views whose occlusion differs by `offset`.
    fn spread_of(offset: f64) -> Spread {
        let tracer = Tracer::new(&corner()).unwrap();
        let of_place = |at: DVec3| 0.5 + 0.1 * (at.x + at.z).sin();
        let own = shot(&tracer, [4.0, 3.0, 2.0], of_place);
        let other = shot(&tracer, [4.5, 3.0, 0.5], |at| of_place(at) + offset);
        let mut seen = Seen::by(&own);
        seen.also_by(&other);
        seen.spread().unwrap()
    }

    #[test]
    fn what_depends_on_the_place_alone_hardly_spreads() {
        let spread = spread_of(0.0);
        assert!(spread.points > 1_000, "{spread:?}");
        // What is left is interpolation over the pixels of a slanted surface.
        assert!(spread.std < 0.003, "{spread:?}");
    }

    #[test]
    fn what_depends_on_the_view_spreads_by_as_much() {
        let spread = spread_of(0.2);
        // Two values 0.2 apart deviate by 0.2 / √2.
        assert!((spread.std - 0.2 / 2f64.sqrt()).abs() < 0.005, "{spread:?}");
    }

    #[test]
    fn turning_keeps_height_and_distance() {
        let before = camera([4.0, 3.0, 2.0]);
        let after = turned(&before, 90.0);
        let target = DVec3::from(before.target_m);
        let [before, after] = [before.position() - target, after.position() - target];
        assert!((before.y - after.y).abs() < 1e-9);
        let [before, after] = [before.with_y(0.0), after.with_y(0.0)];
        assert!((before.length() - after.length()).abs() < 1e-9);
        assert!(before.dot(after).abs() < 1e-9);
    }

    #[test]
    fn a_wall_that_hides_a_point_is_not_taken_for_it() {
        let tracer = Tracer::new(&corner()).unwrap();
        let own = shot(&tracer, [4.0, 3.0, 2.0], |_| 0.0);
        // From behind the wall the floor is hidden, and the wall's normal points away from what is asked for.
        let behind = shot(&tracer, [-4.0, 3.0, 2.0], |_| 0.0);
        let floor = own.points().into_iter().filter(|point| point.normal.y > 0.9);
        let hidden = floor.filter(|point| point.position.x > 1.0 && point.position.x < 3.0);
        let found: Vec<bool> = hidden.map(|point| behind.find(&point).is_some()).collect();
        assert!(found.len() > 50 && !found.contains(&true), "{}", found.len());
    }
}
