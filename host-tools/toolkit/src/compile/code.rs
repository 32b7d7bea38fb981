//! Guards and actions.
//!
//! A guard gets the cheapest form that fits. Most ask for flags of the state that is left: one of
//! them is a number, a conjunction of several is a mask and a value. What else there is becomes a
//! program: a row of tests, each of which jumps or goes on with the next. `^a and (.b or not .c)`
//! is
//!
//! ```text
//! 0  a is clear -> false
//! 1  b is set   -> 3
//! 2  c is set   -> false
//! 3  (true)
//! ```
//!
//! so no test is made whose outcome cannot matter, and evaluation needs no stack. All forms look
//! through nesting and negation: how a guard is written makes no difference.
//!
//! Of actions, one `send` is a number too; all others are a row.

use esm_core::format::{
    ACTION_NONE, ACTION_ROW, ACTION_SEND, CODE_CLEAR, CODE_END, CODE_JUMP_IF_BUSY_INSIDE,
    CODE_JUMP_IF_CLEAR, CODE_JUMP_IF_IDLE_INSIDE, CODE_JUMP_IF_SET, CODE_OPERATION_SHIFT,
    CODE_SEND, CODE_SET, CONTAINER_CONTROL_FLAGS, FLAG_BUSY, FLAG_EXIT, FLAG_TIMEOUT,
    GUARD_IF_CLEAR, GUARD_MASK, GUARD_PROGRAM, GUARD_TRUE, MAX_CODE, MAX_JUMP, TASK_CONTROL_FLAGS,
    WINDOW_FLAGS,
};
use esm_core::layout::{Code, Mask, Short};

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

    pub(super) fn is_simple(&self) -> bool {
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

    /// The bit of the window in which a guard finds one of the state's own flags, if it is one that
    /// the window has.
    fn window_bit(&self, flag: &Guard) -> Option<u16> {
        let bit = match *flag {
            Guard::Exit => self.exit(),
            // That of a superstate is worked out from what is inside.
            Guard::Busy if self.is_super() => None,
            Guard::Busy => self.exit().map(|exit| exit + FLAG_BUSY),
            Guard::Timeout => Some(self.timeout()),
            Guard::Own(flag) => self.control(flag),
            Guard::Parent(_) | Guard::Not(_) | Guard::And(_) | Guard::Or(_) => None,
        };
        let place = bit?.checked_sub(self.layout.begin.flags)?;
        (place < usize::from(WINDOW_FLAGS)).then_some(place as u16)
    }
}

/// The bits of the window that a conjunction wants to be set, and those that it wants to be clear.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Conjunction {
    set: u16,
    clear: u16,
}

impl Conjunction {
    /// What a guard wants, if nothing else can make it true.
    fn of(guard: &Guard, source: Flags<'_>) -> Option<Self> {
        let mut found = Self::default();
        let is_whole = found.add(guard, true, source);
        // One that contradicts itself has no mask: no value could be false for sure.
        (is_whole && found != Self::default() && found.set & found.clear == 0).then_some(found)
    }

    /// Adds what makes the guard have a value; false if that is no conjunction of flags in the
    /// window.
    fn add(&mut self, guard: &Guard, value: bool, source: Flags<'_>) -> bool {
        match (guard, value) {
            (Guard::Not(inner), _) => self.add(inner, !value, source),
            (Guard::And(terms), true) | (Guard::Or(terms), false) => {
                terms.iter().all(|term| self.add(term, value, source))
            }
            (Guard::And(_), false) | (Guard::Or(_), true) => false,
            (flag, _) => match source.window_bit(flag) {
                Some(bit) => {
                    let wanted = if value {
                        &mut self.set
                    } else {
                        &mut self.clear
                    };
                    *wanted |= 1 << bit;
                    true
                }
                None => false,
            },
        }
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

/// Appends the code of a transition's guard, if it needs any. Returns the guard as the transition
/// names it.
pub(super) fn append_guard(
    code: &mut Table,
    transition: &Transition,
    source: Option<Flags<'_>>,
) -> Result<u16, CompileError> {
    let guard = match (&transition.guard, transition.trigger) {
        (Some(guard), _) => guard,
        (None, Trigger::Star) => &Guard::Exit,
        (None, _) => return Ok(GUARD_TRUE),
    };
    let start = records(code);
    match source.and_then(|source| Conjunction::of(guard, source)) {
        Some(Conjunction { set, clear: 0 }) if set.is_power_of_two() => {
            Ok(set.trailing_zeros() as u16)
        }
        Some(Conjunction { set: 0, clear }) if clear.is_power_of_two() => {
            Ok(GUARD_IF_CLEAR + clear.trailing_zeros() as u16)
        }
        Some(Conjunction { set, clear }) => {
            code.push(Mask {
                mask: (set | clear).into(),
                value: set.into(),
            });
            number(code, transition, GUARD_MASK, start)
        }
        None => {
            append_program(code, guard, transition, source)?;
            number(code, transition, GUARD_PROGRAM, start)
        }
    }
}

/// Appends a guard as tests, and their end.
fn append_program(
    code: &mut Table,
    guard: &Guard,
    transition: &Transition,
    source: Option<Flags<'_>>,
) -> Result<(), CompileError> {
    let mut tests = Tests {
        source,
        span: transition.span,
        tests: Vec::new(),
        labels: Vec::new(),
    };
    tests.append(guard, false, Label::False)?;
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
    append_instruction(code, 0, CODE_END, 0);
    Ok(())
}

/// Appends the code of a transition's actions, if they need any. Returns the action as the
/// transition names it.
pub(super) fn append_actions(
    code: &mut Table,
    container: &ContainerLayout,
    transition: &Transition,
    target: Option<Flags<'_>>,
) -> Result<u16, CompileError> {
    let start = records(code);
    let instruction = |action: &Action| {
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
        Ok((operand, operation))
    };
    match &transition.actions[..] {
        [] => Ok(ACTION_NONE),
        [send @ Action::Send(_)] => {
            let (channel, _) = instruction(send)?;
            // A container sends no more events than there are numbers for, and these have 15 bits
            // too.
            Ok(ACTION_SEND | channel as u16)
        }
        actions => {
            for (at, action) in actions.iter().enumerate() {
                let is_last = at + 1 == actions.len();
                let (operand, operation) = instruction(action)?;
                append_instruction(code, operand, operation, usize::from(is_last));
            }
            number(code, transition, ACTION_ROW, start)
        }
    }
}

fn records(code: &Table) -> usize {
    code.bytes.len() / size_of::<Code>()
}

/// The number of what begins at a code record, after the last record of it was written.
fn number(
    code: &Table,
    transition: &Transition,
    first: u16,
    start: usize,
) -> Result<u16, CompileError> {
    within(Capacity::Code, records(code), MAX_CODE).map_err(|error| error.at(transition.span))?;
    Ok(first + start as u16)
}

fn append_instruction(code: &mut Table, operand: usize, operation: u16, low: usize) {
    let control = usize::from(operation) << CODE_OPERATION_SHIFT | low;
    code.push(Code {
        operand: Short::new(operand),
        control: (control as u16).into(),
    });
}
