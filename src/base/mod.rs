//! What every other crate of fathom stands on: parameters, text, printing, files that a user names, medians with intervals,
//! conditions that keep noise down, and the folders that come with the program.

pub mod embedded;
pub mod input;
pub mod npy;
pub mod parameter;
pub mod quiet;
pub mod statistics;
pub mod tell;
pub mod text;
