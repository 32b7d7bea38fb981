//! The part of a chip that a serial line passes through.

/// The rates that a line can have, in baud.
#[derive(Clone, Copy, Debug)]
pub struct LineRates {
    /// The one that it has.
    pub own: u32,
    /// The slowest.
    pub slowest: u32,
    /// The fastest.
    pub fastest: u32,
}

/// The part of a chip that a line's bytes pass through.
pub trait Wire {
    /// Bytes that its FIFO holds; as many are moved in one interrupt at most.
    const FIFO_BYTES: usize;

    /// Takes the interrupt back. Called first in its handler.
    fn acknowledge(&mut self);

    /// Whether there is a byte in the receiver's FIFO.
    fn has_received(&mut self) -> bool;

    /// The next byte of the receiver's FIFO.
    fn receive(&mut self) -> Option<u8>;

    /// Called when bytes came, so that more may follow.
    fn expect_more(&mut self) {}

    /// Whether the transmitter's FIFO has room.
    fn can_send(&mut self) -> bool;

    /// Puts a byte into the transmitter's FIFO; only where it [has room](Self::can_send).
    fn send(&mut self, byte: u8);

    /// Gives the line another rate, in baud, one of the board's [`LineRates`].
    fn set_rate(&mut self, baud: u32) {
        let _ = baud;
    }

    /// Whether the last byte is on the wire as a whole.
    fn is_silent(&mut self) -> bool {
        true
    }

    /// Sets whether the interrupt comes for a transmitter's FIFO that runs empty, too. For received
    /// bytes it always comes.
    fn want_sent(&mut self, sent: bool);
}
