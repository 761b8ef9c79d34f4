//! `godrays/lines`: intensity along lines, their width, and the phase function, against closed forms.

use crate::prelude::*;
use fathom_pipelines::PipelineInstance;
use fathom_pipelines::underwater::{Params, Underwater};
use fathom_reference::godray::{Godray, Medium};
use fathom_stages::godrays::lines::{self, LinesUniforms};

const STAGE: &str = "godrays/lines";
const SIZE: [u32; 2] = [384, 384];
const WIDTH_PX: f64 = 6.0;
const GAMMA_PER_M: f64 = 0.13;
const PHASE_K: f64 = 0.6;
const MEDIUM: Medium = Medium { gamma_per_m: GAMMA_PER_M, phase_k: PHASE_K };
const PHOTON_W: f64 = 0.05;
/// Cells per side in which isolated lines lie.
const CELLS: u32 = 4;
/// The near plane, and a wall across the view: both cut lines.
const SEEN_M: [f64; 2] = [1.4, 3.5];
/// Heights of the eye in the water, at its surface and above it, where lines lie on both sides of the surface; and the light, of which a point
/// light's lines keep their energy.
const VIEWS: [(f64, LightKind); 3] =
    [(-1.0, LightKind::Directional), (0.0, LightKind::Point), (1.5, LightKind::Point)];
/// Pixels this near to a line's edge are not judged: the rasterizer works in 1/256 px.
const EDGE_PX: f64 = 0.6;

pub fn cases() -> Vec<Case> {
    let seen = |(eye_m, light)| format!("isolated lines from {eye_m} m, {light:?} light");
    let scattered =
        Case::new(STAGE, "light scattered in along a line, by the words of its dump", scattered);
    Case::each(STAGE, VIEWS, seen, isolated).chain([scattered]).collect()
}

/// Draws photons' lines without occlusion.
pub fn draw(rig: &Rig<'_>, view: &View, photons: &[Photon]) -> Result<Image> {
    draw_before(rig, view, photons, 1.0, false)
}

fn draw_before(
    rig: &Rig<'_>,
    view: &View,
    photons: &[Photon],
    depth: f64,
    conserving: bool,
) -> Result<Image> {
    let shared = Shared::new(rig, view);
    let settings = LinesUniforms {
        size_px: Vec2::splat(SIZE[0] as f32),
        square_px: Vec2::splat(SIZE[0] as f32),
        width_px: WIDTH_PX as f32,
        phase_k: PHASE_K as f32,
        photon_w: PHOTON_W as f32,
        photons_per_instance: PHOTONS_PER_INSTANCE,
        photons: photons.len() as u32,
    };
    let (photons, depth) = (&rig.photons(photons), &rig.depth(SIZE, depth)?);
    let stage = lines::new(rig, &shared, photons, depth, &settings, conserving, 10.0)?;
    rig.draw(&[&stage], &stage.texture, 0)
}

/// Lines in their own cells.
fn isolated(rig: &Rig<'_>, (eye_m, light): (f64, LightKind)) -> Checks {
    let (lines, conserving) = (LineScene::new(eye_m, light)?, light == LightKind::Point);
    let wall = rig::depth_ahead(&lines.view, SEEN_M[1]);
    let image = draw_before(rig, &lines.view, &lines.photons, wall, conserving)?;
    let errors = |medium: Medium, width_px: f64| lines.errors(&image, medium, width_px);
    let exact = errors(MEDIUM, WIDTH_PX);
    let murky = errors(Medium { gamma_per_m: GAMMA_PER_M * 1.05, ..MEDIUM }, WIDTH_PX);
    let broad = errors(MEDIUM, WIDTH_PX + 2.0);
    Ok(vec![
        Check::new(rig, format!("from {eye_m} m: largest relative error of intensity"))
            .within((1e-3, "1"), exact[0])
            .control("attenuation 5 % higher", murky[0]),
        Check::new(rig, format!("from {eye_m} m: share of pixels unlike the rectangle"))
            .within((1e-3, "1"), exact[1])
            .control("lines 2 px wider", broad[1]),
    ])
}

/// Lines at all angles, each in its own cell of the buffer, some of them running away from the viewer. The near plane cuts two of three, one at
/// its start and one at its end, which lies before the near plane or behind the eye. The wall cuts or hides others.
struct LineScene {
    view: View,
    photons: Vec<Photon>,
    /// Their parts in view.
    segments: Vec<(Godray, ScreenSegment)>,
}

impl LineScene {
    fn new(eye_m: f64, light: LightKind) -> Result<Self> {
        let mut view = rig::synthetic_view(SIZE, GAMMA_PER_M)?;
        (view.camera.position_m[1], view.camera.target_m[1]) = (eye_m, eye_m);
        (view.camera.z_near_m, view.light.kind) = (SEEN_M[0], light);
        let (eye, rays) = (view.camera.position(), rig::rays(&view));
        let mut random = Random::new(5);
        let cell_px = f64::from(SIZE[0] / CELLS);
        let line = |i: u32| {
            let middle = [i % CELLS, i / CELLS].map(|c| (f64::from(c) + 0.5) * cell_px);
            let (sin, cos) = (random.within(0.0, TAU)).sin_cos();
            let end = |sign: f64, distance_m: f64| {
                let reach = sign * 0.3 * cell_px;
                let at = [middle[0] + cos * reach, middle[1] + sin * reach];
                let (near, direction, _) = rays.ray_at(at[0], at[1]);
                if distance_m > 0.0 { eye + direction * distance_m } else { near }
            };
            let far_m = [(); 2].map(|()| random.within(1.8, 5.0));
            let cut = |at: u32| if i % 3 == at { 0.0 } else { far_m[at as usize] };
            let mut ends = [end(-1.0, cut(0)), end(1.0, cut(1))];
            if let Some(end) = ends.get(i as usize % 3) {
                let beyond = *end - ends[1 - i as usize % 3];
                ends[i as usize % 3] += beyond * random.within(0.05, 2.0);
            }
            rig::photon(ends[0], ends[1], ends[0].distance(ends[1]))
        };
        let photons: Vec<Photon> = (0..CELLS * CELLS).map(line).collect();
        let (frame, ahead) = (view.light_frame(), view.camera.direction());
        // A grid that is even on the light's screen: cos³ is the solid angle of a cell over that in the middle.
        let cosine = |entry: DVec3| (entry - frame.position).normalize().dot(frame.forward);
        let weight = |entry: DVec3| match light {
            LightKind::Directional => 1.0,
            LightKind::Point => cosine(entry).powi(3) / WIDTH_PX,
        };
        // With the numbers that the GPU has.
        let segment = |photon: &Photon| {
            let [entry, hit] = [photon.entry_m.as_dvec3(), photon.hit_m.as_dvec3()];
            let [from_m, to_m] = [entry, hit].map(|end| (end - eye).dot(ahead));
            let drawn = [from_m, to_m].map(|end_m| {
                let seen_m = end_m.clamp(SEEN_M[0], SEEN_M[1]);
                entry.lerp(hit, (seen_m - from_m) / (to_m - from_m))
            });
            let is_hidden = from_m.min(to_m) >= SEEN_M[1];
            let ray = Godray { entry, hit, photon: PHOTON_W * weight(entry) };
            Some((ray, ScreenSegment::new(drawn, &rays)?)).filter(|_| !is_hidden)
        };
        let segments = photons.iter().filter_map(segment).collect();
        Ok(Self { view, photons, segments })
    }

    /// Holds the image against every line; lines must not overlap. The largest relative error of intensity over pixels well within a line, and of
    /// the pixels that a rectangle clearly covers or leaves free those drawn otherwise.
    fn errors(&self, image: &Image, medium: Medium, width_px: f64) -> [f64; 2] {
        let (mut intensity, mut unlike) = (Vec::new(), Vec::new());
        for (x, y) in pixels(image.size()) {
            let value = image.get((x, y));
            let pixel = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
            // Margin by which the nearest line covers the pixel, negative outside.
            let covering = self.segments.iter().map(|(ray, segment)| {
                let (start, rest, beside) = segment.place(pixel);
                (start.min(rest).min(0.5 * width_px - beside), ray, segment, start)
            });
            let nearest = covering.max_by(|a, b| a.0.total_cmp(&b.0));
            let Some((margin, ray, segment, start)) =
                nearest.filter(|(margin, ..)| margin.abs() >= EDGE_PX)
            else {
                continue;
            };
            unlike.push((margin > 0.0) != (value > 0.0));
            if margin > 0.0 && value > 0.0 {
                let place = segment.place_m(start / segment.length_px());
                let expected = ray.intensity(place, self.view.camera.position(), medium);
                intensity.push(relative_error(value, expected));
            }
        }
        [largest(intensity), share(unlike)]
    }
}

/// One photon's line under cameras at several angles, in pixels that are not square: radiance by what the dump says, times the area across
/// the sight, adds up to scattering coefficient × flux × length over 4π.
fn scattered(rig: &Rig<'_>) -> Result<Check> {
    const BUFFERS: [[u32; 2]; 3] = [[384, 288], [160, 800], [800, 180]];
    const EYES: [[f64; 3]; 3] = [[0.0, -1.5, 6.0], [1.5, 3.5, 3.0], [-3.0, -0.5, 4.0]];
    let file = SceneFile::load("plane")?;
    let errors = |(buffer, eye)| -> Result<[f64; 2]> {
        let mut params = Params::from(&file);
        params.camera = Camera::new(eye, [0.0, -1.5, 0.0], 60.0, [0.1, 12.0]);
        (params.light.direction, params.light.half_extent_m) = ([0.4, -1.0, 0.25], 1.0);
        (params.water.amplitude_m, params.water.attenuation_per_m) = (0.0, 0.0);
        (params.caustics.grid, params.godrays.grid, params.godrays.subdivision) = (1, 1, 1);
        (params.godrays.phase_k, params.godrays.buffer) = (0.0, buffer);
        params.godrays.line_width_px = 6.0;
        (params.view.width, params.view.height, params.shadow.size) = (320, 240, 256);
        let pipeline = BuiltPipeline::<Underwater>::new(rig.gpu, &Scene::build(&file)?, &params)?;
        rig.run_until(&pipeline, STAGE)?;
        let about = pipeline.context(STAGE);
        let number = |of: &str, name: &str| about[of][name].as_f64().unwrap_or(f64::NAN);
        let (view, photon) = (&pipeline.view, &pipeline.godrays.photons.read(rig.gpu)?[0]);
        let matrix = params.camera.view_projection(view.aspect());
        let rays = PixelRays::of_matrix(matrix, buffer[0], buffer[1]);
        let ends = [photon.entry(), photon.hit()];
        let line = ScreenSegment::new(ends, &rays).ok_or_else(|| rig.empty("scattered light"))?;
        let (segment, pixel) = (ends[1] - ends[0], view.pixel_tangent(buffer).powi(2));
        let image = rig.channel(&pipeline.godrays.drawn.texture, 0)?;
        let brought = |(x, y): (u32, u32)| {
            let (start, ..) = line.place(DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5));
            let place = line.place_m(start / line.length_px());
            let [at, next] = [place, place + segment.normalize() * 1e-4]
                .map(|place| params.camera.view().transform_point3(place));
            let turn = (at.truncate() / at.z).distance(next.truncate() / next.z) / 1e-4;
            let (z, cos) = (-at.z, -at.z / at.length());
            let radiance = image.get((x, y)) * number("radiance", "scale");
            let along = number("radiance", "distance_m") / (z * z * cos * turn);
            [radiance * along, radiance].map(|radiance| radiance * pixel * z * z * cos)
        };
        let lit = || pixels(buffer).filter(|at| image.get(*at) > 0.0).map(brought);
        let flux_w = number("photons", "flux_w");
        let exact = params.godrays.scattering_per_m * flux_w * segment.length() / (4.0 * PI);
        Ok([0, 1].map(|rule| relative_error(lit().map(|both| both[rule]).sum(), exact)))
    };
    let errors: Vec<_> = BUFFERS.into_iter().zip(EYES).map(errors).collect::<Result<_>>()?;
    let worst = |rule: usize| largest(errors.iter().map(|of| of[rule]));
    Ok(Check::new(rig, "light scattered in along a line by its texels: largest relative error")
        .within((0.02, "1"), worst(0))
        .control("neither distance nor angle", worst(1)))
}

pub struct ScreenSegment {
    ends_m: [DVec3; 2],
    pub from: DVec2,
    pub to: DVec2,
    /// Distances along the view direction of its ends: clip-space w.
    pub w: [f64; 2],
}

impl ScreenSegment {
    /// Between two places in the world.
    pub fn new(ends: [DVec3; 2], rays: &PixelRays) -> Option<ScreenSegment> {
        let [Some(a), Some(b)] = ends.map(|end| rays.project(end)) else { return None };
        let [from, to] = [a, b].map(|end| DVec2::new(end.x_px, end.y_px));
        Some(ScreenSegment { ends_m: ends, from, to, w: [a.w, b.w] })
    }

    pub fn length_px(&self) -> f64 {
        self.from.distance(self.to)
    }

    /// Place of a pixel along the line (pixels from its start, and to its end) and beside it.
    fn place(&self, pixel: DVec2) -> (f64, f64, f64) {
        let along = (self.to - self.from).normalize();
        let offset = pixel - self.from;
        let start = offset.dot(along);
        (start, self.length_px() - start, offset.perp_dot(along).abs())
    }

    /// Place in the world at a share of the line on the screen.
    fn place_m(&self, on_screen: f64) -> DVec3 {
        self.ends_m[0].lerp(self.ends_m[1], self.share(on_screen))
    }

    /// Share of the way in the world at a share of the line on the screen: perspective makes the nearer half longer.
    pub fn share(&self, on_screen: f64) -> f64 {
        let [near, far] = [(1.0 - on_screen) / self.w[0], on_screen / self.w[1]];
        far / (near + far)
    }
}
