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

use std::collections::BTreeMap;

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg32;

use super::{Mesh, check};

pub struct Generator {
    /// As scene files call it.
    pub name: &'static str,
    pub about: &'static str,
    pub params: &'static [Param],
    build: fn(&Args) -> Mesh,
}

pub struct Param {
    /// With its unit, as scene files call it.
    pub name: &'static str,
    pub default: f64,
    pub low: f64,
    pub high: f64,
    pub about: &'static str,
}

pub fn all() -> impl Iterator<Item = &'static Generator> + Clone {
    [
        basic::GENERATORS,
        tank::GENERATORS,
        port::GENERATORS,
        storage::GENERATORS,
        atrium::GENERATORS,
        bricks::GENERATORS,
        freight::GENERATORS,
        level::GENERATORS,
        robot::GENERATORS,
        room::GENERATORS,
        thicket::GENERATORS,
        teapot::GENERATORS,
        tree::GENERATORS,
        dolphin::GENERATORS,
        diving::GENERATORS,
    ]
    .into_iter()
    .flatten()
}

/// The generator called `name`; the error names the nearest one.
pub fn find(name: &str) -> Result<&'static Generator, String> {
    all().find(|g| g.name == name).ok_or_else(|| {
        let hint = check::hint(name, all().map(|g| g.name));
        format!("there is no generator `{name}`: {hint}")
    })
}

impl Generator {
    const fn with(self, params: &'static [Param]) -> Self {
        Self { params, ..self }
    }

    /// The mesh for these parameters over a floor `floor_depth_m` below the water.
    pub fn mesh(&self, params: &BTreeMap<String, f64>, floor_depth_m: f64) -> Result<Mesh, String> {
        let mesh = (self.build)(&Args::new(self.name, self.params, params, floor_depth_m)?);
        mesh.validate().map_err(|fault| format!("generator `{}`: {fault}", self.name))?;
        Ok(mesh)
    }
}

/// The parameters of one call.
struct Args<'a> {
    generator: &'static str,
    declared: &'static [Param],
    given: &'a BTreeMap<String, f64>,
    /// Depth of the floor below the water, metres.
    floor_depth_m: f64,
}

impl<'a> Args<'a> {
    /// Parameters that the generator declares, each within its range.
    fn new(
        generator: &'static str,
        declared: &'static [Param],
        given: &'a BTreeMap<String, f64>,
        floor_depth_m: f64,
    ) -> Result<Self, String> {
        for (name, &value) in given {
            let Some(param) = declared.iter().find(|p| p.name == name) else {
                let hint = check::hint(name, declared.iter().map(|p| p.name));
                return Err(format!("generator `{generator}` has no parameter `{name}`: {hint}"));
            };
            check::check_range(&format!("params.{name}"), value, param.low, param.high)?;
        }
        Ok(Self { generator, declared, given, floor_depth_m })
    }

    /// A parameter's value, or its default.
    fn get(&self, name: &str) -> f64 {
        let declared = || self.declared.iter().find(|p| p.name == name).map(|p| p.default);
        let value = self.given.get(name).copied().or_else(declared);
        value.unwrap_or_else(|| panic!("`{}` does not declare `{name}`", self.generator))
    }

    fn count(&self, name: &str) -> usize {
        self.get(name).round() as usize
    }

    fn rng(&self) -> Dice {
        Dice::new(self.get("seed") as u64)
    }
}

struct Dice(Pcg32);

impl Dice {
    fn new(seed: u64) -> Self {
        Self(Pcg32::seed_from_u64(seed))
    }

    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.0.random::<f64>()
    }
}

/// A generator without parameters.
const fn generator(name: &'static str, about: &'static str, build: fn(&Args) -> Mesh) -> Generator {
    Generator { name, about, params: &[], build }
}

const fn param(
    name: &'static str,
    default: f64,
    low: f64,
    high: f64,
    about: &'static str,
) -> Param {
    Param { name, default, low, high, about }
}

const SEED: Param = param("seed", 1.0, 0.0, 4_294_967_295.0, "seed of the random numbers");

/// The mesh of a generator with some of its parameters set, over a floor in 3 m.
#[cfg(test)]
fn made(generator: &str, params: &[(&str, f64)]) -> Mesh {
    let params = params.iter().map(|(name, value)| ((*name).to_owned(), *value)).collect();
    find(generator).and_then(|generator| generator.mesh(&params, 3.0)).expect("a mesh")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_generator_makes_a_valid_mesh_at_several_depths() {
        for generator in all() {
            for depth in [0.5, 4.0, 20.0] {
                let mesh = generator
                    .mesh(&BTreeMap::new(), depth)
                    .unwrap_or_else(|e| panic!("{}: {e}", generator.name));
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
        for generator in all().filter(|generator| !open.contains(&generator.name)) {
            let mesh = made(generator.name, &[]);
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
        let mut block = made("box", &[]);
        block.indices.truncate(block.indices.len() - 3);
        assert_eq!(open_edges(&block), 3);
    }

    #[test]
    fn generators_are_repeatable_at_both_ends_of_every_parameter() {
        for generator in all() {
            for param in generator.params {
                for value in [param.low, param.high] {
                    if param.name != "seed" && param.high > 200.0 {
                        continue;
                    }
                    let params = BTreeMap::from([(param.name.to_owned(), value)]);
                    let mesh = generator
                        .mesh(&params, 3.0)
                        .unwrap_or_else(|e| panic!("{} = {value}: {e}", param.name));
                    assert_eq!(Ok(mesh), generator.mesh(&params, 3.0));
                }
            }
        }
    }

    #[test]
    fn unknown_names_get_the_nearest_one() {
        assert!(find("sphear").err().expect("unknown").contains("`sphere`"));
        let sphere = find("sphere").expect("known");
        for (param, value, named) in
            [("radus_m", 1.0, "`radius_m`"), ("radius_m", f64::NAN, "params.radius_m")]
        {
            let params = BTreeMap::from([(param.to_owned(), value)]);
            let error = sphere.mesh(&params, 3.0).unwrap_err();
            assert!(error.contains(named), "{error}");
        }
    }
}
