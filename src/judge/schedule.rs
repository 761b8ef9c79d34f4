//! What the gate of time measures: cells, launches, and rounds of each.

use fathom_record::comparison::CellId;

#[derive(Clone, Debug)]
pub struct GateSchedule {
    pub cells: Vec<CellId>,
    /// Measured once more with one build on both sides.
    pub control: Option<CellId>,
    /// All those that the comparison then has.
    pub launches: u32,
    /// Rounds of each launch.
    pub pairs: u32,
    pub seed: u64,
}
