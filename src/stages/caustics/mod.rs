pub mod filter;
pub mod splat;
pub mod trace;
