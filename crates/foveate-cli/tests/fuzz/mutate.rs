//! Mutations of a corpus: bits, numbers, parts doubled, left out, moved and crossed. They do not use coverage.

use serde_json::Value;

/// Draws them.
pub(crate) struct Mutator(u64);

/// Numbers that programs go wrong at.
const ODD: [u64; 12] =
    [0, 1, 0x7f, 0x80, 0xff, 0x7fff, 0x8000, 0xffff, 0x7fff_ffff, 0x8000_0000, 0xffff_ffff, u64::MAX >> 1];
/// Texts that do.
const WORDS: [&str; 20] = [
    "nan",
    "inf",
    "-1",
    "1e308",
    "0",
    "9999999999999",
    "-0.0",
    "1e-320",
    "\"",
    "\n",
    ",",
    "=",
    "[",
    "]",
    "{",
    "}",
    "null",
    "true",
    "\\u0000",
    "99",
];

impl Mutator {
    pub(crate) fn new(seed: u64) -> Self {
        Self(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1)
    }

    /// A number below `n`, which is not 0.
    fn below(&mut self, n: usize) -> usize {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 11) as usize % n.max(1)
    }

    /// A mutation of an input of the corpus. JSON mostly stays JSON, because anything else ends in its parser.
    pub(crate) fn next(&mut self, corpus: &[Vec<u8>], longest: usize) -> Vec<u8> {
        let seed = &corpus[self.below(corpus.len())];
        if seed.starts_with(b"{\"") && self.below(4) > 0 {
            let mut value = serde_json::from_slice(seed).expect("JSON");
            (0..1 + self.below(4)).for_each(|_| self.change_json(&mut value));
            return value.to_string().into_bytes();
        }
        let mut bytes = seed.clone();
        for _ in 0..1 + self.below(6) {
            self.change(&mut bytes, corpus);
        }
        bytes.truncate(longest);
        bytes
    }

    /// Another number, word or type somewhere; an entry left out, doubled or taken from beside it; other bits in numbers kept as base64.
    fn change_json(&mut self, value: &mut Value) {
        let odd = ODD[self.below(ODD.len())];
        match value {
            Value::Object(map) if !map.is_empty() && self.below(20) > 0 => {
                let key = map.keys().nth(self.below(map.len())).expect("it is there").clone();
                match self.below(40) {
                    0 => drop(map.remove(&key)),
                    1 => {
                        let other = map.values().nth(self.below(map.len())).expect("it is there").clone();
                        map.insert(key, other);
                    }
                    _ => self.change_json(&mut map[&key]),
                }
            }
            Value::Array(list) if !list.is_empty() && self.below(20) > 0 => {
                let at = self.below(list.len());
                match self.below(20) {
                    0 => drop(list.remove(at)),
                    1 => list.insert(at, list[at].clone()),
                    _ => self.change_json(&mut list[at]),
                }
            }
            Value::String(text) if !text.is_empty() && self.below(10) > 0 => {
                const DIGITS: &[u8] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
                let mut bytes = std::mem::take(text).into_bytes();
                for _ in 0..1 + self.below(8) {
                    let at = self.below(bytes.len());
                    bytes[at] = DIGITS[self.below(64)];
                }
                *text = String::from_utf8_lossy(&bytes).into_owned();
            }
            Value::Number(number) if self.below(2) == 0 => {
                let near = number.as_f64().unwrap_or(0.0) + [-1.0, 1.0, 0.5, 1e-9, 1e3, -1e6][self.below(6)];
                *value = if self.below(2) == 0 { near.into() } else { (near as i64).into() };
            }
            _ => {
                *value = match self.below(8) {
                    0 => Value::Null,
                    1 => true.into(),
                    2 => odd.into(),
                    3 => (-(odd as i64)).into(),
                    4 => f64::from_bits(odd << 40).into(),
                    5 => [1e308, -1e308, 1e-320, 1e20, 0.1][self.below(5)].into(),
                    6 => Value::Array(vec![odd.into()]),
                    _ => "x".into(),
                };
            }
        }
    }

    fn change(&mut self, bytes: &mut Vec<u8>, corpus: &[Vec<u8>]) {
        let n = bytes.len();
        let at = self.below(n);
        let length = 1 + self.below((n - at).clamp(1, 64));
        match self.below(10) {
            0 | 1 if n > 0 => bytes[at] ^= 1 << self.below(8),
            2 if n > 0 => bytes[at] = self.below(256) as u8,
            3 => {
                let (odd, wide) = (ODD[self.below(ODD.len())], 1 << self.below(4));
                let number = if self.below(2) == 0 {
                    odd.to_le_bytes()[..wide].to_vec()
                } else {
                    odd.to_be_bytes()[8 - wide..].to_vec()
                };
                bytes.iter_mut().skip(at).zip(number).for_each(|(byte, new)| *byte = new);
            }
            4 if n > 0 => drop(bytes.drain(at..(at + length).min(n))),
            5 if n > 0 => {
                let part = bytes[at..(at + length).min(n)].to_vec();
                bytes.splice(at..at, part);
            }
            6 => {
                let word = WORDS[self.below(WORDS.len())];
                bytes.splice(at.min(n)..at.min(n), word.bytes());
            }
            7 if n > 0 => {
                // A number in a text becomes another one.
                if let Some(digit) = (at..n).find(|k| bytes[*k].is_ascii_digit()) {
                    let end = (digit..n).find(|k| !bytes[*k].is_ascii_digit()).unwrap_or(n);
                    let word = WORDS[self.below(WORDS.len())];
                    bytes.splice(digit..end, word.bytes());
                }
            }
            8 => {
                let other = &corpus[self.below(corpus.len())];
                let from = self.below(other.len());
                let part: Vec<u8> = other[from..].iter().copied().take(1 + self.below(256)).collect();
                bytes.splice(at.min(n)..at.min(n), part);
            }
            _ => bytes.truncate(at),
        }
    }
}
