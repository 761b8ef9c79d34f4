//! Lines of sight through glass. Krüger, Bürger and Westermann (SPT) §4.

pub mod compose;
pub mod surface;
pub mod trace;
pub mod two_interface;

use crate::{Column, Output};

/// The rays behind glass, a pixel each: `Exit` in `shaders/shared/refraction.wgsl`.
#[derive(Clone)]
pub struct Exits {
    /// World position; 1 in the fourth channel where the pixel shows glass.
    pub positions: wgpu::Texture,
    /// Unit direction; 1 in the fourth channel where the ray is still inside.
    pub directions: wgpu::Texture,
}

/// Format of both.
const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba32Float;

impl Exits {
    /// For dumps.
    fn outputs(&self) -> Vec<Output> {
        let columns = |names: [&'static str; 4], unit, meanings: [&'static str; 2]| {
            let meaning = |place| if place < 3 { meanings[0] } else { meanings[1] };
            let units = |place| if place < 3 { unit } else { "1" };
            let numbered = names.into_iter().enumerate();
            numbered.map(|(place, name)| Column::new(name, units(place), meaning(place))).collect()
        };
        let place = "where the line of sight leaves the glass";
        let along = "unit direction in which it goes on";
        vec![
            Output::texture(
                "positions",
                place,
                columns(
                    ["x_m", "y_m", "z_m", "glass"],
                    "m",
                    [place, "1 where the pixel shows glass"],
                ),
                &self.positions,
            ),
            Output::texture(
                "directions",
                along,
                columns(["x", "y", "z", "inside"], "1", [along, "1 where it is still inside"]),
                &self.directions,
            ),
        ]
    }
}
