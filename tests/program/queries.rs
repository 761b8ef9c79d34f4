//! `fathom query photons` and given water, as a user meets them.

use std::collections::BTreeMap;

use crate::common::{Ends, Place};
use fathom::npy;

/// Rows by column.
struct Table(Vec<BTreeMap<String, String>>);

impl Table {
    fn read(text: &str) -> Table {
        Table(csv::Reader::from_reader(text.as_bytes()).deserialize().map(Result::unwrap).collect())
    }

    fn text(&self, row: usize, column: &str) -> &str {
        self.0[row].get(column).unwrap_or_else(|| panic!("no {column} in {:?}", self.0[row]))
    }

    fn number(&self, row: usize, column: &str) -> f64 {
        let text = self.text(row, column);
        text.parse().unwrap_or_else(|_| panic!("{column} of row {row} is `{text}`"))
    }

    fn vector(&self, row: usize, name: &str) -> [f64; 3] {
        ["x", "y", "z"].map(|axis| self.number(row, &format!("{name}_{axis}")))
    }
}

fn near(a: [f64; 3], b: [f64; 3], tolerance: f64) -> bool {
    a.iter().zip(b).all(|(a, b)| (a - b).abs() < tolerance)
}

/// Asks about starts in scene `plane`, with the reference. The sets have spaces between.
fn photons(place: &Place, starts: &str, sets: &str) -> Table {
    place.write("starts.csv", starts);
    let sets = sets.split_whitespace().flat_map(|set| ["--set", set]);
    let query = "query photons --scene plane --reference --points starts.csv -o out.csv";
    place.fathom(query).args(sets).ends(0);
    Table::read(&place.read("out.csv"))
}

/// Starts on the light's rays and with directions of their own, over flat water 3 m deep: Snell's law by hand.
#[test]
fn photons_through_flat_water_land_where_snell_says() {
    let place = Place::new();
    let flat = "water.amplitude_m=0 caustics.iterations=12 water.fresnel=true";
    let table = photons(&place, "name,x,y,z\na,0.2,1,0.3\nb,0,2,50\n", flat);
    assert_eq!(table.text(0, "outcome"), "landed");
    assert!(near(table.vector(0, "hit"), [0.2, -3.0, 0.3], 1e-3));
    let straight = 1.0 - (0.33f64 / 2.33).powi(2);
    assert!((table.number(0, "weight") - straight).abs() < 1e-5);
    assert!((table.number(0, "reference_weight") - straight).abs() < 1e-12);
    assert_eq!(table.text(0, "converged"), "1");
    assert_eq!(table.text(1, "outcome"), "misses_water");
    assert_eq!(table.text(1, "reference_outcome"), "misses_water");
    assert_eq!(table.text(1, "hit_x"), "");

    let table = photons(&place, "x,y,z,dx,dy,dz\n-1.5,1,0.3,2,-2,0\n", flat);
    let sin = 0.5f64.sqrt() / 1.33;
    let cos = (1.0 - sin * sin).sqrt();
    assert!(near(table.vector(0, "entry"), [-0.5, 0.0, 0.3], 1e-5));
    assert!(near(table.vector(0, "direction"), [sin, -cos, 0.0], 1e-5));
    let hit = [-0.5 + 3.0 * sin / cos, -3.0, 0.3];
    assert!(near(table.vector(0, "hit"), hit, 1e-3), "{:?}", table.0);
    assert!(near(table.vector(0, "reference_hit"), hit, 1e-9));
    assert!((table.number(0, "distance_m") - 3.0 / cos).abs() < 1e-3);
    assert!(table.number(0, "error_m") < 1e-3);
}

/// Two waves that fit a tile of 4 m.
const WAVES: &str = r#"water.waves=[{"direction":[1,0],"wavelength_m":2,"amplitude_m":0.04},{"vector_rad_m":[1.5707963267948966,3.141592653589793],"amplitude_m":0.03,"phase_rad":1}]"#;

fn height(x: f64, z: f64) -> f64 {
    use std::f64::consts::PI;
    0.04 * (PI * x).cos() + 0.03 * (PI / 2.0 * x + PI * z + 1.0).cos()
}

fn npy_file(descriptor: &str, shape: &[usize], values: impl IntoIterator<Item = u8>) -> Vec<u8> {
    npy::header(descriptor, shape).into_iter().chain(values).collect()
}

/// A height map of the same waves.
fn map_file() -> Vec<u8> {
    let place = |i: usize| i as f64 / 16.0;
    let heights = (0..64 * 64).map(|at| height(place(at % 64), place(at / 64)));
    npy_file("<f8", &[64, 64], heights.flat_map(f64::to_le_bytes))
}

/// The list of waves and a height map of the same waves, each against its own exact answer and against the formula.
#[test]
fn given_water_is_the_water_that_was_given() {
    let place = Place::new();
    place.write("sea.npy", map_file());
    let map = "water.model=height_map water.height_map.file=sea.npy water.height_map.tile_m=[4,4]";
    let starts = "x,y,z\n0.1,1,0.2\n-0.7,1,0.4\n0.9,1,-0.6\n-0.4,1,-0.9\n1.3,1,1.1\n";
    let waves = photons(&place, starts, &format!("water.model=waves {WAVES}"));
    let mapped = photons(&place, starts, map);
    for row in 0..5 {
        let [x, y, z] = waves.vector(row, "entry");
        assert!((y - height(x, z)).abs() < 1e-4, "row {row}: {y}");
        for (table, name, other, of_other, tolerance) in [
            (&waves, "entry", &waves, "reference_entry", 1e-4),
            (&waves, "direction", &waves, "reference_direction", 1e-3),
            (&mapped, "entry", &mapped, "reference_entry", 1e-4),
            (&mapped, "direction", &mapped, "reference_direction", 1e-3),
            (&mapped, "reference_entry", &waves, "reference_entry", 1e-4),
            (&mapped, "reference_direction", &waves, "reference_direction", 2e-3),
        ] {
            let [a, b] = [table.vector(row, name), other.vector(row, of_other)];
            assert!(near(a, b, tolerance), "row {row}, {name} and {of_other}: {a:?} and {b:?}");
        }
    }
}

#[test]
fn a_scene_names_its_height_map_relative_to_itself() {
    let place = Place::new();
    place.write("sea.npy", map_file());
    let text = "base = \"plane\"\n[water]\nmodel = \"height_map\"\nheight_map = { file = \"sea.npy\", tile_m = [4.0, 4.0] }\n";
    let scene = place.write("sea.toml", text);
    let scene = fathom::scene::Scene::load(&scene.to_string_lossy()).unwrap();
    assert!((scene.water.height(0.25, 1.75) - height(0.25, 1.75)).abs() < 1e-12);
}

#[test]
fn water_that_cannot_be_used_is_refused_in_one_line() {
    let place = Place::new();
    let zeros = |count: usize| std::iter::repeat_n(0, 4 * count);
    place.write("wide.npy", npy_file("<f4", &[1, 5000], zeros(5000)));
    place.write("whole.npy", npy_file("<i4", &[4, 4], zeros(16)));
    place.write("good.npy", npy_file("<f4", &[4, 4], zeros(16)));
    // Of 412 bytes: the time to read it doubled with each depth.
    let nested = format!("{{'descr': {}{}, ", "(".repeat(24), ")".repeat(24));
    let nested = format!("{nested:<402}");
    place.write("nested.npy", [&b"\x93NUMPY\x01\0\x92\x01"[..], nested.as_bytes()].concat());
    place.write("text.npy", "no array");
    let refused = |sets: &str, reason: &str| {
        let sets = sets.split_whitespace().flat_map(|set| ["--set", set]);
        place.fathom("dump caustics/trace --scene plane").args(sets).refused(reason);
    };
    for (name, tile, reason) in [
        ("none.npy", "[1,1]", "none.npy: "),
        ("wide.npy", "[1,1]", "1 × 5000 heights; each side has 1 to 4096"),
        ("whole.npy", "[1,1]", "little-endian f32 or f64"),
        ("text.npy", "[1,1]", "text.npy: "),
        ("nested.npy", "[1,1]", "of type a structure"),
        ("good.npy", "[0,1]", "water.height_map.tile_m[0] is 0"),
    ] {
        let map = format!("water.height_map.file={name} water.height_map.tile_m={tile}");
        refused(&format!("water.model=height_map {map}"), reason);
    }
    refused(WAVES, "set water.model to waves");
    refused("water.model=waves", "lists none");
    let endless = r#"water.model=waves water.waves=[{"vector_rad_m":[0,0],"amplitude_m":0.1}]"#;
    refused(endless, "water.waves[0].vector_rad_m");
    refused("water.waves=[1]", "a list of tables");
}

#[test]
fn starts_that_cannot_be_used_are_refused_in_one_line() {
    let place = Place::new();
    let above = "--set light.kind=point --set light.position_m=[0,2,0]";
    for (text, options, reason) in [
        ("x,y\n", "", "line 1: there is no column `z`"),
        ("x,y,z\n1,-1,1\n", "", "not above the water"),
        ("x,y,z,dx,dy,dz\n1,1,1,0,1,0\n", "", "must point downwards"),
        ("x,y,z\n1,1,1\n", "--reference 9", "leave the number out"),
        ("x,y,z\n0,1,0\n0,3,0\n", above, "start 2: the light's ray"),
    ] {
        place.write("starts.csv", text);
        let query = "query photons --scene plane --points starts.csv";
        place.fathom(format!("{query} {options}")).refused(reason);
    }
}

/// On the floor far from a ball, beside its foot, and on its top; with ray casting beside fathom's own answer.
#[test]
fn occlusion_is_answered_in_the_order_of_the_points_with_its_reference() {
    let place = Place::new();
    let query = |points: &str, options: &str| {
        place.write("points.csv", points);
        let words = "query ao --scene ball --points points.csv --set voxel.resolution=64";
        place.fathom(format!("{words} {options}"))
    };
    let points =
        "note,x,y,z,nx,ny,nz\nfar,-2.5,-4,-2.5,0,1,0\nfoot,0.6,-4,0,0,3,0\ntop,0,-2.4,0,0,1,0\n";
    query(points, "--reference 512 -o out.csv").ends(0);
    let text = place.read("out.csv");
    assert!(text.starts_with("x,y,z,nx,ny,nz,occlusion,reference,error\n"), "{text}");
    let table = Table::read(&text);
    let foot = ["x", "y", "z", "nx", "ny", "nz"].map(|column| table.number(1, column));
    assert_eq!(foot, [0.6, -4.0, 0.0, 0.0, 3.0, 0.0]);
    for (row, range) in [(0, -0.02..0.02), (1, 0.2..0.9), (2, -0.02..0.02)] {
        let [fast, exact, error] =
            ["occlusion", "reference", "error"].map(|column| table.number(row, column));
        assert!(range.contains(&fast) && range.contains(&exact), "{row}: {fast}, {exact}");
        assert!((fast - exact - error).abs() < 2e-6 && error.abs() < 0.1, "{row}: {error}");
    }
    let answer = query(points, "--set ao.rays=32").answer();
    assert!(answer.starts_with("x,y,z,nx,ny,nz,occlusion\n"), "{answer}");

    let faulty = "x,y,z,nx,ny,nz\n0,-4,0,0,1,0\n0,-4,0,0,NaN,0\n";
    query(faulty, "").refused("points.csv, line 3, column `ny`: `NaN` is not a number");
    let short = "error: ao.r_max_m is 1.000e-3 m, less than a voxel";
    query(points, "--set ao.r_max_m=0.001").refused(short);
}
