//! What changed from one run to another. Exact figures are those of the exact gate.

pub mod cells;
pub mod claims;
