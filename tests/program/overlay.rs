//! One page of several folders: runs beside each other, comparisons, and records that cannot be read.

use crate::common::{Ends, Place, holds, lines, reference_of};
use serde_json::{Value, json};

/// The header, one experiment with its definition, and the end of the committed run.
fn some() -> Vec<String> {
    lines(reference_of("uw-photons")).lines().map(str::to_owned).collect()
}

fn changed(line: &str, change: impl FnOnce(&mut Value)) -> String {
    let mut value = serde_json::from_str(line).unwrap();
    change(&mut value);
    value.to_string()
}

fn write(place: &Place, folder: &str, lines: &[String]) {
    place.write(format!("{folder}/records.jsonl"), lines.join("\n") + "\n");
}

#[track_caller]
fn page(place: &Place, folders: &str) -> String {
    place.fathom(format!("report {folders} --out out")).ends(0);
    place.read("out/index.html")
}

#[test]
fn two_runs_stand_beside_each_other_under_names_that_tell_them_apart() {
    let place = Place::new();
    let mut lines = some();
    write(&place, "one", &lines);
    lines[0] = changed(&lines[0], |run| run["adapter"]["driver_info"] = json!("Mesa 23.0"));
    write(&place, "two", &lines);
    let both = page(&place, "one two");
    holds(&both, &["Mesa 22.3.6", "Mesa 23.0"]);
    assert!(!both.contains("Not shown"));
    place.fathom("report one two").refused("say with --out where to write it");
    let rows = both.matches("<tr data-experiment=\"uw-photons\"");
    assert_eq!(rows.count(), 22, "11 cells of each run");
    assert_eq!(both, page(&place, "one two"), "the same records give the same bytes");
    // Runs on one adapter, driver and version are told apart by their folders.
    let one = place.path("one").display().to_string();
    holds(&page(&place, &format!("{one} one")), &["<h3>one</h3>"]);
}

#[test]
fn what_cannot_be_read_is_left_out_and_named_with_its_reason() {
    let place = Place::new();
    write(&place, "text", &["my notes".to_owned()]);
    place.fathom("report text missing --out out").refused("holds no sound record");
    let lines = some();
    write(&place, "sound", &lines);
    let mut torn = lines.clone();
    let last = torn.pop().unwrap();
    torn.push(last[..last.len() / 2].to_owned());
    torn[3].truncate(100);
    write(&place, "torn", &torn);
    let mut mixed = lines.clone();
    mixed.push(changed(&lines[0], |run| run["schema"] = json!(2)));
    mixed.extend(lines[2..4].iter().cloned());
    write(&place, "mixed", &mixed);
    let mut foreign = lines.clone();
    foreign[0] = changed(&lines[0], |run| run["schema"] = json!(99));
    write(&place, "foreign", &foreign);
    let page = page(&place, "sound torn mixed foreign missing");
    let told: Vec<&str> =
        page.split("<li>").filter(|item| item.contains("records.jsonl")).collect();
    for words in [
        ["torn/records.jsonl", "line 4: not JSON"],
        ["torn/records.jsonl", "(and 1 more)"],
        ["mixed/records.jsonl line", "format 2, but this build reads"],
        ["foreign/records.jsonl line 1", "format 99"],
        ["missing", "No such file"],
    ] {
        let tells = |item: &&str| words.iter().all(|word| item.contains(word));
        assert!(told.iter().any(tells), "{words:?}: {told:?}");
    }
    // Sound cells of both readable runs: 11 each, but one that is damaged.
    assert_eq!(page.matches("<tr data-experiment=\"uw-photons\"").count(), 11 + 10);
}
