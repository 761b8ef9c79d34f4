//! Options of a command line, and the command that goes on with a run.

use std::path::{Path, absolute};

use itertools::Itertools as _;

use crate::Run;
use fathom_base::{private, text};

/// Options of `fathom run` that a cell depends on, and whether each takes a value.
pub const CELL_OPTIONS: [(&str, bool); 6] = [
    ("--set", true),
    ("--axis", true),
    ("--adapter", true),
    ("--without", true),
    ("--unchecked", false),
    ("--allow-large", false),
];

/// What a resumed run is told again, beside [`CELL_OPTIONS`].
const KEPT_OPTIONS: [(&str, bool); 5] = [
    ("--cell", true),
    ("--shard", true),
    ("--profile", true),
    ("--visits", true),
    ("--no-ceilings", false),
];
/// Options that are to be given again with a run's experiments. What a sweep sets is in its experiment.
pub fn run_options(command: &[String]) -> Vec<String> {
    let mut words = command.iter().skip(1).filter(|word| !word.starts_with('-'));
    let is_sweep = words.next().is_some_and(|word| word == "sweep");
    let of_cells = &CELL_OPTIONS[if is_sweep { 2 } else { 0 }..];
    split_options(command, &[of_cells, &KEPT_OPTIONS].concat()).0
}

/// Those of them that a cell depends on.
pub fn cell_options(command: &[String]) -> Vec<String> {
    split_options(&run_options(command), &CELL_OPTIONS).0
}

/// How commands in a run's reports name its folder: from the current one where it lies beneath that, else from itself.
pub fn shown(folder: &Path) -> String {
    let shown = private::path(folder);
    let is_same = absolute(&shown).ok() == absolute(folder).ok();
    if is_same { shown } else { ".".to_owned() }
}

/// The command that goes on with a run in the folder of this name; none where the records do not name its experiments.
pub fn resuming(run: &Run, folder: &str) -> Option<String> {
    let place = |name: &String| {
        if name.ends_with(".toml") { format!("{folder}/{name}") } else { name.clone() }
    };
    let experiments = run.experiments.as_ref()?.iter().map(place);
    let words = ["fathom", "run"].map(str::to_owned).into_iter().chain(experiments);
    let folder = ["--out", folder, "--resume"].map(str::to_owned);
    Some(
        words
            .chain(run_options(&run.command))
            .chain(folder)
            .map(|word| text::shell(&word))
            .join(" "),
    )
}

/// Divides the words of a command line: the given options with their values, and the rest.
pub fn split_options(command: &[String], options: &[(&str, bool)]) -> (Vec<String>, Vec<String>) {
    let mut words = command.iter();
    let (mut found, mut rest) = (Vec::new(), Vec::new());
    while let Some(word) = words.next() {
        let option = word.split_once('=').map_or(word.as_str(), |(option, _)| option);
        let Some((_, takes_value)) = options.iter().find(|(known, _)| *known == option) else {
            rest.push(word.clone());
            continue;
        };
        found.push(word.clone());
        if *takes_value && option == word {
            found.extend(words.next().cloned());
        }
    }
    (found, rest)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_are_found_with_their_values() {
        let line = "fathom run uw-photons --out x --set water.noise=0 --adapter=llvm --resume --unchecked --budget 3";
        let words: Vec<String> = line.split(' ').map(str::to_owned).collect();
        let (found, rest) = split_options(&words, &CELL_OPTIONS);
        assert_eq!(found, ["--set", "water.noise=0", "--adapter=llvm", "--unchecked"]);
        assert_eq!(rest.join(" "), "fathom run uw-photons --out x --resume --budget 3");
    }
}
