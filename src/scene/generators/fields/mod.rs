//! Procedural volumes, named in scene files by `generator` in the table `[volume]`.
//!
//! Each is a field over a box. A volume sampled at fewer cells shows the same thing.

mod bonsai;
mod distance;
mod scans;
mod smoke;

use glam::DVec3;
use rayon::prelude::*;

use super::check;

pub struct FieldGenerator {
    /// As scene files call it.
    pub name: &'static str,
    pub about: &'static str,
    /// Cells along x, y and z where the scene file does not say; their ratio is that of the box.
    pub cells: [u32; 3],
    build: fn() -> FieldFn,
}

/// Values 0 … 1 over a box whose longest edge is 1, about the origin.
type FieldFn = Box<dyn Fn(DVec3) -> f64 + Sync>;

pub fn all() -> impl Iterator<Item = &'static FieldGenerator> + Clone {
    [smoke::GENERATORS, bonsai::GENERATORS, scans::GENERATORS].into_iter().flatten()
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
    pub fn sample(&self, cells: [u32; 3]) -> Vec<f32> {
        let field = (self.build)();
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
        data
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The field along the longest edge sampled at about this many cells.
    fn coarse(generator: &FieldGenerator, longest: f64) -> [u32; 3] {
        (generator.extent() * longest).to_array().map(|n| n.round() as u32)
    }

    #[test]
    fn every_field_is_repeatable_and_neither_empty_nor_full() {
        for generator in all() {
            let cells = coarse(generator, 40.0);
            let data = generator.sample(cells);
            let count = cells.iter().product::<u32>() as usize;
            assert_eq!(data.len(), count);
            assert!(data.iter().all(|v| (0.0..=1.0).contains(v)));
            let filled = data.iter().filter(|v| **v > 0.1).count() as f64 / count as f64;
            assert!((0.03..0.7).contains(&filled), "{}: {filled}", generator.name);
            assert_eq!(data, generator.sample(cells));
        }
    }

    /// A coarse volume is the fine one seen coarsely: both have the same mean.
    #[test]
    fn the_number_of_cells_does_not_change_what_is_shown() {
        for generator in all() {
            let mean = |longest| {
                let data = generator.sample(coarse(generator, longest));
                data.iter().map(|v| f64::from(*v)).sum::<f64>() / data.len() as f64
            };
            let (few, many) = (mean(32.0), mean(56.0));
            assert!((few - many).abs() < 0.15 * many, "{}: {few} against {many}", generator.name);
        }
    }
}
