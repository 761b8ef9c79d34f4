//! `caustics/mesh`: irradiance of refracted triangles against the same triangles in f64, and their energy against the photons'.

use crate::prelude::*;
use fathom_reference::caustic_mesh::{self, Beam, Corner};
use fathom_reference::photons::entering;
use fathom_stages::caustics::mesh::{self, INFO, MeshUniforms};

const SIZE: [u32; 2] = [320, 240];
/// Cells per side of the light's grid, and photons per side of each.
const CELLS: u32 = 20;
const SIDE: u32 = 2;
const COLUMNS: usize = (SIDE * CELLS) as usize;
/// Defaults of `caustics.depth_bias_m` and `caustics.mesh_stretch`.
const BIAS_M: f64 = 0.3;
const STRETCH: f64 = 8.0;
/// Amplitudes of waves that fold the mesh, and of waves too low for that: slivers at folds fall between the pixels' middles, and a sum over
/// pixels then scatters by some per cent.
const FOLDING_M: f64 = 0.05;
const LEVEL_M: f64 = 0.005;
/// Rasterizers move corners by up to 1/32 of a pixel, and with them the borders of triangles that are a few pixels wide.
const TOLERANCE: f64 = 0.02;

pub fn cases() -> Vec<Case> {
    let mut cases = Vec::new();
    for (kind, light) in rig::LIGHTS {
        for (what, camera, extent_m) in views() {
            let what = format!("slanted plane, {light} light, {what}");
            cases.push(Case::new(INFO.name, what.clone(), move |rig| {
                pixel_by_pixel(rig, slanted(kind, (&camera, extent_m), FOLDING_M)?, &what)
            }));
        }
        let what = format!("energy on a slanted plane, {light} light");
        cases.push(Case::new(INFO.name, what, move |rig| energy(rig, kind, light)));
    }
    cases.push(Case::new(INFO.name, "scene tank: silhouettes and photons that miss", in_tank));
    cases
}

/// Cameras, and half the width of the light about the middle of their views: all of what is lit is seen, or it goes on beyond the picture
/// and beside the water.
fn views() -> [(&'static str, Camera, f64); 3] {
    let camera = |target_m| Camera::new([1.5, 3.0, 5.0], target_m, 40.0, [0.1, 12.0]);
    let whole = camera([0.2, -2.5, 0.0]);
    let turned = Camera { up: [0.8, 1.0, 0.3], ..whole.clone() };
    let beside = camera([-2.2, -2.0, 1.8]);
    [("whole", whole, 1.6), ("turned", turned, 1.6), ("beyond the picture", beside, 4.0)]
}

/// Waves over a slanted plane; Fresnel's transmission where the light is a point.
fn slanted(kind: LightKind, (camera, extent_m): (&Camera, f64), amplitude_m: f64) -> Result<Scene> {
    let mut scene = rig::flat_plane(kind)?;
    let (along, across) = (DVec3::new(0.0, 0.7, 6.0), DVec3::new(6.0, -1.1, 0.0));
    let floor = Mesh::parallelogram(DVec3::Y * -2.5, along, across);
    scene.objects = vec![Object::new("slanted", floor)];
    scene.water.amplitude_m = amplitude_m;
    scene.water.fresnel = kind == LightKind::Point;
    scene.light.half_extent_m = extent_m;
    scene.camera = camera.clone();
    Ok(scene)
}

/// The mesh of a scene's exact photons.
struct Meshed {
    stand: Stand,
    frame: LightFrame,
    /// By rows of the light's grid; the rounded numbers of those that have landed.
    corners: Vec<Option<Corner>>,
    /// What the stage draws, over this depth.
    image: Image,
    depth: Image,
}

impl Meshed {
    fn new(rig: &Rig<'_>, scene: Scene, jitter: f64) -> Result<Self> {
        let stand = rig.stand(scene, SIZE)?;
        let frame = stand.view.light_frame();
        let grid = PhotonGrid { jitter, ..PhotonGrid::new(CELLS, SIDE) };
        let landings = land_all(&frame, &stand.scene.water, &stand.tracer, grid, 1);
        let stored: Vec<Photon> = landings.iter().map(stored).collect();
        let mut corners = vec![None; stored.len()];
        for (index, (photon, landing)) in stored.iter().zip(&landings).enumerate() {
            let corner = |landed| corner(&stand.scene, &frame, photon, landed);
            corners[in_rows(index)] = landing.landed().map(corner);
        }
        let settings = MeshUniforms {
            size_px: UVec2::from(SIZE).as_vec2(),
            grid: CELLS,
            strength: stand.view.light.intensity_w_sr as f32,
            depth_bias_m: BIAS_M as f32,
            most_stretch: STRETCH as f32,
        };
        let inputs = (&rig.photons(&stored), &rig.gbuffer(&stand)?.depth);
        let stage = mesh::new(rig, &stand.shared, inputs, &settings, SIDE)?;
        // Twice: a frame must not add to the one before.
        let image = rig.drawn(&[&stage, &stage], &stage.texture, 0)?;
        Ok(Self { depth: rig.channel(inputs.1, 0)?, stand, frame, corners, image })
    }

    /// Flux that the photons bring, W: equal shares of a directional light's, by solid angle of a point light's.
    fn flux_w(&self) -> f64 {
        let spread = |corner: &Corner| match self.frame.kind {
            LightKind::Directional => 1.0,
            LightKind::Point => {
                (corner.entry - self.frame.position).normalize().dot(self.frame.forward).powi(3)
            }
        };
        let whole_w = self.stand.view.light.intensity_w_sr * self.frame.grid_area;
        let whole = |corner: &Corner| whole_w * spread(corner);
        let landed = self.corners.iter().flatten();
        landed.map(|corner| whole(corner) * corner.left).sum::<f64>() / self.corners.len() as f64
    }

    fn beam(&self, most_stretch: f64) -> Beam {
        Beam {
            kind: self.frame.kind,
            position: self.frame.position,
            forward: self.frame.forward,
            strength: self.stand.view.light.intensity_w_sr,
            most_stretch,
        }
    }

    /// The difference of the drawn mesh from these corners' triangles, drawn in f64 over the same depth.
    fn off(&self, corners: &[Option<Corner>], most_stretch: f64) -> f64 {
        let triangles = self.beam(most_stretch).triangles(corners, COLUMNS);
        let seen = CameraDepth { depth: &self.depth, camera: &self.stand.view.camera };
        difference(&self.image, &caustic_mesh::draw(SIZE, &triangles, &seen, BIAS_M))
    }
}

/// Place by rows of a photon that is stored cell by cell.
fn in_rows(index: usize) -> usize {
    let (cell, sub) = (index / 4, index % 4);
    let (x, y) = (cell % CELLS as usize * 2 + sub % 2, cell / CELLS as usize * 2 + sub / 2);
    y * COLUMNS + x
}

fn stored(landing: &Landing) -> Photon {
    match landing.landed() {
        Some(landed) => {
            rig::photon(landed.entry.position, landed.hit.position, landed.hit.distance_m)
        }
        None => Photon { residual_m: MISSED, ..rig::photon(DVec3::ZERO, DVec3::ZERO, 0.0) },
    }
}

fn corner(scene: &Scene, frame: &LightFrame, photon: &Photon, landed: &Landed) -> Corner {
    let entry = photon.entry_m.as_dvec3();
    let incident = match frame.kind {
        LightKind::Directional => frame.forward,
        LightKind::Point => (entry - frame.position).normalize(),
    };
    let passed = entering(&scene.water, landed.entry.normal, incident);
    let left = transmittance(scene.water.attenuation_per_m, photon.distance_m.into()) * passed;
    Corner { entry, hit: photon.hit_m.as_dvec3(), left }
}

fn pixel_by_pixel(rig: &Rig<'_>, scene: Scene, what: &str) -> Result<Check> {
    let meshed = Meshed::new(rig, scene, 0.0)?;
    let dimmed = |corner: &Option<Corner>| corner.map(|c| Corner { left: c.left * 0.95, ..c });
    let dimmer: Vec<_> = meshed.corners.iter().map(dimmed).collect();
    let lit = meshed.image.data().iter().filter(|value| **value > 0.0).count();
    Ok(Check::of(rig, format!("{what}: Σ |irradiance − twin| / Σ"))
        .within((TOLERANCE, "1"), meshed.off(&meshed.corners, STRETCH))
        .control("5 % less light at each corner", meshed.off(&dimmer, STRETCH))
        .with("lit_pixels", lit as f64))
}

/// Scene `tank`, whose objects hide one another from light and camera, with strewn photons.
fn in_tank(rig: &Rig<'_>) -> Result<Check> {
    let meshed = Meshed::new(rig, Scene::load("tank")?, 0.5)?;
    let off = |stretch| meshed.off(&meshed.corners, stretch);
    // Most triangles are longer than 1.2 times their length before refraction.
    Ok(Check::of(rig, "scene tank: Σ |irradiance − twin| / Σ")
        .within((TOLERANCE, "1"), off(STRETCH))
        .control("longest edges up to 1.2 in place of 8", off(1.2))
        .with("difference_without_limit", off(f64::INFINITY))
        .with("landed_share", share(meshed.corners.iter().map(Option::is_some))))
}

/// What the mesh brings to a slanted plane, summed over its area, against the flux of its photons: each stands for a square of
/// the grid, and the outermost half squares have no triangles.
fn energy(rig: &Rig<'_>, kind: LightKind, light: &str) -> Result<Check> {
    // All of what is lit is in view.
    const EXTENT_M: f64 = 1.2;
    let [(_, camera, _), ..] = views();
    let meshed = Meshed::new(rig, slanted(kind, (&camera, EXTENT_M), LEVEL_M)?, 0.0)?;
    let below = meshed.stand.tracer.cast(DVec3::Y, DVec3::NEG_Y, 0.0, f64::MAX);
    let plane = below.map_or((DVec3::NAN, DVec3::NAN), |hit| (hit.position, hit.normal));
    let area = |at| rig::area_shown(&meshed.stand.rays, at, plane);
    let brought: f64 = pixels(SIZE).map(|at| meshed.image.at(at) * area(at)).sum();
    let inner = ((COLUMNS - 1) as f64 / COLUMNS as f64).powi(2);
    let flux = meshed.flux_w() * inner;
    let triangles = meshed.beam(STRETCH).triangles(&meshed.corners, COLUMNS);
    let triangles: f64 = triangles.iter().map(caustic_mesh::Lit::landed_w).sum();
    let what = "Σ irradiance × area over the photons' flux, relative error";
    Ok(Check::of(rig, format!("slanted plane, {light} light: {what}"))
        .within((0.01, "1"), relative_error(brought, flux))
        .control("with the rim that no triangle covers", relative_error(brought, flux / inner))
        .with("flux_of_triangles_error", triangles / flux - 1.0))
}
