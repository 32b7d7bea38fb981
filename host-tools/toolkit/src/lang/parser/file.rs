//! Declarations of a file: `use`, `interpreter`, `queue`, `slot`, and which of the others comes.

use crate::model::Span;

use crate::lang::cure::Cure;
use crate::lang::diagnostic::{Code, Diagnostic, Edit, Fix};
use crate::lang::lexer::TokenKind as T;
use crate::lang::tree::{File, Given, Interpreter, Queue, Rate, Slot, Use};

use super::{Body, Parser, set_if_absent};

impl Parser<'_, '_> {
    pub(super) fn file(&mut self) -> File {
        /// Words that start a declaration of a file.
        const WORDS: [(&str, T); 9] = [
            ("use", T::Use),
            ("interpreter", T::Interpreter),
            ("queue", T::Queue),
            ("slot", T::Slot),
            ("task", T::Task),
            ("container", T::Container),
            ("machine", T::Machine),
            ("link", T::Link),
            ("frame", T::Frame),
        ];
        /// Which body was closed last.
        enum Closed {
            Nothing,
            Task,
            Container,
        }
        let mut file = File::default();
        let mut closed = Closed::Nothing;
        // Whether what belongs into a body has been reported, and nothing else has come since.
        let mut is_told = false;
        loop {
            file.has_gaps |= self.is_lost;
            self.is_lost = std::mem::take(&mut self.stays_lost);
            self.body = Body::File;
            let kind = self.misspelt(&WORDS).unwrap_or(self.token.kind);
            match kind {
                T::EndOfFile => {
                    file.is_cut = self.is_cut;
                    file.has_gaps |= self.is_cut;
                    return file;
                }
                T::Use => {
                    let start = self.here();
                    self.bump();
                    file.uses.push(self.use_file(start));
                }
                // A path or number whose word is missing: nothing else starts with one.
                T::Text => {
                    self.mended("`use`", insert_word(self.here(), "use"));
                    file.uses.push(self.use_file(self.here()));
                }
                T::Integer if self.next.kind == T::Semicolon => {
                    self.mended("`queue`", insert_word(self.here(), "queue"));
                    file.queues.push(self.queue(self.here()));
                }
                T::Integer if self.next.kind == T::Identifier => {
                    self.mended("`slot`", insert_word(self.here(), "slot"));
                    file.slots.push(self.slot(self.here()));
                }
                T::Integer if matches!(self.next.kind, T::Integer | T::Text) => {
                    // A number for the word: what follows says which.
                    self.expected("`slot` or `use`");
                    self.bump();
                    self.report_nothing_here();
                    continue;
                }
                T::Slot if file.interpreters.is_empty() && self.at_number_of_interpreter() => {
                    let cure = Cure::say("did you mean `interpreter slot`?");
                    let insert = Edit::before(self.here(), "interpreter ");
                    self.mended(
                        "`interpreter`",
                        cure.fix(Fix::one("write `interpreter slot`", insert)),
                    );
                    file.interpreters.push(self.interpreter(self.here()));
                }
                T::Interpreter => {
                    let start = self.here();
                    self.bump();
                    file.interpreters.push(self.interpreter(start));
                }
                T::Queue => {
                    let start = self.here();
                    self.bump();
                    file.queues.push(self.queue(start));
                }
                T::Slot => {
                    let start = self.here();
                    self.bump();
                    file.slots.push(self.slot(start));
                }
                T::Link => {
                    let start = self.here();
                    self.bump();
                    file.links.push(self.link(start));
                }
                T::Frame => {
                    let start = self.here();
                    self.bump();
                    file.frames.push(self.frame(start));
                }
                T::Identifier if self.at_task_header() => {
                    self.mended("`task`", insert_word(self.here(), "task"));
                    file.tasks.push(self.task(self.here()));
                    closed = Closed::Task;
                    is_told = false;
                    continue;
                }
                T::Task => {
                    let start = self.here();
                    self.bump();
                    file.tasks.push(self.task(start));
                    closed = Closed::Task;
                    is_told = false;
                    continue;
                }
                T::Container | T::Machine => {
                    file.containers.push(self.container(kind == T::Machine));
                    closed = Closed::Container;
                    is_told = false;
                    continue;
                }
                T::BraceClose if self.loose_closes > 0 => {
                    self.loose_closes -= 1;
                    self.bump();
                    continue;
                }
                T::BraceClose => {
                    if is_told {
                        self.report_nothing_here();
                    }
                    let cure = Cure::say("nothing is open here: remove it");
                    let remove = Edit::remove(self.here());
                    self.mended(
                        "a declaration",
                        cure.fix(Fix::one("remove the `}`", remove)),
                    );
                    self.bump();
                    closed = Closed::Nothing;
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
                    if self.loose_closes > 0 {
                        // The `}` before it was one of those.
                        self.loose_closes -= 1;
                        is_told = true;
                    }
                    if std::mem::replace(&mut is_told, true) {
                        self.report_nothing_here();
                    }
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
                T::Semicolon if self.last_end > 0 => {
                    let cure = Cure::say("no `;` stands behind a body: remove it");
                    let remove = Edit::remove(self.here());
                    self.mended(
                        "a declaration",
                        cure.fix(Fix::one("remove the `;`", remove)),
                    );
                    self.bump();
                    if self.at(T::Semicolon) {
                        self.report_nothing_here();
                    }
                    continue;
                }
                _ => {
                    if is_told && self.next.kind == T::Arrow {
                        self.report_nothing_here();
                    }
                    self.expected(
                        "`use`, `interpreter`, `queue`, `slot`, `task`, `container`, `machine`, `link` or \
                            `frame`",
                    );
                    self.skip_item(&mut file.skipped);
                    // It may have been in a body that goes on behind it.
                    continue;
                }
            }
            closed = Closed::Nothing;
            is_told = false;
        }
    }

    /// `slot 1;`: a slot that the word `interpreter` is missing of.
    pub(super) fn at_number_of_interpreter(&self) -> bool {
        let mut behind = self.lexer_behind_next();
        self.next.kind == T::Integer && behind.next_token().kind == T::Semicolon
    }

    /// `"path";`
    pub(super) fn use_file(&mut self, start: Span) -> Use {
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
            T::Identifier | T::Unknown | T::ForeignWord | T::Dot => {
                let mut cure = Cure::say("the path of the file stands in quotes");
                if let Some(path) = self.unquoted_path() {
                    let quoted = self.between(path.start, path.end);
                    let quoted = quoted.trim_matches(['\'', '<', '>', '`']);
                    cure = cure.edit(Edit::replace(path, format!("\"{quoted}\"")));
                }
                self.lost("a path such as `\"tasks.esm\"`", cure);
                None
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

    /// What stands between `use` and the `;` on its line.
    fn unquoted_path(&self) -> Option<Span> {
        let (path, _) = self.near_text().split_once(';')?;
        let end = self.token.start + path.trim_end().len() as u32;
        let is_path = !path.contains(['"', '{', '}']) && !path.contains("/*");
        is_path.then(|| self.span_between(self.token.start, end))
    }

    /// `slot 1;`
    pub(super) fn interpreter(&mut self, start: Span) -> Interpreter {
        if self.at(T::Integer) {
            self.mended("`slot`", insert_word(self.here(), "slot"));
        } else {
            self.expect(T::Slot, "`slot`");
        }
        let slot = self.integer("the number of a slot", 1, u32::MAX);
        self.no_unit("a slot is named by its number, which has no unit");
        self.end_statement("`;`");
        Interpreter {
            span: self.since(start),
            slot,
        }
    }

    /// `32;`
    pub(super) fn queue(&mut self, start: Span) -> Queue {
        let capacity = self
            .integer("the capacity of the event queue", 1, u32::from(u8::MAX))
            .and_then(|number| u8::try_from(number.value).ok());
        self.no_unit("the queue counts events: its number has no unit");
        self.end_statement("`;`");
        Queue {
            span: self.since(start),
            capacity,
        }
    }

    /// `1 period 10 ms duration 1 ms;`
    pub(super) fn slot(&mut self, start: Span) -> Slot {
        let docs = self.docs_before(start);
        let number = self.integer("the number of a slot", 1, u32::MAX);
        let mut rate = Given::Absent;
        let mut rate_word = "";
        let mut duration_us = Given::Absent;
        self.no_unit("a slot is named by its number, which has no unit");
        loop {
            if self.at_word("duration") && !rate.is_given() {
                self.expected("`period` or `rate`");
            }
            let at = self.token;
            let other = self.other_attribute();
            let Some(word) = other.or_else(|| self.word(&["period", "rate", "duration"])) else {
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
                "period" if self.at_number_with(&["Hz", "kHz"]) => {
                    self.bump();
                    let cure = Cure::say(
                        "a period is a time in `us`, `ms` or `s`: a number of Hz stands behind \
                            `rate`",
                    );
                    let fix = Fix::write(self.span_of(at), "rate");
                    self.mended("a unit of time", cure.fix(fix));
                    self.bump();
                    set_if_absent(&mut rate, Given::Broken);
                    rate_word = "period";
                }
                "period" => {
                    let read = Given::from_read(self.time(1).map(Rate::PeriodUs));
                    set_if_absent(&mut rate, read);
                    rate_word = word;
                }
                "rate" if self.at_number_with(&["us", "ms", "s"]) => {
                    self.bump();
                    let cure = Cure::say("a rate is in Hz: a time stands behind `period`");
                    let fix = Fix::write(self.span_of(at), "period");
                    self.mended("`Hz`", cure.fix(fix));
                    self.bump();
                    set_if_absent(&mut rate, Given::Broken);
                    rate_word = word;
                }
                "rate" => {
                    let hertz = self.integer("a rate in Hz", 1, u32::MAX);
                    if self.word(&["Hz"]).is_none() {
                        let mut cure = Cure::default();
                        if let Some(hertz) = hertz {
                            let insert = Edit::behind(hertz.span, " Hz");
                            cure = Cure::say("write `Hz` behind the number").edit(insert);
                        }
                        self.lost("`Hz`", cure);
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
            docs,
            span: self.since(start),
            number,
            rate: rate.value(),
            duration_us: duration_us.value(),
        }
    }

    /// Whether a number stands here with one of some units, in whichever letters.
    fn at_number_with(&self, units: &[&str]) -> bool {
        let unit = self.text_of(self.next);
        matches!(self.token.kind, T::Integer | T::Float)
            && units.iter().any(|known| known.eq_ignore_ascii_case(unit))
    }

    /// A word of other tools for an attribute of a slot.
    fn other_attribute(&mut self) -> Option<&'static str> {
        const OTHERS: [(&str, &str); 9] = [
            ("every", "period"),
            ("cycle", "period"),
            ("interval", "period"),
            ("freq", "rate"),
            ("frequency", "rate"),
            ("for", "duration"),
            ("length", "duration"),
            ("budget", "duration"),
            ("wcet", "duration"),
        ];
        let text = self.text_of(self.token);
        let other = OTHERS
            .iter()
            .find(|(other, _)| other.eq_ignore_ascii_case(text));
        let (_, word) = other.filter(|_| self.next.kind == T::Integer)?;
        let what = "`period`, `rate` or `duration`";
        self.mended(what, Cure::meant(self.here(), word));
        self.bump();
        Some(word)
    }
}

/// A word that is missing before what stands here.
fn insert_word(here: Span, word: &str) -> Cure {
    let insert = Edit::before(here, format!("{word} "));
    Cure::default().fix(Fix::one(format!("write `{word}`"), insert))
}
