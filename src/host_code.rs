//! Names by a digest all code that the program runs on the host: its sources and the libraries below them. Shaders and scenes are data.

#![allow(clippy::print_stdout)]

#[path = "compare/source_digest.rs"]
mod source_digest;

fn main() {
    let files = ["Cargo.toml", "Cargo.lock"].map(Into::into).to_vec();
    let code = source_digest::digest(files, vec!["src".into()], "");
    println!("cargo::rustc-env=FATHOM_HOST_CODE={code:016x}");
}
