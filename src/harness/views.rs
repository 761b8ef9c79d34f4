//! How much ambient occlusion at one surface point changes with the viewer: the variance over views, less that of the random
//! numbers. VAO §6.1, Fig. 9.

use anyhow::{Context, Result, ensure};
use glam::{DQuat, DVec3};

use super::subject::Subject;
use fathom_base::statistics::mean;
use fathom_gpu::{FrameTimer, Gpu, Pixels, read_texture};
use fathom_pipelines::AnyPipeline;
use fathom_reference::rays::PixelRays;
use fathom_scene::Camera;

/// Points of the cell's own view that are looked up in the others at most.
const MAX_POINTS: usize = 4_000;
/// A pixel of another view shows the point's surroundings when what it shows lies this near, in footprints of a pixel there:
/// a pixel's diagonal on a surface seen at up to 75 degrees.
const NEAR_FOOTPRINTS: f64 = 5.4;
/// Least sum of the bilinear weights of such pixels: a quarter, what is left beside a corner of something nearer.
const MIN_WEIGHT: f64 = 0.25;
/// Cosine between the normals of a point and of what is taken for it in another view: a point beside an edge is not taken for
/// one around it.
const SAME_NORMAL: f64 = 0.9;

/// The camera turned about the vertical through its target.
pub fn rotated(camera: &Camera, angle_deg: f64) -> Camera {
    let target = DVec3::from(camera.target_m);
    let rotation =
        DQuat::from_axis_angle(DVec3::from(camera.up).normalize(), angle_deg.to_radians());
    let position = target + rotation * (camera.position() - target);
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

/// Added to a cell's seed where a view is drawn anew.
const OTHER_SEED: u32 = 1;
/// How far the picture is moved where a view is drawn anew, pixels along both axes: what looking values up between pixels adds is
/// then among what the two draws differ by.
const PAN_PX: f64 = 0.5;

/// The subject drawn anew: other random numbers, and its pixels moved over the scene by half of their size.
fn drawn_anew(subject: &Subject) -> Option<Subject> {
    let height_px = subject.params.pointer("/view/height")?.as_f64()?;
    let moved = panned(&subject.camera(), PAN_PX / height_px);
    subject.with_camera(&moved).reseeded(OTHER_SEED)
}

/// The camera turned on its place so that the picture moves by a share of its height, to the side and down.
fn panned(camera: &Camera, share: f64) -> Camera {
    let target = DVec3::from(camera.target_m);
    let forward = target - camera.position();
    let side = forward.cross(DVec3::from(camera.up)).normalize();
    let up = side.cross(forward).normalize();
    let height_m = 2.0 * (camera.fov_y_deg.to_radians() / 2.0).tan() * forward.length();
    let moved = target + share * height_m * (side + up);
    Camera { target_m: moved.to_array(), ..camera.clone() }
}

/// The cell's own view, and those with the camera turned about its target by these angles, each as the cell is drawn, and drawn anew;
/// none for pipelines without random numbers.
pub fn twice(cell: &Subject, angles_deg: &[f64]) -> Option<Vec<[Subject; 2]>> {
    let camera = cell.camera();
    let viewed = |angle_deg: &f64| cell.with_camera(&rotated(&camera, *angle_deg));
    let all = std::iter::once(cell.clone()).chain(angles_deg.iter().map(viewed));
    all.map(|view| Some([view.clone(), drawn_anew(&view)?])).collect()
}

/// How values at the same points differ between views.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spread {
    /// Mean over the points of the variance over the views.
    pub variance: f64,
    /// Mean over the points and views of the variance between two draws of one view: what random numbers and pixels add to
    /// `variance`.
    pub noise: f64,
    /// Standard error of their difference, from its scatter over the points.
    pub error: f64,
    /// Points that at least two views see.
    pub points: usize,
}

impl Spread {
    /// The variance that the view alone causes: that of a random effect (E s² = σ² of the view + σ² of the noise). What is less than
    /// its standard error is raised to it: no more can be told.
    pub fn by_view(&self) -> f64 {
        (self.variance - self.noise).max(self.error)
    }

    /// For a record: the variance that the view causes as `name`, and what it was made of.
    pub fn figures(&self, name: &str) -> Vec<(String, f64)> {
        let figures = [
            (String::new(), self.by_view()),
            ("_with_noise".to_owned(), self.variance),
            ("_of_noise".to_owned(), self.noise),
            ("_standard_error".to_owned(), self.error),
            ("_points".to_owned(), self.points as f64),
        ];
        figures.map(|(end, value)| (format!("{name}{end}"), value)).into()
    }
}

/// Of the last frame's occlusion, as the image is composed with it, and of that of the other views, each of which is drawn once.
///
/// # Errors
/// What the GPU reports, and a pipeline without occlusion.
pub fn spread(
    gpu: &Gpu,
    timer: &mut FrameTimer,
    cell: &AnyPipeline,
    views: &[[Subject; 2]],
) -> Result<Spread> {
    // One at a time, as the pictures of a view are large.
    let mut draw = |subject: &Subject| -> Result<Shot> {
        let pipeline = subject.build(gpu)?;
        timer.run_stages(gpu, &pipeline.stages())?;
        Shot::new(gpu, pipeline.as_ref())
    };
    let mut seen = ViewPoints::default();
    for (index, [first, second]) in views.iter().enumerate() {
        // The cell's own view is drawn already.
        let own = if index > 0 { draw(first)? } else { Shot::new(gpu, cell)? };
        let shots = [own, draw(second)?];
        if index > 0 { seen.add_view(&shots) } else { seen = ViewPoints::from_own_view(&shots) }
    }
    seen.spread()
}

/// Points of the cell's own view, and their occlusion in two draws of each view that sees them.
#[derive(Default)]
struct ViewPoints(Vec<(SeenPoint, Vec<[f64; 2]>)>);

impl ViewPoints {
    /// Both draws of the cell's own view.
    fn from_own_view([own, again]: &[Shot; 2]) -> Self {
        let points = own.points().into_iter();
        let drawn = |point: SeenPoint| {
            let second = again.find(&point)?;
            Some((point, vec![[point.occlusion, second]]))
        };
        Self(points.filter_map(drawn).collect())
    }

    fn add_view(&mut self, [first, second]: &[Shot; 2]) {
        for (point, values) in &mut self.0 {
            values.extend(first.find(point).zip(second.find(point)).map(|(a, b)| [a, b]));
        }
    }

    fn spread(&self) -> Result<Spread> {
        // Each draw by itself: their mean has half of the noise.
        let over_views = |draws: &[[f64; 2]]| {
            mean([0, 1].map(|k| variance(&draws.iter().map(|d| d[k]).collect::<Vec<_>>())))
        };
        let between_draws = |draws: &[[f64; 2]]| mean(draws.iter().map(|d| variance(d)));
        let seen_twice = self.0.iter().map(|(_, draws)| draws).filter(|d| d.len() > 1);
        let (variances, noises): (Vec<f64>, Vec<f64>) =
            seen_twice.map(|draws| (over_views(draws), between_draws(draws))).unzip();
        ensure!(variances.len() > 1, "no point is seen in two views");
        let differences: Vec<f64> = variances.iter().zip(&noises).map(|(a, b)| a - b).collect();
        Ok(Spread {
            points: differences.len(),
            error: (variance(&differences) / differences.len() as f64).sqrt(),
            variance: mean(variances),
            noise: mean(noises),
        })
    }
}

/// Unbiased, of two values or more.
fn variance(values: &[f64]) -> f64 {
    let middle = mean(values.iter().copied());
    let square: f64 = values.iter().map(|value| (value - middle).powi(2)).sum();
    square / (values.len() - 1) as f64
}

#[derive(Clone, Copy)]
struct SeenPoint {
    position: DVec3,
    normal: DVec3,
    occlusion: f64,
}

impl Shot {
    fn new(gpu: &Gpu, pipeline: &AnyPipeline) -> Result<Shot> {
        let buffers = pipeline.occlusion().context("the pipeline computes no occlusion")?;
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
        let step = (pixels / MAX_POINTS as f64).sqrt().ceil().max(1.0) as usize;
        let along = |side: u32| (0..side).skip(step / 2).step_by(step);
        let lattice = along(height).flat_map(|y| along(width).map(move |x| (x, y)));
        lattice.filter_map(|(x, y)| self.surface_point(x, y)).collect()
    }

    fn surface_point(&self, x: u32, y: u32) -> Option<SeenPoint> {
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
            let Some(shown) = self.surface_point(x as u32, y as u32) else {
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
        (weights > MIN_WEIGHT).then(|| sum / weights)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use fathom_pipelines::occlusion::fixtures::{camera, corner, gbuffer};
    use fathom_reference::image::pixels;
    use fathom_reference::rays::Tracer;
    use fathom_scene::pcg;

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

    /// Of two views whose occlusion differs by `offset`; the draws of each lie `noise` apart from one point to the next.
    fn spread_of(offset: f64, noise: f64) -> Spread {
        let tracer = Tracer::new(&corner());
        let draw = |position: [f64; 3], offset: f64, seed: u32| {
            shot(&tracer, position, |at| {
                let place = (at * 1e4).floor();
                let mixed = pcg(place.x as i32 as u32 ^ pcg(place.z as i32 as u32 ^ pcg(seed)));
                0.5 + 0.1 * (at.x + at.z).sin()
                    + offset
                    + noise * (f64::from(mixed) / 4_294_967_296.0 - 0.5)
            })
        };
        let [own, other] = [[4.0, 3.0, 2.0], [4.5, 3.0, 0.5]];
        let mut seen = ViewPoints::from_own_view(&[draw(own, 0.0, 1), draw(own, 0.0, 2)]);
        seen.add_view(&[draw(other, offset, 3), draw(other, offset, 4)]);
        seen.spread().unwrap()
    }

    #[test]
    fn what_depends_on_the_place_alone_hardly_spreads() {
        let spread = spread_of(0.0, 0.0);
        assert!(spread.points > 1_000, "{spread:?}");
        // What is left is interpolation over the pixels of a slanted surface.
        assert!(spread.variance < 1e-5 && spread.noise < 1e-20, "{spread:?}");
    }

    #[test]
    fn what_depends_on_the_view_spreads_by_as_much() {
        let spread = spread_of(0.2, 0.0);
        // Two values 0.2 apart have a variance of 0.2² / 2.
        assert!((spread.by_view() - 0.02).abs() < 1e-3, "{spread:?}");
    }

    #[test]
    fn noise_is_taken_off() {
        let quiet = spread_of(0.0, 0.3);
        // That of the own view is 0.3² / 12; in the other, four pixels are averaged.
        assert!(quiet.noise > 0.4 * 0.0075 && quiet.noise < 0.0075, "{quiet:?}");
        assert!(quiet.by_view() < 0.1 * quiet.noise && quiet.by_view() > 0.0, "{quiet:?}");
        let loud = spread_of(0.2, 0.3);
        assert!((loud.by_view() - 0.02).abs() < 2e-3, "{loud:?}");
    }

    #[test]
    fn a_panned_picture_moves_by_its_share() {
        let before = camera([4.0, 3.0, 2.0]);
        let after = panned(&before, 0.5 / 80.0);
        let at = |camera: &Camera| PixelRays::new(camera, 96, 80).project(before.target_m.into());
        let (before, after) = (at(&before).unwrap(), at(&after).unwrap());
        let moved = [before.x_px - after.x_px, after.y_px - before.y_px];
        assert!(moved.iter().all(|px| (px - 0.5).abs() < 0.01), "{moved:?}");
    }

    #[test]
    fn rotating_keeps_height_and_distance() {
        let before = camera([4.0, 3.0, 2.0]);
        let after = rotated(&before, 90.0);
        let target = DVec3::from(before.target_m);
        let [before, after] = [before.position() - target, after.position() - target];
        assert!((before.y - after.y).abs() < 1e-9);
        let [before, after] = [before.with_y(0.0), after.with_y(0.0)];
        assert!((before.length() - after.length()).abs() < 1e-9);
        assert!(before.dot(after).abs() < 1e-9);
    }

    #[test]
    fn a_wall_that_hides_a_point_is_not_taken_for_it() {
        let tracer = Tracer::new(&corner());
        let own = shot(&tracer, [4.0, 3.0, 2.0], |_| 0.0);
        // From behind the wall the floor is hidden, and the wall's normal points away from what is asked for.
        let behind = shot(&tracer, [-4.0, 3.0, 2.0], |_| 0.0);
        let floor = own.points().into_iter().filter(|point| point.normal.y > 0.9);
        let hidden = floor.filter(|point| point.position.x > 1.0 && point.position.x < 3.0);
        let found: Vec<bool> = hidden.map(|point| behind.find(&point).is_some()).collect();
        assert!(found.len() > 50 && !found.contains(&true), "{}", found.len());
    }
}
