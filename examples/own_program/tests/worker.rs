//! The program as a worker, compared with itself.

use std::path::Path;
use std::sync::atomic::AtomicBool;

use fathom::Catalog;
use fathom::compare::flow::{self, CompareOptions, Program};
use fathom::compare::store::Comparison;
use fathom::compare::verdict::{Status, Verdicts};
use fathom::compare::worker_process::WorkerStart;
use fathom::record::comparison::{Gate, GateSettings};

/// Of times on a machine of any load no more is asked than that they are there.
#[test]
fn the_program_is_compared_with_itself() {
    let folder = tempfile::tempdir().unwrap();
    let command = format!("'{}'", env!("CARGO_BIN_EXE_worker"));
    let program =
        Program { label: "worker".to_owned(), start: WorkerStart::from_command(&command) };
    let options = CompareOptions {
        catalog: Catalog::builtin(),
        programs: [program.clone(), program],
        cells_file: Some(Path::new(env!("CARGO_MANIFEST_DIR")).join("cells.toml")),
        base_cells: None,
        filter: None,
        env_values: false,
        settings: GateSettings { launches: 2, pairs: 2, ..GateSettings::default() },
        resume: false,
        checkout: None,
    };
    let out = flow::lock_output(Some(&folder.path().join("out")), "", false).unwrap();
    let held = flow::measure(&options, out, &AtomicBool::new(false), &|_| ());
    let stored = Comparison::read(&held.expect("it is compared").output.folder).unwrap();
    assert!(stored.faults.is_empty(), "{:?}", stored.faults);
    if cfg!(target_os = "linux") && stored.header.adapter.software {
        assert!(stored.launches.iter().all(|launch| launch.core.is_some()));
    }
    let skipped: Vec<Gate> = stored.header.skipped.iter().map(|skip| skip.gate).collect();
    assert_eq!(skipped, [Gate::Exact, Gate::Instructions]);
    // Two launches of two pairs, of six cells and the control.
    let pairs = stored.pairs.iter().filter(|pair| !pair.second);
    assert_eq!(pairs.clone().count(), 2 * 2 * 7);
    assert!(pairs.into_iter().all(|pair| pair.base_ns > 0.0 && pair.head_ns > 0.0));
    assert_eq!(Verdicts::judge(&stored).status, Status::Inconclusive);
}
