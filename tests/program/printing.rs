//! Standard streams that cannot be written to: nothing is lost but what was printed, and nothing panics.
#![cfg(unix)]

use std::fs::OpenOptions;
use std::process::Stdio;

use fathom::record::comparison::Compared;

use crate::common::{Ends, Place, SMALL, cells, fathom, skipped_cell, write_records};

/// A stream on a device that is always full.
fn full() -> Stdio {
    let device = OpenOptions::new().write(true).open("/dev/full");
    Stdio::from(device.expect("Linux and the BSDs have /dev/full"))
}

/// A stream into a pipe that nobody reads.
fn unread() -> Stdio {
    let (reader, writer) = std::io::pipe().unwrap();
    drop(reader);
    Stdio::from(writer)
}

/// A folder `run` with the records of two cells that were skipped, so that no adapter is needed.
fn recorded() -> Place {
    let place = Place::new();
    write_records(&place.path("run"), &["n=1", "n=2"].map(skipped_cell));
    place
}

/// Of listings and help, and of what needs an adapter.
#[test]
fn an_answer_on_a_full_disk_is_an_error_and_a_reader_that_has_had_enough_is_none() {
    for words in ["list stages", "--help", "verify voxel/clear"] {
        let output = fathom(words).stdout(full()).ends(2);
        let error = output.error("cannot write to standard output: ");
        assert!(error.starts_with("error: cannot write to standard output: "), "{error}");
        // And where that cannot be told either.
        fathom(words).stdout(full()).stderr(full()).ends(2);
        fathom(words).stdout(unread()).ends(0);
    }
}

#[test]
fn a_message_repeats_little_of_names_and_files() {
    let place = recorded();
    let (long, spaced) = ("x".repeat(90_000), "a b ".repeat(50_000));
    place.write("a.toml", format!("id = [\"{spaced}\"]\nname = [\"{spaced}\"]"));
    place.write("a.gltf", format!("{{\"asset\":\"{spaced}\"}}"));
    place.write("run/records.jsonl", format!("\"{spaced}\""));
    for words in [
        "export LONG run",
        "run LONG",
        "run a.toml",
        "render a.toml",
        "render a.gltf",
        "report run",
    ] {
        let error = place.fathom(words.replace("LONG", &long)).ends(2).err;
        assert!((20..900).contains(&error.len()), "{words}: {error}");
    }
}

#[test]
fn reports_are_written_whatever_can_be_printed() {
    for name in ["full", "unread"] {
        let place = recorded();
        let stream = || if name == "full" { full() } else { unread() };
        place.fathom("report run").stdout(stream()).stderr(stream()).ends(0);
        for file in ["run/summary.md", "run/cells.csv"] {
            assert!(place.path(file).exists(), "{name}: {file}");
        }
    }
    // An error keeps its status where it cannot be told.
    fathom("report no/such/folder").stderr(full()).ends(2);
    fathom("fetch no-such-asset").stdout(full()).stderr(full()).ends(2);
}

/// Records before progress, tables before the one that is printed, pictures and dumps. What was not measured stays status 2.
#[test]
fn what_measures_keeps_everything_whatever_can_be_printed() {
    let place = Place::new();
    for (words, file) in [
        ("dump caustics/trace --scene plane -o .", "caustics-trace-photons.npy"),
        (
            "run uw-default --cell base --budget 10m --visits 1 --no-ceilings --out run",
            "run/summary.md",
        ),
    ] {
        place.fathom(format!("{words} {SMALL}")).stdout(full()).stderr(unread()).ends(0);
        assert!(place.path(file).exists(), "{words}");
    }
    assert_eq!(cells(&place.path("run")).len(), 1);
    write_records(&place.path("tables"), &[Compared::Header(Box::default()).into()]);
    place.fathom("compare --replay tables").stdout(full()).stderr(full()).ends(2);
    assert!(place.path("tables/junit.xml").exists());
}
