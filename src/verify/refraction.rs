//! Lines of sight through glass against closed forms of a slab and a sphere, and against exact ray casting.

use std::collections::BTreeMap;

use crate::prelude::*;
use fathom_pipelines::refraction::by_lines;
use fathom_reference::specular::{Ray, Surfaces};
use fathom_scene::generators;
use fathom_stages::kit::Resources;
use fathom_stages::refraction::trace;
use fathom_stages::refraction::two_interface;
use fathom_stages::refraction::{Exits, compose, surface};
use fathom_stages::transfer::sight;

const SIZE: [u32; 2] = [160, 120];
const INDEX: f64 = 1.4;
const LAYERS: u32 = 8;
/// Steps of a ray at least: the pipeline's default.
const LEAST: u32 = 8;
const EXPOSURE: f64 = 0.4;
/// Scene slab: its upper and lower side, and half its width, metres.
const SLAB_Y_M: [f64; 2] = [-2.6, -3.0];
const SLAB_HALF_M: f64 = 2.0;
/// Scene ball.
const BALL_M: f64 = 0.8;
const BALL_MIDDLE: DVec3 = DVec3::new(0.0, -3.2, 0.0);

pub fn cases() -> Vec<Case> {
    vec![
        Case::new(trace::INFO.name, "a slanted slab", slab),
        Case::new(trace::INFO.name, "a sphere, off-centre", |rig| {
            sphere(rig, (Surface::Plane, LEAST), [2e-3, 0.2])
        }),
        Case::new(sight::INFO.name, "a sphere by lines", |rig| {
            sphere(rig, (Surface::Depth, 64), [0.03, 2.0])
        }),
        Case::new(trace::INFO.name, "a sphere by lines against all layers", |rig| {
            sphere(rig, (Surface::AllDepths, 64), [0.03, 2.0])
        }),
        Case::new(trace::INFO.name, "a knot", knot),
        Case::new(trace::INFO.name, "random solids", random_solids),
        Case::new(trace::INFO.name, "a camera in glass", from_within),
        Case::new(two_interface::INFO.name, "a sphere, off-centre", two_interfaces),
        Case::new(compose::INFO.name, "the environment", environment),
        Case::new(compose::INFO.name, "opaque objects through glass", opaque_through_glass),
        Case::new(surface::INFO.name, "waves from above", |rig| water_surface(rig, true)),
        Case::new(surface::INFO.name, "waves from below", |rig| water_surface(rig, false)),
    ]
}

/// Scene ball with its object in a corner of the view.
fn ball() -> Result<Scene> {
    let mut scene = glass("ball", "ball")?;
    scene.camera.target_m = [0.7, -2.9, 0.3];
    Ok(scene)
}

/// One object of a scene as glass, seen through a turned camera.
fn glass(scene: &str, object: &str) -> Result<Scene> {
    let mut scene = Scene::load(scene)?;
    scene.objects.retain(|found| found.name == object);
    for object in &mut scene.objects {
        object.material.optics = Optics::Glass;
        object.material.alpha = 0.2;
        object.material.refractive_index = INDEX as f32;
    }
    scene.camera = Camera { up: [0.25, 1.0, 0.1], ..scene.camera };
    Ok(scene)
}

/// A pixel's line of sight, and the ray behind glass that a stage finds for it.
struct Found {
    origin: DVec3,
    sight: DVec3,
    position: DVec3,
    direction: DVec3,
}

fn read(rig: &Rig<'_>, stand: &Stand, exits: &Exits) -> Result<Vec<Found>> {
    let glass = rig.channel(&exits.positions, 3)?;
    let positions = rig.vectors(&exits.positions)?;
    let directions = rig.vectors(&exits.directions)?;
    let size_px = stand.view.size_px.to_array();
    let found = pixels(size_px).zip(positions.into_iter().zip(directions));
    Ok(found
        .filter(|(at, _)| glass.at(*at) > 0.0)
        .map(|((x, y), (position, direction))| {
            let (origin, sight, _) = stand.rays.ray(x, y);
            Found { origin, sight, position, direction }
        })
        .collect())
}

fn traced(rig: &Rig<'_>, stand: &Stand, surface: Surface, least: u32) -> Result<Vec<Found>> {
    let Stand { scene, shared, geometry, .. } = stand;
    let size_px = stand.view.size_px.to_array();
    let peel = peel::new(rig, shared, scene, (geometry, Part::Glass), size_px, LAYERS)?;
    rig.run(&[&peel])?;
    let bounds = stand.scene.solid_bounds();
    let resources = Resources::new(rig.gpu);
    let exits = if surface == Surface::Plane {
        let walk = walk_uniforms(&peel, bounds, least);
        resources.push(trace::new(&resources, shared, &peel, &walk, (2, None))?)
    } else {
        by_lines(&resources, (&stand.view, shared), &peel, bounds, (surface, least))?
    };
    let stages = resources.into_parts().stages;
    rig.gpu.run(&stages.iter().map(AsRef::as_ref).collect::<Vec<&Stage>>())?;
    read(rig, stand, &exits)
}

/// Angles to the directions that a rule gives, where it has an answer.
fn angles_deg(found: &[Found], exact: impl Fn(&Found) -> Option<DVec3>) -> Vec<f64> {
    let angle = |f: &Found| Some(f.direction.angle_between(exact(f)?).to_degrees());
    found.iter().filter_map(angle).collect()
}

/// Where a ray leaves the slab through its lower side, a plane glass: it goes on in parallel.
fn behind_slab(origin: DVec3, direction: DVec3, index: f64) -> Option<DVec3> {
    let [top, bottom] = SLAB_Y_M;
    let on = |p: DVec3| p.x.abs().max(p.z.abs()) < 0.98 * SLAB_HALF_M;
    let entry = origin + direction * ((top - origin.y) / direction.y);
    let inside = refract(direction, DVec3::Y, 1.0, index)?;
    let exit = entry + inside * ((bottom - top) / inside.y);
    (direction.y < 0.0 && on(entry) && on(exit)).then_some(exit)
}

fn slab(rig: &Rig<'_>) -> Checks {
    let found = traced(rig, &rig.stand(glass("slab", "slab")?, SIZE)?, Surface::Plane, LEAST)?;
    let places = |index: f64| {
        percentile::<95>(
            found
                .iter()
                .filter_map(|f| Some(f.position.distance(behind_slab(f.origin, f.sight, index)?))),
        )
    };
    let directions = |turned: fn(DVec3) -> DVec3| {
        percentile::<95>(angles_deg(&found, |f| {
            behind_slab(f.origin, f.sight, INDEX).map(|_| turned(f.sight))
        }))
    };
    let inside = |direction| refract(direction, DVec3::Y, 1.0, INDEX).unwrap_or(direction);
    Ok(vec![
        Check::of(rig, "slab: 95th percentile of |exit − closed form|")
            .within((5e-3, "m"), places(INDEX))
            .control("index 5 % higher", places(1.05 * INDEX)),
        Check::of(rig, "slab: 95th percentile of the angle to the closed form")
            .within((0.002, "deg"), directions(|direction| direction))
            .control("held against the rays inside", directions(inside)),
    ])
}

/// First intersection of a ray with the ball.
fn meet_ball(origin: DVec3, direction: DVec3) -> Option<DVec3> {
    let from = origin - BALL_MIDDLE;
    let half = from.dot(direction);
    let root = half * half - from.length_squared() + BALL_M * BALL_M;
    (root > 0.0).then(|| origin + direction * (-half - root.sqrt()))
}

/// The ray behind two refractions at an ideal ball: where it starts, and its direction.
fn behind_ball(origin: DVec3, direction: DVec3, index: f64) -> Option<(DVec3, DVec3)> {
    let entry = meet_ball(origin, direction)?;
    let inside = refract(direction, (entry - BALL_MIDDLE) / BALL_M, 1.0, index)?;
    let chord = -2.0 * (entry - BALL_MIDDLE).dot(inside);
    let exit = entry + inside * chord;
    Some((exit, refract(inside, (exit - BALL_MIDDLE) / BALL_M, index, 1.0)?))
}

/// 75th percentile of the angle to the closed form.
fn ball_error_deg(found: &[Found], index: f64) -> f64 {
    percentile::<75>(angles_deg(found, |f| Some(behind_ball(f.origin, f.sight, index)?.1)))
}

/// With so many steps of a ray at least.
fn sphere(
    rig: &Rig<'_>,
    (surface, least): (Surface, u32),
    [tolerance_m, tolerance_deg]: [f64; 2],
) -> Checks {
    let found = traced(rig, &rig.stand(ball()?, SIZE)?, surface, least)?;
    let place = |index: f64| {
        let off = |f: &Found| Some(f.position.distance(behind_ball(f.origin, f.sight, index)?.0));
        median(found.iter().filter_map(off))
    };
    let control = 1.5;
    let (higher, index) = (format!("index {control} times as high"), control * INDEX);
    Ok(vec![
        Check::of(rig, format!("sphere by {surface:?}: median |exit − closed form|"))
            .within((tolerance_m, "m"), place(INDEX))
            .control(&higher, place(index)),
        Check::of(
            rig,
            format!("sphere by {surface:?}: 75th percentile of the angle to the closed form"),
        )
        .within((tolerance_deg, "deg"), ball_error_deg(&found, INDEX))
        .control(&higher, ball_error_deg(&found, index)),
    ])
}

/// A concave object: rays are not in order of the layers everywhere.
fn knot(rig: &Rig<'_>) -> Result<Check> {
    let stand = rig.stand(glass("glass", "knot")?, SIZE)?;
    let found = traced(rig, &stand, Surface::Plane, LEAST)?;
    let error = |factor: f64| {
        let exact = exact(&stand, &found, factor);
        let pairs = found.iter().zip(&exact);
        median(pairs.filter_map(|(f, exact)| {
            Some(f.direction.angle_between(exact.as_ref()?.direction).to_degrees())
        }))
    };
    Ok(Check::of(rig, "knot: median angle to exact ray casting")
        .within((0.5, "deg"), error(1.0))
        .control("index 25 % higher", error(1.25)))
}

/// Random glass by its number, of faces that are flat: a convex solid, a dented one, or four thin plates one behind another.
fn solids(number: u32) -> Result<Scene, String> {
    let random = &mut Random::new(1000 * number);
    let mut scene = glass("ball", "ball").map_err(|error| error.to_string())?;
    let mut like = scene.objects.remove(0);
    like.material.refractive_index = [1.0, 1.2, 1.5][number as usize / 3 % 3];
    let plates: &[f64] = if number % 3 == 2 { &[-0.6, -0.2, 0.2, 0.6] } else { &[0.0] };
    for plate_y in plates {
        let rows = BTreeMap::from([
            ("rows".into(), 3.0 + (3.0 * random.number()).floor()),
            ("radius_m".into(), 1.0),
        ]);
        let ball = generators::find("sphere")?.mesh(&rows, 1.0)?;
        let half_m = 0.75 + vector(random, 0.25);
        let half_m = half_m * DVec3::new(1.0, if plates.len() > 1 { 0.02 } else { 1.0 }, 1.0);
        let dents = vector(random, 3.0) * f64::from(u8::from(number % 3 == 1));
        let turn = DQuat::from_scaled_axis(vector(random, 0.3));
        let place = |at: DVec3| {
            turn * (half_m * at * (1.0 - 0.5 * at.dot(dents).sin().powi(2))) + plate_y * DVec3::Y
        };
        let corners = (0..ball.triangle_count())
            .flat_map(|triangle| ball.triangle(triangle).map(|at| at - DVec3::Y));
        let positions: Vec<_> = corners.map(|at| place(at).as_vec3().to_array()).collect();
        let indices = (0..positions.len() as u32).collect();
        scene.objects.push(Object { mesh: Mesh::smooth(positions, indices), ..like.clone() });
    }
    let eye = 3.5 * (vector(random, 1.0) + 2.5 * DVec3::Y).normalize();
    scene.camera = Camera::new(eye.to_array(), [0.0; 3], 40.0, [0.1, 20.0]);
    scene.camera.up = [0.3, 0.1, 1.0];
    Ok(scene)
}

fn vector(random: &mut Random, span: f64) -> DVec3 {
    DVec3::from([(); 3].map(|()| random.within(-span, span)))
}

/// Rays behind two surfaces, by exact ray casting, with indices so many times as high.
fn exact(stand: &Stand, found: &[Found], factor: f64) -> Vec<Option<Ray>> {
    let mut objects = stand.scene.objects.clone();
    for object in &mut objects {
        object.material.refractive_index *= factor as f32;
    }
    let surfaces =
        Surfaces { tracer: &stand.tracer, objects: &objects, outside: 1.0, top_m: f64::INFINITY };
    let behind = |f: &Found| surfaces.behind(surfaces.sight(f.origin, f.sight), 2);
    found.iter().map(behind).collect()
}

/// Distances of exits from random glass to exact ones, relative to its size, with the rays' fewest steps; and the same with indices
/// 5 % higher, as a control.
///
/// # Errors
/// What the device reports.
pub fn solid_errors(rig: &Rig<'_>, number: u32, least: u32) -> Result<[Vec<f64>; 2]> {
    let stand = rig.stand(solids(number).map_err(|what| rig.empty(&what))?, [64, 48])?;
    let found = traced(rig, &stand, Surface::Plane, least)?;
    let size_m = stand.scene.solid_bounds().size().max_element();
    Ok([1.0, 1.05].map(|factor| {
        let exact = exact(&stand, &found, factor);
        let pairs = found.iter().zip(exact);
        pairs.filter_map(|(f, exact)| Some(exact?.origin.distance(f.position) / size_m)).collect()
    }))
}

/// An exit farther than this from the exact one, relative to the size of the glass, is wrong.
pub const WRONG: f64 = 2e-3;

fn random_solids(rig: &Rig<'_>) -> Result<Check> {
    let errors = (0..18).map(|number| solid_errors(rig, number, LEAST));
    let errors = errors.collect::<Result<Vec<_>>>()?;
    let all =
        |control: usize| errors.iter().flat_map(move |errors| errors[control].iter().copied());
    // A rasterizer that moves corners by 1/32 of a pixel, as SwiftShader's, moves faces that are seen at a grazing angle.
    Ok(Check::of(
        rig,
        "random solids: 95th percentile of |exit − exact exit|, relative to their size",
    )
    .within((WRONG, "1"), percentile::<95>(all(0)))
    .control("index 5 % higher", percentile::<95>(all(1)))
    .with("exits", all(0).count() as f64)
    .with("wrong_share", share(all(0).map(|error| error > WRONG))))
}

/// The camera in a solid: the first surface is an exit.
fn from_within(rig: &Rig<'_>) -> Result<Check> {
    let mut scene = solids(6).map_err(|what| rig.empty(&what))?;
    (scene.camera.position_m, scene.camera.target_m) = ([0.0; 3], [0.2, 1.0, 0.1]);
    let stand = rig.stand(scene, [64, 48])?;
    let found = traced(rig, &stand, Surface::Plane, LEAST)?;
    let error = |before: f64, behind: f64| {
        median(angles_deg(&found, |f| {
            let normal = stand.tracer.cast(f.origin, f.sight, 0.0, f64::MAX)?.normal;
            refract(f.sight, normal, before, behind)
        }))
    };
    Ok(Check::of(rig, "from within glass: median angle to Snell's law")
        .within((1e-3, "deg"), error(1.5, 1.0))
        .control("an entry", error(1.0, 1.5)))
}

/// Wyman's approximation evaluated for an ideal ball: way through it as a mean of the chord along the sight and of the diameter.
fn approximated(rays: &PixelRays, sight: (DVec3, DVec3), along_normal_m: f64) -> Option<DVec3> {
    let (origin, direction) = sight;
    let entry = meet_ball(origin, direction)?;
    let normal = (entry - BALL_MIDDLE) / BALL_M;
    let inside = refract(direction, normal, 1.0, INDEX)?;
    let [incident, behind] = [direction, inside].map(|d| d.dot(normal).abs().acos());
    let chord_m = -2.0 * (entry - BALL_MIDDLE).dot(direction);
    let share = if incident > 0.0 { behind / incident } else { 1.0 / INDEX };
    let out = entry + inside * (share * chord_m + (1.0 - share) * along_normal_m);
    let at = rays.project(out)?;
    let (from, through, _) = rays.ray_at(at.x_px.floor() + 0.5, at.y_px.floor() + 0.5);
    let near = meet_ball(from, through)?;
    let far = near + through * (-2.0 * (near - BALL_MIDDLE).dot(through));
    refract(inside, (far - BALL_MIDDLE) / BALL_M, INDEX, 1.0)
}

fn two_interfaces(rig: &Rig<'_>) -> Result<Check> {
    let stand = rig.stand(ball()?, SIZE)?;
    let diameter = (2.0 * BALL_M as f32).to_bits();
    let thickness = rig.words(&vec![diameter; stand.scene.objects[0].mesh.positions.len()]);
    let stage = two_interface::new(rig, &stand.shared, &stand.geometry, SIZE, &thickness)?;
    rig.run(&[&stage])?;
    let found = read(rig, &stand, &stage)?;
    let error = |along_normal_m: f64| {
        percentile::<75>(angles_deg(&found, |f| {
            approximated(&stand.rays, (f.origin, f.sight), along_normal_m)
        }))
    };
    Ok(Check::of(rig, "75th percentile of the angle to Wyman's formula")
        .within((0.5, "deg"), error(2.0 * BALL_M))
        .control("way along the normal half as long", error(BALL_M))
        .with("from_exact_deg", ball_error_deg(&found, INDEX)))
}

/// Radiance of the environment, from its description: a cube's inside with twelve tiles a side.
fn environment_radiance(direction: DVec3, irradiance: f64) -> DVec3 {
    let size = direction.abs();
    let axis = size.max_position();
    let [u, v] = [[1, 2], [0, 2], [0, 1]][axis].map(|other| direction[other] / size[axis]);
    let upper = direction[axis] > 0.0;
    let color = match (axis, upper) {
        (0, true) => [0.2, 0.5, 0.25],
        (0, false) => [0.65, 0.2, 0.16],
        (1, true) => [0.75, 0.8, 0.85],
        (1, false) => [0.55, 0.42, 0.3],
        (_, true) => [0.25, 0.35, 0.6],
        (_, false) => [0.8, 0.6, 0.25],
    };
    let place = [u, v].map(|at| (at + 1.0) * 6.0);
    let joint = place.iter().any(|at| (at.fract() - 0.5).abs() > 0.475);
    let odd = (place[0].floor() + place[1].floor()) as i64 % 2 == 1;
    let shade = if joint {
        0.1
    } else if odd {
        1.0
    } else {
        0.35
    };
    DVec3::from(color) * shade * irradiance / PI
}

fn environment(rig: &Rig<'_>) -> Result<Check> {
    const SMALL: [u32; 2] = [4, 4];
    let stand = rig.stand(glass("slab", "none")?, SMALL)?;
    let gbuffer = rig.gbuffer(&stand)?;
    let mut random = Random::new(11);
    let mut shown = Vec::new();
    for _ in 0..24 {
        let direction = DVec3::from([(); 3].map(|()| random.within(-1.0, 1.0)));
        let exits = Exits {
            positions: rig.constant(SMALL, [0.0, 0.0, 0.0, 1.0])?,
            directions: rig
                .constant(SMALL, direction.normalize().as_vec3().extend(0.0).to_array())?,
        };
        let stage = compose::new(rig, &stand.shared, &gbuffer, &exits, None, EXPOSURE)?;
        rig.run(&[&stage])?;
        let color = rig.vectors(stage.texture())?[5];
        shown.push((direction, color.map(|value| radiance_of(value, EXPOSURE))));
    }
    let error = |shifted: usize| {
        let turned = shown.iter().cycle().skip(shifted).map(|(direction, _)| *direction);
        percentile::<90>(shown.iter().zip(turned).map(|((_, color), direction)| {
            let exact = environment_radiance(direction, stand.view.irradiance());
            color.distance(exact) / exact.length()
        }))
    };
    // Steps of an 8-bit display; a direction in 16-bit floats may fall into the next tile.
    Ok(Check::of(rig, "90th percentile of the radiance's relative error")
        .within((0.03, "1"), error(0))
        .control("each held against the next direction", error(1)))
}

/// Exits from a ball of glass of an index before the opaque objects of scene glass, and pictures with the ball and without.
fn through_ball(rig: &Rig<'_>, index: f32) -> Result<(Stand, Vec<Found>, [Vec<DVec3>; 2])> {
    let mut scene = glass("glass", "thin glass ball")?;
    scene.objects[0].material.refractive_index = index;
    let others = Scene::load("glass")?.objects.into_iter();
    scene.objects.extend(others.filter(|object| Part::Opaque.holds(&object.material)));
    let stand = rig.stand(scene, SIZE)?;
    let Stand { shared, geometry, scene, .. } = &stand;
    let gbuffer = rig.gbuffer(&stand)?;
    let peel = peel::new(rig, shared, scene, (geometry, Part::Glass), SIZE, LAYERS)?;
    let walk = walk_uniforms(&peel, scene.solid_bounds(), LEAST);
    let trace = trace::new(rig, shared, &peel, &walk, (2, None))?;
    rig.run(&[&peel, &trace])?;
    let none = rig.constant(SIZE, [0.0; 4])?;
    let none = Exits { positions: none.clone(), directions: none };
    let picture = |exits: &Exits| {
        let opaque = Some(scene.solid_bounds());
        let stage = compose::new(rig, shared, &gbuffer, exits, opaque, EXPOSURE)?;
        rig.run(&[&stage])?;
        rig.vectors(stage.texture())
    };
    let (found, pictures) = (read(rig, &stand, &trace)?, [picture(&trace.left)?, picture(&none)?]);
    Ok((stand, found, pictures))
}

fn opaque_through_glass(rig: &Rig<'_>) -> Checks {
    // Two steps of eight bits.
    let differ = |a: DVec3, b: DVec3| (a - b).abs().max_element() > 2.5 / 255.0;
    let changed = |[glass, plain]: &[Vec<DVec3>; 2]| {
        share(glass.iter().zip(plain).map(|(glass, plain)| differ(*glass, *plain)))
    };
    let (_, _, straight) = through_ball(rig, 1.0)?;
    let (stand, found, bent) = through_ball(rig, 1.4)?;
    let tracer = Tracer::new(&stand.scene.objects[1..]);
    let exact = exact(&stand, &found, 1.0);
    // Of the rays that meet what the camera sees.
    let wrong = |is_straight: bool| {
        share(found.iter().zip(&exact).filter_map(|(f, exact)| {
            let Ray { origin, direction, .. } = exact.as_ref()?;
            let end = tracer.cast(*origin, *direction, 1e-6, f64::MAX)?.position;
            let seen = tracer.cast(f.origin, (end - f.origin).normalize(), 0.0, f64::MAX)?;
            let at = |place| {
                let at = stand.rays.project(place).filter(|_| stand.in_view(place))?;
                Some(at.y_px as usize * SIZE[0] as usize + at.x_px as usize)
            };
            let expected = bent[1][at(if is_straight { f.origin } else { end })?];
            let is_seen = seen.position.distance(end) < 1e-2;
            is_seen.then_some(differ(bent[0][at(f.origin)?], expected))
        }))
    };
    let of = |what: &str| Check::of(rig, format!("opaque objects through glass: {what}"));
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
fn water_surface(rig: &Rig<'_>, above: bool) -> Result<Check> {
    const RED: usize = 0;
    let mut scene = Scene::load("plane")?;
    scene.camera.position_m = [0.4, if above { 1.6 } else { -1.4 }, 3.0];
    // From below so steeply that little is totally reflected.
    scene.camera.target_m = if above { [0.0, -1.6, -1.0] } else { [0.2, 1.6, 1.9] };
    scene.water.amplitude_m = 0.03;
    // Low, so that the sun is out of view: its lobe turns the least error of a normal into a large one.
    scene.light.direction = [0.9, -0.4, 0.6];
    let stand = rig.stand(scene, SIZE)?;
    let Stand { scene, shared, geometry, .. } = &stand;
    let peel = peel::new(rig, shared, scene, (geometry, Part::Opaque), SIZE, 1)?;
    rig.run(&[&peel])?;
    let image = Image::of(SIZE, |x, y| gradient(f64::from(x) + 0.5, f64::from(y) + 0.5));
    let dry = surface::Dry {
        layers: &peel,
        depth: &rig.gbuffer(&stand)?.depth,
        radiance: &rig.grey(&image),
    };
    let walk = walk_uniforms(&peel, scene.solid_bounds(), LEAST);
    let walk = (&walk, scene.water.bound_m());
    let stage = surface::new(rig, shared, &dry, walk, (None, EXPOSURE))?;
    let shown = rig.drawn(&[&stage], stage.texture(), RED)?;
    let error = |index: f64| {
        let water = Wet { stand: &stand, index };
        let seen = pixels(SIZE).filter(|(x, y)| x % 3 == 1 && y % 3 == 1);
        percentile::<75>(seen.filter_map(|at| {
            let exact = water.seen(at)?;
            Some((radiance_of(shown.at(at), EXPOSURE) - exact).abs() / exact)
        }))
    };
    let index = scene.water.refractive_index;
    let side = if above { "above" } else { "below" };
    // Steps of an 8-bit display, and of the noise texture that makes the waves.
    Ok(Check::of(rig, format!("from {side}: 75th percentile of the relative error"))
        .within((0.02, "1"), error(index))
        .control("index 10 % higher", error(1.1 * index)))
}

/// What is seen of a floor through water, in red.
struct Wet<'a> {
    stand: &'a Stand,
    index: f64,
}

impl Wet<'_> {
    /// None where a line of sight ends at the border of the view.
    fn seen(&self, (x, y): (u32, u32)) -> Option<f64> {
        let (_, sight, _) = self.stand.rays.ray(x, y);
        let origin = self.stand.scene.camera.position();
        let floor_m =
            self.stand.tracer.cast(origin, sight, 0.0, f64::MAX).map(|hit| hit.distance_m);
        let under = origin.y < 0.0;
        let shown = gradient(f64::from(x) + 0.5, f64::from(y) + 0.5);
        let Some((entry, normal, way_m)) = self.meet(origin, sight, floor_m) else {
            let path_m = floor_m?;
            return Some(if under { self.fogged(shown, path_m) } else { shown });
        };
        let [before, behind] = if under { [self.index, 1.0] } else { [1.0, self.index] };
        // What ends out of view is taken from straight behind the surface.
        let straight = match floor_m {
            Some(floor_m) => self.fogged(shown, floor_m - way_m),
            None => self.fogged(0.0, self.stand.scene.camera.z_far_m),
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
        Some(if under { self.fogged(radiance, way_m) } else { radiance })
    }

    /// Where a line of sight meets the surface before the floor, by small steps and bisection; the normal there.
    fn meet(
        &self,
        origin: DVec3,
        sight: DVec3,
        floor_m: Option<f64>,
    ) -> Option<(DVec3, DVec3, f64)> {
        let water = &self.stand.scene.water;
        let above = |t: f64| {
            let p = origin + sight * t;
            p.y > water.height(p.x, p.z)
        };
        let far_m = floor_m.unwrap_or(self.stand.scene.camera.z_far_m);
        let (mut a, step) = (0.0, 5e-3);
        while a < far_m && above(a) == above(a + step) {
            a += step;
        }
        if a >= far_m {
            return None;
        }
        let mut b = a + step;
        for _ in 0..40 {
            let middle = 0.5 * (a + b);
            if above(middle) == above(a) { a = middle } else { b = middle }
        }
        let p = origin + sight * b;
        water.contains(p.x, p.z).then(|| (p, water.normal(p.x, p.z), b))
    }

    fn along(&self, place: DVec3, direction: DVec3, straight: f64) -> Option<f64> {
        if direction.y > 0.0 {
            return Some(self.sky(direction));
        }
        let hit = self.stand.tracer.cast(place, direction, 0.0, f64::MAX);
        let seen = hit.and_then(|hit| Some((hit, self.stand.rays.project(hit.position)?)));
        let inside = |at: &Projected, margin: f64| {
            let within = |at: f64, side: u32| (-margin..f64::from(side) + margin).contains(&at);
            within(at.x_px, SIZE[0]) && within(at.y_px, SIZE[1])
        };
        match seen.filter(|(_, at)| inside(at, 2.0)) {
            None => Some(straight),
            Some((hit, at)) => {
                inside(&at, -2.0).then(|| self.fogged(gradient(at.x_px, at.y_px), hit.distance_m))
            }
        }
    }

    /// `shaders/shared/shading.wgsl`: Beer's law, and the water's own colour in red.
    fn fogged(&self, radiance: f64, path_m: f64) -> f64 {
        let t = transmittance(self.stand.scene.water.attenuation_per_m, path_m);
        radiance * t + 0.004 * self.stand.view.irradiance() / PI * (1.0 - t)
    }

    /// The same: a gradient in red, and the sun.
    fn sky(&self, direction: DVec3) -> f64 {
        let forward = self.stand.view.light_frame().forward;
        let up = direction.y.clamp(0.0, 1.0).sqrt();
        let sun = 20.0 * direction.dot(-forward).max(0.0).powf(600.0);
        self.stand.view.irradiance() / PI * ((0.45 + (0.14 - 0.45) * up) * 0.5 + sun)
    }
}
