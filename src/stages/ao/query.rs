//! `ao/query`: volume ambient occlusion at given points. VAO §3 step 3, §5.1.

use encase::ShaderType;
use glam::Vec3;

use crate::marching::Marching;
use crate::prelude::*;
use crate::voxels::Voxels;

pub const INFO: StageInfo = StageInfo {
    name: "ao/query",
    about: "volume ambient occlusion at given points and normals",
    source: "VAO §3 step 3, §5.1",
};

shader_struct! {
    pub struct SurfacePoint {
        pub position_m: Vec3,
        /// Of unit length.
        pub normal: Vec3,
    }
}

/// `points` holds one point at least. A query answers once: its buffer, 1 − A of each point, starts at 1 and is multiplied.
pub fn new(
    resources: &Resources<'_>,
    volumes: &[Voxels],
    points: &[SurfacePoint],
    marching: &Marching,
) -> Result<Stage<Buffer>, GpuError> {
    let resources = &resources.with_size_hint("points × ao.rays × samples");
    let count = points.len() as u64;
    let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC;
    let input = resources.structs("points", points, usage);
    resources.host_copies("points", input.size());
    let visibility = resources.filled_by(INFO.name, count * 4, usage, || {
        bytemuck::cast_slice(&vec![1f32; points.len()]).to_vec()
    });
    let own = Bindings::new(&[&input, &visibility]);
    let passes = marching.passes(resources, volumes, count)?;
    let mut defs = marching.defs();
    defs.push(passes.def());
    let workgroups = kit::linear_workgroups(count);
    let dispatch =
        |group| Dispatch::new(resources, (INFO.name, &defs[..]), &[&own, group], workgroups);
    // One for each slice of the rays through each volume.
    let dispatches =
        passes.volumes.iter().flatten().map(dispatch).collect::<Result<Vec<_>, _>>()?;
    let samples = volumes.iter().map(|v| marching.samples_in(&v.grid) as u64).sum::<u64>();
    // Trilinear samples at most.
    let work = Work {
        texel_fetches: count * samples * u64::from(marching.rays),
        bytes_read: count * SurfacePoint::min_size().get(),
        bytes_written: count * 4,
        ..Work::default()
    };
    // Closed rays end.
    let min_work = Work { texel_fetches: 0, ..work };
    let open = "share of the cosine-weighted hemisphere that is open";
    let columns = vec![Column::new("visibility", "1", open)];
    let meaning = "1 − A at each point, in the order of the points";
    let rows = (&*visibility, 1, count as u32);
    let output = StageDump::rows("visibility", meaning, columns, rows, <[f32]>::to_vec);
    let stage = Dispatch::stage(dispatches, &INFO, work).with_min_work(min_work);
    Ok(stage.dump(output).with_output(visibility))
}
