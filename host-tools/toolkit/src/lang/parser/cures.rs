//! What is written by those who know other tools, and what they mean by it: each such mistake says
//! how it is written here, and the change
//! that an editor can make.

use crate::lang::cure::Cure;
use crate::lang::diagnostic::{Code, Diagnostic, Edit, Fix};
use crate::lang::lexer::{Token, TokenKind as T};
use crate::model::Span;

use super::Parser;

impl<'t> Parser<'t, '_> {
    /// Reports that something else was expected here, with what mends it: the statement goes on.
    pub(super) fn mended(&mut self, what: &str, cure: Cure) {
        if self.is_told() {
            return;
        }
        if self.sink.omits_error() {
            return self.report_nothing_here();
        }
        let mut diagnostic = Diagnostic::new(
            Code::E001,
            self.here(),
            format!("expected {what}, found {}", self.found()),
        );
        if let Some(hint) = cure.hint {
            diagnostic = diagnostic.hint(hint);
        }
        diagnostic.fixes = cure.fixes;
        self.report(diagnostic);
    }

    /// The same where it is not clear what the rest of the statement means.
    pub(super) fn lost(&mut self, what: &str, cure: Cure) {
        self.mended(what, cure);
        self.is_lost = true;
    }

    /// The bytes of this file from one place to another.
    pub(super) fn span_between(&self, start: u32, end: u32) -> Span {
        Span {
            file: self.file,
            start,
            end: end.max(start),
        }
    }

    /// The text between two places.
    pub(super) fn between(&self, start: u32, end: u32) -> &'t str {
        self.text.get(start as usize..end as usize).unwrap_or("")
    }

    /// The rest of this line, as far as it is worth looking at.
    pub(super) fn near_text(&self) -> &'t str {
        const MAX_BYTES: usize = 400;
        let rest = self.text.get(self.token.start as usize..).unwrap_or("");
        let mut end = rest.len().min(MAX_BYTES);
        while !rest.is_char_boundary(end) {
            end -= 1;
        }
        let near = rest.get(..end).unwrap_or("");
        near.lines().next().unwrap_or("")
    }

    /// The empty place behind the last token that was read.
    pub(super) fn behind_last(&self) -> Span {
        self.span_between(self.last_end, self.last_end)
    }

    /// The tokens behind the two that are read.
    pub(super) fn ahead<const COUNT: usize>(&self) -> [Token; COUNT] {
        let mut lexer = self.lexer_behind_next();
        std::array::from_fn(|_| lexer.next_token())
    }

    /// Whether this token is the first of its line.
    pub(super) fn at_new_line(&self) -> bool {
        self.between(self.last_end, self.token.start).contains('\n')
    }

    /// Whether a word stands here, in whichever letters.
    pub(super) fn at_any_case(&self, words: &[&str]) -> bool {
        let text = self.text_of(self.token);
        self.at(T::Identifier) && words.iter().any(|word| word.eq_ignore_ascii_case(text))
    }

    /// Reports that the statement has no `;`, and goes on behind it. What starts a line is not to
    /// blame for the one before.
    pub(super) fn missing_semicolon(&mut self, expected: &str) {
        if self.is_told() {
            self.is_lost = true;
            return;
        }
        let starts_statement = self.at_start_of_item()
            || matches!(
                self.token.kind,
                T::BraceClose | T::Identifier | T::ForeignWord
            );
        let is_last = self.at(T::EndOfFile);
        if !(starts_statement || is_last) {
            return self.expected(expected);
        }
        let behind = self.behind_last();
        let fix = Fix::one("write the missing `;`", Edit::replace(behind, ";"));
        if !is_last && self.at_new_line() && !self.sink.omits_error() {
            let message = format!("expected {expected} before {}", self.found());
            let mut diagnostic = Diagnostic::new(Code::E001, behind, message);
            diagnostic = diagnostic.hint("a `;` is missing at the end of this line");
            self.report(diagnostic.fix(fix));
            self.is_lost = true;
            return;
        }
        let certain = is_last || self.at_start_of_item() || self.at(T::BraceClose);
        let mut cure = Cure {
            hint: if is_last {
                Some("the file stops in the middle of a declaration".into())
            } else {
                self.meant_of(expected)
            },
            fixes: Vec::new(),
        };
        if certain {
            cure = cure.fix(fix);
        }
        self.lost(expected, cure);
    }
}
