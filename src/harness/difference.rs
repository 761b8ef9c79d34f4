//! How far a cell's result is from that of its reference run: the same cell with other parameters.

use std::collections::HashMap;

use anyhow::{Context, Result, ensure};

use super::subject::Subject;
use fathom_gpu::{FrameTimer, Gpu, Pixels, Stage, read_texture};
use fathom_pipelines::AnyPipeline;
use fathom_stages::OutputData;

/// The first of the named stages that the pipeline has.
fn first_present<'p>(pipeline: &'p AnyPipeline, stages: &[String]) -> Option<&'p Stage> {
    let present = pipeline.stages();
    stages.iter().find_map(|name| present.iter().find(|stage| stage.name() == name)).copied()
}

/// Runs a frame as far as [`image()`] of each of these lists of stages needs it.
pub fn run_to(
    gpu: &Gpu,
    timer: &mut FrameTimer,
    pipeline: &AnyPipeline,
    outputs: &[&[String]],
) -> Result<()> {
    let read: Vec<&str> =
        outputs.iter().filter_map(|stages| Some(first_present(pipeline, stages)?.name())).collect();
    Ok(timer.run_stages(gpu, &pipeline.stages_up_to(&read)).map(drop)?)
}

/// Texels of the first texture that the first present of the named stages leaves.
pub fn image(gpu: &Gpu, pipeline: &AnyPipeline, stages: &[String]) -> Result<Pixels> {
    let stage = first_present(pipeline, stages);
    let mut outputs = stage.into_iter().flat_map(|stage| &stage.dumps);
    let texture = outputs.find_map(|output| match &output.data {
        OutputData::Texture(texture) => Some(texture),
        _ => None,
    });
    let missing = || format!("no stage of {} leaves a texture", stages.join(", "));
    Ok(read_texture(gpu, texture.with_context(missing)?)?)
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
        reference: &Subject,
        stages: &[String],
    ) -> Result<f64> {
        let known = self.images(gpu, timer, reference, &[stages])?;
        relative_rms(&image(gpu, cell, stages)?, known[0])
    }

    /// What the first present of each list's stages leaves, in a run of the subject that is made unless all of it is known.
    pub fn images(
        &mut self,
        gpu: &Gpu,
        timer: &mut FrameTimer,
        subject: &Subject,
        outputs: &[&[String]],
    ) -> Result<Vec<&Pixels>> {
        let key =
            |stages: &[String]| format!("{stages:?} {} {}", subject.scene_name, subject.params);
        let keys: Vec<String> = outputs.iter().map(|stages| key(stages)).collect();
        if !keys.iter().all(|key| self.images.contains_key(key)) {
            let pipeline = subject.build(gpu)?;
            run_to(gpu, timer, &pipeline, outputs)?;
            for (key, stages) in keys.iter().zip(outputs) {
                let image = image(gpu, pipeline.as_ref(), stages)?;
                self.images.insert(key.clone(), image);
            }
        }
        Ok(keys.iter().map(|key| &self.images[key]).collect())
    }
}

fn relative_rms(image: &Pixels, reference: &Pixels) -> Result<f64> {
    let size = |of: &Pixels| format!("{} × {}", of.width, of.height);
    let (own, other) = (size(image), size(reference));
    ensure!(own == other, "the cell's image has {own} pixels, the reference's {other}");
    let square = |x: f64| x * x;
    let pairs = image.data.iter().zip(&reference.data);
    let error: f64 = pairs.map(|(a, b)| square(f64::from(*a) - f64::from(*b))).sum();
    let power: f64 = reference.data.iter().map(|b| square(f64::from(*b))).sum();
    ensure!(power > 0.0, "the reference is black");
    Ok((error / power).sqrt())
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
        let sizes = "the cell's image has 1 × 1 pixels, the reference's 2 × 1";
        for (reference, told) in [(&[1.0, 2.0][..], sizes), (&[0.0], "the reference is black")] {
            let error = relative_rms(&image(&[1.0]), &image(reference)).unwrap_err();
            assert_eq!(error.to_string(), told);
        }
    }
}
