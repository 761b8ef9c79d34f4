//! Options of a command line.

/// Options of `fathom run` that a cell depends on, and whether each takes a value.
pub const CELL_OPTIONS: [(&str, bool); 6] = [
    ("--set", true),
    ("--axis", true),
    ("--adapter", true),
    ("--without", true),
    ("--unchecked", false),
    ("--allow-large", false),
];

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
