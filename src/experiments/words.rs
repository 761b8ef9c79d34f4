//! Names of figures and parameters in words with units, for people.
//!
//! Keys of records are identifiers such as `caustics_unconverged_rate`. Known ones have words in a table here; others, such as a
//! user's own, are read by their parts.

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FigureUnit {
    /// A count, a ratio, or an error of something without a unit.
    One,
    /// Of a share, 0 … 1 in the record.
    Percent,
    Metres,
    Degrees,
    Pixels,
    Voxels,
    /// Of bytes.
    Mebibytes,
    /// Of nanoseconds.
    Milliseconds,
    FramesPerSecond,
}

impl FigureUnit {
    /// Its symbol, empty where there is none, and the factor from the value in the record to the value shown.
    fn shown(self) -> (&'static str, f64) {
        match self {
            FigureUnit::One => ("", 1.0),
            FigureUnit::Percent => ("%", 100.0),
            FigureUnit::Metres => ("m", 1.0),
            FigureUnit::Degrees => ("°", 1.0),
            FigureUnit::Pixels => ("px", 1.0),
            FigureUnit::Voxels => ("voxels", 1.0),
            FigureUnit::Mebibytes => ("MiB", 1.0 / f64::from(1 << 20)),
            FigureUnit::Milliseconds => ("ms", 1e-6),
            FigureUnit::FramesPerSecond => ("frames/s", 1.0),
        }
    }

    pub fn symbol(self) -> &'static str {
        self.shown().0
    }

    pub fn factor(self) -> f64 {
        self.shown().1
    }
}

/// What a figure or parameter is called, and what it is shown in.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Label {
    pub words: String,
    pub unit: FigureUnit,
}

impl Label {
    pub fn new(words: impl Into<String>, unit: FigureUnit) -> Label {
        Label { words: words.into(), unit }
    }

    /// `photons not converged (%)`
    pub fn text(&self) -> String {
        match self.unit.symbol() {
            "" => self.words.clone(),
            symbol => format!("{} ({symbol})", self.words),
        }
    }
}

/// Label of a quantity or error by its name in records.
pub fn figure(name: &str) -> Label {
    find_label(FIGURES, name).unwrap_or_else(|| read(name))
}

/// Label of a parameter by its dotted path, or of an axis by its name.
pub fn parameter(path: &str) -> Label {
    find_label(PARAMETERS, path).unwrap_or_else(|| read(&path.replace('.', "_")))
}

/// `line width of godrays (px)` of `godrays.line_width_px`.
pub fn parameter_label(path: &str) -> String {
    parameter(path).text()
}

use FigureUnit::{Degrees, Mebibytes, Metres, Milliseconds, One, Percent, Pixels, Voxels};

type LabelEntry = (&'static str, &'static str, FigureUnit);

/// By its entry, or by that of what comes before its end.
fn find_label(table: &[LabelEntry], name: &str) -> Option<Label> {
    let entry = |name: &str| table.iter().find(|(known, ..)| *known == name);
    if let Some((_, words, unit)) = entry(name) {
        return Some(Label::new(*words, *unit));
    }
    ENDS.iter().find_map(|(end, words, unit)| {
        let (_, start, _) = entry(name.strip_suffix(end)?)?;
        Some(Label::new(format!("{start}{words}"), *unit))
    })
}

/// Ends of names, with what they say: the unit, and words behind the rest.
const ENDS: [(&str, &str, FigureUnit); 14] = [
    ("_median_m", ", median", Metres),
    ("_p99_m", ", 99th percentile", Metres),
    ("_median_deg", ", median", Degrees),
    ("_p90_deg", ", 90th percentile", Degrees),
    ("_rate", "", Percent),
    ("_share", "", Percent),
    ("_bytes", "", Mebibytes),
    ("_voxels", "", Voxels),
    ("_deg", "", Degrees),
    ("_px", "", Pixels),
    ("_mean", ", mean", One),
    ("_rmse", ", RMS error", One),
    ("_m", "", Metres),
    ("_ns", "", Milliseconds),
];

/// A name without an entry: its parts in words, its unit from its end.
fn read(name: &str) -> Label {
    let end = ENDS.iter().find_map(|(end, words, unit)| {
        let start = name.strip_suffix(end).filter(|start| !start.is_empty())?;
        Some(Label::new(start.replace('_', " ") + words, *unit))
    });
    end.unwrap_or_else(|| Label::new(name.replace('_', " "), FigureUnit::One))
}

/// Quantities and errors of the built-in pipelines and experiments.
const FIGURES: &[LabelEntry] = &[
    ("ao_bias", "mean error of occlusion", One),
    ("ao_false_positive_rate", "points occluded by more than they should be", Percent),
    ("ao_filtered_bias", "mean error of occlusion, filtered", One),
    ("ao_filtered_rmse", "RMS error of occlusion, filtered", One),
    ("ao_mean", "mean occlusion", One),
    ("ao_noise", "noise of occlusion, RMS", Percent),
    ("ao_reference_mean", "mean occlusion by ray casting", One),
    ("ao_rmse", "RMS error of occlusion", One),
    ("ao_view_variance", "variance of occlusion over views", One),
    ("ao_view_variance_of_noise", "variance of occlusion between draws of a view", One),
    ("ao_view_variance_points", "points compared over views", One),
    ("ao_view_variance_standard_error", "standard error of the variance over views", One),
    ("ao_view_variance_with_noise", "variance of occlusion over views, noise included", One),
    ("bit_volume_bytes", "volume as bits", Mebibytes),
    ("caustics_contraction", "factor of the error of caustic photons in an iteration", One),
    ("caustics_error_rms", "error of caustics, RMS", Percent),
    ("caustics_image_block_px", "side of the blocks that caustics are compared in", Pixels),
    ("caustics_image_error", "error of the caustics' image", Percent),
    ("caustics_image_level", "mean irradiance of the caustics' image", One),
    ("caustics_image_level_far", "irradiance of the farther half of the caustics' image", One),
    ("caustics_image_level_near", "irradiance of the nearer half of the caustics' image", One),
    ("caustics_image_rms_error", "error of the caustics' image, RMS", Percent),
    ("caustics_in_view_rate", "caustic photons that land in view", Percent),
    ("caustics_left_frustum_rate", "caustic photons that left the light's view", Percent),
    ("caustics_missed_water_rate", "caustic photons that missed the water", Percent),
    ("caustics_noise", "noise of caustics, RMS", Percent),
    ("caustics_photon_error", "distance of caustic photons from the exact end", Metres),
    ("caustics_photon_false_hit_rate", "caustic photons that hit where none should", Percent),
    ("caustics_photon_kept_out_rate", "caustic photons kept out of view", Percent),
    ("caustics_photon_leak_rate", "caustic photons that leak, of those kept out", Percent),
    ("caustics_photon_miss_rate", "caustic photons lost, of all", Percent),
    ("caustics_reference_noise", "noise of the reference of caustics, RMS", Percent),
    ("caustics_unconverged_rate", "caustic photons not converged", Percent),
    ("covered_share", "pixels covered", Percent),
    ("facing_light_rate", "pixels that face the light", Percent),
    ("fragments_behind_8_rate", "surfaces behind the eighth layer", Percent),
    ("glass_rate", "pixels that show glass", Percent),
    ("godrays_contraction", "factor of the error of godray photons in an iteration", One),
    ("godrays_covered_px", "pixels that lines of godrays cover", One),
    ("godrays_in_view_rate", "godray photons that land in view", Percent),
    ("godrays_left_frustum_rate", "godray photons that left the light's view", Percent),
    ("godrays_missed_water_rate", "godray photons that missed the water", Percent),
    ("godrays_noise", "noise of godrays, RMS", Percent),
    ("godrays_photon_error", "distance of godray photons from the exact end", Metres),
    ("godrays_photon_false_hit_rate", "godray photons that hit where none should", Percent),
    ("godrays_photon_miss_rate", "godray photons lost", Percent),
    ("godrays_unconverged_rate", "godray photons not converged", Percent),
    ("intersections_false_rate", "lit places where no ray meets a surface", Percent),
    ("intersections_lost_rate", "intersections of rays in view that are not lit", Percent),
    ("layers_overflow_rate", "pixels of glass with more surfaces than layers", Percent),
    ("line_median_px", "pixels of a line, median", One),
    ("lookups_per_pixel_mean", "look-ups of the skipping map per pixel, mean", One),
    ("map_energy_error", "error of the map's energy", Percent),
    ("map_floor_hole_rate", "dark texels among lit ones", Percent),
    ("map_misplaced_rate", "photons in another texel of the map", Percent),
    ("missed_water_rate", "photons that missed the water", Percent),
    ("occupied_share", "voxels occupied", Percent),
    ("occupied_voxels", "voxels occupied", Voxels),
    ("photon_error", "distance of photons from the exact end", Metres),
    ("photon_false_hit_rate", "photons that hit where none should", Percent),
    ("photon_miss_rate", "photons lost, of those that end in view", Percent),
    ("photon_no_hit_rate", "photons without a hit", Percent),
    (
        "photon_occluded_rate",
        "photons that end before another object, of those that end in view",
        Percent,
    ),
    ("photon_off_frustum_rate", "photons that end out of view", Percent),
    ("photon_on_its_way_rate", "photons still on their way", Percent),
    ("photon_passed_rate", "photons found behind their occluder, of those that have one", Percent),
    (
        "photon_screen_error_share",
        "distance of photons from the exact end on the screen, of the picture's height, median",
        Percent,
    ),
    ("photon_specular_error", "distance from the exact end behind mirrors and glass", Metres),
    (
        "photon_specular_miss_rate",
        "photons lost, of those that end in view behind mirrors and glass",
        Percent,
    ),
    (
        "photon_specular_rate",
        "photons that come by mirror or glass, of those that end in view",
        Percent,
    ),
    ("photon_wrong_face_rate", "photons on a wrong face", Percent),
    ("photon_wrong_surface_rate", "photons on a wrong surface, of those that end in view", Percent),
    ("photons_full_rate", "photons that light as many places as are kept", Percent),
    ("picture_error_rms", "error of the picture, RMS", Percent),
    ("r_max_m", "largest distance of occluders", Metres),
    ("r_max_voxels", "largest distance of occluders", Voxels),
    ("reads_per_pixel_mean", "reads per pixel, mean", One),
    ("refraction_error", "angle to the exact ray", Degrees),
    ("samples_per_covered_pixel", "samples per covered pixel", One),
    ("samples_per_pixel", "samples per pixel", One),
    ("samples_per_pixel_most", "samples per pixel, most", One),
    ("shadow_false_rate", "pixels with a shadow that should have none", Percent),
    ("shadow_missed_rate", "pixels that miss their shadow", Percent),
    ("shadow_wrong_rate", "pixels with a wrong shadow, of those that face the light", Percent),
    ("shadowed_rate", "pixels in shadow", Percent),
    ("step_voxels", "step of the march", Voxels),
    ("texture_volume_bytes", "volume as a byte per voxel", Mebibytes),
    ("totally_reflected_rate", "photons totally reflected", Percent),
    ("visibility_mean", "mean visibility", One),
    ("volume_bytes", "volume", Mebibytes),
    ("voxel_m", "side of a voxel", Metres),
];

/// Parameters and axes of the built-in experiments. A single word stands for itself.
const PARAMETERS: &[LabelEntry] = &[
    ("ao.estimator", "directions of rays", One),
    ("ao.guard", "guard band", One),
    ("ao.offset_voxels", "offset of the first sample", Voxels),
    ("ao.rays", "rays per pixel", One),
    ("ao.samples", "samples per ray", One),
    ("ao.shift_voxels", "offset of the look-ups", Voxels),
    ("ao.skipping", "skipping of empty space", One),
    ("ao.step_voxels", "step of the march", Voxels),
    ("ao.threshold", "threshold of occupancy", One),
    ("both", "caustic and godray grid", One),
    ("camera.z_near_m", "near plane of the camera", Metres),
    ("caustics.buffer", "caustic buffer", Pixels),
    ("caustics.grid", "side of the caustic photon grid", One),
    ("caustics.iterations", "iterations of the estimator", One),
    ("caustics.subdivision", "photons per node of the caustic grid", One),
    ("caustics.subdivision_mode", "subdivision of the caustic grid", One),
    ("dragon", "size of the model", One),
    ("filters", "filters", One),
    ("godrays", "godray buffer", One),
    ("godrays.buffer", "godray buffer", Pixels),
    ("godrays.grid", "side of the godray photon grid", One),
    ("godrays.line_width_px", "line width of godrays", Pixels),
    ("ldi.layers", "layers of depth", One),
    ("planar.texels", "texels per side of a face", One),
    ("rays", "ends of rays", One),
    ("rays.method", "method of intersection testing", One),
    ("rays.test", "test for a hit", One),
    ("rays.tolerance_m", "tolerance of a hit", Metres),
    ("refraction.method", "method of refraction", One),
    ("refraction.surface", "surface that ends a ray", One),
    ("scalar.pyramid", "mip-maps", One),
    ("shadow.size", "side of the shadow map", Pixels),
    ("side", "voxels along the longest side", One),
    ("specular.bounces", "mirrors and glass that a photon leaves", One),
    ("sprites.max_hits", "intersections that are lit", One),
    ("sprites.plane", "plane of the sprites", One),
    ("sprites.radius_m", "radius of sprites", Metres),
    ("step", "step of the march", One),
    ("surface.cells", "cells per side of the water's grid", One),
    ("transfer.grid", "photon grid", One),
    ("view.height", "height of the picture", Pixels),
    ("view.width", "width of the picture", Pixels),
    ("volume", "voxels along the longest side", One),
    ("voxel.axes", "axes of slicemaps", One),
    ("voxel.method", "method of voxelization", One),
    ("voxel.rasterizer", "rasterizer of slicemaps", One),
    ("voxel.resolution", "voxels along the longest side", One),
    ("water.amplitude_m", "amplitude of waves", Metres),
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unknown_names_are_read_by_their_parts() {
        for (name, label) in [
            ("godrays.line_width_px", "line width of godrays (px)"),
            ("foam_error_median_m", "foam error, median (m)"),
            ("lost_foam_rate", "lost foam (%)"),
            ("foam.height_px", "foam height (px)"),
            ("_rate", " rate"),
            ("foam", "foam"),
        ] {
            assert_eq!(parameter_label(name), label);
        }
    }

    #[test]
    fn tables_are_sorted_and_name_nothing_twice() {
        for table in [FIGURES, PARAMETERS] {
            assert!(table.is_sorted_by(|a, b| a.0 < b.0));
        }
    }

    fn assert_known(table: &[LabelEntry], name: &str) {
        let is_word = name.chars().all(|c| c.is_ascii_alphabetic());
        let is_known = is_word || find_label(table, name).is_some();
        assert!(is_known, "`{name}` has no words in src/experiments/words.rs");
    }

    #[test]
    fn every_builtin_experiment_speaks_of_known_names() {
        use crate::Experiment;
        for id in Experiment::builtin_ids() {
            let experiment = Experiment::load(&id).unwrap();
            for measure in experiment.measures() {
                measure.quantities().for_each(|name| assert_known(FIGURES, name));
                measure.params().for_each(|name| assert_known(PARAMETERS, name));
            }
            experiment.axes().for_each(|axis| assert_known(PARAMETERS, &axis.name));
        }
    }

    #[test]
    fn every_figure_of_the_reference_run_is_known() {
        use std::path::Path;

        use fathom_record::{Record, read};
        let path =
            Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/golden/run/records.jsonl");
        let cells = read(&path).unwrap().records.into_iter().filter_map(|record| match record {
            Record::Cell(cell) => Some(cell),
            _ => None,
        });
        let mut figures = 0;
        for measured in cells.filter_map(|cell| cell.measured().cloned()) {
            let named = measured.figures();
            let names = named.keys().copied().chain(measured.repeated.keys().map(String::as_str));
            names.for_each(|name| {
                figures += 1;
                assert_known(FIGURES, name);
            });
        }
        assert!(figures > 100, "{figures}");
    }
}
