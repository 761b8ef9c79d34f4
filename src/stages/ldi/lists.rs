//! `ldi/lists`: every fragment into the list of its pixel, in one pass over the triangles.

use glam::UVec2;

use crate::geometry::{Geometry, Part};
use crate::prelude::*;
use crate::screen_ray::FragmentLists;

pub const INFO: StageInfo = StageInfo {
    name: "ldi/lists",
    about: "every fragment into the list of its pixel, in one pass over the triangles",
    source: "Yang et al. 2010, §3; SPT §6",
};

/// Format of the target that a render pass must have: nothing is written to it.
const DUMMY: wgpu::TextureFormat = wgpu::TextureFormat::R8Unorm;

shader_struct! {
    /// `Lists` in `shaders/ldi/lists.wgsl`.
    pub struct ListUniforms {
        pub width: u32,
        pub capacity: u32,
    }
}

shader_struct! {
    /// `Node` in `shaders/shared/fragment_list.wgsl`.
    pub struct Node {
        pub depth: f32,
        pub next: u32,
        pub surface: UVec2,
    }
}

/// With room for so many fragments a pixel, on average.
pub fn new(
    resources: &Resources<'_>,
    shared: &Shared,
    (geometry, part): (&Geometry, Part),
    size_px: [u32; 2],
    per_pixel: u32,
) -> Result<Stage<FragmentLists>, GpuError> {
    let pixels = u64::from(size_px[0]) * u64::from(size_px[1]);
    let room = pixels * u64::from(per_pixel);
    resources.indexed(INFO.name, room);
    let heads = resources.storage(INFO.name, (pixels + 1) * 4);
    let nodes = resources.room_for::<Node>(INFO.name, room);
    let capacity = u32::try_from(room).unwrap_or(u32::MAX);
    let uniforms = resources.uniform(INFO.name, &ListUniforms { width: size_px[0], capacity });
    let own = Group::new(&[&uniforms, &heads, &nodes, &geometry.materials]);
    let (groups, targets) = ([&shared.group, &own], [kit::unwritten(DUMMY)]);
    let spec = RenderSpec {
        buffers: &[Geometry::layout(false)],
        ..RenderSpec::new(INFO.name, &groups, &targets)
    };
    let pass = Pass::new(resources, &spec, size_px, None)?;
    let work = Work {
        triangles: geometry.triangles_of(part),
        bytes_read: geometry.bytes(),
        bytes_written: heads.size() + nodes.size(),
        ..Work::default()
    };
    // Heads are cleared; nodes are as many as fragments.
    let least = Work { bytes_read: 0, bytes_written: heads.size(), ..work };
    let (geometry, lists) = (geometry.clone(), FragmentLists { heads, nodes, size_px, capacity });
    let heads = lists.heads.clone();
    let stage = Stage::new(&INFO, work, move |scope| {
        scope.copy(|encoder| encoder.clear_buffer(&heads, 0, None));
        pass.render(scope, |pass| geometry.draw(pass, part));
    });
    Ok(stage.at_least(least).leaving(lists))
}
