//! Declarations of a file: `use`, `interpreter`, `queue`, `slot`, and which of the others comes.

use crate::model::Span;

use crate::lang::diagnostic::{Code, Diagnostic};
use crate::lang::lexer::TokenKind as T;
use crate::lang::tree::{File, Given, Interpreter, Queue, Rate, Slot, Use};

use super::{Body, Parser, set_if_absent};

impl Parser<'_, '_> {
    pub(super) fn file(&mut self) -> File {
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
                    self.corrected("`use`", None);
                    file.uses.push(self.use_file(self.here()));
                }
                T::Integer if self.next.kind == T::Semicolon => {
                    self.corrected("`queue`", None);
                    file.queues.push(self.queue(self.here()));
                }
                T::Integer if self.next.kind == T::Identifier => {
                    self.corrected("`slot`", None);
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
                    let hint = "did you mean `interpreter slot`?";
                    self.corrected("`interpreter`", Some(hint.into()));
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
                T::Identifier if self.at_task_header() => {
                    self.corrected("`task`", None);
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
                    self.corrected(
                        "a declaration",
                        Some("nothing is open here: remove it".into()),
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
                _ => {
                    if is_told && self.next.kind == T::Arrow {
                        self.report_nothing_here();
                    }
                    self.expected(
                        "`use`, `interpreter`, `queue`, `slot`, `task`, `container` or `machine`",
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
            T::Identifier => {
                let hint = "the path of the file stands in quotes";
                self.expected_with("a path such as `\"tasks.esm\"`", Some(hint.into()));
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

    /// `slot 1;`
    pub(super) fn interpreter(&mut self, start: Span) -> Interpreter {
        self.expect(T::Slot, "`slot`");
        let slot = self.integer("the number of a slot", 1, u32::MAX);
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
            docs,
            span: self.since(start),
            number,
            rate: rate.value(),
            duration_us: duration_us.value(),
        }
    }
}
