//! Turns good input into bad input: bytes changed, cut, doubled, moved, numbers made extreme, and what no reader expects put in.

use std::io::Write;

use flate2::{Compression, write::GzEncoder};
use proptest::prelude::*;

/// Numbers at and beyond the ends of what types hold.
const NUMBERS: &[&str] = &[
    "0",
    "-0",
    "-1",
    "1",
    "0.5",
    "255",
    "256",
    "65536",
    "16777217",
    "99999999",
    "2147483647",
    "-2147483648",
    "4294967295",
    "4294967296",
    "6148914691236517206",
    "9223372036854775807",
    "-9223372036854775808",
    "18446744073709551615",
    "99999999999999999999999999",
    "1e-320",
    "1e10",
    "1e19",
    "1e38",
    "-1e38",
    "3.5e38",
    "1e308",
    "1e400",
    "nan",
    "NaN",
    "inf",
    "-inf",
    "Infinity",
    "null",
    "true",
    "\"x\"",
    "[]",
    "{}",
    "0x10",
    "1_000",
];

/// What no reader expects where it comes.
const WORDS: &[&[u8]] = &[
    b"\xef\xbb\xbf",
    b"\xff\xfe",
    b"\xc3",
    b"\0",
    b"\r\n",
    b"\r",
    b"\n\n\n",
    b"\x1b[31m",
    b"\"",
    b"'''",
    b"\\",
    b"#",
    b"//",
    b"=",
    b"[[",
    b"]]",
    b"{",
    b"}",
    b",",
    b"a.b.c = 1\n",
    b"../../x",
    "\u{202e}\u{1f600}".as_bytes(),
    b"\x1f\x8b\x08\0",
];

/// A unit that is repeated until it is long.
const UNITS: &[&[u8]] = &[b"[", b"{\"a\":", b"a.", b" ", b"9", b"x", b"f 1\n", b"\n", b",", b"[["];

/// One change; places are taken modulo the length.
#[derive(Clone, Debug)]
enum Change {
    Byte {
        place: usize,
        byte: u8,
    },
    Bit {
        place: usize,
        bit: u8,
    },
    CutOff {
        place: usize,
    },
    Remove {
        place: usize,
        length: usize,
    },
    Repeat {
        place: usize,
        length: usize,
        times: usize,
    },
    /// A piece of another seed.
    Splice {
        place: usize,
        seed: usize,
        from: usize,
        length: usize,
    },
    Number {
        which: usize,
        by: usize,
    },
    Word {
        place: usize,
        word: usize,
    },
    Long {
        place: usize,
        unit: usize,
        times: usize,
    },
}

fn change() -> impl Strategy<Value = Change> {
    let place = any::<usize>;
    prop_oneof![
        2 => (place(), any::<u8>()).prop_map(|(place, byte)| Change::Byte { place, byte }),
        2 => (place(), 0u8..8).prop_map(|(place, bit)| Change::Bit { place, bit }),
        1 => place().prop_map(|place| Change::CutOff { place }),
        2 => (place(), 1usize..64).prop_map(|(place, length)| Change::Remove { place, length }),
        2 => (place(), 1usize..200, 1usize..40)
            .prop_map(|(place, length, times)| Change::Repeat { place, length, times }),
        2 => (place(), place(), place(), 1usize..200)
            .prop_map(|(place, seed, from, length)| Change::Splice { place, seed, from, length }),
        6 => (place(), 0..NUMBERS.len()).prop_map(|(which, by)| Change::Number { which, by }),
        2 => (place(), 0..WORDS.len()).prop_map(|(place, word)| Change::Word { place, word }),
        1 => (place(), 0..UNITS.len(), 1usize..20_000)
            .prop_map(|(place, unit, times)| Change::Long { place, unit, times }),
    ]
}

impl Change {
    fn made(&self, bytes: &mut Vec<u8>, seeds: &[Vec<u8>]) {
        let at = |place: usize| place % (bytes.len() + 1);
        let end = |start: usize, length: usize| (start + length).min(bytes.len());
        match *self {
            Change::Byte { place, byte } if at(place) < bytes.len() => {
                let place = at(place);
                bytes[place] = byte;
            }
            Change::Bit { place, bit } if at(place) < bytes.len() => {
                let place = at(place);
                bytes[place] ^= 1 << bit;
            }
            Change::Byte { .. } | Change::Bit { .. } => {}
            Change::CutOff { place } => bytes.truncate(at(place)),
            Change::Remove { place, length } => {
                let start = at(place);
                bytes.drain(start..end(start, length));
            }
            Change::Repeat { place, length, times } => {
                let start = at(place);
                let piece = bytes[start..end(start, length)].repeat(times);
                insert(bytes, start, &piece);
            }
            Change::Splice { place, seed, from, length } => {
                let other = &seeds[seed % seeds.len()];
                let from = from % (other.len() + 1);
                let piece = &other[from..(from + length).min(other.len())];
                insert(bytes, at(place), piece);
            }
            Change::Number { which, by } => number(bytes, which, NUMBERS[by].as_bytes()),
            Change::Word { place, word } => insert(bytes, at(place), WORDS[word]),
            Change::Long { place, unit, times } => {
                insert(bytes, at(place), &UNITS[unit].repeat(times));
            }
        }
    }
}

fn insert(bytes: &mut Vec<u8>, place: usize, piece: &[u8]) {
    bytes.splice(place..place, piece.iter().copied());
}

/// A text with one of its numbers made extreme.
pub fn extreme(text: &str, which: usize, by: usize) -> String {
    let mut bytes = text.as_bytes().to_vec();
    number(&mut bytes, which, NUMBERS[by % NUMBERS.len()].as_bytes());
    String::from_utf8(bytes).unwrap()
}

/// Replaces one of the numbers of a text.
fn number(bytes: &mut Vec<u8>, which: usize, by: &[u8]) {
    let part = |byte: u8| byte.is_ascii_digit() || b"+-.".contains(&byte);
    let starts = |i: usize| bytes[i].is_ascii_digit() && (i == 0 || !part(bytes[i - 1]));
    let places: Vec<usize> = (0..bytes.len()).filter(|i| starts(*i)).collect();
    let Some(start) = places.get(which % places.len().max(1)).copied() else {
        return;
    };
    let rest = bytes[start..].iter().position(|byte| !part(*byte));
    let end = rest.map_or(bytes.len(), |length| start + length);
    bytes.splice(start..end, by.iter().copied());
}

/// Bytes that a failed test shows as text.
#[derive(Clone)]
pub struct Input(pub Vec<u8>);

impl std::fmt::Debug for Input {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}", self.0.escape_ascii())
    }
}

/// One of the seeds with up to five changes.
pub fn mutated(seeds: Vec<Vec<u8>>) -> impl Strategy<Value = Input> {
    let changes = prop::collection::vec(change(), 0..6);
    (0..seeds.len(), changes).prop_map(move |(seed, changes)| {
        let mut bytes = seeds[seed].clone();
        for change in changes {
            change.made(&mut bytes, &seeds);
        }
        Input(bytes)
    })
}

/// The same, sometimes compressed by gzip, and sometimes damaged in its archive. The flag tells of compression.
pub fn mutated_or_packed(seeds: Vec<Vec<u8>>) -> impl Strategy<Value = (Input, bool)> {
    let damage = prop::option::weighted(0.3, change());
    (mutated(seeds), prop::bool::weighted(0.3), damage).prop_map(|(input, packed, damage)| {
        if !packed {
            return (input, false);
        }
        let mut bytes = gzip(&input.0);
        if let Some(damage) = damage {
            let seeds = [bytes.clone()];
            damage.made(&mut bytes, &seeds);
        }
        (Input(bytes), true)
    })
}

pub fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::fast());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

/// What lines of OBJ and PLY files are made of.
const MESH_WORDS: &str = "v|vn|vt|f|o|l|p|usemtl|mtllib|1|-1|0|2//3|1/1/1|-99999999999999999999|1e38|inf|nan|/|//|\n|\n|\n|\\\n|#|\
    ply|format ascii 1.0|element vertex 3|element face 2|property float x|property list uchar int vertex_indices|end_header";

/// Words of OBJ and PLY files in any order.
pub fn mesh_words() -> impl Strategy<Value = Input> {
    let words = prop::sample::select(MESH_WORDS.split('|').collect::<Vec<&str>>());
    let words = prop::collection::vec(words, 0..60);
    words.prop_map(|words| Input(words.join(" ").into_bytes()))
}
