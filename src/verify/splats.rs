//! `caustics/splat`: size, intensity, depth test and energy of splats against the f64 twin, by compute and by the rasterizer.

use glam::{DVec3, Vec2};

use super::photons::run_until;
use super::{Case, Check, Checks, Random, Result, Rig, largest, rig};
use fathom_pipelines::Built;
use fathom_pipelines::underwater::{Intensity as Rule, Params, Splatting, Underwater};
use fathom_reference::image::Image;
use fathom_reference::photons::{Landed, PhotonGrid, land_all};
use fathom_reference::plane::CameraDepth;
use fathom_reference::rays::{PixelRays, Tracer};
use fathom_reference::splat::{
    Intensity, PointSize, Splat, SurfaceSplat, rasterize, rasterize_within_surfaces, splat_value,
};
use fathom_scene::{Camera, LightKind, Scene, SceneFile};
use fathom_stages::caustics::splat::{self, SplatCoverage, SplatUniforms};
use fathom_stages::frame::{Shared, View};
use fathom_stages::photon::Photon;
use fathom_stages::splatting::PHOTONS_PER_INSTANCE;

const STAGE: &str = "caustics/splat";
const SIZE: [u32; 2] = [512, 512];
/// UW §4.1.
const MIN_PX: f64 = 5.0;
const MAX_PX: f64 = 20.0;
const GAMMA_PER_M: f64 = 0.13;
/// Power of one photon in synthetic cases, watts.
const PHOTON_W: f64 = 0.02;
/// Distances of synthetic photons from the viewer, metres: sizes of 20 down to 5 px.
const NEAREST_M: f64 = 0.15;
const FARTHEST_M: f64 = 18.0;
/// Vulkan lets a rasterizer move edges by 1/32 pixel: a splat of side s then gains or loses up to a row
/// in 1 of 8 cases, 1/(8 s) of its pixels. A compute shader's places are those of f32, to 1e-4 px.
const fn coverage(splatting: Splatting) -> f64 {
    match splatting {
        Splatting::Raster => 0.03,
        Splatting::Compute => 1e-3,
    }
}
/// Sides of the splats whose squares the buffer's border cuts.
const EXTREMES_PX: [f64; 2] = [0.4, 400.0];
/// Cells per side in which isolated splats lie: 64 px each, more than the largest splat.
const CELLS: u32 = 8;

pub fn cases() -> Vec<Case> {
    let mut cases = vec![
        Case::new(STAGE, "flux of a point light", point_flux),
        Case::new(STAGE, "compute against the rasterizer", alike),
    ];
    for splatting in [Splatting::Compute, Splatting::Raster] {
        let rules = Rules { splatting, ..RULES };
        let mut case = |what: &str, check: fn(&Rig<'_>, Rules) -> Checks| {
            let what = format!("{what}, {}", name(splatting));
            cases.push(Case::new(STAGE, what, move |rig| check(rig, rules)));
        };
        case("isolated splats: size and intensity", isolated);
        case("conserved energy of synthetic photons", conserved);
        case("depth test", depth_test);
        case("splats within one surface", within_surface);
        case("sum of many small contributions", accumulation);
        case("splats that the border cuts", cut);
        case("splats of more pixels than a loop has turns", large);
    }
    for name in ["plane", "tank"] {
        cases.push(Case::new(STAGE, format!("conserved energy of scene {name}"), move |rig| {
            scene_energy(rig, name)
        }));
    }
    cases
}

/// The rules that splats follow, as the reference has them; controls change one.
#[derive(Clone, Copy)]
pub(super) struct Rules {
    intensity: Intensity,
    coverage: SplatCoverage,
    photon_w: f64,
    /// At the far and at the near plane.
    sizes_px: [f64; 2],
    gamma_per_m: f64,
    bias_m: f64,
    /// What draws: nothing that the reference knows.
    splatting: Splatting,
}

pub(super) const RULES: Rules = Rules {
    intensity: Intensity::Paper,
    coverage: SplatCoverage::Square,
    photon_w: PHOTON_W,
    sizes_px: [MIN_PX, MAX_PX],
    gamma_per_m: GAMMA_PER_M,
    bias_m: 0.0,
    splatting: Splatting::Compute,
};

fn name(splatting: Splatting) -> &'static str {
    match splatting {
        Splatting::Compute => "compute",
        Splatting::Raster => "raster",
    }
}

impl Rules {
    /// Splats of photons seen by a camera, in pixels of a buffer.
    fn splats(
        &self,
        camera: &Camera,
        size_px: [u32; 2],
        photons: &[(DVec3, f64)],
    ) -> Result<Vec<Splat>> {
        let eye = DVec3::from(camera.position_m);
        let rays = PixelRays::new(camera, size_px[0], size_px[1]);
        let [min_px, max_px] = self.sizes_px;
        let size = PointSize::new(min_px, max_px, camera.z_near_m, camera.z_far_m)?;
        let splat = |(hit, path_m): &(DVec3, f64)| {
            let center = rays.project(*hit)?;
            let distance_m = hit.distance(eye);
            let biased = *hit + (eye - *hit) * (self.bias_m / distance_m);
            let size_px = size.at(distance_m);
            let Self { intensity, photon_w, gamma_per_m, .. } = *self;
            Some(Splat {
                center_px: [center.x_px, center.y_px],
                depth: rays.project(biased).map_or(0.0, |p| p.depth.max(0.0)),
                size_px,
                value: splat_value(intensity, photon_w, gamma_per_m, *path_m, size_px),
            })
        };
        Ok(photons.iter().filter_map(splat).collect())
    }
}

impl Rules {
    /// The splats of these photons in the planes of what a camera sees at their places.
    fn on_surfaces(
        &self,
        seen: &CameraDepth<'_>,
        photons: &[(DVec3, f64)],
        splats: &[Splat],
    ) -> Vec<SurfaceSplat> {
        let size = SIZE.map(f64::from);
        let rays = PixelRays::new(seen.camera, SIZE[0], SIZE[1]);
        let projected = photons.iter().filter_map(|(hit, _)| rays.project(*hit));
        let placed = projected.zip(splats).map(|(photon, splat)| {
            let texels = seen.depth.size();
            let texel = [0, 1].map(|k| {
                let at = splat.center_px[k] * f64::from(texels[k]) / size[k] + 1e-3;
                (at as i64).clamp(0, i64::from(texels[k]) - 1)
            });
            let plane = seen.plane(texel);
            let own = (seen.view_m(plane.z) - photon.w).abs() <= self.bias_m;
            let per_pixel = |k: usize| plane.slope[k] * f64::from(texels[k]) / size[k];
            let slope = if own { [per_pixel(0), per_pixel(1)] } else { [0.0; 2] };
            SurfaceSplat { splat: *splat, photon_depth: photon.depth, slope }
        });
        placed.collect()
    }
}

/// Runs the stage over photons with nothing to hide them.
pub(super) fn draw_free(rig: &Rig<'_>, view: &View, of: &[Photon], rules: &Rules) -> Result<Image> {
    draw(rig, view, of, &rig.depth(SIZE, 1.0)?, rules)
}

/// Runs the stage over photons and the camera's depth.
fn draw(
    rig: &Rig<'_>,
    view: &View,
    photons: &[Photon],
    depth: &wgpu::Texture,
    rules: &Rules,
) -> Result<Image> {
    let shared = Shared::new(&rig.resources, view);
    let [min_px, max_px] = rules.sizes_px;
    let size = PointSize::new(min_px, max_px, view.camera.z_near_m, view.camera.z_far_m)?;
    // a and b of the size rule from two of its values: s = a + b / d.
    let b = (size.at(1.0) - size.at(2.0)) * 2.0;
    let settings = SplatUniforms {
        size_px: Vec2::new(SIZE[0] as f32, SIZE[1] as f32),
        size_a_px: (size.at(1.0) - b) as f32,
        size_b_px_m: b as f32,
        photon_w: rules.photon_w as f32,
        depth_bias_m: rules.bias_m as f32,
        steps: splat::steps(splat_value(rules.intensity, rules.photon_w, 0.0, 0.0, min_px)),
        photons: photons.len() as u32,
        photons_per_instance: PHOTONS_PER_INSTANCE,
    };
    let buffer = rig.photons(photons);
    let conserving = rules.intensity == Intensity::Conserving;
    let how = (conserving, rules.coverage);
    let (resources, inputs) = (&rig.resources, (&buffer, depth));
    let stage = match rules.splatting {
        Splatting::Compute => {
            splat::scatter(resources, &shared, inputs, &settings, how, [10.0, max_px])?
        }
        Splatting::Raster => splat::raster(resources, &shared, inputs, &settings, how, 10.0)?,
    };
    // Twice: a frame must not add to the one before.
    rig.run(&[&stage, &stage])?;
    rig.channel(&stage.texture, 0)
}

/// A photon on the ray through a point of the buffer, and the f64 values of its rounded numbers.
pub(super) fn photon_at(
    rays: &PixelRays,
    eye: DVec3,
    at_px: [f64; 2],
    distance_m: f64,
    path_m: f64,
) -> (Photon, (DVec3, f64)) {
    let (_, direction, _) = rays.ray_at(at_px[0], at_px[1]);
    let hit = eye + direction * distance_m;
    let photon = rig::photon(hit + DVec3::Y * path_m, hit, path_m);
    (photon, (photon.hit_m.as_dvec3(), f64::from(photon.distance_m)))
}

/// One splat in the middle of each cell, from near to far.
fn isolated(rig: &Rig<'_>, rules: Rules) -> Checks {
    let view = rig::synthetic_view(SIZE, GAMMA_PER_M)?;
    let eye = DVec3::from(view.camera.position_m);
    let rays = PixelRays::new(&view.camera, SIZE[0], SIZE[1]);
    let mut random = Random::new(11);
    let cell_px = f64::from(SIZE[0] / CELLS);
    let (photons, twins): (Vec<_>, Vec<_>) = (0..CELLS * CELLS)
        .map(|i| {
            let middle = |cell: u32| (f64::from(cell) + 0.5) * cell_px;
            let at = [i % CELLS, i / CELLS].map(|cell| middle(cell) + random.within(-8.0, 8.0));
            let share = f64::from(i) / f64::from(CELLS * CELLS - 1);
            let distance_m = NEAREST_M * (FARTHEST_M / NEAREST_M).powf(share);
            photon_at(&rays, eye, at, distance_m, random.within(0.5, 8.0))
        })
        .unzip();
    let image = draw_free(rig, &view, &photons, &rules)?;
    let splats = |rules: Rules| rules.splats(&view.camera, SIZE, &twins);
    let wide = Rules { sizes_px: [MIN_PX, MAX_PX * 1.25], ..rules };
    let murky = Rules { gamma_per_m: GAMMA_PER_M * 1.05, ..rules };
    let what = |of| format!("isolated splats, {}: {of}", name(rules.splatting));
    Ok(vec![
        Check::of(STAGE, what("covered pixels unlike the twin's, of all covered"))
            .within((coverage(rules.splatting), "1"), coverage_error(&image, &splats(rules)?))
            .control("s_max 25 px", coverage_error(&image, &splats(wide)?)),
        Check::of(STAGE, what("largest relative error of intensity"))
            .within((1e-4, "1"), center_error(&image, &splats(rules)?))
            .control("attenuation 5 % higher", center_error(&image, &splats(murky)?)),
    ])
}

/// Pixels that one of image and twin covers and the other does not, relative to those covered.
fn coverage_error(image: &Image, splats: &[Splat]) -> f64 {
    let mut twin = Image::constant(image.width(), image.height(), 0.0);
    rasterize(&mut twin, splats, &Image::constant(1, 1, 1.0), 0.0);
    let pairs = || image.data().iter().zip(twin.data());
    let unlike = pairs().filter(|(a, b)| (**a > 0.0) != (**b > 0.0)).count();
    let covered = pairs().filter(|(_, b)| **b > 0.0).count();
    unlike as f64 / covered.max(1) as f64
}

/// Largest relative error of the pixel at the middle of each splat.
fn center_error(image: &Image, splats: &[Splat]) -> f64 {
    let error = |splat: &Splat| {
        let [x, y] = splat.center_px.map(|c| c.floor() as i64);
        (image.clamped(x, y) / splat.value - 1.0).abs()
    };
    largest(splats.iter().map(error))
}

/// Photons strewn over the view, all of their splats within the buffer.
fn strewn(view: &View, count: u32, nearest_m: f64) -> (Vec<Photon>, Vec<(DVec3, f64)>) {
    let eye = DVec3::from(view.camera.position_m);
    let rays = PixelRays::new(&view.camera, SIZE[0], SIZE[1]);
    let mut random = Random::new(23);
    (0..count)
        .map(|_| {
            let inside = |r: &mut Random, side: u32| r.within(MAX_PX, f64::from(side) - MAX_PX);
            let at = [inside(&mut random, SIZE[0]), inside(&mut random, SIZE[1])];
            let distance_m = random.within(nearest_m, FARTHEST_M);
            photon_at(&rays, eye, at, distance_m, random.within(2.0, 8.0))
        })
        .unzip()
}

/// Sum over the buffer against `Σ I exp(−γ d)`.
fn conserved(rig: &Rig<'_>, rules: Rules) -> Checks {
    let view = rig::synthetic_view(SIZE, GAMMA_PER_M)?;
    let (photons, twins) = strewn(&view, 4096, NEAREST_M);
    let rules = Rules { intensity: Intensity::Conserving, ..rules };
    let sum = draw_free(rig, &view, &photons, &rules)?.sum();
    let energy = |gamma: f64| -> f64 {
        let photon = |(_, path_m): &(DVec3, f64)| PHOTON_W * (-gamma * path_m).exp();
        twins.iter().map(photon).sum()
    };
    let what =
        format!("conserved energy of 4096 photons, {}, relative error", name(rules.splatting));
    Ok(vec![
        Check::of(STAGE, what)
            .within((0.01, "1"), (sum / energy(GAMMA_PER_M) - 1.0).abs())
            .control("attenuation 5 % higher", (sum / energy(GAMMA_PER_M * 1.05) - 1.0).abs()),
    ])
}

/// Splats before and behind a wall that faces the camera.
fn depth_test(rig: &Rig<'_>, rules: Rules) -> Checks {
    const WALL_M: f64 = 5.0;
    let view = rig::synthetic_view(SIZE, GAMMA_PER_M)?;
    let eye = DVec3::from(view.camera.position_m);
    let rays = PixelRays::new(&view.camera, SIZE[0], SIZE[1]);
    let wall = rays.project(eye + view.camera.direction() * WALL_M);
    let depth = wall.map_or(1.0, |wall| wall.depth);
    let (photons, twins) = strewn(&view, 2000, 3.0);
    let rules = Rules { bias_m: 0.3, ..rules };
    let image = draw(rig, &view, &photons, &rig.depth(SIZE, depth)?, &rules)?;
    let error = |rules: Rules| -> Result<f64> {
        let mut twin = Image::constant(SIZE[0], SIZE[1], 0.0);
        let wall = Image::constant(1, 1, depth);
        rasterize(&mut twin, &rules.splats(&view.camera, SIZE, &twins)?, &wall, 0.0);
        Ok((image.sum() / twin.sum() - 1.0).abs())
    };
    let what = format!("splats before a wall, {}: sum, relative error", name(rules.splatting));
    Ok(vec![
        Check::of(STAGE, what)
            .within((0.01, "1"), error(rules)?)
            .control("bias 1 m instead of 0.3 m", error(Rules { bias_m: 1.0, ..rules })?),
    ])
}

/// Exact photons of a scene with many edges, drawn where their own surface is seen: against the twin, pixel by pixel.
fn within_surface(rig: &Rig<'_>, rules: Rules) -> Checks {
    const VIEW: [u32; 2] = [400, 400];
    const GRID: u32 = 48;
    const BIAS_M: f64 = 0.3;
    let scene = Scene::load("tank")?;
    let stand = rig.stand(&scene, VIEW);
    let drawn = rig.gbuffer(&stand)?;
    let depth = rig.channel(&drawn.depth, 0)?;
    let tracer = Tracer::new(&scene.objects)?;
    let landings = land_all(
        &stand.view.light_frame(),
        &scene.water,
        &tracer,
        PhotonGrid::new(GRID, 4)?.with_jitter(1.0),
        1,
    );
    let landed = landings.iter().filter_map(|landing| landing.landed());
    let (photons, twins): (Vec<_>, Vec<_>) = landed.map(stored).unzip();
    let rules = Rules { coverage: SplatCoverage::Surface, bias_m: BIAS_M, ..rules };
    let image = draw(rig, &stand.view, &photons, &drawn.depth, &rules)?;

    let seen = CameraDepth { depth: &depth, camera: &scene.camera };
    let splats = rules.splats(&scene.camera, SIZE, &twins)?;
    let placed = rules.on_surfaces(&seen, &twins, &splats);
    let mut twin = Image::constant(SIZE[0], SIZE[1], 0.0);
    rasterize_within_surfaces(&mut twin, &placed, &seen, BIAS_M);
    let mut squares = Image::constant(SIZE[0], SIZE[1], 0.0);
    rasterize(&mut squares, &splats, &depth, 0.0);
    let what = format!("splats within one surface, {}", name(rules.splatting));
    // A plane's depth at a pixel is a difference of depths in f32: at 10 m it decides about pixels to within a millimetre.
    let tolerance = coverage(Splatting::Raster);
    Ok(vec![
        Check::of(STAGE, format!("{what}: sum of |difference from the twin|, of the sum"))
            .within((tolerance, "1"), difference(&image, &twin))
            .control("squares over silhouettes", difference(&image, &squares))
            .with("sum_over_that_of_squares", twin.sum() / squares.sum()),
    ])
}

/// Thousands of contributions of 0.001 on one place: a 16-bit float sticks at 2 (PAPERS, UW "silent or wrong"), and 32 bits of a
/// fixed-point sum begin anew at 0.256.
fn accumulation(rig: &Rig<'_>, rules: Rules) -> Checks {
    const PHOTONS: usize = 8192;
    const EACH_W: f64 = 1e-3;
    let view = rig::synthetic_view(SIZE, 0.0)?;
    let eye = DVec3::from(view.camera.position_m);
    let rays = PixelRays::new(&view.camera, SIZE[0], SIZE[1]);
    let (photon, _) = photon_at(&rays, eye, [256.5, 256.5], 4.0, 1.0);
    let rules = Rules { photon_w: EACH_W, gamma_per_m: 0.0, ..rules };
    let image = draw_free(rig, &view, &vec![photon; PHOTONS], &rules)?;
    let expected = EACH_W * PHOTONS as f64;
    let what = format!(
        "8192 contributions of 0.001 at one pixel, {}, relative error",
        name(rules.splatting)
    );
    // Each f32 addition near 8 rounds by up to 2⁻²¹; a fixed-point sum rounds when it is turned into an f32.
    let tolerance = match rules.splatting {
        Splatting::Raster => 1e-3,
        Splatting::Compute => 1e-6,
    };
    Ok(vec![
        Check::of(STAGE, what)
            .within((tolerance, "1"), (image.clamped(256, 256) / expected - 1.0).abs())
            .control(
                "sum in a 16-bit float",
                (half_float_sum(EACH_W, PHOTONS) / expected - 1.0).abs(),
            ),
    ])
}

/// Splats of all sizes around the border, cut by it on each side; some lie all beyond it. Others are larger than the buffer's half.
fn cut(rig: &Rig<'_>, rules: Rules) -> Checks {
    let view = rig::synthetic_view(SIZE, GAMMA_PER_M)?;
    let eye = DVec3::from(view.camera.position_m);
    let rays = PixelRays::new(&view.camera, SIZE[0], SIZE[1]);
    let mut random = Random::new(31);
    let side = f64::from(SIZE[0]);
    let (photons, twins): (Vec<_>, Vec<_>) = (0..400)
        .map(|i| {
            let (along, beside) = (random.within(-0.2, 1.2), random.within(-0.05, 0.05));
            let at = match i % 4 {
                0 => [along, beside],
                1 => [along, 1.0 + beside],
                2 => [beside, along],
                _ => [1.0 + beside, along],
            };
            let share = random.within(0.0, 1.0);
            let distance_m = NEAREST_M * (FARTHEST_M / NEAREST_M).powf(share);
            photon_at(&rays, eye, at.map(|a| a * side), distance_m, random.within(0.5, 8.0))
        })
        .unzip();
    extremes(rig, (&photons, &twins), rules, "splats of 0.4 to 400 px cut by the border")
}

/// Splats of extreme sizes against the twin's.
fn extremes(rig: &Rig<'_>, of: (&[Photon], &[(DVec3, f64)]), rules: Rules, what: &str) -> Checks {
    let (photons, twins) = of;
    let view = rig::synthetic_view(SIZE, GAMMA_PER_M)?;
    let rules = Rules { sizes_px: EXTREMES_PX, ..rules };
    let image = draw_free(rig, &view, photons, &rules)?;
    let twin = |rules: Rules| -> Result<Image> {
        let mut twin = Image::constant(SIZE[0], SIZE[1], 0.0);
        let splats = rules.splats(&view.camera, SIZE, twins)?;
        rasterize(&mut twin, &splats, &Image::constant(1, 1, 1.0), 0.0);
        Ok(twin)
    };
    let what = format!("{what}, {}", name(rules.splatting));
    let wide = Rules { sizes_px: [EXTREMES_PX[0], 1.25 * EXTREMES_PX[1]], ..rules };
    Ok(vec![
        Check::of(STAGE, format!("{what}: Σ |difference| / Σ"))
            .within((coverage(rules.splatting), "1"), difference(&image, &twin(rules)?))
            .control("s_max 500 px", difference(&image, &twin(wide)?)),
    ])
}

/// Splats of more pixels than an adapter may make turns of an invocation's loops.
fn large(rig: &Rig<'_>, rules: Rules) -> Checks {
    let view = rig::synthetic_view(SIZE, GAMMA_PER_M)?;
    let eye = DVec3::from(view.camera.position_m);
    let rays = PixelRays::new(&view.camera, SIZE[0], SIZE[1]);
    let photon = |at| photon_at(&rays, eye, at, 0.105, 1.0);
    let (photons, twins): (Vec<_>, Vec<_>) =
        [[250.3, 260.8], [240.1, 300.6]].map(photon).into_iter().unzip();
    extremes(rig, (&photons, &twins), rules, "splats of 380 px")
}

/// Sum of the absolute differences of two images' pixels, relative to the second's sum.
fn difference(image: &Image, other: &Image) -> f64 {
    let pairs = image.data().iter().zip(other.data());
    pairs.map(|(a, b)| (a - b).abs()).sum::<f64>() / other.sum()
}

/// Scene `tank` with 36,864 photons: the compute shader's sums against the rasterizer's, pixel by pixel.
fn alike(rig: &Rig<'_>) -> Result<Check> {
    let file = SceneFile::load("tank")?;
    let scene = Scene::build(&file)?;
    let drawn = |splatting: Splatting, bias_m: f64| -> Result<Image> {
        let mut params = Params::from(&file);
        (params.view.width, params.view.height) = (400, 400);
        params.caustics.grid = 96;
        params.caustics.buffer = SIZE;
        params.caustics.splatting = splatting;
        params.caustics.depth_bias_m = bias_m;
        let pipeline = Built::<Underwater>::new(rig.gpu, &scene, &params)?;
        run_until(rig, &pipeline, STAGE)?;
        splat_image(rig, &pipeline)
    };
    let bias_m = Params::from(&file).caustics.depth_bias_m;
    let raster = drawn(Splatting::Raster, bias_m)?;
    let [scattered, unlike] =
        [bias_m, 2.0 * bias_m].map(|bias_m| drawn(Splatting::Compute, bias_m));
    let scattered = scattered?;
    Ok(Check::of(STAGE, "scene tank, compute against the rasterizer: Σ |difference| / Σ")
        .within((coverage(Splatting::Raster), "1"), difference(&scattered, &raster))
        .control("twice the depth bias", difference(&unlike?, &raster))
        .with("relative_difference_of_sums", scattered.sum() / raster.sum() - 1.0))
}

/// What a 16-bit float target holds after adding `each` `count` times, rounding to 11 bits.
fn half_float_sum(each: f64, count: usize) -> f64 {
    let round = |v: f64| {
        let step = 2f64.powi(v.log2().floor() as i32 - 10);
        (v / step).round_ties_even() * step
    };
    (0..count).fold(0.0, |sum, _| round(sum + each))
}

/// Exact photons of a whole scene through G-buffer and splats, against the twin over exact depth. The
/// same with the photons of the pipeline's own estimator is a figure: it holds the method's error too.
fn scene_energy(rig: &Rig<'_>, name: &str) -> Result<Check> {
    let file = SceneFile::load(name)?;
    let scene = Scene::build(&file)?;
    let params = energy_params(&file);
    let pipeline = Built::<Underwater>::new(rig.gpu, &scene, &params)?;
    run_until(rig, &pipeline, STAGE)?;
    let estimated = splat_image(rig, &pipeline)?.sum();

    let tracer = Tracer::new(&scene.objects)?;
    let frame = pipeline.view.light_frame();
    let grid = PhotonGrid::new(params.caustics.grid, params.caustics.subdivision)?;
    let landings = land_all(&frame, &scene.water, &tracer, grid, 1);
    let landed = landings.iter().filter_map(|landing| landing.landed());
    let (photons, twins): (Vec<_>, Vec<_>) = landed.map(stored).unzip();
    let rules = Rules {
        intensity: Intensity::Conserving,
        photon_w: frame.emitted_w / grid.count() as f64,
        bias_m: params.caustics.depth_bias_m,
        gamma_per_m: scene.water.attenuation_per_m,
        ..RULES
    };
    let view_px = [params.view.width, params.view.height];
    // Over the depth of the scene as `scene/gbuffer` draws it.
    let drawn = rig.gbuffer(&rig.stand(&scene, view_px))?;
    let sum = draw(rig, &pipeline.view, &photons, &drawn.depth, &rules)?.sum();
    let depth = exact_depth(&scene.camera, &tracer, view_px);
    let expected = |rules: Rules| -> Result<f64> {
        let mut twin = Image::constant(SIZE[0], SIZE[1], 0.0);
        rasterize(&mut twin, &rules.splats(&scene.camera, SIZE, &twins)?, &depth, 0.0);
        Ok(twin.sum())
    };
    let murky = Rules { gamma_per_m: rules.gamma_per_m * 1.05, ..rules };
    let energy = expected(rules)?;
    let what = format!("scene {name}: conserved energy of exact photons, relative error");
    Ok(Check::of(STAGE, what)
        .within((0.01, "1"), (sum / energy - 1.0).abs())
        .control("attenuation 5 % higher", (sum / expected(murky)? - 1.0).abs())
        .with("emitted_w", frame.emitted_w)
        .with("seen_w", sum)
        .with("error_with_estimated_photons", estimated / energy - 1.0))
}

/// A point light over a level floor, through water that neither refracts nor absorbs: the flux that a camera straight above
/// sees is intensity × solid angle of the rectangle it looks at.
fn point_flux(rig: &Rig<'_>) -> Result<Check> {
    const LIGHT_M: f64 = 3.0;
    const CAMERA_M: f64 = 6.0;
    let mut file = SceneFile::load("plane")?;
    file.water.amplitude_m = 0.0;
    file.water.attenuation_per_m = 0.0;
    file.water.refractive_index = 1.0;
    file.light.kind = LightKind::Point;
    file.light.position_m = [0.0, LIGHT_M, 0.0];
    file.camera.position_m = [0.0, CAMERA_M, 0.0];
    file.camera.target_m = [0.0, 0.0, 0.0];
    file.camera.up = [0.0, 0.0, -1.0];
    (file.camera.z_near_m, file.camera.z_far_m) = (0.5, 15.0);
    let scene = Scene::build(&file)?;
    let mut params = energy_params(&file);
    params.caustics.grid = 128;
    let pipeline = Built::<Underwater>::new(rig.gpu, &scene, &params)?;
    run_until(rig, &pipeline, STAGE)?;
    let seen_w = splat_image(rig, &pipeline)?.sum();

    let half_m = (CAMERA_M + file.floor_depth_m) * (file.camera.fov_y_deg.to_radians() / 2.0).tan();
    // Ω = 4 asin(h² / (h² + d²)) of a square of half side h at a distance d from its middle.
    let flux_w = |height_m: f64| {
        let d = height_m + file.floor_depth_m;
        4.0 * (half_m.powi(2) / (half_m.powi(2) + d * d)).asin() * file.light.intensity_w_sr
    };
    Ok(Check::of(STAGE, "flux of a point light through the view, relative error")
        .within((0.01, "1"), (seen_w / flux_w(LIGHT_M) - 1.0).abs())
        .control("light 0.5 m higher", (seen_w / flux_w(LIGHT_M + 0.5) - 1.0).abs()))
}

/// An exact photon as the GPU stores it, and the f64 values of its rounded numbers.
fn stored(landed: &Landed) -> (Photon, (DVec3, f64)) {
    let photon = rig::photon(landed.entry.position, landed.hit.position, landed.hit.distance_m);
    (photon, (photon.hit_m.as_dvec3(), f64::from(photon.distance_m)))
}

pub(super) fn energy_params(file: &SceneFile) -> Params {
    let mut params = Params::from(file);
    (params.view.width, params.view.height) = (400, 400);
    params.caustics.grid = 64;
    params.caustics.subdivision = 4;
    params.caustics.buffer = SIZE;
    params.caustics.intensity = Rule::Conserving;
    params
}

pub(super) fn splat_image(rig: &Rig<'_>, pipeline: &Underwater) -> Result<Image> {
    rig.channel(&pipeline.caustics.drawn.texture, 0)
}

/// Depth that an exact rasterizer stores at each pixel of a camera.
fn exact_depth(camera: &Camera, tracer: &Tracer, size_px: [u32; 2]) -> Image {
    let rays = PixelRays::new(camera, size_px[0], size_px[1]);
    Image::of(size_px, |x, y| rays.cast(tracer, x, y).map_or(1.0, |(_, depth)| depth))
}
