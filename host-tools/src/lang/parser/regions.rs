//! Regions and states.

use crate::model::Span;
use crate::nearest::nearest;

use crate::lang::lexer::TokenKind as T;
use crate::lang::tree::{Given, Literal, Name, Region, State, StateKind};

use super::values::excerpt;
use super::{Body, Parser, set_if_absent};

/// What stands in a region.
const EXPECTED: &str = "`state`, `task`, `super`, a transition or `}`";

impl Parser<'_, '_> {
    pub(super) fn region(&mut self) -> Region {
        let start = self.here();
        let docs = self.docs_before(start);
        self.bump();
        let name = self.name("the name of the region");
        let mut region = Region {
            docs,
            span: self.since(start),
            name,
            states: Vec::new(),
            transitions: Vec::new(),
            may_have_initial: false,
            skipped: Vec::new(),
            is_cut: false,
            has_gaps: false,
        };
        self.body = Body::Region;
        if self.open_body() {
            self.region_body(&mut region);
        } else {
            region.may_have_initial = true;
            region.has_gaps = true;
        }
        region
    }

    /// The inside of a region and its `}`.
    fn region_body(&mut self, region: &mut Region) {
        self.region_items(region);
        if self.at(T::BraceClose) {
            self.bump();
        } else {
            self.missing_close(EXPECTED);
        }
    }

    /// States and transitions, up to what is neither.
    pub(super) fn region_items(&mut self, region: &mut Region) {
        loop {
            region.has_gaps |= self.is_lost;
            self.is_lost = std::mem::take(&mut self.stays_lost);
            self.body = Body::Region;
            let kind = self.token.kind;
            match kind {
                T::BraceClose => return,
                T::State | T::Super => region.states.push(self.state(kind)),
                T::Task if self.at_task_declaration() => return,
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
                    region.has_gaps |= self.is_cut || self.at(T::EndOfFile);
                    region.may_have_initial |= self.at(T::EndOfFile);
                    return;
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
    pub(super) fn at_transition(&self) -> bool {
        matches!(
            self.next.kind,
            T::Arrow | T::Minus | T::Equals | T::Unknown | T::Final | T::Initial
        )
    }

    /// `A: T;`, `A timeout 1 s;`, `A;`: what kind of state this is meant to be cannot be told, but it has a name.
    pub(super) fn nameless_item(&mut self, region: &mut Region) {
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
    pub(super) fn misspelt_in_region(&mut self, region: &mut Region) {
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
                if self.next.kind == T::Arrow {
                    // Either of them is too many, or the arrow is in the wrong place.
                    self.stays_lost = true;
                    return;
                }
                self.skip_item(&mut region.skipped);
            }
        }
    }

    /// Whether `task` starts the declaration of a task (`task T {`, `task T slot …`), not a task state.
    pub(super) fn at_task_declaration(&self) -> bool {
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
    pub(super) fn state(&mut self, word: T) -> State {
        let start = self.here();
        self.bump();
        self.state_behind(word, start)
    }

    /// A state, from its name on.
    pub(super) fn state_behind(&mut self, word: T, start: Span) -> State {
        let docs = self.docs_before(start);
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
            docs,
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
    pub(super) fn with(&mut self, values: &mut Vec<(Name, Option<Literal>)>) -> bool {
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
            if self.at(T::Semicolon) && self.next.kind == T::Identifier {
                // A `;` for a `,`: the braces are not over.
                self.bump();
            }
            while !matches!(self.token.kind, T::BraceClose | T::Semicolon | T::EndOfFile)
                && !self.at_start_of_item()
            {
                self.bump();
            }
            self.eat(T::BraceClose);
        }
        is_whole
    }
}
