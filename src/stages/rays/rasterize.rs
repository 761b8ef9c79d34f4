//! `rays/rasterize`: a line for each photon into its own row; each fragment is held against all layers. SPT §2.1.

use crate::prelude::*;
use crate::screen_ray::RayInputs;

pub const INFO: StageInfo = StageInfo {
    name: "rays/rasterize",
    about: "photon rays as lines, a row of pixels each, every pixel held against all layers",
    source: "SPT §2.1",
};

/// Distance of a pixel that hits nothing: `NO_HIT` in `shaders/shared/screen_ray.wgsl`.
pub const NO_HIT: f32 = 1e30;

/// The stage leaves the distance along the ray where a pixel hits, metres: a photon a row, a step a column.
pub fn new(
    resources: &Resources<'_>,
    shared: &Shared,
    rays: &RayInputs<'_>,
) -> Result<Stage<wgpu::Texture>, GpuError> {
    let groups = [&shared.group, &rays.group(resources, INFO.name, None)];
    let defs = rays.defs();
    let targets = [kit::opaque(wgpu::TextureFormat::R32Float)];
    let spec = RenderSpec {
        topology: wgpu::PrimitiveTopology::LineList,
        ..RenderSpec::new((INFO.name, &defs), &groups, &targets)
    };
    let clear = wgpu::Color { r: f64::from(NO_HIT), ..wgpu::Color::BLACK };
    let (rows, tiles, photons) = (rays.rows(), rays.tiles(), rays.transfers.count);
    let pass = DrawPass::new(resources, &spec, [rays.max_steps(), rows], clear)?;
    let primitives = rays.work().photons;
    let fragments = primitives * u64::from(rays.max_steps());
    let work = Work { primitives, fragments, bytes_written: fragments * 4, ..rays.work() };
    // Rays end early, and all turns write to the same target.
    let min_work = Work { primitives, bytes_written: pass.pixels() * 4, ..Work::default() };
    let hits = pass.texture().clone();
    let stage = Stage::new(&INFO, work, move |scope| {
        let first = scope.iteration() % tiles * rows;
        let last = (first + rows).min(photons);
        pass.render(scope, |pass| pass.draw(0..2, first..last));
    });
    let column =
        Column::new("distance_m", "m", "from the start of the ray; 1e30 where nothing is hit");
    let meaning = "hits of the last tile of photons: a photon a row, a step a column";
    // A turn for each tile of rows and each way.
    let stage = stage.with_min_work(min_work).with_iterations(tiles * rays.walking.path_segments);
    // Photons that end on a way are not traced on the next.
    let stage = stage.with_spent_inputs(rays.walking.path_segments > 1).with_output(hits);
    Ok(stage.dump_as("hits", meaning, vec![column]))
}
