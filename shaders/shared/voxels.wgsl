// Grids of cubic voxels. Host twin: src/stages/shared/voxels.rs.
#define_import_path fathom::voxels

#import fathom::host::{GridUniforms}

// World to voxels from the grid's origin.
fn to_cells(grid: GridUniforms, position_m: vec3<f32>) -> vec3<f32> {
    return (position_m - grid.origin_m) / grid.voxel_m;
}

// Place of a voxel in memory: x runs fastest. Its bit is bit `index % 32` of word `index / 32`.
fn index_of(grid: GridUniforms, cell: vec3<u32>) -> u32 {
    return cell.x + grid.cells.x * (cell.y + grid.cells.y * cell.z);
}
