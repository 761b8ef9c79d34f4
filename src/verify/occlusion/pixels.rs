//! `ao/march`: pixel by pixel against the f64 twin, from the depth and normals of a rendered scene.

use super::*;
use fathom_reference::image::behind;
use fathom_stages::ao::march::{self, INFO};

/// A ball over a plane, and background.
const SCENE: &str = "ball";
const SIZE: [u32; 2] = [48, 36];
/// The result is stored in 16 bits, a step of which is 4.9e-4 below 1.
const TOLERANCE: f64 = 1e-3;
const OPAQUE: u8 = 255;
const RESOLUTION: u32 = 48;
const RAYS: u32 = 32;
const SIZES: [[u32; 2]; 3] = [SIZE, [24, 18], [31, 23]];
/// Of a buffer whose pixels take many rays.
const FEW: [u32; 2] = [6, 4];

pub fn cases() -> Vec<Case> {
    vec![
        Case::new(INFO.name, "a scene's volume", |rig| compare(rig, false, RAYS, &SIZES)),
        Case::new(INFO.name, "two objects' volumes", |rig| compare(rig, true, RAYS, &SIZES)),
        Case::new(INFO.name, "rays of several passes", |rig| compare(rig, true, MANY_RAYS, &[FEW])),
        Case::new(INFO.name, "samples taken", counts),
    ]
}

/// A small G-buffer and its content on the host.
struct DrawnSurface {
    stand: Stand,
    gbuffer: GbufferTextures,
    view_projection: DMat4,
    depth: Image,
    normal: [Image; 3],
}

impl DrawnSurface {
    fn new(rig: &Rig<'_>) -> Result<Self> {
        let stand = rig.stand(Scene::load(SCENE)?, SIZE)?;
        let gbuffer = rig.gbuffer(&stand)?;
        let channel = |i| rig.channel(&gbuffer.normal, i);
        Ok(Self {
            depth: rig.channel(&gbuffer.depth, 0)?,
            normal: [channel(0)?, channel(1)?, channel(2)?],
            view_projection: stand.view.camera.view_projection(stand.view.aspect()),
            gbuffer,
            stand,
        })
    }

    /// Surface behind a pixel of a buffer of `size_px`, none on the background.
    fn surface(&self, (x, y): (u32, u32), size_px: [u32; 2]) -> Option<(DVec3, DVec3)> {
        let [tx, ty] = behind([x.into(), y.into()], size_px, SIZE);
        let z = self.depth.clamped(tx, ty);
        let normal = [0, 1, 2].map(|i| self.normal[i].clamped(tx, ty));
        let place = self.stand.rays.unproject(tx as f64 + 0.5, ty as f64 + 0.5, z);
        (z < 1.0).then(|| (place, DVec3::from(normal).normalize()))
    }
}

/// Volumes around the scene's objects, or one around all: shells of voxels that have a vertex near. They need not be good
/// ones, only the same for GPU and twin.
fn volumes(rig: &Rig<'_>, scene: &Scene, per_object: bool) -> Result<Vec<MarchedVolume>> {
    let ball = scene.objects.iter().map(|o| o.mesh.bounds());
    let ball = ball.min_by(|a, b| a.size().length().total_cmp(&b.size().length()));
    let ball = ball.unwrap_or_else(|| scene.solid_bounds());
    let floor_m = scene.solid_bounds().min.y;
    let radius = 0.5 * ball.size().x;
    let near =
        Bounds { min: ball.min.with_y(floor_m) - 2.0 * radius, max: ball.max + 2.0 * radius };
    let grid = |bounds: &Bounds| Grid::fit(bounds, RESOLUTION).map_err(GpuError::Limit);
    let (all, own) = (grid(&near)?, grid(&ball)?);
    let is_floor = move |p: DVec3, grid: &Grid| (p.y - floor_m).abs() < 0.5 * grid.voxel_m;
    let is_ball = move |p: DVec3, grid: &Grid| {
        (p.distance(ball.center()) - radius).abs() < 0.6 * grid.voxel_m
    };
    Ok(if per_object {
        vec![
            MarchedVolume::on(rig, &all, OPAQUE, |p| is_floor(p, &all)),
            MarchedVolume::on(rig, &own, OPAQUE, |p| is_ball(p, &own)),
        ]
    } else {
        vec![MarchedVolume::on(rig, &all, OPAQUE, |p| is_floor(p, &all) || is_ball(p, &all))]
    })
}

/// The pipeline's defaults with r_max of ten voxels of the largest grid.
fn settings(volumes: &[MarchedVolume]) -> Marching {
    let r_max_m = largest(volumes.iter().map(|v| 10.0 * v.host.grid.voxel_m));
    Marching { r_max_m, ..marching(|_| ()) }
}

fn compare(rig: &Rig<'_>, per_object: bool, rays: u32, sizes: &[[u32; 2]]) -> Checks {
    let seen = DrawnSurface::new(rig)?;
    let subjects = volumes(rig, &seen.stand.scene, per_object)?;
    let voxels: Vec<_> = subjects.iter().map(|s| s.voxels.clone()).collect();
    // Not 0, which draws nothing else.
    let settings = Marching { seed: 3, rays, ..settings(&subjects) };
    let twins: Vec<(&HostVolume, March)> =
        subjects.iter().map(|s| (&s.host, twin(&settings, &s.host.grid))).collect();
    let check = |size_px: [u32; 2]| {
        let (shared, surface) = (&seen.stand.shared, (&seen.gbuffer, seen.view_projection));
        let stage = march::new(rig, shared, &voxels, surface, &settings, size_px)?;
        let image = rig.drawn(&[&stage], stage.texture(), 0)?;
        // As `seed_of` in shaders/shared/marching.wgsl.
        let own = settings.seed.wrapping_mul(0x9E37_79B9);
        let measure = |moved_by: u32, share: f64| {
            largest(pixels(size_px).map(|(x, y)| {
                let value = share * (1.0 - image.at((x, y)));
                let Some((p, n)) = seen.surface((x, y), size_px) else {
                    return value.abs();
                };
                // Thresholds of all volumes move together.
                beyond(value, &twins[0].1, DENSITY_ERROR, |moved| {
                    let open = twins.iter().map(|(host, march)| {
                        let march = March { threshold: moved.threshold, ..march.clone() };
                        let index = (x + 65536 * y + moved_by).wrapping_add(own);
                        1.0 - march.from(host, p, n, index).occlusion
                    });
                    1.0 - open.product::<f64>()
                })
            }))
        };
        let ([w, h], count) = (size_px, voxels.len());
        // Many rays see the same from any pixel.
        let (perturbed, control) = if rays == MANY_RAYS {
            ("a fifth of what the rays meet left out", measure(0, 0.8))
        } else {
            ("directions of the neighbouring pixel", measure(1, 1.0))
        };
        let what = format!("{count} volumes, {w}×{h}, {rays} rays");
        Ok(Check::of(rig, format!("largest |GPU − f64 twin| of A, {what}"))
            .within((TOLERANCE, "1"), measure(0, 1.0))
            .control(perturbed, control))
    };
    sizes.iter().copied().map(check).collect()
}

fn counts(rig: &Rig<'_>) -> Result<Check> {
    let seen = DrawnSurface::new(rig)?;
    let subjects = volumes(rig, &seen.stand.scene, false)?;
    let settings = settings(&subjects);
    let (surface, voxels) = ((&seen.gbuffer, seen.view_projection), [subjects[0].voxels.clone()]);
    let counted = march::count(rig.gpu, &seen.stand.shared, &voxels, surface, &settings, SIZE)?;
    let off = |r_max_scale: f64| {
        let host = &subjects[0].host;
        let mut march = twin(&settings, &host.grid);
        march.r_max *= r_max_scale;
        let samples = pixels(SIZE).filter_map(|(x, y)| {
            let (p, n) = seen.surface((x, y), SIZE)?;
            Some(march.from(host, p, n, x + 65536 * y).samples)
        });
        relative_error(counted.samples as f64, samples.sum::<u64>() as f64)
    };
    // Rays that rounding of V ends a sample earlier or later.
    Ok(Check::of(rig, "samples counted over those of the f64 twin, less 1")
        .within((2e-3, "1"), off(1.0))
        .control("r_max 1.1 times", off(1.1))
        .with("samples_per_fragment", counted.samples as f64 / counted.fragments.max(1) as f64))
}
