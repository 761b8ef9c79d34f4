//! The picture of caustics on planar receivers against a bilinear look-up in f64. Rows of `effects.toml` judge the map itself.

use crate::prelude::*;
use fathom_reference::pool::{Basin, Face};
use fathom_stages::planar::compose::{self, PlanarView};
use fathom_stages::pool::Pool;

const SIZE: [u32; 2] = [160, 120];
const TEXELS: u32 = 37;
const FLOOR_DEPTH_M: f64 = 2.0;
/// Of the waves, up to which the walls reach.
const AMPLITUDE_M: f64 = 0.12;
const GAMMA_PER_M: f64 = 0.13;

pub fn cases() -> Vec<Case> {
    vec![
        Case::new(compose::INFO.name, "look-up in the map", looked_up),
        Case::new(compose::INFO.name, "map of the floor", shown_map),
    ]
}

/// A pool of a floor and four walls up to the highest wave.
fn pool(center_m: [f64; 2], half_size_m: [f64; 2]) -> Result<Scene> {
    let mut scene = rig::flat_plane(LightKind::Directional)?;
    scene.floor_depth_m = FLOOR_DEPTH_M;
    scene.light.direction = [0.28, -1.0, -0.2];
    scene.light.half_extent_m = 0.0;
    scene.water = Water {
        amplitude_m: AMPLITUDE_M,
        attenuation_per_m: GAMMA_PER_M,
        center_m,
        half_size_m,
        ..Water::default()
    };
    let basin = Basin::from_water(&scene.water, FLOOR_DEPTH_M);
    scene.objects = Face::ALL.map(|face| wall(&basin, face)).into();
    let middle = DVec3::new(center_m[0], 0.0, center_m[1]);
    let at = |offset: DVec3| (middle + offset).to_array();
    let (eye, aim) = (DVec3::new(0.5, 6.0, 9.0), DVec3::NEG_Y);
    scene.camera = Camera::new(at(eye), at(aim), 60.0, [0.5, 30.0]);
    let objects = scene.objects.iter().map(|object| object.mesh.bounds());
    scene.bounds = objects.fold(Bounds::EMPTY, Bounds::union);
    scene.bounds.max.y = 1.0;
    Ok(scene)
}

/// The inner side of a face.
fn wall(basin: &Basin, face: Face) -> Object {
    let rectangle = basin.rectangle(face);
    let [a, b] = [0.5 * rectangle.right, 0.5 * rectangle.down];
    let (a, b) = if a.cross(b).dot(face.normal()) > 0.0 { (a, b) } else { (b, a) };
    Object::new("face", Mesh::parallelogram(rectangle.point([0.5; 2]), a, b))
}

fn pool_from(basin: &Basin) -> Pool {
    Pool { floor_depth_m: basin.floor_depth_m as f32, top_m: basin.top_m as f32, texels: TEXELS }
}

/// An atlas of noise, and what it holds at a place of a face, bilinear and clamped at the border.
struct NoiseAtlas(Image);

impl NoiseAtlas {
    fn new() -> Self {
        // Some W/m², as sunlight brings.
        Self(noise([Face::ALL.len() as u32 * TEXELS, TEXELS], 5).map(|value| 2.0 + 8.0 * value))
    }

    fn value(&self, face: Face, place: [f64; 2]) -> f64 {
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
    let noise = NoiseAtlas::new();
    let mut found = AtlasPixels::default();
    for side in SIDES {
        found.see(rig, &noise, side)?;
    }
    let error = |moved: f64| percentile::<95>(found.lit.iter().map(|lit| lit.off(&noise, moved)));
    let lacking =
        |sides: &[f64]| largest(Face::ALL.map(|face| ENOUGH_PX - found.pixels(face, sides)));
    let added =
        "95th percentile of the relative error of the light that the map adds, pixel by pixel";
    // Steps of an 8-bit display.
    Ok(vec![
        Check::new(rig, added)
            .within((0.05, "1"), error(0.0))
            .control("looked up a fifth of a texel further", error(0.2)),
        Check::new(rig, "pixels that the face which is seen least lacks")
            .within((0.0, "px"), lacking(&SIDES))
            .control("seen from one side", lacking(&SIDES[..1])),
        Check::new(rig, "largest radiance that the map adds beside floor and walls")
            .within((1e-3, "1"), largest(found.unlit.iter().copied()))
            .control("on them", largest(found.lit.iter().map(|lit| lit.added))),
    ])
}

/// A pool with a slab in it, on which no photon is counted, seen from one side.
fn seen_from(side: f64) -> Result<Scene> {
    let mut scene = pool([0.6, -0.4], [3.0, 2.0])?;
    let middle = DVec3::new(0.6, 0.0, -0.4);
    let at =
        |x: f64, y: f64, z: f64| (middle + side * DVec3::new(x, 0.0, z) + DVec3::Y * y).to_array();
    scene.camera = Camera::new(at(4.0, 4.0, 4.5), at(-0.3, -1.2, -0.3), 55.0, [0.5, 30.0]);
    let slab = Mesh::parallelogram(middle + DVec3::NEG_Y, DVec3::Z * 0.4, DVec3::X * 0.4);
    scene.objects.push(Object::new("slab", slab));
    Ok(scene)
}

/// A pixel of a face.
struct LitPixel {
    face: Face,
    side: f64,
    place: [f64; 2],
    /// Radiance that the map adds.
    added: f64,
    /// What it should add for each W/m².
    per_irradiance: f64,
}

impl LitPixel {
    /// With the place moved by so many texels.
    fn off(&self, noise: &NoiseAtlas, texels: f64) -> f64 {
        let place = self.place.map(|share| share + texels / f64::from(TEXELS));
        (self.added / (self.per_irradiance * noise.value(self.face, place)) - 1.0).abs()
    }
}

/// Pixels of pictures with a map of noise against those without light. Those at edges are left out: there the rasterizer may draw either
/// surface.
#[derive(Default)]
struct AtlasPixels {
    lit: Vec<LitPixel>,
    /// Radiance that the map adds elsewhere.
    unlit: Vec<f64>,
}

impl AtlasPixels {
    fn pixels(&self, face: Face, sides: &[f64]) -> f64 {
        let seen = self.lit.iter().filter(|lit| lit.face == face && sides.contains(&lit.side));
        seen.count() as f64
    }

    fn see(&mut self, rig: &Rig<'_>, noise: &NoiseAtlas, side: f64) -> Result<()> {
        let fixture = rig.fixture(seen_from(side)?, SIZE)?;
        let gbuffer = rig.gbuffer(&fixture)?;
        let basin = Basin::from_water(&fixture.scene.water, fixture.scene.floor_depth_m);
        // Radiance of each pixel by a map.
        let radiance = |map: &Image| -> Result<Image> {
            const EXPOSURE: f64 = 0.8;
            let lit = (&rig.grey(map), &pool_from(&basin));
            let stage =
                compose::new(rig, &fixture.shared, &gbuffer, lit, EXPOSURE, PlanarView::Image)?;
            let shown = rig.draw(&[&stage], stage.texture(), BLUE)?;
            Ok(shown.map(|value| radiance_of(value, EXPOSURE)))
        };
        let (light, dark) = (radiance(&noise.0)?, radiance(&noise.0.map(|_| 0.0))?);
        let albedo = rig.channel(&gbuffer.albedo, BLUE)?;
        for at in pixels(SIZE) {
            let added = light.get(at) - dark.get(at);
            let hit = fixture.hit(at);
            if near_other(&fixture, at, hit.map(|hit| hit.object)) {
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
                let through = rig::through_water(&fixture.scene, hit.position);
                self.lit.push(LitPixel {
                    face,
                    side,
                    place: basin.rectangle(face).place(hit.position),
                    added,
                    per_irradiance: albedo.get(at) / PI * through,
                });
            }
        }
        Ok(())
    }
}

/// The blue of water's tint is 1.
const BLUE: usize = 2;

/// Whether a neighbour of the pixel shows something else.
fn near_other(fixture: &Fixture, (x, y): (u32, u32), object: Option<usize>) -> bool {
    let around = [(-1, 0), (1, 0), (0, -1), (0, 1)];
    let other = |(dx, dy): (i32, i32)| {
        let (x, y) = (x.checked_add_signed(dx), y.checked_add_signed(dy));
        let inside = |at: Option<u32>, side: u32| at.filter(|at| *at < side);
        let (Some(x), Some(y)) = (inside(x, SIZE[0]), inside(y, SIZE[1])) else { return false };
        fixture.hit((x, y)).map(|hit| hit.object) != object
    };
    around.into_iter().any(other)
}

/// The picture of the floor's map, pixel by pixel.
fn shown_map(rig: &Rig<'_>) -> Result<Check> {
    const EXPOSURE: f64 = 0.4;
    let fixture = rig.fixture(pool([0.0; 2], [4.0; 2])?, SIZE)?;
    let noise = NoiseAtlas::new();
    let pool = pool_from(&Basin::from_water(&fixture.scene.water, FLOOR_DEPTH_M));
    let (gbuffer, lit) = (rig.gbuffer(&fixture)?, (&rig.grey(&noise.0), &pool));
    let stage = compose::new(rig, &fixture.shared, &gbuffer, lit, EXPOSURE, PlanarView::FloorMap)?;
    let shown = rig.draw(&[&stage], stage.texture(), 0)?;
    let error = |face: i64| {
        largest(pixels(SIZE).map(|(x, y)| {
            let texel = [(x, SIZE[0]), (y, SIZE[1])].map(|(at, side)| {
                ((f64::from(at) + 0.5) / f64::from(side) * f64::from(TEXELS)) as i64
            });
            let irradiance = noise.0.clamped(texel[0] + face * i64::from(TEXELS), texel[1]);
            (shown.get((x, y)) - tone_mapped(irradiance / PI, EXPOSURE)).abs()
        }))
    };
    Ok(Check::new(rig, "largest difference of the picture of the floor's map")
        .within((1.0 / 255.0, "1"), error(0))
        .control("the map of a wall", error(1)))
}
