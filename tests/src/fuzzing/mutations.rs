//! Changed copies of inputs, made without a fuzzer: what the ordinary tests run.

use std::sync::OnceLock;

use crate::random::Random;

/// The words of the language, in the form in which libFuzzer takes a dictionary: each in double
/// quotes on a line of its own, `\"` for a quote.
const DICTIONARY: &str = include_str!("../../../fuzz/esm.dict");

/// No changed copy is longer.
const MAX_BYTES: usize = 1 << 14;

/// The words of the language, signs included.
pub fn words() -> &'static [String] {
    static WORDS: OnceLock<Vec<String>> = OnceLock::new();
    WORDS.get_or_init(|| {
        let quoted = |line: &str| Some(line.strip_prefix('"')?.strip_suffix('"')?.to_owned());
        let lines = DICTIONARY.lines().filter_map(quoted);
        lines
            .map(|word| word.replace("\\\"", "\"").replace("\\\\", "\\"))
            .collect()
    })
}

/// A changed copy of `bytes`, with parts of `other` in it now and then.
pub fn mutated(bytes: &[u8], other: &[u8], random: &mut Random) -> Vec<u8> {
    let mut changed = bytes.to_vec();
    for _ in 0..random.between(1, 5) {
        change(&mut changed, other, random);
    }
    changed.truncate(MAX_BYTES);
    changed
}

fn change(bytes: &mut Vec<u8>, other: &[u8], random: &mut Random) {
    let at = random.below(bytes.len() + 1);
    match random.below(12) {
        0 => {
            let run = some_run(bytes, random);
            bytes.drain(run);
        }
        1 => {
            let copy = bytes[some_run(bytes, random)].to_vec();
            bytes.splice(at..at, copy);
        }
        2 => {
            let copy = other[some_run(other, random)].to_vec();
            bytes.splice(at..at, copy);
        }
        3 | 4 => {
            let (from, to) = (some_line(bytes, random), some_line(bytes, random));
            let line = bytes[from].to_vec();
            let replaced = if random.chance(50) {
                to.clone()
            } else {
                to.start..to.start
            };
            bytes.splice(replaced, line);
        }
        5 => {
            let line = some_line(bytes, random);
            bytes.drain(line);
        }
        6 | 7 => {
            let word = random.pick(words()).map_or("", String::as_str);
            bytes.splice(at..at, format!(" {word} ").into_bytes());
        }
        8 => {
            let number = [
                0,
                1,
                2,
                31,
                255,
                256,
                4_095,
                65_534,
                65_535,
                4_000_000_001,
                u64::MAX,
            ];
            let number = number[random.below(number.len())].to_string();
            bytes.splice(at..at, number.into_bytes());
        }
        9 => bytes.insert(at, random.below(256) as u8),
        _ => {
            if let Some(byte) = bytes.get_mut(at) {
                *byte ^= 1 << random.below(8);
            }
        }
    }
}

/// Some bytes in a row, mostly few.
fn some_run(bytes: &[u8], random: &mut Random) -> std::ops::Range<usize> {
    let start = random.below(bytes.len() + 1);
    let longest = if random.chance(80) { 16 } else { 512 };
    let length = random.below(longest.min(bytes.len() - start + 1));
    start..start + length
}

/// A whole line with its end. Without lines it is the rest of the bytes.
fn some_line(bytes: &[u8], random: &mut Random) -> std::ops::Range<usize> {
    let at = random.below(bytes.len() + 1);
    let is_break = |byte: &u8| *byte == b'\n';
    let start = bytes[..at]
        .iter()
        .rposition(is_break)
        .map_or(0, |it| it + 1);
    let end = bytes[at..].iter().position(is_break);
    start..end.map_or(bytes.len(), |length| at + length + 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_dictionary_has_the_language() {
        for word in [
            "interpreter",
            "super",
            "->",
            "//",
            "\"",
            "final",
            "us",
            "f32",
        ] {
            assert!(words().iter().any(|it| it == word), "{word}");
        }
    }

    #[test]
    fn copies_differ_and_follow_from_the_seed_alone() {
        let copies = |seed| {
            let mut random = Random::new(seed);
            let text = b"machine M {\n  region r { }\n}\n";
            (0..200)
                .map(|_| mutated(text, b"other", &mut random))
                .collect::<Vec<_>>()
        };
        assert_eq!(copies(1), copies(1));
        let different: std::collections::BTreeSet<_> = copies(1).into_iter().collect();
        assert!(different.len() > 150, "{}", different.len());
    }

    #[test]
    fn nothing_is_too_short_to_be_changed() {
        let mut random = Random::new(3);
        for _ in 0..2_000 {
            let _ = mutated(b"", b"", &mut random);
        }
    }
}
