//! `sprites/draw` and `sprites/compose` against Eq. 1, the photons' flux, and the f64 picture of known light.

use crate::prelude::*;
use fathom_reference::picture::{SHAFT_TINT, WATER_TINT};
use fathom_stages::picture::Shafts;
use fathom_stages::sprites::compose::{self, SpriteOutput};
use fathom_stages::sprites::draw::{self, Sprite};

const SIZE: [u32; 2] = [160, 120];

pub fn cases() -> Vec<Case> {
    vec![
        Case::new(draw::INFO.name, "energy on a slanted plane", energy),
        Case::new(draw::INFO.name, "Eq. 1 pixel by pixel", |rig| {
            shape(rig, &SpriteScene::new(rig)?)
        }),
        Case::new(draw::INFO.name, "in the screen's plane, pixel by pixel", facing_shape),
        // There a sprite covers more of the picture than in the middle.
        Case::new(draw::INFO.name, "Eq. 1 at the edges of a wide view", |rig| {
            shape(rig, &SpriteScene::strewn(rig, [[0.02, 0.98], [0.9, 0.98]], 100.0)?)
        }),
        Case::new(draw::INFO.name, "behind a wall", hidden),
        Case::new(compose::INFO.name, "light of sprites, sky and shafts pixel by pixel", composed),
    ]
}

/// The photons' way is a metre.
const GAMMA_PER_M: f64 = 0.13;
const SPRITE: Sprite =
    Sprite { radius_m: 0.4, visible_m: 0.05, facing: false, photon_w: 0.7, side_px: 20.0 };

/// A slanted view of scene `plane` with photons strewn in the middle of the view.
struct SpriteScene {
    fixture: Fixture,
    layers: Layers,
    /// Each with the weight of its ray.
    hits: Vec<(DVec3, f32)>,
    photons: Photons,
}

impl SpriteScene {
    fn new(rig: &Rig<'_>) -> Result<Self> {
        Self::strewn(rig, [[0.4, 0.6], [0.65, 0.75]], 60.0)
    }

    /// Photons between these shares of the picture's width and height.
    fn strewn(rig: &Rig<'_>, within: [[f64; 2]; 2], fov_y_deg: f64) -> Result<Self> {
        let mut scene = rig::flat_plane(LightKind::Directional)?;
        scene.camera.fov_y_deg = fov_y_deg;
        scene.water.attenuation_per_m = GAMMA_PER_M;
        scene.camera.up = [0.3, 1.0, 0.1];
        // Sprites lie in the triangles' planes, not across these.
        scene.objects[0].mesh.normals.fill([0.6, 0.8, 0.0]);
        let fixture = rig.fixture(scene, SIZE)?;
        let Fixture { shared, scene, geometry, .. } = &fixture;
        let peel = peel::new(rig, shared, scene, geometry, Objects::Solid, SIZE, 2)?;
        rig.run(&[&peel])?;
        let mut random = Random::new(7);
        let hit = |_| {
            let shares = within.map(|[low, high]| random.within(low, high));
            let [x, y] = [0, 1].map(|axis| f64::from(SIZE[axis]) * shares[axis]);
            let (origin, direction, _) = fixture.rays.ray_at(x, y);
            Some(fixture.tracer.cast(origin, direction, 0.0, f64::MAX)?.position)
        };
        let hits: Vec<DVec3> = (0..60).filter_map(hit).collect();
        let photon = |hit: &DVec3| rig::photon(*hit + DVec3::Y, *hit, 1.0);
        let mut photons = rig.photons(&hits.iter().map(photon).collect::<Vec<_>>());
        photons.per_ray = 3;
        let weight = |number: usize| 0.25 + 0.125 * (number / 3) as f32;
        let hits = hits.into_iter().enumerate().map(|(number, hit)| (hit, weight(number)));
        Ok(SpriteScene { fixture, layers: peel.output, hits: hits.collect(), photons })
    }

    /// Irradiance that the sprites bring to what a stand's camera sees.
    fn irradiance(&self, rig: &Rig<'_>, fixture: &Fixture, sprite: &Sprite) -> Result<Image> {
        let seen = rig.gbuffer(fixture)?.depth;
        let weights: Vec<u32> = self.hits.iter().step_by(3).map(|(_, w)| w.to_bits()).collect();
        let (photons, weights) = (&self.photons, &rig.words(&weights));
        let stage = draw::new(rig, &fixture.shared, photons, weights, &self.layers, &seen, sprite)?;
        rig.draw(&[&stage], stage.texture(), 0)
    }

    /// Largest difference from Eq. 1 in planes of this normal, over the greatest irradiance.
    fn errors(&self, irradiance: &Image, normal: DVec3, radius_m: f64) -> f64 {
        let error = |(x, y): (u32, u32)| {
            let (origin, direction, _) = self.fixture.rays.ray(x, y);
            let of_sprite = |(hit, weight): &(DVec3, f32)| {
                let carried = SPRITE.rise_w_m3() * f64::from(*weight);
                let far_m = (*hit - origin).dot(normal) / direction.dot(normal);
                let r = (origin + direction * far_m).distance(*hit);
                carried * transmittance(GAMMA_PER_M, 1.0) * (radius_m - r).max(0.0)
            };
            (irradiance.get((x, y)) - self.hits.iter().map(of_sprite).sum::<f64>()).abs()
        };
        largest(pixels(SIZE).map(error)) / largest(irradiance.data().iter().copied())
    }
}

/// What the sprites bring to the plane, summed over its area, against the photons' flux.
fn energy(rig: &Rig<'_>) -> Result<Check> {
    let lit = SpriteScene::new(rig)?;
    let irradiance = lit.irradiance(rig, &lit.fixture, &SPRITE)?;
    let floor = (DVec3::Y * mean(lit.hits.iter().map(|(hit, _)| hit.y)), DVec3::Y);
    let area = |at| rig::area_shown(&lit.fixture.rays, at, floor);
    let shown = pixels(SIZE).filter(|at| irradiance.get(*at) > 0.0);
    let brought: f64 = shown.map(|at| irradiance.get(at) * area(at)).sum();
    let weights: f64 = lit.hits.iter().map(|(_, weight)| f64::from(*weight)).sum();
    let flux = SPRITE.photon_w * transmittance(GAMMA_PER_M, 1.0) * weights;
    Ok(Check::new(rig, "sum of irradiance × area over the photons' flux: relative error")
        .within((0.01, "1"), relative_error(brought, flux))
        .control("one photon in twenty more", relative_error(brought, 1.05 * flux)))
}

/// Sprites on a floor that a wall hides in part: the wall stays dark, and nothing else changes.
fn hidden(rig: &Rig<'_>) -> Result<Check> {
    let lit = SpriteScene::new(rig)?;
    let open = lit.irradiance(rig, &lit.fixture, &SPRITE)?;
    let mut scene = rig::flat_plane(LightKind::Directional)?;
    scene.camera = lit.fixture.scene.camera.clone();
    let middle = lit.hits.iter().map(|(hit, _)| *hit).sum::<DVec3>() / lit.hits.len() as f64;
    let between = middle.lerp(scene.camera.position(), 0.4);
    let wall = Mesh::parallelogram(between, 0.15 * DVec3::X, 0.6 * DVec3::Y);
    scene.objects.push(Object::new("wall", wall));
    let fixture = rig.fixture(scene, SIZE)?;
    let is_wall = |hit: Hit| hit.object + 1 == fixture.scene.objects.len();
    let wall: Vec<(u32, u32)> =
        pixels(SIZE).filter(|at| fixture.hit(*at).is_some_and(is_wall)).collect();
    let Fixture { shared, scene, geometry, .. } = &fixture;
    let peel = peel::new(rig, shared, scene, geometry, Objects::Solid, SIZE, 2)?;
    rig.run(&[&peel])?;
    let behind = SpriteScene { layers: peel.output, ..lit };
    let brightest = |visible_m: f64| -> Result<f64> {
        let irradiance = behind.irradiance(rig, &fixture, &Sprite { visible_m, ..SPRITE })?;
        // Beside the wall the floor is lit by sprites behind it too: some tens of W/m².
        let off = |at| (irradiance.get(at) - open.get(at)).abs() - 1e-3;
        let off = pixels(SIZE).filter(|at| !wall.contains(at)).map(off);
        Ok(largest(wall.iter().map(|at| irradiance.get(*at)).chain(off)))
    };
    Ok(Check::new(rig, "greatest irradiance on a wall before the sprites, or change beside it")
        .within((0.0, "W/m²"), brightest(SPRITE.visible_m)?)
        .control("whatever lies before them is lit", brightest(100.0)?)
        .with("pixels_of_the_wall", wall.len() as f64))
}

/// Each pixel against Eq. 1 evaluated in f64.
fn shape(rig: &Rig<'_>, lit: &SpriteScene) -> Result<Check> {
    let irradiance = lit.irradiance(rig, &lit.fixture, &SPRITE)?;
    let errors = |radius_m| lit.errors(&irradiance, DVec3::Y, radius_m);
    Ok(Check::new(rig, "largest |irradiance − Eq. 1| over the greatest irradiance")
        .within((0.01, "1"), errors(SPRITE.radius_m))
        .control("radius 5 % larger", errors(1.05 * SPRITE.radius_m)))
}

/// Eq. 1 in the plane against the camera's axis, on a floor that lies slanted to it.
fn facing_shape(rig: &Rig<'_>) -> Result<Check> {
    let lit = SpriteScene::new(rig)?;
    let sprite = Sprite { facing: true, visible_m: 100.0, ..SPRITE };
    let irradiance = lit.irradiance(rig, &lit.fixture, &sprite)?;
    let axis = lit.fixture.scene.camera.direction();
    let errors = |normal| lit.errors(&irradiance, normal, SPRITE.radius_m);
    Ok(Check::new(rig, "largest |irradiance − Eq. 1| over the greatest irradiance")
        .within((0.01, "1"), errors(axis))
        .control("in the receiver's plane", errors(DVec3::Y)))
}

/// The port, of whose pixels some are above the water and some below, with known light of sprites and shafts.
fn composed(rig: &Rig<'_>) -> Checks {
    const EXPOSURE: f64 = 0.25;
    const SHAFT_SCALE: f64 = 0.8;
    let mut checks = Vec::new();
    for (kind, height_m) in [(LightKind::Directional, 2.5), (LightKind::Point, -0.6)] {
        let fixture = rig.fixture(rig::shore(kind, height_m)?, SIZE)?;
        let known = NoisySurfaces::new(rig, &fixture, |_| DVec3::ZERO)?;
        let [sprites, shafts] = [3, 4].map(|seed| noise(SIZE, seed).map(|value| 4.0 * value));
        let (light, flux) = (rig.grey(&sprites), rig.grey(&shafts));
        let shafts_over = Some(Shafts { flux: &flux, scale: SHAFT_SCALE });
        let draw = |output: SpriteOutput<'_>| -> Result<Texels> {
            let stage = compose::new(rig, &fixture.shared, &known.gbuffer, &light, &output)?;
            Texels::draw(rig, &stage)
        };
        let dry = |at: (u32, u32), photons: f64| {
            let seen = known.seen(at)?;
            let photons = photons * sprites.get(at) * WATER_TINT;
            Some((seen, seen.lit(photons + known.irradiance(&seen))))
        };
        let picture = |at: (u32, u32), shafts_over: f64| {
            let behind = known.light.background(known.sight(at));
            let radiance = dry(at, 1.0)
                .map_or(behind, |(seen, radiance)| known.through_water(&seen, radiance));
            let shafts = SHAFT_SCALE * shafts.get(at) * SHAFT_TINT;
            vec![displayed(radiance + shafts_over * shafts, EXPOSURE)]
        };
        let radiance = draw(SpriteOutput::Dry)?;
        let dry_error = |photons: f64| {
            largest(pixels(SIZE).map(|at| {
                let exact = dry(at, photons).map_or(DVec4::ZERO, |(_, dry)| dry.extend(1.0));
                ((radiance.get(at) - exact).abs() / (exact + 1e-3)).max_element()
            }))
        };
        checks.push(
            Check::new(rig, format!("{kind:?}: largest relative error of the dry radiance"))
                .within((rig::SHORT_STEP, "1"), dry_error(1.0))
                .control("1 % more light of sprites", dry_error(1.01)),
        );
        for (over, what) in [(None, "picture"), (shafts_over, "picture with shafts")] {
            let shown = draw(SpriteOutput::Picture { shafts: over, exposure: EXPOSURE })?;
            let factor = if over.is_some() { 1.0 } else { 0.0 };
            let error = |factor: f64| largest_excess(&shown, |at| picture(at, factor));
            checks.push(
                Check::new(rig, format!("{kind:?}: largest error of the {what}"))
                    .within((DISPLAY_STEP, "1"), error(factor))
                    .control("2 % more shafts", error(factor + 0.02)),
            );
        }
    }
    Ok(checks)
}
