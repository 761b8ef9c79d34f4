//! Scalar fields on a regular grid: densities or opacities of volume data sets.

use glam::DVec3;

use super::{Bounds, check};

/// Values at the centres of the cells of a box, 0 … 1.
#[derive(Clone, Debug, PartialEq)]
pub struct Volume {
    /// As in the scene file.
    pub name: String,
    /// Cells along x, y and z.
    pub cells: [u32; 3],
    /// The corner of smallest coordinates, metres.
    pub origin_m: DVec3,
    /// Edges of a cell, metres.
    pub spacing_m: DVec3,
    /// x runs fastest, then y, then z.
    pub data: Vec<f32>,
}

impl Volume {
    pub fn bounds(&self) -> Bounds {
        let size = self.spacing_m * DVec3::from(self.cells.map(f64::from));
        Bounds { min: self.origin_m, max: self.origin_m + size }
    }

    /// Whether the values fill the cells and can be used; the error says what is wrong and where.
    pub fn validate(&self) -> Result<(), String> {
        let count: u64 = self.cells.iter().map(|n| u64::from(*n)).product();
        if count == 0 || self.data.len() as u64 != count {
            let [x, y, z] = self.cells;
            let values = self.data.len();
            return Err(format!("a volume of {x} × {y} × {z} cells has {values} values"));
        }
        check::point("volume origin", &self.origin_m.to_array())?;
        for edge in self.spacing_m.to_array() {
            check::within("volume spacing", edge, 1e-9, check::FAR_M)?;
        }
        match self.data.iter().position(|v| !(0.0..=1.0).contains(v)) {
            Some(i) => Err(format!("value {i} is {}: values must lie in 0 to 1", self.data[i])),
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faults_are_found() {
        let volume = |data: Vec<f32>| Volume {
            name: "test".into(),
            cells: [2, 1, 1],
            origin_m: DVec3::ZERO,
            spacing_m: DVec3::new(0.5, 1.0, 1.0),
            data,
        };
        assert!(volume(vec![0.0, 1.0]).validate().is_ok());
        assert_eq!(volume(vec![0.0, 1.0]).bounds().max, DVec3::ONE);
        assert!(volume(vec![0.0]).validate().unwrap_err().contains("1 values"));
        assert!(volume(vec![0.0, f32::NAN]).validate().unwrap_err().contains("value 1 is NaN"));
        assert!(volume(vec![0.0, 1.5]).validate().is_err());
    }
}
