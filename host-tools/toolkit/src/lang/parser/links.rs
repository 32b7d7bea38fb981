//! Links, their frames, and the dispatchers of a link.

use crate::model::{Direction, Span};

use crate::lang::cure::Cure;
use crate::lang::diagnostic::{Code, Diagnostic, Edit, Fix};
use crate::lang::lexer::TokenKind as T;
use crate::lang::tree::{Frame, FrameContent, Given, Link, Name, Number, Rate};

use super::{Parser, set_if_absent};

/// The dispatchers of a link.
const DISPATCHERS: [&str; 2] = ["transmit", "receive"];

/// What can follow the rate of a link.
const LINK_ATTRIBUTES: [&str; 3] = ["header", "gap", "bits"];

/// What can follow the content of a frame.
const FRAME_ATTRIBUTES: [&str; 4] = ["payload", "period", "rate", "late"];

impl Parser<'_, '_> {
    /// A link, from its name on.
    pub(super) fn link(&mut self, start: Span) -> Link {
        let mut link = Link {
            docs: self.docs_before(start),
            span: start,
            name: self.name("the name of the link"),
            rate_bps: Given::Absent,
            header_bytes: Given::Absent,
            gap_us: Given::Absent,
            bits: Given::Absent,
        };
        if self.word(&["rate"]).is_some() {
            let number = self.number_with_unit("a rate in bits a second", "bps");
            link.rate_bps = Given::from_read(number);
        } else {
            self.expected("`rate`");
        }
        loop {
            let at = self.here();
            let Some(word) = self.word(&LINK_ATTRIBUTES) else {
                break;
            };
            let is_second = match word {
                "header" => link.header_bytes.is_given(),
                "gap" => link.gap_us.is_given(),
                _ => link.bits.is_given(),
            };
            if is_second {
                self.given_twice(word, at);
            }
            match word {
                "header" => {
                    let number = self.number_with_unit("a number of bytes", "bytes");
                    set_if_absent(&mut link.header_bytes, Given::from_read(number));
                }
                "gap" => {
                    let read = Given::from_read(self.time(0));
                    set_if_absent(&mut link.gap_us, read);
                }
                _ => {
                    let number = self.any_integer("the bits that a byte takes");
                    self.no_unit("bits are counted: their number has no unit");
                    set_if_absent(&mut link.bits, Given::from_read(number));
                }
            }
        }
        self.end_statement("`header`, `gap`, `bits` or `;`");
        link.span = self.since(start);
        link
    }

    /// A frame, from its name on.
    pub(super) fn frame(&mut self, start: Span) -> Frame {
        let mut frame = Frame {
            docs: self.docs_before(start),
            span: start,
            name: self.name("the name of the frame"),
            number: self.any_integer("the identifier of the frame, a number"),
            direction: None,
            link: None,
            content: Given::Absent,
            payload_bytes: Given::Absent,
            rate: Given::Absent,
            late_us: Given::Absent,
            late_word: None,
        };
        self.no_unit("an identifier has no unit");
        frame.direction = match self.token.kind {
            T::In => Some(Direction::In),
            T::Out => Some(Direction::Out),
            _ => None,
        };
        if frame.direction.is_some() {
            self.bump();
        } else {
            self.expected("`in` or `out`");
        }
        if self.expect(T::On, "`on` and the name of a link") {
            frame.link = self.name("the name of a link");
        }
        frame.content = self.content();
        self.attributes_of_frame(&mut frame);
        if !self.is_lost {
            if !frame.payload_bytes.is_given() {
                self.expected("`payload`");
            } else if !frame.rate.is_given() {
                self.expected("`period` or `rate`");
            }
        }
        self.end_statement("`payload`, `period`, `rate`, `late` or `;`");
        frame.span = self.since(start);
        frame
    }

    /// `: Pose` or `flags lost, low`
    fn content(&mut self) -> Given<FrameContent> {
        const EXPECTED: &str = "`:` and a type, or `flags`";
        if self.eat(T::Colon) {
            let name = self.name("the name of a type");
            return Given::from_read(name.map(FrameContent::Value));
        }
        // `flag` is reserved, and no word of a frame.
        if self.at(T::Flag) {
            self.mended(EXPECTED, Cure::write(self.here(), "flags"));
            self.bump();
        } else if self.at(T::Identifier) && FRAME_ATTRIBUTES.contains(&self.text_of(self.token)) {
            self.corrected(EXPECTED, Some("say what the frame carries".into()));
            return Given::Broken;
        } else if self.word(&["flags"]).is_none() {
            self.expected(EXPECTED);
            return Given::Broken;
        }
        let mut flags = Vec::new();
        loop {
            let Some(name) = self.name("the name of a flag") else {
                return Given::Broken;
            };
            flags.push(name);
            if !self.eat(T::Comma) {
                return Given::Value(FrameContent::Flags(flags));
            }
        }
    }

    /// Payload, period or rate, and how old a value may be.
    fn attributes_of_frame(&mut self, frame: &mut Frame) {
        loop {
            let at = self.here();
            let Some(word) = self.word(&FRAME_ATTRIBUTES) else {
                return;
            };
            let is_second = match word {
                "payload" => frame.payload_bytes.is_given(),
                "late" => frame.late_us.is_given(),
                _ => frame.rate.is_given(),
            };
            if is_second {
                self.given_twice(word, at);
            }
            match word {
                "payload" => {
                    let number = self.number_with_unit("a number of bytes", "bytes");
                    set_if_absent(&mut frame.payload_bytes, Given::from_read(number));
                }
                "period" => {
                    let read = Given::from_read(self.time(1).map(Rate::PeriodUs));
                    set_if_absent(&mut frame.rate, read);
                }
                "rate" => {
                    let read = Given::from_read(self.hertz().map(Rate::Hertz));
                    set_if_absent(&mut frame.rate, read);
                }
                _ => {
                    frame.late_word.get_or_insert(at);
                    let read = Given::from_read(self.time(1));
                    set_if_absent(&mut frame.late_us, read);
                }
            }
        }
    }

    /// `transmit` or `receive`, behind the dot.
    pub(super) fn dispatcher(&mut self) -> Option<(Direction, Name)> {
        let at = self.here();
        let Some(word) = self.word(&DISPATCHERS) else {
            let hint = "a link has two dispatchers, `transmit` and `receive`";
            self.corrected("`transmit` or `receive`", Some(hint.into()));
            if matches!(self.token.kind, T::Identifier | T::ForeignWord) {
                self.bump();
            }
            return None;
        };
        let direction = if word == "transmit" {
            Direction::Out
        } else {
            Direction::In
        };
        Some((direction, Name(at)))
    }

    /// `10 Hz`, above 0.
    fn hertz(&mut self) -> Option<u32> {
        let number = self.integer("a rate in Hz", 1, u32::MAX);
        self.unit(number, "Hz");
        number.map(|number| number.value)
    }

    /// A whole number and its unit. Whether it is in its range is asked later.
    fn number_with_unit(&mut self, what: &str, unit: &'static str) -> Option<Number> {
        let number = self.any_integer(what);
        self.unit(number, unit);
        number
    }

    /// The unit behind a number.
    fn unit(&mut self, number: Option<Number>, unit: &'static str) {
        if self.word(&[unit]).is_some() {
            return;
        }
        let expected = format!("`{unit}`");
        let Some(number) = number else {
            return self.expected(&expected);
        };
        let insert = Edit::behind(number.span, format!(" {unit}"));
        let fix = Fix::one(format!("write `{unit}`"), insert);
        let cure = Cure::say(format!("write `{unit}` behind the number")).fix(fix);
        self.mended(&expected, cure);
    }

    /// A whole number of any size: one that is too large for 32 bits is the largest there is.
    fn any_integer(&mut self, what: &str) -> Option<Number> {
        let token = self.integer_token(what)?;
        Some(Number {
            value: self.text_of(token).parse().unwrap_or(u32::MAX),
            span: self.span_of(token),
        })
    }

    /// Reports an attribute that stands a second time, or that says again what another has said.
    fn given_twice(&mut self, word: &str, at: Span) {
        let message = match word {
            "period" | "rate" => "how often the frame is sent is given twice".to_owned(),
            word => format!("`{word}` is given twice"),
        };
        self.sink
            .push(Diagnostic::new(Code::E003, at, message).hint("remove one of the two"));
    }
}
