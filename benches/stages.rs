//! Criterion over every stage, through the audited clock, so that criterion's reports show GPU time.
//!
//! The underwater stages run at the base size of UW §4.1 on scene `tank`. Throughput is in photons for the traces and in blended
//! fragments, as counted, for splats and lines. Splats of the base size (5 px) and of 20 px, the largest of UW §4.1, are added up by compute
//! and by the rasterizer. What binds each is told in `src/stages/caustics/splat.rs`.
//!
//! Voxelization runs on scene `bunny_dry` at 128 voxels by each method, with throughput in triangles; the marching at the
//! 600 × 600 pixels and 400 samples per pixel of VAO Fig. 8, with throughput in the samples that are really taken; the rest at
//! small sizes. Stages that no group here runs are measured in their gate cells.

use criterion::Criterion;
use fathom::Catalog;
use fathom::bench::{self, StageBench};
use fathom::compare::cells::Gates;
use fathom::gpu::{Gpu, GpuError, Options, audit, audit_table};
use fathom::harness::subject::{Subject, Subjects};
use fathom::parameter;
use fathom::pipelines::AnyPipeline;
use fathom::pipelines::underwater;
use serde_json::{Value, json};

fn main() {
    if let Err(error) = run() {
        eprintln!("error: {error:#}");
        std::process::exit(2);
    }
}

/// One configuration of a pipeline.
struct Group {
    name: &'static str,
    pipeline: &'static str,
    scene: &'static str,
    params: Vec<(&'static str, Value)>,
    /// Stages to measure, `FAMILY/` for all of a family; none means all that no earlier group has measured.
    stages: &'static [&'static str],
}

fn groups() -> Vec<Group> {
    let group =
        |name, pipeline, scene, params, stages| Group { name, pipeline, scene, params, stages };
    let voxelize = |name, method| {
        let size = [("view.width", json!(64)), ("view.height", json!(64))];
        let method = [("voxel.method", json!(method)), ("voxel.resolution", json!(128))];
        let params = size.into_iter().chain(method).collect();
        group(name, "voxelize", "bunny_dry", params, &["voxel/"])
    };
    let splats = |name, splatting, side_px: f64| {
        let params = vec![
            ("caustics.splatting", json!(splatting)),
            ("caustics.point_size_min_px", json!(side_px)),
        ];
        group(name, "underwater", "tank", params, &["caustics/splat"])
    };
    let small = || vec![("view.width", json!(96)), ("view.height", json!(96))];
    let with = |more: Vec<(&'static str, Value)>| small().into_iter().chain(more).collect();
    vec![
        group("underwater", "underwater", "tank", Vec::new(), &[]),
        splats("underwater, splats of 20 px", "compute", 20.0),
        splats("underwater, rasterized splats", "raster", 5.0),
        splats("underwater, rasterized splats of 20 px", "raster", 20.0),
        voxelize("voxelize, slicemap", "slicemap"),
        voxelize("voxelize, slice", "slice"),
        voxelize("voxelize, overlap", "overlap"),
        voxelize("voxelize, thin overlap", "overlap_thin"),
        voxelize("voxelize, alpha", "max_alpha"),
        group(
            "volume_ao, 400 samples per pixel",
            "volume_ao",
            "bunny_dry",
            vec![("ao.rays", json!(50)), ("ao.samples", json!(8))],
            &["ao/march"],
        ),
        group("volume_ao", "volume_ao", "bunny_dry", with(vec![("ao.skipping", json!(true))]), &[]),
        group(
            "volume_ao, moving",
            "volume_ao",
            "bunny_dry",
            with(vec![("animation.deform", json!("twist"))]),
            &[],
        ),
        group("hsao", "hsao", "bunny_dry", small(), &[]),
        group("isosurface", "scalar_ao", "smoke", small(), &[]),
        group("direct", "scalar_ao", "smoke", with(vec![("scalar.mode", json!("direct"))]), &[]),
        group(
            "positional",
            "scalar_ao",
            "smoke",
            with(vec![("scalar.mode", json!("positional"))]),
            &[],
        ),
    ]
}

struct Suite {
    bench: StageBench,
    subjects: Subjects,
    measured: Vec<&'static str>,
}

fn run() -> anyhow::Result<()> {
    let gpu = Gpu::open(&Options::default())?;
    let clock = audit(&gpu)?;
    println!("{}", audit_table(&clock));
    let criterion = Criterion::default().configure_from_args();
    let mut suite = Suite {
        bench: StageBench::new(gpu, clock.plan, criterion)?,
        subjects: Subjects::default(),
        measured: Vec::new(),
    };
    for group in groups() {
        suite.group(&group)?;
    }
    let Suite { mut bench, measured, .. } = suite;
    let catalog = Catalog::builtin();
    let mut gates = Gates::load(None, catalog.gates)?;
    for cell in &mut gates.configurations {
        cell.stages.retain(|stage| !measured.contains(&stage.as_str()));
    }
    bench::gate_cells(&catalog, &mut bench, gates)?;
    bench.finish();
    Ok(())
}

impl Suite {
    fn group(&mut self, group: &Group) -> anyhow::Result<()> {
        let params = group.params.iter();
        let params: Vec<_> =
            params.map(|(path, value)| ((*path).to_owned(), value.clone())).collect();
        let subject = self.subjects.subject(group.pipeline, group.scene, &params)?;
        let pipeline = subject.build(&self.bench.gpu)?;
        let stages = pipeline.stages();
        self.bench.warm_up(&stages)?;
        let blended = match group.pipeline {
            "underwater" => {
                let params = subject.parameters::<underwater::Underwater>()?;
                underwater::blended_fragments(&self.bench.gpu, &subject.scene, params)?
            }
            _ => Default::default(),
        };
        let samples = counted_samples(&self.bench.gpu, &subject, pipeline.as_ref())?;
        for stage in stages {
            let name = stage.name();
            let wanted = match group.stages {
                [] => !self.measured.contains(&name),
                named => named.iter().any(|wanted| {
                    if wanted.ends_with('/') { name.starts_with(wanted) } else { name == *wanted }
                }),
            };
            if wanted {
                let counted = match name {
                    "ao/march" => samples,
                    _ => blended.get(name).copied(),
                };
                self.measured.push(name);
                self.bench.stage(group.name, stage, counted)?;
            }
        }
        Ok(())
    }
}

/// Samples of volumes that a frame takes, where the pipeline counts them.
fn counted_samples(
    gpu: &Gpu,
    subject: &Subject,
    pipeline: &AnyPipeline,
) -> Result<Option<u64>, GpuError> {
    let quantities = pipeline.quantities(gpu)?;
    let number = |path| parameter::get(&subject.params, path).and_then(Value::as_f64);
    let samples = || {
        let covered =
            quantities.get("covered_share")? * number("view.width")? * number("view.height")?;
        Some(quantities.get("samples_per_pixel_mean")? * covered * number("ao.scale")?.powi(2))
    };
    Ok(samples().map(|count| count.round() as u64))
}
