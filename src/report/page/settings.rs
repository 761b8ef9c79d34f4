//! Settings of cells in words.

use itertools::Itertools;
use serde_json::Value;

use fathom_experiments::{label_text, words as terms};

/// The values of a cell's axes: `samples per ray 16, method: mesh`.
pub fn setting_words<'a>(axes: impl IntoIterator<Item = (&'a String, &'a Value)>) -> String {
    let one = |(name, value): (&'a String, &'a Value)| {
        let label = terms::parameter(name);
        let (words, unit, text) = (label.words, label.unit.symbol(), label_text(value));
        match value {
            Value::Number(_) => format!("{words} {text} {unit}").trim_end().to_owned(),
            Value::Bool(on) => format!("{words}: {}", if *on { "on" } else { "off" }),
            _ => format!("{words}: {text}"),
        }
    };
    axes.into_iter().map(one).join(", ")
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn numbers_stand_behind_their_names_and_names_behind_a_colon() {
        let axes = json!({ "ao.samples": 16, "ao.skipping": true, "godrays.line_width_px": 2.5, "method": "mesh" });
        assert_eq!(
            setting_words(axes.as_object().unwrap()),
            "samples per ray 16, skipping of empty space: on, line width of godrays 2.5 px, method: mesh"
        );
    }
}
