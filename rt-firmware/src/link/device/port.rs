//! What a board gives the link: its bytes, its clock, its log, and where it keeps keys and
//! missions.

use crate::mission_store::MissionStore;
use crate::realtime::params::SavedParams;
use esm_link::key_store::KeyStore;
use esm_link::message::MAX_CHUNK;
use esm_link::selftest::Measures;

/// The byte link of a board, and its log.
pub trait LinkPort {
    /// Bytes of an upload that a host may have on their way. Three chunks are 46 ms of a line of
    /// 115,200 baud: more than an answer takes to come into being and to travel, through a host's
    /// converter that looks at its line each 16 ms too. The robot keeps none of them anywhere but
    /// in the blob itself, so that a larger window takes no memory; but all of it is sent again
    /// where the line lost a byte.
    const WINDOW_BYTES: u16 = 3 * MAX_CHUNK as u16;

    /// Whether the board keeps what is logged. A host that wants the log of one that does not is
    /// refused.
    const KEEPS_LOG: bool = true;

    /// Milliseconds that the board's flash takes at most for what one request has it keep: to erase
    /// and write the place of a mission, and the records that go with it. A host waits so much
    /// longer for the answer before it asks again.
    const FLASH_MS: u16 = 0;

    /// How much of the time that slots leave the link may take, in percent; the rest is for slot-0
    /// tasks, whatever comes over the line. At least 1.
    const LINK_PERCENT: u8 = 50;

    /// How much of that it may have saved up, in microseconds: so that a signature, which takes a
    /// tenth of a second, or the check of a blob holds up nothing behind it.
    const LINK_BURST_US: u32 = 250_000;

    /// Microseconds since the robot started, on the clock that
    /// [`Board::now_ticks`](crate::Board::now_ticks) counts.
    fn now_us(&mut self) -> u64;

    /// The next byte that arrived. A board keeps at least as many as arrive while the link waits
    /// for its turn.
    fn receive(&mut self) -> Option<u8>;

    /// Sends a byte. False if there is no room for it now.
    fn send(&mut self, byte: u8) -> bool;

    /// Lets [`RealTime::on_timer`](crate::RealTime::on_timer) come as soon as it can: somebody
    /// wants the robot to stop. A board pends its slot timer's interrupt. Where that is not done,
    /// the stop is looked for when the next slot begins.
    fn wake_real_time(&mut self) {}

    /// Takes bytes off the log; returns how many.
    fn read_log(&mut self, room: &mut [u8]) -> usize {
        let _ = room;
        0
    }

    /// Lines that the log dropped for want of room and that stood before the bytes of the last
    /// [`read_log`](Self::read_log), which ends where lines are missing; wraps.
    fn log_dropped(&self) -> u32 {
        0
    }

    /// Where the board keeps the robot's key. None: it has none, and cannot.
    fn key_store(&mut self) -> Option<&mut dyn KeyStore> {
        None
    }

    /// The most bytes of stack that were in use since the start, where the board measures it. Asked
    /// for with each status.
    fn deepest_stack_bytes(&mut self) -> Option<u32> {
        None
    }

    /// What the board has measured of itself: asked for by a selftest.
    fn measures(&mut self) -> Measures {
        Measures::default()
    }

    /// Whether the board's line can have this rate, in baud.
    fn takes_line_rate(&mut self, baud: u32) -> bool {
        let _ = baud;
        false
    }

    /// Gives the line another rate, which it [takes](Self::takes_line_rate), or its own again: once
    /// all bytes are out that were [sent](Self::send) before.
    fn set_line_rate(&mut self, baud: Option<u32>) {
        let _ = baud;
    }

    /// Who remembers across a reset which mission is on trial and which was confirmed, if the board
    /// has somebody for it.
    fn mission_store(&mut self) -> Option<&mut dyn MissionStore> {
        None
    }
}

/// What the board keeps of parameters.
pub(super) fn saved_params(port: &mut impl LinkPort) -> SavedParams {
    let mission_store = port.mission_store();
    mission_store.map_or(SavedParams::NONE, |mission_store| {
        mission_store.saved_params()
    })
}
