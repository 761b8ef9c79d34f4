//! How far the clocks of a run can be trusted.

use fathom_record::{Clock, PassKind, Run};

/// What a kind of pass was timed by, and what the audit said of that clock.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum ClockTrust {
    /// It agrees with the host clock wherever it was audited.
    Sound,
    /// The host clock around fenced submissions, which others are audited against.
    Host,
    /// The records hold no audit of it.
    NotAudited,
    /// The audit found it unusable, and it was used all the same.
    Unsound,
}

/// Of each kind of pass, the clock and what it is worth.
pub fn clocks(run: &Run) -> impl Iterator<Item = (PassKind, Clock, ClockTrust)> {
    let kinds = run.clocks.iter().filter(|(kind, _)| **kind != PassKind::Host);
    kinds.map(|(kind, clock)| (*kind, *clock, trust(run, *kind, *clock)))
}

fn trust(run: &Run, kind: PassKind, clock: Clock) -> ClockTrust {
    if matches!(clock, Clock::FencedHost | Clock::Host) {
        return ClockTrust::Host;
    }
    let rows = || run.audit.iter().filter(|row| row.pass == kind && row.clock == clock);
    match rows().next() {
        None => ClockTrust::NotAudited,
        Some(_) if rows().all(|row| row.sound) => ClockTrust::Sound,
        Some(_) => ClockTrust::Unsound,
    }
}

#[cfg(test)]
mod tests {
    use itertools::Itertools;

    use super::*;
    use fathom_experiments::fixtures;

    #[test]
    fn clocks_are_worth_what_the_audit_said() {
        let mut run = fixtures::header(fathom_record::Profile::Quick);
        let found = |run: &Run| clocks(run).map(|(_, _, trust)| trust).collect_vec();
        assert_eq!(
            found(&run),
            [ClockTrust::Sound, ClockTrust::Host].into_iter().rev().collect_vec()
        );
        run.clocks.insert(PassKind::Compute, Clock::Timestamp);
        assert_eq!(found(&run)[0], ClockTrust::Unsound);
        run.audit.clear();
        assert_eq!(found(&run), [ClockTrust::NotAudited; 2]);
    }
}
