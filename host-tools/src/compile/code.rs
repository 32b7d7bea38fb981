//! Guards and actions as code.
//!
//! A guard becomes a row of tests, each of which jumps or goes on with the next: `a and (b or not c)` is
//!
//! ```text
//! 0  a is clear -> false
//! 1  b is set   -> 3
//! 2  c is set   -> false
//! 3  (true)
//! ```
//!
//! so no test is made whose outcome cannot matter, and evaluation needs no stack.

use esm_core::format::{
    CODE_CLEAR, CODE_END, CODE_JUMP_IF_BUSY_INSIDE, CODE_JUMP_IF_CLEAR, CODE_JUMP_IF_IDLE_INSIDE,
    CODE_JUMP_IF_SET, CODE_OPERATION_SHIFT, CODE_SEND, CODE_SET, CONTAINER_CONTROL_FLAGS,
    FLAG_BUSY, FLAG_EXIT, FLAG_TIMEOUT, MAX_JUMP, TASK_CONTROL_FLAGS,
};

use super::layout::{ContainerLayout, StateLayout};
use super::{Capacity, CompileError, Table, within};
use crate::model::{Action, Guard, Span, State, StateKind, Transition, Trigger};

/// A state with its layout, as the flags of a transition's source or target.
#[derive(Clone, Copy)]
pub(super) struct Flags<'a> {
    /// What the model says.
    pub state: &'a State,
    /// Where it begins.
    pub layout: &'a StateLayout,
}

impl Flags<'_> {
    fn is_super(&self) -> bool {
        matches!(self.state.kind, StateKind::Super { .. })
    }

    fn is_simple(&self) -> bool {
        matches!(self.state.kind, StateKind::Simple)
    }

    fn exit(&self) -> Option<usize> {
        (!self.is_simple()).then_some(self.layout.begin.flags + FLAG_EXIT)
    }

    fn timeout(&self) -> usize {
        let bit = if self.is_simple() { 0 } else { FLAG_TIMEOUT };
        self.layout.begin.flags + bit
    }

    fn control(&self, flag: usize) -> Option<usize> {
        let first = match self.state.kind {
            StateKind::Simple => return None,
            StateKind::Task { .. } => TASK_CONTROL_FLAGS,
            StateKind::Super { .. } => CONTAINER_CONTROL_FLAGS,
        };
        (first + flag < self.layout.flags).then_some(self.layout.begin.flags + first + flag)
    }
}

/// Where a test jumps to.
#[derive(Clone, Copy)]
enum Label {
    /// The guard is false.
    False,
    /// An index into [`Tests::labels`].
    Local(usize),
}

struct Test {
    operand: usize,
    /// Operation if it jumps on a set flag; the one below it jumps on a clear one.
    operation: u16,
    to: Label,
}

/// A guard in the making.
struct Tests<'a> {
    source: Option<Flags<'a>>,
    span: Span,
    tests: Vec<Test>,
    /// Positions in `tests`.
    labels: Vec<usize>,
}

impl Tests<'_> {
    /// Appends tests that jump to `to` if the guard is `jump_if`, and otherwise go on behind them.
    fn append(&mut self, guard: &Guard, jump_if: bool, to: Label) -> Result<(), CompileError> {
        match guard {
            Guard::Not(inner) => self.append(inner, !jump_if, to),
            Guard::And(terms) => self.append_terms(terms, false, jump_if, to),
            Guard::Or(terms) => self.append_terms(terms, true, jump_if, to),
            atom => self.append_atom(atom, jump_if, to),
        }
    }

    /// Terms of which one that is `decisive` decides the whole.
    fn append_terms(
        &mut self,
        terms: &[Guard],
        decisive: bool,
        jump_if: bool,
        to: Label,
    ) -> Result<(), CompileError> {
        if decisive == jump_if {
            return terms
                .iter()
                .try_for_each(|term| self.append(term, jump_if, to));
        }
        let Some((last, earlier)) = terms.split_last() else {
            return Err(CompileError::Contradiction(self.span));
        };
        let behind = self.labels.len();
        self.labels.push(0);
        for term in earlier {
            self.append(term, decisive, Label::Local(behind))?;
        }
        self.append(last, jump_if, to)?;
        self.labels[behind] = self.tests.len();
        Ok(())
    }

    fn append_atom(&mut self, atom: &Guard, jump_if: bool, to: Label) -> Result<(), CompileError> {
        let source = self.source;
        let exit = source.and_then(|source| source.exit());
        let (operand, set, clear) = match *atom {
            Guard::Busy if source.is_some_and(|source| source.is_super()) => {
                (Some(0), CODE_JUMP_IF_BUSY_INSIDE, CODE_JUMP_IF_IDLE_INSIDE)
            }
            ref flag => {
                let operand = match *flag {
                    Guard::Exit => exit,
                    Guard::Busy => exit.map(|exit| exit + FLAG_BUSY),
                    Guard::Timeout => source.map(|source| source.timeout()),
                    Guard::Own(flag) => source.and_then(|source| source.control(flag)),
                    Guard::Parent(flag) => Some(CONTAINER_CONTROL_FLAGS + flag),
                    _ => None,
                };
                (operand, CODE_JUMP_IF_SET, CODE_JUMP_IF_CLEAR)
            }
        };
        self.tests.push(Test {
            operand: operand.ok_or(CompileError::Contradiction(self.span))?,
            operation: if jump_if { set } else { clear },
            to,
        });
        Ok(())
    }
}

/// Appends the code of a transition to `code`. Returns whether it has any.
pub(super) fn append(
    code: &mut Table,
    container: &ContainerLayout,
    transition: &Transition,
    source: Option<Flags<'_>>,
    target: Option<Flags<'_>>,
) -> Result<bool, CompileError> {
    let mut tests = Tests {
        source,
        span: transition.span,
        tests: Vec::new(),
        labels: Vec::new(),
    };
    let star = (transition.trigger == Trigger::Star).then_some(&Guard::Exit);
    for guard in star.into_iter().chain(&transition.guard) {
        tests.append(guard, false, Label::False)?;
    }
    let Tests { tests, labels, .. } = tests;
    within(Capacity::GuardTests, tests.len(), usize::from(MAX_JUMP))
        .map_err(|error| error.at(transition.span))?;
    for (at, test) in tests.iter().enumerate() {
        let jump = match test.to {
            Label::False => 0,
            Label::Local(label) => labels[label] - at,
        };
        append_instruction(code, test.operand, test.operation, jump);
    }
    for (at, action) in transition.actions.iter().enumerate() {
        let is_last = at + 1 == transition.actions.len();
        let write = |value| if value { CODE_SET } else { CODE_CLEAR };
        let (operand, operation) = match *action {
            Action::Send(event) => (
                container.sent.iter().position(|sent| *sent == event),
                CODE_SEND,
            ),
            Action::Own(flag, value) => {
                (target.and_then(|target| target.control(flag)), write(value))
            }
            Action::Parent(flag, value) => (Some(CONTAINER_CONTROL_FLAGS + flag), write(value)),
        };
        let operand = operand.ok_or(CompileError::Contradiction(transition.span))?;
        append_instruction(code, operand, operation, usize::from(is_last));
    }
    if transition.actions.is_empty() && !tests.is_empty() {
        append_instruction(code, 0, CODE_END, 0);
    }
    Ok(!tests.is_empty() || !transition.actions.is_empty())
}

fn append_instruction(code: &mut Table, operand: usize, operation: u16, low: usize) {
    let control = usize::from(operation) << CODE_OPERATION_SHIFT | low;
    code.words([operand, control]);
}
