//! From tokens to a [`tree`](super::tree), whatever the tokens are.
//!
//! The parser is one function a production, in the order of the grammar. Two rules keep one mistake from costing more than one
//! message, and from costing names that can still be read:
//!
//! - **A mistake is reported where it is found, and not again.** Each production goes on as if what it missed had been there; what
//!   it then misses at the same token is not reported.
//! - **Skipping stops early**: at the `;` or block that ends a statement, before a `}`, and before a word that only starts a
//!   declaration. A word that is nearly such a word is taken for it; a `}` too many or too few closes no more than its own body.
//!
//! Recursion happens in guards alone, and is bounded by [`MAX_GUARD_DEPTH`].

use crate::model::{Direction, ParamType, Span};
use crate::nearest::nearest;

use super::diagnostic::{Code, Diagnostic, Sink};
use super::lexer::{Lexer, Token, TokenKind as T};
use super::tree::{
    Action, Container, DataPort, Endpoint, Event, EventListing, File, Flag, Given, GuardKind,
    GuardTerm, Interpreter, Literal, LiteralKind, Name, Number, Param, Path, PathEnd, Queue, Rate,
    Region, Slot, State, StateKind, SystemFlag, Task, Transition, Trigger, Use,
};

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
    /// Start of the token at which something was reported last.
    reported_at: Option<u32>,
    body: Body,
    /// Whether something in this statement was not as expected, so that what follows in it may mean anything.
    is_lost: bool,
    /// Whether that goes on into the next statement.
    stays_lost: bool,
    /// Whether a comment that is never closed hides the rest of the file.
    is_cut: bool,
    sink: &'s mut Sink,
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
            reported_at: None,
            body: Body::File,
            is_lost: false,
            stays_lost: false,
            is_cut: false,
            sink,
        };
        parser.bump();
        parser.bump();
        parser.last_end = 0;
        parser
    }

    // ─── Tokens ───────────────────────────────────────────────────────────────────────────────────────────────────

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

    // ─── Reports ──────────────────────────────────────────────────────────────────────────────────────────────────

    /// Reports something at the current token, unless something has been reported there or the statement is lost already.
    fn report(&mut self, diagnostic: Diagnostic) {
        if self.reported_at != Some(self.token.start) && !self.is_lost {
            self.reported_at = Some(self.token.start);
            self.sink.push(diagnostic);
        }
    }

    /// Keeps from reporting what is missing at the current token: it is hidden in what was reported before it.
    fn report_nothing_here(&mut self) {
        self.reported_at = Some(self.token.start);
    }

    /// Reports that something else was expected here.
    fn expected(&mut self, what: &str) {
        let hint = match (self.token.kind, self.text_of(self.token)) {
            (T::Unknown, "&&" | "&") => Some("write `and`"),
            (T::Unknown, "||" | "|") => Some("write `or`"),
            (T::Unknown, "!") => Some("write `not`"),
            (T::Unknown, _) => Some("no word or sign of the language starts like this: remove it"),
            (T::UnclosedText, _) => Some("a text ends with `\"` on the same line"),
            (T::EndOfFile, _) => Some("the file stops in the middle of a declaration"),
            _ => None,
        };
        self.expected_with(what, hint.map(str::to_owned));
    }

    fn expected_with(&mut self, what: &str, hint: Option<String>) {
        self.corrected(what, hint);
        self.is_lost = true;
    }

    /// Reports that something else was expected here, where it is clear what is meant: the statement goes on.
    fn corrected(&mut self, what: &str, hint: Option<String>) {
        let mut diagnostic = Diagnostic::new(
            Code::E001,
            self.here(),
            format!("expected {what}, found {}", self.found()),
        );
        diagnostic.hint = hint;
        self.report(diagnostic);
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
        let diagnostic = Diagnostic::new(Code::E003, self.here(), format!("{what} is given twice"))
            .hint("remove one of the two");
        self.report(diagnostic);
    }

    // ─── Skipping ─────────────────────────────────────────────────────────────────────────────────────────────────

    /// Whether the current token can only be the start of a declaration or transition.
    fn at_start_of_item(&self) -> bool {
        match self.token.kind {
            T::Use | T::Interpreter | T::Queue | T::Task | T::Container | T::Machine => true,
            T::Event | T::In | T::Out | T::InOut | T::Param | T::Region | T::Path => true,
            T::State | T::Super | T::Initial => true,
            T::Slot => self.body == Body::File,
            T::Identifier => self.body == Body::Region && self.next.kind == T::Arrow,
            _ => false,
        }
    }

    /// Skips the rest of a statement: to the `;` or block that ends it, or before what cannot belong to it.
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
                T::EndOfFile | T::Machine | T::Container | T::Use | T::Interpreter | T::Queue => {
                    return;
                }
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
        self.expected(expected);
        if self.at_start_of_item() || matches!(self.token.kind, T::BraceClose | T::EndOfFile) {
            // Nothing but the `;` is missing.
            self.is_lost = was_lost;
        }
        self.skip_statement(None);
    }

    /// The start of a body. Without a brace there can still be a body, if something follows that belongs into one.
    fn open_body(&mut self) -> bool {
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
                T::EndOfFile | T::BraceClose => return false,
                T::Use | T::Interpreter | T::Queue | T::Container | T::Machine => return false,
                _ if self.at_start_of_item() => return true,
                _ => self.bump(),
            }
        }
    }

    /// A word where only a declaration can start: the word that is meant, if it is nearly one of those that are possible. The
    /// mistake is then reported.
    fn misspelt(&mut self, possible: &[(&'static str, T)]) -> Option<T> {
        let follows = matches!(
            self.next.kind,
            T::Identifier | T::Integer | T::Text | T::Slot | T::Flag | T::Data | T::Event
        );
        if !self.at(T::Identifier) || !follows {
            return None;
        }
        let meant = nearest(
            self.text_of(self.token),
            possible.iter().map(|&(word, _)| word),
        )?;
        let kind = possible.iter().find(|&&(word, _)| word == meant)?.1;
        self.corrected("a declaration", Some(format!("did you mean `{meant}`?")));
        Some(kind)
    }

    // ─── Names, words, numbers ────────────────────────────────────────────────────────────────────────────────────

    /// A name that must be there.
    fn name(&mut self, what: &str) -> Option<Name> {
        let span = self.here();
        match self.token.kind {
            T::Identifier => {
                self.bump();
                Some(Name(span))
            }
            T::ForeignWord => {
                self.corrected(
                    what,
                    Some("names are made of the letters A to Z and a to z, digits and `_`".into()),
                );
                self.bump();
                Some(Name(span))
            }
            kind if kind.is_reserved() => {
                let for_later = if kind == T::KeptForLater {
                    "it is kept for later versions of the language"
                } else {
                    "a reserved word is no name"
                };
                let hint = Some(format!("{for_later}: choose another"));
                // It was meant as a name where something follows that follows a name.
                let starts_a_block = kind == T::With && self.next.kind == T::BraceOpen;
                if matches!(
                    self.next.kind,
                    T::Semicolon
                        | T::Comma
                        | T::Colon
                        | T::BraceOpen
                        | T::Arrow
                        | T::Dot
                        | T::Equals
                ) && !starts_a_block
                {
                    self.corrected(what, hint);
                    self.bump();
                } else {
                    self.expected_with(what, hint);
                }
                None
            }
            _ => {
                self.expected(what);
                None
            }
        }
    }

    fn at_word(&self, word: &str) -> bool {
        self.at(T::Identifier) && self.text_of(self.token) == word
    }

    /// One of some words that are not reserved. A word that is nearly one of them is taken for it and reported.
    fn word(&mut self, possible: &[&'static str]) -> Option<&'static str> {
        if !self.at(T::Identifier) {
            return None;
        }
        let text = self.text_of(self.token);
        let exact = possible.iter().find(|&&word| word == text).copied();
        let word = match exact {
            Some(word) => word,
            None => {
                let word = nearest(text, possible.iter().copied())?;
                let hint = format!("did you mean `{word}`?");
                self.corrected(&one_of(possible), Some(hint));
                word
            }
        };
        self.bump();
        Some(word)
    }

    /// A whole number from `least` to `greatest`.
    fn integer(&mut self, what: &str, least: u32, greatest: u32) -> Option<Number> {
        let token = self.integer_token(what)?;
        let span = self.span_of(token);
        let value = self
            .text_of(token)
            .parse::<u32>()
            .ok()
            .filter(|value| (least..=greatest).contains(value));
        if value.is_none() {
            self.out_of_range(token, what, &least.to_string(), &greatest.to_string());
        }
        Some(Number {
            value: value?,
            span,
        })
    }

    /// The digits of a whole number; what else is written as a number is reported and skipped.
    fn integer_token(&mut self, what: &str) -> Option<Token> {
        let token = self.token;
        match token.kind {
            T::Integer => {
                self.bump();
                Some(token)
            }
            T::Float => {
                self.corrected(what, Some("write a whole number".into()));
                self.bump();
                None
            }
            T::Minus if matches!(self.next.kind, T::Integer | T::Float) => {
                self.corrected(what, Some("it cannot be negative".into()));
                self.bump();
                self.bump();
                None
            }
            _ => {
                self.expected(what);
                None
            }
        }
    }

    fn out_of_range(&mut self, token: Token, what: &str, least: &str, greatest: &str) {
        let digits = excerpt(self.text_of(token));
        self.sink.push(
            Diagnostic::new(
                Code::E001,
                self.span_of(token),
                format!("{digits} is out of range: expected {what}"),
            )
            .hint(format!("write a number from {least} to {greatest}")),
        );
    }

    /// A time in microseconds, at least `least_us`.
    fn time(&mut self, least_us: u32) -> Option<u32> {
        let number = self.token;
        let digits = match number.kind {
            T::Float => {
                self.corrected(
                    "a time",
                    Some("write a whole number in a smaller unit, such as `1500 ms`".into()),
                );
                self.bump();
                None
            }
            _ => self.integer_token("a time such as `10 ms`"),
        };
        if digits.is_none() && self.last_end != number.end && !self.at(T::Identifier) {
            // Neither a number nor a unit.
            return None;
        }
        let unit_us = self.unit_us()?;
        let value_us = self
            .text_of(digits?)
            .parse::<u64>()
            .ok()
            .and_then(|value| value.checked_mul(unit_us))
            .and_then(|value_us| u32::try_from(value_us).ok())
            .filter(|value_us| (least_us..=MAX_TIME_US).contains(value_us));
        if value_us.is_none() {
            let what = if least_us > 0 {
                "a time above 0"
            } else {
                "a time"
            };
            self.sink.push(
                Diagnostic::new(
                    Code::E001,
                    self.span_of(number),
                    format!(
                        "{} is out of range: expected {what}",
                        excerpt(self.text_of(number))
                    ),
                )
                .hint("the longest time is 4000 s"),
            );
        }
        value_us
    }

    /// The unit of a time, as microseconds.
    fn unit_us(&mut self) -> Option<u64> {
        const UNITS: [(&str, u64); 3] = [("us", 1), ("ms", 1_000), ("s", 1_000_000)];
        let text = self.text_of(self.token);
        if let Some((_, unit_us)) = UNITS.iter().find(|(unit, _)| self.at_word(unit)) {
            self.bump();
            return Some(*unit_us);
        }
        let hint = Some("write `us`, `ms` or `s` behind the number".into());
        if matches!(self.token.kind, T::Identifier | T::Semicolon) {
            self.corrected("a unit of time", hint);
        } else {
            self.expected_with("a unit of time", hint);
        }
        let starts_an_attribute = ["period", "rate", "duration", "wcet", "exclusive"];
        if self.at(T::Identifier) && !starts_an_attribute.contains(&text) {
            self.bump();
        }
        None
    }

    fn literal(&mut self) -> Option<Literal> {
        let start = self.here();
        let negative = self.eat(T::Minus);
        let digits = self.here();
        let kind = match self.token.kind {
            T::Integer => LiteralKind::Integer,
            T::Float => LiteralKind::Float,
            T::True if !negative => LiteralKind::Bool(true),
            T::False if !negative => LiteralKind::Bool(false),
            _ => {
                self.expected("a value such as `3`, `-0.5` or `true`");
                return None;
            }
        };
        self.bump();
        if kind == LiteralKind::Integer && self.at(T::Dot) {
            let hint = "digits stand on both sides of the point, as in `0.5`";
            self.corrected("digits behind the point", Some(hint.into()));
            self.bump();
            return None;
        }
        Some(Literal {
            kind,
            negative,
            digits,
            span: self.since(start),
        })
    }

    // ─── The file ─────────────────────────────────────────────────────────────────────────────────────────────────

    fn file(&mut self) -> File {
        /// Words that start a declaration of a file.
        const WORDS: [(&str, T); 7] = [
            ("use", T::Use),
            ("interpreter", T::Interpreter),
            ("queue", T::Queue),
            ("slot", T::Slot),
            ("task", T::Task),
            ("container", T::Container),
            ("machine", T::Machine),
        ];
        /// Which body was closed last.
        enum Closed {
            Nothing,
            Task,
            Container,
        }
        let mut file = File::default();
        let mut closed = Closed::Nothing;
        loop {
            self.is_lost = std::mem::take(&mut self.stays_lost);
            self.body = Body::File;
            let kind = self.misspelt(&WORDS).unwrap_or(self.token.kind);
            match kind {
                T::EndOfFile => {
                    file.is_cut = self.is_cut;
                    return file;
                }
                T::Use => {
                    let start = self.here();
                    self.bump();
                    file.uses.push(self.use_file(start));
                }
                // A path or number whose word is missing: nothing else starts with one.
                T::Text => {
                    self.corrected("`use`", None);
                    file.uses.push(self.use_file(self.here()));
                }
                T::Integer => {
                    self.corrected("`slot`", None);
                    file.slots.push(self.slot(self.here()));
                }
                T::Slot if file.interpreters.is_empty() && self.at_number_of_interpreter() => {
                    let hint = "did you mean `interpreter slot`?";
                    self.corrected("`interpreter`", Some(hint.into()));
                    file.interpreters.push(self.interpreter(self.here()));
                }
                T::Interpreter => {
                    let start = self.here();
                    self.bump();
                    file.interpreters.push(self.interpreter(start));
                }
                T::Queue => file.queues.push(self.queue()),
                T::Slot => {
                    let start = self.here();
                    self.bump();
                    file.slots.push(self.slot(start));
                }
                T::Identifier if self.at_task_header() => {
                    self.corrected("`task`", None);
                    file.tasks.push(self.task(self.here()));
                    closed = Closed::Task;
                    continue;
                }
                T::Task => {
                    let start = self.here();
                    self.bump();
                    file.tasks.push(self.task(start));
                    closed = Closed::Task;
                    continue;
                }
                T::Container | T::Machine => {
                    file.containers.push(self.container(kind == T::Machine));
                    closed = Closed::Container;
                    continue;
                }
                T::BraceClose => {
                    self.corrected(
                        "a declaration",
                        Some("nothing is open here: remove it".into()),
                    );
                    self.bump();
                    continue;
                }
                T::In
                | T::Out
                | T::InOut
                | T::Param
                | T::Event
                | T::Region
                | T::Path
                | T::State
                | T::Super
                | T::Initial => {
                    self.expected_with(
                        "a declaration of the file",
                        Some("this belongs into a body: is there a `}` too many before it?".into()),
                    );
                    match (&closed, file.tasks.last_mut(), file.containers.last_mut()) {
                        (Closed::Task, Some(task), _)
                            if matches!(kind, T::In | T::Out | T::InOut | T::Param) =>
                        {
                            self.task_body(task);
                        }
                        (Closed::Container, _, Some(container)) if kind != T::Param => {
                            self.container_body(container);
                        }
                        _ => {
                            self.bump();
                            self.skip_item(&mut file.skipped);
                        }
                    }
                    continue;
                }
                _ => {
                    self.expected(
                        "`use`, `interpreter`, `queue`, `slot`, `task`, `container` or `machine`",
                    );
                    self.skip_item(&mut file.skipped);
                }
            }
            closed = Closed::Nothing;
        }
    }

    /// `slot 1;`: a slot that the word `interpreter` is missing of.
    fn at_number_of_interpreter(&self) -> bool {
        let mut behind = self.lexer_behind_next();
        self.next.kind == T::Integer && behind.next_token().kind == T::Semicolon
    }

    /// `"path";`
    fn use_file(&mut self, start: Span) -> Use {
        let token = self.token;
        let path = match token.kind {
            T::Text => {
                self.bump();
                Some(Span {
                    file: self.file,
                    start: token.start + 1,
                    end: token.end - 1,
                })
            }
            T::UnclosedText => {
                self.expected("a path such as `\"tasks.esm\"`");
                self.bump();
                // The rest of the line is in the text.
                self.report_nothing_here();
                self.eat(T::Semicolon);
                return Use {
                    span: self.since(start),
                    path: None,
                };
            }
            _ => {
                self.expected("a path such as `\"tasks.esm\"`");
                None
            }
        };
        self.end_statement("`;`");
        Use {
            span: self.since(start),
            path,
        }
    }

    /// `slot 1;`
    fn interpreter(&mut self, start: Span) -> Interpreter {
        self.expect(T::Slot, "`slot`");
        let slot = self.integer("the number of a slot", 1, u32::MAX);
        self.end_statement("`;`");
        Interpreter {
            span: self.since(start),
            slot,
        }
    }

    fn queue(&mut self) -> Queue {
        let start = self.here();
        self.bump();
        let capacity = self
            .integer("the capacity of the event queue", 1, u32::from(u8::MAX))
            .and_then(|number| u8::try_from(number.value).ok());
        self.end_statement("`;`");
        Queue {
            span: self.since(start),
            capacity,
        }
    }

    /// `1 period 10 ms duration 1 ms;`
    fn slot(&mut self, start: Span) -> Slot {
        let number = self.integer("the number of a slot", 1, u32::MAX);
        let mut rate = Given::Absent;
        let mut rate_word = "";
        let mut duration_us = Given::Absent;
        loop {
            if self.at_word("duration") && !rate.is_given() {
                self.expected("`period` or `rate`");
            }
            let at = self.token;
            let Some(word) = self.word(&["period", "rate", "duration"]) else {
                break;
            };
            // What is wrong with the word is reported where it stands.
            let is_second = if word == "duration" {
                duration_us.is_given()
            } else {
                rate.is_given()
            };
            if is_second {
                let span = self.span_of(at);
                self.sink.push(if word == "duration" || word == rate_word {
                    Diagnostic::new(Code::E003, span, format!("`{word}` is given twice"))
                        .hint("remove one of the two")
                } else {
                    Diagnostic::new(
                        Code::E001,
                        span,
                        format!("expected `duration`, found `{word}`"),
                    )
                    .hint("a slot has either a period or a rate")
                });
            }
            match word {
                "period" => {
                    let read = Given::from_read(self.time(1).map(Rate::PeriodUs));
                    set_if_absent(&mut rate, read);
                    rate_word = word;
                }
                "rate" => {
                    let hertz = self.integer("a rate in Hz", 1, u32::MAX);
                    if self.word(&["Hz"]).is_none() {
                        self.expected("`Hz`");
                    }
                    let read = Given::from_read(hertz.map(|number| Rate::Hertz(number.value)));
                    set_if_absent(&mut rate, read);
                    rate_word = word;
                }
                _ => {
                    let read = Given::from_read(self.time(0));
                    set_if_absent(&mut duration_us, read);
                }
            }
        }
        if !rate.is_given() {
            self.expected("`period` or `rate`");
        } else if !duration_us.is_given() {
            self.expected("`duration`");
        }
        self.end_statement("`;`");
        Slot {
            span: self.since(start),
            number,
            rate: rate.value(),
            duration_us: duration_us.value(),
        }
    }

    // ─── Tasks ────────────────────────────────────────────────────────────────────────────────────────────────────

    /// Whether a name is followed by an attribute of a task.
    fn at_task_header(&self) -> bool {
        match self.next.kind {
            T::Slot => {
                let mut behind = self.lexer_behind_next();
                behind.next_token().kind == T::Integer && behind.next_token().kind != T::Semicolon
            }
            T::Identifier => ["wcet", "exclusive"].contains(&self.text_of(self.next)),
            _ => false,
        }
    }

    /// A task, from its name on.
    fn task(&mut self, start: Span) -> Task {
        let name = self.name("the name of the task");
        let mut task = Task {
            span: start,
            name,
            slot: Given::Absent,
            wcet_us: Given::Absent,
            exclusive: Given::Absent,
            data: Vec::new(),
            flags: Vec::new(),
            params: Vec::new(),
            skipped: Vec::new(),
            is_cut: false,
        };
        loop {
            if self.at(T::Slot) {
                self.slot_attribute(&mut task.slot);
            } else if self.at_word("wcet") {
                if task.wcet_us.is_given() {
                    self.attribute_twice("`wcet`");
                }
                self.bump();
                let read = Given::from_read(self.time(0));
                set_if_absent(&mut task.wcet_us, read);
            } else if self.at_word("exclusive") {
                if task.exclusive.is_given() {
                    self.attribute_twice("`exclusive`");
                }
                self.bump();
                let read = Given::from_read(self.name("the name of an exclusive group"));
                set_if_absent(&mut task.exclusive, read);
            } else if self.at(T::Identifier) {
                // Nearly an attribute: its value must not be taken for anything else.
                if let Some(word) = nearest(self.text_of(self.token), ["wcet", "exclusive", "slot"])
                {
                    let hint = format!("did you mean `{word}`?");
                    self.corrected("`slot`, `wcet`, `exclusive` or `{`", Some(hint));
                    self.bump();
                    match word {
                        "wcet" => task.wcet_us = Given::from_read(self.time(0)),
                        "exclusive" => task.exclusive = Given::from_read(self.name("a group")),
                        _ => {
                            let number = self.integer("the number of a slot", 0, u32::MAX);
                            task.slot = Given::from_read(number);
                        }
                    }
                } else {
                    break;
                }
            } else {
                break;
            }
        }
        task.span = self.since(start);
        if !self.at(T::BraceOpen) {
            self.expected("`slot`, `wcet`, `exclusive` or `{`");
        }
        if self.is_lost {
            set_if_absent(&mut task.slot, Given::Broken);
        }
        self.body = Body::Task;
        if self.open_body() {
            self.task_body(&mut task);
        }
        task
    }

    /// `slot 2`, of a task or task state.
    fn slot_attribute(&mut self, slot: &mut Given<Number>) {
        if slot.is_given() {
            self.attribute_twice("`slot`");
        }
        self.bump();
        let read = Given::from_read(self.integer("the number of a slot, or 0", 0, u32::MAX));
        set_if_absent(slot, read);
    }

    fn task_body(&mut self, task: &mut Task) {
        const WORDS: [(&str, T); 4] = [
            ("in", T::In),
            ("out", T::Out),
            ("inout", T::InOut),
            ("param", T::Param),
        ];
        loop {
            self.is_lost = std::mem::take(&mut self.stays_lost);
            self.body = Body::Task;
            let kind = self.misspelt(&WORDS).unwrap_or(self.token.kind);
            match kind {
                T::BraceClose => return self.bump(),
                T::In | T::Out | T::InOut => {
                    let start = self.here();
                    self.bump();
                    match self.token.kind {
                        T::Flag => task.flags.push(self.flag(start, kind)),
                        T::Data => task.data.push(self.data_port(start, kind)),
                        _ => {
                            self.expected("`data` or `flag`");
                            self.skip_item(&mut task.skipped);
                        }
                    }
                }
                T::Param => task.params.push(self.param()),
                T::Data | T::Flag => {
                    self.expected_with(
                        "`in`, `out` or `inout`",
                        Some("say the direction first".into()),
                    );
                    self.bump();
                    self.skip_item(&mut task.skipped);
                }
                T::EndOfFile
                | T::Use
                | T::Interpreter
                | T::Queue
                | T::Slot
                | T::Task
                | T::Container
                | T::Machine => {
                    task.is_cut = self.is_cut;
                    return self.missing_close("`in`, `out`, `inout`, `param` or `}`");
                }
                _ => {
                    self.expected("`in`, `out`, `inout`, `param` or `}`");
                    self.skip_foreign_item(&mut task.skipped);
                }
            }
        }
    }

    /// Something that belongs into another body starts here: the `}` of this one is missing.
    fn missing_close(&mut self, expected: &str) {
        let hint = match self.token.kind {
            T::EndOfFile => "a `}` is missing before the end of the file",
            _ => "is a `}` missing before it?",
        };
        self.expected_with(expected, Some(hint.into()));
    }

    /// Skips something that starts here but belongs elsewhere.
    fn skip_foreign_item(&mut self, names: &mut Vec<Name>) {
        if self.at_start_of_item() {
            self.bump();
        }
        self.skip_item(names);
    }

    /// A flag, behind its direction.
    fn flag(&mut self, start: Span, direction: T) -> Flag {
        if direction == T::InOut {
            let diagnostic = Diagnostic::new(
                Code::E001,
                start,
                "expected `in` or `out` before `flag`, found the reserved word `inout`",
            )
            .hint("a flag is written from one side only: `in flag` or `out flag`");
            self.sink.push(diagnostic);
        }
        self.bump();
        let name = self.name("the name of the flag");
        self.end_statement("`;`");
        Flag {
            span: self.since(start),
            direction: match direction {
                T::In => Some(Direction::In),
                T::Out => Some(Direction::Out),
                _ => None,
            },
            name,
        }
    }

    /// A data port, behind its direction.
    fn data_port(&mut self, start: Span, direction: T) -> DataPort {
        self.bump();
        let name = self.name("the name of the port");
        let type_name = if self.eat(T::Colon) {
            self.name("the name of a type")
        } else if self.at(T::Identifier) && self.next.kind == T::Semicolon {
            self.corrected("`:` and a type", None);
            self.name("the name of a type")
        } else {
            self.expected("`:` and a type");
            None
        };
        let mut optional = false;
        while self.at_word("optional") {
            if optional {
                self.attribute_twice("`optional`");
            }
            optional = true;
            self.bump();
        }
        self.end_statement("`optional` or `;`");
        DataPort {
            span: self.since(start),
            direction: match direction {
                T::In => Direction::In,
                T::Out => Direction::Out,
                _ => Direction::InOut,
            },
            name,
            type_name,
            optional,
        }
    }

    fn param(&mut self) -> Param {
        const TYPES: [&str; 4] = ["bool", "i32", "u32", "f32"];
        let start = self.here();
        self.bump();
        let name = self.name("the name of the parameter");
        if !self.eat(T::Colon) {
            if self.at(T::Identifier) && TYPES.contains(&self.text_of(self.token)) {
                self.corrected("`:` and a type", None);
            } else {
                self.expected("`:` and a type");
            }
        }
        let param_type = match self.word(&TYPES) {
            Some("bool") => Some(ParamType::Bool),
            Some("i32") => Some(ParamType::I32),
            Some("u32") => Some(ParamType::U32),
            Some(_) => Some(ParamType::F32),
            None => {
                self.expected("`bool`, `i32`, `u32` or `f32`");
                if self.at(T::Identifier) {
                    self.bump();
                }
                None
            }
        };
        let mut param = Param {
            span: start,
            name,
            param_type,
            default: Given::Absent,
            range: Given::Absent,
        };
        if self.eat(T::Equals) {
            param.default = Given::from_read(self.literal());
        }
        if self.at(T::Identifier) && self.word(&["min"]).is_some() {
            let least = self.literal();
            let has_max = self.word(&["max"]).is_some();
            if !has_max {
                self.expected("`max` and a value");
            }
            let greatest = if has_max { self.literal() } else { None };
            param.range = Given::from_read(least.zip(greatest));
        }
        self.end_statement("`=`, `min` or `;`");
        if self.is_lost {
            set_if_absent(&mut param.default, Given::Broken);
        }
        param.span = self.since(start);
        param
    }

    // ─── Containers and machines ──────────────────────────────────────────────────────────────────────────────────

    fn container(&mut self, is_machine: bool) -> Container {
        let start = self.here();
        self.bump();
        let name = self.name(if is_machine {
            "the name of the machine"
        } else {
            "the name of the container"
        });
        let mut container = Container {
            is_machine,
            span: self.since(start),
            name,
            events: Vec::new(),
            flags: Vec::new(),
            data: Vec::new(),
            regions: Vec::new(),
            paths: Vec::new(),
            skipped: Vec::new(),
            is_cut: false,
        };
        self.body = Body::Container;
        if self.open_body() {
            self.container_body(&mut container);
        }
        container
    }

    fn container_body(&mut self, container: &mut Container) {
        const WORDS: [(&str, T); 6] = [
            ("event", T::Event),
            ("in", T::In),
            ("out", T::Out),
            ("inout", T::InOut),
            ("region", T::Region),
            ("path", T::Path),
        ];
        let expected = if container.is_machine {
            "`event`, `region`, `path` or `}`"
        } else {
            "`event`, `in`, `out`, `inout`, `region`, `path` or `}`"
        };
        loop {
            self.is_lost = std::mem::take(&mut self.stays_lost);
            self.body = Body::Container;
            let kind = self.misspelt(&WORDS).unwrap_or(self.token.kind);
            match kind {
                T::BraceClose => {
                    if !container.is_machine
                        && container.regions.is_empty()
                        && container.skipped.is_empty()
                    {
                        self.expected_with(
                            "`region`",
                            Some("a container has at least one region".into()),
                        );
                    }
                    return self.bump();
                }
                T::Event => {
                    self.bump();
                    self.event_names(container, EventListing::Local);
                    self.end_statement("`,` or `;`");
                }
                T::In | T::Out | T::InOut => self.container_port(container, kind, expected),
                T::Region => container.regions.push(self.region()),
                T::Path => {
                    let start = self.here();
                    self.bump();
                    container.paths.push(self.path(start));
                }
                T::Task if !self.at_task_state() => return self.missing_close(expected),
                T::EndOfFile
                | T::Use
                | T::Interpreter
                | T::Queue
                | T::Slot
                | T::Container
                | T::Machine => {
                    container.is_cut = self.is_cut;
                    return self.missing_close(expected);
                }
                T::State | T::Super | T::Initial | T::Task => {
                    self.outside_of_region(container, expected);
                }
                T::Identifier if self.at_path() => {
                    let start = self.here();
                    self.corrected(expected, Some("a data path starts with `path`".into()));
                    container.paths.push(self.path(start));
                }
                T::Identifier if self.next.kind == T::Arrow => {
                    self.outside_of_region(container, expected);
                }
                _ => {
                    self.expected(expected);
                    self.skip_foreign_item(&mut container.skipped);
                }
            }
        }
    }

    /// A state or transition between the regions: it is taken for one of the region before, so that its names are known.
    fn outside_of_region(&mut self, container: &mut Container, expected: &str) {
        self.corrected(
            expected,
            Some(
                "states and transitions stand in a `region`: is there a `}` too many before it?"
                    .into(),
            ),
        );
        match container.regions.last_mut() {
            Some(region) => self.region_body(region),
            None => self.skip_foreign_item(&mut container.skipped),
        }
    }

    /// Whether `task` starts a task state (`task A: …`), not the declaration of a task.
    fn at_task_state(&self) -> bool {
        let mut behind = self.lexer_behind_next();
        self.next.kind == T::Identifier && behind.next_token().kind == T::Colon
    }

    /// Whether a data path starts here without its word: `A.x …`, `x -> A.y`, `x -> y, …`.
    fn at_path(&self) -> bool {
        match self.next.kind {
            T::Dot => true,
            T::Arrow => {
                let mut behind = self.lexer_behind_next();
                behind.next_token().kind == T::Identifier
                    && matches!(behind.next_token().kind, T::Dot | T::Comma)
            }
            _ => false,
        }
    }

    /// A lexer that stands behind the two tokens that are read.
    fn lexer_behind_next(&self) -> Lexer<'t> {
        Lexer::new_at(self.text, self.next.end)
    }

    /// A list of event names.
    fn event_names(&mut self, container: &mut Container, listing: EventListing) {
        loop {
            let name = self.name("the name of an event");
            container.events.push(Event { listing, name });
            if self.eat(T::Comma) {
                continue;
            }
            if self.at(T::Unknown) && self.next.kind == T::Identifier {
                self.corrected("`,` or `;`", None);
                self.bump();
            } else if self.at(T::Identifier) {
                self.corrected("`,` or `;`", None);
            } else {
                return;
            }
        }
    }

    /// `in`, `out` or `inout` of a container. A machine has none, but what it lists is known all the same.
    fn container_port(&mut self, container: &mut Container, direction: T, expected: &str) {
        if container.is_machine {
            self.corrected(
                expected,
                Some(
                    "nothing is around a machine that could use its ports, flags or events".into(),
                ),
            );
        }
        let start = self.here();
        self.bump();
        match self.token.kind {
            T::Flag => container.flags.push(self.flag(start, direction)),
            T::Data => container.data.push(self.data_port(start, direction)),
            T::Event => {
                let listing = match direction {
                    T::In => EventListing::In,
                    T::Out => EventListing::Out,
                    _ => {
                        let hint = "write `in event` and `out event`, one below the other";
                        self.corrected("`data`", Some(hint.into()));
                        EventListing::In
                    }
                };
                self.bump();
                let name = self.name("the name of an event");
                container.events.push(Event { listing, name });
                if self.at(T::Comma) {
                    let hint = "each forwarded event has its own line";
                    self.corrected("`;`", Some(hint.into()));
                    self.bump();
                    self.event_names(container, listing);
                }
                self.end_statement("`;`");
            }
            _ => {
                self.expected("`event`, `flag` or `data`");
                self.skip_item(&mut container.skipped);
            }
        }
    }

    // ─── Regions ──────────────────────────────────────────────────────────────────────────────────────────────────

    fn region(&mut self) -> Region {
        let start = self.here();
        self.bump();
        let name = self.name("the name of the region");
        let mut region = Region {
            span: self.since(start),
            name,
            states: Vec::new(),
            transitions: Vec::new(),
            may_have_initial: false,
            skipped: Vec::new(),
            is_cut: false,
        };
        self.body = Body::Region;
        if self.open_body() {
            self.region_body(&mut region);
        } else {
            region.may_have_initial = true;
        }
        region
    }

    fn region_body(&mut self, region: &mut Region) {
        const EXPECTED: &str = "`state`, `task`, `super`, a transition or `}`";
        loop {
            self.is_lost = std::mem::take(&mut self.stays_lost);
            self.body = Body::Region;
            let kind = self.token.kind;
            match kind {
                T::BraceClose => return self.bump(),
                T::State | T::Super => region.states.push(self.state(kind)),
                T::Task if self.at_task_declaration() => return self.missing_close(EXPECTED),
                T::Task => region.states.push(self.state(kind)),
                T::Identifier if matches!(self.next.kind, T::Identifier | T::ForeignWord) => {
                    self.misspelt_in_region(region);
                }
                T::Identifier if !self.at_transition() => self.nameless_item(region),
                T::Initial | T::Identifier | T::ForeignWord => self.transition(region),
                T::Final if self.next.kind == T::Arrow => {
                    self.expected_with(EXPECTED, Some("`final` can only be entered".into()));
                    self.skip_statement(None);
                }
                T::EndOfFile
                | T::Use
                | T::Interpreter
                | T::Queue
                | T::Slot
                | T::Container
                | T::Machine
                | T::Region
                | T::Event
                | T::In
                | T::Out
                | T::InOut
                | T::Path => {
                    region.is_cut = self.is_cut;
                    region.may_have_initial |= self.at(T::EndOfFile);
                    return self.missing_close(EXPECTED);
                }
                _ => {
                    self.expected(EXPECTED);
                    region.may_have_initial = true;
                    self.skip_foreign_item(&mut region.skipped);
                }
            }
        }
    }

    /// Whether a name is followed by an arrow, or by something that may have been meant as one.
    fn at_transition(&self) -> bool {
        matches!(
            self.next.kind,
            T::Arrow | T::Minus | T::Equals | T::Unknown | T::Final | T::Initial
        )
    }

    /// `A: T;`, `A timeout 1 s;`, `A;`: what kind of state this is meant to be cannot be told, but it has a name.
    fn nameless_item(&mut self, region: &mut Region) {
        region.skipped.push(Name(self.here()));
        self.bump();
        self.expected_with(
            "`->`",
            Some("a state starts with `state`, `task` or `super`".into()),
        );
        self.skip_statement(None);
    }

    /// Two names in a row: a transition without its arrow, or a state whose word is misspelt. What was found against expectation is
    /// the second name.
    fn misspelt_in_region(&mut self, region: &mut Region) {
        const WORDS: [(&str, T); 3] = [("state", T::State), ("task", T::Task), ("super", T::Super)];
        let word = self.token;
        let meant = nearest(self.text_of(word), WORDS.map(|(word, _)| word));
        let kind = WORDS.iter().find(|(word, _)| Some(*word) == meant);
        self.bump();
        let hint = meant.map(|meant| {
            let found = excerpt(self.text_of(word));
            format!("did you mean `{meant}` by `{found}`?")
        });
        match kind {
            Some(&(_, kind)) => {
                self.corrected("`->`", hint);
                let state = self.state_behind(kind, self.span_of(word));
                region.states.push(state);
            }
            None => {
                self.expected("`->`");
                // Nobody knows what they are, so nobody may call them unknown.
                region.skipped.push(Name(self.span_of(word)));
                self.skip_item(&mut region.skipped);
            }
        }
    }

    /// Whether `task` starts the declaration of a task (`task T {`, `task T slot …`), not a task state.
    fn at_task_declaration(&self) -> bool {
        let mut behind = self.lexer_behind_next();
        self.next.kind == T::Identifier
            && match behind.next_token().kind {
                T::BraceOpen => true,
                // `task A slot 2 {` against `task A slot 2;`, a state whose `: T` is missing.
                T::Slot => {
                    behind.next_token();
                    behind.next_token().kind == T::BraceOpen
                }
                _ => false,
            }
    }

    /// A state of the kind whose word stands here.
    fn state(&mut self, word: T) -> State {
        let start = self.here();
        self.bump();
        self.state_behind(word, start)
    }

    /// A state, from its name on.
    fn state_behind(&mut self, word: T, start: Span) -> State {
        let name = self.name("the name of the state");
        let mut timeout_us = Given::Absent;
        let mut slot = Given::Absent;
        let mut with = Vec::new();
        let mut has_with = false;
        let mut with_broken = false;

        let type_name = if word == T::State {
            if self.at(T::Colon) {
                let hint = "only `task A: T;` and `super A: C;` name what they are made of";
                self.corrected("`timeout` or `;`", Some(hint.into()));
                self.bump();
                self.name("a name");
                // Whatever was meant, it was no simple state.
                with_broken = true;
            }
            None
        } else {
            let what = if word == T::Task {
                "`:` and the name of a task"
            } else {
                "`:` and the name of a container"
            };
            if self.at(T::Identifier) {
                self.corrected(what, None);
            } else {
                self.expect(T::Colon, what);
            }
            if self.is_lost { None } else { self.name(what) }
        };

        let expected = match word {
            T::Task => "`slot`, `timeout`, `with` or `;`",
            _ => "`timeout` or `;`",
        };
        loop {
            match self.token.kind {
                T::Timeout => {
                    if timeout_us.is_given() {
                        self.attribute_twice("`timeout`");
                    } else if has_with {
                        self.corrected("`;`", Some("`timeout` stands before `with`".into()));
                    }
                    self.bump();
                    let read = Given::from_read(self.time(0));
                    set_if_absent(&mut timeout_us, read);
                }
                T::Slot => {
                    if word != T::Task {
                        self.corrected(expected, Some("only a task state has a slot".into()));
                    } else if has_with && !slot.is_given() {
                        self.corrected("`;`", Some("`slot` stands before `with`".into()));
                    }
                    self.slot_attribute(&mut slot);
                }
                T::With => {
                    if word != T::Task {
                        self.corrected(expected, Some("only a task state has parameters".into()));
                    } else if has_with {
                        self.attribute_twice("`with`");
                    }
                    has_with = true;
                    with_broken |= !self.with(&mut with);
                }
                T::Identifier if nearest(self.text_of(self.token), ["timeout"]).is_some() => {
                    self.corrected(expected, Some("did you mean `timeout`?".into()));
                    self.bump();
                    timeout_us = Given::from_read(self.time(0));
                }
                _ => break,
            }
        }
        self.end_statement(expected);
        if self.is_lost {
            with_broken |= word == T::Task;
            set_if_absent(&mut slot, Given::Broken);
        }
        State {
            span: self.since(start),
            name,
            kind: match word {
                T::Super => StateKind::Super {
                    container: type_name,
                },
                T::State if !with_broken => StateKind::Simple,
                _ => StateKind::Task {
                    task: type_name,
                    slot,
                    with,
                    with_broken,
                },
            },
            timeout_us,
        }
    }

    /// `with { a = 1, b = 2 }`. Gives whether all of it could be read.
    fn with(&mut self, values: &mut Vec<(Name, Option<Literal>)>) -> bool {
        self.bump();
        let mut is_whole = self.expect(T::BraceOpen, "`{`");
        loop {
            let Some(name) = self.name("the name of a parameter") else {
                is_whole = false;
                break;
            };
            let literal = if self.expect(T::Equals, "`=` and a value") {
                self.literal()
            } else {
                None
            };
            is_whole &= literal.is_some();
            values.push((name, literal));
            if !self.eat(T::Comma) {
                break;
            }
        }
        if !self.expect(T::BraceClose, "`,` or `}`") {
            is_whole = false;
            while !matches!(self.token.kind, T::BraceClose | T::Semicolon | T::EndOfFile)
                && !self.at_start_of_item()
            {
                self.bump();
            }
            self.eat(T::BraceClose);
        }
        is_whole
    }

    // ─── Transitions ──────────────────────────────────────────────────────────────────────────────────────────────

    fn transition(&mut self, region: &mut Region) {
        let start = self.here();
        let source = match self.token.kind {
            T::Initial => {
                self.bump();
                Endpoint::Pseudo
            }
            _ => match self.name("a declaration or a transition") {
                Some(name) => Endpoint::State(name),
                None => return self.skip_item(&mut region.skipped),
            },
        };

        if !self.expect(T::Arrow, "`->`") {
            // `A - > B`, `A => B`: the target is behind the broken arrow.
            while matches!(
                self.token.kind,
                T::Minus | T::Equals | T::Unknown | T::Colon | T::Comma | T::Dot
            ) {
                self.bump();
            }
            if matches!(self.token.kind, T::Identifier | T::Final) {
                self.is_lost = false;
            }
        }
        let target = match self.token.kind {
            T::Final => {
                self.bump();
                Some(Endpoint::Pseudo)
            }
            T::Initial => {
                self.corrected(
                    "a state or `final`",
                    Some("`initial` can only be left".into()),
                );
                self.bump();
                None
            }
            _ => self.name("a state or `final`").map(Endpoint::State),
        };

        let mut transition = Transition {
            span: start,
            source,
            target,
            trigger: Given::Absent,
            guard: Given::Absent,
            actions: Vec::new(),
        };
        let mut expected = "`on`, `[`, `/` or `;`";
        let mut has_actions = false;
        loop {
            match self.token.kind {
                T::On => {
                    if transition.trigger.is_given() || transition.guard.is_given() || has_actions {
                        self.corrected(
                            expected,
                            Some("the parts of a transition are `on E [guard] / actions`, in this order".into()),
                        );
                    }
                    let read = Given::from_read(self.trigger());
                    set_if_absent(&mut transition.trigger, read);
                    if !has_actions && !transition.guard.is_given() {
                        expected = "`[`, `/` or `;`";
                    }
                }
                T::BracketOpen => {
                    if transition.guard.is_given() || has_actions {
                        self.corrected(
                            expected,
                            Some("the parts of a transition are `on E [guard] / actions`, in this order".into()),
                        );
                    }
                    let read = Given::from_read(self.bracketed_guard());
                    set_if_absent(&mut transition.guard, read);
                    if !has_actions {
                        expected = "`/` or `;`";
                    }
                }
                T::Slash => {
                    if has_actions {
                        self.corrected(
                            expected,
                            Some("several actions are separated by `,`".into()),
                        );
                    }
                    has_actions = true;
                    self.actions(&mut transition.actions);
                    expected = "`,` or `;`";
                }
                _ => break,
            }
        }
        self.end_statement(expected);
        transition.span = self.since(start);
        region.transitions.push(transition);
    }

    fn trigger(&mut self) -> Option<Trigger> {
        self.bump();
        let span = self.here();
        match self.token.kind {
            T::Pulse => {
                self.bump();
                Some(Trigger::Pulse)
            }
            T::Star => {
                self.bump();
                Some(Trigger::Star(span))
            }
            _ => self.name("`pulse`, `*` or an event").map(Trigger::Event),
        }
    }

    /// `[guard]`
    fn bracketed_guard(&mut self) -> Option<GuardTerm> {
        self.bump();
        let guard = self.guard(0).ok();
        let is_closed = guard.is_some() && self.expect(T::BracketClose, "`and`, `or` or `]`");
        if !is_closed {
            while !matches!(
                self.token.kind,
                T::BracketClose
                    | T::Semicolon
                    | T::BraceOpen
                    | T::BraceClose
                    | T::Slash
                    | T::EndOfFile
            ) && !self.at_start_of_item()
            {
                self.bump();
            }
            if self.eat(T::BracketClose) {
                self.is_lost = false;
            }
            return None;
        }
        guard
    }

    fn guard(&mut self, depth: usize) -> Result<GuardTerm, BrokenGuard> {
        self.terms(T::Or, |parser| {
            parser.terms(T::And, |parser| parser.negation(depth))
        })
    }

    /// One or more terms with the same word between them.
    fn terms(
        &mut self,
        between: T,
        mut term: impl FnMut(&mut Self) -> Result<GuardTerm, BrokenGuard>,
    ) -> Result<GuardTerm, BrokenGuard> {
        let start = self.here();
        let first = term(self)?;
        if !self.at(between) {
            return Ok(first);
        }
        let mut terms = vec![first];
        while self.eat(between) {
            terms.push(term(self)?);
        }
        Ok(GuardTerm {
            span: self.since(start),
            kind: if between == T::And {
                GuardKind::And(terms)
            } else {
                GuardKind::Or(terms)
            },
        })
    }

    fn negation(&mut self, depth: usize) -> Result<GuardTerm, BrokenGuard> {
        let start = self.here();
        let mut negations = 0;
        while self.at(T::Not) {
            self.check_depth(depth + negations)?;
            self.bump();
            negations += 1;
        }
        let mut term = self.atom(depth + negations)?;
        for _ in 0..negations {
            term = GuardTerm {
                span: self.since(start),
                kind: GuardKind::Not(Box::new(term)),
            };
        }
        Ok(term)
    }

    fn check_depth(&mut self, depth: usize) -> Result<(), BrokenGuard> {
        if depth < MAX_GUARD_DEPTH {
            return Ok(());
        }
        let diagnostic = Diagnostic::new(
            Code::E001,
            self.here(),
            format!("this guard is nested more than {MAX_GUARD_DEPTH} deep"),
        )
        .hint("use fewer `(` and `not`");
        self.report(diagnostic);
        Err(BrokenGuard)
    }

    fn atom(&mut self, depth: usize) -> Result<GuardTerm, BrokenGuard> {
        let start = self.here();
        let kind = match self.token.kind {
            T::Exit => GuardKind::System(SystemFlag::Exit),
            T::Timeout => GuardKind::System(SystemFlag::Timeout),
            T::Busy => GuardKind::System(SystemFlag::Busy),
            T::Dot | T::Caret => {
                let is_own = self.at(T::Dot);
                self.bump();
                let name = self.name("the name of a flag").ok_or(BrokenGuard)?;
                return Ok(GuardTerm {
                    span: self.since(start),
                    kind: if is_own {
                        GuardKind::Own(name)
                    } else {
                        GuardKind::Parent(name)
                    },
                });
            }
            T::ParenthesisOpen => {
                self.check_depth(depth)?;
                self.bump();
                let inner = self.guard(depth + 1)?;
                if !self.expect(T::ParenthesisClose, "`and`, `or` or `)`") {
                    return Err(BrokenGuard);
                }
                return Ok(GuardTerm {
                    span: self.since(start),
                    ..inner
                });
            }
            T::Identifier => {
                self.expected_with("a guard", Some(self.how_to_write_a_flag()));
                return Err(BrokenGuard);
            }
            _ => {
                self.expected("a guard: `exit`, `timeout`, `busy`, `.flag` or `^flag`");
                return Err(BrokenGuard);
            }
        };
        self.bump();
        Ok(GuardTerm { span: start, kind })
    }

    /// A flag without its sign.
    fn how_to_write_a_flag(&self) -> String {
        let name = excerpt(self.text_of(self.token));
        format!(
            "write `.{name}` for a flag of the state, `^{name}` for one of the container around it"
        )
    }

    /// `/ action, action`
    fn actions(&mut self, actions: &mut Vec<Action>) {
        self.bump();
        loop {
            match self.token.kind {
                T::Send => {
                    self.bump();
                    if let Some(name) = self.name("the name of an event") {
                        actions.push(Action::Send(name));
                    }
                }
                kind @ (T::Set | T::Clear) => {
                    self.bump();
                    let is_set = kind == T::Set;
                    match self.token.kind {
                        T::Dot | T::Caret => {
                            let is_own = self.at(T::Dot);
                            self.bump();
                            if let Some(name) = self.name("the name of a flag") {
                                actions.push(if is_own {
                                    Action::Own(name, is_set)
                                } else {
                                    Action::Parent(name, is_set)
                                });
                            }
                        }
                        T::Identifier => {
                            self.corrected(
                                "`.` or `^` and a flag",
                                Some(self.how_to_write_a_flag()),
                            );
                            self.bump();
                        }
                        _ => self.expected("`.` or `^` and a flag"),
                    }
                }
                _ => self.expected("`send`, `set` or `clear`"),
            }
            if !self.eat(T::Comma) {
                return;
            }
        }
    }

    // ─── Data paths ───────────────────────────────────────────────────────────────────────────────────────────────

    /// A data path, behind its word.
    fn path(&mut self, start: Span) -> Path {
        let mut path = Path {
            span: start,
            from: Vec::new(),
            to: Vec::new(),
            broken: false,
        };
        let is_read = self.path_ends(&mut path.from)
            && self.expect(T::Arrow, "`.`, `,` or `->`")
            && self.path_ends(&mut path.to);
        self.end_statement("`.`, `,` or `;`");
        path.broken = !is_read || self.is_lost;
        path.span = self.since(start);
        path
    }

    /// Whether an end can be over here. Behind an end that is cut short nobody knows what its names mean.
    fn at_end_of_path_end(&mut self) -> bool {
        let is_over = matches!(self.token.kind, T::Comma | T::Arrow | T::Semicolon)
            || self.at_start_of_item()
            || self.at(T::BraceClose);
        if !is_over {
            self.expected("`.`, `,`, `->` or `;`");
        }
        is_over
    }

    fn path_ends(&mut self, ends: &mut Vec<PathEnd>) -> bool {
        loop {
            match self.path_end() {
                Some(end) => ends.push(end),
                None => return false,
            }
            if !self.eat(T::Comma) {
                return true;
            }
        }
    }

    fn path_end(&mut self) -> Option<PathEnd> {
        let first = self.name("a port, as `port`, `state.port` or `region.state.port`")?;
        if !self.eat(T::Dot) {
            return self
                .at_end_of_path_end()
                .then_some(PathEnd::Container(first));
        }
        let second = self.name("the name of a port or state")?;
        if !self.eat(T::Dot) {
            return self
                .at_end_of_path_end()
                .then_some(PathEnd::State(first, second));
        }
        let third = self.name("the name of a port")?;
        Some(PathEnd::Region(first, second, third))
    }
}

/// Of an attribute that is given twice the first counts.
fn set_if_absent<V>(attribute: &mut Given<V>, read: Given<V>) {
    if !attribute.is_given() {
        *attribute = read;
    }
}

/// The words in a sentence.
fn one_of(words: &[&str]) -> String {
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
pub(super) fn excerpt(text: &str) -> String {
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
