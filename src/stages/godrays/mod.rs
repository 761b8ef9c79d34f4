pub mod filter;
pub mod lines;
pub mod trace;
