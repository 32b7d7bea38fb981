//! From text to tokens, one at a time: a file of any length costs no memory for its tokens.

use logos::{Filter, Logos};

/// Kind of a token. Blanks and comments are none.
#[derive(Logos, Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[logos(skip r"[ \t\r\n\x0B\x0C]+")]
#[logos(skip(r"//[^\n]*", allow_greedy = true))]
pub enum TokenKind {
    #[token("use")]
    Use,
    #[token("interpreter")]
    Interpreter,
    #[token("queue")]
    Queue,
    #[token("slot")]
    Slot,
    #[token("task")]
    Task,
    #[token("container")]
    Container,
    #[token("machine")]
    Machine,
    #[token("event")]
    Event,
    #[token("in")]
    In,
    #[token("out")]
    Out,
    #[token("inout")]
    InOut,
    #[token("flag")]
    Flag,
    #[token("data")]
    Data,
    #[token("param")]
    Param,
    #[token("region")]
    Region,
    #[token("state")]
    State,
    #[token("super")]
    Super,
    #[token("initial")]
    Initial,
    #[token("final")]
    Final,
    #[token("on")]
    On,
    #[token("pulse")]
    Pulse,
    #[token("send")]
    Send,
    #[token("set")]
    Set,
    #[token("clear")]
    Clear,
    #[token("and")]
    And,
    #[token("or")]
    Or,
    #[token("not")]
    Not,
    #[token("exit")]
    Exit,
    #[token("timeout")]
    Timeout,
    #[token("busy")]
    Busy,
    #[token("path")]
    Path,
    #[token("with")]
    With,
    #[token("link")]
    Link,
    #[token("frame")]
    Frame,
    #[token("true")]
    True,
    #[token("false")]
    False,
    /// A word that is kept for later versions of the language.
    #[token("assert")]
    #[token("history")]
    KeptForLater,

    /// An ANSI C identifier that is not reserved. Units, type names and words such as `period` are
    /// among them.
    #[regex("[A-Za-z_][A-Za-z0-9_]*", priority = 2)]
    Identifier,
    /// A word with letters that an identifier does not have.
    #[regex(
        "[A-Za-z_\u{80}-\u{10FFFF}][A-Za-z0-9_\u{80}-\u{10FFFF}]*",
        priority = 1
    )]
    ForeignWord,
    #[regex("[0-9]+")]
    Integer,
    #[regex(r"[0-9]+\.[0-9]+([eE][+-]?[0-9]+)?|[0-9]+[eE][+-]?[0-9]+")]
    Float,
    /// A text between quotation marks, both of them included.
    #[regex(r#""[^"\r\n]*""#)]
    Text,

    #[token(";")]
    Semicolon,
    #[token(",")]
    Comma,
    #[token(":")]
    Colon,
    #[token(".")]
    Dot,
    #[token("^")]
    Caret,
    #[token("=")]
    Equals,
    #[token("-")]
    Minus,
    #[token("->")]
    Arrow,
    #[token("*")]
    Star,
    #[token("/")]
    Slash,
    #[token("{")]
    BraceOpen,
    #[token("}")]
    BraceClose,
    #[token("[")]
    BracketOpen,
    #[token("]")]
    BracketClose,
    #[token("(")]
    ParenthesisOpen,
    #[token(")")]
    ParenthesisClose,

    /// A text without its second quotation mark: it ends with its line.
    #[regex(r#""[^"\r\n]*"#)]
    UnclosedText,
    /// A comment without its end: all the rest of the file.
    #[token("/*", skip_block_comment)]
    UnclosedComment,
    /// Characters that no token starts with.
    Unknown,
    /// The end of the file, an empty token.
    EndOfFile,
}

/// Skips to the end of a block comment. One without an end becomes a token, so that the parser can
/// say where it starts.
fn skip_block_comment(lexer: &mut logos::Lexer<'_, TokenKind>) -> Filter<()> {
    match lexer.remainder().find("*/") {
        Some(end) => {
            lexer.bump(end + "*/".len());
            Filter::Skip
        }
        None => {
            lexer.bump(lexer.remainder().len());
            Filter::Emit(())
        }
    }
}

impl TokenKind {
    /// Whether the word is reserved, so that nothing can have it as its name.
    pub fn is_reserved(self) -> bool {
        (self as u8) <= TokenKind::KeptForLater as u8
    }

    /// Whether this is a word that cannot be a name: a reserved one, or one with letters that names
    /// do not have, or a very long one.
    pub fn is_no_name(self) -> bool {
        self.is_reserved() || self == TokenKind::ForeignWord
    }
}

/// The reserved words, those that are kept for later among them.
pub const RESERVED_WORDS: [&str; 38] = [
    "use",
    "interpreter",
    "queue",
    "slot",
    "task",
    "container",
    "machine",
    "event",
    "in",
    "out",
    "inout",
    "flag",
    "data",
    "param",
    "region",
    "state",
    "super",
    "initial",
    "final",
    "on",
    "pulse",
    "send",
    "set",
    "clear",
    "and",
    "or",
    "not",
    "exit",
    "timeout",
    "busy",
    "path",
    "with",
    "true",
    "false",
    "link",
    "frame",
    "assert",
    "history",
];

/// The longest name. Longer ones are no names, so that ten thousand messages about one stay
/// readable, and in memory.
pub const MAX_NAME_BYTES: usize = 1_000;

/// A token: its kind and its byte range.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Token {
    /// Kind.
    pub kind: TokenKind,
    /// First byte.
    pub start: u32,
    /// One past the last byte.
    pub end: u32,
}

/// Gives the tokens of a text, then [`TokenKind::EndOfFile`] for ever.
pub struct Lexer<'t> {
    logos: logos::Lexer<'t, TokenKind>,
    /// A token that was read to see where a run of unknown characters ends.
    pending: Option<Token>,
    end_of_file: Token,
}

impl<'t> Lexer<'t> {
    /// A lexer at the start of the text, which is shorter than 4 GiB.
    pub fn new(text: &'t str) -> Self {
        // The end of the file is on its last line: behind the last character that is not the break
        // of that line.
        let last_line = text.strip_suffix('\n').unwrap_or(text);
        let last_line = last_line.strip_suffix('\r').unwrap_or(last_line);
        let end = last_line.len() as u32;
        Lexer {
            logos: TokenKind::lexer(text),
            pending: None,
            end_of_file: Token {
                kind: TokenKind::EndOfFile,
                start: end,
                end,
            },
        }
    }

    /// A lexer behind a token that ends at byte `start`.
    pub fn new_at(text: &'t str, start: u32) -> Self {
        let mut lexer = Lexer::new(text);
        lexer.logos.bump(start as usize);
        lexer
    }

    /// The next token. Neighbouring unknown characters are one token.
    pub fn next_token(&mut self) -> Token {
        let Some(mut token) = self.pending.take().or_else(|| self.raw_token()) else {
            return self.end_of_file;
        };
        if token.kind == TokenKind::Unknown {
            while let Some(next) = self.raw_token() {
                if next.kind == TokenKind::Unknown && next.start == token.end {
                    token.end = next.end;
                } else {
                    self.pending = Some(next);
                    break;
                }
            }
        }
        token
    }

    fn raw_token(&mut self) -> Option<Token> {
        let kind = self.logos.next()?.unwrap_or(TokenKind::Unknown);
        let range = self.logos.span();
        let is_too_long = kind == TokenKind::Identifier && range.len() > MAX_NAME_BYTES;
        Some(Token {
            kind: if is_too_long {
                TokenKind::ForeignWord
            } else {
                kind
            },
            start: range.start as u32,
            end: range.end as u32,
        })
    }
}

/// A comment between two tokens.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Comment<'t> {
    /// The comment with its marks; of a line comment without the end of the line.
    pub text: &'t str,
    /// Whether it starts with `//`, so that nothing can follow on its line.
    pub is_line: bool,
    /// How many lines end between what stands before it (a token, a comment, or the start of the
    /// text) and it.
    pub breaks_before: usize,
    /// First byte of the comment in the gap.
    pub start: usize,
}

/// The comments in a gap between two tokens. Reading tokens alone costs nothing for them: who wants
/// them asks gap by gap.
#[derive(Clone, Debug)]
pub struct Comments<'t> {
    gap: &'t str,
    at: usize,
    breaks: usize,
}

impl<'t> Comments<'t> {
    /// The comments in `gap`, the text from the end of a token to the start of the next one.
    pub fn new(gap: &'t str) -> Self {
        Comments {
            gap,
            at: 0,
            breaks: 0,
        }
    }

    /// How many lines end behind the last comment that was given.
    pub fn breaks(&self) -> usize {
        self.breaks
    }
}

impl<'t> Iterator for Comments<'t> {
    type Item = Comment<'t>;

    fn next(&mut self) -> Option<Comment<'t>> {
        let rest = self.gap.get(self.at..).unwrap_or("");
        // A gap is made of blanks and comments, so the next slash starts one.
        let blank = rest.find('/').unwrap_or(rest.len());
        let (blanks, rest) = rest.split_at(blank);
        self.breaks += blanks.bytes().filter(|&byte| byte == b'\n').count();
        self.at += blank;
        if rest.is_empty() {
            return None;
        }
        let is_line = rest.starts_with("//");
        let end = if is_line {
            rest.find('\n')
        } else {
            // Behind the opening mark: `/*/` closes nothing.
            rest.get(2..)
                .and_then(|inside| inside.find("*/"))
                .map(|end| end + 4)
        };
        let text = rest.get(..end.unwrap_or(rest.len())).unwrap_or(rest);
        let start = self.at;
        self.at += text.len();
        Some(Comment {
            text,
            is_line,
            breaks_before: std::mem::take(&mut self.breaks),
            start,
        })
    }
}

/// Where the lines in a gap are that describe what follows: from the first `///` to the end of the
/// last such line. A comment on the line of the token before describes nothing, nor does one with
/// more than three slashes. `is_first`: the gap starts the file.
pub fn docs(gap: &str, is_first: bool) -> Option<(usize, usize)> {
    if !gap.contains("///") {
        return None;
    }
    let mut found: Option<(usize, usize)> = None;
    let mut is_behind = !is_first;
    for comment in Comments::new(gap) {
        is_behind &= comment.breaks_before == 0;
        if !is_behind && doc_line(comment.text).is_some() {
            let end = comment.start + comment.text.trim_end().len();
            found = Some((found.map_or(comment.start, |(start, _)| start), end));
        }
    }
    found
}

/// What a `///` line says.
fn doc_line(comment: &str) -> Option<&str> {
    let line = comment.strip_prefix("///")?;
    (!line.starts_with('/')).then(|| line.strip_prefix(' ').unwrap_or(line).trim_end())
}

/// What the `///` lines in a text say that [`docs`] found, a line each.
pub fn docs_text(text: &str) -> String {
    let lines: Vec<&str> = Comments::new(text)
        .filter_map(|comment| doc_line(comment.text))
        .collect();
    lines.join("\n")
}

#[cfg(test)]
mod tests {
    use super::TokenKind as T;
    use super::*;

    fn tokens(text: &str) -> Vec<(TokenKind, &str)> {
        let mut lexer = Lexer::new(text);
        let mut tokens = Vec::new();
        loop {
            let token = lexer.next_token();
            if token.kind == T::EndOfFile {
                return tokens;
            }
            tokens.push((token.kind, &text[token.start as usize..token.end as usize]));
        }
    }

    #[test]
    fn texts_and_their_tokens() {
        let cases: &[(&str, &[(TokenKind, &str)])] = &[
            ("", &[]),
            (" \t\r\n\x0C", &[]),
            ("// a\nuse // b", &[(T::Use, "use")]),
            (
                "a/* * / ** */b/**/",
                &[(T::Identifier, "a"), (T::Identifier, "b")],
            ),
            (
                "a /* b",
                &[(T::Identifier, "a"), (T::UnclosedComment, "/* b")],
            ),
            (
                "in inout input",
                &[(T::In, "in"), (T::InOut, "inout"), (T::Identifier, "input")],
            ),
            (
                "history us Hz f32",
                &[
                    (T::KeptForLater, "history"),
                    (T::Identifier, "us"),
                    (T::Identifier, "Hz"),
                    (T::Identifier, "f32"),
                ],
            ),
            ("10ms", &[(T::Integer, "10"), (T::Identifier, "ms")]),
            (
                "1.5e-3 2e5 3e",
                &[
                    (T::Float, "1.5e-3"),
                    (T::Float, "2e5"),
                    (T::Integer, "3"),
                    (T::Identifier, "e"),
                ],
            ),
            (
                "A.b",
                &[(T::Identifier, "A"), (T::Dot, "."), (T::Identifier, "b")],
            ),
            (
                "a->b - >",
                &[
                    (T::Identifier, "a"),
                    (T::Arrow, "->"),
                    (T::Identifier, "b"),
                    (T::Minus, "-"),
                    (T::Unknown, ">"),
                ],
            ),
            (
                "\"a.esm\" \"b",
                &[(T::Text, "\"a.esm\""), (T::UnclosedText, "\"b")],
            ),
            ("\"b\nc", &[(T::UnclosedText, "\"b"), (T::Identifier, "c")]),
            (
                "Größe x",
                &[(T::ForeignWord, "Größe"), (T::Identifier, "x")],
            ),
            (
                "\0\0@ \0;",
                &[
                    (T::Unknown, "\0\0@"),
                    (T::Unknown, "\0"),
                    (T::Semicolon, ";"),
                ],
            ),
        ];
        for (text, expected) in cases {
            assert_eq!(&tokens(text), expected, "{text:?}");
        }
    }

    #[test]
    fn the_file_ends_on_its_last_line() {
        for (text, end) in [
            ("", 0),
            ("a", 1),
            ("a\n", 1),
            ("a\r\n", 1),
            ("a\n\n", 2),
            ("a\n  ", 4),
        ] {
            let mut lexer = Lexer::new(text);
            while lexer.next_token().kind != T::EndOfFile {}
            assert_eq!(lexer.next_token().start, end, "{text:?}");
        }
    }

    #[test]
    fn reserved_words_are_told_from_names() {
        for (text, reserved) in [
            ("use", true),
            ("false", true),
            ("history", true),
            ("period", false),
            ("x", false),
            ("1", false),
        ] {
            assert_eq!(
                Lexer::new(text).next_token().kind.is_reserved(),
                reserved,
                "{text}"
            );
        }
    }

    #[test]
    fn the_reserved_words_are_the_tokens_that_are_reserved() {
        let mut kinds: Vec<TokenKind> = Vec::new();
        for word in RESERVED_WORDS {
            let token = Lexer::new(word).next_token();
            assert!(token.kind.is_reserved(), "{word}");
            assert_eq!(token.end as usize, word.len(), "{word}");
            if !kinds.contains(&token.kind) {
                kinds.push(token.kind);
            }
        }
        assert_eq!(kinds.len(), T::KeptForLater as usize + 1);
    }

    #[test]
    fn lines_that_describe() {
        for (gap, is_first, expected) in [
            ("", true, ""),
            ("/// a", true, "a"),
            ("/// a", false, ""),
            ("  /// a\n", true, "a"),
            (
                "\n  /// a\r\n  ///  b \r\n\t///\n///c\n",
                false,
                "a\n b\n\nc",
            ),
            ("\n// a\n/// b\n// c\n\n/// d\n//// e\n", false, "b\nd"),
            (" /// of what is before it\n", false, ""),
            ("\n/* a */ /// b\n", false, "b"),
            (" /* a */ /// b\n", false, ""),
            ("\n/* a\n/// b\n*/\n", false, ""),
            ("\n/* a */\n/// b /* c\n", false, "b /* c"),
            ("\n// /// a\n", false, ""),
        ] {
            let found = docs(gap, is_first).map(|(start, end)| docs_text(&gap[start..end]));
            assert_eq!(found.unwrap_or_default(), expected, "{gap:?}");
        }
    }

    #[test]
    fn gaps_and_their_comments() {
        type Found<'t> = (&'t str, bool, usize);
        let cases: &[(&str, &[Found<'_>], usize)] = &[
            ("", &[], 0),
            (" \r\n\t\n", &[], 2),
            (" // a\r\n", &[("// a\r", true, 0)], 1),
            ("\n\n// a", &[("// a", true, 2)], 0),
            (
                "/*/ */\n/**/ /* a\nb */// c\n",
                &[
                    ("/*/ */", false, 0),
                    ("/**/", false, 1),
                    ("/* a\nb */", false, 0),
                    ("// c", true, 0),
                ],
                1,
            ),
        ];
        for (gap, expected, breaks) in cases {
            let mut comments = Comments::new(gap);
            let found: Vec<Found<'_>> = comments
                .by_ref()
                .map(|comment| (comment.text, comment.is_line, comment.breaks_before))
                .collect();
            assert_eq!(&found, expected, "{gap:?}");
            assert_eq!(comments.breaks(), *breaks, "{gap:?}");
        }
    }
}
