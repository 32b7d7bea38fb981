//! Words in what is read and in what is said of it: which is meant, how several are told.

use crate::nearest::nearest;

/// The word that is meant: one that differs in capitals only, else the nearest.
pub(super) fn meant<'w>(text: &str, words: &[&'w str]) -> Option<&'w str> {
    let other_case = words.iter().find(|word| word.eq_ignore_ascii_case(text));
    other_case
        .copied()
        .or_else(|| nearest(text, words.iter().copied()))
}

/// Words of other tools for words of this language.
const OTHER_WORDS: [(&str, &str); 22] = [
    ("import", "use"),
    ("include", "use"),
    ("require", "use"),
    ("statemachine", "machine"),
    ("state_machine", "machine"),
    ("fsm", "machine"),
    ("robot", "machine"),
    ("program", "machine"),
    ("composite", "container"),
    ("component", "container"),
    ("submachine", "container"),
    ("module", "container"),
    ("signal", "event"),
    ("events", "event"),
    ("input", "in"),
    ("output", "out"),
    ("parallel", "region"),
    ("connect", "path"),
    ("wire", "path"),
    ("states", "state"),
    ("substate", "super"),
    ("behaviour", "task"),
];

/// The word of the language for a word of another one, of those that are possible.
pub(super) fn other_word<'w>(text: &str, possible: &[&'w str]) -> Option<&'w str> {
    let (_, meant) = OTHER_WORDS
        .iter()
        .find(|(other, _)| other.eq_ignore_ascii_case(text))?;
    possible.iter().find(|word| *word == meant).copied()
}

/// The words in a sentence.
pub(super) fn one_of(words: &[&str]) -> String {
    match words {
        [] => String::new(),
        [word] => format!("`{word}`"),
        [words @ .., last] => {
            let words: Vec<String> = words.iter().map(|word| format!("`{word}`")).collect();
            format!("{} or `{last}`", words.join(", "))
        }
    }
}

/// The start of a text that may be long, with what cannot be printed made visible.
pub(in crate::lang) fn excerpt(text: &str) -> String {
    const MAX_CHARACTERS: usize = 40;
    let mut excerpt: String = text
        .chars()
        .take(MAX_CHARACTERS)
        .flat_map(|character| {
            let is_visible = !character.is_control();
            let escaped = (!is_visible).then(|| character.escape_default());
            is_visible
                .then_some(character)
                .into_iter()
                .chain(escaped.into_iter().flatten())
        })
        .collect();
    if text.chars().nth(MAX_CHARACTERS).is_some() {
        excerpt.push('…');
    }
    excerpt
}
