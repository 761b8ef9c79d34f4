//! The picture of caustics on planar receivers, each pixel against an f64 evaluation. Rows of `effects.toml` judge the map itself.

use crate::prelude::*;
use fathom_reference::picture::WATER_TINT;
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
        Case::new(compose::INFO.name, "pixel by pixel", looked_up),
        Case::new(compose::INFO.name, "map of the floor", shown_map),
    ]
}

/// A pool of a floor and four walls up to the highest wave, with a slab in it, on which no photon is counted; seen from one side.
fn pool(side: f64) -> Result<Scene> {
    let mut scene = rig::flat_plane(LightKind::Directional)?;
    scene.floor_depth_m = FLOOR_DEPTH_M;
    scene.light.direction = [0.28, -1.0, -0.2];
    scene.water = Water {
        amplitude_m: AMPLITUDE_M,
        attenuation_per_m: GAMMA_PER_M,
        center_m: [0.6, -0.4],
        half_size_m: [3.0, 2.0],
        ..Water::default()
    };
    let basin = Basin::from_water(&scene.water, FLOOR_DEPTH_M);
    let middle = DVec3::new(0.6, 0.0, -0.4);
    let slab = Mesh::parallelogram(middle + DVec3::NEG_Y, DVec3::Z * 0.4, DVec3::X * 0.4);
    scene.objects = Face::ALL.map(|face| wall(&basin, face)).into();
    scene.objects.push(Object::new("slab", slab));
    let at =
        |x: f64, y: f64, z: f64| (middle + side * DVec3::new(x, 0.0, z) + DVec3::Y * y).to_array();
    scene.camera = Camera::new(at(4.0, 4.0, 4.5), at(-0.3, -1.2, -0.3), 55.0, [0.5, 30.0]);
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
        let last = i64::from(TEXELS) - 1;
        let left = face.number() as i64 * i64::from(TEXELS);
        let value = |[x, y]: [i64; 2]| self.0.clamped(left + x.clamp(0, last), y);
        corners(place.into(), [TEXELS; 2]).map(|(weight, at)| weight * value(at)).iter().sum()
    }
}

/// The picture of surfaces of noise in a pool, from two sides, so that each face is in view: a bilinear look-up in the map, and the light without it.
fn looked_up(rig: &Rig<'_>) -> Result<Check> {
    let mut pixels = pool_errors(rig, -1.0)?;
    pixels.extend(pool_errors(rig, 1.0)?);
    // Not a number for a face that is not seen.
    let error = |number: usize| {
        let of = |face| pixels.iter().filter(move |pixel| pixel.0 == face);
        let faces = Face::ALL.map(Some).into_iter().chain([None]);
        largest(faces.map(|face| largest(of(face).map(|pixel| pixel.1[number]))))
    };
    Ok(Check::new(rig, "largest error of the picture on each face and beside them")
        .within((DISPLAY_STEP, "1"), error(0))
        .control("looked up a fiftieth of a texel further", error(1)))
}

/// For each pixel from one side the face that it shows, how far its colour is off, and how far from that of a place a fiftieth of a texel further.
fn pool_errors(rig: &Rig<'_>, side: f64) -> Result<Vec<(Option<Face>, [f64; 2])>> {
    const EXPOSURE: f64 = 0.3;
    let atlas = NoiseAtlas::new();
    let fixture = rig.fixture(pool(side)?, SIZE)?;
    let normal = |at| fixture.hit(at).map_or(DVec3::ZERO, |hit| hit.shading_normal);
    let known = NoisySurfaces::new(rig, &fixture, normal)?;
    let basin = Basin::from_water(&fixture.scene.water, fixture.scene.floor_depth_m);
    let (shared, pool) = (&fixture.shared, pool_from(&basin));
    let (map, gbuffer, shown) = (&rig.grey(&atlas.0), &known.gbuffer, PlanarView::Image);
    let stage = compose::new(rig, shared, gbuffer, map, &pool, EXPOSURE, shown)?;
    let shown = Texels::draw(rig, &stage)?;
    // What is seen within 1.5 cm of a face is of it, by its normal; the floor first.
    let near_m = 0.005 * fixture.scene.water.half_size_m[0];
    let face_of = |seen: &SeenSurface| {
        Face::ALL.into_iter().find(|face| {
            let above_m = (seen.position - basin.rectangle(*face).corner).dot(face.normal());
            seen.normal.dot(face.normal()) > 0.5 && above_m.abs() < near_m
        })
    };
    let pixel = |at| {
        let seen = known.seen(at);
        let face = seen.as_ref().and_then(face_of);
        let off = |texels: f64| {
            let radiance = seen.map_or(known.light.background(known.sight(at)), |seen| {
                let photons = face.map_or(0.0, |face| {
                    let place = basin.rectangle(face).place(seen.position);
                    atlas.value(face, place.map(|share| share + texels / f64::from(TEXELS)))
                });
                let light = known.irradiance(&seen) + photons * WATER_TINT;
                known.through_water(&seen, seen.lit(light))
            });
            excess(shown.get(at), &[displayed(radiance, EXPOSURE)]).max_element()
        };
        (face, [off(0.0), off(0.02)])
    };
    Ok(pixels(SIZE).map(pixel).collect())
}

/// The picture of the floor's map, pixel by pixel.
fn shown_map(rig: &Rig<'_>) -> Result<Check> {
    const EXPOSURE: f64 = 0.4;
    let fixture = rig.fixture(pool(1.0)?, SIZE)?;
    let noise = NoiseAtlas::new();
    let pool = pool_from(&Basin::from_water(&fixture.scene.water, FLOOR_DEPTH_M));
    let (gbuffer, map, shown) = (rig.gbuffer(&fixture)?, rig.grey(&noise.0), PlanarView::FloorMap);
    let stage = compose::new(rig, &fixture.shared, &gbuffer, &map, &pool, EXPOSURE, shown)?;
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
