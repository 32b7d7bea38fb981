//! A link over CAN, by any controller of embedded-can's [`nb::Can`].
//!
//! The device of the dispatchers and the bus behind it are two ends. [`CanBus`] has the controller,
//! and belongs to two interrupts: that of a timer, which starts frames at their times whatever slot
//! is executed, and that of the controller, which has received or sent something. [`CanDevice`] has
//! neither. What lies between them are queues with one reader and one writer.
//!
//! Which bits of an identifier are what, [`esm_link::frames::can`] says. The controller's checksum
//! serves; nothing is sent again but what has lost an arbitration.
//!
//! ```
//! use embedded_can::nb::Can;
//! use rt_firmware::frames::can::{CanBus, CanDevice, CanQueues};
//!
//! /// Both ends of a link, of a clock with so many ticks a microsecond. `call` makes the timer's
//! /// interrupt come at once.
//! fn ends<C: Can>(
//!     controller: C,
//!     queues: &mut CanQueues<C::Frame>,
//!     call: fn(),
//! ) -> (CanBus<'_, C>, CanDevice<'_, C::Frame>) {
//!     queues.split(controller, 21, call)
//! }
//!
//! /// What the timer's interrupt does; it sets the timer to what it is answered.
//! fn on_timer<C: Can>(bus: &mut CanBus<'_, C>, now_ticks: u64) -> Option<u64> {
//!     bus.start_due(now_ticks)
//! }
//!
//! /// What the controller's does: a place has become free, or something has come.
//! fn on_controller<C: Can>(bus: &mut CanBus<'_, C>, now_ticks: u64) -> Option<u64> {
//!     bus.hear(now_ticks);
//!     bus.start_due(now_ticks)
//! }
//! ```

use core::cmp::Reverse;
use core::sync::atomic::{AtomicU32, Ordering};

use embedded_can::nb::Can;
use embedded_can::{ExtendedId, Frame, Id};
use esm_link::frames::can::{MAX_PAYLOAD_BYTES, identifier, receive};
use esm_link::frames::receiver::{InFrames, ReceiveError};
use esm_link::frames::wire::Header;
use heapless::Vec;
use heapless::spsc::{Consumer, Producer, Queue};

use super::clock::RobotClock;
use super::device::{LinkDevice, Taken};

/// Frames that wait for their starts, and frames that have arrived and wait for their dispatcher,
/// that are there at once.
pub const WAITING: usize = 8;
/// A queue holds one less than it has room for.
const PLACES: usize = WAITING + 1;

/// A frame, and when it is to start.
struct ToSend<F> {
    at_ticks: u64,
    frame: F,
}

/// What has come, and when; nothing where the controller says that something was lost.
struct Heard<F> {
    at_ticks: u64,
    frame: Option<F>,
}

/// What lies between the two ends.
pub struct CanQueues<F> {
    ready: Queue<ToSend<F>, PLACES>,
    arrived: Queue<Heard<F>, PLACES>,
    rate_bps: AtomicU32,
}

impl<F: Frame> Default for CanQueues<F> {
    fn default() -> Self {
        Self::new()
    }
}

impl<F: Frame> CanQueues<F> {
    /// Nothing.
    #[must_use]
    pub const fn new() -> Self {
        CanQueues {
            ready: Queue::new(),
            arrived: Queue::new(),
            rate_bps: AtomicU32::new(0),
        }
    }

    /// Makes the two ends, of a clock with so many ticks in a microsecond. `call` makes the
    /// interrupt come that [starts what is due](CanBus::start_due); it is called from slots.
    pub fn split<C: Can<Frame = F>>(
        &mut self,
        controller: C,
        ticks_per_us: u32,
        call: fn(),
    ) -> (CanBus<'_, C>, CanDevice<'_, F>) {
        let (ready_in, ready_out) = self.ready.split();
        let (arrived_in, arrived_out) = self.arrived.split();
        let rate_bps = &self.rate_bps;
        (
            CanBus {
                controller,
                ready: ready_out,
                arrived: arrived_in,
                waiting: Vec::new(),
                rate_bps,
                set_bps: 0,
            },
            CanDevice {
                ready: ready_in,
                arrived: arrived_out,
                next: None,
                rate_bps,
                clock: RobotClock::default(),
                ticks_per_us: ticks_per_us.max(1),
                has_new: false,
                call,
            },
        )
    }
}

/// The interrupts' end.
pub struct CanBus<'q, C: Can> {
    controller: C,
    ready: Consumer<'q, ToSend<C::Frame>>,
    arrived: Producer<'q, Heard<C::Frame>>,
    /// What is to be sent, the earliest last.
    waiting: Vec<ToSend<C::Frame>, WAITING>,
    rate_bps: &'q AtomicU32,
    set_bps: u32,
}

impl<C: Can> CanBus<'_, C> {
    /// The controller, with the rate that the mission declares, where it is another one than
    /// before: whoever knows its bit timing sets it.
    pub fn new_rate(&mut self) -> Option<(&mut C, u32)> {
        let rate_bps = self.rate_bps.load(Ordering::Relaxed);
        if rate_bps == core::mem::replace(&mut self.set_bps, rate_bps) {
            return None;
        }
        Some((&mut self.controller, rate_bps))
    }

    /// Gives the controller what is due. Answers when the next frame starts: the timer is to be set
    /// to that. None where none waits, or the controller has no place: then its own interrupt comes
    /// when it has one.
    pub fn start_due(&mut self, now_ticks: u64) -> Option<u64> {
        while !self.waiting.is_full()
            && let Some(frame) = self.ready.dequeue()
        {
            self.wait(frame);
        }
        // Each may push one other out of its place, once.
        for _ in 0..2 * WAITING {
            let next = self.waiting.last()?;
            if next.at_ticks > now_ticks {
                return Some(next.at_ticks);
            }
            match self.controller.transmit(&next.frame) {
                Ok(displaced) => {
                    self.waiting.pop();
                    if let Some(frame) = displaced {
                        let at_ticks = now_ticks;
                        self.wait(ToSend { at_ticks, frame });
                    }
                }
                Err(nb::Error::WouldBlock) => return None,
                // Nothing is sent again.
                Err(nb::Error::Other(_)) => {
                    self.waiting.pop();
                }
            }
        }
        Some(now_ticks)
    }

    /// Puts a frame behind those that start before, and before those with a higher identifier.
    fn wait(&mut self, frame: ToSend<C::Frame>) {
        let key = |it: &ToSend<C::Frame>| (it.at_ticks, bits(&it.frame));
        let place = (self.waiting).partition_point(|it| Reverse(key(it)) <= Reverse(key(&frame)));
        let _ = self.waiting.insert(place, frame);
    }

    /// Whether frames wait for their times, or for a place in the controller.
    #[must_use]
    pub fn is_waiting(&self) -> bool {
        !self.waiting.is_empty()
    }

    /// Takes what the controller has received. What nobody has room for is lost.
    pub fn hear(&mut self, now_ticks: u64) {
        for _ in 0..WAITING {
            let frame = match self.controller.receive() {
                Ok(frame) => Some(frame),
                Err(nb::Error::WouldBlock) => return,
                Err(nb::Error::Other(_)) => None,
            };
            let at_ticks = now_ticks;
            let _ = self.arrived.enqueue(Heard { at_ticks, frame });
        }
    }
}

/// The 29 bits of a frame's identifier; none of one with 11.
fn bits(frame: &impl Frame) -> Option<u32> {
    match frame.id() {
        Id::Extended(id) => Some(id.as_raw()),
        Id::Standard(_) => None,
    }
}

/// The dispatchers' end.
pub struct CanDevice<'q, F> {
    ready: Producer<'q, ToSend<F>>,
    arrived: Consumer<'q, Heard<F>>,
    /// What has arrived, and later than it was asked for.
    next: Option<Heard<F>>,
    rate_bps: &'q AtomicU32,
    clock: RobotClock,
    ticks_per_us: u32,
    /// Frames were handed over that the bus does not know of.
    has_new: bool,
    call: fn(),
}

impl<F> CanDevice<'_, F> {
    /// Takes over how robot time goes with the clock: an activation starts at this time by the one
    /// and by the other.
    pub fn note(&mut self, start_us: u64, start_ticks: u64) {
        self.clock.note(start_us, start_ticks, self.ticks_per_us);
    }
}

impl<F: Frame> LinkDevice for CanDevice<'_, F> {
    fn set_rate(&mut self, rate_bps: u32) {
        self.rate_bps.store(rate_bps, Ordering::Relaxed);
        (self.call)();
    }

    fn send(
        &mut self,
        start_us: u64,
        header: Header,
        payload_bytes: usize,
        write: &mut dyn FnMut(&mut [u8]),
    ) -> bool {
        let mut data = [0; MAX_PAYLOAD_BYTES];
        let id = identifier(header).and_then(ExtendedId::new);
        let (Some(data), Some(id)) = (data.get_mut(..payload_bytes), id) else {
            return false;
        };
        if !self.ready.ready() {
            return false;
        }
        write(data);
        let Some(frame) = F::new(id, data) else {
            return false;
        };
        self.has_new = true;
        let at_ticks = self.clock.ticks(start_us, self.ticks_per_us);
        self.ready.enqueue(ToSend { at_ticks, frame }).is_ok()
    }

    fn start_sending(&mut self) {
        if core::mem::take(&mut self.has_new) {
            (self.call)();
        }
    }

    fn receive(&mut self, until_us: u64, frames: &dyn InFrames, take: Taken<'_>) {
        // What arrives meanwhile is later.
        for _ in 0..=WAITING {
            let Some(heard) = self.next.take().or_else(|| self.arrived.dequeue()) else {
                return;
            };
            let at_us = (self.clock).us_by(until_us, heard.at_ticks, self.ticks_per_us);
            let Some(at_us) = at_us else {
                self.next = Some(heard);
                return;
            };
            let arrived = match &heard.frame {
                None => Err(ReceiveError::Checksum),
                Some(frame) => match bits(frame) {
                    Some(id) => receive(id, frame.data(), frames),
                    None => Err(ReceiveError::UnknownIdentifier),
                },
            };
            take(arrived, at_us);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::cell::RefCell;
    use std::collections::VecDeque;
    use std::rc::Rc;
    use std::sync::atomic::AtomicUsize;
    use std::vec::Vec;

    use embedded_can::{Error, ErrorKind, StandardId};
    use esm_link::frames::configuration::{Configuration, Content};
    use esm_link::frames::receiver::{InFrame, SortedFrames};

    use super::*;

    #[derive(Clone, Debug, PartialEq)]
    struct Bytes {
        id: Id,
        data: Vec<u8>,
    }

    impl Frame for Bytes {
        fn new(id: impl Into<Id>, data: &[u8]) -> Option<Self> {
            let (id, data) = (id.into(), data.to_vec());
            (data.len() <= 8).then_some(Bytes { id, data })
        }
        fn new_remote(_: impl Into<Id>, _: usize) -> Option<Self> {
            None
        }
        fn is_extended(&self) -> bool {
            matches!(self.id, Id::Extended(_))
        }
        fn is_remote_frame(&self) -> bool {
            false
        }
        fn id(&self) -> Id {
            self.id
        }
        fn dlc(&self) -> usize {
            self.data.len()
        }
        fn data(&self) -> &[u8] {
            &self.data
        }
    }

    #[derive(Debug)]
    struct Overrun;

    impl Error for Overrun {
        fn kind(&self) -> ErrorKind {
            ErrorKind::Overrun
        }
    }

    /// A controller whose mailboxes are sent when the test says so, and come back.
    #[derive(Default)]
    struct Loop {
        mailboxes: Vec<Bytes>,
        room: usize,
        heard: VecDeque<Result<Bytes, Overrun>>,
    }

    #[derive(Clone)]
    struct Controller(Rc<RefCell<Loop>>);

    impl Controller {
        fn new(room: usize) -> Self {
            Controller(Rc::new(RefCell::new(Loop {
                room,
                ..Loop::default()
            })))
        }

        /// The frame with the lowest identifier crosses the bus.
        fn pass(&self) {
            let mut inner = self.0.borrow_mut();
            let lowest = inner.mailboxes.iter().enumerate();
            let lowest = lowest.min_by_key(|(_, it)| bits(*it)).map(|(at, _)| at);
            if let Some(at) = lowest {
                let frame = inner.mailboxes.remove(at);
                inner.heard.push_back(Ok(frame));
            }
        }
    }

    impl Can for Controller {
        type Frame = Bytes;
        type Error = Overrun;

        fn transmit(&mut self, frame: &Bytes) -> nb::Result<Option<Bytes>, Overrun> {
            let mut inner = self.0.borrow_mut();
            if inner.mailboxes.len() < inner.room {
                inner.mailboxes.push(frame.clone());
                return Ok(None);
            }
            let highest = inner.mailboxes.iter_mut().max_by_key(|it| bits(*it));
            match highest.filter(|it| bits(*it) > bits(frame)) {
                Some(place) => Ok(Some(std::mem::replace(place, frame.clone()))),
                None => Err(nb::Error::WouldBlock),
            }
        }

        fn receive(&mut self) -> nb::Result<Bytes, Overrun> {
            let heard = self.0.borrow_mut().heard.pop_front();
            heard
                .ok_or(nb::Error::WouldBlock)?
                .map_err(nb::Error::Other)
        }
    }

    const TICKS_PER_US: u32 = 10;

    fn configuration(id: u16) -> Configuration {
        Configuration::of(id, Content::Value("Twist"), 2, 20_000)
    }

    fn send(device: &mut impl LinkDevice, id: u16, number: u8, start_us: u64) -> bool {
        let header = Header {
            identifier: id,
            number,
            configuration: configuration(id),
        };
        device.send(start_us, header, 2, &mut |data| data.fill(number))
    }

    /// What has arrived by a time: identifier, number, first byte, and when.
    type Got = Vec<(Result<(usize, u8, u8), ReceiveError>, u64)>;

    fn got(device: &mut impl LinkDevice, until_us: u64) -> Got {
        let frames = [3, 4].map(|identifier| InFrame {
            identifier,
            payload_bytes: 2,
            configuration: configuration(identifier),
        });
        let frames = SortedFrames::new(&frames).unwrap();
        let mut got = Vec::new();
        device.receive(until_us, &frames, &mut |arrived, at_us| {
            let arrived = arrived.map(|it| (it.index, it.number, it.payload[0]));
            got.push((arrived, at_us));
        });
        got
    }

    #[test]
    fn what_is_sent_starts_in_time_and_comes_back() {
        static CALLS: AtomicUsize = AtomicUsize::new(0);
        let call = || {
            CALLS.fetch_add(1, Ordering::Relaxed);
        };
        let controller = Controller::new(3);
        let mut queues = CanQueues::new();
        let (mut bus, mut device) = queues.split(controller.clone(), TICKS_PER_US, call);
        // The robot's time began at 500 ticks of the clock.
        device.note(1_000, 10_500);
        assert!(bus.new_rate().is_none());
        device.set_rate(250_000);
        assert_eq!(bus.new_rate().map(|it| it.1), Some(250_000));
        assert!(bus.new_rate().is_none());
        // In the order of declarations, not of starts.
        assert!(send(&mut device, 4, 7, 3_000));
        assert!(send(&mut device, 3, 6, 2_000));
        device.start_sending();
        device.start_sending();
        assert_eq!(CALLS.load(Ordering::Relaxed), 2);
        assert_eq!(bus.start_due(11_000), Some(20_500));
        controller.pass();
        assert_eq!(bus.start_due(20_500), Some(30_500));
        controller.pass();
        bus.hear(22_000);
        assert_eq!(bus.start_due(30_501), None);
        controller.pass();
        bus.hear(32_000);
        assert_eq!(got(&mut device, 2_149), []);
        assert_eq!(got(&mut device, 2_150), [(Ok((0, 6, 6)), 2_150)]);
        assert_eq!(got(&mut device, 9_000), [(Ok((1, 7, 7)), 3_150)]);
    }

    #[test]
    fn a_lower_identifier_goes_first_and_none_is_lost_on_a_full_controller() {
        let controller = Controller::new(1);
        let mut queues = CanQueues::new();
        let (mut bus, mut device) = queues.split(controller.clone(), TICKS_PER_US, || ());
        for (id, start_us) in [(4, 10), (3, 20), (4, 30)] {
            assert!(send(&mut device, id, start_us as u8, start_us));
            // Each is due when it is given; the second pushes the first out of its place.
            assert_eq!(bus.start_due(start_us * 10), None);
        }
        for _ in 0..3 {
            controller.pass();
            bus.hear(1_000);
            bus.start_due(1_000);
        }
        let numbers: Vec<u8> = (got(&mut device, 200).into_iter())
            .map(|(arrived, _)| arrived.unwrap().1)
            .collect();
        assert_eq!(numbers, [20, 10, 30]);
    }

    #[test]
    fn where_there_is_no_room_nothing_is_sent_and_nothing_written() {
        let mut queues = CanQueues::new();
        let (mut bus, mut device) = queues.split(Controller::new(0), TICKS_PER_US, || ());
        let sent = (0..20).filter(|number| send(&mut device, 3, *number, 0));
        assert_eq!(sent.count(), WAITING);
        assert_eq!(bus.start_due(0), None);
        // Those wait with the bus now, and as many more can be handed over.
        let sent = (0..20).filter(|number| send(&mut device, 3, *number, 0));
        assert_eq!(sent.count(), WAITING);
        let header = Header {
            identifier: 3,
            number: 0,
            configuration: configuration(3),
        };
        assert!(!device.send(0, header, 9, &mut |_| panic!("nine bytes are no frame")));
    }

    #[test]
    fn what_is_no_frame_of_ours_is_told() {
        let controller = Controller::new(1);
        let mut queues = CanQueues::new();
        let (mut bus, mut device) = queues.split(controller.clone(), TICKS_PER_US, || ());
        let of = |id: Id, bytes: &[u8]| Ok(Bytes::new(id, bytes).unwrap());
        let known = |number| {
            let header = Header {
                identifier: 3,
                number,
                configuration: configuration(3),
            };
            Id::Extended(ExtendedId::new(identifier(header).unwrap()).unwrap())
        };
        let other = ExtendedId::new(bits(&Bytes::new(known(1), &[]).unwrap()).unwrap() ^ 1 << 2);
        controller.0.borrow_mut().heard.extend([
            of(known(1), &[5, 5]),
            of(Id::Standard(StandardId::new(3).unwrap()), &[5, 5]),
            of(known(2), &[5]),
            of(Id::Extended(other.unwrap()), &[5, 5]),
            Err(Overrun),
            of(known(3), &[6, 6]),
        ]);
        bus.hear(10);
        let told: Vec<_> = got(&mut device, 10).into_iter().map(|it| it.0).collect();
        assert_eq!(
            told,
            [
                Ok((0, 1, 5)),
                Err(ReceiveError::UnknownIdentifier),
                Err(ReceiveError::Length),
                Err(ReceiveError::Configuration),
                Err(ReceiveError::Checksum),
                Ok((0, 3, 6)),
            ]
        );
    }
}
