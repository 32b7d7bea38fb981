//! A CAN bus: who has the lower identifier goes first, and everybody else hears it.
//!
//! Frames are the data frames with 29-bit identifiers of ISO 11898-1 (classical CAN), bit by bit:
//! stuff bits follow from identifier and data. A frame that is damaged is not sent again.

use std::collections::VecDeque;

use super::chance::{Chance, Fate};
use super::clock::{Clock, Life};
use super::plant_time::{Cut, PS_IN_S, is_cut};

/// Bits of an identifier.
const IDENTIFIER_BITS: u32 = 29;
/// Those of it that come before two bits that say so.
const BASE_BITS: u32 = 11;
/// After so many equal bits another one is stuffed in.
const EQUAL_BITS: u32 = 5;
/// Of the checksum, and its polynomial.
const CRC_BITS: u32 = 15;
const CRC_POLYNOMIAL: u32 = 0x4599;
/// What is not stuffed: delimiter of the checksum, acknowledgement and its delimiter, end.
const END_BITS: u64 = 1 + 2 + 7;
/// Between two frames.
const INTERFRAME_BITS: u64 = 3;
/// Greatest number of bytes of data.
pub const MAX_DATA_BYTES: usize = 8;

/// What a bus is like.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BusSettings {
    /// Bits a second.
    pub rate_bps: u32,
    /// How probable it is that a bit is damaged, and its frame with it.
    pub noise: Chance,
    /// How probable it is that nobody hears a frame.
    pub loss: Chance,
    /// When the cable is cut.
    pub cuts: Vec<Cut>,
}

/// Why a frame cannot be sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SendError {
    /// No node has this number.
    #[error("no node of the bus has this number")]
    Node,
    /// The identifier has more than 29 bits.
    #[error("an identifier of CAN has 29 bits")]
    Identifier,
    /// There is more data than a frame takes.
    #[error("a frame of CAN takes {MAX_DATA_BYTES} bytes of data")]
    Data,
}

/// A frame that waits for the bus.
#[derive(Clone, Debug)]
struct Waiting {
    ready_ps: u64,
    /// Its node is reset then.
    until_ps: u64,
    node: usize,
    identifier: u32,
    data: Vec<u8>,
}

/// A frame that a node has heard.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Heard {
    /// When its last bit was over, by the clock of who heard it.
    pub at_us: u64,
    /// Its identifier.
    pub identifier: u32,
    /// Its data.
    pub data: Vec<u8>,
}

/// A bus and its nodes.
#[derive(Clone, Debug)]
pub struct Bus {
    settings: BusSettings,
    fate: Fate,
    nodes: Vec<Life>,
    /// In the order in which they were given.
    waiting: Vec<Waiting>,
    heard: Vec<VecDeque<(u64, u32, Vec<u8>)>>,
    /// When the bus is free, in picoseconds of plant time.
    free_ps: u64,
}

impl Bus {
    /// A bus with nodes that have these clocks.
    #[must_use]
    pub fn new(settings: BusSettings, fate: Fate, clocks: Vec<Clock>) -> Self {
        Bus {
            settings,
            fate,
            heard: vec![VecDeque::new(); clocks.len()],
            nodes: clocks.into_iter().map(Life::whole).collect(),
            waiting: Vec::new(),
            free_ps: 0,
        }
    }

    /// A node is from now on the processor as it is between two resets.
    pub fn set_node(&mut self, node: usize, life: Life) {
        if let Some(of_node) = self.nodes.get_mut(node) {
            *of_node = life;
        }
    }

    /// Gives a node a frame to be sent from a time of its clock on.
    ///
    /// # Errors
    /// [`SendError`]
    pub fn send(
        &mut self,
        node: usize,
        start_us: u64,
        identifier: u32,
        data: &[u8],
    ) -> Result<(), SendError> {
        let life = self.nodes.get(node).ok_or(SendError::Node)?;
        if identifier >> IDENTIFIER_BITS != 0 {
            return Err(SendError::Identifier);
        }
        if data.len() > MAX_DATA_BYTES {
            return Err(SendError::Data);
        }
        let ready_ps = life.clock.plant_ps(start_us);
        if ready_ps >= life.to_ps {
            // It is reset before.
            return Ok(());
        }
        self.waiting.push(Waiting {
            ready_ps,
            until_ps: life.to_ps,
            node,
            identifier,
            data: data.to_vec(),
        });
        Ok(())
    }

    /// Lets the bus work up to a plant time, in picoseconds: all frames that are ready before were
    /// given.
    pub fn advance_to(&mut self, plant_ps: u64) {
        while let Some(ready_ps) = self.waiting.iter().map(|it| it.ready_ps).min() {
            let begins_ps = ready_ps.max(self.free_ps);
            if begins_ps >= plant_ps {
                break;
            }
            // One that waited for the bus when its node was reset is gone.
            self.waiting.retain(|it| it.until_ps > begins_ps);
            let ready = (self.waiting.iter().enumerate()).filter(|it| it.1.ready_ps <= begins_ps);
            let Some((first, _)) = ready.min_by_key(|(_, it)| it.identifier) else {
                continue;
            };
            let frame = self.waiting.remove(first);
            // Who sends the same identifier at the same time has won as well: both go on, and the
            // first bit in which they differ damages both.
            let is_twin = |it: &Waiting| {
                it.identifier == frame.identifier
                    && it.node != frame.node
                    && it.ready_ps <= begins_ps
            };
            let is_damaged = (self.waiting.iter()).any(|it| is_twin(it) && it.data != frame.data);
            self.waiting.retain(|it| !is_twin(it));
            self.transmit(begins_ps, frame, is_damaged);
        }
    }

    /// The next frame that a node has heard by a time of its clock.
    pub fn take(&mut self, node: usize, until_us: u64) -> Option<Heard> {
        let Life { clock, from_ps, .. } = *self.nodes.get(node)?;
        let heard = self.heard.get_mut(node)?;
        // What came before a reset is gone with it.
        while heard.pop_front_if(|it| it.0 < from_ps).is_some() {}
        let there = |it: &mut (u64, u32, Vec<u8>)| clock.local_us(it.0) <= until_us;
        let (at_ps, identifier, data) = heard.pop_front_if(there)?;
        Some(Heard {
            at_us: clock.local_us(at_ps),
            identifier,
            data,
        })
    }

    fn transmit(&mut self, begins_ps: u64, frame: Waiting, collides: bool) {
        let bits = frame_bits(frame.identifier, &frame.data);
        let rate = u128::from(self.settings.rate_bps.max(1));
        let after = |bits: u64| {
            let ps = u128::from(bits) * u128::from(PS_IN_S) / rate;
            begins_ps.saturating_add(ps as u64)
        };
        let ends_ps = after(bits);
        self.free_ps = after(bits + INTERFRAME_BITS);
        let noise = self.settings.noise;
        let is_damaged = (0..bits).fold(false, |damaged, _| self.fate.decide(noise) | damaged);
        if is_damaged
            || collides
            || self.fate.decide(self.settings.loss)
            || is_cut(&self.settings.cuts, begins_ps, ends_ps)
            || ends_ps > frame.until_ps
        {
            return;
        }
        for (node, heard) in self.heard.iter_mut().enumerate() {
            if node != frame.node {
                heard.push_back((ends_ps, frame.identifier, frame.data.clone()));
            }
        }
    }
}

/// How many bits a frame with so many bytes of data takes at least, up to its end: without any that
/// are stuffed in.
#[must_use]
pub const fn least_bits(data_bytes: u64) -> u64 {
    const START_BITS: u64 = 1 + IDENTIFIER_BITS as u64 + 2 + 3 + 4;
    START_BITS + CRC_BITS as u64 + END_BITS + 8 * data_bytes
}

/// How many bits a frame takes, up to its end.
fn frame_bits(identifier: u32, data: &[u8]) -> u64 {
    let mut bits = Bits::default();
    // Start of frame; the identifier, with two recessive bits between its parts, and what says that
    // it is a data frame; two reserved bits.
    bits.take(0, 1);
    bits.take(identifier >> (IDENTIFIER_BITS - BASE_BITS), BASE_BITS);
    bits.take(0b11, 2);
    bits.take(identifier, IDENTIFIER_BITS - BASE_BITS);
    bits.take(0, 3);
    bits.take(data.len() as u32, 4);
    for byte in data {
        bits.take((*byte).into(), u8::BITS);
    }
    let crc = bits.crc;
    bits.take(crc, CRC_BITS);
    bits.count + END_BITS
}

/// What has been sent of a frame.
#[derive(Default)]
struct Bits {
    count: u64,
    crc: u32,
    last: u32,
    equal: u32,
}

impl Bits {
    /// Sends the lowest `count` bits, the highest of them first.
    fn take(&mut self, bits: u32, count: u32) {
        for place in (0..count).rev() {
            let bit = bits >> place & 1;
            let feedback = bit ^ self.crc >> (CRC_BITS - 1) & 1;
            self.crc = ((self.crc << 1) ^ (feedback * CRC_POLYNOMIAL)) & ((1 << CRC_BITS) - 1);
            self.put(bit);
        }
    }

    fn put(&mut self, bit: u32) {
        self.count += 1;
        self.equal = if self.equal > 0 && bit == self.last {
            self.equal + 1
        } else {
            1
        };
        self.last = bit;
        if self.equal == EQUAL_BITS {
            // The bit that is stuffed in is the first of the next that may be equal.
            self.count += 1;
            self.last = bit ^ 1;
            self.equal = 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::medium::PS_IN_US;

    fn bus(nodes: usize) -> Bus {
        let settings = BusSettings {
            rate_bps: 1_000_000,
            noise: Chance::NEVER,
            loss: Chance::NEVER,
            cuts: Vec::new(),
        };
        Bus::new(settings, Fate::new(1, 0), vec![Clock::new(0, 0); nodes])
    }

    fn heard(bus: &mut Bus, node: usize) -> Vec<(u64, u32)> {
        std::iter::from_fn(|| bus.take(node, u64::MAX))
            .map(|it| (it.at_us, it.identifier))
            .collect()
    }

    #[test]
    fn a_frame_is_as_long_as_the_standard_makes_it() {
        // Without stuff bits 64 and 8 a byte; with as many as there can be, a quarter more of what
        // is stuffed.
        for (identifier, data, expected) in [
            (0x0AAA_AAAA, &[0x55; 8][..], 128..=140),
            (0, &[], 64..=64 + 13),
            (0, &[0; 8], 128 + 15..=128 + 29),
        ] {
            let bits = frame_bits(identifier, data);
            assert!(least_bits(data.len() as u64) <= bits);
            assert!(expected.contains(&bits), "{bits} {expected:?}");
        }
        // The checksum of the sequence of bits 1 is the polynomial.
        let mut bits = Bits::default();
        bits.take(1, 1);
        assert_eq!(bits.crc, CRC_POLYNOMIAL);
        // Five equal bits bring a sixth, which counts for the next five.
        let mut bits = Bits::default();
        bits.take(0, 5);
        bits.take(0b1111, 4);
        assert_eq!(bits.count, 11);
    }

    #[test]
    fn the_lower_identifier_goes_first_and_a_frame_is_not_interrupted() {
        let mut bus = bus(3);
        bus.send(0, 10, 0x1555, &[1]).unwrap();
        bus.send(1, 10, 0x0555, &[2]).unwrap();
        bus.send(2, 11, 0x0055, &[3]).unwrap();
        bus.advance_to(1_000 * PS_IN_US);
        let identifiers = |heard: Vec<(u64, u32)>| -> Vec<u32> {
            assert!(heard.is_sorted());
            heard.into_iter().map(|it| it.1).collect()
        };
        assert_eq!(identifiers(heard(&mut bus, 0)), [0x0555, 0x0055]);
        assert_eq!(identifiers(heard(&mut bus, 1)), [0x0055, 0x1555]);
        assert_eq!(identifiers(heard(&mut bus, 2)), [0x0555, 0x1555]);
    }

    #[test]
    fn a_bus_works_no_further_than_it_is_told() {
        let mut bus = bus(2);
        bus.send(0, 10, 5, &[]).unwrap();
        bus.advance_to(10 * PS_IN_US);
        // Something more urgent comes at the same time.
        bus.send(1, 10, 4, &[]).unwrap();
        bus.advance_to(11 * PS_IN_US);
        let first = bus.take(0, u64::MAX).unwrap();
        assert_eq!(first.identifier, 4);
        assert_eq!(bus.take(1, u64::MAX), None);
        bus.advance_to(200 * PS_IN_US);
        let second = bus.take(1, u64::MAX).unwrap();
        assert!(second.at_us > first.at_us + 64);
    }

    #[test]
    fn two_nodes_that_send_one_identifier_at_one_time_damage_each_other() {
        let mut bus = bus(3);
        // With other data; with equal data; one behind the other.
        for (start_us, both) in [(1_000, [1, 2]), (2_000, [3, 3])] {
            bus.send(0, start_us, 5, &[both[0]]).unwrap();
            bus.send(1, start_us, 5, &[both[1]]).unwrap();
        }
        bus.send(0, 3_000, 5, &[4]).unwrap();
        bus.send(1, 4_000, 5, &[5]).unwrap();
        // What waits meanwhile has the bus next.
        bus.send(2, 1_001, 9, &[9]).unwrap();
        bus.advance_to(u64::MAX);
        let data: Vec<u8> = std::iter::from_fn(|| bus.take(1, u64::MAX))
            .map(|it| it.data[0])
            .collect();
        assert_eq!(data, [9, 3, 4]);
        let data: Vec<u8> = std::iter::from_fn(|| bus.take(2, u64::MAX))
            .map(|it| it.data[0])
            .collect();
        assert_eq!(data, [3, 4, 5]);
    }

    #[test]
    fn a_node_that_is_reset_sends_nothing_more_and_has_heard_nothing() {
        let life = |from_us: u64, to_us: u64| Life {
            clock: Clock::new(from_us * PS_IN_US, 0),
            from_ps: from_us * PS_IN_US,
            to_ps: to_us * PS_IN_US,
        };
        let mut bus = bus(2);
        bus.set_node(0, life(0, 1_000));
        // The first is over before, the second is cut off, the third waits for it, the fourth would
        // begin later.
        for (start_us, identifier) in [(800, 1), (950, 2), (960, 3), (1_000, 4)] {
            bus.send(0, start_us, identifier, &[0x55; 8]).unwrap();
        }
        bus.advance_to(2_000 * PS_IN_US);
        bus.set_node(0, life(2_000, 9_000_000));
        bus.send(0, 100, 5, &[]).unwrap();
        bus.advance_to(9_000 * PS_IN_US);
        let identifiers: Vec<u32> = heard(&mut bus, 1).into_iter().map(|it| it.1).collect();
        assert_eq!(identifiers, [1, 5]);
        bus.send(1, 10_000, 6, &[]).unwrap();
        bus.advance_to(11_000 * PS_IN_US);
        bus.set_node(0, life(12_000, 9_000_000));
        assert_eq!(heard(&mut bus, 0), []);
    }

    #[test]
    fn a_damaged_frame_is_heard_by_nobody_and_what_is_wrong_is_refused() {
        let mut bus = bus(2);
        bus.settings.noise = Chance::new(0.001).unwrap();
        for nth in 0..1_000 {
            bus.send(0, nth * 1_000, 5, &[7; 8]).unwrap();
        }
        bus.advance_to(u64::MAX);
        let count = heard(&mut bus, 1).len();
        // Of 1,000 with about 135 bits each.
        assert!((840..910).contains(&count), "{count}");
        assert_eq!(bus.send(2, 0, 5, &[]), Err(SendError::Node));
        assert_eq!(bus.send(0, 0, 1 << 29, &[]), Err(SendError::Identifier));
        assert_eq!(bus.send(0, 0, 5, &[0; 9]), Err(SendError::Data));
    }
}
