//! A sample of faults in shaders: `fathom verify` finds nearly all that change an output.
#![cfg(feature = "nightly")]

use std::process::Command;

#[test]
fn checks_find_faults_of_shaders() {
    let folder = tempfile::tempdir().unwrap();
    let mut mutants = Command::new(env!("CARGO_BIN_EXE_fathom-selftest"));
    mutants.args(["mutants", "--count", "20", "--seed", "65", "--out"]).arg(folder.path());
    let status = mutants.status().unwrap();
    let table = std::fs::read_to_string(folder.path().join("mutants.md")).unwrap_or_default();
    assert!(status.success(), "{table}");
}
