//! Regions and states.

use crate::model::Span;

use crate::lang::cure::Cure;
use crate::lang::diagnostic::{Code, Diagnostic, Edit, Fix};
use crate::lang::lexer::TokenKind as T;
use crate::lang::tree::{Endpoint, Given, Literal, Name, Region, State, StateKind};

use super::tasks::missing_colon;
use super::words::{excerpt, meant};
use super::{Body, Parser, set_if_absent};

/// What stands in a region.
const EXPECTED: &str = "`state`, `task`, `super`, a transition or `}`";

/// Words for `timeout` at a state.
pub(super) const LIMIT_WORDS: [&str; 6] = ["after", "for", "within", "limit", "wait", "delay"];

/// Words for an arrow.
const TO_WORDS: [&str; 5] = ["to", "goto", "goes", "becomes", "then"];

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
        self.tell_limits(region);
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
                T::Initial if matches!(self.next.kind, T::State | T::Task | T::Super) => {
                    self.initial_state(region);
                }
                T::Identifier if self.at_foreign_transition() => self.foreign_transition(region),
                T::Identifier
                    if matches!(self.next.kind, T::Identifier | T::ForeignWord)
                        && !self.is_foreign_arrow(self.next) =>
                {
                    self.misspelt_in_region(region);
                }
                T::Identifier | T::Exit if self.at_entry_action() => {
                    let hint = "a state has no actions of its own: they stand at the transitions \
                        that enter or leave it, `A -> B / send E;`";
                    self.expected_with(EXPECTED, Some(hint.into()));
                    region.may_have_initial = true;
                    self.skip_statement(Some(&mut region.skipped));
                }
                T::Identifier if !self.at_transition() => self.nameless_item(region),
                T::BracketOpen | T::Star | T::Arrow
                    if self.at_foreign_initial(region).is_some() =>
                {
                    self.foreign_initial(region);
                }
                T::Send | T::Set | T::Clear => {
                    self.stray_action(region);
                }
                T::Initial | T::Identifier | T::ForeignWord => self.transition(region),
                T::Final if self.next.kind == T::Arrow => {
                    self.expected_with(EXPECTED, Some("`final` can only be entered".into()));
                    self.skip_statement(None);
                }
                T::EndOfFile
                | T::Use
                | T::Interpreter
                | T::Queue
                | T::Link
                | T::Frame
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
        ) || self.is_foreign_arrow(self.next)
    }

    /// Whether `entry / …` or `exit: …` stands here, as in other tools.
    fn at_entry_action(&self) -> bool {
        let words = [
            "entry", "exit", "enter", "do", "onentry", "onexit", "during",
        ];
        let text = self.text_of(self.token);
        words.iter().any(|word| word.eq_ignore_ascii_case(text))
            && matches!(
                self.next.kind,
                T::Slash | T::Colon | T::BraceOpen | T::Send | T::Set
            )
    }

    /// `initial state A;`: the state, and that it is the initial one.
    fn initial_state(&mut self, region: &mut Region) {
        let word = self.here();
        self.bump();
        let (found, is_told) = (self.here(), self.is_told());
        let message = format!("expected `->`, found {}", self.found());
        self.report_nothing_here();
        let state = self.state(self.token.kind);
        region.may_have_initial = true;
        if let (false, Some(name)) = (is_told, state.name) {
            let name = self.between(name.0.start, name.0.end);
            let hint = format!("declare the state, and write `initial -> {name};`");
            let word = self.span_between(word.start, found.start);
            let edits = vec![
                Edit::remove(word),
                Edit::behind(state.span, format!(" initial -> {name};")),
            ];
            let fix = Fix::new(format!("write `initial -> {name};`"), edits);
            let diagnostic = Diagnostic::new(Code::E001, found, message);
            self.sink.push(diagnostic.hint(hint).fix(fix));
        }
        region.states.push(state);
    }

    /// Whether a transition stands here with words of other tools: `transition A -> B`,
    /// `from A to B`, `A to B`.
    fn at_foreign_transition(&self) -> bool {
        let [third] = self.ahead();
        let next = self.text_of(self.next);
        let is_name = |kind| matches!(kind, T::Identifier | T::Final);
        if self.next.kind != T::Identifier {
            return false;
        }
        let is_arrow = TO_WORDS.iter().any(|word| word.eq_ignore_ascii_case(next));
        let starts = self.at_any_case(&["transition", "trans", "edge", "from", "arc"]);
        starts && (third.kind == T::Arrow || self.is_to_word(third))
            || is_arrow && is_name(third.kind)
    }

    fn is_to_word(&self, token: crate::lang::lexer::Token) -> bool {
        let text = self.text_of(token);
        token.kind == T::Identifier && TO_WORDS.iter().any(|word| word.eq_ignore_ascii_case(text))
    }

    /// Such a transition, without its first word.
    fn foreign_transition(&mut self, region: &mut Region) {
        let cure = Cure::say("a transition is written `A -> B;`");
        let starts = !self.is_to_word(self.next);
        if starts {
            let word = self.span_between(self.token.start, self.next.start);
            let [third] = self.ahead();
            let mut edits = vec![Edit::remove(word)];
            if self.is_to_word(third) {
                edits.push(Edit::replace(self.span_of(third), "->"));
            }
            let fix = Fix::new("write it with `->` alone", edits);
            self.mended(EXPECTED, cure.fix(fix));
            self.bump();
            self.report_nothing_here();
        } else {
            let word = self.span_of(self.next);
            let source = self.here();
            self.bump();
            self.mended("`->`", cure.fix(Fix::write(word, "->")));
            self.bump();
            self.report_nothing_here();
            return self.behind_arrow(source, Endpoint::State(Name(source)), region);
        }
        let source = self.here();
        if self.is_to_word(self.next) {
            self.bump();
            self.bump();
            self.report_nothing_here();
            return self.behind_arrow(source, Endpoint::State(Name(source)), region);
        }
        self.transition(region);
    }

    /// How `[*]`, `*` or nothing stand before an arrow for `initial`: the bytes of it.
    fn at_foreign_initial(&self, region: &Region) -> Option<Span> {
        // Where a region starts stands at its beginning.
        let mut transitions = region.transitions.iter().take(100);
        if transitions.any(|it| it.source == Endpoint::Pseudo) {
            // Some other state is missing then.
            return None;
        }
        let start = self.token.start;
        let tokens: [_; 2] = self.ahead();
        let kinds = [
            self.token.kind,
            self.next.kind,
            tokens[0].kind,
            tokens[1].kind,
        ];
        let end = match kinds {
            [
                T::BracketOpen,
                T::Star,
                T::BracketClose,
                T::Arrow | T::Minus,
            ] => tokens[0].end,
            [T::Star, T::Arrow, T::Identifier, _] => self.token.end,
            [T::Arrow, T::Identifier, T::Semicolon, _] => start,
            _ => return None,
        };
        Some(self.span_between(start, end))
    }

    fn foreign_initial(&mut self, region: &mut Region) {
        let Some(sign) = self.at_foreign_initial(region) else {
            return;
        };
        let start = self.here();
        let text = if sign.start == sign.end {
            "initial "
        } else {
            "initial"
        };
        let cure = Cure::say("where a region starts is written `initial -> A;`");
        let fix = Fix::one("write `initial`", Edit::replace(sign, text));
        self.mended(EXPECTED, cure.fix(fix));
        while self.token.start < sign.end {
            self.bump();
        }
        self.report_nothing_here();
        let before = region.transitions.len();
        self.arrow();
        self.behind_arrow(start, Endpoint::Pseudo, region);
        if region.transitions.len() == before {
            region.may_have_initial = true;
        }
    }

    /// An action where a statement starts: behind a `;` that should be a `,`.
    fn stray_action(&mut self, region: &mut Region) {
        let behind = region.transitions.last();
        let ends_before =
            behind.is_some_and(|it| it.span.end == self.last_end && !it.actions.is_empty());
        let mut cure = Cure::say("actions stand at a transition, `A -> B / send E, set .f;`");
        if ends_before && self.last_end > 0 {
            let semicolon = self.span_between(self.last_end - 1, self.last_end);
            cure = Cure::say("several actions are separated by `,`")
                .edit(Edit::replace(semicolon, ","));
        }
        region.has_gaps = true;
        self.lost(EXPECTED, cure);
        self.skip_statement(Some(&mut region.skipped));
    }

    /// Reports the limits of time that stand at transitions, where they can be moved to the states
    /// that are left.
    pub(super) fn tell_limits(&mut self, region: &Region) {
        for limit in std::mem::take(&mut self.limits) {
            let source = limit
                .source
                .map(|name| self.between(name.0.start, name.0.end));
            let state = region.states.iter().find(|state| {
                let name = state.name;
                source.is_some() && name.map(|it| self.between(it.0.start, it.0.end)) == source
            });
            let time = limit.time.as_deref();
            let mut diagnostic = limit.diagnostic;
            if let (Some(state), Some(time)) = (state, time)
                && !state.timeout_us.is_given()
                && let Some(place) = state.place_of_attributes()
            {
                let mut edits = limit.edits;
                edits.push(Edit::behind(place, format!(" timeout {time}")));
                let title = format!(
                    "give state `{}` the limit, and read it as `[timeout]`",
                    source.unwrap_or_default()
                );
                diagnostic = diagnostic.fix(Fix::new(title, edits));
            } else if state.is_some_and(|state| state.timeout_us.is_given()) {
                let title = "read the limit of the state, `[timeout]`";
                diagnostic = diagnostic.fix(Fix::new(title, limit.edits));
            }
            self.sink.push(diagnostic);
        }
    }

    /// `A: T;`, `A timeout 1 s;`, `A;`: what kind of state this is meant to be cannot be told, but
    /// it has a name.
    pub(super) fn nameless_item(&mut self, region: &mut Region) {
        region.skipped.push(Name(self.here()));
        self.bump();
        self.expected_with(
            "`->`",
            Some("a state starts with `state`, `task` or `super`".into()),
        );
        self.skip_statement(None);
    }

    /// Two names in a row: a transition without its arrow, or a state whose word is misspelt. What
    /// was found against expectation is the second name.
    pub(super) fn misspelt_in_region(&mut self, region: &mut Region) {
        const WORDS: [(&str, T); 3] = [("state", T::State), ("task", T::Task), ("super", T::Super)];
        let word = self.token;
        let meant = meant(self.text_of(word), &WORDS.map(|(word, _)| word));
        let kind = WORDS.iter().find(|(word, _)| Some(*word) == meant);
        self.bump();
        let hint = meant.map(|meant| {
            let found = excerpt(self.text_of(word));
            format!("did you mean `{meant}` by `{found}`?")
        });
        match kind {
            Some(&(_, kind)) => {
                let fix = meant.map(|meant| Fix::write(self.span_of(word), meant));
                let fixes = fix.into_iter().collect();
                self.mended("`->`", Cure { hint, fixes });
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

    /// Whether `task` starts the declaration of a task (`task T {`, `task T slot …`), not a task
    /// state.
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
        let mut slot_word = None;
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
                self.mended(what, missing_colon(self.behind_last()));
            } else if matches!(self.token.kind, T::Equals | T::Arrow)
                && self.next.kind == T::Identifier
            {
                self.mended(what, Cure::write(self.here(), ":"));
                self.bump();
            } else {
                self.expect(T::Colon, what);
            }
            if self.is_lost { None } else { self.name(what) }
        };
        let mut dispatcher = Given::Absent;
        if word == T::Task && type_name.is_some() && self.eat(T::Dot) {
            dispatcher = Given::from_read(self.dispatcher());
        }

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
                    slot_word.get_or_insert(self.here());
                    self.slot_attribute(&mut slot);
                }
                T::BraceOpen if word == T::Task && !has_with && self.at_values() => {
                    let cure = Cure::say("values of parameters stand behind `with`");
                    let insert = Edit::before(self.here(), "with ");
                    self.mended(expected, cure.fix(Fix::one("write `with`", insert)));
                    has_with = true;
                    with_broken |= !self.values(&mut with);
                }
                T::BraceOpen => {
                    self.body_of_state(expected);
                    with_broken |= word == T::Task;
                    break;
                }
                T::Comma if self.next.kind == T::Identifier => {
                    let text = match word {
                        T::State => "; state",
                        T::Task => "; task",
                        _ => "; super",
                    };
                    let cure = Cure::say("each state has a declaration of its own");
                    self.lost(expected, cure.edit(Edit::replace(self.here(), text)));
                    break;
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
                T::Identifier
                    if !self.at_new_line()
                        && (meant(self.text_of(self.token), &["timeout"]).is_some()
                            || self.next.kind == T::Integer && self.at_any_case(&LIMIT_WORDS)) =>
                {
                    self.mended(expected, Cure::meant(self.here(), "timeout"));
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
                    dispatcher,
                    slot,
                    slot_word,
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
        self.values(values)
    }

    /// Whether the values of a task state stand here without their word.
    fn at_values(&self) -> bool {
        let [sign] = self.ahead();
        self.next.kind == T::Identifier && matches!(sign.kind, T::Equals | T::Colon)
    }

    /// `state A { … }`: states have no body.
    fn body_of_state(&mut self, expected: &str) {
        let mut cure = Cure::say(
            "a state has no body: actions stand at transitions, and states inside a state in a \
                `container`, which a `super` is made of",
        );
        if self.next.kind == T::BraceClose {
            let [behind] = self.ahead();
            let body = self.span_between(self.last_end, self.next.end);
            let text = if behind.kind == T::Semicolon { "" } else { ";" };
            let fix = Fix::one("remove the empty body", Edit::replace(body, text));
            cure = cure.fix(fix);
        }
        self.lost(expected, cure);
    }

    /// `{ a = 1, b = 2 }`. Gives whether all of it could be read.
    fn values(&mut self, values: &mut Vec<(Name, Option<Literal>)>) -> bool {
        let is_open = self.at(T::Identifier) && self.next.kind == T::Equals;
        let mut is_whole = if is_open {
            self.open_values();
            true
        } else {
            self.expect(T::BraceOpen, "`{`")
        };
        loop {
            let Some(name) = self.name("the name of a parameter") else {
                is_whole = false;
                break;
            };
            let is_colon = self.at(T::Colon);
            if is_colon {
                let sign = self.span_between(self.last_end, self.token.end);
                let cure = Cure::say("write `=`").edit(Edit::replace(sign, " ="));
                self.mended("`=` and a value", cure);
                self.bump();
            }
            let literal = if is_colon || self.expect(T::Equals, "`=` and a value") {
                self.literal()
            } else {
                None
            };
            is_whole &= literal.is_some();
            values.push((name, literal));
            if self.at(T::Comma) && self.next.kind == T::BraceClose {
                let cure = Cure::say("no `,` stands behind the last value");
                let remove = Edit::remove(self.here());
                self.mended("`}`", cure.fix(Fix::one("remove the `,`", remove)));
                self.bump();
                break;
            }
            if matches!(self.token.kind, T::Semicolon | T::Identifier) && self.at_next_value() {
                let here = self.here();
                let sign = self.span_between(self.last_end, here.start);
                let edit = if self.at(T::Semicolon) {
                    Edit::replace(here, ",")
                } else {
                    Edit::before(sign, ",")
                };
                let cure = Cure::say("values are separated by `,`");
                self.mended("`,` or `}`", cure.edit(edit));
                self.eat(T::Semicolon);
                continue;
            }
            if !self.eat(T::Comma) {
                break;
            }
        }
        if is_open && self.at(T::Semicolon) {
            return is_whole;
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

    /// Whether a name and `=` follow, behind a `;` that may stand here.
    fn at_next_value(&self) -> bool {
        let [third] = self.ahead();
        match self.token.kind {
            T::Semicolon => self.next.kind == T::Identifier && third.kind == T::Equals,
            _ => self.next.kind == T::Equals,
        }
    }

    /// Reports values without their opening brace, and perhaps without the closing one:
    /// `a = 1, b = 2;`.
    fn open_values(&mut self) {
        let mut cure = Cure::say("the values stand in braces");
        if let Some((values, _)) = self.near_text().split_once(';')
            && !values.contains(['{', '/', '"'])
        {
            let mut edits = vec![Edit::before(self.here(), "{ ")];
            if !values.contains('}') {
                let end = self.token.start + values.trim_end().len() as u32;
                edits.push(Edit::replace(self.span_between(end, end), " }"));
            }
            cure = cure.fix(Fix::new("write the braces", edits));
        }
        self.mended("`{`", cure);
    }
}
