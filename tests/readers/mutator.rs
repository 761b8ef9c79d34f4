//! Turns a good input into a bad one: bytes changed, cut, repeated, moved between inputs, numbers made extreme, and what no reader
//! expects put in.

use proptest::prelude::*;

/// Numbers at and beyond the ends of what types hold.
const NUMBERS: &str = "0 -1 0.5 256 65536 16777217 99999999 2147483647 -2147483648 4294967296 6148914691236517206 \
    9223372036854775807 18446744073709551615 99999999999999999999999999 1e-320 1e19 1e38 -1e38 1e308 1e400 nan inf null true \"x\" [] {}";
/// What no reader expects where it comes; repeated it is long or deep.
const WORDS: [&[u8]; 16] = [
    b"\xef\xbb\xbf",
    b"\xff\xfe",
    b"\0",
    b"\r\n",
    b"\x1b[31m",
    b"\"",
    b"'''",
    b"\\",
    b"[",
    b"{\"a\":",
    b"a.",
    b"[[x]]\n",
    b"f 1\n",
    b"9",
    b"../../x",
    b"\x1f\x8b\x08\0",
];

/// Bytes that a failed test shows as text.
#[derive(Clone)]
pub struct Input(pub Vec<u8>);

impl std::fmt::Debug for Input {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}", self.0.escape_ascii())
    }
}

/// One of the seeds with up to five changes. Each is its kind, its place (modulo the length), two more numbers and how often.
pub fn mutated(seeds: Vec<Vec<u8>>) -> impl Strategy<Value = Input> {
    let place = any::<usize>;
    let times = prop_oneof![4 => Just(1usize), 1 => 1..20_000usize];
    let changes = prop::collection::vec((0..8u8, place(), place(), 1..200usize, times), 0..6);
    (0..seeds.len(), changes).prop_map(move |(seed, changes)| {
        let mut bytes = seeds[seed].clone();
        for (kind, place, other, length, times) in changes {
            let start = place % (bytes.len() + 1);
            let end = (start + length).min(bytes.len());
            let piece = match kind {
                0 => vec![other as u8],
                1 => Vec::new(),
                2 => bytes[start..end].repeat(times.min(40)),
                3 => {
                    let seed = &seeds[other % seeds.len()];
                    let from = place % (seed.len() + 1);
                    seed[from..(from + length).min(seed.len())].to_vec()
                }
                4 => WORDS[other % WORDS.len()].repeat(times),
                5 => {
                    bytes.truncate(start);
                    continue;
                }
                _ => {
                    bytes = extreme(&bytes, place, other);
                    continue;
                }
            };
            let end = if kind < 2 { end } else { start };
            bytes.splice(start..end, piece);
        }
        Input(bytes)
    })
}

/// A text with one of its numbers made extreme.
pub fn extreme(bytes: &[u8], which: usize, by: usize) -> Vec<u8> {
    let part = |byte: &u8| byte.is_ascii_digit() || b"+-.".contains(byte);
    let numbers: Vec<&[u8]> = bytes.chunk_by(|a, b| part(a) == part(b)).collect();
    let places = (0..numbers.len()).filter(|place| numbers[*place].iter().any(u8::is_ascii_digit));
    let Some(place) = places.clone().nth(which % places.count().max(1)) else {
        return bytes.to_vec();
    };
    let other = NUMBERS.split(' ').nth(by % NUMBERS.split(' ').count()).unwrap();
    [&numbers[..place].concat(), other.as_bytes(), &numbers[place + 1..].concat()].concat()
}
