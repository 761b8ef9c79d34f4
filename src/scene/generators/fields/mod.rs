//! Procedural volumes, named in scene files by `generator` in the table `[volume]`.
//!
//! Each is a field over a box that can be sampled at any number of cells: a coarser volume shows the
//! same thing.

mod smoke;

use std::collections::BTreeMap;

use glam::DVec3;
use rayon::prelude::*;

use super::{Args, Param, check};

/// One generator of volumes.
pub struct FieldGenerator {
    /// As scene files call it.
    pub name: &'static str,
    /// What it makes, in a few words.
    pub about: &'static str,
    /// What can be set.
    pub params: &'static [Param],
    /// Cells along x, y and z where the scene file does not say; their ratio is that of the box.
    pub cells: [u32; 3],
    /// The field for these parameters.
    build: fn(&Args) -> Field,
}

/// Values 0 … 1 over a box whose longest edge is 1, about the origin.
type Field = Box<dyn Fn(DVec3) -> f64 + Sync>;

/// Every generator of volumes there is.
pub fn all() -> impl Iterator<Item = &'static FieldGenerator> + Clone {
    [smoke::GENERATORS].into_iter().flatten()
}

/// The generator called `name`; the error names the nearest one.
pub fn find(name: &str) -> Result<&'static FieldGenerator, String> {
    all().find(|g| g.name == name).ok_or_else(|| {
        let hint = check::hint(name, all().map(|g| g.name));
        format!("there is no generator of volumes `{name}`: {hint}")
    })
}

impl FieldGenerator {
    /// Edges of the box, the longest one 1.
    pub fn extent(&self) -> DVec3 {
        let cells = DVec3::from(self.cells.map(f64::from));
        cells / cells.max_element()
    }

    /// The field at the centres of so many cells, x fastest.
    pub fn sample(
        &self,
        params: &BTreeMap<String, f64>,
        cells: [u32; 3],
    ) -> Result<Vec<f32>, String> {
        let field = (self.build)(&Args::new(self.name, self.params, params, 0.0)?);
        let [nx, ny, nz] = cells.map(|n| n as usize);
        let extent = self.extent();
        let spacing = extent / DVec3::from(cells.map(f64::from));
        let mut data = vec![0.0; nx * ny * nz];
        data.par_chunks_mut(nx).enumerate().for_each(|(row, line)| {
            for (x, value) in line.iter_mut().enumerate() {
                let cell = DVec3::new(x as f64, (row % ny) as f64, (row / ny) as f64);
                let p = (cell + 0.5) * spacing - 0.5 * extent;
                *value = field(p).clamp(0.0, 1.0) as f32;
            }
        });
        Ok(data)
    }
}
