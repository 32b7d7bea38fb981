//! What ships.

use super::go_to::GoTo;
use super::move_on::Move;
use super::turn_to::TurnTo;
use crate::repertoire;

repertoire! {
    /// The laws of all behaviours that ship.
    pub enum ShippedLaws { Move, TurnTo, GoTo }
}
