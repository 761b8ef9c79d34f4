//! Names by a digest what of the program takes part in a measurement beside the cell: the clock, the worker, and wgpu.

#![allow(clippy::print_stdout)]

mod source_digest;

fn main() {
    let lock = "../../Cargo.lock";
    println!("cargo::rerun-if-changed={lock}");
    let packages = std::fs::read_to_string(lock).unwrap_or_default();
    let is_below = |package: &&str| {
        let name = package.trim_start().trim_start_matches("name = \"");
        ["wgpu", "naga", "ash\"", "glow\"", "metal", "gpu-"].iter().any(|of| name.starts_with(of))
    };
    let below: String = packages.split("[[package]]").filter(is_below).collect();
    let files = ["worker.rs", "valgrind.rs"].map(Into::into).to_vec();
    let sum = source_digest::digest(files, vec!["../clock".into()], &below);
    println!("cargo::rustc-env=FATHOM_MEASURED_BY={sum:016x}");
}
