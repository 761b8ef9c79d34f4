//! `fathom query`: ambient occlusion at the points of a CSV file.

mod table;

use std::io::{Read, Write};
use std::path::Path;

use anyhow::{Result, anyhow, ensure};
use glam::DVec3;
use rayon::prelude::*;

use super::subject::Subject;
use fathom_base::input;
use fathom_gpu::{Gpu, GpuError};
use fathom_pipelines::occlusion::exact as attenuation;
use fathom_pipelines::settings::Deform;
use fathom_pipelines::volume_ao::{VolumeAo, occlusion_at, point_query};
use fathom_reference::occlusion as exact;
use fathom_reference::rays::Tracer;
use fathom_stages::ao::query::SurfacePoint;
use fathom_stages::kit::Resources;
use fathom_stages::marching::Occluder;
use table::SHORT;

/// Columns that a file of points must have, in any order and among others.
const COLUMNS: [&str; 6] = ["x", "y", "z", "nx", "ny", "nz"];
/// The added column.
const ANSWER: &str = "occlusion";
/// Largest file of points, bytes: five million points of the shortest lines, which take 0.3 GiB.
const MAX_POINTS_FILE: u64 = 64 << 20;
/// The columns that a reference adds.
const REFERENCE: [&str; 2] = ["reference", "error"];
/// Rays of a reference unless told otherwise: its own error is below 0.005.
pub const REFERENCE_RAYS: u32 = 1024;

/// A surface point as its file has it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfaceRow {
    pub position_m: DVec3,
    /// Of any length.
    pub normal: DVec3,
}

/// The points of a CSV file with the columns x, y, z (metres) and nx, ny, nz; others are left aside. An error names the first
/// fault, its line and column.
pub fn read(path: &Path) -> Result<Vec<SurfaceRow>> {
    let shown = path.display();
    let file = input::open_limited(path, MAX_POINTS_FILE);
    let file = file.map_err(|error| anyhow!("cannot read {shown}: {error}"))?;
    parse(file).map_err(|fault| anyhow!("{shown}, {fault}"))
}

fn parse(text: impl Read) -> Result<Vec<SurfaceRow>> {
    table::read(text, &COLUMNS)?.into_iter().map(row).collect()
}

fn row((line, numbers): table::TableRow) -> Result<SurfaceRow> {
    let [position_m, normal] = [0, 3].map(|at| DVec3::from_slice(&numbers[at..]));
    let length = normal.length();
    ensure!(
        length >= SHORT,
        "line {line}, columns `nx`, `ny`, `nz`: a normal of length {length} has no direction"
    );
    Ok(SurfaceRow { position_m, normal })
}

/// Ambient occlusion at each point by the volumes and rays of a subject of the pipeline `volume_ao`: 0 open … 1 closed.
/// What is beyond the adapter's limits is an error before anything is allocated.
pub fn occlusion(gpu: &Gpu, subject: &Subject, rows: &[SurfaceRow]) -> Result<Vec<f32>> {
    let params = subject.parameters::<VolumeAo>()?;
    let point = |row: &SurfaceRow| SurfacePoint {
        position_m: row.position_m.as_vec3(),
        normal: row.normal.normalize().as_vec3(),
    };
    let points: Vec<SurfacePoint> = rows.iter().map(point).collect();
    let plan = |resources: &Resources<'_>| {
        point_query(resources, &subject.scene, &params, &points).map(drop)
    };
    check(gpu, plan)?;
    Ok(gpu.catch(|| occlusion_at(gpu, &subject.scene, &params, &points))?)
}

/// Holds what `plan` makes against the adapter, before anything is allocated.
fn check(gpu: &Gpu, plan: impl FnOnce(&Resources<'_>) -> Result<(), GpuError>) -> Result<()> {
    let planner = Gpu::planner()?;
    let resources = Resources::new(planner);
    planner.catch(|| plan(&resources))?;
    gpu.check(&resources.into_parts().demand).map_err(anyhow::Error::msg)
}

/// The same by casting `rays` rays from each point at the scene's triangles, all of them opaque and at rest. It is an error where
/// geometry moves, or where rays pass through transparent objects.
pub fn reference(subject: &Subject, rows: &[SurfaceRow], rays: u32) -> Result<Vec<f64>> {
    let params = subject.parameters::<VolumeAo>()?;
    ensure!(
        params.animation.deform == Deform::None,
        "--reference: the geometry moves (animation.deform), and the reference knows it at rest only"
    );
    let opaque = subject.scene.objects.iter().all(|o| o.material.alpha >= 1.0);
    ensure!(
        opaque || params.ao.occluder != Occluder::Opacity,
        "--reference: with ao.occluder=opacity rays pass through transparent objects, those of the reference do not"
    );
    let marching = params.marching(&subject.scene);
    let attenuation = attenuation(marching.attenuation);
    let tracer = Tracer::new(&subject.scene.objects);
    let answer = |row: &SurfaceRow| {
        let normal = row.normal.normalize();
        exact::occlusion(&tracer, row.position_m, normal, marching.r_max_m, attenuation, rays)
    };
    Ok(rows.par_iter().map(answer).collect())
}

/// Writes the points in their order with their occlusion, and with the reference and the difference from it where there is
/// one; `target` names the writer in errors.
pub fn write(
    target: &str,
    writer: impl Write,
    rows: &[SurfaceRow],
    occlusion: &[f32],
    reference: Option<&[f64]>,
) -> Result<()> {
    let more = REFERENCE.iter().filter(|_| reference.is_some());
    let header = COLUMNS.iter().chain([&ANSWER]).chain(more).map(ToString::to_string).collect();
    let row = |(i, (row, occlusion)): (usize, (&SurfaceRow, &f32))| {
        let occlusion = f64::from(*occlusion);
        let exact = reference.and_then(|all| all.get(i));
        let exact = exact.map(|exact| [*exact, occlusion - exact]);
        let answers = [occlusion].into_iter().chain(exact.into_iter().flatten());
        let numbers = numbers([row.position_m, row.normal]);
        numbers.chain(answers.map(|answer| format!("{answer:.6}"))).collect()
    };
    write_rows(target, writer, header, rows.iter().zip(occlusion).enumerate().map(row))
}

/// The fields of two vectors.
fn numbers(vectors: [DVec3; 2]) -> impl Iterator<Item = String> {
    vectors.into_iter().flat_map(|v| v.to_array()).map(|number| number.to_string())
}

/// Writes rows below a header; `target` names the writer in errors.
fn write_rows(
    target: &str,
    writer: impl Write,
    header: Vec<String>,
    mut rows: impl Iterator<Item = Vec<String>>,
) -> Result<()> {
    let mut csv = csv::Writer::from_writer(writer);
    let written =
        csv.write_record(header).and_then(|()| rows.try_for_each(|row| csv.write_record(row)));
    let written = written.and_then(|()| csv.flush().map_err(csv::Error::from));
    written.map_err(|error| anyhow!("cannot write {target}: {error}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_are_found_by_name_and_others_left_aside() {
        let text = "name,nz, ny,nx,z,y,x\n\"a, b\",0,2,0,3, 2,1\n";
        let row =
            SurfaceRow { position_m: DVec3::new(1.0, 2.0, 3.0), normal: DVec3::new(0.0, 2.0, 0.0) };
        let rows = parse(text.as_bytes()).unwrap();
        assert_eq!(rows, [row]);
        let plain = "x,y,z,nx,ny,nz,occlusion\n1,2,3,0,2,0,0.250000\n";
        let referred =
            "x,y,z,nx,ny,nz,occlusion,reference,error\n1,2,3,0,2,0,0.250000,0.500000,-0.250000\n";
        for (reference, expected) in [(None, plain), (Some(&[0.5][..]), referred)] {
            let mut out = Vec::new();
            write("memory", &mut out, &rows, &[0.25], reference).unwrap();
            assert_eq!(String::from_utf8(out).unwrap(), expected);
        }
    }

    #[test]
    fn faults_name_line_and_column() {
        let fault = |text: &str| parse(text.as_bytes()).unwrap_err().to_string();
        let header = "x,y,z,nx,ny,nz\n";
        assert!(fault("x,y,z,nx,nz\n1,2,3,0,1\n").starts_with("line 1: there is no column `ny`"));
        assert!(fault("").starts_with("line 1: there is no column `x`"));
        assert_eq!(fault(header), "line 2: there is no point");
        let bad = fault(&format!("{header}1,2,3,0,1,0\n1,2,three,0,1,0\n"));
        assert!(bad.starts_with("line 3, column `z`: `three` is not"), "{bad}");
        for number in ["NaN", "inf", "1e7", ""] {
            let bad = fault(&format!("{header}1,{number},3,0,1,0\n"));
            assert!(bad.starts_with("line 2, column `y`"), "{bad}");
        }
        let bad = fault(&format!("{header}1,2,3,0,0,0\n"));
        assert!(bad.starts_with("line 2, columns `nx`, `ny`, `nz`"), "{bad}");
        let bad = fault(&format!("{header}1,2,3,0,1\n"));
        assert_eq!(bad, "line 2 has 5 fields, the header has 6");
    }
}
