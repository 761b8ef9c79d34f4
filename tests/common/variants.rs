//! Every shader that fathom can link, by its path and the values that it is compiled with.

use std::collections::BTreeSet;

use fathom::Catalog;
use fathom::compare::cells::Gates;
use fathom::embedded::{Folders, SHADERS};
use fathom::gpu::{CodeKey, Gpu, shader_paths};
use fathom::harness::plan::{Request, expand};
use fathom::harness::subject::Subjects;
use fathom::record::Profile;
use serde_json::Value;

/// Of the adapter's limits, beside the defaults.
const LIMITS: [(&str, (&str, i32)); 2] =
    [("ceilings/raster", ("UNORM", 0)), ("ceilings/raster", ("UNORM", 1))];

/// Of what no pipeline plans, and of what is planned: all cells of all experiments, their references, the gates, and each
/// pipeline with each choice of its parameters.
pub fn planned() -> BTreeSet<CodeKey> {
    let (catalog, planner) = (Catalog::builtin(), Gpu::planner().unwrap());
    for kind in &catalog.kinds {
        catalog.stages_of(kind.name).unwrap();
    }
    let mut subjects = Subjects::new(&catalog).silent();
    let mut plan = |pipeline: &str, scene: &str, overrides: &[(String, Value)]| {
        subjects.subject(pipeline, scene, overrides).unwrap().plan().unwrap();
    };
    let request = Request::default();
    let experiments = request.load(&catalog).unwrap();
    let profiles = [Profile::Quick, Profile::Paper];
    let cells = profiles.map(|profile| expand(&experiments, &request, profile).unwrap());
    for cell in cells.iter().flatten().flatten() {
        let reference = cell.reference.iter().map(|reference| &reference.overrides);
        for overrides in std::iter::once(&cell.overrides).chain(reference) {
            plan(&cell.pipeline, &cell.scene, overrides);
        }
    }
    for cell in Gates::load(None, catalog.gates).unwrap().configurations {
        let overrides: Vec<_> = cell.params.into_iter().collect();
        plan(&cell.pipeline, &cell.scene, &overrides);
    }
    planner.shader_variants().into_iter().chain(unplanned()).collect()
}

/// Of shaders that no pipeline runs, and of each with its own defaults.
pub fn unplanned() -> BTreeSet<CodeKey> {
    let paths = shader_paths(&Folders::new(SHADERS));
    let defaults = paths.iter().map(|path| CodeKey::new(path, &[]));
    defaults.chain(LIMITS.map(|(path, def)| CodeKey::new(path, &[def]))).collect()
}
