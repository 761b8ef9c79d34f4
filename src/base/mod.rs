//! What every other crate of fathom stands on: parameters, text, printing, files that a user names, medians with intervals,
//! child processes and conditions that keep noise down.

#[cfg(feature = "embedded")]
pub mod embedded;
pub mod folder;
pub mod input;
pub mod machine;
pub mod npy;
pub mod parameter;
pub mod print;
pub mod private;
pub mod process;
pub mod quiet;
pub mod statistics;
pub mod text;
