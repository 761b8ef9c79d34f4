//! Tests of claims and kinds of plot of earlier versions, as records and files hold them, in the form of today.

use serde::{Deserialize, Deserializer, de};
use serde_json::{Map, Value, json};
use toml::Table;

use super::{Plot, Repetitions, Test};

type Renamed = &'static [(&'static str, &'static str)];

/// Earlier test, the test of today, and their keys that were renamed.
const TESTS: [(&str, &str, Renamed); 4] = [
    ("at_least", "within", &[("value", "low")]),
    ("independent", "ratio", &[]),
    ("lowest", "ratio", &[("value", "numerator")]),
    ("no_worse", "ratio", &[("of", "numerator"), ("than", "denominator")]),
];

pub(super) fn test<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Test, D::Error> {
    let mut test = Table::deserialize(deserializer)?;
    for (earlier, today, renamed) in TESTS {
        let Some(toml::Value::Table(mut keys)) = test.remove(earlier) else { continue };
        for (from, to) in renamed {
            keys.remove(*from).and_then(|value| keys.insert((*to).to_owned(), value));
        }
        if today == "ratio" {
            let share = ["margin", "tolerance"].into_iter().find_map(|name| keys.remove(name));
            let share = share.map_or(Ok(0.0), f64::deserialize).map_err(de::Error::custom)?;
            keys.insert("high".to_owned(), (1.0 + share).into());
        }
        test.insert(today.to_owned(), keys.into());
    }
    Test::deserialize(test).map_err(de::Error::custom)
}

/// Without the dense run and its bias.
pub(super) fn repetitions<'de, D: Deserializer<'de>>(
    deserializer: D,
) -> Result<Option<Repetitions>, D::Error> {
    let mut repetitions = Table::deserialize(deserializer)?;
    repetitions.remove("limit");
    let outputs = repetitions.get_mut("output").and_then(toml::Value::as_array_mut);
    for output in outputs.into_iter().flatten().filter_map(toml::Value::as_table_mut) {
        output.remove("bias");
    }
    Repetitions::deserialize(repetitions).map(Some).map_err(de::Error::custom)
}

/// A map becomes lines over its columns, one for each row. Ratios become bars of the two values, a plot for each measure.
pub(super) fn plots<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<Plot>, D::Error> {
    let mut plots = Vec::new();
    for mut plot in Vec::<Map<String, Value>>::deserialize(deserializer)? {
        let kind = plot.get("kind").cloned().unwrap_or_default();
        let mut take = |name| plot.remove(name).unwrap_or_default();
        let today = match kind.as_str() {
            Some("map") => {
                let (columns, _) = (take("columns"), take("rows"));
                let x = format!("axis:{}", columns.as_str().unwrap_or_default());
                vec![json!({ "kind": "lines", "over": columns, "x": x })]
            }
            Some("ratios") => {
                let [over, y, _, _] = ["over", "y", "numerator", "denominator"].map(take);
                let measures = y.as_array().into_iter().flatten();
                measures.map(|y| json!({ "kind": "bars", "colors": over, "y": [y] })).collect()
            }
            _ => vec![json!({})],
        };
        let is_split = today.len() > 1;
        for keys in today {
            let mut whole = plot.clone();
            whole.extend(keys.as_object().cloned().unwrap_or_default());
            let mut plot = Plot::deserialize(Value::Object(whole)).map_err(de::Error::custom)?;
            if is_split {
                plot.title += &format!(": {}", plot.y[0]);
            }
            plots.push(plot);
        }
    }
    Ok(plots)
}

#[cfg(test)]
mod tests {
    use crate::fixtures::own;
    use crate::schema::Experiment;

    fn with(claim_or_plot: &str) -> Experiment {
        let sweep = "[[sweep]]\naxis.n.values = [1, 2]\naxis.m.values = [\"a\", \"b\"]";
        let experiment = own(&format!("{sweep}\n{claim_or_plot}"));
        Experiment { text: String::new(), ..experiment }
    }

    #[test]
    fn tests_of_earlier_versions_are_forms_of_todays() {
        for (earlier, today) in [
            ("at_least = { value = 0.5 }", "within = { low = 0.5 }"),
            (
                "independent = { over = \"n\", tolerance = 0.15 }",
                "ratio = { over = \"n\", high = 1.15 }",
            ),
            (
                "lowest = { over = \"n\", value = 2 }",
                "ratio = { over = \"n\", numerator = 2, high = 1.0 }",
            ),
            (
                "no_worse = { of = { n = 1 }, than = { n = 2, m = \"a\" }, margin = 1 }",
                "ratio = { numerator = { n = 1 }, denominator = { n = 2, m = \"a\" }, high = 2 }",
            ),
        ] {
            let claim = |test: &str| {
                with(&format!(
                    "[claim.c]\ntext = \"x\"\ntest.{}",
                    test.replace(" }", ", y = \"frame\" }")
                ))
            };
            assert_eq!(claim(earlier), claim(today));
        }
    }
}
