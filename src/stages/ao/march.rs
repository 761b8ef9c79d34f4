//! `ao/march`: ambient occlusion of what the camera sees, by marching rays through volumes. VAO §3 step 3, §5.1.

use glam::{DMat4, UVec2};

use crate::bilateral::{VISIBILITY_FORMAT, visible};
use crate::counters::Counters;
use crate::gbuffer::GBuffer;
use crate::marching::Marching;
use crate::prelude::*;
use crate::voxels::Voxels;
use fathom_gpu::kit::{Canvas, Raster};
use fathom_scene::Bounds;

pub const INFO: StageInfo = StageInfo {
    name: "ao/march",
    about: "volume ambient occlusion: rays marched through the volumes from every pixel",
    source: "VAO §3 step 3, §5.1",
};

shader_struct! {
    pub struct TargetUniforms {
        /// Pixels of the occlusion buffer.
        pub size_px: UVec2,
    }
}

/// A volume's passes and the pixels that it can reach.
struct Draws {
    /// One for each slice of the rays.
    rasters: Vec<Raster>,
    /// x, y, width, height.
    scissor: [u32; 4],
    samples: u64,
}

impl Draws {
    fn pixels(&self) -> u64 {
        u64::from(self.scissor[2]) * u64::from(self.scissor[3])
    }
}

/// The occlusion buffer, 1 − A, 1 where nothing was drawn, has `size_px` pixels; it may be smaller than the viewport. Rectangles of the
/// pixels that volumes can reach follow from `view_projection`, world to clip space.
/// With `counters` the shader also counts trilinear samples, look-ups of the pyramid, and fragments that marched, once for each volume.
pub fn new(
    resources: &Resources<'_>,
    shared: &Shared,
    volumes: &[Voxels],
    (gbuffer, view_projection): (&GBuffer, DMat4),
    marching: &Marching,
    size_px: [u32; 2],
    counters: Option<&Counters>,
) -> Result<Stage<wgpu::Texture>, GpuError> {
    let mut defs = marching.defs();
    defs.push(("COUNT", i32::from(counters.is_some())));
    let settings = TargetUniforms { size_px: size_px.into() };
    let uniforms = resources.uniform(INFO.name, &settings);
    let inputs = Bindings::new(&[&uniforms, &gbuffer.depth, &gbuffer.normal]).and(counters);
    let pixels = u64::from(size_px[0]) * u64::from(size_px[1]);
    let passes = marching.passes(resources, volumes, pixels)?;
    defs.push(passes.def());
    if passes.def().1 == 1 {
        resources.fragment_writes(INFO.name);
    }
    let targets = [kit::multiplicative(VISIBILITY_FORMAT)];
    let spec = RenderSpec::new((INFO.name, &defs[..]), &[], &targets);
    let raster = |group: &Bindings| {
        let groups = [&shared.group, group, &inputs];
        Raster::new(resources, &RenderSpec { groups: &groups, ..spec.clone() })
    };
    let mut drawn = Vec::new();
    for (groups, voxels) in passes.volumes.iter().zip(volumes) {
        let rasters = groups.iter().map(raster).collect::<Result<_, _>>()?;
        let offset_m = (marching.offset_voxels + marching.shift_voxels.abs()) * voxels.grid.voxel_m;
        let reach = grown(&voxels.grid.bounds(), marching.r_max_m + offset_m);
        let Some(scissor) = rectangle(&view_projection, &reach, size_px) else { continue };
        drawn.push(Draws { rasters, scissor, samples: marching.samples_in(&voxels.grid) as u64 });
    }
    let work = work(&drawn, marching.rays);
    // The background has no samples, and closed rays end.
    let least = Work { texel_fetches: 0, ..work };
    let canvas = Canvas::new(resources, &spec, size_px, wgpu::Color::WHITE);
    let texture = canvas.textures[0].clone();
    let slices = drawn.iter().map(|volume| volume.rasters.len()).max().unwrap_or(1);
    let stage = Stage::new(&INFO, work, move |scope| {
        // A pass adds to the sums of the one before it.
        canvas.series(scope, slices, |number, pass| {
            for Draws { rasters, scissor: [x, y, width, height], .. } in &drawn {
                let Some(raster) = rasters.get(number) else { continue };
                raster.bind(pass);
                pass.set_scissor_rect(*x, *y, *width, *height);
                kit::draw_fullscreen(pass);
            }
        });
    });
    Ok(visible(stage.with_min_work(least).with_output(texture), "visibility"))
}

/// Fragments of the volumes' rectangles, and trilinear samples at most: rays end early at hits and at the volume's border.
fn work(drawn: &[Draws], rays: u32) -> Work {
    let fragments = drawn.iter().map(Draws::pixels).sum();
    let samples = |volume: &Draws| volume.pixels() * u64::from(rays) * volume.samples;
    let texel_fetches = drawn.iter().map(samples).sum();
    Work { fragments, texel_fetches, bytes_written: fragments * 2, ..Work::default() }
}

fn grown(bounds: &Bounds, by: f64) -> Bounds {
    Bounds { min: bounds.min - by, max: bounds.max + by }
}

/// The pixels that a box can cover (x, y, width, height): the whole image where the box reaches behind the eye, none where it
/// lies beside the image. VAO §3.
fn rectangle(view_projection: &DMat4, bounds: &Bounds, size_px: [u32; 2]) -> Option<[u32; 4]> {
    let corners = bounds.corners().map(|p| *view_projection * p.extend(1.0));
    if corners.iter().any(|clip| clip.w <= 0.0) {
        return Some([0, 0, size_px[0], size_px[1]]);
    }
    let span = |place: &dyn Fn(usize) -> f64, size: u32| {
        let places = (0..8).map(place);
        let low = places.clone().fold(f64::INFINITY, f64::min);
        let high = places.fold(f64::NEG_INFINITY, f64::max);
        let clamped = |x: f64| (x * f64::from(size)).clamp(0.0, f64::from(size));
        (clamped(low).floor() as u32, clamped(high).ceil() as u32)
    };
    let (left, right) = span(&|i| 0.5 + 0.5 * corners[i].x / corners[i].w, size_px[0]);
    let (top, bottom) = span(&|i| 0.5 - 0.5 * corners[i].y / corners[i].w, size_px[1]);
    (right > left && bottom > top).then_some([left, top, right - left, bottom - top])
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use fathom_scene::Camera;

    #[test]
    fn rectangles_hold_what_a_box_covers() {
        let camera = Camera::new([0.0, 0.0, 5.0], [0.0; 3], 90.0, [0.1, 100.0]);
        let m = camera.view_projection(1.0);
        let cube = |center: DVec3, half: f64| grown(&Bounds { min: center, max: center }, half);
        // At 4 m the image spans 8 m: the near face of a cube of 2 m covers a quarter of it.
        let seen = rectangle(&m, &cube(DVec3::ZERO, 1.0), [80, 80]);
        assert_eq!(seen, Some([30, 30, 20, 20]));
        assert_eq!(rectangle(&m, &cube(DVec3::X * 50.0, 1.0), [80, 80]), None);
        let around = cube(DVec3::ZERO, 20.0);
        assert_eq!(rectangle(&m, &around, [80, 40]), Some([0, 0, 80, 40]));

        // Any place of any box that is in view lies in its rectangle, and not always in that of half the box.
        let mut missed = [0, 0];
        for i in 0..4000 {
            let at = |k: f64| DVec3::new(0.819_173, 0.671_044, 0.549_700) * (f64::from(i) + k);
            let [center, place] = [at(0.0), at(0.5)].map(|v| 2.0 * v.fract() - 1.0);
            let (center, half) = (6.0 * center, 2.0 * at(0.3).fract().x);
            let clip = m * (center + half * place).extend(1.0);
            let pixel = [clip.x, -clip.y].map(|x| 40.0 * (1.0 + x / clip.w));
            if clip.w <= 0.0 || pixel.iter().any(|x| !(0.0..80.0).contains(x)) {
                continue;
            }
            let holds = |[x, y, width, height]: [u32; 4]| {
                let [right, bottom] = [x + width, y + height].map(f64::from);
                (f64::from(x)..right).contains(&pixel[0])
                    && (f64::from(y)..bottom).contains(&pixel[1])
            };
            for (missed, half) in missed.iter_mut().zip([half, 0.5 * half]) {
                *missed +=
                    u32::from(!rectangle(&m, &cube(center, half), [80, 80]).is_some_and(holds));
            }
        }
        assert!(missed[0] == 0 && missed[1] > 100, "{missed:?}");
    }
}
