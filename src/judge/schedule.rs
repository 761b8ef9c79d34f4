//! What the gate of time measures: cells, launches, and rounds of each.

use std::collections::BTreeSet;

use fathom_record::comparison::CellId;

/// The second measurement has up to so many times the rounds of the first, as far as it takes no longer than that. With 64
/// pairs instead of 16 the figures of launches of `scene/gbuffer` scattered by 1.1 to 2.0 % instead of 2.6 to 3.8 % (llvmpipe).
pub const MORE_PAIRS: u32 = 4;

#[derive(Clone, Debug)]
pub struct GateSchedule {
    pub cells: Vec<CellId>,
    /// Measured once more with the base on both sides.
    pub control: Option<CellId>,
    pub launches: u32,
    /// Rounds of each launch.
    pub pairs: u32,
    pub seed: u64,
    /// It is the second measurement.
    pub second: bool,
}

impl GateSchedule {
    pub fn first_launches(&self, launches: u32) -> Self {
        Self { launches: self.launches.min(launches), ..self.clone() }
    }

    pub fn without_settled(mut self, settled: &BTreeSet<CellId>) -> Self {
        self.cells.retain(|cell| !settled.contains(cell));
        self
    }

    /// The second measurement, of the cells that this one left open.
    pub fn second_measurement(&self, open: Vec<CellId>) -> Self {
        let room = self.pairs as usize * self.cells.len() / open.len().max(1);
        let max_pairs = (MORE_PAIRS * self.pairs) as usize;
        Self {
            pairs: room.clamp(self.pairs as usize, max_pairs) as u32,
            cells: open,
            second: true,
            ..self.clone()
        }
    }
}
