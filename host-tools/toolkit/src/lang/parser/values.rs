//! Names, words, numbers: what the statements of the language are made of.

use crate::lang::cure::Cure;
use crate::lang::diagnostic::{Code, Diagnostic, Edit, Fix};
use crate::lang::lexer::{Lexer, MAX_NAME_BYTES, Token, TokenKind as T};
use crate::lang::tree::{Literal, LiteralKind, Name, Number};

use super::words::{excerpt, meant, one_of};
use super::{MAX_TIME_US, Parser};

/// Units of time, as microseconds.
const UNITS: [(&str, u64); 3] = [("us", 1), ("ms", 1_000), ("s", 1_000_000)];

/// Other words for units of time, and how many microseconds they are.
const OTHER_UNITS: [(&str, u64); 22] = [
    ("sec", 1_000_000),
    ("secs", 1_000_000),
    ("second", 1_000_000),
    ("seconds", 1_000_000),
    ("msec", 1_000),
    ("msecs", 1_000),
    ("millis", 1_000),
    ("millisecond", 1_000),
    ("milliseconds", 1_000),
    ("usec", 1),
    ("usecs", 1),
    ("micros", 1),
    ("microsecond", 1),
    ("microseconds", 1),
    ("\u{b5}s", 1),
    ("\u{3bc}s", 1),
    ("min", 60_000_000),
    ("mins", 60_000_000),
    ("minute", 60_000_000),
    ("minutes", 60_000_000),
    ("h", 3_600_000_000),
    ("hours", 3_600_000_000),
];

/// What is written behind numbers that have no unit here.
const UNITS_OF_NUMBERS: [&str; 22] = [
    "us", "ms", "s", "sec", "Hz", "kHz", "mm", "cm", "m", "km", "deg", "rad", "mps", "rpm", "V",
    "mV", "A", "mA", "N", "kg", "f", "u",
];

/// A time in the largest unit in which it is a whole number.
pub(in crate::lang) fn written_time(time_us: u64) -> String {
    let (unit, unit_us) = UNITS
        .into_iter()
        .rev()
        .find(|(_, unit_us)| time_us.is_multiple_of(*unit_us))
        .unwrap_or(("us", 1));
    format!("{} {unit}", time_us / unit_us)
}

impl Parser<'_, '_> {
    /// A name that must be there.
    pub(super) fn name(&mut self, what: &str) -> Option<Name> {
        let span = self.here();
        match self.token.kind {
            T::Identifier => {
                self.bump();
                Some(Name(span))
            }
            T::Text => {
                let inside = self.span_between(span.start + 1, span.end.saturating_sub(1));
                let name = self.between(inside.start, inside.end);
                let mut lexer = Lexer::new(name);
                let token = lexer.next_token();
                if token.kind != T::Identifier || token.end as usize != name.len() {
                    self.expected(what);
                    return None;
                }
                let cure = Cure::say("a name stands without quotes");
                self.mended(what, cure.edit(Edit::replace(span, name)));
                self.bump();
                Some(Name(inside))
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

    /// Eats a word that stands where a name should, and cannot be one. It is reported once: its
    /// other uses follow from the first.
    fn no_name(&mut self, what: &str, hint: &str) {
        if self.no_names.insert(self.text_of(self.token)) {
            self.corrected(what, Some(hint.to_owned()));
        }
        self.bump();
    }

    pub(super) fn at_word(&self, word: &str) -> bool {
        self.at(T::Identifier) && self.text_of(self.token) == word
    }

    /// One of some words that are not reserved. A word that is nearly one of them is taken for it
    /// and reported.
    pub(super) fn word(&mut self, possible: &[&'static str]) -> Option<&'static str> {
        if !self.at(T::Identifier) {
            return None;
        }
        let text = self.text_of(self.token);
        let exact = possible.iter().find(|&&word| word == text).copied();
        let word = match exact {
            Some(word) => word,
            None => {
                let word = meant(text, possible)?;
                self.mended(&one_of(possible), Cure::meant(self.here(), word));
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
                let mut cure = Cure::say("write a whole number");
                let text = self.text_of(token);
                if let Some((whole, rest)) = text.split_once('.')
                    && rest.bytes().all(|digit| digit == b'0')
                {
                    cure = cure.fix(Fix::write(self.here(), whole));
                }
                self.mended(what, cure);
                self.bump();
                None
            }
            T::Equals | T::Colon if self.next.kind == T::Integer => {
                self.no_sign(what);
                self.integer_token(what)
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

    /// A sign between a word and its number, where none stands.
    fn no_sign(&mut self, what: &str) {
        let sign = self.span_between(self.last_end, self.token.end);
        let behind = if self.token.end == self.next.start {
            " "
        } else {
            ""
        };
        let cure = Cure::say("no sign stands between a word and its value: remove it");
        self.mended(what, cure.edit(Edit::replace(sign, behind)));
        self.bump();
    }

    /// A unit behind a number that has none. `why` says so.
    pub(super) fn no_unit(&mut self, why: &str) {
        let (unit, mut end) = (self.text_of(self.token), self.token.end);
        let is_word = self.at(T::Identifier) && UNITS_OF_NUMBERS.contains(&unit);
        let is_sign = self.at(T::Unknown) && unit == "%";
        if !is_word && !is_sign || self.at_new_line() {
            return;
        }
        let is_quotient = self.next.kind == T::Slash;
        let [under] = self.ahead();
        if is_quotient && under.kind == T::Identifier {
            end = under.end;
        }
        let unit = self.span_between(self.last_end, end);
        let cure = Cure::say(why).fix(Fix::one("remove the unit", Edit::remove(unit)));
        self.mended("a number without a unit", cure);
        while self.token.end < end {
            self.bump();
        }
        self.bump();
    }

    /// A time in microseconds, at least `least_us`.
    pub(super) fn time(&mut self, least_us: u32) -> Option<u32> {
        if matches!(self.token.kind, T::Equals | T::Colon)
            && matches!(self.next.kind, T::Integer | T::Float)
        {
            self.no_sign("a time");
        }
        let [unit, close] = self.ahead();
        let is_in_parentheses = self.at(T::ParenthesisOpen)
            && self.next.kind == T::Integer
            && unit.kind == T::Identifier
            && close.kind == T::ParenthesisClose;
        if is_in_parentheses {
            let open = self.span_between(self.last_end, self.token.end);
            let edits = vec![Edit::replace(open, " "), Edit::remove(self.span_of(close))];
            let hint = "a time stands without parentheses";
            self.mended("a time", Cure::say(hint).fix(Fix::new(hint, edits)));
            self.bump();
        }
        let time = self.plain_time(least_us);
        if is_in_parentheses {
            self.eat(T::ParenthesisClose);
        }
        time
    }

    /// A number and its unit.
    fn plain_time(&mut self, least_us: u32) -> Option<u32> {
        let number = self.token;
        let digits = match number.kind {
            T::Float => {
                let cure = Cure::say("write a whole number in a smaller unit, such as `1500 ms`");
                let cure = match self.time_of_float() {
                    Some(time) => cure.fix(Fix::write(
                        self.span_between(number.start, self.next.end),
                        time,
                    )),
                    None => cure,
                };
                self.mended("a time", cure);
                self.bump();
                None
            }
            _ => self.integer_token("a time such as `10 ms`"),
        };
        if digits.is_none() && self.last_end != number.end && !self.at(T::Identifier) {
            // Neither a number nor a unit.
            return None;
        }
        let unit_us = self.unit_us(number)?;
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

    /// A time that is no whole number in its unit, in one in which it is.
    fn time_of_float(&self) -> Option<String> {
        let unit = self.text_of(self.next);
        let (_, unit_us) = UNITS.into_iter().find(|(word, _)| *word == unit)?;
        let (whole, part) = self.text_of(self.token).split_once('.')?;
        let scale = 10_u64.checked_pow(u32::try_from(part.len()).ok()?)?;
        let part_us = part.parse::<u64>().ok()?.checked_mul(unit_us)?;
        let whole_us = whole.parse::<u64>().ok()?.checked_mul(unit_us)?;
        let time_us = whole_us.checked_add(part_us / scale)?;
        let is_short = (1..=u64::from(MAX_TIME_US)).contains(&time_us);
        (part_us.is_multiple_of(scale) && is_short).then(|| written_time(time_us))
    }

    /// The unit of a time, as microseconds. `number` stands before it.
    fn unit_us(&mut self, number: Token) -> Option<u64> {
        let text = self.text_of(self.token);
        if let Some((_, unit_us)) = UNITS.iter().find(|(unit, _)| self.at_word(unit)) {
            self.bump();
            return Some(*unit_us);
        }
        let mut cure = Cure::say("write `us`, `ms` or `s` behind the number");
        let is_word = matches!(self.token.kind, T::Identifier | T::ForeignWord);
        let other = OTHER_UNITS
            .iter()
            .chain(&UNITS)
            .find(|(unit, _)| is_word && unit.eq_ignore_ascii_case(text));
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
        let is_attribute = starts_an_attribute.contains(&text);
        if let Some((_, unit_us)) = other {
            let count = self.text_of(number).parse::<u64>().ok();
            let time_us = count.and_then(|count| count.checked_mul(*unit_us));
            if let Some(time_us) = time_us {
                let time = self.span_between(number.start, self.token.end);
                cure = cure.fix(Fix::write(time, written_time(time_us)));
            }
        } else if number.kind == T::Integer && (!is_word || is_attribute || self.at_new_line()) {
            let digits = self.text_of(number);
            let before = self.between(0, number.start).trim_end();
            // Limits of states are seconds more often than not, times of slots are not.
            let is_limit = before.ends_with("timeout");
            for unit in if is_limit { ["s", "ms"] } else { ["ms", "us"] } {
                let title = format!("write `{} {unit}`", excerpt(digits));
                let insert = Edit::behind(self.span_of(number), format!(" {unit}"));
                cure = cure.fix(Fix::one(title, insert));
            }
        }
        if is_word || self.at(T::Semicolon) {
            self.mended("a unit of time", cure);
        } else {
            self.lost("a unit of time", cure);
        }
        if is_word && !is_attribute && !self.at_new_line() {
            self.bump();
        }
        None
    }

    pub(super) fn literal(&mut self) -> Option<Literal> {
        let start = self.here();
        if self.at(T::Unknown) && self.text_of(self.token) == "+" {
            let cure = Cure::say("a positive number has no sign");
            self.mended("a value", cure.edit(Edit::remove(start)));
            self.bump();
        }
        let negative = self.eat(T::Minus);
        let digits = self.here();
        let kind = match self.token.kind {
            T::Integer => LiteralKind::Integer,
            T::Float => LiteralKind::Float,
            T::True if !negative => LiteralKind::Bool(true),
            T::False if !negative => LiteralKind::Bool(false),
            T::Dot if self.next.kind == T::Integer && self.next.start == self.token.end => {
                let hint = "digits stand on both sides of the point, as in `0.5`";
                self.mended("a value", Cure::say(hint).edit(Edit::before(digits, "0")));
                self.bump();
                self.bump();
                return None;
            }
            T::Identifier if !negative => {
                let text = self.text_of(self.token);
                let value = [("true", ["true", "yes"]), ("false", ["false", "no"])]
                    .into_iter()
                    .find(|(_, words)| words.iter().any(|word| word.eq_ignore_ascii_case(text)));
                let Some((word, _)) = value else {
                    self.expected("a value such as `3`, `-0.5` or `true`");
                    return None;
                };
                self.mended("a value", Cure::write(digits, word));
                self.bump();
                return None;
            }
            _ => {
                self.expected("a value such as `3`, `-0.5` or `true`");
                return None;
            }
        };
        self.bump();
        if kind == LiteralKind::Integer && self.at(T::Dot) {
            let hint = "digits stand on both sides of the point, as in `0.5`";
            let mut cure = Cure::say(hint);
            if self.token.start == digits.end {
                cure = cure.edit(Edit::behind(self.here(), "0"));
            }
            self.mended("digits behind the point", cure);
            self.bump();
            return None;
        }
        let literal = Literal {
            kind,
            negative,
            digits,
            span: self.since(start),
        };
        self.no_unit("values of parameters have no unit: the task says in what it counts");
        Some(literal)
    }
}
