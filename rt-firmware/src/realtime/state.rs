//! What the real-time side is made of.

use super::commands::Commands;
use super::execution::Execution;
use super::machine::Machine;
use super::observers::Observers;
use super::safety::Safety;
use super::timetable::Timetable;
use esm_link::message::Mode;

/// The real-time side of a runtime. Each of its parts has fields of its own, which nobody else
/// reaches into.
// In this order: what each slot needs lies at the beginning, within reach of the instructions that
// load two words at once.
#[repr(C)]
pub struct RealTime<'q, 'm> {
    pub(super) timetable: Timetable<'m>,
    pub(super) safety: Safety<'m>,
    pub(super) execution: Execution<'q, 'm>,
    pub(super) machine: Machine<'q, 'm>,
    pub(super) observers: Observers<'m>,
    pub(super) commands: Commands<'q, 'm>,
}

impl<'q, 'm> RealTime<'q, 'm> {
    pub(crate) fn new(
        timetable: Timetable<'m>,
        machine: Machine<'q, 'm>,
        execution: Execution<'q, 'm>,
        safety: Safety<'m>,
        observers: Observers<'m>,
        commands: Commands<'q, 'm>,
    ) -> Self {
        RealTime {
            timetable,
            machine,
            execution,
            safety,
            observers,
            commands,
        }
    }

    /// What the real-time side is doing.
    pub fn mode(&self) -> Mode {
        self.safety.mode()
    }
}
