//! One page of several folders: runs beside each other, comparisons, and records that cannot be read.

use std::path::{Path, PathBuf};
use std::process::Output;

use crate::common::fathom;
use serde_json::{Value, json};
use tempfile::TempDir;

/// Records of a whole run, as committed.
fn reference() -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("reports/llvmpipe/records.jsonl");
    std::fs::read_to_string(path).unwrap()
}

/// The header, one experiment with its definition, and the end of the reference run.
fn some() -> Vec<String> {
    let of_experiment = |line: &Value| match line["record"].as_str() {
        Some("cell") => line["experiment"] == "uw-photons",
        Some("experiment") => line["id"] == "uw-photons",
        _ => true,
    };
    let text = reference();
    let lines = text.lines().filter(|line| of_experiment(&serde_json::from_str(line).unwrap()));
    lines.map(str::to_owned).collect()
}

fn changed(line: &str, change: impl FnOnce(&mut Value)) -> String {
    let mut value = serde_json::from_str(line).unwrap();
    change(&mut value);
    value.to_string()
}

struct Folders(TempDir);

impl Folders {
    fn new() -> Folders {
        Folders(tempfile::tempdir().unwrap())
    }

    fn put(&self, name: &str, lines: &[String]) -> PathBuf {
        let folder = self.0.path().join(name);
        std::fs::create_dir_all(&folder).unwrap();
        std::fs::write(folder.join("records.jsonl"), lines.join("\n") + "\n").unwrap();
        folder
    }

    fn report(&self, folders: &[&Path]) -> Output {
        let mut report = fathom();
        report.arg("report").args(folders).arg("--out").arg(self.out());
        report.output().unwrap()
    }

    fn out(&self) -> PathBuf {
        self.0.path().join("out")
    }

    #[track_caller]
    fn page(&self, folders: &[&Path]) -> String {
        let output = self.report(folders);
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        std::fs::read_to_string(self.out().join("index.html")).unwrap()
    }
}

#[test]
fn two_runs_stand_beside_each_other_under_names_that_tell_them_apart() {
    let folders = Folders::new();
    let mut lines = some();
    let one = folders.put("one", &lines);
    lines[0] = changed(&lines[0], |run| run["adapter"]["driver_info"] = json!("Mesa 23.0"));
    let two = folders.put("two", &lines);
    let page = folders.page(&[&one, &two]);
    assert!(page.contains("Mesa 22.3.6") && page.contains("Mesa 23.0"));
    assert!(!page.contains("Not shown"));
    let rows = |page: &str| page.matches("<tr data-experiment=\"uw-photons\"").count();
    assert_eq!(rows(&page), 22, "11 cells of each run");
    assert_eq!(page, folders.page(&[&one, &two]), "the same records give the same bytes");
    // Runs on one adapter, driver and version are told apart by their folders.
    let page = folders.page(&[&one, &one]);
    assert!(page.contains(&one.display().to_string()));
}

#[test]
fn what_cannot_be_read_is_left_out_and_named_with_its_reason() {
    let folders = Folders::new();
    let lines = some();
    let sound = folders.put("sound", &lines);
    let mut torn = lines.clone();
    let last = torn.pop().unwrap();
    torn.push(last[..last.len() / 2].to_owned());
    torn[3].truncate(100);
    let torn = folders.put("torn", &torn);
    let mut mixed = lines.clone();
    mixed.push(changed(&lines[0], |run| run["schema"] = json!(2)));
    mixed.extend(lines[2..4].iter().cloned());
    let mixed = folders.put("mixed", &mixed);
    let mut foreign = lines.clone();
    foreign[0] = changed(&lines[0], |run| run["schema"] = json!(99));
    let foreign = folders.put("foreign", &foreign);
    let missing = folders.0.path().join("missing");
    let page = folders.page(&[&sound, &torn, &mixed, &foreign, &missing]);
    let told: Vec<&str> =
        page.split("<li>").filter(|item| item.contains("records.jsonl")).collect();
    let tells = |words: &[&str]| {
        assert!(
            told.iter().any(|item| words.iter().all(|word| item.contains(word))),
            "{words:?}: {told:?}"
        );
    };
    tells(&["torn/records.jsonl, line 4", "not JSON"]);
    tells(&["torn/records.jsonl, line 14", "not JSON: EOF"]);
    tells(&["mixed/records.jsonl, line", "format 2, but this build reads"]);
    tells(&["mixed/records.jsonl, 2 lines from", "belongs to a run whose header"]);
    tells(&["foreign/records.jsonl, line 1", "format 99"]);
    tells(&["missing", "No such file"]);
    // Sound cells of every readable run: 11 each, but one that is damaged.
    assert_eq!(page.matches("<tr data-experiment=\"uw-photons\"").count(), 11 + 10 + 11);
}

#[test]
fn nothing_to_show_is_one_clear_line() {
    let folders = Folders::new();
    let missing = folders.0.path().join("missing");
    crate::common::refused(&folders.report(&[&missing]), "missing/records.jsonl");
    let text = folders.put("text", &["my notes".to_owned()]);
    crate::common::refused(&folders.report(&[&text, &missing]), "holds no sound record");
    let two = fathom().arg("report").args([&text, &missing]).output().unwrap();
    crate::common::refused(&two, "say with --out where to write it");
}
