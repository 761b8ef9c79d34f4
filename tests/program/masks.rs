//! Adapters without a feature.

use crate::common::{Ends, Place, SMALL, holds, records};
use fathom::record::{Feature, Mask, NoteKind, Record, earlier};

/// Records, page and summary of less than the adapter say so.
#[test]
fn a_masked_run_is_not_taken_for_the_adapters_own() {
    let place = Place::new();
    let run = format!(
        "run uw-default --cell base --no-ceilings --visits 1 --budget 10m {SMALL} --out out"
    );
    let masked = "--without float32-blendable --without timestamp-query";
    place.fathom(format!("{run} {masked}")).ends(0);
    let all = records(&place.path("out"));
    let header = all.iter().find_map(Record::try_as_run_ref).unwrap();
    let without = vec![Feature::Float32Blendable, Feature::TimestampQuery];
    assert_eq!(header.adapter.mask, Mask { without });
    let notes = header.notes.iter().filter(|note| note.kind == NoteKind::Adapter);
    assert_eq!(notes.count(), 3, "{:?}", header.notes);
    let title = "masked: without float32-blendable, without timestamp-query";
    for file in ["index.html", "summary.md", "cells.csv"] {
        holds(&place.read(format!("out/{file}")), &[title]);
    }
    // A run goes on with what was measured under the same mask alone.
    let mut whole = header.clone();
    whole.adapter.mask = Mask::default();
    assert_eq!([header, &whole].map(|run| earlier(&all, run).len()), [1, 0]);
}
