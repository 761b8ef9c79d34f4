//! Stages of caustics on planar receivers: the illumination map against photons counted in f64 and against closed forms of the light's flux,
//! and the picture against a bilinear look-up in f64.

use std::f64::consts::PI;

use glam::{DVec3, UVec2};

use super::{Case, Check, Checks, Result, Rig, largest, noise, rig};
use fathom_reference::image::{Image, pixels};
use fathom_reference::optics::refract;
use fathom_reference::pool::{Basin, Counted, Face, face_by_face, middle_photon_w, share_left};
use fathom_reference::quantities::quantile;
use fathom_reference::rays::{PixelRays, Tracer};
use fathom_reference::surface::enter;
use fathom_scene::{Camera, LightFrame, LightKind, Mesh, Object, Scene, Water};
use fathom_stages::frame::View;
use fathom_stages::gbuffer::GbufferTextures;
use fathom_stages::planar::compose::{self, Shown};
use fathom_stages::planar::points;
use fathom_stages::pool::Pool;
use fathom_stages::screen_ray::{NEVER, Transfer, Transfers};
use fathom_stages::shadow::{depth, mask};
use fathom_stages::transfer::map::{self, MapUniforms};

const SIZE: [u32; 2] = [160, 120];
/// No multiples of a workgroup or of each other.
const GRID: [u32; 2] = [211, 187];
/// So fine that little depends on the photons at the border of the water, of which whole rows lie inside or outside.
const FINE_GRID: [u32; 2] = [1009, 887];
const TEXELS: u32 = 37;
const FLOOR_DEPTH_M: f64 = 2.0;
/// Rounding of a photon's place on a face in 32-bit floats: some ten times the step of numbers near 10 m.
const ROUNDING_M: f64 = 1e-5;
/// Waves are steep, so that many photons meet walls.
const AMPLITUDE_M: f64 = 0.12;
const GAMMA_PER_M: f64 = 0.13;

pub fn cases() -> Vec<Case> {
    let mut cases = Vec::new();
    for setting in SETTINGS {
        let what = setting.name();
        cases.push(Case::new(points::INFO.name, format!("{what}: texel by texel"), move |rig| {
            counted(rig, setting)
        }));
        cases.push(Case::new(points::INFO.name, format!("{what}: exact photons"), move |rig| {
            exact(rig, setting)
        }));
    }
    for kind in [LightKind::Directional, LightKind::Point] {
        let what = format!("flux of a light, {kind:?}");
        cases.push(Case::new(points::INFO.name, what, move |rig| flux(rig, kind)));
    }
    cases.push(Case::new(compose::INFO.name, "look-up in the map", looked_up));
    cases.push(Case::new(compose::INFO.name, "map of the floor", shown_map));
    cases
}

/// What a pool is lit by, and where it is.
#[derive(Clone, Copy)]
enum Setting {
    Sun,
    /// A sun that stands low, from the other side, through a surface that reflects.
    Turned,
    /// A pool that is no square, away from the origin.
    OffCenter,
    Lamp,
}

const SETTINGS: [Setting; 4] = [Setting::Sun, Setting::Turned, Setting::OffCenter, Setting::Lamp];

impl Setting {
    fn name(self) -> &'static str {
        match self {
            Setting::Sun => "sun",
            Setting::Turned => "low sun, Fresnel",
            Setting::OffCenter => "pool off the centre",
            Setting::Lamp => "lamp",
        }
    }

    fn scene(self) -> Result<Scene> {
        let (center, half) = match self {
            Setting::OffCenter => ([3.7, -5.3], [2.5, 4.0]),
            _ => ([0.0; 2], [4.0; 2]),
        };
        let mut scene = pool(center, half, AMPLITUDE_M)?;
        match self {
            Setting::Sun | Setting::OffCenter => {}
            Setting::Turned => {
                scene.light.direction = [-0.9, -1.0, 0.7];
                scene.water.fresnel = true;
            }
            Setting::Lamp => {
                scene.light.kind = LightKind::Point;
                scene.light.position_m = [1.5, 3.0, -1.0];
            }
        }
        Ok(scene)
    }
}

/// A pool of a floor and four walls up to the highest wave.
fn pool(center_m: [f64; 2], half_size_m: [f64; 2], amplitude_m: f64) -> Result<Scene> {
    let mut scene = rig::flat_plane(LightKind::Directional)?;
    scene.floor_depth_m = FLOOR_DEPTH_M;
    scene.light.direction = [0.28, -1.0, -0.2];
    scene.light.half_extent_m = 0.0;
    scene.water = Water {
        amplitude_m,
        noise_tile_m: 4.0,
        attenuation_per_m: GAMMA_PER_M,
        center_m,
        half_size_m,
        ..Water::default()
    };
    let basin = Basin::of(&scene.water, FLOOR_DEPTH_M);
    scene.objects = Face::ALL.map(|face| wall(&basin, face)).into();
    let middle = DVec3::new(center_m[0], 0.0, center_m[1]);
    let at = |offset: DVec3| (middle + offset).to_array();
    let (eye, aim) = (DVec3::new(0.5, 6.0, 9.0), DVec3::NEG_Y);
    scene.camera = Camera::new(at(eye), at(aim), 60.0, [0.5, 30.0]);
    let objects = scene.objects.iter().map(|object| object.mesh.bounds());
    scene.bounds = objects.fold(fathom_scene::Bounds::EMPTY, fathom_scene::Bounds::union);
    scene.bounds.max.y = 1.0;
    Ok(scene)
}

/// The inner side of a face.
fn wall(basin: &Basin, face: Face) -> Object {
    let rectangle = basin.rectangle(face);
    let [a, b] = [0.5 * rectangle.right, 0.5 * rectangle.down];
    let (a, b) = if a.cross(b).dot(face.normal()) > 0.0 { (a, b) } else { (b, a) };
    Object::new("face", Mesh::parallelogram(rectangle.at([0.5; 2]), a, b))
}

/// An illumination map, and the photons that it was drawn from.
struct Drawn {
    view: View,
    basin: Basin,
    frame: LightFrame,
    photon_w: f64,
    stored: Vec<Transfer>,
    /// Face by face, W/m².
    map: Vec<f64>,
}

impl Drawn {
    fn new(rig: &Rig<'_>, scene: &Scene, grid: [u32; 2]) -> Result<Drawn> {
        let stand = rig.stand(scene, SIZE);
        let rig::Stand { shared, geometry, .. } = &stand;
        let depth = depth::new(&rig.resources, shared, geometry, 512)?;
        let mask = mask::new(&rig.resources, shared, depth.texture(), 64)?;
        let settings = MapUniforms { grid: UVec2::from(grid) };
        let transfers = map::new(&rig.resources, shared, mask.texture(), &settings)?;
        rig.run(&[&depth, &mask, &transfers])?;
        Self::of(rig, &stand, scene, &transfers.transfers)
    }

    fn of(
        rig: &Rig<'_>,
        stand: &rig::Stand,
        scene: &Scene,
        transfers: &Transfers,
    ) -> Result<Drawn> {
        let view = &stand.view;
        let basin = Basin::of(&scene.water, scene.floor_depth_m);
        let photon_w = view.weighted_flux_w() / f64::from(transfers.count);
        let pool = of_basin(&basin);
        let points = points::new(&rig.resources, &stand.shared, transfers, &pool, photon_w)?;
        // Twice, as the second frame finds what the first has left.
        rig.run(&[&points])?;
        rig.run(&[&points])?;
        let atlas = rig.channel(points.texture(), 0)?;
        let frame = view.light_frame();
        Ok(Drawn {
            basin,
            photon_w: middle_photon_w(&view.light, &frame, transfers.count),
            frame,
            stored: rig.read(&transfers.buffer)?,
            map: face_by_face(atlas.data(), TEXELS),
            view: view.clone(),
        })
    }

    /// What the photons of the transfer map bring to a pool, their attenuation so many times.
    fn counted(&self, basin: &Basin, attenuation: f64) -> Counted {
        let mut counted = Counted::new(TEXELS);
        let mut water = self.view.water.clone();
        water.attenuation_per_m *= attenuation;
        for photon in self.stored.iter().filter(|photon| photon.state != NEVER) {
            let (origin, direction) = (photon.position_m.as_dvec3(), photon.direction.as_dvec3());
            let flux_w = |way_m| self.photon_w * share_left(&self.frame, &water, origin, way_m);
            let ray = (origin, direction.normalize());
            counted.add((basin, TEXELS), ray, ROUNDING_M, flux_w);
        }
        counted
    }

    /// Flux on the whole map.
    fn flux_w(&self) -> f64 {
        let texels = self.map.iter().enumerate();
        texels.map(|(texel, irradiance)| irradiance * self.area_m2(texel)).sum()
    }

    fn area_m2(&self, texel: usize) -> f64 {
        self.basin.texel_area_m2(face_of(texel), TEXELS)
    }
}

fn face_of(texel: usize) -> Face {
    Face::ALL[texel / (TEXELS * TEXELS) as usize]
}

fn of_basin(basin: &Basin) -> Pool {
    Pool { floor_depth_m: basin.floor_depth_m, top_m: basin.top_m, texels: TEXELS }
}

/// Each texel against the photons that lie in it by an f64 count of the same transfers, and the sum of all.
fn counted(rig: &Rig<'_>, setting: Setting) -> Checks {
    let drawn = Drawn::new(rig, &setting.scene()?, GRID)?;
    let counted = drawn.counted(&drawn.basin, 1.0);
    // In photons of mean flux.
    let photon_w = counted.flux_w / drawn.stored.iter().filter(|p| p.state != NEVER).count() as f64;
    let off = |counted: &Counted, of: &dyn Fn(Face) -> bool| {
        let texels = drawn.map.iter().enumerate().filter(|(texel, _)| of(face_of(*texel)));
        largest(texels.map(|(texel, irradiance)| {
            counted.off(texel, *irradiance) * drawn.area_m2(texel) / photon_w
        }))
    };
    let is_floor = |face: Face| face == Face::Floor;
    let is_wall = |face: Face| face != Face::Floor;
    let deeper = Basin { floor_depth_m: drawn.basin.floor_depth_m + 0.01, ..drawn.basin };
    let wider =
        Basin { half_size_m: drawn.basin.half_size_m.map(|half| half + 0.01), ..drawn.basin };
    let on_walls = counted.sure[(TEXELS * TEXELS) as usize..].iter().filter(|e| **e > 0.0).count();
    let energy = |flux_w: f64| (drawn.flux_w() / flux_w - 1.0).abs();
    let murkier = drawn.counted(&drawn.basin, 1.05);
    let name = setting.name();
    // Sums of some hundred 32-bit floats.
    Ok(vec![
        Check::of(
            points::INFO.name,
            format!("{name}: largest difference of a texel of the floor from its f64 count"),
        )
        .within((0.01, "ph"), off(&counted, &is_floor))
        .control("a floor 1 cm deeper", off(&drawn.counted(&deeper, 1.0), &is_floor))
        .with("unsure_share", counted.unsure_w / counted.flux_w),
        Check::of(
            points::INFO.name,
            format!("{name}: largest difference of a texel of the walls from its f64 count"),
        )
        .within((0.01, "ph"), off(&counted, &is_wall))
        .control("walls 1 cm further", off(&drawn.counted(&wider, 1.0), &is_wall))
        .with("lit_wall_texels", on_walls as f64),
        Check::of(
            points::INFO.name,
            format!("{name}: sum of irradiance × area over the photons' flux: relative error"),
        )
        .within((1e-4, "1"), energy(counted.flux_w))
        .control("attenuation 5 % higher", energy(murkier.flux_w)),
    ])
}

/// The map against exact entries, exact refraction and exact planes: the share of the flux in other texels.
fn exact(rig: &Rig<'_>, setting: Setting) -> Result<Check> {
    let drawn = Drawn::new(rig, &setting.scene()?, GRID)?;
    let misplaced = |index: f64| {
        let counted = exactly(&drawn, index);
        let texels = drawn.map.iter().enumerate();
        let off_w = texels
            .map(|(texel, irradiance)| counted.off(texel, *irradiance) * drawn.area_m2(texel));
        0.5 * off_w.sum::<f64>() / counted.flux_w
    };
    let index = drawn.view.water.refractive_index;
    let name = setting.name();
    // The noise texture is interpolated between texels: photons move by a millimetre, and a texel has 6 cm and more.
    Ok(Check::of(
        points::INFO.name,
        format!("{name}: share of the flux in other texels than exact photons"),
    )
    .within((0.03, "1"), misplaced(index))
    .control("refractive index 3 % higher", misplaced(1.03 * index)))
}

/// Exact photons of those that are alive.
fn exactly(drawn: &Drawn, index: f64) -> Counted {
    let ndc = |k: u32, n: u32| 2.0 * (f64::from(k) + 0.5) / f64::from(n) - 1.0;
    let water = &drawn.view.water;
    let mut counted = Counted::new(TEXELS);
    for (number, _) in (0..).zip(&drawn.stored).filter(|(_, photon)| photon.state != NEVER) {
        let place = [ndc(number % GRID[0], GRID[0]), ndc(number / GRID[0], GRID[1])];
        let (origin, incident) = drawn.frame.ray(place[0], place[1]);
        let Some(entry) = enter(water, origin, incident, f64::MAX) else { continue };
        let Some(refracted) = refract(incident, entry.normal, 1.0, index) else { continue };
        let flux_w =
            |way_m| drawn.photon_w * share_left(&drawn.frame, water, entry.position, way_m);
        counted.add((&drawn.basin, TEXELS), (entry.position, refracted), 0.0, flux_w);
    }
    counted
}

/// All that the light sends through flat water arrives, where nothing is lost on the way: irradiance × area across the rays, or intensity ×
/// solid angle.
fn flux(rig: &Rig<'_>, kind: LightKind) -> Result<Check> {
    let mut scene = pool([0.4, -0.3], [3.0, 2.0], 0.0)?;
    scene.water.attenuation_per_m = 0.0;
    scene.light.kind = kind;
    scene.light.direction = [0.5, -1.0, 0.3];
    scene.light.position_m = [1.0, 4.0, -0.5];
    // What sees nothing gets all of the light.
    scene.camera = Camera::new([0.4, -50.0, 0.0], [0.4, -60.0, 1.0], 60.0, [0.5, 30.0]);
    let drawn = Drawn::new(rig, &scene, FINE_GRID)?;
    let basin = drawn.basin;
    let exact_w = |height_m: f64| match kind {
        LightKind::Directional => {
            let area_m2 = basin.rectangle(Face::Floor).area_m2();
            scene.light.intensity_w_sr * area_m2 * -drawn.frame.forward.y * height_m
        }
        LightKind::Point => {
            let lamp = DVec3::from(scene.light.position_m) * DVec3::new(1.0, height_m, 1.0);
            scene.light.intensity_w_sr * solid_angle(&basin, lamp)
        }
    };
    let off = |height_m: f64| (drawn.flux_w() / exact_w(height_m) - 1.0).abs();
    // Rows of photons at the border of the water, of some five hundred.
    Ok(Check::of(
        points::INFO.name,
        format!(
            "{kind:?} light: sum over the map against the flux through the water: relative error"
        ),
    )
    .within((5e-3, "1"), off(1.0))
    .control("a sun 10 % brighter, a lamp 10 % higher", off(1.1)))
}

/// Solid angle of the water at rest from above, steradians: the sum over the corners of a rectangle.
fn solid_angle(basin: &Basin, from: DVec3) -> f64 {
    let corner = |x: f64, z: f64| (x * z).atan2(from.y * (x * x + z * z + from.y * from.y).sqrt());
    let [x, z] = [(0, from.x), (1, from.z)].map(|(axis, at)| {
        let (center, half) = (basin.center_m[axis], basin.half_size_m[axis]);
        [center - half - at, center + half - at]
    });
    corner(x[1], z[1]) - corner(x[0], z[1]) - corner(x[1], z[0]) + corner(x[0], z[0])
}

/// An atlas of noise, and what it holds at a place of a face, bilinear and clamped at the border.
struct Noise(Image);

impl Noise {
    fn new() -> Self {
        // Some W/m², as sunlight brings.
        Self(noise([Face::ALL.len() as u32 * TEXELS, TEXELS], 5).map(|value| 2.0 + 8.0 * value))
    }

    fn at(&self, face: Face, place: [f64; 2]) -> f64 {
        let texel = |column: f64, row: f64| {
            let last = f64::from(TEXELS - 1);
            let [column, row] = [column, row].map(|k| k.clamp(0.0, last) as i64);
            self.0.clamped(column + face.number() as i64 * i64::from(TEXELS), row)
        };
        let at = place.map(|share| share * f64::from(TEXELS) - 0.5);
        let [column, row] = at.map(f64::floor);
        let [right, down] = [at[0] - column, at[1] - row];
        let across =
            |row: f64| (1.0 - right) * texel(column, row) + right * texel(column + 1.0, row);
        (1.0 - down) * across(row) + down * across(row + 1.0)
    }
}

/// Sides of the pool from which it is seen, so that each face is in view.
const SIDES: [f64; 2] = [-1.0, 1.0];
/// Pixels of a face that are enough to judge it.
const ENOUGH_PX: f64 = 200.0;

/// Radiance that a known map adds to each pixel, against a bilinear look-up in f64, Lambert's law and Beer's; and that nothing else is lit.
fn looked_up(rig: &Rig<'_>) -> Checks {
    let noise = Noise::new();
    let mut found = Found::default();
    for side in SIDES {
        found.see(rig, &noise, side)?;
    }
    let error = |moved: f64| {
        let off = found.lit.iter().map(|lit| lit.off(&noise, moved));
        quantile(&mut off.collect::<Vec<_>>(), 0.95)
    };
    let lacking =
        |sides: &[f64]| largest(Face::ALL.map(|face| ENOUGH_PX - found.pixels(face, sides)));
    let lit = found.lit.iter().map(|lit| lit.added);
    // Steps of an 8-bit display.
    Ok(vec![
        Check::of(
            compose::INFO.name,
            "95th percentile of the relative error of the light that the map adds, pixel by pixel",
        )
        .within((0.05, "1"), error(0.0))
        .control("looked up a fifth of a texel further", error(0.2)),
        Check::of(compose::INFO.name, "pixels that the face which is seen least lacks")
            .within((0.0, "px"), lacking(&SIDES))
            .control("seen from one side", lacking(&SIDES[..1])),
        Check::of(compose::INFO.name, "largest radiance that the map adds beside floor and walls")
            .within((1e-3, "1"), largest(found.unlit.iter().copied()))
            .control("on them", largest(lit)),
    ])
}

/// A pool with a slab in it, on which no photon is counted, seen from one side.
fn seen_from(side: f64) -> Result<Scene> {
    let mut scene = pool([0.6, -0.4], [3.0, 2.0], AMPLITUDE_M)?;
    let middle = DVec3::new(0.6, 0.0, -0.4);
    let at =
        |x: f64, y: f64, z: f64| (middle + side * DVec3::new(x, 0.0, z) + DVec3::Y * y).to_array();
    scene.camera = Camera::new(at(4.0, 4.0, 4.5), at(-0.3, -1.2, -0.3), 55.0, [0.5, 30.0]);
    let slab = Mesh::parallelogram(middle + DVec3::NEG_Y, DVec3::Z * 0.4, DVec3::X * 0.4);
    scene.objects.push(Object::new("slab", slab));
    Ok(scene)
}

/// A pixel of a face.
struct Lit {
    face: Face,
    side: f64,
    place: [f64; 2],
    /// Radiance that the map adds.
    added: f64,
    /// What it should add for each W/m².
    per_irradiance: f64,
}

impl Lit {
    /// With the place moved by so many texels.
    fn off(&self, noise: &Noise, texels: f64) -> f64 {
        let place = self.place.map(|share| share + texels / f64::from(TEXELS));
        (self.added / (self.per_irradiance * noise.at(self.face, place)) - 1.0).abs()
    }
}

/// Pixels of pictures with a map of noise against those without light. Those at edges are left out: there the rasterizer may draw either
/// surface.
#[derive(Default)]
struct Found {
    lit: Vec<Lit>,
    /// Radiance that the map adds elsewhere.
    unlit: Vec<f64>,
}

impl Found {
    fn pixels(&self, face: Face, sides: &[f64]) -> f64 {
        let seen = self.lit.iter().filter(|lit| lit.face == face && sides.contains(&lit.side));
        seen.count() as f64
    }

    fn see(&mut self, rig: &Rig<'_>, noise: &Noise, side: f64) -> Result<()> {
        let scene = seen_from(side)?;
        let stand = rig.stand(&scene, SIZE);
        let gbuffer = rig.gbuffer(&stand)?;
        let basin = Basin::of(&scene.water, scene.floor_depth_m);
        let light = radiance(rig, &stand, &gbuffer, &basin, &noise.0)?;
        let dark = radiance(rig, &stand, &gbuffer, &basin, &noise.0.map(|_| 0.0))?;
        let albedo = rig.channel(&gbuffer.albedo, BLUE)?;
        let tracer = Tracer::new(&scene.objects)?;
        let rays = PixelRays::new(&scene.camera, SIZE[0], SIZE[1]);
        for (x, y) in pixels(SIZE) {
            let at = |image: &Image| image.clamped(x.into(), y.into());
            let added = at(&light) - at(&dark);
            let hit = rays.cast(&tracer, x, y).map(|(hit, _)| hit);
            if near_other(&rays, &tracer, [x, y], hit.map(|hit| hit.object)) {
                continue;
            }
            // Objects are the faces in their order, and then the slab.
            let Some((hit, face)) = hit.and_then(|hit| Some((hit, *Face::ALL.get(hit.object)?)))
            else {
                self.unlit.push(added);
                continue;
            };
            // Walls have no outer sides here: what is seen from behind says nothing.
            if face.normal().dot(hit.normal) > 0.0 {
                self.lit.push(Lit {
                    face,
                    side,
                    place: basin.rectangle(face).place(hit.position),
                    added,
                    per_irradiance: at(&albedo) / PI * through(&scene, hit.position),
                });
            }
        }
        Ok(())
    }
}

/// The blue of water's tint is 1.
const BLUE: usize = 2;

/// Radiance of each pixel by a map.
fn radiance(
    rig: &Rig<'_>,
    stand: &rig::Stand,
    gbuffer: &GbufferTextures,
    basin: &Basin,
    map: &Image,
) -> Result<Image> {
    const EXPOSURE: f64 = 0.8;
    let (map, pool) = (rig.grey(map), of_basin(basin));
    let lit = (&map, &pool);
    let stage = compose::new(&rig.resources, &stand.shared, gbuffer, lit, EXPOSURE, Shown::Scene)?;
    rig.run(&[&stage])?;
    let shown = rig.channel(stage.texture(), BLUE)?;
    Ok(shown.map(|value| -(1.0 - value.powf(2.2)).ln() / EXPOSURE))
}

/// Whether a neighbour of the pixel shows something else.
fn near_other(rays: &PixelRays, tracer: &Tracer, [x, y]: [u32; 2], object: Option<usize>) -> bool {
    let around = [(-1, 0), (1, 0), (0, -1), (0, 1)];
    let other = |(dx, dy): (i32, i32)| {
        let (x, y) = (x.checked_add_signed(dx), y.checked_add_signed(dy));
        let inside = |at: Option<u32>, side: u32| at.filter(|at| *at < side);
        let (Some(x), Some(y)) = (inside(x, SIZE[0]), inside(y, SIZE[1])) else { return false };
        rays.cast(tracer, x, y).map(|(hit, _)| hit.object) != object
    };
    around.into_iter().any(other)
}

/// Share of the light that the water lets through from a place to a camera above it.
fn through(scene: &Scene, place: DVec3) -> f64 {
    let camera = DVec3::from(scene.camera.position_m);
    let path_m = camera.distance(place) * (-place.y).max(0.0) / (camera.y - place.y);
    (-scene.water.attenuation_per_m * path_m).exp()
}

/// The picture of the floor's map, pixel by pixel.
fn shown_map(rig: &Rig<'_>) -> Result<Check> {
    const EXPOSURE: f64 = 0.4;
    let scene = pool([0.0; 2], [4.0; 2], AMPLITUDE_M)?;
    let stand = rig.stand(&scene, SIZE);
    let gbuffer = rig.gbuffer(&stand)?;
    let noise = Noise::new();
    let (map, pool) = (rig.grey(&noise.0), of_basin(&Basin::of(&scene.water, FLOOR_DEPTH_M)));
    let lit = (&map, &pool);
    let stage =
        compose::new(&rig.resources, &stand.shared, &gbuffer, lit, EXPOSURE, Shown::FloorMap)?;
    rig.run(&[&stage])?;
    let shown = rig.channel(stage.texture(), 0)?;
    let error = |face: i64| {
        largest(pixels(SIZE).map(|(x, y)| {
            let texel = [(x, SIZE[0]), (y, SIZE[1])].map(|(at, side)| {
                ((f64::from(at) + 0.5) / f64::from(side) * f64::from(TEXELS)) as i64
            });
            let irradiance = noise.0.clamped(texel[0] + face * i64::from(TEXELS), texel[1]);
            let exact = (1.0 - (-EXPOSURE * irradiance / PI).exp()).powf(1.0 / 2.2);
            (shown.clamped(x.into(), y.into()) - exact).abs()
        }))
    };
    Ok(Check::of(compose::INFO.name, "largest difference of the picture of the floor's map")
        .within((1.0 / 255.0, "1"), error(0))
        .control("the map of a wall", error(1)))
}
