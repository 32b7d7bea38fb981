//! One direction of a serial line: a UART at each end, or a pair of radio modems that pass on what
//! they get.

use std::collections::VecDeque;

use super::chance::{Chance, Fate};
use super::clock::Clock;
use super::plant_time::{Cut, PS_IN_S, is_cut};

/// Bits of a byte that noise can change.
const DATA_BITS: u32 = 8;

/// What a line is like.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LineSettings {
    /// Bits a second, by the sender's clock.
    pub rate_bps: u32,
    /// Bits that a byte takes.
    pub bits: u8,
    /// From the sender's pin to the receiver's, in picoseconds.
    pub delay_ps: u64,
    /// How probable it is that a bit arrives as the other one.
    pub noise: Chance,
    /// How probable it is that a byte does not arrive.
    pub byte_loss: Chance,
    /// How probable it is that nothing arrives of what was sent at once.
    pub loss: Chance,
    /// When the cable is cut.
    pub cuts: Vec<Cut>,
}

/// A byte that has arrived.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ArrivedByte {
    /// When its last bit was there, by the receiver's clock.
    pub at_us: u64,
    /// The byte.
    pub byte: u8,
}

/// One direction of a line.
#[derive(Clone, Debug)]
pub struct Line {
    settings: LineSettings,
    fate: Fate,
    /// The sender's clock, and the receiver's.
    sender: Clock,
    receiver: Clock,
    /// When the last bit is sent of all that was given, in picoseconds of plant time.
    free_ps: u64,
    /// Bytes on their way, with the times of their arrival.
    under_way: VecDeque<(u64, u8)>,
}

impl Line {
    /// A line on which nothing was sent.
    #[must_use]
    pub fn new(settings: LineSettings, fate: Fate, sender: Clock, receiver: Clock) -> Self {
        Line {
            settings,
            fate,
            sender,
            receiver,
            free_ps: 0,
            under_way: VecDeque::new(),
        }
    }

    /// One end has another clock from now on: its processor has begun anew.
    pub fn set_clocks(&mut self, sender: Clock, receiver: Clock) {
        self.sender = sender;
        self.receiver = receiver;
    }

    /// Sends bytes from a time of the sender's clock on, or behind what was given before. Answers
    /// when the first bit is sent, in picoseconds of plant time.
    pub fn send(&mut self, start_us: u64, bytes: &[u8]) -> u64 {
        let begins_ps = self.sender.plant_ps(start_us).max(self.free_ps);
        let is_lost = self.fate.decide(self.settings.loss);
        for (nth, byte) in bytes.iter().enumerate() {
            let sent = |count| begins_ps.saturating_add(self.length_ps(count));
            let (from_ps, to_ps) = (sent(nth), sent(nth + 1));
            let byte = self.noisy(*byte);
            let is_gone = self.fate.decide(self.settings.byte_loss)
                || is_cut(&self.settings.cuts, from_ps, to_ps);
            if !is_lost && !is_gone {
                let arrives_ps = to_ps.saturating_add(self.settings.delay_ps);
                self.under_way.push_back((arrives_ps, byte));
            }
        }
        self.free_ps = begins_ps.saturating_add(self.length_ps(bytes.len()));
        begins_ps
    }

    /// Whether what was given before is still being sent at a time of the sender's clock, and for
    /// longer than so many bytes take.
    #[must_use]
    pub fn is_behind(&self, start_us: u64, bytes: usize) -> bool {
        let start_ps = self.sender.plant_ps(start_us);
        self.free_ps > start_ps.saturating_add(self.length_ps(bytes))
    }

    /// When the next byte arrives, in picoseconds of plant time.
    #[must_use]
    pub fn next_ps(&self) -> Option<u64> {
        self.under_way.front().map(|(at_ps, _)| *at_ps)
    }

    /// The next byte that has arrived by a time of the receiver's clock, in the order of arrival.
    pub fn take(&mut self, until_us: u64) -> Option<ArrivedByte> {
        let receiver = self.receiver;
        let arrived = |(at_ps, _): &mut (u64, u8)| receiver.local_us(*at_ps) <= until_us;
        let (at_ps, byte) = self.under_way.pop_front_if(arrived)?;
        let at_us = receiver.local_us(at_ps);
        Some(ArrivedByte { at_us, byte })
    }

    /// How long so many bytes take, in picoseconds of plant time: from the first one on, so that
    /// nothing is lost by rounding.
    fn length_ps(&self, bytes: usize) -> u64 {
        let bits = bytes as u128 * u128::from(self.settings.bits);
        let nominal_ps = bits * u128::from(PS_IN_S) / u128::from(self.settings.rate_bps.max(1));
        self.sender.stretched_ps(nominal_ps)
    }

    fn noisy(&mut self, byte: u8) -> u8 {
        let noise = self.settings.noise;
        (0..DATA_BITS).fold(byte, |byte, bit| {
            byte ^ u8::from(self.fate.decide(noise)) << bit
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::medium::PS_IN_US;

    const RATE_BPS: u32 = 115_200;

    fn settings() -> LineSettings {
        LineSettings {
            rate_bps: RATE_BPS,
            bits: 10,
            delay_ps: 0,
            noise: Chance::NEVER,
            byte_loss: Chance::NEVER,
            loss: Chance::NEVER,
            cuts: Vec::new(),
        }
    }

    fn line(settings: LineSettings) -> Line {
        let clock = Clock::new(0, 0);
        Line::new(settings, Fate::new(1, 0), clock, clock)
    }

    fn all(line: &mut Line) -> Vec<(u64, u8)> {
        std::iter::from_fn(|| line.take(u64::MAX))
            .map(|arrived| (arrived.at_us, arrived.byte))
            .collect()
    }

    #[test]
    fn bytes_arrive_at_the_lines_rate_one_behind_the_other() {
        let mut line = line(LineSettings {
            delay_ps: 200 * PS_IN_US,
            ..settings()
        });
        assert_eq!(line.send(1_000, b"abc"), 1_000 * PS_IN_US);
        // Before the first are through: they wait.
        let second_ps = line.send(1_100, b"d");
        assert_eq!(second_ps, 1_260_416_666);
        assert_eq!(line.next_ps(), Some(1_286_805_555));
        assert_eq!(line.take(1_285), None);
        let first = ArrivedByte {
            at_us: 1_286,
            byte: b'a',
        };
        assert_eq!(line.take(1_286), Some(first));
        assert_eq!(
            all(&mut line),
            [(1_373, b'b'), (1_460, b'c'), (1_547, b'd')]
        );
    }

    #[test]
    fn each_end_goes_by_its_own_clock() {
        let (fast, slow) = (Clock::new(0, 100_000), Clock::new(50 * PS_IN_US, -100_000));
        let mut line = Line::new(settings(), Fate::new(1, 0), fast, slow);
        let hour_us = 3_600 * 1_000_000;
        let sent_ps = line.send(hour_us, b"x");
        assert_eq!(sent_ps, fast.plant_ps(hour_us));
        // Two times 0.36 s, the time for a byte, and 50 µs.
        let arrived = line.take(u64::MAX).unwrap();
        assert_eq!(arrived.at_us, hour_us - 720_000 + 108);
    }

    #[test]
    fn a_cut_takes_the_bytes_that_it_meets() {
        let mut line = line(LineSettings {
            cuts: vec![Cut {
                from_ps: 100 * PS_IN_US,
                to_ps: 200 * PS_IN_US,
            }],
            ..settings()
        });
        line.send(0, b"abcd");
        assert_eq!(all(&mut line), [(86, b'a'), (347, b'd')]);
    }

    #[test]
    fn noise_and_losses_are_as_frequent_as_they_are_said_to_be() {
        let chance = |of| Chance::new(of).unwrap();
        let sent = [0x55; 100_000];
        let run = |settings: LineSettings| {
            let mut line = line(settings);
            for part in sent.chunks(100) {
                line.send(0, part);
            }
            all(&mut line)
        };
        let noisy = run(LineSettings {
            noise: chance(0.001),
            ..settings()
        });
        let changed: u32 = noisy
            .iter()
            .map(|(_, byte)| (byte ^ 0x55).count_ones())
            .sum();
        assert!((700..900).contains(&changed), "{changed}");
        let holey = run(LineSettings {
            byte_loss: chance(0.01),
            ..settings()
        });
        assert!((98_500..99_500).contains(&holey.len()), "{}", holey.len());
        let lossy = run(LineSettings {
            loss: chance(0.1),
            ..settings()
        });
        assert!((85_000..95_000).contains(&lossy.len()), "{}", lossy.len());
        assert_eq!(lossy.len() % 100, 0);
        assert!(lossy.is_sorted());
    }
}
