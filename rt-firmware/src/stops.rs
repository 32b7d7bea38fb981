//! Wishes that the robot stops: who has one says so here, and the real-time side looks before each
//! exchange with the body.
//!
//! A stop is wished for at two places: where its bytes come off the line
//! ([`StopListener`](crate::StopListener)), ahead of all that waits in the link's queue, and where
//! the link reads it there. The real-time side sees the button besides. Each place counts its own
//! wishes, so that every word has one writer. The sum says which wishes were there when a request
//! was read, however long it waits after that: what is older than a wish must not undo it.
//!
//! *Invariant:* a wish is counted first, then the real-time side is called. It takes the call back
//! first, and looks at the counts then. So no wish is lost, wherever one interrupts the other.

use core::sync::atomic::{
    AtomicU32,
    Ordering::{Acquire, Relaxed, Release},
};

use crate::signal::Signal;

/// What is known of stops that were wished for. Counts wrap.
pub(crate) struct Stops {
    /// The real-time side is to look. Set by whoever wishes for a stop.
    called: Signal,
    /// Wishes heard on the line. The listener's.
    heard: AtomicU32,
    /// How many bytes of the line had been kept for the link when the last one was heard. The
    /// listener's.
    heard_at: AtomicU32,
    /// Wishes that the link has read. The link's.
    read: AtomicU32,
    /// Of these, as many as the robot has stopped for. The real-time side's.
    done: AtomicU32,
    /// How often the button was seen pressed. The real-time side's.
    pressed: AtomicU32,
    /// Bytes that were kept for the link. The listener's.
    kept_bytes: AtomicU32,
    /// Bytes of the line that found no room. The listener's.
    lost_bytes: AtomicU32,
}

/// Adds one to a word that nobody else writes.
fn add_one(word: &AtomicU32) -> u32 {
    let value = word.load(Relaxed).wrapping_add(1);
    preemptible!();
    word.store(value, Release);
    preemptible!();
    value
}

impl Stops {
    pub(crate) const fn new() -> Self {
        Stops {
            called: Signal::new(),
            heard: AtomicU32::new(0),
            heard_at: AtomicU32::new(0),
            read: AtomicU32::new(0),
            done: AtomicU32::new(0),
            pressed: AtomicU32::new(0),
            kept_bytes: AtomicU32::new(0),
            lost_bytes: AtomicU32::new(0),
        }
    }

    /// A wish was heard, behind so many bytes that were kept. For the listener alone.
    pub(crate) fn hear(&self, kept_bytes: u32) {
        self.heard_at.store(kept_bytes, Release);
        preemptible!();
        add_one(&self.heard);
    }

    /// So many bytes were kept for the link. For the listener alone.
    pub(crate) fn keep_bytes(&self, kept_bytes: u32) {
        self.kept_bytes.store(kept_bytes, Relaxed);
    }

    /// A byte of the line found no room. For the listener alone.
    pub(crate) fn lose_byte(&self) {
        add_one(&self.lost_bytes);
    }

    /// Bytes of the line that found no room; wraps.
    pub(crate) fn lost_bytes(&self) -> u32 {
        self.lost_bytes.load(Relaxed)
    }

    /// A wish was read. For the link alone. Returns its number, which [`is_done`](Self::is_done)
    /// takes.
    pub(crate) fn read(&self) -> u32 {
        add_one(&self.read)
    }

    /// The button is pressed. For the real-time side alone, which stops the robot itself.
    pub(crate) fn press(&self) {
        add_one(&self.pressed);
    }

    /// Calls the real-time side. To be called behind all that it is to see.
    pub(crate) fn call(&self) {
        self.called.set();
    }

    /// Whether the real-time side is called. The one look that each slot takes.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(crate) fn is_called(&self) -> bool {
        self.called.is_set()
    }

    /// Takes the call back. For the real-time side, before it looks at what was wished for.
    pub(crate) fn take_call(&self) {
        self.called.take_back();
    }

    /// How many wishes there were.
    pub(crate) fn count(&self) -> u32 {
        let heard = self.heard.load(Acquire);
        preemptible!();
        let read = self.read.load(Acquire);
        heard
            .wrapping_add(read)
            .wrapping_add(self.pressed.load(Relaxed))
    }

    /// How many were read. For the real-time side, before it stops the robot.
    pub(crate) fn count_read(&self) -> u32 {
        self.read.load(Acquire)
    }

    /// The robot stands still for the first so many that were read.
    pub(crate) fn set_done(&self, read: u32) {
        self.done.store(read, Release);
    }

    /// Whether a stop was wished for since there were so many wishes.
    pub(crate) fn overtakes(&self, count: u32) -> bool {
        count != self.count() && !mutant!(OvertakenForgotten)
    }

    /// A number of wishes that a stop overtakes: there is one more, and never so few again.
    pub(crate) fn overtaken(&self) -> u32 {
        self.count().wrapping_sub(1)
    }

    /// Whether the robot has stopped for the wish of this number, or for a later one.
    pub(crate) fn is_done(&self, number: u32) -> bool {
        preemptible!();
        let ahead = self.done.load(Acquire).wrapping_sub(number) as i32;
        mutant!(StopDoneBefore) || ahead >= 0
    }
}

/// Where the link stands among the bytes of the line.
pub(crate) struct Place {
    /// Bytes that were taken; wraps.
    taken: u32,
    /// As many of the wishes that were heard lie behind.
    passed: u32,
}

impl Place {
    pub(crate) const BEGINNING: Place = Place {
        taken: 0,
        passed: 0,
    };

    /// A byte was taken. Returns how many were.
    pub(crate) fn take(&mut self) -> u32 {
        self.taken = self.taken.wrapping_add(1);
        self.taken
    }

    /// Bytes that wait for the link; below 0 where nobody says how many were kept.
    pub(crate) fn bytes_behind(&self, stops: &Stops) -> i32 {
        let kept_bytes = stops.kept_bytes.load(Relaxed);
        if kept_bytes == 0 {
            return -1;
        }
        kept_bytes.wrapping_sub(self.taken) as i32
    }

    /// How many wishes there are that a request does not come before which ends here. One that is
    /// heard already and comes behind it overtakes it.
    pub(crate) fn wishes_before(&mut self, stops: &Stops) -> u32 {
        // First how many, then whether one is ahead: so none is overlooked that is heard in
        // between.
        let count = stops.count();
        match self.is_stop_ahead(stops) {
            true => count.wrapping_sub(1),
            false => count,
        }
    }

    /// Whether a stop was heard whose bytes are still to come, or were lost: what was read up to
    /// here is older.
    pub(crate) fn is_stop_ahead(&mut self, stops: &Stops) -> bool {
        // First how many, then where: one that is heard in between is still ahead.
        let heard = stops.heard.load(Acquire);
        preemptible!();
        if heard == self.passed || mutant!(StopAheadForgotten) {
            return false;
        }
        let ahead = stops.heard_at.load(Acquire).wrapping_sub(self.taken) as i32;
        if ahead <= 0 {
            self.passed = heard;
        }
        ahead > 0
    }
}
