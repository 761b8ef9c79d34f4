//! `compose`: known inputs in, and the laws of adding light, of attenuation and of reflection out.

use crate::prelude::*;
use fathom_reference::image::pixel_behind;
use fathom_stages::compose::{self, ComposeInputs, PictureUniforms};
use fathom_stages::picture::Picture;

const STAGE: &str = "compose";
const SIZE: [u32; 2] = [96, 64];
/// Distance of the wall that fills the view, metres.
const WALL_M: f64 = 4.0;
/// How deep its middle is.
const DEPTH_M: f64 = 2.0;
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

pub fn cases() -> Vec<Case> {
    vec![
        Case::new(STAGE, "addition and attenuation of known inputs", known_inputs),
        Case::new(STAGE, "Fresnel reflection of the water from above and below", fresnel),
        Case::new(STAGE, "caustics brought to the picture's size within surfaces", |rig| {
            upscaled(rig, "caustics", |dark, caustics| Buffers { caustics, ..dark })
        }),
        Case::new(STAGE, "godrays brought to the picture's size within surfaces", |rig| {
            // They are radiance; of irradiance a white surface sends a πth to the eye.
            let lit = |dark, rays: Image| Buffers { godrays: rays.map(|value| value / PI), ..dark };
            upscaled(rig, "godrays", lit)
        }),
        Case::new(STAGE, "flux of pixels over the area behind them", conserved),
        Case::new(STAGE, "light of the sky below water", sky),
        Case::new(STAGE, "screen-space ambient occlusion", occlusion),
    ]
}

/// Mean radiance of each band: `[godrays][caustics]`.
type Bands = [[f64; 3]; 2];

fn known_inputs(rig: &Rig<'_>) -> Checks {
    let clear = wall(rig, 0.0, false)?;
    let water = wall(rig, GAMMA_PER_M, false)?;
    let added = wall(rig, GAMMA_PER_M, true)?;
    let [low, middle, high] = water[0];
    let (rays, both) = (water[1][0] - low, water[1][2] - low);
    let through = (high - low) / (clear[0][2] - clear[0][0]);
    let left = |factor: f64| transmittance(GAMMA_PER_M * factor, WALL_M);
    let unfaded = |seen: &Bands| relative_error(seen[0][2] - seen[0][0], clear[0][2] - clear[0][0]);
    let twice = (high - low) / (middle - low);
    Ok(vec![
        Check::new(rig, "twice the caustics, twice the light: relative error")
            .within((5e-3, "1"), relative_error(twice, 2.0))
            .control("2.1 times expected", relative_error(twice, 2.1)),
        Check::new(rig, "caustics and godrays add up: relative error")
            .within((5e-3, "1"), relative_error(both, high - low + rays))
            .control("godrays counted 1.1 times", relative_error(both, high - low + 1.1 * rays)),
        Check::new(rig, "caustics seen through 4 m of water: relative error")
            .within((5e-3, "1"), relative_error(through, left(1.0)))
            .control("attenuation 5 % higher", relative_error(through, left(1.05))),
        Check::new(rig, "caustics added over a grey wall behind 4 m of water: relative error")
            .within((5e-3, "1"), unfaded(&added))
            .control("caustics that light a white wall", unfaded(&water)),
    ])
}

/// What is composed, one value for the whole view unless an image.
#[derive(Clone)]
struct Buffers {
    albedo: f32,
    /// What is seen: one normal for all of it.
    depth: wgpu::Texture,
    normal: Vec3,
    /// Taps, and their radius in metres.
    occlusion: (u32, f64),
    caustics: Image,
    /// A pixel's extent at 1 m, where caustics are flux and not irradiance.
    pixel_tangent: Option<f64>,
    added: bool,
    godrays: Image,
    reflection: f32,
    exposure: f64,
}

impl Buffers {
    /// A white surface that faces the camera, with no light but the sky's.
    fn unlit(depth: wgpu::Texture, exposure: f64) -> Self {
        let nothing = Image::constant(SIZE[0], SIZE[1], 0.0);
        Self {
            albedo: 1.0,
            depth,
            normal: Vec3::Z,
            occlusion: (0, 0.5),
            caustics: nothing.clone(),
            pixel_tangent: None,
            added: false,
            godrays: nothing,
            reflection: 0.0,
            exposure,
        }
    }

    /// Composes the inputs and returns the radiance of each pixel.
    fn radiance(&self, rig: &Rig<'_>, view: &View) -> Result<Image> {
        let grey = |value: f32| rig.constant(SIZE, [value, value, value, 1.0]);
        let gbuffer = GBuffer {
            albedo: grey(self.albedo)?,
            normal: rig.constant(SIZE, self.normal.extend(1.0).to_array())?,
            depth: self.depth.clone(),
        };
        let inputs = ComposeInputs {
            picture: Picture::new(&gbuffer, self.exposure, 0.0),
            caustics: &rig.grey(&self.caustics),
            godrays: &rig.grey(&self.godrays),
            reflection: &grey(self.reflection)?,
            refraction: &grey(0.0)?,
        };
        let settings = PictureUniforms {
            caustics_scale: self.pixel_tangent.unwrap_or(1.0) as f32,
            godrays_scale: 1.0,
            occlusion_taps: self.occlusion.0,
            occlusion_radius_m: self.occlusion.1 as f32,
            water_cells: 64,
            depth_share: DEPTH_SHARE as f32,
        };
        let (shared, conserving) = (Shared::new(rig, view), self.pixel_tangent.is_some());
        let stage = compose::new(rig, &shared, &inputs, &settings, conserving, self.added)?;
        let shown = rig.draw(&[&stage], stage.texture(), BLUE)?;
        Ok(shown.map(|value| radiance_of(value, self.exposure)))
    }

    /// What caustics add to the radiance of each pixel.
    fn added(self, rig: &Rig<'_>, view: &View, caustics: Image) -> Result<Image> {
        let lit = Buffers { caustics, ..self.clone() };
        self.brightened(lit, rig, view)
    }

    /// By how much each pixel is brighter in `lit`.
    fn brightened(self, lit: Buffers, rig: &Rig<'_>, view: &View) -> Result<Image> {
        let without = self.radiance(rig, view)?;
        let with = lit.radiance(rig, view)?;
        Ok(Image::from_fn(SIZE, |x, y| with.get((x, y)) - without.get((x, y))))
    }
}

/// A narrow view under water.
fn narrow_view(gamma_per_m: f64) -> Result<View> {
    let mut view = rig::synthetic_view(SIZE, gamma_per_m)?;
    // So narrow that the path through the water is the same for all pixels.
    view.camera.fov_y_deg = 1.0;
    // Deep enough that the surface is not in view.
    view.camera.position_m[1] = -DEPTH_M;
    view.camera.target_m[1] = -DEPTH_M;
    Ok(view)
}

/// What a white wall sends of the sky's light has come down to it, and on to the viewer.
fn sky(rig: &Rig<'_>) -> Result<Check> {
    let sent = |gamma_per_m: f64| -> Result<f64> {
        let view = narrow_view(gamma_per_m)?;
        let white = Buffers::unlit(rig.depth(SIZE, rig::depth_ahead(&view, WALL_M))?, 2.0);
        let black = Buffers { albedo: 0.0, ..white.clone() };
        Ok(black.brightened(white, rig, &view)?.mean())
    };
    let left = sent(GAMMA_PER_M)? / sent(0.0)?;
    let error = |way_m: f64| relative_error(left, transmittance(GAMMA_PER_M, way_m));
    Ok(Check::new(rig, "share that 2 m down and 4 m across leave: relative error")
        .within((0.02, "1"), error(DEPTH_M + WALL_M))
        .control("no water above the wall", error(WALL_M)))
}

/// A wall across the view, with the bands upon it: white where they light it, grey where they are added.
fn wall(rig: &Rig<'_>, gamma_per_m: f64, added: bool) -> Result<Bands> {
    let view = narrow_view(gamma_per_m)?;
    let (columns, rows) = (SIZE[0] / 3, SIZE[1] / 2);
    let caustics = |x: u32, _| {
        let within = f64::from(x % columns) + 0.5;
        CAUSTICS[(x / columns) as usize] + RAMP * (within / f64::from(columns) - 0.5)
    };
    let known = Buffers {
        caustics: Image::from_fn(SIZE, caustics),
        godrays: Image::from_fn(SIZE, |_, y| GODRAYS[(y / rows) as usize]),
        albedo: if added { 0.3 } else { 1.0 },
        added,
        ..Buffers::unlit(rig.depth(SIZE, rig::depth_ahead(&view, WALL_M))?, 0.4)
    };
    let image = known.radiance(rig, &view)?;
    let band = |column: u32, row: u32| {
        let inside = |band: u32, side: u32| band * side + BORDER_PX..(band + 1) * side - BORDER_PX;
        let pixels = inside(row, rows).flat_map(|y| inside(column, columns).map(move |x| (x, y)));
        mean(pixels.map(|at| image.get(at)))
    };
    Ok([0, 1].map(|row| [0, 1, 2].map(|column| band(column, row))))
}

/// A scene in clear and dry water, of whose surface nothing is drawn.
fn dry(rig: &Rig<'_>, mut scene: Scene) -> Result<(Fixture, wgpu::Texture)> {
    scene.water.attenuation_per_m = 0.0;
    scene.water.half_size_m = [1e-3; 2];
    let fixture = rig.fixture(scene, SIZE)?;
    let depth = rig.gbuffer(&fixture)?.depth;
    Ok((fixture, depth))
}

/// Caustics or godrays in a smaller buffer, each texel of its own brightness: a texel counts for the pixels whose surface it is on.
fn upscaled(rig: &Rig<'_>, buffer: &str, lit: impl Fn(Buffers, Image) -> Buffers) -> Result<Check> {
    const BUFFER: [u32; 2] = [61, 41];
    const MIN_WEIGHT: f64 = 1e-3;
    let (fixture, drawn) = dry(rig, Scene::load("tank")?)?;
    let depth = rig.channel(&drawn, 0)?;
    let view_m = |z: f64| fixture.view.camera.view_depth_m(z);
    let texels = noise(BUFFER, 5).map(|value| 1.0 + 3.0 * value);
    let dark = Buffers::unlit(drawn, 0.8);
    let lit = lit(dark.clone(), texels.clone());
    let light = dark.brightened(lit, rig, &fixture.view)?;
    let twin = |x: u32, y: u32, share: f64| {
        let place = [0, 1].map(|k| {
            (f64::from([x, y][k]) + 0.5) * f64::from(BUFFER[k]) / f64::from(SIZE[k]) - 0.5
        });
        let own_m = view_m(depth.get((x, y)));
        let (mut sum, mut weights, mut all) = (0.0, 0.0, 0.0);
        for corner in 0..4 {
            let base = [0, 1].map(|k| place[k].floor() + f64::from(corner >> k & 1));
            let weight = (1.0 - (place[0] - base[0]).abs()) * (1.0 - (place[1] - base[1]).abs());
            let texel = [0, 1].map(|k| base[k].clamp(0.0, f64::from(BUFFER[k]) - 1.0) as i64);
            let [column, row] = pixel_behind(texel.map(|k| k as f64), BUFFER, SIZE);
            let off = (view_m(depth.clamped(column, row)) - own_m).abs() / own_m;
            let value = texels.clamped(texel[0], texel[1]);
            all += weight * value;
            if off <= share {
                sum += weight * value;
                weights += weight;
            }
        }
        if weights < MIN_WEIGHT { all } else { sum / weights }
    };
    let errors = |share: f64| {
        let seen_pixels = pixels(SIZE).filter(|at| depth.get(*at) < 1.0);
        let error = |(x, y)| (light.get((x, y)) - twin(x, y, share) / PI).abs();
        percentile::<95>(seen_pixels.map(error)) / light.mean()
    };
    // Steps of an 8-bit display; a few pixels may decide otherwise in f32.
    let what = format!(
        "{buffer} within surfaces: 95th percentile of |difference from the twin|, of the mean"
    );
    Ok(Check::new(rig, what)
        .within((0.03, "1"), errors(DEPTH_SHARE))
        .control("texels of all surfaces", errors(f64::INFINITY)))
}

/// The same flux in every pixel of a level floor under a wide view: irradiance is flux over the area that the pixel shows.
fn conserved(rig: &Rig<'_>) -> Result<Check> {
    const FLUX_W: f64 = 0.01;
    /// Less is lost in the steps of an 8-bit display.
    const MIN_W_M2: f64 = 0.2;
    let mut scene = rig::flat_plane(LightKind::Directional)?;
    scene.camera = Camera::new([0.0, -0.5, 1.0], [0.3, -3.0, -0.5], 90.0, [0.1, 20.0]);
    let (fixture, depth) = dry(rig, scene)?;
    let dark = Buffers {
        normal: Vec3::Y,
        pixel_tangent: Some(fixture.view.pixel_tangent(SIZE)),
        ..Buffers::unlit(depth, 0.8)
    };
    let flux = Image::constant(SIZE[0], SIZE[1], FLUX_W);
    let light = dark.added(rig, &fixture.view, flux)?;
    let (camera, floor_m) = (&fixture.scene.camera, -fixture.scene.floor_depth_m);
    let errors = |power: i32| {
        percentile::<90>(pixels(SIZE).filter_map(|at| {
            let hit = fixture.hit(at)?;
            let area = rig::area_shown(&fixture.rays, at, (DVec3::Y * floor_m, DVec3::Y));
            let sight = (hit.position - camera.position()).normalize();
            let exact = FLUX_W / area * sight.dot(camera.direction()).powi(power);
            (exact > MIN_W_M2).then(|| relative_error(light.get(at) * PI, exact))
        }))
    };
    Ok(Check::new(rig, "flux over area: 90th percentile of the irradiance's relative error")
        .within((0.03, "1"), errors(0))
        .control("pixels as large at the rim as in the middle", errors(3)))
}

/// Ambient light with occlusion over that without.
fn occlusion(rig: &Rig<'_>) -> Checks {
    /// Mean of this scene, from when each pixel agreed with an f64 copy of the algorithm within the steps of an 8-bit display: 0.96537 on lavapipe
    /// (Mesa 22.3), 0.96525 on SwiftShader.
    const MEAN: f64 = 0.9653;
    let openness = |scene: Scene, radius_m: f64| -> Result<Vec<f64>> {
        let (fixture, drawn) = dry(rig, scene)?;
        let known = Buffers { normal: Vec3::Y, ..Buffers::unlit(drawn, 2.0) };
        let open = known.radiance(rig, &fixture.view)?;
        let occluded =
            Buffers { occlusion: (16, radius_m), ..known }.radiance(rig, &fixture.view)?;
        // The lower half of the picture is all under water, where no direct light saturates the display.
        let seen_pixels = pixels(SIZE).filter(|(_, y)| *y >= SIZE[1] / 2);
        Ok(seen_pixels.map(|at| occluded.get(at) / open.get(at)).collect())
    };
    let tank = |radius_m: f64| openness(Scene::load("tank")?, radius_m);
    let (found, wider) = (tank(0.5)?, tank(0.6)?);
    let off = |found: &[f64]| (mean(found.iter().copied()) - MEAN).abs();
    let closed = |found: &[f64]| largest(found.iter().map(|open| 1.0 - open));
    Ok(vec![
        Check::new(
            rig,
            "screen-space ambient occlusion: mean openness against that of an f64 copy",
        )
        .within((2e-4, "1"), off(&found))
        .control("a radius 20 % greater", off(&wider)),
        Check::new(rig, "screen-space ambient occlusion of a plane: largest")
            .within((0.01, "1"), closed(&openness(Scene::load("plane")?, 0.5)?))
            .control("of scene tank", closed(&found)),
    ])
}

/// Flat water between a white reflection and a black refraction shows its reflectance.
fn fresnel(rig: &Rig<'_>) -> Checks {
    let unlit = Buffers::unlit(rig.depth(SIZE, 1.0)?, 1.5);
    let known = Buffers { albedo: 0.0, reflection: 1.0, ..unlit };
    let check = |(height_m, name, target_z): (f64, &str, f64)| {
        let side = f64::signum(height_m);
        let mut view = rig::synthetic_view(SIZE, 0.0)?;
        view.camera.position_m = [0.0, height_m, 2.0];
        view.camera.target_m = [0.0, height_m - 1.5 * side, target_z];
        view.camera.fov_y_deg = 30.0;
        let (image, rays) = (known.radiance(rig, &view)?, rig::rays(&view));
        let error = |index: f64| {
            let (outer, inner) = if side > 0.0 { (1.0, index) } else { (index, 1.0) };
            let exact = |x, y| fresnel_reflectance(-side * rays.ray(x, y).1.y, outer, inner);
            difference(&image, &Image::from_fn(SIZE, exact))
        };
        let what = format!("flat water from {name}: mean |reflectance − Fresnel|, of the mean");
        Ok(Check::new(rig, what)
            .within((0.02, "1"), error(view.water.refractive_index))
            .control("refractive index 1.40", error(1.40)))
    };
    // From below the view crosses the critical angle, 48.8° from the vertical. The nearest water is within the near plane's distance.
    let cases = [(1.5, "above", -1.5), (-1.5, "below", 0.8), (-0.02, "2 cm below", 0.8)];
    cases.into_iter().map(check).collect()
}
