//! Noise of a cell's result: its frame is drawn several times with the photon grids at other places. UW §4.2.

use anyhow::{Result, ensure};
use itertools::Itertools as _;

use super::difference::{image, run_to};
use super::subject::Subject;
use fathom_base::statistics::mean;
use fathom_experiments::schema::RepeatedOutput;
use fathom_gpu::{FrameTimer, Gpu, Pixels};
use fathom_pipelines::AnyPipeline;

/// Draws every repetition once, and gives of each output, relative to its mean level, the RMS over the pixels of the difference of each
/// repetition from the mean over the repetitions. That whose grids lie as the cell's own is drawn already.
pub fn noise(
    gpu: &Gpu,
    timer: &mut FrameTimer,
    own: &Subject,
    drawn: &AnyPipeline,
    repeated: &[Subject],
    outputs: &[RepeatedOutput],
) -> Result<Vec<Vec<f64>>> {
    let stages: Vec<&[String]> = outputs.iter().map(|output| output.stages.as_slice()).collect();
    let mut images: Vec<Vec<Pixels>> = outputs.iter().map(|_| Vec::new()).collect();
    // One pipeline at a time: only the outputs are kept.
    for subject in repeated {
        let is_drawn = subject.params == own.params;
        let built = if is_drawn { None } else { Some(subject.build(gpu)?) };
        if let Some(built) = &built {
            run_to(gpu, timer, built, &stages)?;
        }
        for (images, stages) in images.iter_mut().zip(&stages) {
            images.push(image(gpu, built.as_deref().unwrap_or(drawn), stages)?);
        }
    }
    images.iter().map(|images| noise_of_images(images)).collect()
}

fn noise_of_images(images: &[Pixels]) -> Result<Vec<f64>> {
    ensure!(
        images.iter().map(|image| image.data.len()).all_equal(),
        "the repetitions' images differ in size"
    );
    let count = images.len() as f64;
    let whole = mean_image(images.iter());
    let level = mean(whole.iter().copied());
    ensure!(level > 0.0, "the image is black");
    // A repetition is part of the mean that it is compared with, so that its difference from it is too small by this factor.
    // Places that are spread evenly make it up to √(n / (n − 1)) too large, in every cell alike.
    let own = count / (count - 1.0);
    let noise =
        images.iter().map(|image| (own * mean_square_difference(image, &whole)).sqrt() / level);
    Ok(noise.collect())
}

fn mean_square_difference(image: &Pixels, middle: &[f64]) -> f64 {
    let values = image.data.iter().map(|value| f64::from(*value));
    mean(values.zip(middle).map(|(value, middle)| (value - middle).powi(2)))
}

/// Mean of images, texel by texel.
fn mean_image<'a>(images: impl Iterator<Item = &'a Pixels>) -> Vec<f64> {
    let (mut sums, mut count) = (Vec::new(), 0.0);
    for image in images {
        sums.resize(image.data.len(), 0.0);
        for (sum, value) in sums.iter_mut().zip(&image.data) {
            *sum += f64::from(*value);
        }
        count += 1.0;
    }
    sums.iter_mut().for_each(|sum| *sum /= count);
    sums
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64;

    use super::*;

    const SIDE: u32 = 96;

    fn picture(value: impl FnMut() -> f64) -> Pixels {
        let mut value = value;
        let data = (0..SIDE * SIDE).map(|_| value() as f32).collect();
        Pixels { width: SIDE, height: SIDE, channels: 1, data }
    }

    #[test]
    fn noise_is_that_of_each_repetition() {
        let mut random = Pcg64::seed_from_u64(3);
        // A uniform number of standard deviation 1.
        let mut unit = || (random.random::<f64>() - 0.5) * 12f64.sqrt();
        for (noise, count) in [(0.2, 8), (0.01, 8), (0.4, 4)] {
            let images: Vec<Pixels> =
                (0..count).map(|_| picture(|| 2.0 + 2.0 * noise * unit())).collect();
            let noises = noise_of_images(&images).unwrap();
            assert_eq!(noises.len(), count);
            for of_one in &noises {
                assert!((of_one / noise - 1.0).abs() < 0.05, "{noise}: {noises:?}");
            }
        }
        let equal = vec![picture(|| 2.0); 4];
        assert!(noise_of_images(&equal).unwrap().iter().all(|noise| *noise == 0.0));
    }
}
