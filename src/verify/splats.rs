//! `caustics/splat`: size, intensity, depth test and energy of splats against the f64 twin, by compute and by the rasterizer.

use crate::prelude::*;
use fathom_pipelines::underwater::{IntensityRule as Rule, Params, Splatting, Underwater};
use fathom_reference::splat::{Splat, SplatSize, rasterize, splat_value};
use fathom_stages::caustics::splat::{self, SplatCoverage, SplatStyle, SplatUniforms};
use half::f16;

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
/// Places of splats are those of f32, to 1e-4 px: quads cover whole pixels, so that no rasterizer's rounding of corners counts.
const COVERAGE: f64 = 1e-3;
/// In 16-bit floats, which lose half a step in each addition.
const SHORT_COVERAGE: f64 = 0.03;
/// Sides of the splats whose squares the buffer's border cuts.
const EXTREMES_PX: [f64; 2] = [0.4, 400.0];
/// Cells per side in which isolated splats lie: 64 px each, more than the largest splat.
const CELLS: u32 = 8;

pub fn cases() -> Vec<Case> {
    let mut cases = vec![Case::new(STAGE, "flux of a point light", point_flux)];
    for splatting in [Splatting::Compute, Splatting::Raster] {
        let rules = Rules { splatting, ..RULES };
        cases.extend([
            by(rules, "isolated splats: size and intensity", isolated),
            by(rules, "conserved energy of synthetic photons", conserved),
            by(rules, "depth test", depth_test),
            by(rules, "splats within one surface", within_surface),
            by(rules, "sum of many small contributions", accumulation),
            by(rules, "splats that the border cuts", cut),
            by(rules, "border of the picture", border),
            by(rules, "splats of more pixels than a loop has turns", large),
        ]);
    }
    cases
}

fn by<C: Into<Vec<Check>> + 'static>(
    rules: Rules,
    what: &str,
    check: fn(&Rig<'_>, Rules) -> Result<C>,
) -> Case {
    Case::new(STAGE, format!("{what}, {}", name(rules.splatting)), move |rig| check(rig, rules))
}

/// The rules that splats follow, as the reference has them; controls change one.
#[derive(Clone, Copy)]
pub struct Rules {
    /// Whether intensity is divided by a splat's area, so that a photon keeps its energy.
    conserving: bool,
    coverage: SplatCoverage,
    photon_w: f64,
    /// At the far and at the near plane.
    sizes_px: [f64; 2],
    gamma_per_m: f64,
    bias_m: f64,
    /// What draws: nothing that the reference knows.
    splatting: Splatting,
}

pub const RULES: Rules = Rules {
    conserving: false,
    coverage: SplatCoverage::Square,
    photon_w: PHOTON_W,
    sizes_px: [MIN_PX, MAX_PX],
    gamma_per_m: GAMMA_PER_M,
    bias_m: 0.0,
    splatting: Splatting::Compute,
};

fn name(splatting: Splatting) -> String {
    format!("{splatting:?}").to_lowercase()
}

/// A control of [`Rules::murkier`].
const MURKIER: &str = "attenuation 5 % higher";

impl Rules {
    fn murkier(self) -> Rules {
        Rules { gamma_per_m: self.gamma_per_m * 1.05, ..self }
    }

    /// Splats of photons seen by a camera, in pixels of a buffer.
    fn splats(&self, camera: &Camera, photons: &[HitPath]) -> Result<Vec<Splat>> {
        let eye = camera.position();
        let rays = PixelRays::new(camera, SIZE[0], SIZE[1]);
        let [min_px, max_px] = self.sizes_px;
        let size = SplatSize::new(min_px, max_px, camera.z_near_m, camera.z_far_m);
        let splat = |(hit, path_m): &HitPath| {
            let center = rays.project(*hit)?;
            let distance_m = hit.distance(eye);
            let biased = *hit + (eye - *hit) * (self.bias_m / distance_m);
            let size_px = size.size_px(distance_m);
            let Self { conserving, photon_w, gamma_per_m, .. } = *self;
            Some(Splat {
                center_px: [center.x_px, center.y_px],
                depth: rays.project(biased).map_or(0.0, |p| p.depth.max(0.0)),
                size_px,
                value: splat_value(conserving, photon_w, gamma_per_m, *path_m, size_px),
            })
        };
        Ok(photons.iter().filter_map(splat).collect())
    }

    /// The rasterizer adds them up in 16-bit floats.
    fn is_short(&self, rig: &Rig<'_>) -> bool {
        self.splatting == Splatting::Raster && rig.sums_are_short()
    }

    /// Tolerance of pixels covered and what they add up to.
    fn coverage(&self, rig: &Rig<'_>) -> f64 {
        if self.is_short(rig) { SHORT_COVERAGE } else { COVERAGE }
    }

    /// This tolerance, where a value in the buffer is known to it.
    fn tolerance_for(&self, rig: &Rig<'_>, tolerance: f64) -> f64 {
        if self.is_short(rig) { rig::SHORT_STEP } else { tolerance }
    }

    /// What these splats add up to, before what is seen at this depth.
    fn twin(&self, camera: &Camera, photons: &[HitPath], depth: &Image) -> Result<Image> {
        let mut twin = Image::constant(SIZE[0], SIZE[1], 0.0);
        rasterize(&mut twin, &self.splats(camera, photons)?, depth, 0.0);
        Ok(twin)
    }
}

/// Where a photon has landed, and its path under water: the f64 values of the GPU's rounded numbers.
type HitPath = (DVec3, f64);

/// Runs the stage over photons with nothing to hide them.
pub fn draw_free(rig: &Rig<'_>, view: &View, of: &[Photon], rules: &Rules) -> Result<Image> {
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
    let shared = Shared::new(rig, view);
    let [min_px, max_px] = rules.sizes_px;
    let size = SplatSize::new(min_px, max_px, view.camera.z_near_m, view.camera.z_far_m);
    // a and b of the size rule from two of its values: s = a + b / d.
    let b = (size.size_px(1.0) - size.size_px(2.0)) * 2.0;
    let contributions = [max_px, min_px]
        .map(|side_px| splat_value(rules.conserving, rules.photon_w, 0.0, 0.0, side_px));
    let settings = SplatUniforms {
        size_px: view.size_px.as_vec2(),
        size_a_px: (size.size_px(1.0) - b) as f32,
        size_b_px_m: b as f32,
        photon_w: rules.photon_w as f32,
        depth_bias_m: rules.bias_m as f32,
        steps: splat::steps(contributions),
        photons: photons.len() as u32,
        photons_per_instance: PHOTONS_PER_INSTANCE,
    };
    let Rules { conserving, coverage, .. } = *rules;
    let style = SplatStyle { conserving, coverage, typical_px: 10.0, max_px };
    let photons = &rig.photons(photons);
    let stage = match rules.splatting {
        Splatting::Compute => splat::scatter(rig, &shared, photons, depth, &settings, style)?,
        Splatting::Raster => splat::raster(rig, &shared, photons, depth, &settings, style)?,
    };
    // Twice: a frame must not add to the one before.
    rig.draw(&[&stage, &stage], &stage.texture, 0)
}

/// A photon on the ray through a point of a view.
pub fn photon_at(view: &View, at_px: [f64; 2], distance_m: f64, path_m: f64) -> (Photon, HitPath) {
    let (_, direction, _) = rig::rays(view).ray_at(at_px[0], at_px[1]);
    let hit = view.camera.position() + direction * distance_m;
    let photon = rig::photon(hit + DVec3::Y * path_m, hit, path_m);
    (photon, (photon.hit_m.as_dvec3(), f64::from(photon.distance_m)))
}

/// A photon at a distance between the nearest and the farthest, evenly in its logarithm.
fn photon_between(view: &View, at_px: [f64; 2], share: f64, path_m: f64) -> (Photon, HitPath) {
    photon_at(view, at_px, NEAREST_M * (FARTHEST_M / NEAREST_M).powf(share), path_m)
}

/// Nothing hides a splat.
fn open() -> Image {
    Image::constant(1, 1, 1.0)
}

/// One splat in the middle of each cell, from near to far.
fn isolated(rig: &Rig<'_>, rules: Rules) -> Checks {
    let view = rig::synthetic_view(SIZE, GAMMA_PER_M)?;
    let mut random = Random::new(11);
    let cell_px = f64::from(SIZE[0] / CELLS);
    let (photons, twins): (Vec<_>, Vec<_>) = (0..CELLS * CELLS)
        .map(|i| {
            let middle = |cell: u32| (f64::from(cell) + 0.5) * cell_px;
            let at = [i % CELLS, i / CELLS].map(|cell| middle(cell) + random.within(-8.0, 8.0));
            let share = f64::from(i) / f64::from(CELLS * CELLS - 1);
            photon_between(&view, at, share, random.within(0.5, 8.0))
        })
        .unzip();
    let image = draw_free(rig, &view, &photons, &rules)?;
    // Pixels that one of image and twin covers and the other does not, relative to those covered.
    let coverage_error = |rules: &Rules| -> Result<f64> {
        let twin = rules.twin(&view.camera, &twins, &open())?;
        let pairs = || image.data().iter().zip(twin.data());
        let unlike = pairs().filter(|(a, b)| (**a > 0.0) != (**b > 0.0)).count();
        let covered = pairs().filter(|(_, b)| **b > 0.0).count();
        Ok(unlike as f64 / covered.max(1) as f64)
    };
    // Of the pixel at the middle of each splat.
    let center_error = |rules: &Rules| -> Result<f64> {
        let splats = rules.splats(&view.camera, &twins)?;
        Ok(largest(splats.iter().map(|splat| {
            let [x, y] = splat.center_px.map(|c| c.floor() as i64);
            relative_error(image.clamped(x, y), splat.value)
        })))
    };
    let wide = Rules { sizes_px: [MIN_PX, MAX_PX * 1.25], ..rules };
    let what = |of| format!("isolated splats, {}: {of}", name(rules.splatting));
    Ok(vec![
        Check::new(rig, what("covered pixels unlike the twin's, of all covered"))
            .within((COVERAGE, "1"), coverage_error(&rules)?)
            .control("s_max 25 px", coverage_error(&wide)?),
        Check::new(rig, what("largest relative error of intensity"))
            .within((rules.tolerance_for(rig, 1e-4), "1"), center_error(&rules)?)
            .control(MURKIER, center_error(&rules.murkier())?),
    ])
}

/// Photons strewn over the view, all of their splats within the buffer.
fn scatter(view: &View, count: u32, nearest_m: f64) -> (Vec<Photon>, Vec<HitPath>) {
    let mut random = Random::new(23);
    (0..count)
        .map(|_| {
            let at = SIZE.map(|side| random.within(MAX_PX, f64::from(side) - MAX_PX));
            let distance_m = random.within(nearest_m, FARTHEST_M);
            photon_at(view, at, distance_m, random.within(2.0, 8.0))
        })
        .unzip()
}

/// Sum over the buffer against `Σ I exp(−γ d)`.
fn conserved(rig: &Rig<'_>, rules: Rules) -> Result<Check> {
    let view = rig::synthetic_view(SIZE, GAMMA_PER_M)?;
    let (photons, twins) = scatter(&view, 4096, NEAREST_M);
    let rules = Rules { conserving: true, ..rules };
    let sum = draw_free(rig, &view, &photons, &rules)?.sum();
    let error = |rules: Rules| {
        let left = |(_, path_m): &HitPath| transmittance(rules.gamma_per_m, *path_m);
        relative_error(sum, twins.iter().map(|twin| PHOTON_W * left(twin)).sum())
    };
    let drawn_by = name(rules.splatting);
    Ok(Check::new(rig, format!("conserved energy of 4096 photons, {drawn_by}, relative error"))
        .within((0.01, "1"), error(rules))
        .control(MURKIER, error(rules.murkier())))
}

/// Splats before and behind a wall that faces the camera.
fn depth_test(rig: &Rig<'_>, rules: Rules) -> Result<Check> {
    let view = rig::synthetic_view(SIZE, GAMMA_PER_M)?;
    let depth = rig::depth_ahead(&view, 5.0);
    let (photons, twins) = scatter(&view, 2000, 3.0);
    let rules = Rules { bias_m: 0.3, ..rules };
    let sum = draw(rig, &view, &photons, &rig.depth(SIZE, depth)?, &rules)?.sum();
    let error = |rules: Rules| -> Result<f64> {
        let wall = Image::constant(1, 1, depth);
        Ok(relative_error(sum, rules.twin(&view.camera, &twins, &wall)?.sum()))
    };
    let drawn_by = name(rules.splatting);
    Ok(Check::new(rig, format!("splats before a wall, {drawn_by}: sum, relative error"))
        .within((0.01, "1"), error(rules)?)
        .control("bias 1 m instead of 0.3 m", error(Rules { bias_m: 1.0, ..rules })?))
}

/// Photons at places of a random share, 0 to 1, and height.
fn photons_at(random: &mut Random, place: impl Fn(f64, f64) -> DVec3) -> Vec<Photon> {
    let photon = |_| {
        let hit = place(random.number(), random.within(-0.8, 0.8));
        rig::photon(hit + DVec3::Y, hit, 1.0)
    };
    (0..200).map(photon).collect()
}

/// Splats at the edge of a wall leave one behind it dark, and those on a slanted wall are not hidden by it.
fn within_surface(rig: &Rig<'_>, rules: Rules) -> Checks {
    let mut random = Random::new(17);
    let drawn = |fixture: &Fixture, photons: &[Photon], coverage: SplatCoverage, bias_m: f64| {
        let depth = rig.gbuffer(fixture)?.depth;
        let image =
            draw(rig, &fixture.view, photons, &depth, &Rules { coverage, bias_m, ..rules })?;
        Ok::<_, VerifyError>((image, rig.channel(&depth, 0)?))
    };
    let (walls, between) = rig.two_walls(SIZE, [3.0, 4.0], [DVec3::Z; 2])?;
    let at_edge = photons_at(&mut random, |share, y| DVec3::new(-0.02 - 0.01 * share, y, -3.0));
    let leak = |coverage: SplatCoverage| -> Result<f64> {
        let (image, depth) = drawn(&walls, &at_edge, coverage, 0.3)?;
        let behind = pixels(SIZE).filter(|at| depth.get(*at) > between);
        Ok(behind.map(|at| image.get(at)).sum::<f64>() / image.sum())
    };
    let slope = DVec3::new(0.0, 0.5, -3f64.sqrt() / 2.0);
    let mut scene = walls.scene.clone();
    let wall = Mesh::parallelogram(DVec3::NEG_Z * 3.0, 9.0 * DVec3::X, 9.0 * slope);
    scene.objects = vec![Object::new("wall", wall)];
    let slanted = rig.fixture(scene, SIZE)?;
    let on_slope = photons_at(&mut random, |share, y| {
        DVec3::NEG_Z * 3.0 + (2.0 * share - 1.0) * DVec3::X + y * slope
    });
    let whole = draw_free(rig, &slanted.view, &on_slope, &rules)?;
    let hidden = |coverage: SplatCoverage| -> Result<f64> {
        Ok(difference(&drawn(&slanted, &on_slope, coverage, 0.01)?.0, &whole))
    };
    // In the pixels that the edge crosses the wall behind is seen, whose slope is none of theirs.
    let mut scene = walls.scene.clone();
    let behind = DVec3::new(0.5, 0.0, 3f64.sqrt() / 2.0);
    scene.objects[1].mesh = Mesh::parallelogram(DVec3::NEG_Z * 4.0, 9.0 * behind, 9.0 * DVec3::Y);
    let rotated = rig.fixture(scene, SIZE)?;
    let across = |far_m: f64| -> Vec<Photon> {
        let hit = |i: i32| DVec3::new(-0.0202 - far_m, 0.004 * f64::from(i), -3.0);
        (-200..200).map(|i| rig::photon(hit(i) + DVec3::Y, hit(i), 1.0)).collect()
    };
    let (level, depth) = drawn(&walls, &across(0.0), SplatCoverage::Surface, 0.01)?;
    let unlike = |far_m: f64| -> Result<f64> {
        let (image, _) = drawn(&rotated, &across(far_m), SplatCoverage::Surface, 0.01)?;
        let near = pixels(SIZE).filter(|at| depth.get(*at) < between);
        Ok(near.map(|at| (image.get(at) - level.get(at)).abs()).sum::<f64>() / level.sum())
    };
    let what = |of: &str| format!("splats within one surface, {}: {of}", name(rules.splatting));
    Ok(vec![
        Check::new(rig, what("share of the light that is on a wall behind"))
            .within((0.0, "1"), leak(SplatCoverage::Surface)?)
            .control("squares over silhouettes", leak(SplatCoverage::Square)?),
        Check::new(rig, what("share of the light that a slanted wall hides"))
            .within((rules.coverage(rig), "1"), hidden(SplatCoverage::Surface)?)
            .control("squares", hidden(SplatCoverage::Square)?),
        Check::new(rig, what("share of the light that a slanted wall behind changes"))
            .within((rules.coverage(rig), "1"), unlike(0.0)?)
            .control("photons a pixel from the edge", unlike(0.004)?),
    ])
}

/// Contributions that a 16-bit float adds up to within a hundredth.
const FEW: usize = 16;

/// Thousands of contributions of 0.001 on one place: a 16-bit float sticks at 2 (PAPERS, UW "silent or wrong"), and 32 bits of a
/// fixed-point sum begin anew at 0.256.
fn accumulation(rig: &Rig<'_>, rules: Rules) -> Result<Check> {
    const EACH_W: f64 = 1e-3;
    let short = rules.is_short(rig);
    let count = if short { FEW } else { 8192 };
    // No square: its rows are not as many as its columns.
    const BUFFER: [u32; 2] = [512, 384];
    let view = rig::synthetic_view(BUFFER, 0.0)?;
    let (photon, _) = photon_at(&view, [256.5, 192.5], 4.0, 1.0);
    let rules = Rules { photon_w: EACH_W, gamma_per_m: 0.0, ..rules };
    let image = draw(rig, &view, &vec![photon; count], &rig.depth(BUFFER, 1.0)?, &rules)?;
    let error = |sum: f64| relative_error(sum, EACH_W * count as f64);
    // Each f32 addition near 8 rounds by up to 2⁻²¹; a fixed-point sum rounds when it is turned into an f32.
    let tolerance = match rules.splatting {
        Splatting::Raster if short => 0.5 * FEW as f64 * rig::SHORT_STEP,
        Splatting::Raster => 1e-3,
        Splatting::Compute => 1e-6,
    };
    let drawn_by = name(rules.splatting);
    let what = format!("{count} contributions of 0.001 at one pixel, {drawn_by}, relative error");
    let check = Check::new(rig, what).within((tolerance, "1"), error(image.clamped(256, 192)));
    let added = |sum: f16| f16::from_f64(f64::from(sum) + EACH_W);
    let halves = (0..count).fold(f16::ZERO, |sum, _| added(sum));
    Ok(if short {
        check.control("a photon less", error(EACH_W * (count - 1) as f64))
    } else {
        check.control("sum in a 16-bit float", error(halves.into()))
    })
}

/// Splats of all sizes around the border, cut by it on each side; some lie all beyond it. Others are larger than the buffer's half.
fn cut(rig: &Rig<'_>, rules: Rules) -> Result<Check> {
    let view = rig::synthetic_view(SIZE, GAMMA_PER_M)?;
    let mut random = Random::new(31);
    let side = f64::from(SIZE[0]);
    let photons = (0..400).map(|i| {
        let (along, beside) = (random.within(-0.2, 1.2), random.within(-0.05, 0.05));
        let at = match i % 4 {
            0 => [along, beside],
            1 => [along, 1.0 + beside],
            2 => [beside, along],
            _ => [1.0 + beside, along],
        };
        let share = random.within(0.0, 1.0);
        photon_between(&view, at.map(|a| a * side), share, random.within(0.5, 8.0))
    });
    extremes(rig, &view, photons, rules, "splats of 0.4 to 400 px cut by the border")
}

/// A picture is the middle of one three times as wide and as high, seen from the same eye: of a slanted floor, with a depth twice as fine
/// as the buffer, and photons in the middle and beyond its border.
fn border(rig: &Rig<'_>, rules: Rules) -> Result<Check> {
    const BUFFER: [u32; 2] = [96, 72];
    let fixture = |times: u32| -> Result<Fixture> {
        let mut scene = rig::flat_plane(LightKind::Directional)?;
        (scene.camera.up, scene.camera.target_m) = ([0.3, 1.0, 0.1], [0.0, -5.0, 0.0]);
        scene.camera.fov_y_deg = 2.0 * (0.36 * f64::from(times)).atan().to_degrees();
        rig.fixture(scene, BUFFER.map(|side| 2 * times * side))
    };
    let (own, wider, mut random) = (fixture(1)?, fixture(3)?, Random::new(13));
    let photon = |_| {
        let [x, y] = BUFFER.map(|side| 2.0 * f64::from(side) * random.within(-0.2, 1.2));
        let (origin, direction, _) = own.rays.ray_at(x, y);
        let hit = own.tracer.cast(origin, direction, 0.0, f64::MAX)?.position;
        Some(rig::photon(hit + DVec3::Y, hit, 1.0))
    };
    let photons: Vec<Photon> = (0..3000).filter_map(photon).collect();
    let rules = Rules { coverage: SplatCoverage::Surface, bias_m: 0.03, ..rules };
    let drawn = |fixture: &Fixture| {
        let view = View { size_px: fixture.view.size_px / 2, ..fixture.view.clone() };
        draw(rig, &view, &photons, &rig.gbuffer(fixture)?.depth, &rules)
    };
    let (own, wider) = (drawn(&own)?, drawn(&wider)?);
    let middle = |aside: i64| {
        let [left, top] = [i64::from(BUFFER[0]) + aside, i64::from(BUFFER[1])];
        Image::from_fn(BUFFER, |x, y| wider.clamped(left + i64::from(x), top + i64::from(y)))
    };
    Ok(Check::new(rig, format!("border, {}: Σ |difference| / Σ", name(rules.splatting)))
        .within((1e-3, "1"), difference(&own, &middle(0)))
        .control("a pixel aside", difference(&own, &middle(1))))
}

/// Splats of more pixels than an adapter may make turns of an invocation's loops.
fn large(rig: &Rig<'_>, rules: Rules) -> Result<Check> {
    let view = rig::synthetic_view(SIZE, GAMMA_PER_M)?;
    let photon = |at| photon_at(&view, at, 0.105, 1.0);
    let photons = [[250.3, 260.8], [240.1, 300.6]].map(photon);
    extremes(rig, &view, photons.into_iter(), rules, "splats of 380 px")
}

/// Splats of extreme sizes against the twin's.
fn extremes(
    rig: &Rig<'_>,
    view: &View,
    photons: impl Iterator<Item = (Photon, HitPath)>,
    rules: Rules,
    what: &str,
) -> Result<Check> {
    let (photons, twins): (Vec<_>, Vec<_>) = photons.unzip();
    let rules = Rules { sizes_px: EXTREMES_PX, ..rules };
    let image = draw_free(rig, view, &photons, &rules)?;
    let error = |rules: &Rules| -> Result<f64> {
        Ok(difference(&image, &rules.twin(&view.camera, &twins, &open())?))
    };
    let wide = Rules { sizes_px: [EXTREMES_PX[0], 1.25 * EXTREMES_PX[1]], ..rules };
    Ok(Check::new(rig, format!("{what}, {}: Σ |difference| / Σ", name(rules.splatting)))
        .within((rules.coverage(rig), "1"), error(&rules)?)
        .control("s_max 500 px", error(&wide)?))
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
    let mut params = Params::from(&file);
    (params.view.width, params.view.height) = (400, 400);
    (params.caustics.grid, params.caustics.buffer) = (128, SIZE);
    params.caustics.intensity = Rule::Conserving;
    let pipeline = BuiltPipeline::<Underwater>::new(rig.gpu, &Scene::build(&file)?, &params)?;
    rig.run_until(&pipeline, STAGE)?;
    let seen_w = rig.channel(&pipeline.caustics.drawn.texture, 0)?.sum();

    let half_m = (CAMERA_M + file.floor_depth_m) * (file.camera.fov_y_deg.to_radians() / 2.0).tan();
    // Ω = 4 asin(h² / (h² + d²)) of a square of half side h at a distance d from its middle.
    let flux_w = |height_m: f64| {
        let d = height_m + file.floor_depth_m;
        4.0 * (half_m.powi(2) / (half_m.powi(2) + d * d)).asin() * file.light.intensity_w_sr
    };
    Ok(Check::new(rig, "flux of a point light through the view, relative error")
        .within((0.01, "1"), relative_error(seen_w, flux_w(LIGHT_M)))
        .control("light 0.5 m higher", relative_error(seen_w, flux_w(LIGHT_M + 0.5))))
}
