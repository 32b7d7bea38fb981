//! Tasks: their attributes, ports, flags and parameters.

use crate::model::{Direction, ParamType, Span};
use crate::nearest::nearest;

use crate::lang::cure::Cure;
use crate::lang::diagnostic::{Edit, Fix};
use crate::lang::lexer::TokenKind as T;
use crate::lang::tree::{DataPort, Flag, Given, Name, Number, Param, Task};

use super::{Body, Parser, set_if_absent};

/// The attributes of a task whose words are not reserved.
const ATTRIBUTE_WORDS: [&str; 4] = ["wcet", "exclusive", "count", "endless"];

/// What can follow the name of a task.
const ATTRIBUTES: &str = "`slot`, `wcet`, `exclusive`, `count`, `endless` or `{`";

impl Parser<'_, '_> {
    /// Whether a name is followed by an attribute of a task.
    pub(super) fn at_task_header(&self) -> bool {
        match self.next.kind {
            T::Slot => {
                let mut behind = self.lexer_behind_next();
                behind.next_token().kind == T::Integer
                    && match behind.next_token() {
                        token if token.kind == T::BraceOpen => true,
                        token => ATTRIBUTE_WORDS.contains(&self.text_of(token)),
                    }
            }
            T::Identifier => ATTRIBUTE_WORDS.contains(&self.text_of(self.next)),
            _ => false,
        }
    }

    /// A task, from its name on.
    pub(super) fn task(&mut self, start: Span) -> Task {
        let docs = self.docs_before(start);
        let name = self.name("the name of the task");
        let mut task = Task {
            docs,
            span: start,
            name,
            slot: Given::Absent,
            wcet_us: Given::Absent,
            exclusive: Given::Absent,
            count: Given::Absent,
            endless: false,
            data: Vec::new(),
            flags: Vec::new(),
            params: Vec::new(),
            skipped: Vec::new(),
            is_cut: false,
            has_gaps: false,
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
            } else if self.at_word("count") {
                if task.count.is_given() {
                    self.attribute_twice("`count`");
                }
                self.bump();
                let read = self.count();
                set_if_absent(&mut task.count, read);
            } else if self.at_word("endless") {
                if task.endless {
                    self.attribute_twice("`endless`");
                }
                self.bump();
                task.endless = true;
            } else if self.at(T::Identifier) {
                // Nearly an attribute: its value must not be taken for anything else.
                let words = ATTRIBUTE_WORDS.into_iter().chain(["slot"]);
                if let Some(word) = nearest(self.text_of(self.token), words) {
                    let hint = format!("did you mean `{word}`?");
                    self.corrected(ATTRIBUTES, Some(hint));
                    self.bump();
                    match word {
                        "wcet" => task.wcet_us = Given::from_read(self.time(0)),
                        "exclusive" => task.exclusive = Given::from_read(self.name("a group")),
                        "count" => task.count = self.count(),
                        "endless" => task.endless = true,
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
            self.expected(ATTRIBUTES);
        }
        if self.is_lost {
            set_if_absent(&mut task.slot, Given::Broken);
        }
        self.body = Body::Task;
        if self.open_body() {
            self.task_body(&mut task);
        } else {
            task.has_gaps = true;
        }
        task
    }

    /// The number behind `count`.
    fn count(&mut self) -> Given<u32> {
        let number = self.integer("how many task states there can be", 0, u32::MAX);
        Given::from_read(number.map(|number| number.value))
    }

    /// `slot 2`, of a task or task state.
    pub(super) fn slot_attribute(&mut self, slot: &mut Given<Number>) {
        if slot.is_given() {
            self.attribute_twice("`slot`");
        }
        self.bump();
        let read = Given::from_read(self.integer("the number of a slot, or 0", 0, u32::MAX));
        self.no_unit("a slot is named by its number, which has no unit");
        set_if_absent(slot, read);
    }

    pub(super) fn task_body(&mut self, task: &mut Task) {
        const WORDS: [(&str, T); 4] = [
            ("in", T::In),
            ("out", T::Out),
            ("inout", T::InOut),
            ("param", T::Param),
        ];
        loop {
            task.has_gaps |= self.is_lost;
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
                        T::Event => {
                            let hint = "events are sent and received by containers: a task reports with flags";
                            self.expected_with("`data` or `flag`", Some(hint.into()));
                            self.bump();
                            self.skip_item(&mut task.skipped);
                        }
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
                | T::Link
                | T::Frame
                | T::Slot
                | T::Task
                | T::Container
                | T::Machine => {
                    task.is_cut = self.is_cut;
                    task.has_gaps |= self.is_cut || self.at(T::EndOfFile);
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
    pub(super) fn missing_close(&mut self, expected: &str) {
        let hint = match self.token.kind {
            T::EndOfFile => "a `}` is missing before the end of the file",
            _ => "is a `}` missing before it?",
        };
        self.loose_closes += 1;
        let close = Edit::replace(self.behind_last(), "\n}");
        let fix = Fix::one("write the missing `}`", close);
        self.lost(expected, Cure::say(hint).fix(fix));
    }

    /// Skips something that starts here but belongs elsewhere.
    pub(super) fn skip_foreign_item(&mut self, names: &mut Vec<Name>) {
        if self.at_start_of_item() {
            self.bump();
        }
        self.skip_item(names);
    }

    /// A flag, behind its direction.
    pub(super) fn flag(&mut self, start: Span, direction: T) -> Flag {
        if direction == T::InOut {
            let hint = "a flag is written from one side only: `in flag` or `out flag`";
            self.corrected("`data`", Some(hint.into()));
        }
        let docs = self.docs_before(start);
        self.bump();
        let name = self.name("the name of the flag");
        self.end_statement("`;`");
        Flag {
            docs,
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
    pub(super) fn data_port(&mut self, start: Span, direction: T) -> DataPort {
        let docs = self.docs_before(start);
        self.bump();
        let name = self.name("the name of the port");
        let type_name = if self.eat(T::Colon) {
            if self.at_word("within") && self.next.kind == T::Integer {
                // The type is missing before its attribute.
                self.corrected("the name of a type", None);
                None
            } else {
                self.name("the name of a type")
            }
        } else if self.at(T::Identifier) && self.next.kind == T::Semicolon {
            self.mended("`:` and a type", missing_colon(self.behind_last()));
            self.name("the name of a type")
        } else {
            self.expected("`:` and a type");
            None
        };
        let takes_within = self.body == Body::Task && direction != T::Out;
        let expected = if takes_within {
            "`optional`, `within` or `;`"
        } else {
            "`optional` or `;`"
        };
        let mut optional = false;
        let mut within_us = Given::Absent;
        loop {
            if self.at_word("optional") {
                if optional {
                    self.attribute_twice("`optional`");
                }
                optional = true;
                self.bump();
            } else if self.at_word("within") {
                if !takes_within {
                    let hint = if self.body == Body::Task {
                        "how old a value may be is said where it is read, at an `in` or `inout` port"
                    } else {
                        "how old a value may be is said by the task that reads it, at its own port"
                    };
                    self.corrected(expected, Some(hint.into()));
                } else if within_us.is_given() {
                    self.attribute_twice("`within`");
                }
                self.bump();
                let read = Given::from_read(self.time(1));
                if takes_within {
                    set_if_absent(&mut within_us, read);
                }
            } else {
                break;
            }
        }
        self.end_statement(expected);
        DataPort {
            docs,
            span: self.since(start),
            direction: match direction {
                T::In => Direction::In,
                T::Out => Direction::Out,
                _ => Direction::InOut,
            },
            name,
            type_name,
            optional,
            within_us,
        }
    }

    pub(super) fn param(&mut self) -> Param {
        const TYPES: [&str; 4] = ["bool", "i32", "u32", "f32"];
        let start = self.here();
        let docs = self.docs_before(start);
        self.bump();
        let name = self.name("the name of the parameter");
        if !self.eat(T::Colon) {
            if self.at(T::Identifier) && TYPES.contains(&self.text_of(self.token)) {
                self.mended("`:` and a type", missing_colon(self.behind_last()));
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
            docs,
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
}

/// A colon that is missing behind a name.
pub(super) fn missing_colon(behind: Span) -> Cure {
    Cure::default().fix(Fix::one(
        "write the missing `:`",
        Edit::replace(behind, ":"),
    ))
}
