//! Turns good input into bad input: bytes changed, cut, doubled, moved, numbers made extreme, and what no reader expects put in.

use proptest::prelude::*;

use super::files::gzip;

/// Numbers at and beyond the ends of what types hold.
const NUMBERS: &str = "0 -0 -1 1 0.5 255 256 65536 16777217 99999999 2147483647 -2147483648 4294967295 4294967296 \
    6148914691236517206 9223372036854775807 -9223372036854775808 18446744073709551615 \
    99999999999999999999999999 1e-320 1e10 1e19 1e38 -1e38 3.5e38 1e308 1e400 nan NaN inf -inf Infinity null \
    true \"x\" [] {} 0x10 1_000";

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

/// One change; the place is taken modulo the length. A splice is a piece of another seed. The place of a number is its number
/// among those of the text.
#[derive(Clone, Debug)]
struct Change {
    place: usize,
    edit: Edit,
}

#[derive(Clone, Debug)]
enum Edit {
    Byte(u8),
    Bit(u8),
    CutOff,
    Remove(usize),
    Repeat { length: usize, times: usize },
    Splice { seed: usize, from: usize, length: usize },
    Number(usize),
    Word(usize),
    Long { unit: usize, times: usize },
}

fn change() -> impl Strategy<Value = Change> {
    let place = any::<usize>;
    prop_oneof![
        2 => (place(), any::<u8>()).prop_map(|(place, byte)| (place, Edit::Byte(byte))),
        2 => (place(), 0u8..8).prop_map(|(place, bit)| (place, Edit::Bit(bit))),
        1 => place().prop_map(|place| (place, Edit::CutOff)),
        2 => (place(), 1usize..64).prop_map(|(place, length)| (place, Edit::Remove(length))),
        2 => (place(), 1usize..200, 1usize..40)
            .prop_map(|(place, length, times)| (place, Edit::Repeat { length, times })),
        2 => (place(), place(), place(), 1usize..200)
            .prop_map(|(place, seed, from, length)| (place, Edit::Splice { seed, from, length })),
        6 => (place(), 0..numbers().count()).prop_map(|(place, by)| (place, Edit::Number(by))),
        2 => (place(), 0..WORDS.len()).prop_map(|(place, word)| (place, Edit::Word(word))),
        1 => (place(), 0..UNITS.len(), 1usize..20_000)
            .prop_map(|(place, unit, times)| (place, Edit::Long { unit, times })),
    ]
    .prop_map(|(place, edit)| Change { place, edit })
}

impl Change {
    fn made(&self, bytes: &mut Vec<u8>, seeds: &[Vec<u8>]) {
        let start = self.place % (bytes.len() + 1);
        let end = |length: usize| (start + length).min(bytes.len());
        match self.edit {
            Edit::Byte(byte) => {
                if let Some(old) = bytes.get_mut(start) {
                    *old = byte;
                }
            }
            Edit::Bit(bit) => {
                if let Some(old) = bytes.get_mut(start) {
                    *old ^= 1 << bit;
                }
            }
            Edit::CutOff => bytes.truncate(start),
            Edit::Remove(length) => drop(bytes.drain(start..end(length))),
            Edit::Repeat { length, times } => {
                let piece = bytes[start..end(length)].repeat(times);
                insert(bytes, start, &piece);
            }
            Edit::Splice { seed, from, length } => {
                let other = &seeds[seed % seeds.len()];
                let from = from % (other.len() + 1);
                insert(bytes, start, &other[from..(from + length).min(other.len())]);
            }
            Edit::Number(by) => number(bytes, self.place, by),
            Edit::Word(word) => insert(bytes, start, WORDS[word]),
            Edit::Long { unit, times } => insert(bytes, start, &UNITS[unit].repeat(times)),
        }
    }
}

fn insert(bytes: &mut Vec<u8>, place: usize, piece: &[u8]) {
    bytes.splice(place..place, piece.iter().copied());
}

/// A text with one of its numbers made extreme.
pub fn extreme(text: &str, which: usize, by: usize) -> String {
    let mut bytes = text.as_bytes().to_vec();
    number(&mut bytes, which, by % numbers().count());
    String::from_utf8(bytes).unwrap()
}

fn numbers() -> impl Iterator<Item = &'static str> {
    NUMBERS.split(' ')
}

fn number(bytes: &mut Vec<u8>, which: usize, by: usize) {
    let part = |byte: u8| byte.is_ascii_digit() || b"+-.".contains(&byte);
    let starts = |i: usize| bytes[i].is_ascii_digit() && (i == 0 || !part(bytes[i - 1]));
    let places: Vec<usize> = (0..bytes.len()).filter(|i| starts(*i)).collect();
    let Some(start) = places.get(which % places.len().max(1)).copied() else { return };
    let rest = bytes[start..].iter().position(|byte| !part(*byte));
    let end = rest.map_or(bytes.len(), |length| start + length);
    bytes.splice(start..end, numbers().nth(by).into_iter().flat_map(str::bytes));
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

/// What lines of OBJ and PLY files are made of.
const MESH_WORDS: &str = "v|vn|vt|f|o|l|p|usemtl|mtllib|1|-1|0|2//3|1/1/1|-99999999999999999999|1e38|inf|nan|/|//|\n|\n|\n|\\\n|#|\
    ply|format ascii 1.0|element vertex 3|element face 2|property float x|property list uchar int vertex_indices|end_header";

pub fn mesh_words() -> impl Strategy<Value = Input> {
    let words = prop::sample::select(MESH_WORDS.split('|').collect::<Vec<&str>>());
    let words = prop::collection::vec(words, 0..60);
    words.prop_map(|words| Input(words.join(" ").into_bytes()))
}
