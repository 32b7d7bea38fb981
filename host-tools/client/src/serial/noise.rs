//! A bad line: bytes corrupted, dropped and doubled, repeatable from a seed.

use std::io;
use std::time::Duration;

use super::ByteLink;
use super::clock::Clock;

/// How often a byte suffers what, in parts of [`Noise::WHOLE`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Noise {
    /// One of its bits is flipped.
    pub corrupted: u32,
    /// It is lost.
    pub dropped: u32,
    /// It comes twice.
    pub doubled: u32,
}

impl Noise {
    /// What the rates are parts of.
    pub const WHOLE: u32 = 1_000_000;

    /// Each of the three at the same rate, in parts of [`Noise::WHOLE`].
    pub const fn of_each(rate: u32) -> Self {
        Noise {
            corrupted: rate,
            dropped: rate,
            doubled: rate,
        }
    }
}

/// A link over a bad line.
pub struct Noisy<L> {
    link: L,
    noise: Noise,
    random: SplitMix,
    /// What is received suffers, too.
    both_ways: bool,
    /// What came twice and had no room yet.
    waiting: Vec<u8>,
}

impl<L: ByteLink> Noisy<L> {
    /// Lets `noise` at the bytes of `link`, in both directions. Equal seeds and bytes suffer
    /// equally.
    pub fn new(link: L, noise: Noise, seed: u64) -> Self {
        Noisy {
            link,
            noise,
            random: SplitMix(seed),
            both_ways: true,
            waiting: Vec::new(),
        }
    }

    /// The same, but only what is sent suffers.
    pub fn outwards(link: L, noise: Noise, seed: u64) -> Self {
        Noisy {
            both_ways: false,
            ..Noisy::new(link, noise, seed)
        }
    }

    /// The link, good as it was.
    pub fn into_inner(self) -> L {
        self.link
    }

    fn spoil(&mut self, bytes: &[u8]) -> Vec<u8> {
        let mut corrupt = Vec::with_capacity(bytes.len() + 1);
        for &byte in bytes {
            let Noise {
                corrupted,
                dropped,
                doubled,
            } = self.noise;
            let lot = (self.random.next() % u64::from(Noise::WHOLE)) as u32;
            if lot < dropped {
                continue;
            }
            let lot = lot - dropped;
            if lot < corrupted {
                corrupt.push(byte ^ (1 << (self.random.next() % 8)));
                continue;
            }
            corrupt.push(byte);
            if lot - corrupted < doubled {
                corrupt.push(byte);
            }
        }
        corrupt
    }
}

impl<L: ByteLink> ByteLink for Noisy<L> {
    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> io::Result<usize> {
        if !self.both_ways {
            return self.link.receive(buffer, timeout);
        }
        if self.waiting.is_empty() {
            let count = self.link.receive(buffer, timeout)?;
            self.waiting = self.spoil(&buffer[..count]);
        }
        let count = buffer.len().min(self.waiting.len());
        for (place, byte) in buffer.iter_mut().zip(self.waiting.drain(..count)) {
            *place = byte;
        }
        Ok(count)
    }

    fn send(&mut self, bytes: &[u8]) -> io::Result<()> {
        let corrupt = self.spoil(bytes);
        self.link.send(&corrupt)
    }

    fn set_rate(&mut self, baud: u32) -> io::Result<()> {
        self.link.set_rate(baud)
    }

    fn clock(&self) -> Clock {
        self.link.clock()
    }
}

/// The generator `SplitMix64` of Steele, Lea and Flood (2014): small, and good enough to choose
/// bytes.
struct SplitMix(u64);

impl SplitMix {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }
}

#[cfg(test)]
mod tests {
    use super::super::pipe;
    use super::*;

    fn heard_over(noise: Noise, sent: &[u8]) -> Vec<u8> {
        let (near, mut far) = pipe::pair();
        let mut near = Noisy::new(near, noise, 5);
        near.send(sent).unwrap();
        drop(near);
        let mut heard = Vec::new();
        let mut buffer = [0; 4096];
        while let Ok(count) = far.receive(&mut buffer, Duration::ZERO) {
            heard.extend_from_slice(&buffer[..count]);
        }
        heard
    }

    #[test]
    fn noise_comes_at_its_rate_and_the_same_each_time() {
        let sent = [0x55; 20_000];
        assert_eq!(heard_over(Noise::default(), &sent), sent);
        let one_percent = Noise::WHOLE / 100;
        let only = |corrupted, dropped, doubled| Noise {
            corrupted,
            dropped,
            doubled,
        };
        let near = |found: usize, expected: usize| found.abs_diff(expected) < 60;
        let dropped = heard_over(only(0, one_percent, 0), &sent);
        assert!(near(dropped.len(), 19_800), "{}", dropped.len());
        let doubled = heard_over(only(0, 0, one_percent), &sent);
        assert!(near(doubled.len(), 20_200), "{}", doubled.len());
        let corrupted = heard_over(only(one_percent, 0, 0), &sent);
        let corrupt = corrupted.iter().filter(|&&byte| byte != 0x55).count();
        assert!(
            near(corrupt, 200) && corrupted.len() == sent.len(),
            "{corrupt}"
        );
        assert_eq!(corrupted, heard_over(only(one_percent, 0, 0), &sent));
    }

    #[test]
    fn a_line_that_is_bad_outwards_brings_back_what_was_sent() {
        let (near, mut far) = pipe::pair();
        let mut near = Noisy::outwards(near, Noise::of_each(Noise::WHOLE / 4), 5);
        let bytes = [0x55; 400];
        far.send(&bytes).unwrap();
        let mut heard = [0; 400];
        assert_eq!(near.receive(&mut heard, Duration::ZERO).unwrap(), 400);
        assert_eq!(heard, bytes);
        near.send(&bytes).unwrap();
        let count = far.receive(&mut heard, Duration::ZERO).unwrap();
        assert_ne!(heard[..count], bytes);
    }
}
