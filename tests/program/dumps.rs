//! Dumps hold what is needed to use them: the caustics buffer's sum is computed again from the photons, the camera's depth
//! and the descriptions alone.

use std::path::Path;

use crate::common::{Array, array, gpu, sets};
use fathom::gpu::Gpu;
use fathom::harness::dump::dump;
use fathom::harness::subject::Subjects;
use glam::{DMat4, DVec3};
use serde::de::DeserializeOwned;
use serde_json::Value;

/// Relative error of the sum against splats that cover pixels in f64: drivers place edges within 1/256 px.
const SUM: f64 = 0.005;
/// Against the energy of the photons that land in view: splats reach over the border.
const ENERGY: f64 = 0.03;

struct Dump {
    array: Array,
    about: Value,
}

impl Dump {
    fn read(folder: &Path, stem: &str) -> Dump {
        let text = std::fs::read_to_string(folder.join(format!("{stem}.json"))).unwrap();
        Dump {
            array: array(&folder.join(format!("{stem}.npy"))),
            about: serde_json::from_str(&text).unwrap(),
        }
    }

    fn field<T: DeserializeOwned>(&self, pointer: &str) -> T {
        let found = self.about.pointer(pointer).and_then(|value| T::deserialize(value).ok());
        found
            .unwrap_or_else(|| panic!("{pointer} is not found or another type in {:#}", self.about))
    }

    fn matrix(&self, pointer: &str) -> DMat4 {
        DMat4::from_cols_array_2d(&self.field(pointer)).transpose()
    }

    fn column(&self, name: &str) -> usize {
        let columns = self.about["columns"].as_array().unwrap();
        columns.iter().position(|c| c["name"] == name).unwrap_or_else(|| panic!("no column {name}"))
    }

    fn rows(&self) -> impl Iterator<Item = &[f64]> {
        self.array.values.chunks_exact(self.array.shape[1])
    }
}

/// Photons, caustics, filtered caustics and depth that the stages left behind of one frame.
fn dumps(gpu: &Gpu, set: &str) -> [Dump; 4] {
    // The paper's squares, of photons on a regular grid.
    let small = "view.width=200 view.height=200 caustics.grid=64 caustics.buffer=[128,128] \
        caustics.coverage=square caustics.jitter=0 godrays.grid=8";
    let sets = sets(&format!("{small} {set}"));
    let subject = Subjects::default().subject("underwater", "plane", &sets).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let outputs = [
        ("caustics/trace", "caustics-trace-photons"),
        ("caustics/splat", "caustics-splat-intensity"),
        ("caustics/filter", "caustics-filter-filtered"),
        ("scene/gbuffer", "scene-gbuffer-depth"),
    ];
    outputs.map(|(stage, stem)| {
        dump(gpu, &subject, stage, folder.path()).unwrap();
        Dump::read(folder.path(), stem)
    })
}

/// A photon that landed: its hit, and the energy that it brings, W.
fn landed(photons: &Dump) -> Vec<(DVec3, f64)> {
    let [x, residual, distance, weight] =
        ["hit_x_m", "residual_m", "distance_m", "weight"].map(|name| photons.column(name));
    let flux_w: f64 = photons.field("/photons/flux_w");
    let gamma: f64 = photons.field("/photons/attenuation_per_m");
    let photon = |row: &[f64]| {
        let hit = DVec3::new(row[x], row[x + 1], row[x + 2]);
        let decay = (-gamma * row[distance]).exp();
        (hit, flux_w * row[weight] * decay)
    };
    let rows = photons.rows().filter(|row| row[residual] >= 0.0);
    rows.map(photon).collect()
}

/// The buffer's sum by the description's rules, and the energy of the photons whose hits lie in view.
fn expected(photons: &Dump, splat: &Dump, depth: &Array) -> (f64, f64) {
    let eye: DVec3 = splat.field("/camera/position_m");
    let project = splat.matrix("/camera/view_projection");
    let size = [128.0, 128.0];
    let [a, b, bias_m]: [f64; 3] = ["size_a_px", "size_b_px_m", "depth_bias_m"]
        .map(|name| splat.field(&format!("/splat/{name}")));
    let conserving = splat.about["photons"]["intensity"] == "conserving";
    let (mut sum, mut energy) = (0.0, 0.0);
    for (hit, photon_w) in landed(photons) {
        let ndc = project.project_point3(hit);
        let place = [(ndc.x + 1.0) / 2.0 * size[0], (1.0 - ndc.y) / 2.0 * size[1]];
        let distance_m = hit.distance(eye);
        let side = a + b / distance_m;
        let nearer = project.project_point3(hit + (eye - hit) * (bias_m / distance_m)).z;
        let covered = |center: f64| {
            let first = (center - side / 2.0 - 0.5).ceil().max(0.0) as usize;
            first..((center + side / 2.0 - 0.5).ceil().clamp(0.0, 128.0) as usize)
        };
        let pixels = covered(place[1]).flat_map(|y| covered(place[0]).map(move |x| (x, y)));
        let seen = pixels.filter(|(x, y)| {
            let texel = [*y, *x].map(|i| ((i as f64 + 0.5) / 128.0 * 200.0) as usize);
            nearer <= depth.values[texel[0] * depth.shape[1] + texel[1]]
        });
        let value = if conserving { photon_w / (side * side) } else { photon_w };
        sum += value * seen.count() as f64;
        if place.iter().all(|p| (0.0..128.0).contains(p)) {
            energy += photon_w;
        }
    }
    (sum, energy)
}

fn off(measured: f64, expected: f64) -> f64 {
    (measured / expected - 1.0).abs()
}

/// Straight down, so that the floor hides nothing.
const FROM_ABOVE: &str = "camera.position_m=[0.0,6.0,0.0] camera.target_m=[0.0,0.0,0.0] \
    camera.up=[0.0,0.0,-1.0] camera.z_near_m=0.5 camera.z_far_m=15.0";

/// A point light, with losses at the surface.
const POINT_LIGHT: &str = "light.kind=point light.position_m=[1.5,4.0,-1.0] water.fresnel=true";

fn unit(dump: &Dump) -> &str {
    dump.about["columns"][0]["unit"].as_str().unwrap()
}

/// Seen at a slant, where the floor hides parts of most splats; and from above, where the conserving buffer sums to the energy that lands
/// in view. The paper's counts each photon in every pixel of its splat, of which there are 25 at least.
#[test]
fn the_caustics_buffer_follows_from_its_dumps_in_the_units_that_they_tell() {
    let gpu = gpu();
    for (set, of_energy) in [
        (format!("caustics.intensity=conserving {POINT_LIGHT}"), None),
        (format!("caustics.intensity=conserving {FROM_ABOVE} {POINT_LIGHT}"), Some("W/px")),
        (format!("caustics.intensity=paper {FROM_ABOVE}"), Some("not divided")),
    ] {
        let [photons, splat, filtered, depth] = dumps(&gpu, &set);
        let (sum, energy) = expected(&photons, &splat, &depth.array);
        let measured: f64 = splat.array.values.iter().sum();
        assert!(off(measured, sum) < SUM, "{set}: {measured} against {sum}");
        assert_eq!(unit(&splat), unit(&filtered));
        let Some(told) = of_energy else { continue };
        assert!(unit(&splat).contains(told), "{}", unit(&splat));
        let is_in_view = off(measured, energy) < ENERGY;
        assert!(is_in_view || told != "W/px" && measured > 24.0 * energy, "{measured} {energy}");
    }
}

/// The frustum's parts agree with each other and with where the photons enter.
#[test]
fn the_light_frustum_and_the_photons_belong_together() {
    let [photons, ..] = dumps(&gpu(), "water.amplitude_m=0.0");
    assert_eq!(photons.array.shape, [64 * 64 * 4, 13]);
    assert_eq!(photons.field::<Vec<usize>>("/shape"), photons.array.shape);
    assert_eq!(photons.field::<Vec<Value>>("/columns").len(), 13);
    assert_eq!(photons.field::<f64>("/params/water/refractive_index"), 1.33);
    let project = photons.matrix("/light_frustum/view_projection");
    let inverse = photons.matrix("/light_frustum/inverse");
    assert!((project * inverse - DMat4::IDENTITY).to_cols_array().iter().all(|v| v.abs() < 1e-9));
    let [area, emitted] = ["grid_area", "emitted_w"]
        .map(|name| photons.field::<f64>(&format!("/light_frustum/{name}")));
    assert!(off(area * 9.2, emitted) < 1e-9);
    let place = photons.matrix("/light_frustum/photon_grid").inverse();
    let [count, flux_w, eta] = ["count", "flux_w", "refractive_index"]
        .map(|name| photons.field::<f64>(&format!("/photons/{name}")));
    assert!(off(flux_w * count, emitted) < 1e-5);
    let forward: DVec3 = photons.field("/light_frustum/forward");
    let [entry, direction, weight] =
        ["entry_x_m", "direction_x", "weight"].map(|name| photons.column(name));
    let mut judged = 0;
    for (i, row) in photons.rows().enumerate() {
        let vector = |at: usize| DVec3::new(row[at], row[at + 1], row[at + 2]);
        let cell = i / 4;
        let fine = [cell % 64 * 2 + i % 2, cell / 64 * 2 + i % 4 / 2];
        let at = place.project_point3(vector(entry));
        for (along, place) in [at.x, at.y].into_iter().zip(fine) {
            assert!((along - ((place as f64 + 0.5) / 64.0 - 1.0)).abs() < 1e-4, "photon {i}");
        }
        if row[weight] > 0.0 && row[photons.column("residual_m")] >= 0.0 {
            let along = (forward - eta * vector(direction)).cross(DVec3::Y).length();
            assert!(along < 1e-4, "photon {i}: {along}");
            judged += 1;
        }
    }
    assert!(judged > 1000, "{judged}");
}
