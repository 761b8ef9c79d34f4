//! What pictures are made from, known exactly, and what each pixel of them may show.

use std::f64::consts::SQRT_2;

use crate::prelude::*;
use fathom_gpu::kit;
use fathom_gpu::read_texture;
use half::f16;
use half::slice::HalfFloatSliceExt as _;

/// Half a step of 8 bits, and rounding before it.
pub const DISPLAY_STEP: f64 = 0.51 / 255.0;
/// Vulkan lets a rasterizer move corners by 1/32 pixel (`subPixelPrecisionBits` of 4): what is interpolated lies among what is seen at these places
/// around a pixel's middle.
pub const SHIFTS_PX: [[f64; 2]; 5] = [
    [0.0, 0.0],
    [-NEAR_PX, -NEAR_PX],
    [NEAR_PX, -NEAR_PX],
    [-NEAR_PX, NEAR_PX],
    [NEAR_PX, NEAR_PX],
];
const NEAR_PX: f64 = 1.0 / 32.0;

/// Share of pixels at creases and slits, where a rasterizer may draw what no ray near the pixel meets: 6 of 6,912 on SwiftShader.
pub const EDGES: f64 = 2e-3;

/// What a texture holds.
pub struct Texels {
    pub texture: wgpu::Texture,
    /// Four for each texel.
    values: Vec<f32>,
}

impl Texels {
    /// 16-bit floats, which can be filtered everywhere.
    pub fn new(rig: &Rig<'_>, size: [u32; 2], texel: impl FnMut((u32, u32)) -> DVec4) -> Self {
        let format = wgpu::TextureFormat::Rgba16Float;
        let values: Vec<f32> =
            pixels(size).map(texel).flat_map(|v| v.to_array().map(cut_to_half)).collect();
        let halves: Vec<f16> = values.iter().map(|value| f16::from_f32(*value)).collect();
        let texels = || bytemuck::pod_collect_to_vec(halves.reinterpret_cast());
        Self { texture: rig.fixed_texture("verify texels", size, format, texels), values }
    }

    /// Each channel noise in 0…1.
    pub fn noise(rig: &Rig<'_>, size: [u32; 2], seed: u32) -> Self {
        let mut random = Random::new(seed);
        Self::new(rig, size, |_| DVec4::from([(); 4].map(|()| random.number())))
    }

    /// What a stage draws.
    pub fn draw(rig: &Rig<'_>, stage: &Stage<wgpu::Texture>) -> Result<Self> {
        rig.run(&[stage])?;
        Self::read(rig, stage.texture())
    }

    pub fn read(rig: &Rig<'_>, texture: &wgpu::Texture) -> Result<Self> {
        let values = read_texture(rig.gpu, texture)?.data;
        Ok(Self { texture: texture.clone(), values })
    }

    /// Clamped at the border.
    pub fn at(&self, texel: [i64; 2]) -> DVec4 {
        let size = kit::size_px(&self.texture);
        let [x, y] = [0, 1].map(|k| texel[k].clamp(0, i64::from(size[k]) - 1) as usize);
        let first = 4 * (y * size[0] as usize + x);
        DVec4::from([0, 1, 2, 3].map(|k| f64::from(self.values[first + k])))
    }

    pub fn get(&self, (x, y): (u32, u32)) -> DVec4 {
        self.at([x.into(), y.into()])
    }

    /// Between texels, at a place of 0…1.
    pub fn bilinear(&self, uv: DVec2) -> DVec4 {
        let size = kit::size_px(&self.texture);
        corners(uv, size).map(|(weight, texel)| weight * self.at(texel)).into_iter().sum()
    }
}

/// The four texels around a place of 0…1, with their bilinear weights. They may lie beyond the border.
pub fn corners(uv: DVec2, size: [u32; 2]) -> [(f64, [i64; 2]); 4] {
    let place = uv * UVec2::from(size).as_dvec2() - 0.5;
    [0, 1, 2, 3].map(|k: i32| {
        let texel = place.floor() + DVec2::new(f64::from(k & 1), f64::from(k >> 1));
        let near = 1.0 - (place - texel).abs();
        (near.x * near.y, [texel.x as i64, texel.y as i64])
    })
}

/// What a 16-bit float holds of a number, cut off; less than its least normal number is nothing.
fn cut_to_half(value: f64) -> f32 {
    let cut = f32::from_bits((value as f32).to_bits() & !0x1fff);
    if cut.abs() < 1e-4 { 0.0 } else { cut }
}

/// What a camera sees, each pixel of a colour and a normal of its own, so that no other pixel's can stand for them.
pub struct NoisySurfaces<'a> {
    pub fixture: &'a Fixture,
    pub light: PictureLight,
    pub gbuffer: GBuffer,
    pub depth: Image,
    pub albedo: Texels,
    /// The specular coefficient in w.
    pub normal: Texels,
}

/// What a pixel shows.
#[derive(Clone, Copy)]
pub struct SeenSurface {
    pub position: DVec3,
    pub normal: DVec3,
    pub albedo: DVec3,
}

impl SeenSurface {
    /// Radiance in such light: Lambert's law.
    pub fn lit(&self, irradiance: DVec3) -> DVec3 {
        self.albedo / PI * irradiance
    }
}

impl<'a> NoisySurfaces<'a> {
    /// With normals within 45 degrees of those of each pixel that are not zero.
    pub fn new(
        rig: &Rig<'_>,
        fixture: &'a Fixture,
        normal: impl Fn((u32, u32)) -> DVec3,
    ) -> Result<Self> {
        let size = fixture.view.size_px.to_array();
        let depth = rig.gbuffer(fixture)?.depth;
        let albedo = Texels::noise(rig, size, 101);
        let mut random = Random::new(13);
        let normal = Texels::new(rig, size, |at| {
            (normal(at) * SQRT_2 + random.direction()).normalize().extend(random.number())
        });
        let (albedo_texels, normal_texels) = (albedo.texture.clone(), normal.texture.clone());
        Ok(Self {
            fixture,
            light: fixture.light(),
            depth: rig.channel(&depth, 0)?,
            gbuffer: GBuffer { albedo: albedo_texels, normal: normal_texels, depth },
            albedo,
            normal,
        })
    }

    pub fn seen(&self, (x, y): (u32, u32)) -> Option<SeenSurface> {
        let at = rig::middle((x, y));
        (self.depth.get((x, y)) < 1.0).then(|| self.surface(at, [x.into(), y.into()]))
    }

    /// What a texel holds, where the line of sight through a place of the picture, in pixels, has its depth.
    pub fn surface(&self, px: DVec2, texel: [i64; 2]) -> SeenSurface {
        let depth = self.depth.clamped(texel[0], texel[1]);
        SeenSurface {
            position: self.fixture.rays.unproject(px.x, px.y, depth),
            normal: self.normal.at(texel).truncate(),
            albedo: self.albedo.at(texel).truncate(),
        }
    }

    pub fn sight(&self, (x, y): (u32, u32)) -> DVec3 {
        self.fixture.rays.ray(x, y).1
    }

    /// Sky and light of a surface without photons.
    pub fn irradiance(&self, seen: &SeenSurface) -> f64 {
        let SeenSurface { position, normal, .. } = *seen;
        self.light.ambient(position, normal) + self.light.direct(position, normal)
    }

    /// Seen through the water before it.
    pub fn through_water(&self, seen: &SeenSurface, radiance: DVec3) -> DVec3 {
        self.light.fogged(radiance, self.light.wet_m(seen.position))
    }
}

/// What a display shows of a radiance, opaque.
pub fn displayed(radiance: DVec3, exposure: f64) -> DVec4 {
    radiance.map(|value| tone_mapped(value, exposure)).extend(1.0)
}

/// How far each channel lies outside of what it may be, less than 0 within it; not a number where nothing is known.
pub fn excess(shown: DVec4, allowed: &[DVec4]) -> DVec4 {
    let bound = |bound: fn(DVec4, DVec4) -> DVec4| allowed.iter().copied().reduce(bound);
    match (bound(DVec4::min), bound(DVec4::max)) {
        (Some(low), Some(high)) => (low - shown).max(shown - high),
        _ => DVec4::NAN,
    }
}

/// The largest that a picture lies outside of what its pixels may show.
pub fn largest_excess(shown: &Texels, allowed: impl Fn((u32, u32)) -> Vec<DVec4>) -> f64 {
    let size = kit::size_px(&shown.texture);
    largest(pixels(size).map(|at| excess(shown.get(at), &allowed(at)).max_element()))
}

/// Share of pixels that lie outside by more than a display's rounding.
pub fn share_unlike(shown: &Texels, allowed: impl Fn((u32, u32)) -> Vec<DVec4>) -> f64 {
    let size = kit::size_px(&shown.texture);
    share(pixels(size).map(|at| {
        let outside = excess(shown.get(at), &allowed(at));
        !outside.cmple(DVec4::splat(DISPLAY_STEP)).all()
    }))
}
