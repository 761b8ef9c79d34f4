//! `fathom dump`: a stage's outputs as `.npy` files, each with a JSON file that says what it holds.

use std::io::BufWriter;
use std::path::{Path, PathBuf};

use anyhow::{Result, anyhow, bail};
use serde_json::{Value, json};

use super::picture::write_error;
use super::render;
use super::subject::Subject;
use fathom_base::folder::Dir;
use fathom_base::npy;
use fathom_base::text::did_you_mean;
use fathom_gpu::{Gpu, read_buffer, read_texture, read_volume};
use fathom_stages::{OutputData, Stage, StageDump};

/// Runs one frame of the subject and writes the outputs of `stage` into `folder`, which is made if need be.
/// Gives the `.npy` files' paths.
///
/// A texture becomes an array of shape (height, width, channels), row 0 at the top; a volume one of shape (z, y, x), with
/// channels last where it has several; a buffer one of shape (elements, columns). All values are 32-bit floats in C order.
pub fn dump(gpu: &Gpu, subject: &Subject, stage: &str, folder: &Path) -> Result<Vec<PathBuf>> {
    let pipeline = render::frame(gpu, subject)?;
    let stages = pipeline.stages();
    let outputs = &find(&stages, stage)?.dumps;
    let context = pipeline.context(stage);
    if outputs.is_empty() {
        bail!("stage `{stage}` leaves nothing to dump");
    }
    let folder = Dir::make(folder).map_err(|error| write_error(folder, error))?;
    outputs.iter().map(|output| write(gpu, subject, stage, &context, output, &folder)).collect()
}

fn find<'a>(stages: &[&'a Stage], name: &str) -> Result<&'a Stage> {
    let found = stages.iter().find(|stage| stage.name() == name);
    found.copied().ok_or_else(|| {
        let hint = did_you_mean(name, stages.iter().map(|stage| stage.name()));
        anyhow!("this pipeline runs no stage `{name}`{hint}")
    })
}

fn write(
    gpu: &Gpu,
    subject: &Subject,
    stage: &str,
    context: &Value,
    output: &StageDump,
    folder: &Dir,
) -> Result<PathBuf> {
    let (shape, values) = read(gpu, output)?;
    let stem = format!("{}-{}", stage.replace('/', "-"), output.name.replace('/', "-"));
    let name = format!("{stem}.npy");
    let path = folder.path().join(&name);
    folder
        .check_own(&name, npy::MAGIC)
        .and_then(|()| {
            folder.write_with(&name, |file| npy::write(BufWriter::new(file), &shape, &values))
        })
        .map_err(|error| write_error(&path, error))?;
    let mut about = describe(subject, stage, output, &shape);
    for (key, value) in context.as_object().into_iter().flatten() {
        about[key] = value.clone();
    }
    let beside = format!("{stem}.json");
    let written = folder.write_own(&beside, format!("{about:#}\n").as_bytes());
    written.map_err(|error| write_error(&folder.path().join(beside), error))?;
    Ok(path)
}

/// Shape and values of an output.
pub fn read(gpu: &Gpu, output: &StageDump) -> Result<(Vec<usize>, Vec<f32>)> {
    Ok(match &output.data {
        OutputData::Buffer { buffer, stride_floats, count, row } => {
            let floats: Vec<f32> = bytemuck::pod_collect_to_vec(&read_buffer(gpu, buffer)?);
            let elements = floats.chunks_exact(*stride_floats as usize);
            let data = elements.take(*count as usize).flat_map(row).collect();
            (vec![*count as usize, output.columns.len()], data)
        }
        OutputData::Texture(texture) => {
            let pixels = read_texture(gpu, texture)?;
            let shape = [pixels.height, pixels.width, pixels.channels];
            (shape.map(|extent| extent as usize).to_vec(), pixels.data)
        }
        OutputData::Volume { texture, level, .. } => {
            let texels = read_volume(gpu, texture, *level)?;
            let [x, y, z] = texels.cells.map(|extent| extent as usize);
            let mut shape = vec![z, y, x];
            shape.extend((texels.channels > 1).then_some(texels.channels as usize));
            (shape, texels.data)
        }
    })
}

fn describe(subject: &Subject, stage: &str, output: &StageDump, shape: &[usize]) -> Value {
    let mut about = json!({
        "stage": stage,
        "output": output.name,
        "meaning": output.meaning,
        "shape": shape,
        "axes": axes(output, shape.len()),
        "memory": "C order: the last axis runs fastest; little-endian 32-bit floats",
        "columns": output.columns,
        "pipeline": subject.kind.name,
        "scene": subject.scene_name,
        "stand_ins": subject.scene.stand_ins,
        "conventions": "right-handed world, +Y up, metres, water at rest is y = 0, seconds, \
            depth 0 (near) to 1 (far), light directions point the way the light travels",
        "params": subject.params,
    });
    if let OutputData::Volume { level, origin_m, spacing_m, .. } = &output.data {
        about["grid"] = json!({
            "level": level,
            "origin_m": origin_m.to_array(),
            "spacing_m": spacing_m.to_array(),
            "centre_m": "origin_m + spacing_m * (x + 0.5, y + 0.5, z + 0.5), component by component",
        });
    }
    about
}

fn axes(output: &StageDump, count: usize) -> Value {
    match output.data {
        OutputData::Buffer { .. } => json!(["element", "column"]),
        OutputData::Texture(_) => json!(["row, from the top", "column, from the left", "channel"]),
        OutputData::Volume { .. } => json!(["z", "y", "x", "channel"][..count]),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use fathom_gpu::Options;
    use fathom_scene::Grid;
    use fathom_stages::kit::Resources;
    use fathom_stages::voxels::Voxels;

    /// A volume whose cell (x, y, z) of 3 × 2 × 5 holds 10 + x + 3 (y + 2 z).
    #[test]
    fn volumes_are_dumped_with_z_outermost() {
        let gpu = Gpu::open(&Options::default()).expect("an adapter is there");
        let resources = Resources::new(&gpu);
        let grid = Grid { cells: [3, 2, 5], origin_m: glam::DVec3::ZERO, voxel_m: 0.5 };
        let voxels = Voxels::new(&resources, "volume", &grid, true);
        let values: Vec<u8> = (10..40).collect();
        voxels.write(&resources, &values);
        let output = |level: u32| StageDump {
            name: "volume".into(),
            meaning: String::new(),
            columns: Vec::new(),
            data: OutputData::Volume {
                texture: voxels.texture.clone(),
                level,
                origin_m: grid.origin_m,
                spacing_m: glam::DVec3::splat(grid.voxel_m * f64::from(1u32 << level)),
            },
        };
        let (shape, texels) = read(&gpu, &output(0)).unwrap();
        assert_eq!(shape, [5, 2, 3]);
        for ((z, y, x), expected) in [((0, 0, 0), 10.0), ((4, 1, 2), 39.0), ((2, 0, 1), 23.0)] {
            let byte = (texels[x + 3 * (y + 2 * z)] * 255.0).round();
            assert_eq!(byte, expected, "({x}, {y}, {z})");
        }
        assert_eq!(read(&gpu, &output(1)).unwrap().0, [2, 1, 1]);
        assert_eq!(axes(&output(0), 3), json!(["z", "y", "x"]));
    }
}
