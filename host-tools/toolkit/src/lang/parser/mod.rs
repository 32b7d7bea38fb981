//! From tokens to a [`tree`](super::tree), whatever the tokens are.
//!
//! The parser is one function a production, in the order of the grammar. Two rules keep one mistake
//! from costing more than one message, and from costing names that can still be read:
//!
//! - **A mistake is reported where it is found, and not again.** Each production goes on as if what
//!   it missed had been there; what it then misses at the same token is not reported.
//! - **Skipping stops early**: at the `;` or block that ends a statement, before a `}`, and before
//!   a word that only starts a declaration. A word that is nearly such a word is taken for it; a
//!   `}` too many or too few closes no more than its own body.
//!
//! Recursion happens in guards alone, and is bounded by [`MAX_GUARD_DEPTH`].

mod containers;
mod cures;
mod file;
mod links;
mod regions;
mod tasks;
mod transitions;
mod values;
mod words;

use std::collections::HashSet;

use crate::model::Span;

use crate::lang::cure::Cure;
use crate::lang::diagnostic::{Code, Diagnostic, Edit, Fix, Sink};
use crate::lang::lexer::{Lexer, Token, TokenKind as T, docs};
use crate::lang::tree::{File, Given, Name};

pub(super) use words::excerpt;
use words::{meant, other_word};

/// How deep `(` and `not` nest in a guard.
pub const MAX_GUARD_DEPTH: usize = 100;

/// The longest time that can be written, in microseconds: 4,000 s, so that every time fits 32 bits.
pub const MAX_TIME_US: u32 = 4_000_000_000;

/// Reads a whole file. `file` is its index in the set.
pub(super) fn parse(text: &str, file: u32, sink: &mut Sink) -> File {
    let mut parser = Parser::new(text, file, sink);
    parser.file()
}

/// Which body the parser is in: what starts a declaration depends on it.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Body {
    File,
    Task,
    Container,
    Region,
}

struct Parser<'t, 's> {
    text: &'t str,
    file: u32,
    lexer: Lexer<'t>,
    token: Token,
    next: Token,
    /// End of the token before `token`.
    last_end: u32,
    /// The last `///` lines, and the start of the token behind them.
    docs: Option<(u32, Span)>,
    /// Start of the token at which something was reported last.
    reported_at: Option<u32>,
    body: Body,
    /// Whether something in this statement was not as expected, so that what follows in it may mean
    /// anything.
    is_lost: bool,
    /// Whether that goes on into the next statement.
    stays_lost: bool,
    /// Whether a comment that is never closed hides the rest of the file.
    is_cut: bool,
    /// How many `}` may stand where nothing is open, because of what has been reported: a body that
    /// was left without its own, or one that something outside of it was taken into.
    loose_closes: usize,
    /// Words that were used as names and cannot be.
    no_names: HashSet<&'t str>,
    /// Limits of time that stand at transitions of this region: they are told when all its states
    /// are known.
    limits: Vec<Limit>,
    /// Whether a part of the guard that is read is not known for certain; it is reported.
    guard_has_gaps: bool,
    sink: &'s mut Sink,
}

/// A limit of time that stands at a transition.
struct Limit {
    /// The state that the transition leaves.
    source: Option<Name>,
    /// The time as it is written, with a unit.
    time: Option<String>,
    /// What is told of it.
    diagnostic: Diagnostic,
    /// What reads the limit of the state instead.
    edits: Vec<Edit>,
}

/// A guard that could not be read; why is reported.
struct BrokenGuard;

impl<'t, 's> Parser<'t, 's> {
    fn new(text: &'t str, file: u32, sink: &'s mut Sink) -> Self {
        let nothing = Token {
            kind: T::EndOfFile,
            start: 0,
            end: 0,
        };
        let mut parser = Parser {
            text,
            file,
            lexer: Lexer::new(text),
            token: nothing,
            next: nothing,
            last_end: 0,
            docs: None,
            reported_at: None,
            body: Body::File,
            is_lost: false,
            stays_lost: false,
            is_cut: false,
            loose_closes: 0,
            no_names: HashSet::new(),
            limits: Vec::new(),
            guard_has_gaps: false,
            sink,
        };
        parser.bump();
        parser.bump();
        parser.last_end = 0;
        parser
    }

    // ─── Tokens ──────────────────────────────────────────────────────────────────────────────────

    /// Goes to the next token.
    fn bump(&mut self) {
        self.last_end = self.token.end;
        self.token = self.next;
        self.next = self.lexer.next_token();
        if self.token.kind == T::UnclosedComment {
            self.report(
                Diagnostic::new(Code::E001, self.here(), "this comment is never closed")
                    .hint("end it with `*/`"),
            );
            self.is_cut = true;
            self.token = self.next;
            self.report_nothing_here();
        }
        self.note_docs();
        if self.is_repeated() {
            if !self.is_lost {
                let found = excerpt(self.text_of(self.next));
                let message = format!("found `{found}` a second time in a row");
                let second = self.span_between(self.token.end, self.next.end);
                self.sink.push(
                    Diagnostic::new(Code::E001, self.span_of(self.next), message)
                        .hint("remove one of the two")
                        .fix(Fix::one("remove one of the two", Edit::remove(second))),
                );
            }
            while self.is_repeated() {
                self.next = self.lexer.next_token();
            }
        }
    }

    /// Takes down the `///` lines before the current token.
    fn note_docs(&mut self) {
        let (start, end) = (self.last_end, self.token.start);
        let gap = self.text.get(start as usize..end as usize).unwrap_or("");
        if let Some((first, last)) = docs(gap, start == 0) {
            let docs = Span {
                file: self.file,
                start: start + first as u32,
                end: start + last as u32,
            };
            self.docs = Some((end, docs));
        }
    }

    /// The `///` lines before what starts at a place.
    fn docs_before(&self, start: Span) -> Option<Span> {
        self.docs
            .filter(|(token, _)| *token == start.start)
            .map(|(_, docs)| docs)
    }

    /// Whether the next token is this one again, which is not how any statement goes on. It is then
    /// taken once.
    fn is_repeated(&self) -> bool {
        if self.next.kind != self.token.kind {
            return false;
        }
        let behind = || self.lexer_behind_next().next_token().kind;
        match self.token.kind {
            T::Not => false,
            T::BraceOpen => true,
            // `task A A: T`
            T::Identifier => {
                self.text_of(self.next) == self.text_of(self.token) && behind() == T::Colon
            }
            // `data data: X` is another mistake: a reserved word for a name.
            kind if kind.is_reserved() => {
                let behind = behind();
                behind.is_reserved() || matches!(behind, T::Identifier | T::Integer)
            }
            _ => false,
        }
    }

    fn at(&self, kind: T) -> bool {
        self.token.kind == kind
    }

    fn eat(&mut self, kind: T) -> bool {
        let is_there = self.at(kind);
        if is_there {
            self.bump();
        }
        is_there
    }

    /// Eats a token that must be there, or reports that it is not.
    fn expect(&mut self, kind: T, what: &str) -> bool {
        let is_there = self.eat(kind);
        if !is_there {
            self.expected(what);
        }
        is_there
    }

    fn text_of(&self, token: Token) -> &'t str {
        self.text
            .get(token.start as usize..token.end as usize)
            .unwrap_or("")
    }

    fn span_of(&self, token: Token) -> Span {
        Span {
            file: self.file,
            start: token.start,
            end: token.end,
        }
    }

    /// Where the parser is.
    fn here(&self) -> Span {
        self.span_of(self.token)
    }

    /// From `start` to the end of the token before this one.
    fn since(&self, start: Span) -> Span {
        Span {
            end: self.last_end.max(start.start),
            ..start
        }
    }

    // ─── Reports ─────────────────────────────────────────────────────────────────────────────────

    /// Whether something has been reported at the current token, or the statement is lost already:
    /// no more is said then.
    fn is_told(&self) -> bool {
        self.reported_at == Some(self.token.start) || self.is_lost
    }

    /// Reports something at the current token, unless that [is told](Self::is_told).
    fn report(&mut self, diagnostic: Diagnostic) {
        if !self.is_told() {
            self.reported_at = Some(self.token.start);
            self.sink.push(diagnostic);
        }
    }

    /// Keeps from reporting what is missing at the current token: it is hidden in what was reported
    /// before it.
    fn report_nothing_here(&mut self) {
        self.reported_at = Some(self.token.start);
    }

    /// Reports that something else was expected here.
    fn expected(&mut self, what: &str) {
        if self.is_told() {
            self.is_lost = true;
            return;
        }
        let hint = match (self.token.kind, self.text_of(self.token)) {
            (T::Unknown, "&&" | "&") => Some("write `and`"),
            (T::Unknown, "||" | "|") => Some("write `or`"),
            (T::Unknown, "!") => Some("write `not`"),
            (T::Unknown, text) if text.starts_with('#') => {
                let rest = self.span_of(self.token);
                let mark = Span {
                    end: rest.start + 1,
                    ..rest
                };
                let cure = Cure::say("a comment starts with `//`").edit(Edit::replace(mark, "//"));
                return self.lost(what, cure);
            }
            (T::Unknown, _) => Some("no word or sign of the language starts like this: remove it"),
            (T::UnclosedText, _) => Some("a text ends with `\"` on the same line"),
            (T::EndOfFile, _) => Some("the file stops in the middle of a declaration"),
            _ => None,
        };
        if hint.is_none()
            && let Some(word) = self.word_meant(what)
        {
            return self.lost(what, Cure::meant(self.here(), word));
        }
        self.expected_with(what, hint.map(str::to_owned));
    }

    /// The word that was probably meant, of those that `what` has between backticks.
    fn word_meant<'w>(&self, what: &'w str) -> Option<&'w str> {
        if !self.at(T::Identifier) {
            return None;
        }
        let quoted = what.split('`').skip(1).step_by(2);
        let words: Vec<&str> = quoted
            .filter(|text| text.chars().all(|letter| letter.is_ascii_alphanumeric()))
            .collect();
        meant(self.text_of(self.token), &words)
    }

    /// The same as a question.
    fn meant_of(&self, what: &str) -> Option<String> {
        let meant = self.word_meant(what)?;
        Some(format!("did you mean `{meant}`?"))
    }

    fn expected_with(&mut self, what: &str, hint: Option<String>) {
        self.corrected(what, hint);
        self.is_lost = true;
    }

    /// Reports that something else was expected here, where it is clear what is meant: the
    /// statement goes on.
    fn corrected(&mut self, what: &str, hint: Option<String>) {
        let fixes = Vec::new();
        self.mended(what, Cure { hint, fixes });
    }

    /// The current token for a message.
    fn found(&self) -> String {
        match self.token.kind {
            T::EndOfFile => "the end of the file".to_owned(),
            kind if kind.is_reserved() => {
                format!("the reserved word `{}`", self.text_of(self.token))
            }
            _ => format!("`{}`", excerpt(self.text_of(self.token))),
        }
    }

    /// Reports an attribute that is there a second time.
    fn attribute_twice(&mut self, what: &str) {
        let mut diagnostic =
            Diagnostic::new(Code::E003, self.here(), format!("{what} is given twice"))
                .hint("remove one of the two");
        // The attribute with its value.
        let [third] = self.ahead();
        let end = match what {
            "`timeout`" | "`wcet`" | "`within`" if third.kind == T::Identifier => Some(third.end),
            "`slot`" | "`count`" if self.next.kind == T::Integer => Some(self.next.end),
            "`exclusive`" if self.next.kind == T::Identifier => Some(self.next.end),
            "`optional`" | "`endless`" => Some(self.token.end),
            _ => None,
        };
        if let Some(end) = end {
            let second = self.span_between(self.last_end, end);
            diagnostic = diagnostic.fix(Fix::one("remove the second one", Edit::remove(second)));
        }
        self.report(diagnostic);
    }

    // ─── Skipping ────────────────────────────────────────────────────────────────────────────────

    /// Whether the current token can only be the start of a declaration or transition.
    fn at_start_of_item(&self) -> bool {
        match self.token.kind {
            T::Use | T::Interpreter | T::Queue | T::Task | T::Container | T::Machine => true,
            T::Event | T::In | T::Out | T::InOut | T::Param | T::Region | T::Path => true,
            T::State | T::Super | T::Initial | T::Link | T::Frame => true,
            T::Slot => self.body == Body::File,
            T::Identifier => self.body == Body::Region && self.next.kind == T::Arrow,
            _ => false,
        }
    }

    /// Skips the rest of a statement: to the `;` or block that ends it, or before what cannot
    /// belong to it.
    fn skip_statement(&mut self, mut names: Option<&mut Vec<Name>>) {
        loop {
            match self.token.kind {
                T::EndOfFile | T::BraceClose => return,
                T::Semicolon => return self.bump(),
                T::BraceOpen => {
                    self.skip_block(names);
                    self.eat(T::Semicolon);
                    return;
                }
                _ if self.at_start_of_item() => return,
                T::Identifier => {
                    if let Some(names) = &mut names {
                        names.push(Name(self.here()));
                    }
                    self.bump();
                }
                _ => self.bump(),
            }
        }
    }

    /// Skips from a `{` to its `}`, or before a word that starts a declaration of the file.
    fn skip_block(&mut self, mut names: Option<&mut Vec<Name>>) {
        let mut depth = 0_usize;
        loop {
            match self.token.kind {
                T::EndOfFile
                | T::Machine
                | T::Container
                | T::Use
                | T::Interpreter
                | T::Queue
                | T::Link
                | T::Frame => return,
                T::BraceOpen => depth += 1,
                T::BraceClose => depth -= 1,
                T::Identifier => {
                    if let Some(names) = &mut names {
                        names.push(Name(self.here()));
                    }
                }
                _ => {}
            }
            self.bump();
            if depth == 0 {
                return;
            }
        }
    }

    /// Whether a name stands here that is more than a wrong first word of something known.
    fn at_unknown_statement(&self) -> bool {
        let is_known = match self.next.kind {
            T::Text | T::Integer | T::Slot => self.body == Body::File,
            T::Identifier => {
                let behind = self.lexer_behind_next().next_token().kind;
                self.body == Body::Container && matches!(behind, T::Arrow | T::Dot)
            }
            _ => false,
        };
        self.at(T::Identifier) && !is_known
    }

    /// Skips something that starts no declaration of this body, at least one token of it.
    fn skip_item(&mut self, names: &mut Vec<Name>) {
        if !self.at(T::BraceOpen) && !self.token.kind.is_reserved() && !self.at_unknown_statement()
        {
            // A word or sign too many, or instead of the first one: what follows is taken as it is.
            self.stays_lost = !self.at(T::Semicolon);
            self.bump();
            return self.report_nothing_here();
        }
        let before = self.token.start;
        self.skip_statement(Some(names));
        if self.token.start == before && !self.at(T::EndOfFile) {
            self.bump();
        }
    }

    /// The end of a statement.
    fn end_statement(&mut self, expected: &str) {
        let is_reported = self.reported_at == Some(self.token.start);
        if self.eat(T::Semicolon) {
            if is_reported {
                // Perhaps the `;` was the mistake, and the rest of the statement follows.
                self.report_nothing_here();
            }
            return;
        }
        let was_lost = self.is_lost;
        self.missing_semicolon(expected);
        if self.at_start_of_item() || matches!(self.token.kind, T::BraceClose | T::EndOfFile) {
            // Nothing but the `;` is missing.
            self.is_lost = was_lost;
        }
        self.skip_statement(None);
    }

    /// The start of a body. Without a brace there can still be a body, if something follows that
    /// belongs into one.
    fn open_body(&mut self) -> bool {
        if self.is_in_body(self.token.kind) && self.at_start_of_item() {
            let insert = Edit::replace(self.behind_last(), " {");
            self.lost("`{`", Cure::say("a `{` is missing before it").edit(insert));
        }
        if self.expect(T::BraceOpen, "`{`") {
            {
                self.is_lost = false;
                return true;
            }
        }
        loop {
            match self.token.kind {
                T::BraceOpen => {
                    self.bump();
                    {
                        self.is_lost = false;
                        return true;
                    }
                }
                T::Semicolon => {
                    self.bump();
                    return false;
                }
                T::BraceClose if self.next_is_in_body() => {
                    // The wrong brace.
                    self.bump();
                    self.is_lost = false;
                    return true;
                }
                T::EndOfFile | T::BraceClose => return false,
                T::Use
                | T::Interpreter
                | T::Queue
                | T::Link
                | T::Frame
                | T::Container
                | T::Machine => return false,
                _ if self.at_start_of_item() => return true,
                _ => self.bump(),
            }
        }
    }

    /// Whether what comes next stands in the body that is to be opened, and not behind it.
    fn next_is_in_body(&self) -> bool {
        self.is_in_body(self.next.kind)
    }

    /// Whether a token can start something in the body that is to be opened.
    fn is_in_body(&self, kind: T) -> bool {
        match self.body {
            Body::File => false,
            Body::Task => matches!(kind, T::In | T::Out | T::InOut | T::Param),
            Body::Container => matches!(
                kind,
                T::Event | T::In | T::Out | T::InOut | T::Region | T::Path
            ),
            Body::Region => matches!(
                kind,
                T::State | T::Task | T::Super | T::Initial | T::Identifier
            ),
        }
    }

    /// A word where only a declaration can start: the word that is meant, if it is nearly one of
    /// those that are possible. The mistake is then reported.
    fn misspelt(&mut self, possible: &[(&'static str, T)]) -> Option<T> {
        let follows = matches!(
            self.next.kind,
            T::Identifier | T::Integer | T::Text | T::Slot | T::Flag | T::Data | T::Event
        );
        if !self.at(T::Identifier) || !follows {
            return None;
        }
        let words: Vec<&str> = possible.iter().map(|&(word, _)| word).collect();
        let text = self.text_of(self.token);
        let meant = meant(text, &words).or_else(|| other_word(text, &words))?;
        let kind = possible.iter().find(|&&(word, _)| word == meant)?.1;
        self.mended("a declaration", Cure::meant(self.here(), meant));
        Some(kind)
    }
}

/// Of an attribute that is given twice the first counts.
fn set_if_absent<V>(attribute: &mut Given<V>, read: Given<V>) {
    if !attribute.is_given() {
        *attribute = read;
    }
}
