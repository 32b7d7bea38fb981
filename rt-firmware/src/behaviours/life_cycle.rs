//! The states of a behaviour on the list.

/// A state in a behaviour's life.
///
/// Source: Schoute, "Behaviour-based control framework for an autonomous mobile robot", section
/// 3.1, figure 2.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(u8)]
pub enum LifeState {
    /// On the list, and never executed so far.
    #[default]
    Initial = 0,
    /// At the head of the list: it says how the robot moves.
    Execute = 1,
    /// Interrupted, by a situation or by hand.
    Suspend = 2,
    /// Interrupted, and on the list to go on when it is at the head again.
    Resume = 3,
    /// Over: it leaves the list.
    Destroy = 4,
}

/// What changes the state of a behaviour.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cause {
    /// It is at the head of the list.
    Dispatch,
    /// Something is to be done before it goes on.
    Interrupt,
    /// What interrupted it is on the list before it.
    Requeue,
    /// It has finished, has failed, or is cancelled.
    End,
}

impl LifeState {
    /// The state of this number; one that is none is over.
    pub(super) const fn of_number(number: u8) -> Self {
        match number {
            0 => Self::Initial,
            1 => Self::Execute,
            2 => Self::Suspend,
            3 => Self::Resume,
            _ => Self::Destroy,
        }
    }

    /// The state after this cause; none where the cause changes nothing in this state.
    pub const fn after(self, cause: Cause) -> Option<Self> {
        match (self, cause) {
            (Self::Initial | Self::Resume, Cause::Dispatch) => Some(Self::Execute),
            (Self::Execute, Cause::Interrupt) => Some(Self::Suspend),
            (Self::Suspend, Cause::Requeue) => Some(Self::Resume),
            (Self::Initial | Self::Execute | Self::Suspend | Self::Resume, Cause::End) => {
                Some(Self::Destroy)
            }
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_state_and_cause_is_as_in_figure_2() {
        use Cause::{Dispatch, End, Interrupt, Requeue};
        use LifeState::{Destroy, Execute, Initial, Resume, Suspend};
        for (state, cause, after) in [
            (Initial, Dispatch, Some(Execute)),
            (Initial, Interrupt, None),
            (Initial, Requeue, None),
            (Initial, End, Some(Destroy)),
            (Execute, Dispatch, None),
            (Execute, Interrupt, Some(Suspend)),
            (Execute, Requeue, None),
            (Execute, End, Some(Destroy)),
            (Suspend, Dispatch, None),
            (Suspend, Interrupt, None),
            (Suspend, Requeue, Some(Resume)),
            (Suspend, End, Some(Destroy)),
            (Resume, Dispatch, Some(Execute)),
            (Resume, Interrupt, None),
            (Resume, Requeue, None),
            (Resume, End, Some(Destroy)),
            (Destroy, Dispatch, None),
            (Destroy, Interrupt, None),
            (Destroy, Requeue, None),
            (Destroy, End, None),
        ] {
            assert_eq!(state.after(cause), after, "{state:?}, {cause:?}");
        }
    }
}
