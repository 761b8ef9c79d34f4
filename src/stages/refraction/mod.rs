//! Lines of sight through glass. Krüger, Bürger and Westermann (SPT) §4.

pub mod compose;
pub mod surface;
pub mod trace;
pub mod two_interface;

use crate::prelude::*;

/// The rays behind glass, a pixel each: `Exit` in `shaders/shared/refraction.wgsl`.
#[derive(Clone)]
pub struct Exits {
    /// World position; in the fourth channel how far from the camera the line of sight enters the glass, 0 where the pixel shows none.
    pub positions: wgpu::Texture,
    /// Unit direction; 1 in the fourth channel where the ray is still inside.
    pub directions: wgpu::Texture,
}

/// Format of both.
const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba32Float;

impl Exits {
    fn from_pass(pass: &DrawPass) -> Self {
        let [positions, directions] = [0, 1].map(|target: usize| pass.textures()[target].clone());
        Self { positions, directions }
    }

    /// For dumps.
    fn outputs(&self) -> [StageDump; 2] {
        let (place, along) =
            ("where the line of sight leaves the glass", "unit direction in which it goes on");
        let mut positions = Column::many(["x_m", "y_m", "z_m"], "m", place);
        positions.push(Column::new("entry_m", "m", "distance to the glass, 0 without"));
        let mut directions = Column::many(["x", "y", "z"], "1", along);
        directions.push(Column::new("inside", "1", "1 where it is still inside"));
        [
            StageDump::texture("positions", place, positions, &self.positions),
            StageDump::texture("directions", along, directions, &self.directions),
        ]
    }
}
