//! What a firmware says of itself.

use esm_link::message::ResetReason;

use crate::retained_ram::RetainedRam;

/// The longest name in an [`About`], so that the answer fits into a frame.
pub const MAX_NAME_BYTES: usize = 40;

/// What a robot says of itself.
#[derive(Clone, Copy)]
pub struct About<'m> {
    /// Name and version of the firmware; at most [`MAX_NAME_BYTES`].
    pub firmware: &'m str,
    /// Name of the board; at most [`MAX_NAME_BYTES`].
    pub board: &'m str,
    /// Why the robot started.
    pub reset: ResetReason,
    /// What is kept across a reset, if the board keeps anything.
    pub kept: Option<&'m RetainedRam>,
}

impl<'m> About<'m> {
    /// A robot that started because the power came on.
    ///
    /// # Panics
    /// A name is longer than [`MAX_NAME_BYTES`]: at start-up, or while compiling where this is a
    /// constant.
    pub const fn new(firmware: &'m str, board: &'m str) -> Self {
        assert!(
            firmware.len() <= MAX_NAME_BYTES && board.len() <= MAX_NAME_BYTES,
            "the name of a firmware or board is too long to be told"
        );
        About {
            firmware,
            board,
            reset: ResetReason::PowerOn,
            kept: None,
        }
    }
}
