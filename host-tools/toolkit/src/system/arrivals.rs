//! What comes out of the devices of links, written down as it comes.
//!
//! Nobody else sees it: the device of an end notes what it gives to the processor. So the account
//! of it, [`partner`](super::partner), is no part of a mission, and none is needed on a board.

use std::cell::{Cell, RefCell};
use std::rc::Rc;

use esm_link::frames::receiver::{InFrame, InFrames, ReceiveError, receive};
use esm_link::frames::wire::Header;
use rt_firmware::frames::{LinkDevice, Taken};

/// What something that has arrived was.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Came {
    /// A frame that the mission receives.
    Frame {
        /// Its identifier.
        identifier: u16,
        /// Number of its occurrence, modulo 256.
        number: u8,
    },
    /// Something else.
    Wrong(ReceiveError),
    /// Bytes of a wire up to a delimiter, which a board reads itself; none where there were more
    /// than a frame has.
    Wire(Option<Vec<u8>>),
}

impl Came {
    /// The same as a mission reads it that receives these frames.
    #[must_use]
    pub(super) fn read(&self, frames: &dyn InFrames) -> Came {
        let Came::Wire(bytes) = self else {
            return self.clone();
        };
        let Some(bytes) = bytes else {
            return Came::Wrong(ReceiveError::TooLong);
        };
        let noted = Noted::of(frames);
        match receive(&mut bytes.clone(), &noted) {
            Ok(arrived) => Came::Frame {
                identifier: noted.last.get(),
                number: arrived.number,
            },
            Err(error) => Came::Wrong(error),
        }
    }
}

/// Something that has arrived. All times are on the clock of the processor that took it, in
/// microseconds.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Arrival {
    /// When its last bit was there.
    pub at_us: u64,
    /// Start of the activation that took it.
    pub taken_us: u64,
    /// Start of the one before, if there was one.
    pub before_us: Option<u64>,
    /// What it was.
    pub came: Came,
}

/// What has arrived at one end of a link.
#[derive(Clone, Debug, Default)]
pub struct Arrivals {
    /// All of it, in its order.
    pub all: Vec<Arrival>,
    /// Start of the last activation that looked.
    pub looked_us: Option<u64>,
    pub(super) before_us: Option<u64>,
}

impl Arrivals {
    /// An activation that starts then looks what there is.
    pub(super) fn look(&mut self, taken_us: u64) {
        // A board asks once for each frame.
        if self.looked_us != Some(taken_us) {
            self.before_us = self.looked_us.replace(taken_us);
        }
    }

    /// That activation takes this.
    pub(super) fn take(&mut self, at_us: u64, came: Came) {
        let Some(taken_us) = self.looked_us else {
            return;
        };
        self.all.push(Arrival {
            at_us,
            taken_us,
            before_us: self.before_us,
            came,
        });
    }
}

/// Arrivals that a device writes down, and someone reads at the end.
pub type Noting = Rc<RefCell<Arrivals>>;

/// Frames that may arrive, and which of them was asked for last.
struct Noted<'f> {
    frames: &'f dyn InFrames,
    last: Cell<u16>,
}

impl<'f> Noted<'f> {
    fn of(frames: &'f dyn InFrames) -> Self {
        Noted {
            frames,
            last: Cell::new(0),
        }
    }
}

impl InFrames for Noted<'_> {
    fn find(&self, identifier: u16) -> Option<(usize, InFrame)> {
        self.last.set(identifier);
        self.frames.find(identifier)
    }
}

/// A device that writes down what it gives.
pub(super) struct Listening {
    pub(super) device: Box<dyn LinkDevice>,
    pub(super) arrivals: Noting,
}

impl LinkDevice for Listening {
    fn set_rate(&mut self, rate_bps: u32) {
        self.device.set_rate(rate_bps);
    }

    fn send(
        &mut self,
        start_us: u64,
        header: Header,
        payload_bytes: usize,
        write: &mut dyn FnMut(&mut [u8]),
    ) -> bool {
        self.device.send(start_us, header, payload_bytes, write)
    }

    fn start_sending(&mut self) {
        self.device.start_sending();
    }

    fn receive(&mut self, until_us: u64, frames: &dyn InFrames, take: Taken<'_>) {
        self.arrivals.borrow_mut().look(until_us);
        let noted = Noted::of(frames);
        self.device
            .receive(until_us, &noted, &mut |arrived, at_us| {
                let came = match &arrived {
                    Ok(it) => Came::Frame {
                        identifier: noted.last.get(),
                        number: it.number,
                    },
                    Err(error) => Came::Wrong(*error),
                };
                self.arrivals.borrow_mut().take(at_us, came);
                take(arrived, at_us);
            });
    }
}
