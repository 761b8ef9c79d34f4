//! What every other crate of fathom stands on: parameters, text, printing, files that a user names, medians with intervals,
//! child processes, conditions that keep noise down, and the folders that come with the program.

pub mod embedded;
pub mod folder;
pub mod input;
pub mod npy;
pub mod parameter;
pub mod private;
pub mod process;
pub mod quiet;
pub mod statistics;
pub mod tell;
pub mod text;
