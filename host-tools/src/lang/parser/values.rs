//! Names, words, numbers: what the statements of the language are made of.

use crate::nearest::nearest;

use crate::lang::diagnostic::{Code, Diagnostic};
use crate::lang::lexer::{MAX_NAME_BYTES, Token, TokenKind as T};
use crate::lang::tree::{Literal, LiteralKind, Name, Number};

use super::{MAX_TIME_US, Parser};

impl Parser<'_, '_> {
    /// A name that must be there.
    pub(super) fn name(&mut self, what: &str) -> Option<Name> {
        let span = self.here();
        match self.token.kind {
            T::Identifier => {
                self.bump();
                Some(Name(span))
            }
            T::ForeignWord if self.text_of(self.token).len() > MAX_NAME_BYTES => {
                let hint = format!("a name has at most {MAX_NAME_BYTES} characters");
                self.no_name(what, &hint);
                None
            }
            T::ForeignWord => {
                let hint = "names are made of the letters A to Z and a to z, digits and `_`";
                self.no_name(what, hint);
                Some(Name(span))
            }
            kind if kind.is_reserved() => {
                let hint = if kind == T::KeptForLater {
                    "it is kept for later versions of the language: choose another"
                } else {
                    "a reserved word is no name: choose another"
                };
                // It was meant as a name where something follows that follows a name.
                let follows_a_name = match self.next.kind {
                    T::Semicolon | T::Comma | T::Colon | T::Arrow | T::Equals => true,
                    // `[.and .near]` lacks a name before `and`.
                    T::Dot => !matches!(kind, T::And | T::Or | T::Not),
                    T::BraceOpen => kind != T::With,
                    _ => false,
                };
                if follows_a_name {
                    self.no_name(what, hint);
                    Some(Name(span))
                } else {
                    self.expected_with(what, Some(hint.into()));
                    None
                }
            }
            _ => {
                self.expected(what);
                None
            }
        }
    }

    /// Eats a word that stands where a name should, and cannot be one. It is reported once: its other uses follow from the first.
    fn no_name(&mut self, what: &str, hint: &str) {
        if self.no_names.insert(self.text_of(self.token)) {
            self.corrected(what, Some(hint.to_owned()));
        }
        self.bump();
    }

    pub(super) fn at_word(&self, word: &str) -> bool {
        self.at(T::Identifier) && self.text_of(self.token) == word
    }

    /// One of some words that are not reserved. A word that is nearly one of them is taken for it and reported.
    pub(super) fn word(&mut self, possible: &[&'static str]) -> Option<&'static str> {
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
    pub(super) fn integer(&mut self, what: &str, least: u32, greatest: u32) -> Option<Number> {
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
    pub(super) fn integer_token(&mut self, what: &str) -> Option<Token> {
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

    pub(super) fn out_of_range(&mut self, token: Token, what: &str, least: &str, greatest: &str) {
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
    pub(super) fn time(&mut self, least_us: u32) -> Option<u32> {
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
    pub(super) fn unit_us(&mut self) -> Option<u64> {
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
        let starts_an_attribute = [
            "period",
            "rate",
            "duration",
            "wcet",
            "exclusive",
            "count",
            "endless",
            "optional",
            "within",
        ];
        if self.at(T::Identifier) && !starts_an_attribute.contains(&text) {
            self.bump();
        }
        None
    }

    pub(super) fn literal(&mut self) -> Option<Literal> {
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
