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

use super::declaration::{Link, Medium};
use crate::host_board::OpenLine;
use crate::host_run::WiredLink;
use crate::medium::PS_IN_US;
use crate::medium::can::{Bus, BusSettings};
use crate::medium::chance::Fate;
use crate::medium::clock::Clock;
pub use crate::medium::line::Sent;
use crate::medium::line::{Line, LineSettings};
use crate::medium::memory::SharedMemory;

/// Directions of a link.
const WAYS: u64 = 2;

/// What is to be known of a processor's links.
#[derive(Clone, Debug)]
pub struct Links {
    /// Its clock.
    pub clock: Clock,
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
}

/// What lies between processors.
pub struct Wires {
    /// The ends of each processor, in the order of its links.
    pub ends: Vec<Vec<End>>,
    /// What crosses the links.
    pub traffic: Traffic,
}

/// What has crossed the links of a system.
#[derive(Clone, Default)]
pub struct Traffic(Vec<Option<[Rc<RefCell<Line>>; 2]>>);

impl Traffic {
    /// Of each link, what its first end and its second has sent; none where it is no line.
    #[must_use]
    pub fn sent(&self) -> Vec<Option<[Sent; 2]>> {
        let of = |lines: &[Rc<RefCell<Line>>; 2]| lines.each_ref().map(|it| it.borrow().sent());
        self.0.iter().map(|lines| lines.as_ref().map(of)).collect()
    }
}

/// Makes the ends of all links of each processor. A link that nothing is joined to leads nowhere.
#[must_use]
pub fn wires(links: &[Link], processors: &[Links], seed: u64) -> Wires {
    let mut ends: Vec<Vec<End>> = (processors.iter())
        .map(|it| it.links.iter().map(|_| End::open()).collect())
        .collect();
    let mut traffic = Traffic::default();
    for (number, link) in (0..).zip(links) {
        let of_link = link.ends.each_ref().map(|end| {
            let processor = processors.get(end.processor)?;
            let index = processor.links.iter().position(|it| it.name == end.link)?;
            let of_blob = processor.links.get(index)?;
            Some((end.processor, index, processor.clock, of_blob))
        });
        // One whose dispatchers are not used sends nothing and hears nothing.
        let [Some(first), Some(second)] = of_link else {
            traffic.0.push(None);
            continue;
        };
        let clocks = [first.2, second.2];
        let mut lines = None;
        let made = match link.medium {
            Medium::Line => {
                let numbers = [number * WAYS, number * WAYS + 1];
                let both = self::lines(link, clocks, first.3, numbers, seed);
                let [there, back] = lines.insert(both).each_ref().map(Rc::clone);
                [
                    Uart::new(Rc::clone(&there), Rc::clone(&back)),
                    Uart::new(back, there),
                ]
                .map(|uart| End {
                    device: Box::new(uart.device()),
                    uart: Some(uart),
                })
            }
            Medium::Memory => memories(clocks).map(|device| End { device, uart: None }),
            Medium::Can => {
                let nodes = nodes(link, clocks, first.3, number * WAYS, seed);
                nodes.map(|device| End { device, uart: None })
            }
        };
        traffic.0.push(lines);
        for (end, (processor, index, ..)) in made.into_iter().zip([first, second]) {
            let place = ends.get_mut(processor).and_then(|it| it.get_mut(index));
            if let Some(place) = place {
                *place = end;
            }
        }
    }
    Wires { ends, traffic }
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
    /// What has come of a frame.
    arriving: Vec<u8>,
}

impl Uart {
    fn new(sends: Rc<RefCell<Line>>, hears: Rc<RefCell<Line>>) -> Self {
        Uart {
            sends,
            hears,
            arriving: Vec::new(),
        }
    }

    fn device(&self) -> LineEnd {
        LineEnd {
            sends: Rc::clone(&self.sends),
            hears: Rc::clone(&self.hears),
            receiver: Receiver::new(),
        }
    }

    /// The board starts a frame.
    pub fn start(&mut self, mut frame: CarriedFrame) {
        let (at_us, late_ns) = (frame.at_us(), frame.late_ns());
        if let Some(bytes) = frame.carried() {
            self.sends.borrow_mut().send_late(at_us, late_ns, bytes);
        }
    }

    /// The next frame that has arrived by a time of the board's clock.
    pub fn arrived(&mut self, until_us: u64) -> CarriedFrame {
        let mut line = self.hears.borrow_mut();
        while let Some(arrived) = line.take(until_us) {
            if arrived.byte == DELIMITER {
                let bytes = std::mem::take(&mut self.arriving);
                if !bytes.is_empty() {
                    return CarriedFrame::new(arrived.at_us, 0, &bytes);
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
        while let Some(arrived) = line.take(until_us) {
            let mut bytes = &[arrived.byte][..];
            if let Some(outcome) = self.receiver.take(&mut bytes, frames) {
                take(outcome, arrived.at_us);
            }
        }
    }
}

fn memories(clocks: [Clock; 2]) -> [Box<dyn LinkDevice>; 2] {
    let [first, second] = clocks;
    let there = shared(SharedMemory::new(first, second));
    let back = shared(SharedMemory::new(second, first));
    let end = |writes: &Rc<RefCell<SharedMemory>>, reads: &Rc<RefCell<SharedMemory>>| {
        let (writes, reads) = (Rc::clone(writes), Rc::clone(reads));
        let receiver = Receiver::new();
        Box::new(MemoryEnd {
            writes,
            reads,
            receiver,
        }) as Box<dyn LinkDevice>
    };
    [end(&there, &back), end(&back, &there)]
}

/// Memory of two processors. Frames are there as they are on a line, so that their configuration is
/// checked in the same way.
struct MemoryEnd {
    writes: Rc<RefCell<SharedMemory>>,
    reads: Rc<RefCell<SharedMemory>>,
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
        self.writes.borrow_mut().write(start_us, bytes);
        true
    }

    fn receive(&mut self, until_us: u64, frames: &dyn InFrames, take: Taken<'_>) {
        while let Some(written) = self.reads.borrow_mut().take(until_us) {
            let mut bytes = &written.bytes[..];
            while let Some(outcome) = self.receiver.take(&mut bytes, frames) {
                take(outcome, written.at_us);
            }
        }
    }
}

fn nodes(
    link: &Link,
    clocks: [Clock; 2],
    of_blob: &WiredLink,
    number: u64,
    seed: u64,
) -> [Box<dyn LinkDevice>; 2] {
    let settings = BusSettings {
        rate_bps: of_blob.rate_bps,
        noise: link.noise,
        loss: link.loss,
        cuts: link.cuts.clone(),
    };
    let bus = shared(Bus::new(settings, Fate::new(seed, number), clocks.to_vec()));
    [(0, clocks[0]), (1, clocks[1])].map(|(node, clock)| {
        let bus = Rc::clone(&bus);
        Box::new(CanNode { bus, node, clock }) as Box<dyn LinkDevice>
    })
}

/// A controller on a bus.
struct CanNode {
    bus: Rc<RefCell<Bus>>,
    node: usize,
    clock: Clock,
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
        bus.send(self.node, start_us, identifier, payload).is_ok()
    }

    fn receive(&mut self, until_us: u64, frames: &dyn InFrames, take: Taken<'_>) {
        let mut bus = self.bus.borrow_mut();
        // Whoever sends before this time has given it already.
        bus.advance_to(self.clock.plant_ps(until_us));
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
        };
        let clock = Clock::new(0, 0);
        let processors = [
            Links {
                clock,
                links: vec![wired("open"), wired("one")],
            },
            Links {
                clock,
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
