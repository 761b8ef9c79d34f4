//! How far a cell's result is from that of its reference run: the same cell with other parameters.

use std::collections::HashMap;

use thiserror::Error;

use super::subject::Subject;
use fathom_gpu::{FrameTimer, Gpu, GpuError, Pixels, read_texture};
use fathom_pipelines::AnyPipeline;
use fathom_stages::OutputData;

/// Why nothing can be told of images that stages left behind.
#[derive(Debug, Error)]
pub enum ReadoutError {
    #[error(transparent)]
    Gpu(#[from] GpuError),
    #[error("no stage of {0} leaves a texture")]
    NoTexture(String),
    #[error("the cell's image has {0} × {1} pixels, the reference's {2} × {3}")]
    Size(u32, u32, u32, u32),
    #[error("the reference is black")]
    BlackReference,
    #[error("the repetitions' images differ in size")]
    Sizes,
    #[error("the image is black")]
    Black,
}

/// Texels of the first texture that the first present of the named stages leaves.
pub fn image(gpu: &Gpu, pipeline: &AnyPipeline, stages: &[String]) -> Result<Pixels, ReadoutError> {
    let present = pipeline.stages();
    let named = |name: &String| present.iter().find(|stage| stage.name() == name);
    let mut outputs = stages.iter().find_map(named).into_iter().flat_map(|stage| &stage.outputs);
    let texture = outputs.find_map(|output| match &output.data {
        OutputData::Texture(texture) => Some(texture),
        _ => None,
    });
    let texture = texture.ok_or_else(|| ReadoutError::NoTexture(stages.join(", ")))?;
    Ok(read_texture(gpu, texture)?)
}

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
        cell: &AnyPipeline,
        (subject, stages): (&Subject, &[String]),
    ) -> Result<f64, ReadoutError> {
        let known = self.images(gpu, timer, subject, &[stages])?;
        relative_rms(&image(gpu, cell, stages)?, known[0])
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
                let image = image(gpu, pipeline.as_ref(), stages)?;
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
