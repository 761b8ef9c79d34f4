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
pub mod visits;

/// How this program was built: cargo's profile, the compiler, its flags and for what.
pub const BUILT_WITH: [(&str, &str); 5] = [
    ("profile", env!("FATHOM_PROFILE")),
    ("opt-level", env!("FATHOM_OPT_LEVEL")),
    ("target", env!("FATHOM_TARGET")),
    ("flags", env!("FATHOM_FLAGS")),
    ("compiler", env!("FATHOM_COMPILER")),
];
