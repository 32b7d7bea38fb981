//! Transitions: triggers, guards, actions.

use crate::model::Span;

use crate::lang::cure::Cure;
use crate::lang::diagnostic::{Code, Diagnostic, Edit, Fix};
use crate::lang::lexer::{Lexer, Token, TokenKind as T};
use crate::lang::tree::{
    Action, Endpoint, Given, GuardKind, GuardTerm, Region, SystemFlag, Transition, Trigger,
};

use super::regions::LIMIT_WORDS;
use super::words::{excerpt, meant};
use super::{BrokenGuard, Limit, MAX_GUARD_DEPTH, Parser, set_if_absent};

/// How far the end of a guard is looked for.
const MAX_GUARD_TOKENS: usize = 400;

/// As many limits of time at transitions of one region are told with a change that mends them.
const MAX_LIMITS: usize = 100;

/// The order of the parts of a transition.
const ORDER: &str = "the parts of a transition are `on E [guard] / actions`, in this order";

/// How a limit of time is written.
const HOW_LIMITS_ARE: &str = "a limit of time belongs to the state: declare `state A timeout 5 \
    s;`, and read it with `[timeout]`";

/// How flags of other states can be asked for.
const HOW_OTHERS_ARE_READ: &str = "a guard reads flags of the state that is left, `.f`, and of the \
    container around it, `^f`; what another state has to say it says with an event (`/ send E` \
    there, `on E` here) or with a flag of the container (`/ set ^f`)";

impl Parser<'_, '_> {
    pub(super) fn transition(&mut self, region: &mut Region) {
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

        self.arrow();
        self.behind_arrow(start, source, region);
    }

    /// The same from the target on.
    pub(super) fn behind_arrow(&mut self, start: Span, source: Endpoint, region: &mut Region) {
        let target = self.target();
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
                        self.corrected(expected, Some(ORDER.into()));
                    }
                    let read = Given::from_read(self.trigger(source));
                    set_if_absent(&mut transition.trigger, read);
                    if !has_actions && !transition.guard.is_given() {
                        expected = "`[`, `/` or `;`";
                    }
                }
                T::BracketOpen => {
                    if transition.guard.is_given() || has_actions {
                        self.corrected(expected, Some(ORDER.into()));
                    }
                    let read = Given::from_read(self.bracketed_guard(source));
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
                T::Send | T::Set | T::Clear if !has_actions => {
                    let cure = Cure::say("actions stand behind `/`");
                    let insert = Edit::before(self.here(), "/ ");
                    self.mended(
                        expected,
                        cure.fix(Fix::one("write the missing `/`", insert)),
                    );
                    has_actions = true;
                    self.action_list(&mut transition.actions);
                    expected = "`,` or `;`";
                }
                T::Send | T::Set | T::Clear if !self.at_new_line() => {
                    let comma = Edit::replace(self.behind_last(), ",");
                    let cure = Cure::say("several actions are separated by `,`");
                    self.mended(expected, cure.edit(comma));
                    self.action_list(&mut transition.actions);
                }
                _ => {
                    if has_actions || !self.foreign_part(&mut transition, expected) {
                        break;
                    }
                }
            }
        }
        self.end_statement(expected);
        transition.span = self.since(start);
        region.transitions.push(transition);
    }

    /// `->`, or what stands for it.
    pub(super) fn arrow(&mut self) {
        if self.eat(T::Arrow) {
            if self.at(T::Unknown) && self.text_of(self.token) == ">" {
                let cure = Cure::say("an arrow is written `->`");
                let remove = Edit::remove(self.here());
                self.mended(
                    "a state or `final`",
                    cure.fix(Fix::one("write `->`", remove)),
                );
                self.bump();
                self.report_nothing_here();
            }
            return;
        }
        let cure = self.cure_of_arrow();
        self.lost("`->`", cure);
        // `A - > B`, `A => B`: the target is behind the broken arrow.
        while matches!(
            self.token.kind,
            T::Minus | T::Equals | T::Unknown | T::Colon | T::Comma | T::Dot | T::Arrow
        ) || self.is_foreign_arrow(self.token)
        {
            self.bump();
        }
        if self.at(T::Identifier) && matches!(self.next.kind, T::Identifier | T::Final) {
            // A word for the arrow.
            self.bump();
        }
        if matches!(self.token.kind, T::Identifier | T::Final) {
            // `A B ->` has its arrow in the wrong place.
            self.is_lost = self.next.kind == T::Arrow;
        }
    }

    /// Whether a token is an arrow of another alphabet.
    pub(super) fn is_foreign_arrow(&self, token: Token) -> bool {
        let is_arrow = |letter| ('\u{2190}'..='\u{21ff}').contains(&letter) || letter == '\u{27f6}';
        token.kind == T::ForeignWord && self.text_of(token).chars().all(is_arrow)
    }

    /// What replaces the signs that stand for an arrow here, up to the target.
    fn cure_of_arrow(&self) -> Cure {
        let mut lexer = Lexer::new_at(self.text, self.token.start);
        let mut target = lexer.next_token();
        while matches!(
            target.kind,
            T::Minus | T::Equals | T::Unknown | T::Colon | T::Comma | T::Dot | T::Arrow
        ) || self.is_foreign_arrow(target)
        {
            target = lexer.next_token();
        }
        let behind = lexer.next_token();
        let is_target = matches!(target.kind, T::Identifier | T::Final);
        let is_certain = !matches!(behind.kind, T::Arrow | T::Identifier | T::Final);
        let is_near = !self
            .between(self.last_end, target.start)
            .contains(['\n', '/']);
        if !(is_target && is_certain && is_near) {
            return Cure::default();
        }
        let sign = self.span_between(self.last_end, target.start);
        let cure = Cure::say("an arrow is written `->`");
        cure.fix(Fix::one("write `->`", Edit::replace(sign, " -> ")))
    }

    fn target(&mut self) -> Option<Endpoint> {
        const WHAT: &str = "a state or `final`";
        let span = self.here();
        let target = match self.token.kind {
            T::Final => {
                self.bump();
                return Some(Endpoint::Pseudo);
            }
            T::Initial => {
                self.corrected(WHAT, Some("`initial` can only be left".into()));
                self.bump();
                return None;
            }
            T::Exit => {
                let cure = Cure::say("where a region ends is written `-> final`");
                self.mended(WHAT, cure.fix(Fix::write(span, "final")));
                self.bump();
                return Some(Endpoint::Pseudo);
            }
            T::BracketOpen if self.next.kind == T::Star => {
                let [close] = self.ahead();
                let cure = Cure::say("where a region ends is written `-> final`");
                let sign = self.span_between(span.start, close.end);
                self.mended(WHAT, cure.fix(Fix::write(sign, "final")));
                self.bump();
                self.bump();
                self.eat(T::BracketClose);
                return Some(Endpoint::Pseudo);
            }
            _ => self.name(WHAT).map(Endpoint::State),
        };
        if self.at(T::Dot) && self.last_end == self.token.start && self.next.kind == T::Identifier {
            let cure = Cure::say(
                "a transition leads to a state of its own region; where it goes on inside that \
                    state says `initial -> …` in the container",
            );
            let part = self.span_of(self.next);
            let part = self.span_between(self.token.start, part.end);
            let fix = Fix::one("name the state of this region alone", Edit::remove(part));
            self.mended("`on`, `[`, `/` or `;`", cure.fix(fix));
            self.bump();
            self.bump();
        }
        target
    }

    pub(super) fn trigger(&mut self, source: Endpoint) -> Option<Trigger> {
        const WHAT: &str = "`pulse`, `*` or an event";
        let on = self.here();
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
            T::Exit | T::Timeout | T::Busy if self.next.kind == T::Integer => {
                self.limit(source, WHAT, on.start, self.token.end, "[timeout]");
                None
            }
            T::Exit | T::Timeout | T::Busy => {
                let word = self.text_of(self.token);
                let hint =
                    format!("`{word}` is no event but a flag of the state: write `[{word}]`");
                let cure = match self.guard_with(on, word) {
                    Some(fix) => Cure::say(hint).fix(fix),
                    None => Cure::say(hint),
                };
                self.mended(WHAT, cure);
                self.bump();
                None
            }
            T::Dot | T::Caret | T::Not | T::ParenthesisOpen => {
                self.bare_guard(WHAT, on.start, source);
                None
            }
            T::BracketOpen => {
                let word = self.span_between(on.start, span.start);
                let cure =
                    Cure::say("`on` names an event; a guard stands alone, `A -> B [guard];`");
                self.mended(
                    WHAT,
                    cure.fix(Fix::one("remove the `on`", Edit::remove(word))),
                );
                None
            }
            T::Integer => {
                self.limit(source, WHAT, on.start, span.start, "[timeout]");
                None
            }
            T::Identifier
                if self.at_any_case(&LIMIT_WORDS)
                    && matches!(self.next.kind, T::Integer | T::ParenthesisOpen) =>
            {
                self.limit(source, WHAT, on.start, span.end, "[timeout]");
                None
            }
            _ => {
                let event = self.name(WHAT).map(Trigger::Event);
                self.behind_event();
                event
            }
        }
    }

    /// What others write behind an event, and is none of it here.
    fn behind_event(&mut self) {
        let what = "`[`, `/` or `;`";
        match self.token.kind {
            T::ParenthesisOpen => {
                let close = self.next;
                let mut cure = Cure::say("events carry no values: `on E`");
                if close.kind == T::ParenthesisClose {
                    let both = self.span_between(self.last_end, close.end);
                    cure = cure.fix(Fix::one("remove the parentheses", Edit::remove(both)));
                }
                self.mended(what, cure);
                while !matches!(
                    self.token.kind,
                    T::ParenthesisClose | T::Semicolon | T::BraceClose | T::EndOfFile
                ) && !self.at_start_of_item()
                {
                    self.bump();
                }
                self.eat(T::ParenthesisClose);
            }
            T::Comma | T::Or | T::Unknown
                if self.next.kind == T::Identifier
                    && (!self.at(T::Unknown) || self.text_of(self.token).starts_with('|')) =>
            {
                let hint = "a transition has one event: write another transition for the other one";
                self.corrected(what, Some(hint.into()));
                self.bump();
                self.bump();
            }
            T::And if self.next.kind != T::Identifier => {
                self.corrected(
                    what,
                    Some("a guard stands in brackets behind the event: `on E [guard]`".into()),
                );
            }
            _ => {}
        }
    }

    /// A flag that stands from `on` to this token as a guard: alone, or with the guard that
    /// follows.
    fn guard_with(&self, on: Span, word: &str) -> Option<Fix> {
        let title = format!("write `[{word}]`");
        let part = self.span_between(on.start, self.token.end);
        if self.next.kind != T::BracketOpen {
            return Some(Fix::one(title, Edit::replace(part, format!("[{word}]"))));
        }
        let mut lexer = self.lexer_behind_next();
        for _ in 0..MAX_GUARD_TOKENS {
            let token = lexer.next_token();
            match token.kind {
                T::BracketClose => {
                    let open = self.span_between(part.start, self.next.end);
                    let edits = vec![
                        Edit::replace(open, format!("[{word} and (")),
                        Edit::before(self.span_of(token), ")"),
                    ];
                    return Some(Fix::new(title, edits));
                }
                T::Semicolon | T::BraceClose | T::EndOfFile => return None,
                _ => {}
            }
        }
        None
    }

    /// A limit of time where none stands: `after 5 s`, from byte `from` on. What stands before
    /// `time_from` is a word for it.
    /// `read` is what reads it in its place.
    fn limit(&mut self, source: Endpoint, what: &str, from: u32, time_from: u32, read: &str) {
        let diagnostic = Diagnostic::new(
            Code::E001,
            self.here(),
            format!("expected {what}, found {}", self.found()),
        )
        .hint(HOW_LIMITS_ARE);
        let is_told = self.is_told();
        self.report_nothing_here();
        while self.token.start < time_from {
            self.bump();
        }
        let is_in_brackets = self.eat(T::ParenthesisOpen);
        while matches!(self.token.kind, T::Equals | T::Colon | T::Unknown) {
            self.bump();
        }
        let mut time = None;
        if self.at(T::Integer) && self.next.kind == T::Identifier {
            let text = self.between(self.token.start, self.next.end);
            let unit = self.text_of(self.next);
            time = ["us", "ms", "s"].contains(&unit).then(|| text.to_owned());
            self.bump();
        } else if self.at(T::Integer) && self.next.kind != T::Identifier {
            time = Some(format!("{} s", self.text_of(self.token)));
        }
        if matches!(self.token.kind, T::Integer | T::Float | T::Identifier) {
            self.bump();
            if self.at(T::Identifier) && !self.at_new_line() {
                self.bump();
            }
        }
        if is_in_brackets {
            self.eat(T::ParenthesisClose);
        }
        if is_told {
            return;
        }
        let part = self.span_between(from, self.last_end);
        let source = match source {
            Endpoint::State(name) => Some(name),
            Endpoint::Pseudo => None,
        };
        let is_guarded = self.at(T::BracketOpen);
        let edits = vec![Edit::replace(part, read)];
        if self.limits.len() >= MAX_LIMITS {
            return self.sink.push(diagnostic);
        }
        self.limits.push(Limit {
            source: source.filter(|_| !is_guarded),
            time,
            diagnostic,
            edits,
        });
    }

    /// A guard without its brackets, from this token on; what stands before it from byte `from` on
    /// goes. Gives whether it could be read.
    fn bare_guard(&mut self, what: &str, from: u32, source: Endpoint) -> Option<GuardTerm> {
        let (found, at) = (self.found(), self.here());
        let is_told = self.is_told();
        self.report_nothing_here();
        self.guard_has_gaps = false;
        let guard = self.guard(0, source).ok();
        let has_gaps = std::mem::take(&mut self.guard_has_gaps);
        let mut diagnostic =
            Diagnostic::new(Code::E001, at, format!("expected {what}, found {found}"))
                .hint("a guard stands in brackets: `A -> B [guard];`");
        if guard.is_some() {
            let open = self.span_between(from, at.start);
            let mut edits = vec![Edit::replace(open, "[")];
            if !self.eat(T::BracketClose) {
                edits.push(Edit::replace(self.behind_last(), "]"));
            }
            diagnostic = diagnostic.fix(Fix::new("write the brackets", edits));
        }
        if !is_told {
            self.sink.push(diagnostic);
        }
        guard.filter(|_| !has_gaps)
    }

    /// A part of a transition as other tools write it. Gives whether there was one.
    fn foreign_part(&mut self, transition: &mut Transition, expected: &str) -> bool {
        let here = self.here();
        let source = transition.source;
        let is_free = !transition.guard.is_given();
        let has_trigger = transition.trigger.is_given();
        let is_near = !self.at_new_line();
        match self.token.kind {
            T::Timeout if self.next.kind == T::Integer || self.next.kind == T::ParenthesisOpen => {
                self.limit(source, expected, here.start, here.end, "[timeout]");
                set_if_absent(&mut transition.guard, Given::Broken);
            }
            T::Timeout | T::Dot | T::Caret | T::Not | T::ParenthesisOpen if is_free => {
                let guard = self.bare_guard(expected, here.start, source);
                transition.guard = Given::from_read(guard);
            }
            T::Exit | T::Busy if is_free && is_near => {
                let guard = self.bare_guard(expected, here.start, source);
                transition.guard = Given::from_read(guard);
            }
            T::Identifier if self.next.kind == T::Arrow => return false,
            T::Identifier
                if self.at_any_case(&LIMIT_WORDS)
                    && matches!(self.next.kind, T::Integer | T::Float | T::ParenthesisOpen) =>
            {
                self.limit(source, expected, here.start, here.end, "[timeout]");
                set_if_absent(&mut transition.guard, Given::Broken);
            }
            T::Identifier if is_free && self.at_any_case(&["if", "when", "where", "while"]) => {
                self.guard_behind_word(transition, expected);
            }
            T::Identifier if self.at_any_case(&["else", "otherwise", "default"]) => {
                let word = self.span_between(self.last_end, here.end);
                let hint = "a transition without a guard, written behind the others, is taken \
                    where theirs are not true";
                let fix = Fix::one("remove the word", Edit::remove(word));
                self.mended(expected, Cure::say(hint).fix(fix));
                self.bump();
            }
            T::Identifier
                if self.at_any_case(&["do", "then", "action"])
                    && matches!(self.next.kind, T::Send | T::Set | T::Clear) =>
            {
                self.mended(
                    expected,
                    Cure::say("actions stand behind `/`").fix(Fix::write(here, "/")),
                );
                self.bump();
                self.action_list(&mut transition.actions);
            }
            T::BraceOpen => {
                self.lost(
                    expected,
                    Cure::say("what a transition does stands behind `/`"),
                );
                return false;
            }
            T::Event if self.next.kind == T::Identifier && !has_trigger && is_near => {
                self.mended(expected, Cure::write(here, "on"));
                self.bump();
                self.bump();
                transition.trigger = Given::Broken;
            }
            T::Colon if self.next.kind == T::Identifier && !has_trigger && is_free => {
                let sign = self.span_between(self.last_end, self.next.start);
                let cure = Cure::say("an event stands behind `on`: `A -> B on E;`");
                let fix = Fix::one("write `on`", Edit::replace(sign, " on "));
                self.mended(expected, cure.fix(fix));
                self.bump();
                self.bump();
                transition.trigger = Given::Broken;
            }
            T::Colon if matches!(self.next.kind, T::BracketOpen | T::Slash) => {
                let sign = self.span_between(self.last_end, self.token.end);
                let cure = Cure::say("no sign stands before the parts of a transition");
                let fix = Fix::one("remove the `:`", Edit::remove(sign));
                self.mended(expected, cure.fix(fix));
                self.bump();
            }
            T::Identifier
                if !has_trigger
                    && is_free
                    && is_near
                    && matches!(self.next.kind, T::Semicolon | T::BracketOpen | T::Slash)
                    && meant(self.text_of(self.token), &["on", "timeout", "exit", "busy"])
                        .is_none() =>
            {
                let name = excerpt(self.text_of(self.token));
                let cure = Cure::say(format!(
                    "an event stands behind `on`, `on {name}`; a flag in brackets, `[.{name}]`"
                ));
                let insert = Edit::before(here, "on ");
                let fix = Fix::one(format!("write `on {name}`"), insert);
                let brackets = Edit::replace(here, format!("[.{name}]"));
                let other = Fix::one(format!("write `[.{name}]`"), brackets);
                self.mended(expected, cure.fix(fix).fix(other));
                self.bump();
                transition.trigger = Given::Broken;
            }
            _ => return false,
        }
        true
    }

    /// `if .f`, `when (.f)`, `if [.f]`, `when E`.
    fn guard_behind_word(&mut self, transition: &mut Transition, expected: &str) {
        let word = self.here();
        let source = transition.source;
        let cure = Cure::say("a guard stands in brackets, `[.f]`; an event behind `on`, `on E`");
        match self.next.kind {
            T::BracketOpen => {
                let part = self.span_between(self.last_end, word.end);
                let fix = Fix::one("remove the word", Edit::remove(part));
                self.mended(expected, cure.fix(fix));
                self.bump();
                self.report_nothing_here();
            }
            T::Identifier if !transition.trigger.is_given() => {
                self.mended(expected, cure.fix(Fix::write(word, "on")));
                self.bump();
                self.bump();
                transition.trigger = Given::Broken;
            }
            _ => {
                self.bump();
                let guard = self.bare_guard(expected, word.start, source);
                transition.guard = Given::from_read(guard);
            }
        }
    }

    /// `[guard]`
    pub(super) fn bracketed_guard(&mut self, source: Endpoint) -> Option<GuardTerm> {
        let open = self.here();
        self.bump();
        if self.at(T::BracketClose) {
            let brackets = self.span_between(open.start, self.token.end);
            let cure = Cure::say("a transition without a guard has no brackets");
            let fix = Fix::one("remove the brackets", Edit::remove(brackets));
            self.mended(
                "a guard: `exit`, `timeout`, `busy`, `.flag` or `^flag`",
                cure.fix(fix),
            );
            self.bump();
            return None;
        }
        self.guard_has_gaps = false;
        let guard = self.guard(0, source).ok();
        let has_gaps = std::mem::take(&mut self.guard_has_gaps);
        let is_closed = guard.is_some() && self.close_guard();
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
        guard.filter(|_| !has_gaps)
    }

    /// The `]` of a guard. Where only that is missing, what follows is read.
    fn close_guard(&mut self) -> bool {
        const WHAT: &str = "`and`, `or` or `]`";
        if matches!(self.token.kind, T::Slash | T::Semicolon) {
            let close = Edit::replace(self.behind_last(), "]");
            let cure = Cure::default().fix(Fix::one("write the missing `]`", close));
            self.lost(WHAT, cure);
            return false;
        }
        self.expect(T::BracketClose, WHAT)
    }

    pub(super) fn guard(
        &mut self,
        depth: usize,
        source: Endpoint,
    ) -> Result<GuardTerm, BrokenGuard> {
        self.terms(T::Or, |parser| {
            parser.terms(T::And, |parser| parser.negation(depth, source))
        })
    }

    /// One or more terms with the same word between them.
    pub(super) fn terms(
        &mut self,
        between: T,
        mut term: impl FnMut(&mut Self) -> Result<GuardTerm, BrokenGuard>,
    ) -> Result<GuardTerm, BrokenGuard> {
        let start = self.here();
        let first = term(self)?;
        if !self.at(between) && !self.at_foreign_word(between) {
            return Ok(first);
        }
        let mut terms = vec![first];
        while self.eat(between) || self.eat_foreign_word(between) {
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

    /// Whether `&&`, `||` or the like stands here for a word.
    fn at_foreign_word(&self, word: T) -> bool {
        let (letters, sign) = if word == T::And {
            ("and", '&')
        } else {
            ("or", '|')
        };
        match self.token.kind {
            T::Unknown => self.text_of(self.token).starts_with(sign),
            _ => self.at_any_case(&[letters]),
        }
    }

    fn eat_foreign_word(&mut self, word: T) -> bool {
        if !self.at_foreign_word(word) {
            return false;
        }
        let letters = if word == T::And { "and" } else { "or" };
        // `&&!`
        let negations = self.text_of(self.token).matches(['!', '~']).count();
        self.guard_has_gaps |= negations > 0;
        let meant = format!("{letters}{}", " not".repeat(negations));
        let place = self.span_between(self.last_end, self.next.start);
        let cure = Cure::say(format!("write `{meant}`"));
        let fix = Fix::one(
            format!("write `{meant}`"),
            Edit::replace(place, format!(" {meant} ")),
        );
        self.mended("`and`, `or` or `]`", cure.fix(fix));
        self.bump();
        true
    }

    pub(super) fn negation(
        &mut self,
        depth: usize,
        source: Endpoint,
    ) -> Result<GuardTerm, BrokenGuard> {
        let start = self.here();
        let mut negations = 0;
        loop {
            if self.at(T::Not) {
                self.check_depth(depth + negations)?;
                self.bump();
                negations += 1;
            } else if self.at(T::Unknown)
                && self
                    .text_of(self.token)
                    .chars()
                    .all(|it| it == '!' || it == '~')
                || self.at_any_case(&["not"])
            {
                let sign = self.span_between(self.token.start, self.next.start);
                let is_word = self.at(T::Identifier);
                let count = if is_word {
                    1
                } else {
                    self.token.end - self.token.start
                };
                let cure = Cure::say("write `not`");
                let meant = "not ".repeat(count as usize);
                let fix = Fix::one("write `not`", Edit::replace(sign, meant));
                self.mended("a guard", cure.fix(fix));
                self.guard_has_gaps = true;
                self.bump();
            } else {
                break;
            }
        }
        let mut term = self.atom(depth + negations, source)?;
        for _ in 0..negations {
            term = GuardTerm {
                span: self.since(start),
                kind: GuardKind::Not(Box::new(term)),
            };
        }
        Ok(term)
    }

    pub(super) fn check_depth(&mut self, depth: usize) -> Result<(), BrokenGuard> {
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

    pub(super) fn atom(
        &mut self,
        depth: usize,
        source: Endpoint,
    ) -> Result<GuardTerm, BrokenGuard> {
        const WHAT: &str = "a guard";
        let start = self.here();
        let kind = match self.token.kind {
            T::Timeout
                if matches!(self.next.kind, T::Integer | T::Equals)
                    || self.next.kind == T::Unknown
                        && self.text_of(self.next).starts_with(['<', '>']) =>
            {
                return self.limit_in_guard(source);
            }
            T::Exit => GuardKind::System(SystemFlag::Exit),
            T::Timeout => GuardKind::System(SystemFlag::Timeout),
            T::Busy => GuardKind::System(SystemFlag::Busy),
            T::Dot | T::Caret => {
                let is_own = self.at(T::Dot);
                self.bump();
                let name = self.name("the name of a flag").ok_or(BrokenGuard)?;
                let term = GuardTerm {
                    span: self.since(start),
                    kind: if is_own {
                        GuardKind::Own(name)
                    } else {
                        GuardKind::Parent(name)
                    },
                };
                self.comparison(start)?;
                return Ok(term);
            }
            T::ParenthesisOpen => {
                self.check_depth(depth)?;
                self.bump();
                let inner = self.guard(depth + 1, source)?;
                if !self.expect(T::ParenthesisClose, "`and`, `or` or `)`") {
                    return Err(BrokenGuard);
                }
                return Ok(GuardTerm {
                    span: self.since(start),
                    ..inner
                });
            }
            T::Identifier
                if self.at_any_case(&LIMIT_WORDS)
                    && matches!(self.next.kind, T::Integer | T::ParenthesisOpen) =>
            {
                return self.limit_in_guard(source);
            }
            T::Identifier if self.next.kind == T::Dot => {
                let [flag] = self.ahead();
                let named = self.text_of(self.token);
                let is_source = match source {
                    Endpoint::State(name) => self.between(name.0.start, name.0.end) == named,
                    Endpoint::Pseudo => false,
                };
                let cure = if is_source {
                    let cure = Cure::say("a flag of the state that is left is written `.f`");
                    let fix = Fix::one("leave the state out", Edit::remove(start));
                    cure.fix(fix)
                } else {
                    Cure::say(HOW_OTHERS_ARE_READ)
                };
                self.mended(WHAT, cure);
                self.bump();
                if flag.kind != T::Identifier {
                    return Err(BrokenGuard);
                }
                self.bump();
                self.bump();
                return Ok(self.unknown_term(start));
            }
            T::Identifier => {
                let words = ["exit", "timeout", "busy", "not"];
                let word = meant(self.text_of(self.token), &words);
                let is_exit = self.at_any_case(&["finished", "done", "completed"]);
                let cure = match word.or_else(|| is_exit.then_some("exit")) {
                    Some(word) => Cure::meant(start, word),
                    None => self.cure_of_flag(),
                };
                self.mended(WHAT, cure);
                self.bump();
                self.comparison(start)?;
                return Ok(self.unknown_term(start));
            }
            _ => {
                self.expected("a guard: `exit`, `timeout`, `busy`, `.flag` or `^flag`");
                return Err(BrokenGuard);
            }
        };
        self.bump();
        Ok(GuardTerm { span: start, kind })
    }

    /// A term that stands for what is not known.
    fn unknown_term(&mut self, start: Span) -> GuardTerm {
        self.guard_has_gaps = true;
        GuardTerm {
            span: self.since(start),
            kind: GuardKind::And(Vec::new()),
        }
    }

    /// `[after 5 s]`, `[timeout > 5 s]`
    fn limit_in_guard(&mut self, source: Endpoint) -> Result<GuardTerm, BrokenGuard> {
        let start = self.here();
        self.limit(source, "a guard", start.start, start.end, "timeout");
        Ok(self.unknown_term(start))
    }

    /// `.f == true`: a flag that is compared. Flags are asked for by their names alone.
    fn comparison(&mut self, flag: Span) -> Result<(), BrokenGuard> {
        let is_sign = |parser: &Self| match parser.token.kind {
            T::Equals => true,
            T::Unknown => {
                let text = parser.text_of(parser.token);
                text.chars().all(|it| "!<>~".contains(it))
            }
            _ => false,
        };
        if !is_sign(self) {
            return Ok(());
        }
        let from = self.last_end;
        let mut lexer = Lexer::new_at(self.text, self.token.start);
        let mut signs = String::new();
        let value = loop {
            let token = lexer.next_token();
            match token.kind {
                T::Equals | T::Unknown => signs += self.text_of(token),
                _ => break token,
            }
        };
        let is_equal = match signs.as_str() {
            "=" | "==" | "===" => Some(true),
            "!=" | "!==" | "<>" | "~=" => Some(false),
            _ => None,
        };
        let is_set = match (value.kind, self.text_of(value)) {
            (T::True, _) | (T::Integer, "1") => Some(true),
            (T::False, _) | (T::Integer, "0") => Some(false),
            (T::Identifier, text) if text.eq_ignore_ascii_case("true") => Some(true),
            (T::Identifier, text) if text.eq_ignore_ascii_case("false") => Some(false),
            _ => None,
        };
        let part = self.span_between(from, value.end);
        let (Some(is_equal), Some(is_set)) = (is_equal, is_set) else {
            let hint = "guards compare nothing, they ask for flags: let a task compare, and set an \
                `out` flag";
            self.lost("`and`, `or` or `]`", Cure::say(hint));
            return Err(BrokenGuard);
        };
        let (hint, mut edits) = if is_equal == is_set {
            ("a flag is asked for by its name alone: `[.f]`", Vec::new())
        } else {
            (
                "that a flag is not set is written `[not .f]`",
                vec![Edit::before(flag, "not ")],
            )
        };
        edits.push(Edit::remove(part));
        let fix = Fix::new(hint, edits);
        self.mended("`and`, `or` or `]`", Cure::say(hint).fix(fix));
        while self.token.start <= value.start && !self.at(T::EndOfFile) {
            self.bump();
        }
        self.guard_has_gaps = true;
        Ok(())
    }

    /// A flag without its sign, and what it can be.
    fn cure_of_flag(&self) -> Cure {
        let here = self.here();
        let mut cure = Cure::say(self.how_to_write_a_flag());
        for sign in [".", "^"] {
            let title = format!("write `{sign}{}`", excerpt(self.text_of(self.token)));
            cure = cure.fix(Fix::one(title, Edit::before(here, sign)));
        }
        cure
    }

    /// A flag without its sign.
    pub(super) fn how_to_write_a_flag(&self) -> String {
        let name = excerpt(self.text_of(self.token));
        format!(
            "write `.{name}` for a flag of the state, `^{name}` for one of the container around it"
        )
    }

    /// `/ action, action`
    pub(super) fn actions(&mut self, actions: &mut Vec<Action>) {
        self.bump();
        self.action_list(actions);
    }

    fn action_list(&mut self, actions: &mut Vec<Action>) {
        loop {
            match self.token.kind {
                T::Send => {
                    self.bump();
                    if let Some(name) = self.name("the name of an event") {
                        actions.push(Action::Send(name));
                    }
                    if self.at(T::ParenthesisOpen) && self.next.kind == T::ParenthesisClose {
                        self.behind_event();
                    }
                }
                kind @ (T::Set | T::Clear) => {
                    self.bump();
                    self.written_flag(kind == T::Set, actions);
                }
                T::Identifier | T::Dot | T::Caret | T::Not => self.foreign_action(actions),
                _ => self.expected("`send`, `set` or `clear`"),
            }
            let is_and = self.at(T::And) || self.at(T::Unknown) && self.text_of(self.token) == "&&";
            if is_and && matches!(self.next.kind, T::Send | T::Set | T::Clear) {
                let word = self.span_between(self.last_end, self.token.end);
                let cure = Cure::say("several actions are separated by `,`");
                self.mended("`,` or `;`", cure.edit(Edit::replace(word, ",")));
                self.bump();
                continue;
            }
            if self.at(T::Comma) && self.next.kind == T::Semicolon {
                let remove = Edit::remove(self.here());
                self.bump();
                let cure = Cure::say("no `,` stands behind the last action");
                let fix = Fix::one("remove the `,`", remove);
                return self.mended("`send`, `set` or `clear`", cure.fix(fix));
            }
            if !self.eat(T::Comma) {
                return;
            }
        }
    }

    /// The flag behind `set` or `clear`.
    fn written_flag(&mut self, is_set: bool, actions: &mut Vec<Action>) {
        const WHAT: &str = "`.` or `^` and a flag";
        match self.token.kind {
            T::Dot | T::Caret => {
                let is_own = self.at(T::Dot);
                self.bump();
                let Some(name) = self.name("the name of a flag") else {
                    return;
                };
                actions.push(if is_own {
                    Action::Own(name, is_set)
                } else {
                    Action::Parent(name, is_set)
                });
                self.assigned_value();
            }
            T::Identifier if self.next.kind == T::Dot => {
                let hint = "an action sets flags of the state that is entered, `.f`, and of the \
                    container around it, `^f`; to tell another state something send an event";
                let fix = Fix::one("leave the state out", Edit::remove(self.here()));
                self.mended(WHAT, Cure::say(hint).fix(fix));
                self.bump();
                self.bump();
                self.name("the name of a flag");
                self.is_lost |= !matches!(self.token.kind, T::Comma | T::Semicolon);
            }
            T::Identifier => {
                self.mended(WHAT, self.cure_of_flag());
                self.bump();
                self.assigned_value();
            }
            _ => self.expected(WHAT),
        }
    }

    /// `set .f = true`
    fn assigned_value(&mut self) {
        if !self.at(T::Equals) || !matches!(self.next.kind, T::True | T::False) {
            return;
        }
        let mut cure = Cure::say("`set` and `clear` stand for the value: `set .f`, `clear .f`");
        if self.next.kind == T::True {
            let part = self.span_between(self.last_end, self.next.end);
            cure = cure.fix(Fix::one("remove the value", Edit::remove(part)));
        }
        self.mended("`,` or `;`", cure);
        self.bump();
        self.bump();
    }

    /// An action as other tools write it: `E`, `raise E`, `.f = true`, `not .f`.
    fn foreign_action(&mut self, actions: &mut Vec<Action>) {
        const WHAT: &str = "`send`, `set` or `clear`";
        const WORDS: [(&str, &str); 9] = [
            ("raise", "send"),
            ("emit", "send"),
            ("trigger", "send"),
            ("fire", "send"),
            ("signal", "send"),
            ("unset", "clear"),
            ("reset", "clear"),
            ("enable", "set"),
            ("disable", "clear"),
        ];
        let here = self.here();
        let text = self.text_of(self.token);
        let [third, fourth] = self.ahead();
        let word = WORDS
            .iter()
            .find(|(other, _)| other.eq_ignore_ascii_case(text))
            .map(|(_, word)| *word)
            .or_else(|| meant(text, &["send", "set", "clear"]));
        match self.token.kind {
            T::Identifier
                if word.is_some()
                    && matches!(self.next.kind, T::Identifier | T::Dot | T::Caret) =>
            {
                self.mended(WHAT, Cure::meant(here, word.unwrap_or_default()));
                self.bump();
                let is_flag = matches!(self.token.kind, T::Dot | T::Caret);
                if is_flag {
                    self.bump();
                }
                let name = self.name("a name");
                // It is clear what was meant: the event is sent.
                if let (Some(name), Some("send"), false) = (name, word, is_flag) {
                    actions.push(Action::Send(name));
                }
            }
            T::Identifier if matches!(self.next.kind, T::Comma | T::Semicolon) => {
                let name = excerpt(text);
                let hint = format!("write `send {name}` for an event, `set .{name}` for a flag");
                let insert = Edit::before(here, "send ");
                let fix = Fix::one(format!("write `send {name}`"), insert);
                self.mended(WHAT, Cure::say(hint).fix(fix));
                self.bump();
            }
            T::Dot | T::Caret if self.next.kind == T::Identifier => {
                let value = match (third.kind, fourth.kind) {
                    (T::Equals, T::True) => Some(("set ", Some(fourth.end))),
                    (T::Equals, T::False) => Some(("clear ", Some(fourth.end))),
                    (T::Comma | T::Semicolon, _) => Some(("set ", None)),
                    _ => None,
                };
                let mut cure = Cure::say("a flag is written with `set .f` and `clear .f`");
                if let Some((word, end)) = value {
                    let mut edits = vec![Edit::before(here, word)];
                    if let Some(end) = end {
                        edits.push(Edit::remove(self.span_between(self.next.end, end)));
                    }
                    cure = cure.fix(Fix::new(format!("write `{}`", word.trim_end()), edits));
                }
                self.lost(WHAT, cure);
            }
            T::Not if matches!(self.next.kind, T::Dot | T::Caret) => {
                self.mended(WHAT, Cure::write(here, "clear"));
                self.bump();
                self.bump();
                self.name("the name of a flag");
            }
            _ => self.expected(WHAT),
        }
    }
}
