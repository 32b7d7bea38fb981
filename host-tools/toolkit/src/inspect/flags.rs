//! What a flag bit is called where a transition tests or writes it.

use esm_core::format::{
    CONTAINER_CONTROL_FLAGS, FLAG_BUSY, FLAG_EXIT, FLAG_TIMEOUT, TASK_CONTROL_FLAGS,
};
use esm_core::tables::{State, StateKind};

/// A flag, seen from a transition that leaves or enters a state.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Flag {
    /// `exit` of the state.
    Exit,
    /// `timeout` of the state.
    Timeout,
    /// `busy` of the task state.
    Busy,
    /// A control flag of the state's task or container, by its place among them.
    Own(usize),
    /// A control flag of the container around, by its place among them.
    Parent(usize),
    /// A bit that no transition of this language can name; a verified blob may use it all the same.
    Nameless,
}

impl Flag {
    /// The flag behind a bit that is counted from the first of the instance. `container_flags` are
    /// the control flags of the container around.
    pub(super) fn of(state: &State, container_flags: usize, bit: usize) -> Self {
        match bit.checked_sub(state.first_flag) {
            Some(offset) if offset < state.flags => Self::of_state(state.kind, offset),
            _ => match bit.checked_sub(CONTAINER_CONTROL_FLAGS) {
                Some(control) if control < container_flags => Self::Parent(control),
                _ => Self::Nameless,
            },
        }
    }

    fn of_state(kind: StateKind, offset: usize) -> Self {
        match (kind, offset) {
            (StateKind::Task { .. }, FLAG_BUSY) => Self::Busy,
            (StateKind::Task { .. } | StateKind::Super { .. }, FLAG_EXIT) => Self::Exit,
            (StateKind::Task { .. } | StateKind::Super { .. }, FLAG_TIMEOUT) => Self::Timeout,
            (StateKind::Task { .. }, _) => Self::Own(offset - TASK_CONTROL_FLAGS),
            (StateKind::Super { .. }, _) => Self::Own(offset - CONTAINER_CONTROL_FLAGS),
            (StateKind::Simple, _) => Self::Timeout,
            (StateKind::Initial | StateKind::Final, _) => Self::Nameless,
        }
    }
}
