//! Stages of family `scalar` on small fields against closed forms and f64 marching.

mod frames;
mod isosurface;
mod media;

use super::voxel::subjects;
use crate::prelude::*;
use fathom_pipelines::scalar_ao::{self, Law, Mode, Scalar};
use fathom_stages::ray_cast::Cast;
use fathom_stages::scalar_field::{self, ScalarField};

pub fn cases() -> Vec<Case> {
    let families = [frames::cases(), isosurface::cases(), media::cases()];
    families.into_iter().flatten().collect()
}

/// Edge of a cubic cell, metres.
const VOXEL_M: f64 = 0.1;

/// A field seen by a camera, and how it is marched.
#[derive(Clone)]
struct Setup {
    volume: Volume,
    scalar: Scalar,
    camera: Camera,
    size_px: [u32; 2],
}

/// Of red, green and blue: unequal, so that none can take another's place.
const COLOR_WEIGHTS: DVec3 = DVec3::new(0.2, 0.3, 0.5);

/// What a stage left behind, pixel by pixel.
struct ScalarPicture {
    visibility: Image,
    opacity: Image,
    distance_m: Image,
    look_ups: Image,
    /// The displayed colour times [`COLOR_WEIGHTS`].
    shown: Image,
    /// Only of an isosurface.
    normal: Option<[Image; 3]>,
}

impl Setup {
    fn view(&self) -> Result<View> {
        Ok(View { camera: self.camera.clone(), ..rig::synthetic_view(self.size_px, 0.0)? })
    }

    fn run(&self, rig: &Rig<'_>) -> Result<ScalarPicture> {
        let shared = Shared::new(rig, &self.view()?);
        let field = ScalarField::new(rig, &self.volume, self.scalar.needs_pyramid());
        let (settings, r_max_m) = (&self.scalar, self.scalar.r_max_m);
        let pass = scalar_ao::cast(rig, &shared, &field, settings, self.size_px, r_max_m)?;
        rig.run(&[&pass])?;
        ScalarPicture::read(rig, &pass)
    }
}

impl ScalarPicture {
    fn read(rig: &Rig<'_>, pass: &Cast) -> Result<ScalarPicture> {
        let channel = |i| rig.channel(&pass.result, i);
        let axes = |normal| -> Result<[Image; 3]> {
            Ok([rig.channel(normal, 0)?, rig.channel(normal, 1)?, rig.channel(normal, 2)?])
        };
        let size_px = [pass.image.width(), pass.image.height()];
        let colors = Texels::read(rig, &pass.image)?;
        Ok(ScalarPicture {
            visibility: channel(0)?,
            opacity: channel(1)?,
            distance_m: channel(2)?,
            look_ups: channel(3)?,
            shown: Image::from_fn(size_px, |x, y| colors.get((x, y)).truncate().dot(COLOR_WEIGHTS)),
            normal: pass.normal.as_ref().map(axes).transpose()?,
        })
    }
}

/// Marching that leaves nothing out.
fn settings(mode: Mode) -> Scalar {
    Scalar { mode, rejection: false, threshold: 1.0, pyramid: false, ..Scalar::default() }
}

/// A field of cells of edges `spacing_m`, centred on the world's origin, of values that 8 bits hold.
fn field(cells: [u32; 3], spacing_m: DVec3, f: impl Fn(DVec3) -> f64) -> Volume {
    unrounded(cells, spacing_m, |p| (f(p).clamp(0.0, 1.0) * 255.0).round() / 255.0)
}

fn unrounded(cells: [u32; 3], spacing_m: DVec3, f: impl Fn(DVec3) -> f64) -> Volume {
    let origin_m = -0.5 * spacing_m * DVec3::from(cells.map(f64::from));
    let centre = |cell: [u32; 3]| origin_m + spacing_m * (DVec3::from(cell.map(f64::from)) + 0.5);
    let data =
        subjects::cells(&subjects::plain(cells)).map(|cell| f(centre(cell)) as f32).collect();
    Volume { name: "verify".into(), cells, origin_m, spacing_m, data }
}

fn cubes(cells: u32, f: impl Fn(DVec3) -> f64) -> Volume {
    field([cells; 3], DVec3::splat(VOXEL_M), f)
}

/// A camera whose view rays run through one point alone, as good as: a hundredth of a voxel from plane to plane.
fn probe(point: DVec3) -> Camera {
    let mut camera = looking(point, point - DVec3::new(0.3, 0.2, 1.0));
    camera.z_near_m = 0.01 * VOXEL_M;
    camera.z_far_m = 0.02 * VOXEL_M;
    camera
}

fn looking(position: DVec3, target: DVec3) -> Camera {
    Camera::new(position.to_array(), target.to_array(), 30.0, [0.1, 20.0])
}
