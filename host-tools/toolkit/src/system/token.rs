//! Words of a system file.

use crate::model::Span;

/// What a token is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// A name, a keyword, a number: letters, digits, `_ . + -`.
    Word,
    /// A text in quotes.
    Text,
    /// `; , %`
    Sign(char),
    /// A text whose second quote is missing on its line.
    OpenText,
    /// What no file has outside of texts.
    Unknown,
}

/// A token.
#[derive(Clone, Copy, Debug)]
pub(super) struct Token<'t> {
    pub(super) kind: Kind,
    /// Without quotes.
    pub(super) text: &'t str,
    pub(super) span: Span,
}

fn is_of_word(letter: char) -> bool {
    letter.is_ascii_alphanumeric() || "_.+-".contains(letter)
}

/// The tokens of a text, without blanks and comments.
pub(super) fn tokens(text: &str) -> Vec<Token<'_>> {
    let mut tokens = Vec::new();
    let mut at = 0;
    while let Some(rest) = text.get(at..).filter(|rest| !rest.is_empty()) {
        let blanks = rest.len() - rest.trim_start().len();
        if blanks > 0 {
            at += blanks;
            continue;
        }
        let line = rest.split(['\n', '\r']).next().unwrap_or(rest);
        if rest.starts_with("//") {
            at += line.len();
            continue;
        }
        let first = rest.chars().next().unwrap_or(' ');
        let (kind, inside, length) = if first == '"' {
            let inside = line.get(1..).unwrap_or("");
            match inside.find('"') {
                Some(end) => (Kind::Text, inside.get(..end).unwrap_or(""), end + 2),
                None => (Kind::OpenText, inside, line.len()),
            }
        } else if is_of_word(first) {
            let end = rest.find(|letter| !is_of_word(letter));
            let end = end.unwrap_or(rest.len());
            (Kind::Word, rest.get(..end).unwrap_or(""), end)
        } else {
            let kind = match first {
                ';' | ',' | '%' => Kind::Sign(first),
                _ => Kind::Unknown,
            };
            let length = first.len_utf8();
            (kind, rest.get(..length).unwrap_or(""), length)
        };
        tokens.push(Token {
            kind,
            text: inside,
            span: span(at, at + length),
        });
        at += length;
    }
    tokens
}

/// A span of the system file, which is the first of its set.
pub(super) fn span(start: usize, end: usize) -> Span {
    let place = |at| u32::try_from(at).unwrap_or(u32::MAX);
    Span {
        file: 0,
        start: place(start),
        end: place(end),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_words_texts_and_signs() {
        let text = "link a.b, // more; \n \"x y\" 1e-5%;\u{e9}\"open\n";
        let found: Vec<(Kind, &str)> = (tokens(text).iter()).map(|it| (it.kind, it.text)).collect();
        let expected = [
            (Kind::Word, "link"),
            (Kind::Word, "a.b"),
            (Kind::Sign(','), ","),
            (Kind::Text, "x y"),
            (Kind::Word, "1e-5"),
            (Kind::Sign('%'), "%"),
            (Kind::Sign(';'), ";"),
            (Kind::Unknown, "\u{e9}"),
            (Kind::OpenText, "open"),
        ];
        assert_eq!(found, expected);
        for token in tokens(text) {
            let (start, end) = (token.span.start as usize, token.span.end as usize);
            assert!(text[start..end].contains(token.text));
        }
    }
}
