//! Names of figures and parameters in words with units, for people.
//!
//! Keys of records are identifiers such as `caustics_unconverged_rate`. Known ones have words in a table here; others, such as a
//! user's own, are read by their parts.

/// What a figure is shown in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unit {
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

impl Unit {
    /// Empty where there is none.
    pub fn symbol(self) -> &'static str {
        match self {
            Unit::One => "",
            Unit::Percent => "%",
            Unit::Metres => "m",
            Unit::Degrees => "°",
            Unit::Pixels => "px",
            Unit::Voxels => "voxels",
            Unit::Mebibytes => "MiB",
            Unit::Milliseconds => "ms",
            Unit::FramesPerSecond => "frames/s",
        }
    }

    /// From the value in the record to the value shown.
    pub fn factor(self) -> f64 {
        match self {
            Unit::Percent => 100.0,
            Unit::Mebibytes => 1.0 / f64::from(1 << 20),
            Unit::Milliseconds => 1e-6,
            Unit::One
            | Unit::Metres
            | Unit::Degrees
            | Unit::Pixels
            | Unit::Voxels
            | Unit::FramesPerSecond => 1.0,
        }
    }
}

/// What a figure or parameter is called, and what it is shown in.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Label {
    pub words: String,
    pub unit: Unit,
}

impl Label {
    pub fn new(words: impl Into<String>, unit: Unit) -> Label {
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
    known(FIGURES, name).unwrap_or_else(|| read(name))
}

/// `photons not converged (%)` of `caustics_unconverged_rate`.
pub fn figure_label(name: &str) -> String {
    figure(name).text()
}

/// Label of a parameter by its dotted path, or of an axis by its name.
pub fn parameter(path: &str) -> Label {
    known(PARAMETERS, path).unwrap_or_else(|| read(&path.replace('.', "_")))
}

/// `line width of godrays (px)` of `godrays.line_width_px`.
pub fn parameter_label(path: &str) -> String {
    parameter(path).text()
}

type Entry = (&'static str, &'static str, Unit);

/// By its entry, or by that of what comes before its end.
fn known(table: &[Entry], name: &str) -> Option<Label> {
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
const ENDS: [(&str, &str, Unit); 14] = [
    ("_median_m", ", median", Unit::Metres),
    ("_p99_m", ", 99th percentile", Unit::Metres),
    ("_median_deg", ", median", Unit::Degrees),
    ("_p90_deg", ", 90th percentile", Unit::Degrees),
    ("_rate", "", Unit::Percent),
    ("_share", "", Unit::Percent),
    ("_bytes", "", Unit::Mebibytes),
    ("_voxels", "", Unit::Voxels),
    ("_deg", "", Unit::Degrees),
    ("_px", "", Unit::Pixels),
    ("_mean", ", mean", Unit::One),
    ("_rmse", ", RMS error", Unit::One),
    ("_m", "", Unit::Metres),
    ("_ns", "", Unit::Milliseconds),
];

/// A name without an entry: its parts in words, its unit from its end.
fn read(name: &str) -> Label {
    let end = ENDS.iter().find_map(|(end, words, unit)| {
        let start = name.strip_suffix(end).filter(|start| !start.is_empty())?;
        Some(Label::new(start.replace('_', " ") + words, *unit))
    });
    end.unwrap_or_else(|| Label::new(name.replace('_', " "), Unit::One))
}

/// Quantities and errors of the built-in pipelines and experiments.
const FIGURES: &[Entry] = &[
    ("ao_bias", "mean error of occlusion", Unit::One),
    ("ao_filtered_bias", "mean error of occlusion, filtered", Unit::One),
    ("ao_filtered_rmse", "RMS error of occlusion, filtered", Unit::One),
    ("ao_mean", "mean occlusion", Unit::One),
    ("ao_noise", "noise of occlusion, RMS", Unit::Percent),
    ("ao_reference_mean", "mean occlusion by ray casting", Unit::One),
    ("ao_rmse", "RMS error of occlusion", Unit::One),
    ("ao_view_variance", "variance of occlusion over views", Unit::One),
    ("ao_view_variance_of_noise", "variance of occlusion between draws of a view", Unit::One),
    ("ao_view_variance_points", "points compared over views", Unit::One),
    ("ao_view_variance_standard_error", "standard error of the variance over views", Unit::One),
    ("ao_view_variance_with_noise", "variance of occlusion over views, noise included", Unit::One),
    ("bit_volume_bytes", "volume as bits", Unit::Mebibytes),
    ("caustics_bias", "bias of caustics, RMS", Unit::Percent),
    ("caustics_contraction", "factor of the error of caustic photons in an iteration", Unit::One),
    ("caustics_error_rms", "error of caustics, RMS", Unit::Percent),
    ("caustics_image_block_px", "side of the blocks that caustics are compared in", Unit::Pixels),
    ("caustics_image_error", "error of the caustics' image", Unit::Percent),
    ("caustics_image_level", "mean irradiance of the caustics' image", Unit::One),
    ("caustics_image_rms_error", "error of the caustics' image, RMS", Unit::Percent),
    ("caustics_left_frustum_rate", "caustic photons that left the light's view", Unit::Percent),
    ("caustics_missed_water_rate", "caustic photons that missed the water", Unit::Percent),
    ("caustics_noise", "noise of caustics, RMS", Unit::Percent),
    ("caustics_photon_error", "distance of caustic photons from the exact end", Unit::Metres),
    ("caustics_photon_false_hit_rate", "caustic photons that hit where none should", Unit::Percent),
    ("caustics_photon_miss_rate", "caustic photons lost, of all", Unit::Percent),
    ("caustics_reference_noise", "noise of the reference of caustics, RMS", Unit::Percent),
    ("caustics_unconverged_rate", "caustic photons not converged", Unit::Percent),
    ("covered_share", "pixels covered", Unit::Percent),
    ("facing_light_rate", "pixels that face the light", Unit::Percent),
    ("glass_rate", "pixels that show glass", Unit::Percent),
    ("godrays_bias", "bias of godrays, RMS", Unit::Percent),
    ("godrays_contraction", "factor of the error of godray photons in an iteration", Unit::One),
    ("godrays_covered_px", "pixels that lines of godrays cover", Unit::One),
    ("godrays_left_frustum_rate", "godray photons that left the light's view", Unit::Percent),
    ("godrays_missed_water_rate", "godray photons that missed the water", Unit::Percent),
    ("godrays_noise", "noise of godrays, RMS", Unit::Percent),
    ("godrays_photon_error", "distance of godray photons from the exact end", Unit::Metres),
    ("godrays_photon_false_hit_rate", "godray photons that hit where none should", Unit::Percent),
    ("godrays_photon_miss_rate", "godray photons lost", Unit::Percent),
    ("godrays_unconverged_rate", "godray photons not converged", Unit::Percent),
    ("ldi_fragments_per_pixel", "fragments per pixel of the layers", Unit::One),
    ("ldi_lost_fragments", "fragments that found no layer", Unit::One),
    ("lookups_per_pixel_mean", "look-ups of the skipping map per pixel, mean", Unit::One),
    ("map_energy_error", "error of the map's energy", Unit::Percent),
    ("map_floor_hole_rate", "dark texels among lit ones", Unit::Percent),
    ("map_misplaced_rate", "photons in another texel of the map", Unit::Percent),
    ("missed_water_rate", "photons that missed the water", Unit::Percent),
    ("occupied_share", "voxels occupied", Unit::Percent),
    ("occupied_voxels", "voxels occupied", Unit::Voxels),
    ("photon_error", "distance of photons from the exact end", Unit::Metres),
    ("photon_false_hit_rate", "photons that hit where none should", Unit::Percent),
    ("photon_miss_rate", "photons lost, of those that end in view", Unit::Percent),
    ("photon_no_hit_rate", "photons without a hit", Unit::Percent),
    ("photon_off_frustum_rate", "photons that end out of view", Unit::Percent),
    ("photon_on_its_way_rate", "photons still on their way", Unit::Percent),
    ("photon_wrong_face_rate", "photons on a wrong face", Unit::Percent),
    (
        "photon_wrong_surface_rate",
        "photons on a wrong surface, of those that end in view",
        Unit::Percent,
    ),
    ("r_max_m", "largest distance of occluders", Unit::Metres),
    ("r_max_voxels", "largest distance of occluders", Unit::Voxels),
    ("reads_per_pixel_mean", "reads per pixel, mean", Unit::One),
    ("refraction_error", "angle to the exact ray", Unit::Degrees),
    ("samples_per_covered_pixel", "samples per covered pixel", Unit::One),
    ("samples_per_pixel", "samples per pixel", Unit::One),
    ("samples_per_pixel_most", "samples per pixel, most", Unit::One),
    ("shadow_false_rate", "pixels with a shadow that should have none", Unit::Percent),
    ("shadow_missed_rate", "pixels that miss their shadow", Unit::Percent),
    (
        "shadow_wrong_rate",
        "pixels with a wrong shadow, of those that face the light",
        Unit::Percent,
    ),
    ("shadowed_rate", "pixels in shadow", Unit::Percent),
    ("step_voxels", "step of the march", Unit::Voxels),
    ("texture_volume_bytes", "volume as a byte per voxel", Unit::Mebibytes),
    ("totally_reflected_rate", "photons totally reflected", Unit::Percent),
    ("visibility_mean", "mean visibility", Unit::One),
    ("volume_bytes", "volume", Unit::Mebibytes),
    ("voxel_m", "side of a voxel", Unit::Metres),
];

/// Parameters and axes of the built-in experiments. A single word stands for itself.
const PARAMETERS: &[Entry] = &[
    ("ao.guard", "guard band", Unit::One),
    ("ao.offset_voxels", "offset of the first sample", Unit::Voxels),
    ("ao.rays", "rays per pixel", Unit::One),
    ("ao.samples", "samples per ray", Unit::One),
    ("ao.skipping", "skipping of empty space", Unit::One),
    ("ao.step_voxels", "step of the march", Unit::Voxels),
    ("ao.threshold", "threshold of occupancy", Unit::One),
    ("both", "caustic and godray grid", Unit::One),
    ("caustics.buffer", "caustic buffer", Unit::Pixels),
    ("caustics.grid", "side of the caustic photon grid", Unit::One),
    ("caustics.subdivision", "photons per node of the caustic grid", Unit::One),
    ("caustics.subdivision_mode", "subdivision of the caustic grid", Unit::One),
    ("dragon", "size of the model", Unit::One),
    ("filters", "filters of both buffers", Unit::One),
    ("godrays", "godray buffer", Unit::One),
    ("godrays.buffer", "godray buffer", Unit::Pixels),
    ("godrays.grid", "side of the godray photon grid", Unit::One),
    ("godrays.line_width_px", "line width of godrays", Unit::Pixels),
    ("ldi.layers", "layers of depth", Unit::One),
    ("ldi.method", "method of the layers", Unit::One),
    ("planar.texels", "texels per side of a face", Unit::One),
    ("rays", "ends of rays", Unit::One),
    ("rays.method", "method of intersection testing", Unit::One),
    ("rays.test", "test for a hit", Unit::One),
    ("refraction.method", "method of refraction", Unit::One),
    ("shadow.size", "side of the shadow map", Unit::Pixels),
    ("side", "voxels along the longest side", Unit::One),
    ("step", "step of the march", Unit::One),
    ("transfer.grid", "photon grid", Unit::One),
    ("view.height", "height of the picture", Unit::Pixels),
    ("view.width", "width of the picture", Unit::Pixels),
    ("volume", "voxels along the longest side", Unit::One),
    ("voxel.method", "method of voxelization", Unit::One),
    ("voxel.resolution", "voxels along the longest side", Unit::One),
    ("water.amplitude_m", "amplitude of waves", Unit::Metres),
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_are_words_with_units() {
        assert_eq!(figure_label("caustics_unconverged_rate"), "caustic photons not converged (%)");
        assert_eq!(parameter_label("godrays.line_width_px"), "line width of godrays (px)");
        assert_eq!(figure_label("reads_per_pixel_mean"), "reads per pixel, mean");
    }

    #[test]
    fn unknown_names_are_read_by_their_parts() {
        for (name, label) in [
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

    fn assert_known(table: &[Entry], name: &str) {
        let is_word = name.chars().all(|c| c.is_ascii_alphabetic());
        let is_known = is_word || known(table, name).is_some();
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
            Path::new(env!("CARGO_MANIFEST_DIR")).join("../../reports/llvmpipe/records.jsonl");
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
        assert!(figures > 1_000, "{figures}");
    }
}
