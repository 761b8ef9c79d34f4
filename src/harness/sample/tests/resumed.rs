//! What is kept of a run, and what the next one makes of it.

use super::*;

/// A noisy cell with rejected frames, one that compiles at first, and a slow one.
fn cells() -> Vec<MockCell> {
    let noisy = MockCell { faulty: |f| f % 8 == 5, ..cell(|f, _| 1e7 * noise(f, 0.9)) };
    let compiles = cell(|f, _| [9e7, 5e7, 2e7].get(f).copied().unwrap_or(1.5e7) * noise(f, 0.5));
    vec![noisy, compiles, cell(|f, _| 2e8 * noise(f, 0.3))]
}

const SHORT: Settings = SETTINGS;

fn by_cell(kept: &[(usize, Addition)]) -> BTreeMap<usize, Vec<Addition>> {
    let mut cells = BTreeMap::<usize, Vec<Addition>>::new();
    for (cell, added) in kept {
        cells.entry(*cell).or_default().push(added.clone());
    }
    cells
}

/// What a whole run leaves behind.
fn whole() -> Mock {
    Mock::of(cells()).run(&SHORT)
}

/// A run that has this from before.
fn resumed(earlier: &[(usize, Addition)]) -> Mock {
    Mock { earlier: by_cell(earlier), ..Mock::of(cells()) }
}

#[test]
fn what_is_kept_makes_up_all_samples_and_no_more_than_a_round_is_at_risk() {
    let mock = whole();
    assert_eq!(mock.safe, mock.kept.len());
    assert_eq!(mock.most_unsafe, 3, "each cell once");
    for (cell, additions) in by_cell(&mock.kept) {
        let samples = mock.samples(cell);
        let made_up =
            Samples { earlier_pairs: 0, stopped: samples.stopped, ..Samples::of(&additions) };
        assert_eq!(made_up, *samples);
        assert!(samples.pairs() >= MIN_PAIRS && samples.warm_up_frames >= 2);
    }
    assert!(!mock.samples(0).rejected.is_empty());
}

#[test]
fn a_run_that_was_killed_after_any_visit_goes_on_with_all_that_was_kept() {
    let whole = whole();
    for killed_after in 0..whole.kept.len() {
        let earlier = &whole.kept[..killed_after];
        let mock = resumed(earlier).run(&SHORT);
        assert_eq!(mock.results.len(), 3);
        for cell in 0..3 {
            let before = by_cell(earlier).remove(&cell).unwrap_or_default();
            let (before, after) = (Samples::of(&before), mock.samples(cell));
            let pairs = before.pairs();
            assert_eq!(after.earlier_pairs, pairs);
            assert_eq!(after.taken[..pairs], before.taken);
            let all = after.pairs();
            assert!(all > pairs, "{all} of {pairs}: a frame is rendered to read figures from");
            assert!(after.taken.iter().all(|pair| after.has_stages(&pair.stages)));
            assert!(after.warm_up_frames >= before.warm_up_frames + 2);
            for (reason, count) in &before.rejected {
                assert!(after.rejected[reason] >= *count);
            }
        }
    }
}

#[test]
fn a_resumed_cell_with_all_its_pairs_still_renders_before_it_is_finished() {
    let whole = whole();
    let mock = resumed(&whole.kept).run(&SHORT);
    for cell in 0..3 {
        assert!(mock.calls.contains(&(Timed, cell)));
        assert!(mock.samples(cell).pairs() <= whole.samples(cell).pairs() + 1);
    }
}

#[test]
fn an_interruption_before_the_first_frame_leaves_a_resumed_cell_for_later() {
    // In the warm-up of the first cell that is visited.
    let mock = Mock { interrupt_at_s: Some(0.001), ..resumed(&whole().kept) }.run(&SHORT);
    assert_eq!(mock.results.len(), 1, "what rendered nothing is not finished");
    assert_eq!(mock.safe, mock.kept.len());
}

#[test]
fn what_was_timed_by_another_clock_does_not_count() {
    let whole = whole();
    let mut other = whole.kept.clone();
    let pairs = other.iter_mut().filter_map(|(_, added)| added.pair.as_mut());
    pairs.for_each(|pair| pair.stages[1].clock = Clock::Timestamp);
    let mock = resumed(&other).run(&SHORT);
    for cell in 0..3 {
        let samples = mock.samples(cell);
        assert_eq!(samples.stages()[1].clock, Clock::FencedHost);
        assert_eq!(samples.earlier_pairs, 0);
        let new: Vec<Addition> = by_cell(&mock.kept).remove(&cell).unwrap();
        assert!(new[0].afresh, "the next run must not go back to them");
        assert!(new[1..].iter().all(|added| !added.afresh));
        // Of both runs' lines, as they stand in the file.
        let all: Vec<Addition> =
            by_cell(&other).remove(&cell).unwrap().into_iter().chain(new).collect();
        assert_eq!(Samples::of(&all).taken, samples.taken);
    }
    // Should the line that says so be lost, clocks are still not mixed.
    let (old, new) = (whole.kept[0].1.clone(), other[0].1.clone());
    let mixed = Samples::of(&[old, new.clone()]);
    assert_eq!(mixed.taken, Samples::of(&[new]).taken);
}
