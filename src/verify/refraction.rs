//! `refraction/compose` and `refraction/surface`: pictures of what lines of sight meet behind glass and behind the water, against exact rays.

use crate::prelude::*;
use fathom_reference::bisected;
use fathom_reference::picture::SKY_SHARE;
use fathom_reference::quantities::quantile;
use fathom_reference::specular::{Ray, Surfaces};
use fathom_stages::refraction::trace;
use fathom_stages::refraction::{Exits, compose, surface};

const SIZE: [u32; 2] = [160, 120];
const LAYERS: u32 = 8;
/// Steps of a ray at least: the pipeline's default.
const MIN_STEPS: u32 = 8;
const EXPOSURE: f64 = 0.4;

pub fn cases() -> Vec<Case> {
    let kinds = [LightKind::Directional, LightKind::Point];
    let what = |kind| format!("pixel by pixel, {kind:?} light");
    let glass = Case::new(compose::INFO.name, "opaque objects through glass", opaque_through_glass);
    let from = |water: WaterView| format!("waves from {}", water.0);
    let waters = Case::each(surface::INFO.name, WATERS, from, water_surface);
    Case::each(compose::INFO.name, kinds, what, composed).chain([glass]).chain(waters).collect()
}

/// Where waves are seen from, the percentile that is judged, the eye and what it looks at, the angle of view (degrees), and the waves'
/// amplitude and length (metres).
type WaterView = (&'static str, u8, [[f64; 3]; 2], [f64; 3]);

/// From below so steeply that little is totally reflected. From the crests lines of sight cross up to twenty waves.
const WATERS: [WaterView; 4] = [
    ("above", 90, [[0.4, 1.6, 3.0], [0.0, -1.6, -1.0]], [60.0, 0.03, 1.5]),
    ("below", 80, [[0.4, -1.4, 3.0], [0.2, 1.6, 1.9]], [60.0, 0.03, 1.5]),
    ("above, flat", 90, [[0.4, 1.6, 3.0], [0.0, -1.6, -1.0]], [60.0, 0.0, 1.5]),
    ("just above crests", 98, [[0.4, 0.02, 3.0], [0.0, -0.04, -1.0]], [4.0, 0.006, 0.25]),
];

/// Surfaces of noise before the environment, in front of which every third pixel has glass and every third has it behind.
fn composed(rig: &Rig<'_>, kind: LightKind) -> Result<Check> {
    let mut scene = ball_before(1.5)?;
    scene.light.kind = kind;
    let fixture = rig.fixture(scene, SIZE)?;
    let known = NoisySurfaces::new(rig, &fixture, |_| DVec3::ZERO)?;
    let mut random = Random::new(11);
    let directions = Texels::new(rig, SIZE, |_| random.direction().extend(0.0));
    let glass_m = |(x, y): (u32, u32)| [0.0, 0.1, 1e3][((x + y) % 3) as usize];
    let positions = Texels::new(rig, SIZE, |at| DVec3::ZERO.extend(glass_m(at)));
    let exits = Exits { positions: positions.texture, directions: directions.texture.clone() };
    // Rays behind glass take no steps: opaque objects through it are the other case's.
    let stage = compose::new(rig, &fixture.shared, &known.gbuffer, &exits, None, EXPOSURE)?;
    let shown = Texels::draw(rig, &stage)?;
    let light = &known.light;
    let unlike = |tiles: f64| {
        share_unlike(&shown, |at| {
            let distance_m = known.seen(at).map(|seen| seen.position.distance(light.camera_m));
            let is_glass = glass_m(at) > 0.0 && distance_m.is_none_or(|m| glass_m(at) < m);
            let direction = if is_glass { directions.get(at).truncate() } else { known.sight(at) };
            let behind = environment(direction, tiles) * light.irradiance / PI;
            let radiance = known.seen(at).filter(|_| !is_glass).map_or(behind, |seen| {
                let cosine = seen.normal.dot(light.to_light(seen.position)).max(0.0);
                seen.lit(DVec3::splat(light.irradiance * (SKY_SHARE + cosine)))
            });
            vec![displayed(radiance, EXPOSURE)]
        })
    };
    // Directions in 16-bit floats fall on edges of the cube.
    Ok(Check::new(rig, format!("{kind:?}: share of pixels unlike an f64 picture"))
        .within((0.5 * EDGES, "1"), unlike(12.0))
        .control("a hundredth of a tile more on a side", unlike(12.01)))
}

/// What a white light is sent back as by the inside of a cube: sides of so many tiles, each side of a colour, every second tile dark, joints darker.
/// Tuned for its looks.
fn environment(direction: DVec3, tiles: f64) -> DVec3 {
    const COLORS: [[[f64; 3]; 2]; 3] = [
        [[0.2, 0.5, 0.25], [0.65, 0.2, 0.16]],
        [[0.75, 0.8, 0.85], [0.55, 0.42, 0.3]],
        [[0.25, 0.35, 0.6], [0.8, 0.6, 0.25]],
    ];
    let axis = direction.abs().max_position();
    let across = [0, 1, 2].into_iter().filter(|other| *other != axis);
    let place = across.map(|other| (direction[other] / direction[axis].abs() * 0.5 + 0.5) * tiles);
    let place: Vec<f64> = place.collect();
    let is_joint = place.iter().any(|at| (at.fract() - 0.5).abs() > 0.5 - 0.025);
    let is_bright = place.iter().map(|at| at.floor()).sum::<f64>() % 2.0 == 1.0;
    let shade = [[0.35, 1.0], [0.1; 2]][usize::from(is_joint)][usize::from(is_bright)];
    shade * DVec3::from(COLORS[axis][usize::from(direction[axis] < 0.0)])
}

/// Scene glass with one ball of glass of an index, which is the first object, before the opaque objects.
fn ball_before(index: f32) -> Result<Scene> {
    let mut scene = Scene::load("glass")?;
    let is_ball = |object: &Object| object.name == "thin glass ball";
    scene.objects.retain(|object| is_ball(object) || Objects::Opaque.holds(&object.material));
    scene.objects.sort_by_key(|object| !is_ball(object));
    let material = &mut scene.objects[0].material;
    (material.optics, material.refractive_index) = (Optics::Glass, index);
    scene.camera = Camera { up: [0.25, 1.0, 0.1], ..scene.camera };
    Ok(scene)
}

/// Pixels that show glass, and pictures with the ball and without.
fn through_ball(rig: &Rig<'_>, index: f32) -> Result<(Fixture, Image, [Texels; 2])> {
    let fixture = rig.fixture(ball_before(index)?, SIZE)?;
    let Fixture { shared, geometry, scene, .. } = &fixture;
    let gbuffer = rig.gbuffer(&fixture)?;
    let peel = peel::new(rig, shared, scene, geometry, Objects::Glass, SIZE, LAYERS)?;
    let walk = walk_uniforms(&peel, scene.solid_bounds(), MIN_STEPS);
    let trace = trace::new(rig, shared, &peel, &walk, 2, None)?;
    rig.run(&[&peel, &trace])?;
    let none = Texels::new(rig, SIZE, |_| DVec4::ZERO).texture;
    let none = Exits { positions: none.clone(), directions: none };
    let picture = |exits: &Exits| {
        let opaque = Some(scene.solid_bounds());
        let stage = compose::new(rig, shared, &gbuffer, exits, opaque, EXPOSURE)?;
        Texels::draw(rig, &stage)
    };
    let pictures = [picture(&trace.output)?, picture(&none)?];
    let glass = rig.channel(&trace.positions, 3)?;
    Ok((fixture, glass, pictures))
}

fn opaque_through_glass(rig: &Rig<'_>) -> Checks {
    // Two steps of eight bits.
    let differ = |a: DVec4, b: DVec4| (a - b).abs().max_element() > 2.5 / 255.0;
    let changed = |[glass, plain]: &[Texels; 2]| {
        share(pixels(SIZE).map(|at| differ(glass.get(at), plain.get(at))))
    };
    let (_, _, straight) = through_ball(rig, 1.0)?;
    let (fixture, glass, bent) = through_ball(rig, 1.4)?;
    let objects = &fixture.scene.objects;
    let surfaces =
        Surfaces { tracer: &fixture.tracer, objects, outside: 1.0, top_m: f64::INFINITY };
    let tracer = Tracer::new(&objects[1..]);
    // Of the rays that meet what the camera sees.
    let wrong = |is_straight: bool| {
        share(pixels(SIZE).filter(|at| glass.get(*at) > 0.0).filter_map(|(x, y)| {
            let (eye, sight, _) = fixture.rays.ray(x, y);
            let Ray { origin, direction, .. } =
                surfaces.ray_behind(surfaces.sight(eye, sight), 2)?;
            let end = tracer.cast(origin, direction, 1e-6, f64::MAX)?.position;
            let seen = tracer.cast(eye, (end - eye).normalize(), 0.0, f64::MAX)?;
            let at = fixture.rays.project(end).filter(|_| fixture.in_view(end))?;
            let expected =
                bent[1].get(if is_straight { (x, y) } else { (at.x_px as u32, at.y_px as u32) });
            let is_seen = seen.position.distance(end) < 1e-2;
            is_seen.then(|| differ(bent[0].get((x, y)), expected))
        }))
    };
    let of = |what: &str| Check::new(rig, format!("opaque objects through glass: {what}"));
    Ok(vec![
        of("share of pixels that index 1 changes")
            .within((0.0, "1"), changed(&straight))
            .control("index 1.4", changed(&bent)),
        // At edges the nearest pixel may show another object.
        of("share of pixels unlike those that exact rays meet")
            .within((0.06, "1"), wrong(false))
            .control("straight rays", wrong(true)),
    ])
}

/// Radiance of what is seen, at a place of the picture: a gradient, so that a line of sight that ends elsewhere shows.
fn gradient(x_px: f64, y_px: f64) -> f64 {
    0.3 + 0.4 * x_px / f64::from(SIZE[0]) + y_px / f64::from(SIZE[1])
}

/// The picture of a floor through waves, against exact refraction and reflection of each line of sight.
fn water_surface(rig: &Rig<'_>, (from, percent, eye_to, waves): WaterView) -> Result<Check> {
    const RED: usize = 0;
    let mut scene = Scene::load("plane")?;
    [scene.camera.position_m, scene.camera.target_m] = eye_to;
    [scene.camera.fov_y_deg, scene.water.amplitude_m, scene.water.wavelength_m] = waves;
    // Low, so that the sun is out of view: its lobe turns the least error of a normal into a large one.
    scene.light.direction = [0.9, -0.4, 0.6];
    let fixture = rig.fixture(scene, SIZE)?;
    let Fixture { scene, shared, geometry, .. } = &fixture;
    let peel = peel::new(rig, shared, scene, geometry, Objects::Opaque, SIZE, 1)?;
    rig.run(&[&peel])?;
    let image = Image::from_fn(SIZE, |x, y| gradient(f64::from(x) + 0.5, f64::from(y) + 0.5));
    let dry = surface::DryView {
        layers: &peel,
        depth: &rig.gbuffer(&fixture)?.depth,
        radiance: &rig.grey(&image),
    };
    let walk = walk_uniforms(&peel, scene.solid_bounds(), MIN_STEPS);
    let stage = surface::new(rig, shared, &dry, &walk, &scene.water, None, EXPOSURE)?;
    let shown = rig.draw(&[&stage], stage.texture(), RED)?;
    let seen = pixels(SIZE).filter(|(x, y)| x % 4 == 1 && y % 4 == 1);
    let met: Vec<_> = seen.map(|at| (at, meet(&fixture, at))).collect();
    let light = fixture.light();
    let error = |index: f64| {
        let water = WetFloor { fixture: &fixture, light: &light, index };
        let errors = met.iter().filter_map(|&(at, met)| {
            let exact = water.radiance(at, met)?;
            Some((radiance_of(shown.get(at), EXPOSURE) - exact).abs() / exact)
        });
        quantile(&mut errors.collect::<Vec<_>>(), f64::from(percent) / 100.0)
    };
    let index = scene.water.refractive_index;
    // Steps of an 8-bit display, and of the noise texture that makes the waves.
    Ok(Check::new(rig, format!("from {from}: {percent}th percentile of the relative error"))
        .within((0.02, "1"), error(index))
        .control("index 10 % higher", error(1.1 * index)))
}

/// Where a line of sight meets the surface before the floor: the place, the normal there, and its distance; and that of the floor.
type SightHits = (Option<(DVec3, DVec3, f64)>, Option<f64>);

/// By small steps and bisection.
fn meet(fixture: &Fixture, (x, y): (u32, u32)) -> SightHits {
    let (water, origin) = (&fixture.scene.water, fixture.scene.camera.position());
    let (_, sight, _) = fixture.rays.ray(x, y);
    let floor_m = fixture.tracer.cast(origin, sight, 0.0, f64::MAX).map(|hit| hit.distance_m);
    let above = |t: f64| {
        let p = origin + sight * t;
        p.y > water.height(p.x, p.z)
    };
    let far_m = floor_m.unwrap_or(fixture.scene.camera.z_far_m);
    let (mut from, step) = (0.0, 5e-3);
    while from < far_m && above(from) == above(from + step) {
        from += step;
    }
    if from >= far_m {
        return (None, floor_m);
    }
    let [_, met] = bisected([from, from + step], 40, |t| above(t) != above(from));
    let p = origin + sight * met;
    (water.contains(p.x, p.z).then(|| (p, water.normal(p.x, p.z), met)), floor_m)
}

/// What is seen of a floor through water, in red.
struct WetFloor<'a> {
    fixture: &'a Fixture,
    light: &'a PictureLight,
    index: f64,
}

impl WetFloor<'_> {
    /// None where a line of sight ends at the border of the view.
    fn radiance(&self, (x, y): (u32, u32), (met, floor_m): SightHits) -> Option<f64> {
        let (_, sight, _) = self.fixture.rays.ray(x, y);
        let origin = self.fixture.scene.camera.position();
        let under = origin.y < 0.0;
        let shown = gradient(f64::from(x) + 0.5, f64::from(y) + 0.5);
        let Some((entry, normal, distance_m)) = met else {
            let path_m = floor_m?;
            return Some(if under { self.through(shown, path_m) } else { shown });
        };
        let [before, behind] = if under { [self.index, 1.0] } else { [1.0, self.index] };
        // What ends out of view is taken from straight behind the surface.
        let straight = match floor_m {
            Some(floor_m) => self.through(shown, floor_m - distance_m),
            None => self.through(0.0, self.fixture.scene.camera.z_far_m),
        };
        let reflected = fresnel_reflectance(sight.dot(normal).abs(), before, behind);
        let mirrored = sight - 2.0 * sight.dot(normal) * normal;
        let mut radiance = 0.0;
        if reflected > 0.0 {
            radiance += reflected * self.along(entry, mirrored, straight)?;
        }
        if let Some(refracted) = refract(sight, normal, before, behind) {
            radiance += (1.0 - reflected) * self.along(entry, refracted, straight)?;
        }
        Some(if under { self.through(radiance, distance_m) } else { radiance })
    }

    fn along(&self, place: DVec3, direction: DVec3, straight: f64) -> Option<f64> {
        if direction.y > 0.0 {
            return Some(self.light.sky(direction).x);
        }
        let hit = self.fixture.tracer.cast(place, direction, 0.0, f64::MAX);
        let seen = hit.and_then(|hit| Some((hit, self.fixture.rays.project(hit.position)?)));
        let inside = |at: &Projected, margin: f64| {
            let within = |at: f64, side: u32| (-margin..f64::from(side) + margin).contains(&at);
            within(at.x_px, SIZE[0]) && within(at.y_px, SIZE[1])
        };
        match seen.filter(|(_, at)| inside(at, 2.0)) {
            None => Some(straight),
            Some((hit, at)) => {
                inside(&at, -2.0).then(|| self.through(gradient(at.x_px, at.y_px), hit.distance_m))
            }
        }
    }

    fn through(&self, radiance: f64, path_m: f64) -> f64 {
        self.light.fogged(DVec3::splat(radiance), path_m).x
    }
}
