//! What the voxel cases voxelize, and volumes as lists of voxels.

use crate::prelude::*;
use fathom_reference::voxel::{Corners, triangles};
use fathom_stages::kit::Resources;
use fathom_stages::voxel::VoxelPart;
use fathom_stages::voxel::slicemap::SliceAxis;
use glam::Vec3Swizzles;

/// Between the first pixel and this one, [`VoxelScene::tiles`] leave no gaps.
pub const TILED_PX: u32 = 44;

/// Triangles and a grid whose numbers f32 holds exactly, so that GPU and reference start from the same.
pub struct VoxelScene {
    pub name: &'static str,
    pub scene: Scene,
    pub grid: Grid,
}

impl VoxelScene {
    fn new(name: &'static str, mesh: Mesh, grid: Grid) -> Result<Self> {
        let objects = vec![Object::new(name, mesh)];
        Ok(Self { name, scene: Scene { objects, ..Scene::load("plane")? }, grid })
    }

    /// Random triangles of all sizes, some without area and some outside a grid that is no cube.
    pub fn soup() -> Result<Self> {
        let grid =
            Grid { cells: [37, 24, 32], origin_m: DVec3::new(-1.5, -2.25, 0.5), voxel_m: 0.125 };
        let mut random = Random::new(3);
        let mut mesh = Mesh::default();
        for number in 0..300u32 {
            // From a tenth of a voxel to more than the grid.
            let size = grid.voxel_m * 10f64.powf(random.within(-1.0, 1.7));
            let middle = grid.bounds().min + grid.size_m() * corner(&mut random, -0.2, 1.2);
            let [a, b, c] = [0, 1, 2].map(|_| middle + size * corner(&mut random, -0.5, 0.5));
            // Every twentieth is a line.
            let c = if number % 20 == 0 { (a + b) / 2.0 } else { c };
            let first = mesh.positions.len() as u32;
            mesh.positions.extend([a, b, c].map(|p| p.as_vec3().to_array()));
            mesh.indices.extend([first, first + 1, first + 2]);
        }
        mesh.recompute_normals();
        Self::new("soup", mesh, grid)
    }

    /// So many triangles of more than 4,096 columns of voxels: copies of one, and another at the end.
    pub fn huge(count: u32) -> Result<Self> {
        let cells = [72, 70, 9];
        let grid = Grid { cells, origin_m: DVec3::new(-4.5, -4.25, 0.5), voxel_m: 0.125 };
        let place = |x: f64, y: f64, z: f64| {
            (grid.bounds().min + grid.size_m() * DVec3::new(x, y, z)).as_vec3().to_array()
        };
        let low = [place(-0.1, -0.1, 0.11), place(1.2, -0.1, 0.22), place(-0.1, 1.2, 0.33)];
        let high = [place(1.1, 1.1, 0.87), place(-0.2, 1.1, 0.76), place(1.1, -0.2, 0.65)];
        let copies = (1..count).flat_map(|_| [0, 1, 2]);
        let mesh = Mesh::smooth([low, high].concat(), copies.chain([3, 4, 5]).collect());
        Self::new("huge triangles", mesh, grid)
    }

    /// Quads of 1 to 16 grid edges, slanted at random, each with a grid that its middle lies in and that clips it.
    pub fn slanted() -> Result<Vec<Self>> {
        let mut random = Random::new(29);
        let quads = 12;
        let subject = |number| {
            let origin_m = DVec3::new(-2.5, -1.75, 0.25);
            let grid = Grid { cells: [40, 33, 48], origin_m, voxel_m: 0.125 };
            let edges = 16f64.powf(f64::from(number) / f64::from(quads - 1));
            let half = edges * grid.size_m().max_element() / 2.0;
            let across = corner(&mut random, -1.0, 1.0).normalize();
            let [along, up] = across.any_orthonormal_pair().into();
            let (sin, cos) = random.within(0.0, std::f64::consts::TAU).sin_cos();
            let [along, up] = [cos * along + sin * up, cos * up - sin * along].map(|d| half * d);
            let middle = grid.bounds().min + grid.size_m() * corner(&mut random, 0.2, 0.8);
            Self::new("slanted quads", Mesh::parallelogram(middle, along, up), grid)
        };
        (0..quads).map(subject).collect()
    }

    /// Planes through corners of voxels, along diagonals of their faces and of their insides. No edge of the grid is exact in binary.
    pub fn diagonals() -> Result<Vec<Self>> {
        let origin_m = DVec3::new(-1.37, -2.21, 0.43);
        let grid = rounded(&Grid { cells: [40, 33, 48], origin_m, voxel_m: 0.1 });
        let edges = [[[1, 1, 0], [0, 0, 1]], [[1, -1, 0], [0, 1, -1]], [[2, 1, 0], [0, 1, 1]]];
        let place = |voxels: [i32; 3]| DVec3::from(voxels.map(f64::from)) * grid.voxel_m;
        let subject = |edges: [[i32; 3]; 2]| {
            let middle = grid.origin_m + place([20, 16, 24]);
            let [along, up] = edges.map(|voxels| 10.3 * place(voxels));
            Self::new("diagonals", Mesh::parallelogram(middle, along, up), grid)
        };
        edges.into_iter().map(subject).collect()
    }

    /// Triangles side by side across an axis, each in a slice of its own: all corners and many places of edges are pixels' centres. The larger ones are
    /// for the raster units. Every second one is moved aside.
    pub fn tiles(axis: SliceAxis, moved_px: f64) -> Result<Self> {
        const LINES_PX: [f64; 9] =
            [0.5, 4.5, 8.5, 12.5, 16.5, 20.5, 28.5, 36.5, TILED_PX as f64 + 0.5];
        let grid = Grid { cells: [48; 3], origin_m: DVec3::new(-2.5, -1.75, 0.25), voxel_m: 0.125 };
        let mut random = Random::new(13);
        let mut line = |k: usize| {
            LINES_PX[k] + f64::from(!k.is_multiple_of(8)) * random.within(-1.5, 1.5).round()
        };
        let corners: Vec<_> = (0..81).map(|number| [line(number % 9), line(number / 9)]).collect();
        let halves = (0..72).filter(|first| first % 9 < 8).flat_map(|first| {
            let [a, b, c, d] = [0, 1, 10, 9].map(|next| corners[first + next]);
            if first % 3 > 0 { [[a, b, c], [c, d, a]] } else { [[a, d, b], [b, d, c]] }
        });
        let triangles = halves.zip(0..).flat_map(|(half, number)| {
            let (aside, slice) = (f64::from(number % 2) * moved_px, f64::from(number % 48) + 0.5);
            half.map(|[column, row]| {
                let at = DVec3::new(column + aside, row + aside, slice);
                let at = [at.zxy(), at.xzy(), at][axis as usize];
                (grid.origin_m + grid.voxel_m * at).as_vec3().to_array()
            })
        });
        let places: Vec<_> = triangles.collect();
        let indices = (0..places.len() as u32).collect();
        Self::new("tiles", Mesh::smooth(places, indices), grid)
    }

    /// A scanned surface of small triangles, or its stand-in, fitted with `resolution` voxels.
    pub fn bunny(resolution: u32) -> Result<Self> {
        let mut scene = Scene::load("bunny")?;
        scene.objects.retain(|object| object.name == "bunny");
        let grid = Grid::fit(&scene.solid_bounds(), resolution).map_err(GpuError::Limit)?;
        Ok(Self { name: "bunny", grid: rounded(&grid), scene })
    }

    /// Large faces, many of which the passes see from their edge.
    pub fn crates(resolution: u32) -> Result<Self> {
        let scene = Scene::load("crates")?;
        let grid = Grid::fit(&scene.solid_bounds(), resolution).map_err(GpuError::Limit)?;
        Ok(Self { name: "crates", grid: rounded(&grid), scene })
    }

    pub fn triangles(&self) -> Vec<Corners> {
        triangles(&self.scene.objects)
    }

    /// The geometry, and an empty volume that takes all of it.
    pub fn upload(&self, resources: &Resources<'_>) -> (Geometry, VoxelPart) {
        let geometry = Geometry::new(resources, &self.scene);
        let part = VoxelPart {
            voxels: Voxels::new(resources, "verify voxels", &self.grid, false),
            indices: 0..3 * geometry.triangles() as u32,
        };
        (geometry, part)
    }

    /// The voxels that a stage sets over the scene.
    pub fn voxelized<L>(
        &self,
        rig: &Rig<'_>,
        stage: impl FnOnce(&Geometry, &[VoxelPart]) -> Result<Stage<L>, GpuError>,
    ) -> Result<Vec<bool>> {
        let (geometry, part) = self.upload(rig);
        let bits = part.voxels.bits.clone();
        rig.run(&[&stage(&geometry, &[part])?])?;
        Ok(voxels_of(&rig.read(&bits)?, &self.grid))
    }

    /// The grid moved by a share of a voxel: what controls are perturbed by.
    pub fn shifted(&self, voxels: f64) -> Grid {
        let shift = voxels * self.grid.voxel_m * DVec3::new(1.0, 0.7, 0.4);
        Grid { origin_m: self.grid.origin_m + shift, ..self.grid }
    }
}

fn corner(random: &mut Random, low: f64, high: f64) -> DVec3 {
    DVec3::from([0, 1, 2].map(|_| random.within(low, high)))
}

/// The grid as the GPU has it.
fn rounded(grid: &Grid) -> Grid {
    let origin_m = grid.origin_m.as_vec3().as_dvec3();
    Grid { origin_m, voxel_m: f64::from(grid.voxel_m as f32), ..*grid }
}

/// A bit volume's voxels, in the order of [`Grid::index`].
pub fn voxels_of(words: &[u32], grid: &Grid) -> Vec<bool> {
    let bit = |index: usize| words[index / 32] >> (index % 32) & 1 == 1;
    (0..grid.count() as usize).map(bit).collect()
}

/// All voxels of a grid in the order of [`Grid::index`].
pub fn cells(grid: &Grid) -> impl Iterator<Item = [u32; 3]> + use<> {
    let [nx, ny, nz] = grid.cells;
    (0..nz).flat_map(move |z| (0..ny).flat_map(move |y| (0..nx).map(move |x| [x, y, z])))
}

/// Random voxels, a `share` of them full.
pub fn random_voxels(random: &mut Random, grid: &Grid, share: f64) -> Vec<bool> {
    (0..grid.count()).map(|_| random.number() < share).collect()
}

/// A unit grid of so many cells.
pub fn plain(cells: [u32; 3]) -> Grid {
    Grid { cells, origin_m: DVec3::ZERO, voxel_m: 1.0 }
}
