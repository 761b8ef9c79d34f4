pub mod filter;
pub mod mesh;
pub mod splat;
pub mod trace;
