//! What ships.

use super::along_wall::AlongWall;
use super::approach::Approach;
use super::follow_corridor::FollowCorridor;
use super::follow_object::FollowObject;
use super::go_to::GoTo;
use super::move_on::Move;
use super::pass_door::PassDoor;
use super::turn_to::TurnTo;
use super::wander::Wander;
use crate::repertoire;

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
    }
}
