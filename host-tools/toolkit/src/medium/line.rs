//! One direction of a serial line: a UART at each end, or a pair of radio modems that pass on what
//! they get.

use std::collections::VecDeque;

use super::chance::{Chance, Fate};
use super::clock::{Clock, Life};
use super::plant_time::{Cut, PS_IN_S, is_cut};

/// Picoseconds in a nanosecond.
const PS_IN_NS: u128 = 1_000;
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

/// What was sent so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Sent {
    /// How often something was sent at once.
    pub count: u64,
    /// By how much the first bit of any of it was too late at most, in picoseconds.
    pub latest_ps: u64,
}

/// Something that is to be sent at once.
#[derive(Clone, Debug)]
struct Waiting {
    start_ps: u64,
    /// Its sender is reset then.
    until_ps: u64,
    bytes: Vec<u8>,
}

/// One direction of a line.
#[derive(Clone, Debug)]
pub struct Line {
    settings: LineSettings,
    fate: Fate,
    sender: Life,
    receiver: Life,
    /// What is to be sent, in the order of its starts in picoseconds of plant time.
    waiting: VecDeque<Waiting>,
    /// When the last bit is sent of all that was begun, in picoseconds of plant time.
    free_ps: u64,
    sent: Sent,
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
            sender: Life::whole(sender),
            receiver: Life::whole(receiver),
            waiting: VecDeque::new(),
            free_ps: 0,
            sent: Sent::default(),
            under_way: VecDeque::new(),
        }
    }

    /// Who sends from now on: the processor as it is between two resets.
    pub fn set_sender(&mut self, sender: Life) {
        self.sender = sender;
    }

    /// Who receives from now on.
    pub fn set_receiver(&mut self, receiver: Life) {
        self.receiver = receiver;
    }

    /// Sends bytes from a time of the sender's clock on, or behind what is to start before. What is
    /// given later may start earlier, but not before what has been taken.
    pub fn send(&mut self, start_us: u64, bytes: &[u8]) {
        self.send_late(start_us, 0, bytes);
    }

    /// The same of a sender that is late, by so many nanoseconds of its clock. That is noted, and
    /// moves nothing: else what is received in which activation would depend on how quick a sender
    /// is, and no board would leave the trace of another.
    pub fn send_late(&mut self, start_us: u64, late_ns: u32, bytes: &[u8]) {
        let start_ps = self.sender.clock.plant_ps(start_us);
        if start_ps >= self.sender.to_ps {
            // It is reset before.
            return;
        }
        let late_ps = (self.sender.clock).stretched_ps(u128::from(late_ns) * PS_IN_NS);
        let place = (self.waiting).partition_point(|it| it.start_ps <= start_ps);
        let waiting = Waiting {
            start_ps,
            until_ps: self.sender.to_ps,
            bytes: bytes.to_vec(),
        };
        self.waiting.insert(place, waiting);
        self.sent.count += 1;
        self.sent.latest_ps = self.sent.latest_ps.max(late_ps);
    }

    /// What was sent so far.
    #[must_use]
    pub fn sent(&self) -> Sent {
        self.sent
    }

    /// Begins all that starts by a plant time.
    fn begin_until(&mut self, plant_ps: u64) {
        while let Some(waiting) = self.waiting.pop_front_if(|it| it.start_ps <= plant_ps) {
            self.begin(&waiting);
        }
    }

    fn begin(&mut self, waiting: &Waiting) {
        let Waiting {
            start_ps,
            until_ps,
            ref bytes,
        } = *waiting;
        let begins_ps = start_ps.max(self.free_ps);
        let behind_ps = begins_ps - start_ps;
        self.sent.latest_ps = self.sent.latest_ps.max(behind_ps);
        let is_lost = self.fate.decide(self.settings.loss);
        for (nth, byte) in bytes.iter().enumerate() {
            let sent = |count| begins_ps.saturating_add(self.length_ps(count));
            let (from_ps, to_ps) = (sent(nth), sent(nth + 1));
            let byte = self.noisy(*byte);
            let is_gone = self.fate.decide(self.settings.byte_loss)
                || is_cut(&self.settings.cuts, from_ps, to_ps)
                || to_ps > until_ps;
            if !is_lost && !is_gone {
                let arrives_ps = to_ps.saturating_add(self.settings.delay_ps);
                self.under_way.push_back((arrives_ps, byte));
            }
        }
        let ends_ps = begins_ps.saturating_add(self.length_ps(bytes.len()));
        // Who is reset falls silent.
        self.free_ps = ends_ps.min(until_ps).max(self.free_ps);
    }

    /// Whether what starts before is still being sent at a time of the sender's clock, and for
    /// longer than so many bytes take.
    #[must_use]
    pub fn is_behind(&self, start_us: u64, bytes: usize) -> bool {
        let start_ps = self.sender.clock.plant_ps(start_us);
        let before = (self.waiting.iter()).take_while(|it| it.start_ps <= start_ps);
        let free_ps = before.fold(self.free_ps, |free_ps, it| {
            let length_ps = self.length_ps(it.bytes.len());
            free_ps.max(it.start_ps).saturating_add(length_ps)
        });
        free_ps > start_ps.saturating_add(self.length_ps(bytes))
    }

    /// The next byte that has arrived by a time of the receiver's clock, in the order of arrival.
    pub fn take(&mut self, until_us: u64) -> Option<ArrivedByte> {
        let Life { clock, from_ps, .. } = self.receiver;
        let receiver = clock;
        self.begin_until(receiver.plant_ps(until_us.saturating_add(1)));
        // What came before a reset is gone with it.
        while self.under_way.pop_front_if(|it| it.0 < from_ps).is_some() {}
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
        self.sender.clock.stretched_ps(nominal_ps)
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
    fn who_is_reset_falls_silent_and_has_heard_nothing() {
        // 10 bytes take 868 us.
        let life = |from_us: u64, to_us: u64| Life {
            clock: Clock::new(from_us * PS_IN_US, 0),
            from_ps: from_us * PS_IN_US,
            to_ps: to_us * PS_IN_US,
        };
        let mut line = line(settings());
        line.set_sender(life(0, 1_500));
        line.send(1_000, b"0123456789");
        line.send(1_400, b"behind");
        line.send(1_600, b"never");
        assert_eq!(line.sent().count, 2);
        // It begins anew 100 us later: 5 bytes were through, and the line is free.
        line.set_sender(life(1_600, 9_000_000));
        line.send(0, b"new");
        let heard = all(&mut line);
        let bytes: Vec<u8> = heard.iter().map(|it| it.1).collect();
        assert_eq!(bytes, b"01234new");
        assert_eq!(heard[5].0, 1_686);
        // Who hears is reset: what came before is gone.
        line.send(1_000, b"ab");
        line.set_receiver(life(2_750, 9_000_000));
        assert_eq!(all(&mut line), [(23, b'b')]);
    }

    #[test]
    fn bytes_arrive_at_the_lines_rate_one_behind_the_other() {
        let mut line = line(LineSettings {
            delay_ps: 200 * PS_IN_US,
            ..settings()
        });
        // Before the first are through: it waits.
        line.send(1_100, b"d");
        line.send(1_000, b"abc");
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
        let sent = Sent {
            count: 2,
            latest_ps: 160_416_666,
        };
        assert_eq!(line.sent(), sent);
    }

    #[test]
    fn what_starts_earlier_goes_first_and_who_is_late_is_told() {
        let mut line = line(settings());
        line.send_late(2_000, 3_000, b"b");
        line.send(1_000, b"a");
        assert!(line.is_behind(2_010, 0) && !line.is_behind(1_999, 0));
        assert_eq!(all(&mut line), [(1_086, b'a'), (2_086, b'b')]);
        let late = line.sent();
        assert_eq!((late.count, late.latest_ps), (2, 3 * PS_IN_US));
    }

    #[test]
    fn each_end_goes_by_its_own_clock() {
        let (fast, slow) = (Clock::new(0, 100_000), Clock::new(50 * PS_IN_US, -100_000));
        let mut line = Line::new(settings(), Fate::new(1, 0), fast, slow);
        let hour_us = 3_600 * 1_000_000;
        line.send(hour_us, b"x");
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
