//! `fathom query ao`, dumped photons and given water, as a user meets them.

use std::collections::BTreeMap;

use crate::common::{Ends, Place};
use fathom::reference::optics::refract;
use glam::DVec3;

/// Rows by column.
struct QueryTable(Vec<BTreeMap<String, String>>);

impl QueryTable {
    fn read(text: &str) -> QueryTable {
        QueryTable(
            csv::Reader::from_reader(text.as_bytes()).deserialize().map(Result::unwrap).collect(),
        )
    }

    fn number(&self, row: usize, column: &str) -> f64 {
        let text = &self.0[row][column];
        text.parse().unwrap_or_else(|_| panic!("{column} of row {row} is `{text}`"))
    }
}

/// A photon of a dump of `caustics/trace`, and how the light reaches it.
struct DumpedPhoton {
    entry: DVec3,
    incident: DVec3,
    direction: DVec3,
    hit: DVec3,
    residual_m: f64,
    weight: f64,
}

/// The photons of a dump in scene `plane`. The sets have spaces between.
fn photons(place: &Place, sets: &str) -> Vec<DumpedPhoton> {
    let few = "caustics.grid=8 caustics.iterations=12 caustics.intensity=paper";
    let sets = few.split(' ').chain(sets.split_whitespace()).flat_map(|set| ["--set", set]);
    place.fathom("dump caustics/trace --scene plane -o .").args(sets).ends(0);
    let about = place.read("caustics-trace-photons.json");
    let light = &serde_json::from_str::<serde_json::Value>(&about).unwrap()["light_frustum"];
    let vector = |name: &str| serde_json::from_value::<DVec3>(light[name].clone()).unwrap();
    let (forward, position, is_point) =
        (vector("forward"), vector("position_m"), light["kind"] == "point");
    let array = crate::common::array(&place.path("caustics-trace-photons.npy"));
    let rows = array.values.chunks_exact(array.shape[1]).map(|row| {
        let entry = DVec3::from_slice(row);
        DumpedPhoton {
            entry,
            incident: if is_point { (entry - position).normalize() } else { forward },
            direction: DVec3::from_slice(&row[3..]),
            hit: DVec3::from_slice(&row[6..]),
            residual_m: row[10],
            weight: row[12],
        }
    });
    rows.filter(|photon| photon.residual_m != -1.0).collect()
}

/// Under a lamp, over flat water 3 m deep: Snell's and Fresnel's laws by hand.
#[test]
fn photons_through_flat_water_land_where_snell_says_with_what_fresnel_lets_through() {
    let lamp = "light.kind=point light.position_m=[2.0,3.0,-1.0]";
    let flat = format!("water.amplitude_m=0 water.fresnel=true {lamp}");
    let photons = photons(&Place::new(), &flat);
    assert!(photons.len() > 100, "{}", photons.len());
    for photon in &photons {
        let DumpedPhoton { incident, direction, entry, .. } = *photon;
        let across = incident.with_y(0.0) / 1.33;
        let cos_t = (1.0 - across.length_squared()).sqrt();
        assert!(direction.distance(across.with_y(-cos_t)) < 1e-5);
        let hit = entry + across.with_y(-cos_t) * (3.0 / cos_t);
        assert!(photon.residual_m < 0.0 || photon.hit.distance(hit) < 1e-3, "{} {hit}", photon.hit);
        let cos_i = -incident.y;
        let s = (cos_i - 1.33 * cos_t) / (cos_i + 1.33 * cos_t);
        let p = (1.33 * cos_i - cos_t) / (1.33 * cos_i + cos_t);
        assert!((photon.weight - (1.0 - 0.5 * (s * s + p * p))).abs() < 1e-5);
    }
    assert!(photons.iter().filter(|photon| photon.residual_m >= 0.0).count() > 100);
}

/// Two waves.
const WAVES: &str = r#"water.waves=[{"direction":[1,0],"wavelength_m":2,"amplitude_m":0.04},{"direction":[1,2],"wavelength_m":1.7888543819998317,"amplitude_m":0.03,"phase_rad":1}]"#;

fn height(x: f64, z: f64) -> f64 {
    use std::f64::consts::PI;
    0.04 * (PI * x).cos() + 0.03 * (PI / 2.0 * x + PI * z + 1.0).cos()
}

/// Photons enter a list of waves and are refracted as the formula has it.
#[test]
fn given_water_is_the_water_that_was_given() {
    let photons = photons(&Place::new(), &format!("water.model=waves {WAVES}"));
    assert!(photons.len() > 100, "{}", photons.len());
    for DumpedPhoton { entry, incident, direction, .. } in photons {
        let [x, y, z] = entry.to_array();
        let slope = |dx: f64, dz: f64| (height(x + dx, z + dz) - height(x - dx, z - dz)) / 2e-6;
        let normal = DVec3::new(-slope(1e-6, 0.0), 1.0, -slope(0.0, 1e-6)).normalize();
        let exact = refract(incident, normal, 1.0, 1.33).unwrap();
        assert!((y - height(x, z)).abs() < 1e-3, "{y} at {x}, {z}");
        assert!(direction.distance(exact) < 1e-3, "{direction} {exact}");
    }
}

#[test]
fn water_that_cannot_be_used_is_refused_in_one_line() {
    let place = Place::new();
    let refused = |sets: &str, reason: &str| {
        let sets = sets.split_whitespace().flat_map(|set| ["--set", set]);
        place.fathom("dump caustics/trace --scene plane").args(sets).refused(reason);
    };
    refused(WAVES, "set water.model to waves");
    refused("water.model=waves", "lists none");
    let endless =
        r#"water.model=waves water.waves=[{"direction":[0,0],"wavelength_m":1,"amplitude_m":0.1}]"#;
    refused(endless, "water.waves[0].direction");
    refused("water.waves=[1]", "a list of tables");
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
    let table = QueryTable::read(&text);
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
