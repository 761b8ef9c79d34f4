//! What a check measures: figures of many errors, and of pairs of pictures.

use fathom_reference::image::Image;
use fathom_reference::quantities::quantile;

pub use fathom_base::statistics::mean;

/// The largest of errors; not a number where one is none or there is nothing to compare, so that no check passes by it.
pub fn largest(errors: impl IntoIterator<Item = f64>) -> f64 {
    let worse = |a: f64, b: f64| if a.is_nan() || b.is_nan() { f64::NAN } else { a.max(b) };
    errors.into_iter().reduce(worse).map_or(f64::NAN, |max| worse(max, 0.0))
}

/// A percentile of errors; not a number for none.
pub fn percentile<const PERCENT: u32>(errors: impl IntoIterator<Item = f64>) -> f64 {
    quantile(&mut errors.into_iter().collect::<Vec<_>>(), f64::from(PERCENT) / 100.0)
}

pub fn median(errors: impl IntoIterator<Item = f64>) -> f64 {
    percentile::<50>(errors)
}

/// Root mean square.
pub fn rms(errors: impl IntoIterator<Item = f64>) -> f64 {
    mean(errors.into_iter().map(|error| error * error)).sqrt()
}

/// Of what is judged, the share that holds; not a number where nothing is judged.
pub fn share(judged: impl IntoIterator<Item = bool>) -> f64 {
    mean(judged.into_iter().map(|holds| f64::from(u8::from(holds))))
}

/// How far a number is from an exact one, relative to it.
pub fn relative_error(found: f64, exact: f64) -> f64 {
    (found / exact - 1.0).abs()
}

/// Sum of the absolute differences of two images' pixels, relative to the second's sum.
pub fn difference(image: &Image, other: &Image) -> f64 {
    let pairs = image.data().iter().zip(other.data());
    pairs.map(|(a, b)| (a - b).abs()).sum::<f64>() / other.sum()
}

/// The largest difference of two images' pixels.
pub fn apart(image: &Image, other: &Image) -> f64 {
    largest(image.data().iter().zip(other.data()).map(|(a, b)| (a - b).abs()))
}

/// Of how many places two lists of the same length differ; what one has more differs.
pub fn differing<T: PartialEq>(a: &[T], b: &[T]) -> f64 {
    let pairs = a.iter().zip(b).filter(|(a, b)| a != b).count();
    (pairs + a.len().abs_diff(b.len())) as f64
}

/// Radiance L of what a stage shows in 8 bits, as `(1 − exp(−exposure · L))^(1 / 2.2)`.
pub fn radiance_of(shown: f64, exposure: f64) -> f64 {
    -(1.0 - shown.powf(DISPLAY_GAMMA)).ln() / exposure
}

pub fn tone_mapped(radiance: f64, exposure: f64) -> f64 {
    (1.0 - (-radiance * exposure).exp()).powf(1.0 / DISPLAY_GAMMA)
}

pub const DISPLAY_GAMMA: f64 = 2.2;
