//! Transitions: triggers, guards, actions.

use crate::lang::diagnostic::{Code, Diagnostic};
use crate::lang::lexer::TokenKind as T;
use crate::lang::tree::{
    Action, Endpoint, Given, GuardKind, GuardTerm, Region, SystemFlag, Transition, Trigger,
};

use super::values::excerpt;
use super::{BrokenGuard, MAX_GUARD_DEPTH, Parser, set_if_absent};

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

        if !self.expect(T::Arrow, "`->`") {
            // `A - > B`, `A => B`: the target is behind the broken arrow.
            while matches!(
                self.token.kind,
                T::Minus | T::Equals | T::Unknown | T::Colon | T::Comma | T::Dot
            ) {
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
        let target = match self.token.kind {
            T::Final => {
                self.bump();
                Some(Endpoint::Pseudo)
            }
            T::Initial => {
                self.corrected(
                    "a state or `final`",
                    Some("`initial` can only be left".into()),
                );
                self.bump();
                None
            }
            _ => self.name("a state or `final`").map(Endpoint::State),
        };

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
                        self.corrected(
                            expected,
                            Some("the parts of a transition are `on E [guard] / actions`, in this order".into()),
                        );
                    }
                    let read = Given::from_read(self.trigger());
                    set_if_absent(&mut transition.trigger, read);
                    if !has_actions && !transition.guard.is_given() {
                        expected = "`[`, `/` or `;`";
                    }
                }
                T::BracketOpen => {
                    if transition.guard.is_given() || has_actions {
                        self.corrected(
                            expected,
                            Some("the parts of a transition are `on E [guard] / actions`, in this order".into()),
                        );
                    }
                    let read = Given::from_read(self.bracketed_guard());
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
                _ => break,
            }
        }
        self.end_statement(expected);
        transition.span = self.since(start);
        region.transitions.push(transition);
    }

    pub(super) fn trigger(&mut self) -> Option<Trigger> {
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
            _ => self.name("`pulse`, `*` or an event").map(Trigger::Event),
        }
    }

    /// `[guard]`
    pub(super) fn bracketed_guard(&mut self) -> Option<GuardTerm> {
        self.bump();
        let guard = self.guard(0).ok();
        let is_closed = guard.is_some() && self.expect(T::BracketClose, "`and`, `or` or `]`");
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
        guard
    }

    pub(super) fn guard(&mut self, depth: usize) -> Result<GuardTerm, BrokenGuard> {
        self.terms(T::Or, |parser| {
            parser.terms(T::And, |parser| parser.negation(depth))
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
        if !self.at(between) {
            return Ok(first);
        }
        let mut terms = vec![first];
        while self.eat(between) {
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

    pub(super) fn negation(&mut self, depth: usize) -> Result<GuardTerm, BrokenGuard> {
        let start = self.here();
        let mut negations = 0;
        while self.at(T::Not) {
            self.check_depth(depth + negations)?;
            self.bump();
            negations += 1;
        }
        let mut term = self.atom(depth + negations)?;
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

    pub(super) fn atom(&mut self, depth: usize) -> Result<GuardTerm, BrokenGuard> {
        let start = self.here();
        let kind = match self.token.kind {
            T::Exit => GuardKind::System(SystemFlag::Exit),
            T::Timeout => GuardKind::System(SystemFlag::Timeout),
            T::Busy => GuardKind::System(SystemFlag::Busy),
            T::Dot | T::Caret => {
                let is_own = self.at(T::Dot);
                self.bump();
                let name = self.name("the name of a flag").ok_or(BrokenGuard)?;
                return Ok(GuardTerm {
                    span: self.since(start),
                    kind: if is_own {
                        GuardKind::Own(name)
                    } else {
                        GuardKind::Parent(name)
                    },
                });
            }
            T::ParenthesisOpen => {
                self.check_depth(depth)?;
                self.bump();
                let inner = self.guard(depth + 1)?;
                if !self.expect(T::ParenthesisClose, "`and`, `or` or `)`") {
                    return Err(BrokenGuard);
                }
                return Ok(GuardTerm {
                    span: self.since(start),
                    ..inner
                });
            }
            T::Identifier => {
                let meant = self.meant_of("`exit`, `timeout`, `busy`, `not`");
                let hint = meant.unwrap_or_else(|| self.how_to_write_a_flag());
                self.expected_with("a guard", Some(hint));
                return Err(BrokenGuard);
            }
            _ => {
                self.expected("a guard: `exit`, `timeout`, `busy`, `.flag` or `^flag`");
                return Err(BrokenGuard);
            }
        };
        self.bump();
        Ok(GuardTerm { span: start, kind })
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
        loop {
            match self.token.kind {
                T::Send => {
                    self.bump();
                    if let Some(name) = self.name("the name of an event") {
                        actions.push(Action::Send(name));
                    }
                }
                kind @ (T::Set | T::Clear) => {
                    self.bump();
                    let is_set = kind == T::Set;
                    match self.token.kind {
                        T::Dot | T::Caret => {
                            let is_own = self.at(T::Dot);
                            self.bump();
                            if let Some(name) = self.name("the name of a flag") {
                                actions.push(if is_own {
                                    Action::Own(name, is_set)
                                } else {
                                    Action::Parent(name, is_set)
                                });
                            }
                        }
                        T::Identifier => {
                            self.corrected(
                                "`.` or `^` and a flag",
                                Some(self.how_to_write_a_flag()),
                            );
                            self.bump();
                        }
                        _ => self.expected("`.` or `^` and a flag"),
                    }
                }
                _ => self.expected("`send`, `set` or `clear`"),
            }
            if !self.eat(T::Comma) {
                return;
            }
        }
    }
}
