//! `compose`: known inputs in, and the laws of adding light, of attenuation and of reflection out.

use glam::{DVec3, Vec2};

use super::{Case, Check, Checks, Result, Rig, rig};
use fathom_reference::image::{Image, pixels};
use fathom_reference::openness::Openness;
use fathom_reference::optics::{fresnel_reflectance, transmittance};
use fathom_reference::plane::CameraDepth;
use fathom_reference::quantities::quantile;
use fathom_reference::rays::{PixelRays, Tracer};
use fathom_scene::{Camera, LightKind, Scene};
use fathom_stages::compose::{self, ComposeUniforms, Composed};
use fathom_stages::frame::{Shared, View};
use fathom_stages::gbuffer::GbufferTextures;

const STAGE: &str = "compose";
const SIZE: [u32; 2] = [96, 64];
/// Radiance L is shown as `(1 − exp(−exposure · L))^(1 / 2.2)` in 8 bits.
const DISPLAY_GAMMA: f64 = 2.2;
/// Distance of the wall that fills the view, metres.
const WALL_M: f64 = 4.0;
const GAMMA_PER_M: f64 = 0.13;
/// Channel that is judged: the water's tint leaves blue as it is.
const BLUE: usize = 2;
/// Middles of the bands of caustics (from left to right) and of godrays (from top to bottom), arbitrary units.
const CAUSTICS: [f64; 3] = [1.0, 4.0, 7.0];
const GODRAYS: [f64; 2] = [0.05, 0.4];
/// Caustics rise by this much across a band: the 8-bit steps of the display then average out.
const RAMP: f64 = 1.0;
/// Pixels next to another band are mixed with it.
const BORDER_PX: u32 = 4;

/// Default of `caustics.filter_depth_share`.
const DEPTH_SHARE: f64 = 0.05;
const FACING: [f32; 3] = [0.0, 0.0, 1.0];
const NO_OCCLUSION: Openness = Openness { taps: 0, radius_m: 0.5 };

pub fn cases() -> Vec<Case> {
    vec![
        Case::new(STAGE, "addition and attenuation of known inputs", known_inputs),
        Case::new(STAGE, "Fresnel reflection of the water from above and below", fresnel),
        Case::new(STAGE, "caustics brought to the picture's size within surfaces", upscaled),
        Case::new(STAGE, "flux of pixels over the area behind them", conserved),
        Case::new(STAGE, "screen-space ambient occlusion", occlusion),
    ]
}

/// Mean radiance of each band: `[godrays][caustics]`.
type Bands = [[f64; 3]; 2];

fn known_inputs(rig: &Rig<'_>) -> Checks {
    let clear = wall(rig, 0.0)?;
    let water = wall(rig, GAMMA_PER_M)?;
    let [low, middle, high] = water[0];
    let (rays, both) = (water[1][0] - low, water[1][2] - low);
    let through = (high - low) / (clear[0][2] - clear[0][0]);
    let off = |measured: f64, expected: f64| (measured / expected - 1.0).abs();
    let murky = transmittance(GAMMA_PER_M * 1.05, WALL_M);
    let twice = (high - low) / (middle - low);
    Ok(vec![
        Check::of(STAGE, "twice the caustics, twice the light: relative error")
            .within((5e-3, "1"), off(twice, 2.0))
            .control("2.1 times expected", off(twice, 2.1)),
        Check::of(STAGE, "caustics and godrays add up: relative error")
            .within((5e-3, "1"), off(both, high - low + rays))
            .control("godrays counted 1.1 times", off(both, high - low + 1.1 * rays)),
        Check::of(STAGE, "caustics seen through 4 m of water: relative error")
            .within((5e-3, "1"), off(through, transmittance(GAMMA_PER_M, WALL_M)))
            .control("attenuation 5 % higher", off(through, murky)),
    ])
}

/// What is composed, one value for the whole view unless an image.
#[derive(Clone, Copy)]
struct Known<'a> {
    albedo: f32,
    /// What is seen: one normal for all of it.
    depth: &'a wgpu::Texture,
    normal: [f32; 3],
    occlusion: Openness,
    caustics: &'a Image,
    /// A pixel's extent at 1 m, where caustics are flux and not irradiance.
    pixel_tangent: Option<f64>,
    godrays: &'a Image,
    reflection: f32,
    exposure: f64,
}

/// Composes known inputs and returns the radiance of each pixel.
fn radiance(rig: &Rig<'_>, view: &View, known: &Known<'_>) -> Result<Image> {
    let shared = Shared::new(&rig.resources, view);
    let grey = |value: f32, alpha: f32| rig.constant(SIZE, [value, value, value, alpha]);
    let [x, y, z] = known.normal;
    let gbuffer = GbufferTextures {
        albedo: grey(known.albedo, 1.0)?,
        normal: rig.constant(SIZE, [x, y, z, 1.0])?,
        depth: known.depth.clone(),
    };
    let inputs = Composed {
        gbuffer: &gbuffer,
        caustics: &rig.grey(known.caustics),
        godrays: &rig.grey(known.godrays),
        reflection: &grey(known.reflection, 1.0)?,
        refraction: &grey(0.0, 1.0)?,
    };
    let settings = ComposeUniforms {
        size_px: Vec2::new(SIZE[0] as f32, SIZE[1] as f32),
        caustics_scale: known.pixel_tangent.unwrap_or(1.0) as f32,
        godrays_scale: 1.0,
        exposure: known.exposure as f32,
        occlusion_taps: known.occlusion.taps,
        occlusion_radius_m: known.occlusion.radius_m as f32,
        water_cells: 8,
        depth_share: DEPTH_SHARE as f32,
    };
    let flux = known.pixel_tangent.is_some();
    let stage = compose::new(&rig.resources, &shared, &inputs, &settings, flux)?;
    rig.run(&[&stage])?;
    let shown = rig.channel(stage.texture(), BLUE)?;
    Ok(shown.map(|value| -(1.0 - value.powf(DISPLAY_GAMMA)).ln() / known.exposure))
}

/// A white wall across a narrow view under water, with the bands upon it.
fn wall(rig: &Rig<'_>, gamma_per_m: f64) -> Result<Bands> {
    let mut view = rig::synthetic_view(SIZE, gamma_per_m)?;
    // So narrow that the path through the water is the same for all pixels.
    view.camera.fov_y_deg = 1.0;
    // Deep enough that the surface is not in view.
    view.camera.position_m[1] = -2.0;
    view.camera.target_m[1] = -2.0;
    let rays = PixelRays::new(&view.camera, SIZE[0], SIZE[1]);
    let eye = DVec3::from(view.camera.position_m);
    let wall = rays.project(eye + view.camera.direction() * WALL_M);
    let (columns, rows) = (SIZE[0] / 3, SIZE[1] / 2);
    let caustics = |x: u32, _| {
        let within = f64::from(x % columns) + 0.5;
        CAUSTICS[(x / columns) as usize] + RAMP * (within / f64::from(columns) - 0.5)
    };
    let known = Known {
        albedo: 1.0,
        depth: &rig.depth(SIZE, wall.map_or(1.0, |wall| wall.depth))?,
        normal: FACING,
        occlusion: NO_OCCLUSION,
        caustics: &Image::of(SIZE, caustics),
        pixel_tangent: None,
        godrays: &Image::of(SIZE, |_, y| GODRAYS[(y / rows) as usize]),
        reflection: 0.0,
        exposure: 0.4,
    };
    let image = radiance(rig, &view, &known)?;
    let mean = |column: u32, row: u32| {
        let inside = |band: u32, side: u32| band * side + BORDER_PX..(band + 1) * side - BORDER_PX;
        let pixels = inside(row, rows).flat_map(|y| inside(column, columns).map(move |x| (x, y)));
        rig::mean(pixels.map(|(x, y)| image.clamped(x.into(), y.into())))
    };
    Ok([0, 1].map(|row| [0, 1, 2].map(|column| mean(column, row))))
}

/// The scene with many edges, in clear and dry water, and what is seen of it.
fn edged(rig: &Rig<'_>) -> Result<(View, wgpu::Texture)> {
    let mut scene = Scene::load("tank")?;
    scene.water.attenuation_per_m = 0.0;
    // Nothing of the surface is drawn.
    scene.water.half_size_m = [1e-3; 2];
    let stand = rig.stand(&scene, SIZE);
    let drawn = rig.gbuffer(&stand)?;
    Ok((stand.view, drawn.depth))
}

/// What a change of the inputs adds to the radiance of each pixel.
fn added(rig: &Rig<'_>, view: &View, with: &Known<'_>, without: &Known<'_>) -> Result<Image> {
    let (with, without) = (radiance(rig, view, with)?, radiance(rig, view, without)?);
    let at = |x: u32, y: u32| {
        let [with, without] = [&with, &without].map(|image| image.clamped(x.into(), y.into()));
        with - without
    };
    Ok(Image::of(SIZE, at))
}

/// Caustics in a smaller buffer, each half of them of its own brightness: a texel counts for the pixels whose surface it is on.
fn upscaled(rig: &Rig<'_>) -> Result<Check> {
    const BUFFER: [u32; 2] = [61, 41];
    const LEAST_WEIGHT: f64 = 1e-3;
    let (view, drawn) = edged(rig)?;
    let depth = rig.channel(&drawn, 0)?;
    let seen = CameraDepth { depth: &depth, camera: &view.camera };
    let caustics = rig::noise(BUFFER, 5).map(|value| 1.0 + 3.0 * value);
    let nothing = &Image::constant(SIZE[0], SIZE[1], 0.0);
    let lit = Known {
        albedo: 1.0,
        depth: &drawn,
        normal: FACING,
        occlusion: NO_OCCLUSION,
        caustics: &caustics,
        pixel_tangent: None,
        godrays: nothing,
        reflection: 0.0,
        exposure: 0.8,
    };
    let light = added(rig, &view, &lit, &Known { caustics: nothing, ..lit })?;
    let twin = |x: u32, y: u32, share: f64| {
        let place = [0, 1].map(|k| {
            (f64::from([x, y][k]) + 0.5) * f64::from(BUFFER[k]) / f64::from(SIZE[k]) - 0.5
        });
        let view_m = seen.view_m(depth.clamped(x.into(), y.into()));
        let (mut sum, mut weights, mut all) = (0.0, 0.0, 0.0);
        for corner in 0..4 {
            let base = [0, 1].map(|k| place[k].floor() + f64::from(corner >> k & 1));
            let weight = (1.0 - (place[0] - base[0]).abs()) * (1.0 - (place[1] - base[1]).abs());
            let texel = [0, 1].map(|k| base[k].clamp(0.0, f64::from(BUFFER[k]) - 1.0) as i64);
            let [column, row] = seen.texel(texel, BUFFER);
            let off = (seen.view_m(depth.clamped(column, row)) - view_m).abs() / view_m;
            let value = caustics.clamped(texel[0], texel[1]);
            all += weight * value;
            if off <= share {
                sum += weight * value;
                weights += weight;
            }
        }
        if weights < LEAST_WEIGHT { all } else { sum / weights }
    };
    let seen_pixels = pixels(SIZE).filter(|(x, y)| depth.clamped((*x).into(), (*y).into()) < 1.0);
    let errors = |share: f64| {
        let error = |(x, y): (u32, u32)| {
            let expected = twin(x, y, share) / std::f64::consts::PI;
            (light.clamped(x.into(), y.into()) - expected).abs()
        };
        quantile(&mut seen_pixels.clone().map(error).collect::<Vec<_>>(), 0.95) / light.mean()
    };
    // Steps of an 8-bit display; a few pixels may decide otherwise in f32.
    Ok(Check::of(
        STAGE,
        "caustics within surfaces: 95th percentile of |difference from the twin|, of the mean",
    )
    .within((0.03, "1"), errors(DEPTH_SHARE))
    .control("texels of all surfaces", errors(f64::INFINITY)))
}

/// The same flux in every pixel of a level floor under a wide view: irradiance is flux over the area that the pixel shows.
fn conserved(rig: &Rig<'_>) -> Result<Check> {
    const FLUX_W: f64 = 0.01;
    /// Less is lost in the steps of an 8-bit display.
    const LEAST_W_M2: f64 = 0.2;
    let mut scene = rig::flat_plane(LightKind::Directional)?;
    scene.water.attenuation_per_m = 0.0;
    // Nothing of the surface is drawn.
    scene.water.half_size_m = [1e-3; 2];
    scene.camera = Camera::new([0.0, -0.5, 1.0], [0.3, -3.0, -0.5], 90.0, [0.1, 20.0]);
    let stand = rig.stand(&scene, SIZE);
    let drawn = rig.gbuffer(&stand)?;
    let nothing = &Image::constant(SIZE[0], SIZE[1], 0.0);
    let lit = Known {
        albedo: 1.0,
        depth: &drawn.depth,
        normal: [0.0, 1.0, 0.0],
        occlusion: NO_OCCLUSION,
        caustics: &Image::constant(SIZE[0], SIZE[1], FLUX_W),
        pixel_tangent: Some(stand.view.pixel_tangent(SIZE[1])),
        godrays: nothing,
        reflection: 0.0,
        exposure: 0.8,
    };
    let light = added(rig, &stand.view, &lit, &Known { caustics: nothing, ..lit })?;
    let tracer = Tracer::new(&scene.objects)?;
    let rays = PixelRays::new(&scene.camera, SIZE[0], SIZE[1]);
    let floor_y = -scene.floor_depth_m;
    let on_floor = |x: u32, y: u32| {
        let (origin, direction, _) = rays.ray_at(x.into(), y.into());
        origin + direction * ((floor_y - origin.y) / direction.y)
    };
    let errors = |power: i32| {
        let error = |(x, y): (u32, u32)| {
            let (hit, _) = rays.cast(&tracer, x, y)?;
            let diagonal = on_floor(x + 1, y + 1) - on_floor(x, y);
            let area = 0.5 * diagonal.cross(on_floor(x, y + 1) - on_floor(x + 1, y)).length();
            let sight = (hit.position - scene.camera.position()).normalize();
            let exact = FLUX_W / area * sight.dot(scene.camera.direction()).powi(power);
            let found = light.clamped(x.into(), y.into()) * std::f64::consts::PI;
            (exact > LEAST_W_M2).then(|| (found / exact - 1.0).abs())
        };
        quantile(&mut pixels(SIZE).filter_map(error).collect::<Vec<_>>(), 0.9)
    };
    Ok(Check::of(STAGE, "flux over area: 90th percentile of the irradiance's relative error")
        .within((0.03, "1"), errors(0))
        .control("pixels as large at the rim as in the middle", errors(3)))
}

/// Ambient light with occlusion over that without, against the twin over the same depth.
fn occlusion(rig: &Rig<'_>) -> Result<Check> {
    const METHOD: Openness = Openness { taps: 16, radius_m: 0.5 };
    let (view, drawn) = edged(rig)?;
    let depth = rig.channel(&drawn, 0)?;
    let nothing = &Image::constant(SIZE[0], SIZE[1], 0.0);
    let open = Known {
        albedo: 1.0,
        depth: &drawn,
        normal: [0.0, 1.0, 0.0],
        occlusion: NO_OCCLUSION,
        caustics: nothing,
        pixel_tangent: None,
        godrays: nothing,
        reflection: 0.0,
        exposure: 2.0,
    };
    let (open, occluded) =
        (radiance(rig, &view, &open)?, radiance(rig, &view, &Known { occlusion: METHOD, ..open })?);
    // The lower half of the picture is all under water, where no direct light saturates the display.
    let seen_pixels = pixels(SIZE).filter(|(_, y)| *y >= SIZE[1] / 2);
    let error = |method: Openness| {
        let off = seen_pixels.clone().map(|(x, y)| {
            let at = |image: &Image| image.clamped(x.into(), y.into());
            let exact = method.at(&view.camera, &depth, DVec3::Y, x, y);
            (at(&occluded) / at(&open) - exact).abs()
        });
        rig::mean(off)
    };
    Ok(Check::of(STAGE, "screen-space ambient occlusion: mean |openness − twin|")
        .within((0.006, "1"), error(METHOD))
        .control("radius of 1 m instead of 0.5 m", error(Openness { radius_m: 1.0, ..METHOD })))
}

/// Flat water between a white reflection and a black refraction shows its reflectance.
fn fresnel(rig: &Rig<'_>) -> Checks {
    let nothing = &Image::constant(SIZE[0], SIZE[1], 0.0);
    let known = Known {
        albedo: 0.0,
        depth: &rig.depth(SIZE, 1.0)?,
        normal: FACING,
        occlusion: NO_OCCLUSION,
        caustics: nothing,
        pixel_tangent: None,
        godrays: nothing,
        reflection: 1.0,
        exposure: 1.5,
    };
    let check = |(side, name, target_z)| {
        let mut view = rig::synthetic_view(SIZE, 0.0)?;
        view.camera.position_m = [0.0, 1.5 * side, 2.0];
        view.camera.target_m = [0.0, 0.0, target_z];
        view.camera.fov_y_deg = 30.0;
        let image = radiance(rig, &view, &known)?;
        let rays = PixelRays::new(&view.camera, SIZE[0], SIZE[1]);
        let error = |index: f64| reflectance_error(&image, &rays, side, index);
        let what = format!("flat water from {name}: mean |reflectance − Fresnel|, of the mean");
        Ok(Check::of(STAGE, what)
            .within((0.02, "1"), error(view.water.refractive_index))
            .control("refractive index 1.40", error(1.40)))
    };
    // From below the view crosses the critical angle, 48.8° from the vertical.
    [(1.0, "above", -1.5), (-1.0, "below", 0.8)].into_iter().map(check).collect()
}

/// Mean absolute difference from the exact reflectance over the pixels that see the water, relative
/// to its mean. `side` is 1 for a camera in the air and −1 for one in the water.
fn reflectance_error(image: &Image, rays: &PixelRays, side: f64, index: f64) -> f64 {
    let (outer, inner) = if side > 0.0 { (1.0, index) } else { (index, 1.0) };
    let (mut difference, mut sum) = (0.0, 0.0);
    for (x, y) in pixels(SIZE) {
        let (_, direction, _) = rays.ray(x, y);
        let exact = fresnel_reflectance(-side * direction.y, outer, inner);
        difference += (image.clamped(x.into(), y.into()) - exact).abs();
        sum += exact;
    }
    difference / sum
}
