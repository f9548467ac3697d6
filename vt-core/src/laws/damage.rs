//! Damage to the bytes of a good file: what a reader must answer with a value or an error.

use proptest::collection::vec;
use proptest::prelude::*;
use proptest::sample::{Index, select};

/// Words that readers of numbers and counts stumble over.
const WORDS: [&[u8]; 12] = [
    b"\xff\xff\xff\xff",
    b"\0\0\0\x7f",
    b"\0",
    b" 4294967295 ",
    b" 99999999999999999999 ",
    b" -1 ",
    b" nan ",
    b" 1e308 ",
    b"\n\n",
    b"[[[[{",
    b"\"",
    b"${A}",
];

/// One change; places are shares of the length.
#[derive(Clone, Debug)]
enum Edit {
    Flip(Index, u8),
    Set(Index, u8),
    Insert(Index, &'static [u8]),
    Delete(Index, usize),
    Repeat(Index, usize),
    Truncate(Index),
}

/// Some changes, one after the other.
#[derive(Clone, Debug)]
pub struct Damage(Vec<Edit>);

impl Damage {
    /// The damaged bytes.
    pub fn apply(&self, bytes: &[u8]) -> Vec<u8> {
        let mut out = bytes.to_vec();
        for edit in &self.0 {
            let place = |index: &Index| index.index(out.len() + 1);
            let piece = |at: usize, length: usize| at..(at + length).min(out.len());
            match edit {
                Edit::Flip(at, bit) => {
                    let at = place(at);
                    out.iter_mut().skip(at).take(1).for_each(|b| *b ^= 1 << bit);
                }
                Edit::Set(at, byte) => {
                    let at = place(at);
                    out.iter_mut().skip(at).take(1).for_each(|b| *b = *byte);
                }
                Edit::Insert(at, word) => {
                    let at = place(at);
                    out.splice(at..at, word.iter().copied());
                }
                Edit::Delete(at, length) => {
                    let gone = piece(place(at), *length);
                    out.drain(gone);
                }
                Edit::Repeat(at, length) => {
                    let at = place(at);
                    let again = out[piece(at, *length)].to_vec();
                    out.splice(at..at, again);
                }
                Edit::Truncate(at) => out.truncate(place(at)),
            }
        }
        out
    }
}

/// One to three changes: bits, bytes, words put in, pieces gone or there twice, the rest cut off.
pub fn damage() -> impl Strategy<Value = Damage> {
    let at = any::<Index>;
    let edit = prop_oneof![
        (at(), 0..8_u8).prop_map(|(at, bit)| Edit::Flip(at, bit)),
        (at(), any::<u8>()).prop_map(|(at, byte)| Edit::Set(at, byte)),
        (at(), select(&WORDS[..])).prop_map(|(at, word)| Edit::Insert(at, word)),
        (at(), 1..40_usize).prop_map(|(at, length)| Edit::Delete(at, length)),
        (at(), 1..80_usize).prop_map(|(at, length)| Edit::Repeat(at, length)),
        at().prop_map(Edit::Truncate),
    ];
    vec(edit, 1..=3).prop_map(Damage)
}
