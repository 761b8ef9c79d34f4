//! Borders of pictures: what is drawn of photons is the middle of a picture that is three times as wide and as high, seen from the same eye.

use super::{lines, shafts, splats};
use crate::prelude::*;
use fathom_pipelines::underwater::Splatting;
use fathom_stages::caustics::splat;
use fathom_stages::godrays::lines as godrays;
use fathom_stages::shafts::lines as pixel_lines;

/// Of the buffer. The camera's depth is twice as fine.
const SIZE: [u32; 2] = [96, 72];
/// Of the picture's height, half of it: the tangent.
const HALF_HEIGHT: f64 = 0.36;
/// What lies this near to the border is judged.
const BORDER_PX: u32 = 8;
const PHOTONS: u32 = 3000;

/// Draws photons over the camera's depth.
type DrawFn = fn(&Rig<'_>, &View, &[Photon], &wgpu::Texture) -> Result<Image>;

pub fn cases() -> Vec<Case> {
    let lines: DrawFn =
        |rig, view, photons, _| lines::draw_as(rig, view, photons, view.size_px.into(), 3.0, true);
    // Rasterizers move corners by up to 1/32 px, and a line that is cut may begin in another pixel.
    let drawn: [(&str, &str, f64, DrawFn); 4] = [
        (splat::INFO.name, "compute", 1e-3, |rig, view, photons, depth| {
            splats::draw_on_surface(rig, view, photons, depth, Splatting::Compute)
        }),
        (splat::INFO.name, "raster", 1e-3, |rig, view, photons, depth| {
            splats::draw_on_surface(rig, view, photons, depth, Splatting::Raster)
        }),
        (godrays::INFO.name, "quads", 0.01, lines),
        (pixel_lines::INFO.name, "lines", 0.03, |rig, view, photons, _| {
            shafts::draw(rig, view, photons, &rig.depth(view.size_px.into(), 1.0)?)
        }),
    ];
    let case = |(stage, what, most, draw): (&'static str, &'static str, f64, DrawFn)| {
        let name = format!("border of the picture, {what}");
        Case::new(stage, name.clone(), move |rig| {
            let [own, middle] = [drawn_over(rig, 1, draw)?, drawn_over(rig, 3, draw)?];
            let off = |aside: i64| {
                let pairs = pixels(SIZE).filter(|at| is_at_border(*at)).map(|(x, y)| {
                    let [column, row] = [x + SIZE[0], y + SIZE[1]].map(i64::from);
                    (own.get((x, y)), middle.clamped(column + aside, row))
                });
                let (found, exact): (Vec<f64>, Vec<f64>) = pairs.unzip();
                let off = found.iter().zip(&exact).map(|(a, b)| (a - b).abs());
                off.sum::<f64>() / exact.iter().sum::<f64>()
            };
            Ok(Check::new(rig, format!("{name}: Σ |difference| / Σ from a wider picture's middle"))
                .within((most, "1"), off(0))
                .control("a pixel aside", off(1)))
        })
    };
    drawn.into_iter().map(case).collect()
}

fn is_at_border((x, y): (u32, u32)) -> bool {
    [(x, SIZE[0]), (y, SIZE[1])].into_iter().any(|(k, of)| k.min(of - 1 - k) < BORDER_PX)
}

/// A slanted view of a floor, so many times as wide and as high, with photons in the middle and beyond its border.
fn drawn_over(rig: &Rig<'_>, times: u32, draw: DrawFn) -> Result<Image> {
    let fixture = |times: u32| -> Result<Fixture> {
        let mut scene = rig::flat_plane(LightKind::Directional)?;
        (scene.camera.up, scene.camera.target_m) = ([0.3, 1.0, 0.1], [0.0, -5.0, 0.0]);
        scene.camera.fov_y_deg = 2.0 * (HALF_HEIGHT * f64::from(times)).atan().to_degrees();
        rig.fixture(scene, SIZE.map(|side| 2 * times * side))
    };
    let (own, wider) = (fixture(1)?, fixture(times)?);
    let mut random = Random::new(13);
    let photon = |_| {
        let [x, y] = SIZE.map(|side| 2.0 * f64::from(side) * random.within(-0.2, 1.2));
        let (origin, direction, _) = own.rays.ray_at(x, y);
        let hit = own.tracer.cast(origin, direction, 0.0, f64::MAX)?.position;
        let entry = hit + DVec3::new(random.within(-0.5, 0.5), 0.7, random.within(-0.5, 0.5));
        Some(rig::photon(entry, hit, entry.distance(hit)))
    };
    let photons: Vec<Photon> = (0..PHOTONS).filter_map(photon).collect();
    let depth = rig.gbuffer(&wider)?.depth;
    let view = View { size_px: wider.view.size_px / 2, ..wider.view };
    draw(rig, &view, &photons, &depth)
}
