//! The transitions out of a state: events, targets, guards and actions.

use core::ops::Range;

use super::code::Scope;
use super::finding::{Entry, Finding};
use super::pass::Pass;
use crate::format::{self, Section};
use crate::layout::{State, Transition};
use crate::refusal::Cause;

/// The state whose transitions are checked, and what these can name.
pub(super) struct Source<'a> {
    pub(super) state: &'a Entry<'a, State>,
    /// Events of the mission.
    pub(super) events: usize,
    /// The states of its region.
    pub(super) region: Range<usize>,
    /// Flags at the head of its instance's block.
    pub(super) head: usize,
    /// Channels of its instance.
    pub(super) channels: usize,
}

/// What a state says of its transitions.
#[derive(Default)]
pub(super) struct Summary {
    /// Events that they are on, as bits.
    pub(super) events: u32,
    /// How many are on the pulse.
    pub(super) on_pulse: usize,
    /// How many of those, at the head, have guards that ask for one bit each, one behind the other.
    pub(super) row: usize,
}

impl Pass<'_> {
    /// Checks the transitions of a state, which are the next ones up to `end`.
    pub(super) fn check_transitions(
        &mut self,
        source: &Source<'_>,
        end: usize,
    ) -> Result<Summary, Finding> {
        let mut summary = Summary::default();
        let mut last_event = format::PULSE;
        let mut next_of_row = 0;
        while self.checked[Section::Transitions] < end {
            let transition = self.next::<Transition>(Cause::Index)?;
            let event = transition.event.get() & format::MAX_EVENT;
            let guard = transition.guard.get();
            summary.events |= 1 << (event % u32::BITS as u16);
            if event == format::PULSE {
                let is_first = summary.on_pulse == 0;
                let goes_on = summary.row == summary.on_pulse
                    && guard < format::GUARD_PROGRAM
                    && (is_first || guard == next_of_row);
                if goes_on {
                    summary.row += 1;
                    next_of_row = guard + 1;
                }
                summary.on_pulse += 1;
            }
            // They are sorted, and so the pulse comes first.
            transition.ensure(last_event <= event, Cause::Order)?;
            last_event = event;
            self.check_transition(source, &transition, event)?;
        }
        Ok(summary)
    }

    /// Checks what a transition says of itself, and its code.
    fn check_transition(
        &mut self,
        source: &Source<'_>,
        transition: &Entry<'_, Transition>,
        event: u16,
    ) -> Result<(), Finding> {
        let target_index = transition.target.get();
        let action = transition.action.get();
        // It leads to a state of its region, but not to `initial`; the channel that a single `send`
        // names exists.
        let exists = usize::from(event) <= source.events
            && source.region.start < target_index
            && target_index < source.region.end
            && usize::from(action) < usize::from(format::ACTION_SEND) + source.channels;
        transition.ensure(exists, Cause::Index)?;
        let target = self.entry::<State>(target_index, Cause::Kind)?;

        let is_marked = transition.event.get() & format::TRANSITION_IS_PLAIN != 0;
        let is_plain = changes_state_only(source.state, &target, action)
            || event == format::PULSE && enters_itself(source.state, target_index, action);
        transition.ensure(is_marked == is_plain, Cause::Kind)?;

        self.check_guard(source, transition)?;
        if action != format::ACTION_NONE && action < format::ACTION_SEND {
            // What is not for actions to write stands first.
            let protected = format::CONTAINER_CONTROL_FLAGS;
            let scope = Scope {
                operations: format::CODE_SEND..format::CODE_SET + 1,
                head: protected..source.head,
                own: target.own_flags(protected),
                channels: source.channels,
            };
            self.check_row(action - format::ACTION_ROW, &scope)?;
        }
        Ok(())
    }

    /// Checks the guard of a transition.
    fn check_guard(
        &mut self,
        source: &Source<'_>,
        transition: &Entry<'_, Transition>,
    ) -> Result<(), Finding> {
        let guard = transition.guard.get();
        let window = source.state.flags().min(usize::from(format::WINDOW_FLAGS));
        match guard {
            format::GUARD_TRUE => Ok(()),
            ..format::GUARD_PROGRAM => {
                let bit = usize::from(guard % format::GUARD_IF_CLEAR);
                transition.ensure(bit < window, Cause::Index)
            }
            format::GUARD_PROGRAM..format::GUARD_MASK => {
                let last = match source.state.kind() {
                    format::STATE_SUPER => format::CODE_JUMP_IF_BUSY_INSIDE,
                    _ => format::CODE_JUMP_IF_SET,
                };
                let scope = Scope {
                    operations: format::CODE_END..last + 1,
                    head: 0..source.head,
                    own: source.state.own_flags(0),
                    channels: source.channels,
                };
                self.check_tests(guard - format::GUARD_PROGRAM, &scope)
            }
            format::GUARD_MASK.. => self.check_mask(guard - format::GUARD_MASK, window),
        }
    }
}

/// Whether a transition from a pseudo-state or a simple state leads to a simple state without
/// flags, without actions.
fn changes_state_only(source: &State, target: &State, action: u16) -> bool {
    source.kind() <= format::STATE_SIMPLE
        && target.shape.get() == format::STATE_SIMPLE << format::STATE_KIND_SHIFT
        && action == format::ACTION_NONE
}

/// Whether a transition leads from a real-time task without timeout and with few flags to itself,
/// with a single `send`.
fn enters_itself(source: &Entry<'_, State>, target_index: usize, action: u16) -> bool {
    source.kind() == format::STATE_TASK
        && !source.has_timeout()
        && source.flags() <= usize::from(format::PLAIN_FLAGS)
        && target_index == source.index
        && action >= format::ACTION_SEND
}
