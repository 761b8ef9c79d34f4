//! Noise and bias of a cell's result apart: its frame is drawn several times with the photon grids at other places, and once
//! densely. UW §4.2.

use anyhow::{Result, ensure};
use itertools::Itertools as _;

use super::difference::{References, image, run_to};
use super::subject::Subject;
use fathom_base::statistics::mean;
use fathom_experiments::schema::RepeatedOutput;
use fathom_gpu::{FrameTimer, Gpu, Pixels};
use fathom_pipelines::AnyPipeline;

/// The runs of a cell: the same with its photon grids at other places, and its dense limit.
pub struct PlannedRepetitions {
    pub repeated: Vec<Subject>,
    pub limit: Subject,
}

/// Of each output, relative to its mean level.
pub struct NoiseAndBias {
    /// RMS over the pixels of the difference of each repetition from the mean over the repetitions.
    pub noise: Vec<Vec<f64>>,
    /// RMS of the difference of that mean from the dense limit, less the share that the noise of the mean explains. 0 where
    /// noise explains all of it. The dense limit may be beyond the adapter.
    pub bias: Result<Vec<f64>>,
}

/// Draws every repetition once, and gives what is asked of each output. That whose grids lie as the cell's own is drawn already.
pub fn noise_and_bias(
    gpu: &Gpu,
    timer: &mut FrameTimer,
    references: &mut References,
    own: &Subject,
    drawn: &AnyPipeline,
    planned: &PlannedRepetitions,
    outputs: &[RepeatedOutput],
) -> Result<NoiseAndBias> {
    let stages: Vec<&[String]> = outputs.iter().map(|output| output.stages.as_slice()).collect();
    let mut images: Vec<Vec<Pixels>> = outputs.iter().map(|_| Vec::new()).collect();
    // One pipeline at a time: only the outputs are kept.
    for subject in &planned.repeated {
        let is_drawn = subject.params == own.params;
        let built = if is_drawn { None } else { Some(subject.build(gpu)?) };
        if let Some(built) = &built {
            run_to(gpu, timer, built, &stages)?;
        }
        for (images, stages) in images.iter_mut().zip(&stages) {
            images.push(image(gpu, built.as_deref().unwrap_or(drawn), stages)?);
        }
    }
    let repeated: Vec<OutputNoise> =
        images.iter().map(|images| OutputNoise::from_images(images)).collect::<Result<_>>()?;
    let bias = references.images(gpu, timer, &planned.limit, &stages).and_then(|limits| {
        repeated.iter().zip(limits).map(|(repeated, limit)| repeated.bias(limit)).collect()
    });
    Ok(NoiseAndBias { noise: repeated.into_iter().map(|repeated| repeated.noise).collect(), bias })
}

struct OutputNoise {
    middle: Vec<f64>,
    level: f64,
    noise: Vec<f64>,
    /// Mean square of the noise of the mean.
    mean_noise: f64,
}

impl OutputNoise {
    fn from_images(images: &[Pixels]) -> Result<Self> {
        ensure!(
            images.iter().map(|image| image.data.len()).all_equal(),
            "the repetitions' images differ in size"
        );
        let count = images.len() as f64;
        // Means over every other repetition, each of which is spread evenly over the unit square.
        let half = |first: usize| mean_image(images.iter().skip(first).step_by(2));
        let (halves, whole) = ([half(0), half(1)], mean_image(images.iter()));
        let level = mean(whole.iter().copied());
        ensure!(level > 0.0, "the image is black");
        // A repetition is part of the mean that it is compared with, so that its difference from it is too small by this factor.
        // Places that are spread evenly make it up to √(n / (n − 1)) too large, in every cell alike.
        let own = count / (count - 1.0);
        let noise = images
            .iter()
            .map(|image| (own * mean_square_difference(image, &whole)).sqrt() / level)
            .collect();
        // Half the difference of the halves errs as their mean does.
        let mean_noise = mean_square(halves[0].iter().copied(), &halves[1]) / 4.0;
        Ok(Self { middle: whole, level, noise, mean_noise })
    }

    fn bias(&self, limit: &Pixels) -> Result<f64> {
        ensure!(
            limit.data.len() == self.middle.len(),
            "the dense limit's image differs in size from the repetitions'"
        );
        Ok((mean_square_difference(limit, &self.middle) - self.mean_noise).max(0.0).sqrt()
            / self.level)
    }
}

fn mean_square_difference(image: &Pixels, middle: &[f64]) -> f64 {
    mean_square(image.data.iter().map(|v| f64::from(*v)), middle)
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

fn mean_square(values: impl Iterator<Item = f64>, from: &[f64]) -> f64 {
    mean(values.zip(from).map(|(value, from)| (value - from).powi(2)))
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

    /// Repetitions of level 2 with noise of a standard deviation of `noise`, about a limit that lies `bias` beside their mean.
    fn noise_and_bias(noise: f64, bias: f64) -> (Vec<f64>, f64) {
        let mut random = Pcg64::seed_from_u64(3);
        // A uniform number of standard deviation 1.
        let mut unit = || (random.random::<f64>() - 0.5) * 12f64.sqrt();
        let images: Vec<Pixels> = (0..8).map(|_| picture(|| 2.0 + 2.0 * noise * unit())).collect();
        let repeated = OutputNoise::from_images(&images).unwrap();
        let bias = repeated.bias(&picture(|| 2.0 + 2.0 * bias)).unwrap();
        (repeated.noise, bias)
    }

    #[test]
    fn noise_is_told_from_bias() {
        for (noise, bias) in [(0.2, 0.0), (0.2, 0.1), (0.01, 0.1), (0.4, 0.05)] {
            let (noises, found) = noise_and_bias(noise, bias);
            assert_eq!(noises.len(), 8);
            for of_one in &noises {
                assert!((of_one / noise - 1.0).abs() < 0.05, "{noise} {bias}: {noises:?}");
            }
            // The noise of the mean, 0.35 of that of one, hides bias of less than about a tenth of it.
            assert!((found - bias).abs() < 0.02 * noise + 0.01, "{noise} {bias}: {found}");
        }
    }

    #[test]
    fn equal_repetitions_have_no_noise() {
        let (noises, bias) = noise_and_bias(0.0, 0.3);
        assert!(noises.iter().all(|noise| *noise == 0.0));
        assert!((bias - 0.3).abs() < 1e-6);
    }
}
