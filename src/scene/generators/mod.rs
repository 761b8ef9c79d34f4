//! Procedural meshes and volumes, named in scene files as `generator = "NAME"`.
//!
//! Each generator of an `[[object]]` makes one mesh in metres, the floor at y = 0, the water at rest
//! at y = `floor_depth_m`; those of a `[volume]` are in [`fields`]. Everything random comes from the
//! `seed`.

mod atrium;
mod basic;
mod bricks;
mod diving;
mod dolphin;
pub mod fields;
mod freight;
mod level;
mod port;
mod robot;
mod room;
mod storage;
mod tank;
mod teapot;
mod thicket;
mod tree;

use std::sync::LazyLock;

use fathom_base::parameter::{self, ParamError, ParamField, Setting};
use fathom_base::settings;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg32;
use serde::{Serialize, de::DeserializeOwned};
use serde_json::Value;

use super::{Mesh, check};
pub use basic::{Sphere, sphere};
pub use tank::{Basin, basin};
use {atrium::*, basic::*, bricks::*, diving::*, dolphin::*, freight::*, level::*, port::*};
use {robot::*, room::*, storage::*, tank::*, teapot::*, thicket::*, tree::*};

pub static GENERATORS: LazyLock<Vec<Generator>> = LazyLock::new(|| {
    vec![
        generator("plane", "a level rectangle that faces up", plane),
        generator("corner", "three squares that meet in the origin and face +x, +y and +z", corner),
        generator("box", "a box standing on the floor", block),
        generator("cylinder", "a round bar standing on the floor", cylinder),
        generator("sphere", "a ball that touches the floor", sphere),
        generator("torus", "a ring lying on the floor", torus),
        generator("blob", "a ball with bumps, a stand-in for scanned objects", blob),
        generator("knot", "a knotted tube, a stand-in for scanned objects", knot),
        over_floor("basin", "a rectangular basin open above that faces inward, with a rim", basin),
        generator("column", "a fluted column with base and capital", column),
        generator("steps", "a flight of steps that rises towards -z", steps),
        generator("statue", "a draped figure with raised arm on a pedestal", statue),
        generator("sea_bed", "uneven ground that rises towards -z", sea_bed),
        over_floor("quay", "stone blocks along x under coping stones, a wall that faces +z", quay),
        over_floor("pier", "a plank deck on two rows of piles, along z", pier),
        generator("stones", "stones strewn over a rectangle", stones),
        generator("hull", "an open rowing boat along z, bow towards -z, waterline at y = 0", hull),
        fixed("bollard", "a mooring bollard", bollard),
        generator("rope", "a rope that hangs from the origin to a point", rope),
        over_floor("hall", "a hall with floor, walls, and a roof of slabs with gaps", hall),
        over_floor("trusses", "roof trusses across x", trusses),
        generator("crates", "stacks of wooden crates in rows over a rectangle", crates),
        generator("barrels", "barrels strewn over a rectangle, some fallen", barrels),
        generator("shelves", "a rack along x with boxes on its shelves, open towards +z", shelves),
        generator("pipe", "a pipe along x with flanges, bent down to the floor at both ends", pipe),
        fixed("arcade", "an open courtyard between two storeys of arcades", arcade),
        generator("brick", "a toy brick with studs, or a plate with a low height", brick),
        generator("brick_wall", "toy bricks along x, two studs thick, with an opening", brick_wall),
        generator("brick_roof", "a stepped gable of toy bricks, its ridge along x", brick_roof),
        generator("loose_bricks", "toy bricks on a rectangle, some upon others", loose_bricks),
        generator("crate", "planks with gaps, battens along the edges, braces", plank_crate),
        fixed("level", "rooms of a low-resolution game level, open to the sky", level),
        fixed("robot", "a walking robot, facing +z, its lowest foot on the floor", robot),
        generator("interior", "a closed room with a window in the wall at −x", interior),
        fixed("table", "a table with four legs", || table([1.3, 0.75, 0.8].into())),
        fixed("chair", "a chair with a slatted back at −z", chair),
        fixed("bookcase", "a case of shelves with books, open towards +z", bookcase),
        generator("sofa", "a sofa with cushions, its back at −z", sofa),
        fixed("lamp", "a standing lamp with a conical shade", lamp),
        generator("thicket", "bars between random places of a box on the floor", thicket),
        generator("teapot", "the Utah teapot of Bézier patches, spout towards +x", teapot),
        fixed("tree", "a tree of tapered branches, grown by an L-system; SPT Fig. 11, 12", tree),
        generator("dolphin", "about the origin, swimming towards +x; SPT Fig. 1, 8", dolphin),
        generator("diving_platform", "board along +x, pool's edge at x = 0; SPT Fig. 13", platform),
    ]
});

pub struct Generator {
    /// As scene files call it.
    pub name: &'static str,
    pub about: &'static str,
    pub params: Vec<ParamField>,
    pub defaults: Value,
    build: BuildFn,
}

type BuildFn = Box<dyn Fn(&Value, f64) -> Result<Mesh, ParamError> + Send + Sync>;

/// A generator that needs the depth of the floor below the water, metres.
fn over_floor<P: Setting + Default + Serialize + DeserializeOwned>(
    name: &'static str,
    about: &'static str,
    build: impl Fn(&P, f64) -> Mesh + Send + Sync + 'static,
) -> Generator {
    let (params, defaults) = (parameter::fields::<P>(), parameter::tree(&P::default()));
    let build = move |params: &Value, depth_m| Ok(build(&parameter::read(params)?, depth_m));
    Generator { name, about, params, defaults, build: Box::new(build) }
}

fn generator<P: Setting + Default + Serialize + DeserializeOwned + 'static>(
    name: &'static str,
    about: &'static str,
    build: fn(&P) -> Mesh,
) -> Generator {
    over_floor(name, about, move |params, _| build(params))
}

settings! { struct NoParams {} }

/// A generator without parameters.
fn fixed(name: &'static str, about: &'static str, build: fn() -> Mesh) -> Generator {
    over_floor(name, about, move |_: &NoParams, _| build())
}

/// The generator called `name`; the error names the nearest one.
pub fn find(name: &str) -> Result<&'static Generator, String> {
    GENERATORS.iter().find(|g| g.name == name).ok_or_else(|| {
        let hint = check::hint(name, GENERATORS.iter().map(|g| g.name));
        format!("there is no generator `{name}`: {hint}")
    })
}

impl Generator {
    /// The mesh for these parameters over a floor `floor_depth_m` below the water.
    pub fn mesh(&self, params: &Value, floor_depth_m: f64) -> Result<Mesh, String> {
        let mesh = (self.build)(params, floor_depth_m)
            .map_err(|fault| format!("generator `{}`: params.{fault}", self.name))?;
        mesh.validate().map_err(|fault| format!("generator `{}`: {fault}", self.name))?;
        Ok(mesh)
    }
}

struct Dice(Pcg32);

impl Dice {
    fn new(seed: u32) -> Self {
        Self(Pcg32::seed_from_u64(seed.into()))
    }

    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.0.random::<f64>()
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use fathom_base::parameter::{Allowed, Range};
    use serde_json::json;

    use super::*;

    #[test]
    fn every_generator_makes_a_valid_mesh_at_several_depths() {
        for generator in GENERATORS.iter() {
            for depth in [0.5, 4.0, 20.0] {
                let mesh = generator.mesh(&json!({}), depth).expect(generator.name);
                assert!(mesh.triangle_count() < 100_000, "{}", generator.name);
            }
        }
    }

    /// Edges that are not met as often from one side as from the other: none in closed meshes.
    fn open_edges(mesh: &Mesh) -> usize {
        // Adding 0 makes −0 of 0.
        let corner = |i: u32| mesh.positions[i as usize].map(|c| (c + 0.0).to_bits());
        let mut balance = BTreeMap::new();
        for triangle in mesh.indices.chunks_exact(3) {
            for k in 0..3 {
                let (a, b) = (corner(triangle[k]), corner(triangle[(k + 1) % 3]));
                *balance.entry((a.min(b), a.max(b))).or_insert(0) += if a < b { 1 } else { -1 };
            }
        }
        balance.values().filter(|n| **n != 0).count()
    }

    #[test]
    fn solids_are_closed_face_outward_and_have_no_degenerate_triangles() {
        let open = [
            "plane", "corner", "basin", "column", "steps", "statue", "sea_bed", "quay", "pier",
            "stones", "hull", "bollard", "rope", "hall", "trusses", "crates", "barrels", "shelves",
            "pipe", "arcade", "teapot",
        ];
        for generator in GENERATORS.iter().filter(|generator| !open.contains(&generator.name)) {
            let mesh = generator.mesh(&json!({}), 3.0).expect(generator.name);
            assert_eq!(open_edges(&mesh), 0, "{}", generator.name);
            assert!(mesh.volume() > 0.0, "{}", generator.name);
            let flat = (0..mesh.triangle_count()).filter(|t| {
                let [a, b, c] = mesh.triangle(*t);
                (b - a).cross(c - a).length() < 1e-12
            });
            assert_eq!(flat.count(), 0, "{}", generator.name);
        }
    }

    #[test]
    fn the_check_for_closed_meshes_finds_holes() {
        let mut block = block(&Block::default());
        block.indices.truncate(block.indices.len() - 3);
        assert_eq!(open_edges(&block), 3);
    }

    #[test]
    fn generators_are_repeatable_at_both_ends_of_every_parameter() {
        for generator in GENERATORS.iter() {
            for ParamField { path, allowed, .. } in &generator.params {
                let Allowed::Numbers(Range { low, high }) = *allowed else { panic!("{path}") };
                for value in [low, high] {
                    if path != "seed" && high > 200.0 {
                        continue;
                    }
                    let mut params = generator.defaults.clone();
                    parameter::set(&mut params, path, value.into()).expect(path);
                    let mesh = generator.mesh(&params, 3.0).expect(path);
                    assert_eq!(Ok(mesh), generator.mesh(&params, 3.0));
                }
            }
        }
    }

    #[test]
    fn unknown_names_get_the_nearest_one() {
        assert!(find("sphear").err().expect("unknown").contains("`sphere`"));
        let sphere = find("sphere").expect("known");
        for (params, named) in [
            (json!({ "radus_m": 1.0 }), "radus_m: unknown field `radus_m`, expected `radius_m`"),
            (json!({ "radius_m": 0 }), "radius_m is 0: it must lie within 0.001 … 1000"),
            (json!({ "radius_m": f64::NAN }), "radius_m: invalid type: null, expected f64"),
            (json!({ "rows": 4.5 }), "rows: invalid type: floating point `4.5`, expected u32"),
        ] {
            let error = sphere.mesh(&params, 3.0).unwrap_err();
            assert!(error.starts_with(&format!("generator `sphere`: params.{named}")), "{error}");
        }
        assert!(sphere.mesh(&json!({ "radius_m": 1, "rows": 4 }), 3.0).is_ok());
    }
}
