//! The owner of the list of behaviours.

use super::list::{BehaviourList, Key};
use crate::ports::Io;
use crate::task;
use crate::task::{Step, Task};
use crate::tasks::Twist;

/// Owns the list: makes it, takes off whose task state was left, and passes on what the behaviour
/// that executes asks for. Where nobody does, the robot stands still.
#[derive(Clone, Copy, Debug, Default)]
pub struct Behaviours;

task! {
    /// Owns the list of behaviours, and moves as the one says that executes; it stands still while
    /// none does. Behaviours run in its slot, and share its lists: `path Run.made -> Run.list,
    /// Go.list;`.
    impl Behaviours {
        slot 2;
        wcet 200 us;
        endless;
        data {
            /// A list with nobody on it, once.
            out made: BehaviourList;
            /// The list of behaviours.
            inout list: BehaviourList optional;
            /// How the robot is to move.
            out twist: Twist;
        }
        flags {
            /// Nobody is on the list, or IDLE executes.
            out idle;
        }
    }
}

impl Task for Behaviours {
    fn step(&mut self, io: &mut Io<'_>) -> Step {
        let (twist, is_idle) = match io.try_update(Self::LIST) {
            Some(list) => {
                let twist = list.take_asked();
                list.look();
                (twist, list.is_empty() || list.head() == Some(Key::IDLE))
            }
            None => {
                *io.write(Self::MADE) = BehaviourList::EMPTY;
                (Twist::STILL, true)
            }
        };
        *io.write(Self::TWIST) = twist;
        io.set(Self::IDLE, is_idle);
        Step::Run
    }
}
