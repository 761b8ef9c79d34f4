//! What is kept of a run, and what the next one makes of it.

use super::*;

/// A noisy cell with rejected frames, one that compiles at first, and two slow ones.
fn cells() -> Vec<MockCell> {
    let noisy = MockCell { faulty: |f| f % 8 == 5, ..cell(|f, _| 1e7 * noise(f, 0.9)) };
    let compiles = cell(|f, _| [9e7, 5e7, 2e7].get(f).copied().unwrap_or(1.5e7) * noise(f, 0.5));
    let slow = || cell(|f, _| 8e8 * noise(f, 0.3));
    vec![noisy, compiles, slow(), slow()]
}

type SavedSamples = [(f64, usize, Samples)];

/// The latest of each cell, as a record of it gives it to the next run.
fn latest(kept: &SavedSamples) -> BTreeMap<usize, Samples> {
    let latest = kept.iter().map(|(_, cell, samples)| {
        (*cell, Samples { earlier_pairs: samples.pairs(), ..samples.clone() })
    });
    latest.collect()
}

/// What a whole run leaves behind: five visits.
fn whole() -> Mock {
    Mock::new(cells()).run_visits(5, &SETTINGS)
}

/// A run that has this from before.
fn resumed(earlier: &SavedSamples) -> Mock {
    Mock { earlier: latest(earlier), ..Mock::new(cells()) }
}

#[test]
fn a_cell_is_kept_after_its_first_pair_and_then_every_few_seconds() {
    let mock = whole();
    for cell in 0..cells().len() {
        let of_cell = mock.kept.iter().filter(|(_, of, _)| *of == cell);
        let (at_s, pairs): (Vec<f64>, Vec<usize>) =
            of_cell.map(|(at_s, _, samples)| (*at_s, samples.pairs())).unzip();
        assert_eq!((pairs[0], *pairs.last().unwrap()), (1, mock.samples(cell).pairs()));
        assert!(at_s.len() > 2 && pairs.is_sorted(), "{at_s:?} {pairs:?}");
        // A visit to a slow cell takes two seconds, its warm-up two more.
        let longest_s = at_s.windows(2).map(|pair| pair[1] - pair[0]).fold(0.0, f64::max);
        assert!(longest_s <= KEEP_INTERVAL_S + VISIT_S + 4.0, "{at_s:?}");
    }
    assert!(!mock.samples(0).rejected.is_empty());
}

#[test]
fn a_run_that_was_killed_at_any_moment_goes_on_with_all_that_was_kept() {
    let whole = whole();
    for killed_after in 0..=whole.kept.len() {
        let earlier = &whole.kept[..killed_after];
        let mock = resumed(earlier).run(&SETTINGS);
        assert_eq!(mock.results.len(), cells().len());
        for cell in 0..cells().len() {
            let before = latest(earlier).remove(&cell).unwrap_or_default();
            let (pairs, after) = (before.pairs(), mock.samples(cell));
            assert_eq!(after.earlier_pairs, pairs);
            assert_eq!(after.pairs[..pairs], before.pairs);
            let all = after.pairs();
            assert!(all > pairs, "{all} of {pairs}: a frame is rendered to read figures from");
            assert!(all <= pairs + VISIT_PAIRS, "{all} of {pairs}: one visit more");
            assert!(after.pairs.iter().all(|pair| after.has_stages(&pair.stages)));
            assert!(after.warm_up_frames > before.warm_up_frames);
            for (reason, count) in &before.rejected {
                assert!(after.rejected[reason] >= *count);
            }
        }
    }
}

#[test]
fn an_interruption_keeps_what_has_too_little_and_leaves_what_rendered_nothing() {
    // In the warm-up of the first cell that is visited, and after all cells have a few pairs.
    let early = Mock { interrupt_at_s: Some(0.001), ..resumed(&whole().kept) }.run(&SETTINGS);
    assert!(early.results.is_empty() && early.kept.is_empty());
    let late = Mock { interrupt_at_s: Some(8.0), ..Mock::new(cells()) }.run(&SETTINGS);
    assert!(late.results.is_empty());
    let kept = latest(&late.kept);
    let count = |did| late.calls.iter().filter(|call| **call == (did, 0)).count();
    let rejected: u32 = kept[&0].rejected.values().sum();
    let taken = kept[&0].pairs() + rejected as usize;
    assert!(count(Timed) - taken <= 2, "all but the warm-up and at most the visit that it met");
}

#[test]
fn what_was_timed_by_another_clock_does_not_count() {
    let mut other = whole().kept;
    for pair in other.iter_mut().flat_map(|(_, _, samples)| &mut samples.pairs) {
        pair.stages[1].clock = Clock::Timestamp;
    }
    let mock = resumed(&other).run(&SETTINGS);
    for cell in 0..cells().len() {
        let samples = mock.samples(cell);
        assert_eq!(samples.stages()[1].clock, Clock::FencedHost);
        assert_eq!(samples.earlier_pairs, 0);
        let kept = mock.kept.iter().filter(|(_, of, _)| *of == cell);
        assert!(kept.map(|(_, _, samples)| samples).all(|kept| kept.has_stages(samples.stages())));
    }
}
