//! Checks of parameters. Each error names the parameter, its value and the valid range.

use fathom_base::parameter::{self, FieldMeta, Setting};
use fathom_base::text;

/// Largest coordinate or distance that a scene may use, metres: f32 keeps centimetres there.
pub const FAR_M: f64 = 1e5;

pub fn check_range(name: &str, value: f64, low: f64, high: f64) -> Result<(), String> {
    parameter::check_range(name, value, low, high).map_err(|error| error.to_string())
}

/// Every parameter of a group lies in its range.
pub fn within_ranges<T: Setting>(path: &str, group: &T) -> Result<(), String> {
    group.check(FieldMeta { path, ..FieldMeta::default() }).map_err(|error| error.to_string())
}

/// A change that makes a value invalid, and what the error then says.
#[cfg(test)]
pub type InvalidCase<T> = (fn(&mut T), &'static str);

/// Each change makes a valid value one that `validate` refuses.
#[cfg(test)]
pub fn assert_refused<T: Clone>(
    valid: &T,
    validate: impl Fn(&T) -> Result<(), String>,
    cases: &[InvalidCase<T>],
) {
    assert_eq!(validate(valid), Ok(()));
    for (change, text) in cases {
        let mut changed = valid.clone();
        change(&mut changed);
        let fault = validate(&changed).expect_err(text);
        assert!(fault.contains(text), "{fault}, not {text}");
    }
}

/// `did you mean NAME?`, or a list of what there is when nothing is near.
pub fn hint<'a>(name: &str, candidates: impl IntoIterator<Item = &'a str>) -> String {
    let all: Vec<&str> = candidates.into_iter().collect();
    match text::nearest(name, all.iter().copied()) {
        Some(near) => format!("did you mean `{near}`?"),
        None => format!("there are: {}", all.join(", ")),
    }
}
