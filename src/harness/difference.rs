//! How far a cell's result is from that of its reference run: the same cell with other parameters.

use std::collections::HashMap;

use super::plan::PlannedReference;
use super::readout::{self, ReadoutError};
use super::subject::Subject;
use fathom_gpu::{FrameTimer, Gpu, GpuError, Pixels};
use fathom_pipelines::AnyPipeline;

/// Results of reference runs, each run once.
#[derive(Default)]
pub struct References {
    images: HashMap<String, Pixels>,
}

impl References {
    /// Runs the reference unless it is known, and gives the relative RMS difference of the cell's last
    /// frame from it: `√(Σ (a − b)² / Σ b²)` over all pixels and channels, in f64.
    pub fn difference(
        &mut self,
        gpu: &Gpu,
        timer: &mut FrameTimer,
        cell: &dyn AnyPipeline,
        reference: &PlannedReference,
    ) -> Result<f64, ReadoutError> {
        let stages = &reference.plan.stages;
        let known = self.images(gpu, timer, &reference.subject, &[stages])?;
        relative_rms(&readout::image(gpu, cell, stages, None)?, known[0])
    }

    /// What the first present of each list's stages leaves, in a run of the subject that is made unless all of it is known.
    pub fn images(
        &mut self,
        gpu: &Gpu,
        timer: &mut FrameTimer,
        subject: &Subject,
        outputs: &[&[String]],
    ) -> Result<Vec<&Pixels>, ReadoutError> {
        let key =
            |stages: &[String]| format!("{stages:?} {} {}", subject.scene_name, subject.params);
        let keys: Vec<String> = outputs.iter().map(|stages| key(stages)).collect();
        if !keys.iter().all(|key| self.images.contains_key(key)) {
            let pipeline = subject.build(gpu)?;
            timer.untimed(gpu, &pipeline.stages()).map_err(GpuError::from)?;
            for (key, stages) in keys.iter().zip(outputs) {
                let image = readout::image(gpu, pipeline.as_ref(), stages, None)?;
                self.images.insert(key.clone(), image);
            }
        }
        Ok(keys.iter().map(|key| &self.images[key]).collect())
    }
}

fn relative_rms(image: &Pixels, reference: &Pixels) -> Result<f64, ReadoutError> {
    if (image.width, image.height) != (reference.width, reference.height) {
        let Pixels { width, height, .. } = *reference;
        return Err(ReadoutError::Size(image.width, image.height, width, height));
    }
    let square = |x: f64| x * x;
    let pairs = image.data.iter().zip(&reference.data);
    let error: f64 = pairs.map(|(a, b)| square(f64::from(*a) - f64::from(*b))).sum();
    let power: f64 = reference.data.iter().map(|b| square(f64::from(*b))).sum();
    if power > 0.0 { Ok((error / power).sqrt()) } else { Err(ReadoutError::BlackReference) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image(data: &[f32]) -> Pixels {
        Pixels { width: data.len() as u32, height: 1, channels: 1, data: data.to_vec() }
    }

    #[test]
    fn relative_rms_is_zero_for_equals_and_scales() {
        let reference = image(&[3.0, 4.0]);
        assert_eq!(relative_rms(&reference, &reference).unwrap(), 0.0);
        let twice = relative_rms(&image(&[6.0, 8.0]), &reference).unwrap();
        assert!((twice - 1.0).abs() < 1e-12);
        let one_off = relative_rms(&image(&[3.0, 4.5]), &reference).unwrap();
        assert!((one_off - 0.1).abs() < 1e-12);
    }

    #[test]
    fn images_of_other_sizes_and_black_references_are_refused() {
        assert!(matches!(
            relative_rms(&image(&[1.0]), &image(&[1.0, 2.0])),
            Err(ReadoutError::Size(1, 1, 2, 1))
        ));
        assert!(matches!(
            relative_rms(&image(&[1.0]), &image(&[0.0])),
            Err(ReadoutError::BlackReference)
        ));
    }
}
