//! Timestamps of clocks that are wrong in a known way, for tests.

use super::timer::Ticks;

/// What is wrong with timestamps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum ClockFault {
    /// A tick takes so many ns.
    Period(f64),
    /// So many bits are valid, and the counter begins again at zero in the middle of every frame.
    Bits(u32),
    Zero,
    /// The end of a pass has the timestamp of its begin.
    Equal,
    Backwards,
    /// Timestamps are multiples of so many ns.
    Step(f64),
}

impl ClockFault {
    /// What is read of a frame instead of ticks of this period.
    pub(crate) fn distort(self, ticks: &mut [Ticks], period_ns: f64) {
        let (Some([first, _]), Some([_, last])) = (ticks.first(), ticks.last()) else { return };
        let middle = first + last.saturating_sub(*first) / 2;
        let each = |ticks: &mut [Ticks], of: &dyn Fn(u64) -> u64| {
            ticks.as_flattened_mut().iter_mut().for_each(|tick| *tick = of(*tick));
        };
        match self {
            Self::Period(ns) => each(ticks, &|tick| (tick as f64 * period_ns / ns) as u64),
            Self::Bits(bits) => each(ticks, &|tick| {
                tick.wrapping_sub(middle) & u64::MAX.unbounded_shr(u64::BITS - bits)
            }),
            Self::Zero => each(ticks, &|_| 0),
            Self::Step(ns) => {
                let step = (ns / period_ns).max(1.0) as u64;
                each(ticks, &|tick| tick - tick % step);
            }
            Self::Equal => ticks.iter_mut().for_each(|[begin, end]| *end = *begin),
            Self::Backwards => ticks.iter_mut().for_each(|ticks| ticks.swap(0, 1)),
        }
    }
}
