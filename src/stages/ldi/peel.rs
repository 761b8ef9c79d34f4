//! `ldi/peel`: layers of depth, normals of triangles and interpolated normals from the camera, one after the other. SPT §2.2.

use crate::flat_triangles::FlatTriangles;
use crate::geometry::{Geometry, Objects};
use crate::prelude::*;
use crate::screen_ray::Layers;
use fathom_gpu::kit::Layer;
use fathom_scene::Scene;

pub const INFO: StageInfo = StageInfo {
    name: "ldi/peel",
    about: "layered depth image by depth peeling: a pass over all triangles for each layer",
    source: "SPT §2.2",
};

/// `count` layers, one at least, of a part of the scene.
pub fn new(
    resources: &Resources<'_>,
    shared: &Shared,
    scene: &Scene,
    geometry: &Geometry,
    part: Objects,
    size_px: [u32; 2],
    count: u32,
) -> Result<Stage<Layers>, GpuError> {
    let layers = Layers::drawn(resources, INFO.name, size_px, count.max(1));
    let targets = [kit::opaque(Layers::SURFACES)];
    let triangles = FlatTriangles::new(resources, scene, part);
    let peel = |layer: u32| {
        let before = layer.checked_sub(1).map(|before| Layer(&layers.depths, before));
        let groups = [&shared.group, &Bindings::new(&[&geometry.materials]).and(&before)];
        let defs = [("FIRST", i32::from(layer == 0))];
        let spec = RenderSpec {
            buffers: &[FlatTriangles::layout()],
            depth: Some(Depth { layer, ..Depth::nearest(&layers.depths) }),
            ..RenderSpec::new((INFO.name, &defs), &groups, &targets)
        };
        let (view, surfaces) = (kit::layer_view(&layers.surfaces, layer), layers.surfaces.clone());
        DrawPass::over(resources, &spec, vec![(view, Some(wgpu::Color::TRANSPARENT), surfaces)])
    };
    let peels = (0..layers.count()).map(peel).collect::<Result<Vec<_>, _>>()?;
    let drawn = u64::from(layers.count());
    let work = Work {
        triangles: drawn * triangles.triangles(),
        bytes_read: drawn * triangles.bytes(),
        bytes_written: drawn * kit::pixels(&layers.depths) * (4 + 16),
        ..Work::default()
    };
    // Later layers may find the triangles in a cache.
    let min_work = Work { bytes_read: triangles.bytes(), ..work };
    let stage = Stage::new(&INFO, work, move |scope| {
        for peel in &peels {
            peel.render(scope, |pass| triangles.draw(pass));
        }
    });
    Ok(stage.with_min_work(min_work).dump(layers.output()).with_output(layers))
}
