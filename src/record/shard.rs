//! A part of a run's cells, measured by a process of its own.

use std::fmt;
use std::str::FromStr;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Most shards of a run.
pub const MAX_SHARDS: u32 = 1 << 10;
/// Bits of a round's number that are left to the rounds of one shard.
const ROUND_BITS: u32 = 22;

/// Which part, such as `3/8`: the third of eight.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Part {
    /// Which one, from 1.
    #[schemars(range(min = 1, max = MAX_SHARDS))]
    pub number: u32,
    /// Of how many.
    #[schemars(range(min = 1, max = MAX_SHARDS))]
    pub of: u32,
}

impl Part {
    /// There is such a part: records of anyone may say otherwise.
    pub fn is_valid(self) -> bool {
        1 <= self.number && self.number <= self.of && self.of <= MAX_SHARDS
    }

    /// The first number of its rounds. No round of another shard of the same run has this number or one after it, so that
    /// samples of two machines never count as taken next to each other.
    pub fn first_round(self) -> u32 {
        (self.number - 1) << ROUND_BITS
    }
}

impl fmt::Display for Part {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.number, self.of)
    }
}

impl FromStr for Part {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let error = || format!("a shard is I/N, such as 3/8, with 1 ≤ I ≤ N ≤ {MAX_SHARDS}");
        let (number, of) = text.split_once('/').ok_or_else(error)?;
        let [number, of] = [number, of].map(|n| n.trim().parse::<u32>().map_err(|_| error()));
        let part = Self { number: number?, of: of? };
        part.is_valid().then_some(part).ok_or_else(error)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_part_is_one_of_some() {
        assert_eq!("3/8".parse(), Ok(Part { number: 3, of: 8 }));
        for bad in ["", "3", "0/8", "9/8", "1/0", "-1/2", "1/2/3", "a/b", "1/1025", "99999999999/8"]
        {
            assert!(bad.parse::<Part>().is_err(), "{bad}");
        }
    }

    #[test]
    fn rounds_of_two_shards_never_meet() {
        let of = MAX_SHARDS;
        let first = |number| Part { number, of }.first_round();
        assert_eq!(first(1), 0);
        for number in 1..of {
            assert!(first(number + 1) - first(number) >= 1 << ROUND_BITS);
        }
        assert!(first(of).checked_add((1 << ROUND_BITS) - 1).is_some());
    }
}
