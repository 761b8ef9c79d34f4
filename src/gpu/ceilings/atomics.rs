//! Atomic adds to words in memory.

use super::invocations::{Answer, Code, Invocations, invocations, words};
use super::kernel::all_are;
use crate::{Gpu, GpuError};
use fathom_record::ceilings::Addresses;

/// Adds of an invocation in a turn.
const ADDS: u32 = 8;

/// Atomic adds to a buffer.
pub(super) fn atomics(gpu: &Gpu, addresses: Addresses) -> Result<Invocations, GpuError> {
    let contended = addresses == Addresses::Contended;
    let defs = [("CONTENDED", i32::from(contended))];
    let code =
        Code { path: "ceilings/atomics", entry: "main", defs: &defs, reads: vec![], within: 0 };
    let invocations = invocations(gpu);
    let answer: Answer = Box::new(move |turns, results| {
        let adds = ADDS.wrapping_mul(turns);
        let adds = if contended { adds.wrapping_mul(invocations) } else { adds };
        let used = if contended { 4 } else { results.len() };
        all_are(words(&results[..used]).map(f64::from), f64::from(adds), 0.0)
    });
    let per_turn = f64::from(invocations) * f64::from(ADDS);
    Invocations::new(gpu, code, per_turn, u32::MAX, answer)
}
