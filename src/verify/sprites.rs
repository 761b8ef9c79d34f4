//! `sprites/draw` and `sprites/compose` against Eq. 1, the photons' flux, and Lambert's and Beer's laws.

use glam::DVec3;

use super::{Case, Check, Checks, Result, Rig, largest, rig};
use fathom_reference::image::{Image, pixels};
use fathom_reference::quantities::quantile;
use fathom_reference::rays::{PixelRays, Tracer};
use fathom_scene::{LightKind, Mesh, Object, Scene};
use fathom_stages::Stage;
use fathom_stages::geometry::Part;
use fathom_stages::ldi::peel;
use fathom_stages::photon::Photons;
use fathom_stages::screen_picture::Shafts;
use fathom_stages::screen_ray::Layers;
use fathom_stages::sprites::compose::{self, Composed};
use fathom_stages::sprites::draw::{self, Sprite};

const SIZE: [u32; 2] = [320, 240];

pub fn cases() -> Vec<Case> {
    vec![
        Case::new(draw::INFO.name, "energy on a slanted plane", energy),
        Case::new(draw::INFO.name, "Eq. 1 pixel by pixel", sprite_shape),
        Case::new(draw::INFO.name, "behind a wall", hidden),
        Case::new(compose::INFO.name, "light of sprites", composed),
    ]
}

/// A slanted view of scene `plane` with photons strewn in the middle of the view.
struct Lit {
    stand: rig::Stand,
    layers: Layers,
    /// What the camera sees.
    seen: wgpu::Texture,
    hits: Vec<DVec3>,
    photons: Photons,
}

impl Lit {
    fn sprites(&self, rig: &Rig<'_>) -> Result<Stage<wgpu::Texture>> {
        let Self { stand, layers, seen, photons, .. } = self;
        let alike = rig.ones(photons.count);
        let photons = (photons, &alike);
        Ok(draw::new(&rig.resources, &stand.shared, photons, layers, seen, &SPRITE)?)
    }
}

/// The photons' way is a metre.
const GAMMA_PER_M: f64 = 0.13;
const SPRITE: Sprite = Sprite { radius_m: 0.4, visible_m: 0.05, photon_w: 0.7, side_px: 40.0 };

fn lit(rig: &Rig<'_>) -> Result<Lit> {
    let mut scene = rig::flat_plane(LightKind::Directional)?;
    scene.water.attenuation_per_m = GAMMA_PER_M;
    scene.camera.up = [0.3, 1.0, 0.1];
    let stand = rig.stand(&scene, SIZE);
    let peel = peel::new(&rig.resources, &stand.shared, (&stand.geometry, Part::Solid), SIZE, 2)?;
    rig.run(&[&peel])?;
    let tracer = Tracer::new(&scene.objects)?;
    let rays = PixelRays::new(&scene.camera, SIZE[0], SIZE[1]);
    let mut random = rig::Random::new(7);
    let hits: Vec<DVec3> = (0..60)
        .filter_map(|_| {
            let shares = [random.within(0.4, 0.6), random.within(0.65, 0.75)];
            let [x, y] = [0, 1].map(|axis| f64::from(SIZE[axis]) * shares[axis]);
            let (origin, direction, _) = rays.ray_at(x, y);
            Some(tracer.cast(origin, direction, 0.0, f64::MAX)?.position)
        })
        .collect();
    let photons: Vec<_> = hits.iter().map(|hit| rig::photon(*hit + DVec3::Y, *hit, 1.0)).collect();
    let photons = rig.photons(&photons);
    let seen = rig.gbuffer(&stand)?.depth;
    Ok(Lit { stand, layers: peel.left, seen, hits, photons })
}

/// What the sprites bring to the plane, summed over its area, against the photons' flux.
fn energy(rig: &Rig<'_>) -> Result<Check> {
    let lit = lit(rig)?;
    let stage = lit.sprites(rig)?;
    rig.run(&[&stage])?;
    let irradiance = rig.channel(stage.texture(), 0)?;
    let rays = PixelRays::new(&lit.stand.view.camera, SIZE[0], SIZE[1]);
    let floor_y = rig::mean(lit.hits.iter().map(|hit| hit.y));
    // The part of the floor that a pixel shows.
    let area = |x: u32, y: u32| {
        let on_floor = |x_px: f64, y_px: f64| {
            let (origin, direction, _) = rays.ray_at(x_px, y_px);
            origin + direction * ((floor_y - origin.y) / direction.y)
        };
        let (x, y) = (f64::from(x), f64::from(y));
        let [a, b, c, d] =
            [(x, y), (x + 1.0, y), (x + 1.0, y + 1.0), (x, y + 1.0)].map(|(x, y)| on_floor(x, y));
        0.5 * (c - a).cross(d - b).length()
    };
    let shown = pixels(SIZE).filter(|(x, y)| irradiance.clamped((*x).into(), (*y).into()) > 0.0);
    let brought: f64 =
        shown.map(|(x, y)| irradiance.clamped(x.into(), y.into()) * area(x, y)).sum();
    let flux = SPRITE.photon_w * (-GAMMA_PER_M).exp() * lit.hits.len() as f64;
    let off = |flux: f64| (brought / flux - 1.0).abs();
    Ok(Check::of(
        draw::INFO.name,
        "sum of irradiance × area over the photons' flux: relative error",
    )
    .within((0.01, "1"), off(flux))
    .control("one photon in twenty more", off(1.05 * flux)))
}

/// Sprites on a floor that a wall hides in part: the wall stays dark.
fn hidden(rig: &Rig<'_>) -> Result<Check> {
    let lit = lit(rig)?;
    let mut scene = rig::flat_plane(LightKind::Directional)?;
    scene.camera = lit.stand.view.camera.clone();
    let middle = lit.hits.iter().sum::<DVec3>() / lit.hits.len() as f64;
    let between = middle.lerp(scene.camera.position(), 0.4);
    let wall = Mesh::parallelogram(between, 0.15 * DVec3::X, 0.6 * DVec3::Y);
    scene.objects.push(Object::new("wall", wall));
    let stand = rig.stand(&scene, SIZE);
    let seen = rig.gbuffer(&stand)?.depth;
    let alike = rig.ones(lit.photons.count);
    let tracer = Tracer::new(&scene.objects)?;
    let rays = PixelRays::new(&scene.camera, SIZE[0], SIZE[1]);
    let on_wall = |(x, y): &(u32, u32)| {
        rays.cast(&tracer, *x, *y).is_some_and(|(hit, _)| hit.object + 1 == scene.objects.len())
    };
    let wall: Vec<(u32, u32)> = pixels(SIZE).filter(on_wall).collect();
    let brightest = |visible_m: f64| -> Result<f64> {
        let sprite = Sprite { visible_m, ..SPRITE };
        let photons = (&lit.photons, &alike);
        let stage = draw::new(&rig.resources, &stand.shared, photons, &lit.layers, &seen, &sprite)?;
        rig.run(&[&stage])?;
        let irradiance = rig.channel(stage.texture(), 0)?;
        Ok(largest(wall.iter().map(|(x, y)| irradiance.clamped((*x).into(), (*y).into()))))
    };
    Ok(Check::of(draw::INFO.name, "greatest irradiance on a wall before the sprites")
        .within((0.0, "W/m²"), brightest(SPRITE.visible_m)?)
        .control("whatever lies before them is lit", brightest(100.0)?)
        .with("pixels_of_the_wall", wall.len() as f64))
}

/// Each pixel against Eq. 1 evaluated in f64.
fn sprite_shape(rig: &Rig<'_>) -> Result<Check> {
    let lit = lit(rig)?;
    let stage = lit.sprites(rig)?;
    rig.run(&[&stage])?;
    let irradiance = rig.channel(stage.texture(), 0)?;
    let rays = PixelRays::new(&lit.stand.view.camera, SIZE[0], SIZE[1]);
    let errors = |radius_m: f64| {
        let error = |(x, y): (u32, u32)| {
            let (origin, direction, _) = rays.ray(x, y);
            let exact: f64 = lit
                .hits
                .iter()
                .map(|hit| {
                    let far_m = (hit.y - origin.y) / direction.y;
                    let r = (origin + direction * far_m).distance(*hit);
                    SPRITE.rise_w_m3() * (-GAMMA_PER_M).exp() * (radius_m - r).max(0.0)
                })
                .sum();
            (irradiance.clamped(x.into(), y.into()) - exact).abs()
        };
        largest(pixels(SIZE).map(error)) / irradiance.data().iter().copied().fold(0.0, f64::max)
    };
    Ok(Check::of(draw::INFO.name, "largest |irradiance − Eq. 1| over the greatest irradiance")
        .within((0.01, "1"), errors(SPRITE.radius_m))
        .control("radius 5 % larger", errors(1.05 * SPRITE.radius_m)))
}

/// Radiance that known irradiance adds to a grey floor, against Lambert's law and Beer's; and that shafts add to what is behind them.
fn composed(rig: &Rig<'_>) -> Checks {
    const EXPOSURE: f64 = 0.4;
    const SHAFT_W: f64 = 1.5;
    const SHAFT_SCALE: f64 = 0.2;
    /// Where the tint of shafts is 1.
    const BLUE: usize = 2;
    let scene = rig::flat_plane(LightKind::Directional)?;
    let stand = rig.stand(&scene, SIZE);
    let gbuffer = rig.gbuffer(&stand)?;
    let constant = |value: f64| rig.grey(&Image::constant(SIZE[0], SIZE[1], value));
    let shaft = constant(SHAFT_W);
    let radiance = |irradiance: f64, shafts| -> Result<Image> {
        let light = constant(irradiance);
        let composed = Composed::Picture { shafts, exposure: EXPOSURE };
        let stage = compose::new(&rig.resources, &stand.shared, &gbuffer, &light, &composed)?;
        rig.run(&[&stage])?;
        let shown = rig.channel(stage.texture(), BLUE)?;
        Ok(shown.map(|value| -(1.0 - value.powf(2.2)).ln() / EXPOSURE))
    };
    let (dark, light) = (radiance(0.0, None)?, radiance(6.0, None)?);
    let crossed = radiance(0.0, Some(Shafts { flux: &shaft, scale: SHAFT_SCALE }))?;
    let albedo = rig.channel(&gbuffer.albedo, BLUE)?;
    let tracer = Tracer::new(&scene.objects)?;
    let rays = PixelRays::new(&scene.camera, SIZE[0], SIZE[1]);
    let errors = |irradiance: f64| {
        let off = pixels(SIZE).filter_map(|(x, y)| {
            let (hit, _) = rays.cast(&tracer, x, y)?;
            let at = |image: &Image| image.clamped(x.into(), y.into());
            let through = (-scene.water.attenuation_per_m * path_m(&scene, hit.position)).exp();
            let exact = at(&albedo) / std::f64::consts::PI * irradiance * through;
            Some((at(&light) - at(&dark) - exact).abs() / exact)
        });
        quantile(&mut off.collect::<Vec<_>>(), 0.9)
    };
    let of_shafts = |scale: f64| {
        let added = crossed.data().iter().zip(dark.data()).map(|(with, without)| with - without);
        let off = added.map(|added| (added / (SHAFT_W * scale) - 1.0).abs());
        quantile(&mut off.collect::<Vec<_>>(), 0.9)
    };
    // Steps of an 8-bit display.
    Ok(vec![
        Check::of(compose::INFO.name, "90th percentile of the added radiance's relative error")
            .within((0.03, "1"), errors(6.0))
            .control("6 % more light expected", errors(6.36)),
        Check::of(
            compose::INFO.name,
            "90th percentile of the relative error of the shafts' radiance",
        )
        .within((0.03, "1"), of_shafts(SHAFT_SCALE))
        .control("a scale 6 % larger", of_shafts(1.06 * SHAFT_SCALE)),
    ])
}

/// Way through the water from a place below it to the camera.
fn path_m(scene: &Scene, place: DVec3) -> f64 {
    let camera = DVec3::from(scene.camera.position_m);
    let whole = camera.distance(place);
    if camera.y <= 0.0 { whole } else { whole * -place.y / (camera.y - place.y) }
}
