//! REMOTE_CONTROL: somebody steers by hand.

use super::inserted::Surroundings;
use super::life_cycle::LifeState;
use super::list::{BehaviourList, Key};
use super::situation::SafetyCheck;
use crate::tasks::Twist;
use esm_link::message::LinkError;

/// A movement by hand. It is before all behaviours, which go on when its time is over.
///
/// Source: Schoute, figure 4, `remote_control_bhv`: once its flag is off, it ends and says nothing.
#[derive(Clone, Copy, Debug)]
pub(super) struct RemoteControl {
    key: Key,
    twist: Twist,
    until_us: u64,
}

impl RemoteControl {
    /// Moves like this from now on, until a time on the robot's clock. `before` is what was asked
    /// for before, if that holds still.
    ///
    /// # Errors
    /// [`LinkError::Late`] where the time is over, [`LinkError::ListFull`].
    pub(super) fn drive(
        before: Option<Self>,
        list: &mut BehaviourList,
        twist: Twist,
        until_us: u64,
        robot_us: u64,
    ) -> Result<Self, LinkError> {
        if robot_us > until_us {
            return Err(LinkError::Late);
        }
        let on_list = before.filter(|before| list.state(before.key).is_some());
        let key = match on_list {
            Some(before) => before.key,
            None => list.insert_at_head(0).map_err(|_| LinkError::ListFull)?,
        };
        Ok(Self {
            key,
            twist,
            until_us,
        })
    }

    /// Its key on the list.
    pub(super) fn key(&self) -> Key {
        self.key
    }

    /// Says how to move, as long as it holds and the way is free. False where it is over.
    pub(super) fn step(&self, list: &mut BehaviourList, around: &Surroundings<'_>) -> bool {
        if around.robot_us > self.until_us {
            list.end(self.key);
            return false;
        }
        list.see(self.key);
        list.dispatch();
        let state = list.state(self.key);
        if state == Some(LifeState::Execute) {
            let is_free = SafetyCheck::is_free(&self.twist, around.ranges);
            list.ask(if is_free { self.twist } else { Twist::STILL });
        }
        state.is_some()
    }
}
