//! The devices of all links of a system: what a processor sends goes onto a simulated medium, and
//! what that has brought is received.

use std::cell::RefCell;
use std::rc::Rc;

use esm_link::frame::DELIMITER;
use esm_link::frames::can;
use esm_link::frames::receiver::{InFrames, Receiver};
use esm_link::frames::wire::{self, Header, MAX_PAYLOAD_BYTES, MAX_WIRE_BYTES};
use rt_firmware::body::frames::CarriedFrame;
use rt_firmware::frames::{LinkDevice, Taken};

use super::arrivals::{Arrivals, Came, Listening, Noting};
use super::declaration::{Link, Medium};
use crate::host_board::OpenLine;
use crate::host_run::WiredLink;
use crate::medium::PS_IN_US;
use crate::medium::can::{Bus, BusSettings};
use crate::medium::chance::Fate;
use crate::medium::clock::{Clock, Life};
pub use crate::medium::line::Sent;
use crate::medium::line::{Line, LineSettings};
use crate::medium::memory::SharedMemory;

/// Directions of a link.
const WAYS: u64 = 2;

/// What is to be known of a processor's links, between two resets.
#[derive(Clone, Debug)]
pub struct Links {
    /// Index of the processor.
    pub processor: usize,
    /// Its clock, and when it is there.
    pub life: Life,
    /// The links in its mission's blob, in their order.
    pub links: Vec<WiredLink>,
}

/// The devices of a processor, in the order of its links.
pub type Devices = Vec<Box<dyn LinkDevice>>;

/// One end of a link, for whoever serves it.
pub struct End {
    /// The device of a host board.
    pub device: Box<dyn LinkDevice>,
    /// The line that leads to it, where that is one: for a board with a UART of its own.
    pub uart: Option<Uart>,
}

impl End {
    /// An end that leads nowhere.
    fn open() -> Self {
        End {
            device: Box::new(OpenLine),
            uart: None,
        }
    }

    /// The same, with what arrives written down.
    fn noting(self, arrivals: &Noting) -> Self {
        End {
            device: Box::new(Listening {
                device: self.device,
                arrivals: Rc::clone(arrivals),
            }),
            uart: self.uart.map(|uart| Uart {
                arrivals: Rc::clone(arrivals),
                ..uart
            }),
        }
    }
}

/// What lies between processors.
pub struct Wires {
    /// The ends of each processor between two resets, in the order of its links.
    pub ends: Vec<Vec<End>>,
    /// What crosses the links.
    pub traffic: Traffic,
}

/// What has crossed the links of a system.
#[derive(Clone, Default)]
pub struct Traffic {
    lines: Vec<Option<[Rc<RefCell<Line>>; 2]>>,
    arrivals: Vec<Option<[Noting; 2]>>,
}

impl Traffic {
    /// Of each link, what has arrived at its first end and its second since their last resets; none
    /// where one of them is not used. It is given once.
    #[must_use]
    pub fn arrived(&self) -> Vec<Option<[Arrivals; 2]>> {
        let of = |both: &[Noting; 2]| both.each_ref().map(|it| it.take());
        (self.arrivals.iter())
            .map(|both| both.as_ref().map(of))
            .collect()
    }

    /// Of each link, what its first end and its second has sent; none where it is no line.
    #[must_use]
    pub fn sent(&self) -> Vec<Option<[Sent; 2]>> {
        let of = |lines: &[Rc<RefCell<Line>>; 2]| lines.each_ref().map(|it| it.borrow().sent());
        (self.lines.iter())
            .map(|lines| lines.as_ref().map(of))
            .collect()
    }
}

/// Makes the ends of all links of each processor, each time that it is there: one entry of `lives`,
/// in the order of their times. A link that nothing is joined to leads nowhere.
#[must_use]
pub fn wires(links: &[Link], lives: &[Links], seed: u64) -> Wires {
    let mut ends: Vec<Vec<End>> = (lives.iter())
        .map(|it| it.links.iter().map(|_| End::open()).collect())
        .collect();
    let mut traffic = Traffic::default();
    for (number, link) in (0..).zip(links) {
        let of_link = link.ends.each_ref().map(|end| {
            let first = lives.iter().find(|it| it.processor == end.processor)?;
            let of_blob = first.links.iter().find(|it| it.name == end.link)?;
            Some((end, first.life.clock, of_blob))
        });
        // One whose dispatchers are not used sends nothing and hears nothing.
        let [Some(first), Some(second)] = of_link else {
            traffic.lines.push(None);
            traffic.arrivals.push(None);
            continue;
        };
        let clocks = [first.1, second.1];
        let between = match link.medium {
            Medium::Line => {
                let numbers = [number * WAYS, number * WAYS + 1];
                Between::Lines(lines(link, clocks, first.2, numbers, seed))
            }
            Medium::Memory => Between::Memory(memories(clocks)),
            Medium::Can => Between::Bus(bus(link, clocks, first.2, number * WAYS, seed)),
        };
        traffic.lines.push(between.lines());
        let mut arrivals = [Noting::default(), Noting::default()];
        for ((which, (end, ..)), arrivals) in [first, second].iter().enumerate().zip(&mut arrivals)
        {
            let of_end = lives.iter().zip(&mut ends);
            for (life, ends) in of_end.filter(|(it, _)| it.processor == end.processor) {
                let index = life.links.iter().position(|it| it.name == end.link);
                if let Some(place) = index.and_then(|index| ends.get_mut(index)) {
                    *arrivals = Noting::default();
                    *place = between.end(which, life.life).noting(arrivals);
                }
            }
        }
        traffic.arrivals.push(Some(arrivals));
    }
    Wires { ends, traffic }
}

/// What lies between both ends of a link.
enum Between {
    Lines([Rc<RefCell<Line>>; WAYS as usize]),
    Memory([Rc<RefCell<SharedMemory>>; WAYS as usize]),
    Bus(Rc<RefCell<Bus>>),
}

impl Between {
    fn lines(&self) -> Option<[Rc<RefCell<Line>>; 2]> {
        match self {
            Between::Lines(lines) => Some(lines.each_ref().map(Rc::clone)),
            _ => None,
        }
    }

    /// An end of it: the first or the other, for a processor between two resets.
    fn end(&self, which: usize, life: Life) -> End {
        fn both<T>(two: &[Rc<RefCell<T>>; 2], which: usize) -> [Rc<RefCell<T>>; 2] {
            let [there, back] = two.each_ref().map(Rc::clone);
            match which {
                0 => [there, back],
                _ => [back, there],
            }
        }
        match self {
            Between::Lines(lines) => {
                let [sends, hears] = both(lines, which);
                let uart = Uart::new(sends, hears, life);
                End {
                    device: Box::new(uart.device()),
                    uart: Some(uart),
                }
            }
            Between::Memory(memories) => {
                let [writes, reads] = both(memories, which);
                let receiver = Receiver::new();
                let device = Box::new(MemoryEnd {
                    writes,
                    reads,
                    life,
                    receiver,
                });
                End { device, uart: None }
            }
            Between::Bus(bus) => {
                let device = Box::new(CanNode {
                    bus: Rc::clone(bus),
                    node: which,
                    life,
                });
                End { device, uart: None }
            }
        }
    }
}

fn shared<T>(value: T) -> Rc<RefCell<T>> {
    Rc::new(RefCell::new(value))
}

/// Both directions of a line.
fn lines(
    link: &Link,
    clocks: [Clock; 2],
    of_blob: &WiredLink,
    numbers: [u64; 2],
    seed: u64,
) -> [Rc<RefCell<Line>>; 2] {
    let settings = || LineSettings {
        rate_bps: of_blob.rate_bps,
        bits: of_blob.bits,
        delay_ps: link.delay_us.saturating_mul(PS_IN_US),
        noise: link.noise,
        byte_loss: link.byte_loss,
        loss: link.loss,
        cuts: link.cuts.clone(),
    };
    let line = |number, from, to| shared(Line::new(settings(), Fate::new(seed, number), from, to));
    [
        line(numbers[0], clocks[0], clocks[1]),
        line(numbers[1], clocks[1], clocks[0]),
    ]
}

/// The pins of a UART: whole frames as the bytes of the wire, for a board that makes and reads them
/// itself.
pub struct Uart {
    sends: Rc<RefCell<Line>>,
    hears: Rc<RefCell<Line>>,
    life: Life,
    /// What has come of a frame.
    arriving: Vec<u8>,
    arrivals: Noting,
}

impl Uart {
    fn new(sends: Rc<RefCell<Line>>, hears: Rc<RefCell<Line>>, life: Life) -> Self {
        Uart {
            sends,
            hears,
            life,
            arriving: Vec::new(),
            arrivals: Noting::default(),
        }
    }

    fn device(&self) -> LineEnd {
        LineEnd {
            sends: Rc::clone(&self.sends),
            hears: Rc::clone(&self.hears),
            life: self.life,
            receiver: Receiver::new(),
        }
    }

    /// The board starts a frame.
    pub fn start(&mut self, mut frame: CarriedFrame) {
        let (at_us, late_ns) = (frame.at_us(), frame.late_ns());
        if let Some(bytes) = frame.carried() {
            let mut line = self.sends.borrow_mut();
            line.set_sender(self.life);
            line.send_late(at_us, late_ns, bytes);
        }
    }

    /// The next frame that has arrived by a time of the board's clock.
    pub fn arrived(&mut self, until_us: u64) -> CarriedFrame {
        let mut arrivals = self.arrivals.borrow_mut();
        arrivals.look(until_us);
        let mut line = self.hears.borrow_mut();
        line.set_receiver(self.life);
        while let Some(arrived) = line.take(until_us) {
            if arrived.byte == DELIMITER {
                let bytes = std::mem::take(&mut self.arriving);
                if !bytes.is_empty() {
                    let frame = CarriedFrame::new(arrived.at_us, 0, &bytes);
                    let fits = bytes.len() < MAX_WIRE_BYTES;
                    arrivals.take(arrived.at_us, Came::Wire(fits.then_some(bytes)));
                    return frame;
                }
            } else if self.arriving.len() <= MAX_WIRE_BYTES {
                self.arriving.push(arrived.byte);
            }
        }
        CarriedFrame::NONE
    }
}

/// A UART.
struct LineEnd {
    sends: Rc<RefCell<Line>>,
    hears: Rc<RefCell<Line>>,
    life: Life,
    receiver: Receiver,
}

impl LinkDevice for LineEnd {
    fn send(
        &mut self,
        start_us: u64,
        header: Header,
        payload_bytes: usize,
        write: &mut dyn FnMut(&mut [u8]),
    ) -> bool {
        let mut line = self.sends.borrow_mut();
        line.set_sender(self.life);
        // It has room for a frame behind the one that it sends.
        if line.is_behind(start_us, MAX_WIRE_BYTES) {
            return false;
        }
        let mut bytes = [0; MAX_WIRE_BYTES];
        let Ok(length) = wire::encode_with(header, payload_bytes, &mut bytes, write) else {
            return false;
        };
        line.send(start_us, bytes.get(..length).unwrap_or_default());
        true
    }

    fn receive(&mut self, until_us: u64, frames: &dyn InFrames, take: Taken<'_>) {
        let mut line = self.hears.borrow_mut();
        line.set_receiver(self.life);
        while let Some(arrived) = line.take(until_us) {
            let mut bytes = &[arrived.byte][..];
            if let Some(outcome) = self.receiver.take(&mut bytes, frames) {
                take(outcome, arrived.at_us);
            }
        }
    }
}

fn memories(clocks: [Clock; 2]) -> [Rc<RefCell<SharedMemory>>; 2] {
    let [first, second] = clocks;
    [(first, second), (second, first)]
        .map(|(writer, reader)| shared(SharedMemory::new(writer, reader)))
}

/// Memory of two processors. Frames are there as they are on a line, so that their configuration is
/// checked in the same way.
struct MemoryEnd {
    writes: Rc<RefCell<SharedMemory>>,
    reads: Rc<RefCell<SharedMemory>>,
    life: Life,
    receiver: Receiver,
}

impl LinkDevice for MemoryEnd {
    fn send(
        &mut self,
        start_us: u64,
        header: Header,
        payload_bytes: usize,
        write: &mut dyn FnMut(&mut [u8]),
    ) -> bool {
        let mut bytes = [0; MAX_WIRE_BYTES];
        let Ok(length) = wire::encode_with(header, payload_bytes, &mut bytes, write) else {
            return false;
        };
        let bytes = bytes.get(..length).unwrap_or_default();
        let mut memory = self.writes.borrow_mut();
        memory.set_writer(self.life);
        memory.write(start_us, bytes);
        true
    }

    fn receive(&mut self, until_us: u64, frames: &dyn InFrames, take: Taken<'_>) {
        let mut memory = self.reads.borrow_mut();
        memory.set_reader(self.life);
        while let Some(written) = memory.take(until_us) {
            let mut bytes = &written.bytes[..];
            while let Some(outcome) = self.receiver.take(&mut bytes, frames) {
                take(outcome, written.at_us);
            }
        }
    }
}

fn bus(
    link: &Link,
    clocks: [Clock; 2],
    of_blob: &WiredLink,
    number: u64,
    seed: u64,
) -> Rc<RefCell<Bus>> {
    let settings = BusSettings {
        rate_bps: of_blob.rate_bps,
        noise: link.noise,
        loss: link.loss,
        cuts: link.cuts.clone(),
    };
    shared(Bus::new(settings, Fate::new(seed, number), clocks.to_vec()))
}

/// A controller on a bus.
struct CanNode {
    bus: Rc<RefCell<Bus>>,
    node: usize,
    life: Life,
}

impl LinkDevice for CanNode {
    fn send(
        &mut self,
        start_us: u64,
        header: Header,
        payload_bytes: usize,
        write: &mut dyn FnMut(&mut [u8]),
    ) -> bool {
        let mut payload = [0; MAX_PAYLOAD_BYTES];
        let payload = payload.get_mut(..payload_bytes);
        let (Some(identifier), Some(payload)) = (can::identifier(header), payload) else {
            return false;
        };
        write(payload);
        let mut bus = self.bus.borrow_mut();
        bus.set_node(self.node, self.life);
        bus.send(self.node, start_us, identifier, payload).is_ok()
    }

    fn receive(&mut self, until_us: u64, frames: &dyn InFrames, take: Taken<'_>) {
        let mut bus = self.bus.borrow_mut();
        bus.set_node(self.node, self.life);
        // Whoever sends before this time has given it already.
        bus.advance_to(self.life.clock.plant_ps(until_us));
        while let Some(heard) = bus.take(self.node, until_us) {
            take(
                can::receive(heard.identifier, &heard.data, frames),
                heard.at_us,
            );
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::system::read::read;
    use esm_link::frames::configuration::{Configuration, Content};
    use esm_link::frames::receiver::{InFrame, ReceiveError, SortedFrames};

    const FRAME: u16 = 7;

    fn configuration() -> Configuration {
        Configuration::of(FRAME, Content::Value("Twist"), 8, 10_000)
    }

    /// The devices of two processors with a link between them, and one that leads nowhere.
    fn pair(link: &str) -> Vec<Devices> {
        let text = format!(
            "processor a mission \"a\"; processor b mission \"b\"; link a.one to b.two {link};"
        );
        let system = read(&text).0.unwrap();
        let wired = |name: &str| WiredLink {
            name: name.to_owned(),
            rate_bps: 1_000_000,
            bits: 10,
            ..WiredLink::default()
        };
        let life = Life::whole(Clock::new(0, 0));
        let processors = [
            Links {
                processor: 0,
                life,
                links: vec![wired("open"), wired("one")],
            },
            Links {
                processor: 1,
                life,
                links: vec![wired("two")],
            },
        ];
        let ends = wires(&system.links, &processors, 1).ends;
        let devices = ends.into_iter();
        devices
            .map(|ends| ends.into_iter().map(|end| end.device).collect())
            .collect()
    }

    fn send(
        device: &mut dyn LinkDevice,
        start_us: u64,
        number: u8,
        configuration: Configuration,
    ) -> bool {
        let header = Header {
            identifier: FRAME,
            number,
            configuration,
        };
        device.send(start_us, header, 8, &mut |payload| payload.fill(number))
    }

    fn receive(device: &mut dyn LinkDevice, until_us: u64) -> Vec<(Result<u8, ReceiveError>, u64)> {
        let frames = [InFrame {
            identifier: FRAME,
            payload_bytes: 8,
            configuration: configuration(),
        }];
        let frames = SortedFrames::new(&frames).unwrap();
        let mut taken = Vec::new();
        device.receive(until_us, &frames, &mut |arrived, at_us| {
            let number = arrived.map(|it| {
                assert_eq!(it.payload, [it.number; 8]);
                it.number
            });
            taken.push((number, at_us));
        });
        taken
    }

    #[test]
    fn a_frame_arrives_over_each_medium_and_the_open_line_has_none() {
        // 18 bytes with 10 bits each; at once; some 135 bits.
        for (link, from_us, to_us) in [
            ("", 180, 180),
            ("delay 1 ms", 1_180, 1_180),
            ("over memory", 0, 0),
            ("over can", 120, 160),
        ] {
            let mut both = pair(link);
            let (a, b) = both.split_at_mut(1);
            let (open, one, two) = {
                let (open, one) = a[0].split_at_mut(1);
                (&mut open[0], &mut one[0], &mut b[0][0])
            };
            assert!(send(&mut **one, 5_000, 200, configuration()));
            assert!(send(&mut **open, 5_000, 201, configuration()));
            assert_eq!(receive(&mut **two, 4_999), [], "{link}");
            let there = receive(&mut **two, 10_000);
            assert!(matches!(there[..], [(Ok(200), _)]), "{link} {there:?}");
            let after_us = there[0].1 - 5_000;
            assert!((from_us..=to_us).contains(&after_us), "{link} {after_us}");
            assert_eq!(receive(&mut **one, 10_000), [], "{link}");
            assert_eq!(receive(&mut **open, 10_000), [], "{link}");
            // The other way, and one that means something else.
            let other = Configuration::of(FRAME, Content::Value("Twist"), 8, 20_000);
            assert!(send(&mut **two, 20_000, 1, other));
            assert!(send(&mut **two, 30_000, 2, configuration()));
            let back: Vec<_> = receive(&mut **one, 40_000)
                .into_iter()
                .map(|it| it.0)
                .collect();
            assert_eq!(back, [Err(ReceiveError::Configuration), Ok(2)], "{link}");
        }
    }

    #[test]
    fn a_line_that_is_far_behind_takes_no_more() {
        let mut both = pair("");
        let one = &mut *both[0][1];
        let taken = (0..100).take_while(|number| send(one, 0, *number, configuration()));
        // 250 bytes behind at most, with 18 each.
        assert_eq!(taken.count(), 14);
        assert!(send(one, 10_000, 0, configuration()));
    }

    #[test]
    fn a_cut_and_losses_take_frames_whole() {
        let numbers = |link: &str| -> Vec<u8> {
            let mut both = pair(link);
            for number in 0..200 {
                assert!(send(
                    &mut *both[0][1],
                    u64::from(number) * 1_000,
                    number,
                    configuration()
                ));
            }
            let taken = receive(&mut *both[1][0], 1_000_000).into_iter();
            taken.filter_map(|it| it.0.ok()).collect()
        };
        let cut = numbers("cut 50 ms to 100 ms");
        assert_eq!(cut, (0..50).chain(100..200).collect::<Vec<u8>>());
        let lossy = numbers("loss 10 %");
        assert!((160..195).contains(&lossy.len()), "{}", lossy.len());
        assert_eq!(lossy, numbers("loss 10 %"));
        let of_can = numbers("over can loss 10 %");
        assert!((160..195).contains(&of_can.len()), "{}", of_can.len());
    }
}
