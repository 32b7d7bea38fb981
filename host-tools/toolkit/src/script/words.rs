//! The words of a line.

use crate::model::Span;

/// A word, a sign, or something that is neither.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Word<'t> {
    pub(super) text: &'t str,
    pub(super) span: Span,
}

/// The words of each line of a text, comments and empty lines left out.
pub(super) fn lines(text: &str) -> Vec<(u32, Vec<Word<'_>>)> {
    let mut start = 0;
    let mut lines = Vec::new();
    for (number, line) in (1..).zip(text.split('\n')) {
        let code = line.find("//").map_or(line, |comment| &line[..comment]);
        let words = words(code, start);
        if !words.is_empty() {
            lines.push((number, words));
        }
        start += line.len() + 1;
    }
    lines
}

fn words(line: &str, start: usize) -> Vec<Word<'_>> {
    let mut words = Vec::new();
    let mut rest = line;
    loop {
        let trimmed = rest.trim_start();
        let Some(first) = trimmed.chars().next() else {
            return words;
        };
        let len = if trimmed.starts_with("->") {
            2
        } else if is_of_word(first) {
            let end = trimmed.find(|letter| !is_of_word(letter));
            // A number's sign is its own, but an arrow is none: `2->`.
            let end = end.unwrap_or(trimmed.len());
            trimmed.find("->").map_or(end, |arrow| arrow.min(end))
        } else {
            first.len_utf8()
        };
        let at = start + (line.len() - trimmed.len());
        words.push(Word {
            text: &trimmed[..len],
            span: Span {
                file: 0,
                start: at as u32,
                end: (at + len) as u32,
            },
        });
        rest = &trimmed[len..];
    }
}

fn is_of_word(letter: char) -> bool {
    letter.is_alphanumeric() || matches!(letter, '_' | '.' | '-' | '+')
}
