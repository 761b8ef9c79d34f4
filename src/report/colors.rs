//! One colour per stage on all plots of a report.
//!
//! Stages of a family share a hue and differ in lightness. Neighbouring families are far apart in hue.

use std::collections::{BTreeMap, BTreeSet};

use itertools::Itertools;

use fathom_base::text::family;

/// Degrees between the hues of families that follow each other in the alphabet: the golden angle, so that any number of
/// families is spread evenly and neighbours are far apart.
const HUE_STEP_DEG: f64 = 137.508;
/// Hue of the first family, degrees: blue.
const FIRST_HUE_DEG: f64 = 250.0;
/// Perceived lightness of a family's stages (Oklab, 0 black to 1 white): all of them stand out against white and against black.
const LIGHTNESS: [f64; 5] = [0.60, 0.76, 0.50, 0.68, 0.56];
/// Degrees by which the hue of a family's stages moves each time the list of lightness values begins again.
const SHIFT_DEG: f64 = 22.0;
const CHROMA: f64 = 0.125;

/// Of what is no stage of the GPU, and of stages that are unknown.
pub const NEUTRAL: Color = Color(150, 150, 150);

/// Red, green and blue of sRGB.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Color(pub u8, pub u8, pub u8);

impl Color {
    /// For CSS and SVG.
    pub fn hex(self) -> String {
        let Self(red, green, blue) = self;
        format!("#{red:02x}{green:02x}{blue:02x}")
    }
}

/// The colours of a report's stages. The same set of names gives the same colours.
#[derive(Clone, Debug, Default)]
pub struct StageColors(BTreeMap<String, Color>);

impl StageColors {
    pub fn new<'a>(stages: impl IntoIterator<Item = &'a str>) -> StageColors {
        let names: BTreeSet<&str> = stages.into_iter().collect();
        let families = names.into_iter().chunk_by(|name| family(name));
        let mut colors = BTreeMap::new();
        for (place, (_, stages)) in families.into_iter().enumerate() {
            let hue = FIRST_HUE_DEG + HUE_STEP_DEG * place as f64;
            let colored = stages.enumerate();
            colors.extend(colored.map(|(index, name)| (name.to_owned(), color(hue, index))));
        }
        StageColors(colors)
    }

    /// Whether it is a stage of the report with a colour.
    pub fn has(&self, stage: &str) -> bool {
        self.0.contains_key(stage)
    }

    /// Of a stage of the report; grey for others, such as the CPU's part of a frame.
    pub fn color(&self, stage: &str) -> Color {
        self.0.get(stage).copied().unwrap_or(NEUTRAL)
    }
}

fn color(hue_deg: f64, index: usize) -> Color {
    let cycles = (index / LIGHTNESS.len()) as f64;
    let hue = hue_deg + SHIFT_DEG * cycles;
    of_oklch(LIGHTNESS[index % LIGHTNESS.len()], CHROMA, hue)
}

/// A colour of Oklab by lightness, chroma and hue (Ottosson, *A perceptual color space for image processing*, 2020), in sRGB.
fn of_oklch(lightness: f64, chroma: f64, hue_deg: f64) -> Color {
    let (sin, cos) = hue_deg.to_radians().sin_cos();
    let (a, b) = (chroma * cos, chroma * sin);
    let l = (lightness + 0.3963377774 * a + 0.2158037573 * b).powi(3);
    let m = (lightness - 0.1055613458 * a - 0.0638541728 * b).powi(3);
    let s = (lightness - 0.0894841775 * a - 1.2914855480 * b).powi(3);
    let byte = |linear: f64| {
        let curved = 1.055 * linear.powf(1.0 / 2.4) - 0.055;
        let value = if linear <= 0.0031308 { 12.92 * linear } else { curved };
        (255.0 * value.clamp(0.0, 1.0)).round() as u8
    };
    Color(
        byte(4.0767416621 * l - 3.3077115913 * m + 0.2309699292 * s),
        byte(-1.2684380046 * l + 2.6097574011 * m - 0.3413193965 * s),
        byte(-0.0041960863 * l - 0.7034186147 * m + 1.7076147010 * s),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    const STAGES: [&str; 9] = [
        "compose",
        "ao/blur",
        "ao/compose",
        "ao/march",
        "caustics/splat",
        "caustics/trace",
        "post/compose",
        "voxel/unpack",
        "scene/gbuffer",
    ];

    #[test]
    fn every_stage_has_a_colour_of_its_own() {
        let colors = StageColors::new(STAGES);
        let used: BTreeSet<Color> = STAGES.iter().map(|stage| colors.color(stage)).collect();
        assert_eq!(used.len(), STAGES.len());
        assert!(!used.contains(&NEUTRAL));
    }

    #[test]
    fn the_order_of_names_does_not_matter_and_what_is_unknown_is_grey() {
        let [forth, back] = [StageColors::new(STAGES), StageColors::new(STAGES.into_iter().rev())];
        assert!(STAGES.iter().all(|stage| forth.color(stage) == back.color(stage)));
        assert_eq!(forth.color("uniforms"), NEUTRAL);
    }
}
