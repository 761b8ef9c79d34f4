//! What `voxel/overlap` and `voxel/alpha` are: triangles against voxels, in three dispatches.
//!
//! The first empties a queue. The second takes a triangle an invocation; triangles of many columns of voxels would keep their
//! workgroup waiting: they go to the queue. In the third a workgroup takes each large triangle, and all workgroups share each
//! huge one.

use super::clear::Cleared;
use super::{VoxelPart, bit_volumes, triangles};
use crate::geometry::Geometry;
use crate::prelude::*;
use crate::voxels::Voxels;
use fathom_gpu::MAX_ITERATIONS;
use fathom_scene::Grid;

/// Columns of voxels above which a triangle is large, and above which it is huge. Tuned on scenes bunny_dry and room, on a software
/// driver and with workgroups of a GPU in mind: more columns leave a few invocations of a workgroup at work for long.
const SMALL_COLUMNS: u32 = 32;
const LARGE_COLUMNS: u32 = 4096;
/// Workgroups of the dispatch of large triangles. Tuned likewise.
const LARGE_GROUPS: u32 = 128;

/// Invocations of a workgroup.
const GROUP: u64 = 64;
/// Turns of loops in a column at most: w is the axis nearest to the normal, so that a triangle's plane passes no more than four voxels of
/// it. With the column's own turn, the loop's end, and one for rounding.
const COLUMN_TURNS: u64 = 7;
/// Animated triangles are up to so many times as long as at rest.
const STRETCH: f64 = 2.0;

shader_struct! {
    pub struct BatchUniforms {
        pub first_index: u32,
        pub triangles: u32,
        /// Columns above which a triangle is large, and above which it is huge.
        pub small_columns: u32,
        pub large_columns: u32,
    }
}

/// What is filled.
pub struct Filled {
    /// What must be cleared before each frame.
    pub cleared: Vec<Cleared>,
    /// If asked for, each volume's largest alphas, 0 … 255 in a word a voxel.
    pub alphas: Vec<Buffer>,
}

/// The stage `info`. `with_alpha` also stores the largest alpha of the triangles that touch a voxel.
pub(super) fn new(
    resources: &Resources<'_>,
    info: &'static StageInfo,
    geometry: &Geometry,
    parts: &[VoxelPart],
    with_alpha: bool,
) -> Result<Stage<Filled>, GpuError> {
    let run = |part: &VoxelPart| VolumeRun::new(resources, info.name, geometry, part, with_alpha);
    let runs = parts.iter().map(run).collect::<Result<Vec<_>, _>>()?;
    let alphas: Vec<Buffer> = runs.iter().filter_map(|run| run.alphas.clone()).collect();
    let bits = parts.iter().map(|part| &part.voxels.bits);
    let cleared = bits.chain(&alphas).map(Cleared::from).collect();
    let work =
        Work { triangles: triangles(parts), bytes_read: geometry.bytes(), ..Work::default() };
    // A compute pass: no rasterizer draws the triangles.
    let min_work = Work { triangles: 0, ..work };
    let stage = Stage::new(info, work, move |scope| {
        scope.compute(|pass| {
            for step in 0..STEPS {
                runs.iter().for_each(|run| run.dispatches[step].run(pass));
            }
        });
    });
    let outputs = bit_volumes(parts.iter().map(|part| &part.voxels));
    Ok(stage.with_min_work(min_work).dumps(outputs).with_output(Filled { cleared, alphas }))
}

/// The queue, small triangles, large ones.
const STEPS: usize = 3;

/// One volume's share.
struct VolumeRun {
    /// Of each step.
    dispatches: Vec<Dispatch>,
    alphas: Option<Buffer>,
}

/// A line may take all voxels of each column, and an invocation all columns of a small triangle.
fn small_columns(grid: &Grid) -> u32 {
    let longest = grid.cells.into_iter().max().unwrap_or(0);
    SMALL_COLUMNS.min(MAX_ITERATIONS as u32 / (longest + COLUMN_TURNS as u32))
}

impl VolumeRun {
    fn new(
        resources: &Resources<'_>,
        name: &'static str,
        geometry: &Geometry,
        part: &VoxelPart,
        with_alpha: bool,
    ) -> Result<Self, GpuError> {
        let (voxels, triangles) = (&part.voxels, part.triangles());
        let load = WorkBound::count(geometry, part);
        let layers = load.layers();
        resources.iterations("triangles and voxels", load.loop_bound(layers));
        let batch = BatchUniforms {
            first_index: part.indices.start,
            triangles: triangles as u32,
            small_columns: small_columns(&voxels.grid),
            large_columns: LARGE_COLUMNS,
        };
        let batch = resources.uniform(name, &batch);
        // Two counters, and a word for each triangle.
        let queue = resources.storage("voxel queue", (2 + triangles) * 4);
        let alphas = with_alpha.then(|| resources.storage("voxel alphas", voxels.grid.count() * 4));
        let Voxels { uniforms, bits, .. } = voxels;
        let Geometry { vertices, indices, materials, .. } = geometry;
        let group = Bindings::new(&[uniforms, &batch, vertices, indices, bits, &queue]);
        let group = group.and(alphas.as_ref().map(|_| materials)).and(&alphas);
        let small = kit::linear_workgroups(triangles);
        let workgroups: [_; STEPS] = [[1, 1, 1], small, [LARGE_GROUPS, 1, layers as u32]];
        let dispatch = |(step, workgroups): (i32, [u32; 3])| {
            Dispatch::new(resources, (name, &[("STEP", step)]), &[&group], workgroups)
        };
        let dispatches = (0..).zip(workgroups).map(dispatch).collect::<Result<_, _>>()?;
        Ok(Self { dispatches, alphas })
    }
}

/// What the third dispatch has to do at most.
#[derive(Default)]
struct WorkBound {
    large: u64,
    huge: u64,
    /// Columns of the largest triangle, and of all huge ones.
    max_columns: u64,
    huge_columns: u64,
    /// Those that are lines, whose planes bound no column, and the most turns of one: all voxels of the columns that it passes.
    lines: u64,
    max_line_iterations: u64,
}

impl WorkBound {
    fn count(geometry: &Geometry, part: &VoxelPart) -> Self {
        let grid = &part.voxels.grid;
        let mut cells = grid.cells.map(u64::from);
        cells.sort_unstable();
        let triangles = part.indices.start as usize / 3..part.indices.end as usize / 3;
        let mut load = Self::default();
        for size in &geometry.sizes[triangles] {
            // A voxel that is only touched counts, at either end.
            let voxels = |side: f32| (STRETCH * f64::from(side) / grid.voxel_m).ceil() as u64 + 2;
            let [long, short] = size.sides_m.map(voxels).map(|side| side.min(cells[2]));
            let columns = long * short.min(cells[1]);
            load.max_columns = load.max_columns.max(columns);
            if columns > LARGE_COLUMNS.into() {
                load.huge += 1;
                load.huge_columns = load.huge_columns.saturating_add(columns);
            }
            // One that is shorter than it might be is large and not huge.
            load.large += u64::from(columns > SMALL_COLUMNS.into());
            if size.is_line && columns > SMALL_COLUMNS.into() {
                load.lines += 1;
                let iterations = 2 * (long + short) * (long + COLUMN_TURNS);
                load.max_line_iterations = load.max_line_iterations.max(iterations);
            }
        }
        load
    }

    /// Turns of an invocation in so many layers of the dispatch: all large triangles may have the most columns that one may have, and
    /// one layer's huge triangles may be the largest.
    fn loop_bound(&self, layers: u64) -> u64 {
        let share = |columns: u64, invocations: u64| columns.div_ceil(invocations) + 1;
        let large = self.large.div_ceil(u64::from(LARGE_GROUPS) * layers);
        let columns = self.max_columns.min(LARGE_COLUMNS.into());
        let huge = self.huge.div_ceil(layers);
        let huge_columns = self.huge_columns.min(huge.saturating_mul(self.max_columns));
        let all = GROUP * u64::from(LARGE_GROUPS);
        2 + self.lines.min(large + huge) * self.max_line_iterations
            + large * (1 + COLUMN_TURNS * share(columns, GROUP))
            + huge * (1 + 2 * COLUMN_TURNS)
            + COLUMN_TURNS * (huge_columns / all)
    }

    /// As few layers as keep to the turns that adapters make; the most where none do.
    fn layers(&self) -> u64 {
        let mut numbers = (0..16).map(|power| 1u64 << power);
        numbers.find(|layers| self.loop_bound(*layers) <= MAX_ITERATIONS).unwrap_or(1 << 15)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The poles of a ball: no layer makes one line shorter, and each workgroup takes few.
    #[test]
    fn many_short_lines_take_few_layers() {
        let poles = WorkBound {
            large: 9216,
            lines: 192,
            max_columns: 100,
            max_line_iterations: 2 * (11 + 11) * (11 + COLUMN_TURNS),
            ..WorkBound::default()
        };
        let layers = poles.layers();
        assert!(layers <= 2 && poles.loop_bound(layers) <= MAX_ITERATIONS, "{layers}");
        let long =
            WorkBound { lines: 1, large: 1, max_line_iterations: 2 * MAX_ITERATIONS, ..poles };
        assert!(long.loop_bound(long.layers()) > MAX_ITERATIONS, "a line that is too long passes");
    }
}
