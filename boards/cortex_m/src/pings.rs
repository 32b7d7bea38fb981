//! The last ping at each echo pin: neighbours may share one, and what was timed is the echo of no
//! other.

use core::sync::atomic::{AtomicU16, Ordering::Relaxed};

/// The last ping at each of so many echo pins. One task has all sonars, so load and store suffice.
pub struct Pings<const PINS: usize>([AtomicU16; PINS]);

/// A ping: its number, and whose it was.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Ping(u16);

impl Ping {
    /// Whether it was this sonar's.
    pub fn is_of(self, sonar: u8) -> bool {
        self.0 & u16::from(u8::MAX) == u16::from(sonar)
    }
}

impl<const PINS: usize> Pings<PINS> {
    /// No sonar has pinged; one of the number 0 would have.
    #[allow(clippy::new_without_default, reason = "for statics alone")]
    pub const fn new() -> Self {
        Pings([const { AtomicU16::new(0) }; PINS])
    }

    /// A sonar pings, whose number is 1 at least.
    pub fn begin(&self, pin: usize, sonar: u8) {
        if let Some(ping) = self.0.get(pin) {
            let number = (ping.load(Relaxed) >> u8::BITS).wrapping_add(1);
            ping.store(number << u8::BITS | u16::from(sonar), Relaxed);
        }
    }

    /// The last ping at a pin.
    pub fn last(&self, pin: usize) -> Ping {
        Ping(self.0.get(pin).map_or(0, |ping| ping.load(Relaxed)))
    }
}
