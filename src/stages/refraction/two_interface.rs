//! `refraction/two_interface`: refraction through two interfaces, approximated. Wyman 2005, the method that SPT §4 compares with.

use super::{Exits, FORMAT};
use crate::geometry::{Geometry, Objects};
use crate::prelude::*;

pub const INFO: StageInfo = StageInfo {
    name: "refraction/two_interface",
    about: "lines of sight through the nearest and the farthest surface of glass, approximated",
    source: "Wyman 2005",
};

/// Normals of the far side.
const NORMALS: wgpu::TextureFormat = wgpu::TextureFormat::Rgba16Float;

/// `thickness_m` holds the way through the object against the normal, for each vertex.
pub fn new(
    resources: &Resources<'_>,
    shared: &Shared,
    geometry: &Geometry,
    size_px: [u32; 2],
    thickness_m: &Buffer,
) -> Result<Stage<Exits>, GpuError> {
    let depth = || resources.target(INFO.name, size_px, kit::DEPTH_FORMAT);
    let (farthest, nearest) = (depth(), depth());
    let side = |near: bool, group: &Bindings, formats: &[wgpu::TextureFormat], depth: Depth<'_>| {
        let defs = [("SIDE", i32::from(near))];
        let states: Vec<_> = formats.iter().map(|format| kit::opaque(*format)).collect();
        let groups = [&shared.group, group];
        let spec = RenderSpec {
            buffers: &[Geometry::layout(false)],
            depth: Some(depth),
            ..RenderSpec::new((INFO.name, &defs), &groups, &states)
        };
        DrawPass::new(resources, &spec, size_px, wgpu::Color::TRANSPARENT)
    };
    let compare = wgpu::CompareFunction::Greater;
    let tested = Depth { compare, clear: Some(0.0), ..Depth::nearest(&farthest) };
    let far = side(false, &Bindings::new(&[&geometry.materials]), &[NORMALS], tested)?;
    let group = Bindings::new(&[&geometry.materials, &farthest, far.texture(), thickness_m]);
    let near = side(true, &group, &[FORMAT; 2], Depth::nearest(&nearest))?;
    let work = Work {
        triangles: 2 * geometry.triangles_of(Objects::Glass),
        bytes_read: 2 * geometry.bytes(),
        bytes_written: kit::pixels(&nearest) * (4 + 8 + 4 + 32),
        ..Work::default()
    };
    // Of the geometry only one part is drawn, and its bytes are read twice.
    let min_work = Work { bytes_read: 0, ..work };
    let (exits, geometry) = (Exits::from_pass(&near), geometry.clone());
    let stage = Stage::new(&INFO, work, move |scope| {
        for side in [&far, &near] {
            side.render(scope, |pass| geometry.draw(pass, Objects::Glass));
        }
    });
    Ok(stage.with_min_work(min_work).dumps(exits.outputs()).with_output(exits))
}
