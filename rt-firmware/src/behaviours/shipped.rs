//! What ships.

#[cfg(feature = "all-behaviours")]
use super::along_wall::AlongWall;
#[cfg(feature = "all-behaviours")]
use super::approach::Approach;
#[cfg(feature = "all-behaviours")]
use super::dock::Dock;
#[cfg(feature = "all-behaviours")]
use super::follow_corridor::FollowCorridor;
#[cfg(feature = "all-behaviours")]
use super::follow_object::FollowObject;
use super::go_to::GoTo;
use super::move_on::Move;
#[cfg(feature = "all-behaviours")]
use super::pass_door::PassDoor;
use super::turn_to::TurnTo;
#[cfg(feature = "all-behaviours")]
use super::wander::Wander;
use crate::repertoire;

#[cfg(feature = "all-behaviours")]
repertoire! {
    /// The laws of all behaviours that ship.
    pub enum ShippedLaws {
        Move,
        TurnTo,
        GoTo,
        FollowCorridor,
        PassDoor,
        AlongWall,
        Wander,
        Approach,
        FollowObject,
        Dock,
    }
}

#[cfg(not(feature = "all-behaviours"))]
repertoire! {
    /// The laws of the behaviours that a small robot has.
    pub enum ShippedLaws { Move, TurnTo, GoTo }
}
