//! `fathom export` and `fathom schema` as a user meets them.

use crate::common::{Ends, Place, fathom, holds, names, reference_of, write_records};
use fathom::record::comparison::Compared;
use fathom::record::schema::LineKind;

/// A run of one experiment, a comparison, and a folder without records.
fn folders() -> Place {
    let place = Place::new();
    write_records(&place.path("run"), &reference_of("uw-photons"));
    write_records(&place.path("comparison"), &[Compared::Header(Box::default()).into()]);
    std::fs::create_dir(place.path("empty")).unwrap();
    place
}

fn exported(place: &Place, words: &str) -> String {
    let output = place.fathom(format!("export {words}")).ends(0);
    assert_eq!(output.err, "");
    output.out
}

#[test]
fn each_format_can_be_had_alone_and_goes_where_it_is_told_to_go() {
    let place = folders();
    place.fathom("report run").ends(0);
    for (format, file) in [("csv", "cells.csv"), ("markdown", "summary.md")] {
        let written = place.read(format!("run/{file}"));
        assert_eq!(exported(&place, &format!("{format} run")), written, "{format}");
        assert_eq!(exported(&place, &format!("{format} run -o a.txt")).trim(), "a.txt");
        exported(&place, &format!("{format} run -o empty"));
        assert_eq!([place.read("a.txt"), place.read(format!("empty/{file}"))], [&*written; 2]);
    }
    // Formats of comparisons are found by what the folder holds.
    holds(&exported(&place, "text comparison"), &["0 cells"]);
}

#[test]
fn what_cannot_be_exported_is_one_clear_line() {
    let place = folders();
    for (words, reason) in [
        ("csv no/such/folder", "no/such/folder/records.jsonl"),
        ("csv empty", "holds a file records.jsonl"),
        ("bencherr run", "unknown format `bencherr`; did you mean `bencher`?"),
        ("csv comparison", "holds a comparison, which cannot be written as `csv`, only as text"),
        ("text run", "holds a run, which cannot be written as `text`, only as plots, csv"),
        ("plots run", "name a folder with -o DIR"),
        ("csv run -o no/such/folder/cells.csv", "cannot write no/such/folder/cells.csv"),
    ] {
        place.fathom(format!("export {words}")).refused(reason);
    }
    assert_eq!(names(&place.path("")), ["comparison", "empty", "run"]);
    place.fathom("report --png comparison").refused("a comparison has no plots");
    place.fathom("report --png run run").refused("--png is for the plots of one folder");
    let no_fonts = place.write("fonts.conf", "<fontconfig><dir>none</dir></fontconfig>");
    place.fathom("report --png run").env("FONTCONFIG_FILE", no_fonts).refused("fonts-dejavu-core");
    let has_fonts = fathom::report::charts::png::Rasterizer::new().is_ok();
    place.fathom("report --png run").ends(if has_fonts { 0 } else { 2 });
    assert_eq!(place.path("run/uw-photons.png").exists(), has_fonts);
    place.write("empty/records.jsonl", "nonsense\n");
    place.fathom("export csv empty").refused("holds no sound record: line 1: not JSON");
}

#[test]
fn schemas_are_told() {
    for (words, kind) in [("schema", LineKind::Record), ("schema worker", LineKind::Worker)] {
        assert_eq!(fathom(words).ends(0).json(), kind.schema());
    }
    let wrong = fathom("schema records").refused("error: invalid value 'records'");
    holds(&wrong, &["record, worker"]);
}
