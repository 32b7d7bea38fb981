//! Sonars on an I2C bus: SRF08 and SRF02 of Devantech.
//!
//! They do what a sonar with two pins does, and measure the echo by themselves, in microseconds: so
//! they are a trigger and an echo timer to who has them, and stand in a ring beside others. There
//! is no crate for them: the registry has none for either.
//!
//! | register | written | read |
//! |---|---|---|
//! | 0 | command: 0x52 measures, in microseconds | version of the software |
//! | 2, 3 | (SRF08, 2) how long it listens: 43 mm of range, and 43 mm for each count | first echo, high byte first; 0 where there was none |
//!
//! While one listens it acknowledges nothing. An SRF08 listens for as long as it is told to, an
//! SRF02 for 65 ms: the slot of its task has a period of 70 ms or more. Source: Devantech, "SRF08
//! Ultra sonic range finder" and "SRF02 Ultrasonic range finder", technical specification.

use embedded_hal::digital::{self, OutputPin};
use embedded_hal::i2c::{self, I2c};

use super::{EchoPulse, EchoTimer, LONGEST_ECHO_US};

const COMMAND: u8 = 0;
const RANGE: u8 = 2;
const FIRST_ECHO: u8 = 2;

/// Measures, and tells the echo in microseconds.
const MEASURE_US: u8 = 0x52;

/// As far as an echo counts, 4.3 m: sound is on its way there and back for [`LONGEST_ECHO_US`].
const LISTENS_TO: u8 = {
    const MM_OF_A_COUNT: u32 = 43;
    let mm = LONGEST_ECHO_US as u32 * 343 / 2_000;
    // 99, which a byte holds.
    mm.div_ceil(MM_OF_A_COUNT) as u8 - 1
};

/// Which sonar it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BusSonarKind {
    /// It listens for 25 ms.
    Srf08,
    /// It listens for 65 ms.
    Srf02,
}

/// A sonar on a bus: its trigger, or its echo timer. The first one asks, the second one reads.
#[derive(Clone, Copy, Debug)]
pub struct BusSonar<B> {
    bus: B,
    kind: BusSonarKind,
    address: u8,
}

/// A ping that could not be sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NotSent<E>(pub E);

impl<E: i2c::Error> digital::Error for NotSent<E> {
    fn kind(&self) -> digital::ErrorKind {
        digital::ErrorKind::Other
    }
}

impl<B: I2c> BusSonar<B> {
    /// The one at this address, of 7 bits.
    pub const fn new(bus: B, kind: BusSonarKind, address: u8) -> Self {
        Self { bus, kind, address }
    }
}

impl<B: I2c> digital::ErrorType for BusSonar<B> {
    type Error = NotSent<B::Error>;
}

impl<B: I2c> OutputPin for BusSonar<B> {
    /// It ends its burst by itself.
    fn set_low(&mut self) -> Result<(), Self::Error> {
        Ok(())
    }

    /// Sends a burst. An SRF08 is told each time how long to listen: it forgets that with its
    /// supply, and nobody hears of it.
    fn set_high(&mut self) -> Result<(), Self::Error> {
        if self.kind == BusSonarKind::Srf08 {
            let range = [RANGE, LISTENS_TO];
            self.bus.write(self.address, &range).map_err(NotSent)?;
        }
        let command = [COMMAND, MEASURE_US];
        self.bus.write(self.address, &command).map_err(NotSent)
    }
}

impl<B: I2c> EchoTimer for BusSonar<B> {
    /// One that still listens is as silent as one that is not there: it has not been asked in time.
    fn pulse(&mut self) -> EchoPulse {
        let mut bytes = [0; 2];
        let read = (self.bus).write_read(self.address, &[FIRST_ECHO], &mut bytes);
        match (read, u16::from_be_bytes(bytes)) {
            (Err(_), _) => EchoPulse::None,
            // It has listened to the end.
            (Ok(()), 0) => EchoPulse::Over { us: u16::MAX },
            (Ok(()), us) => EchoPulse::Over { us },
        }
    }
}

#[cfg(test)]
mod tests {
    use embedded_hal::i2c::{ErrorKind, NoAcknowledgeSource};
    use embedded_hal_mock::eh1::i2c::{Mock, Transaction};

    use super::super::{Answer, Sonar, Sound};
    use super::*;

    const AT: u8 = 0x70;
    const NOBODY: ErrorKind = ErrorKind::NoAcknowledge(NoAcknowledgeSource::Address);

    fn write(bytes: [u8; 2]) -> Transaction {
        Transaction::write(AT, bytes.into())
    }

    fn read(bytes: [u8; 2]) -> Transaction {
        Transaction::write_read(AT, [2].into(), bytes.into())
    }

    /// What a sonar of this kind answers to a ping on a bus where this is to happen.
    fn answer(kind: BusSonarKind, expected: &[Transaction]) -> (bool, Answer) {
        let mut bus = Mock::new(expected);
        let part = || BusSonar::new(bus.clone(), kind, AT);
        let mut sonar = Sonar::new(part(), part());
        let is_sent = sonar.ping().is_ok();
        let answer = sonar.answer(Sound::IN_A_ROOM);
        bus.done();
        (is_sent, answer)
    }

    #[test]
    fn an_srf08_listens_for_25_ms_and_tells_the_first_echo_in_microseconds() {
        // 100 counts of 43 mm: 4.3 m, there and back in 25.1 ms.
        let ping = [write([2, 99]), write([0, 0x52])];
        let all = |last| [&ping[..], &[last]].concat();
        let (is_sent, echo) = answer(BusSonarKind::Srf08, &all(read([0x16, 0xC5])));
        assert!(is_sent);
        // 5,829 µs at 343.2 m/s, there and back.
        assert!(matches!(echo, Answer::Echo { range_m } if (range_m - 1.0003).abs() < 1e-4));
        let (_, one_more) = answer(BusSonarKind::Srf08, &all(read([0x16, 0xC6])));
        let (Answer::Echo { range_m: at_m }, Answer::Echo { range_m: then_m }) = (echo, one_more)
        else {
            panic!("two echoes");
        };
        assert!(
            (then_m - at_m - 0.000_171_6).abs() < 1e-6,
            "a microsecond is 0.17 mm"
        );
        let (_, nothing) = answer(BusSonarKind::Srf08, &all(read([0, 0])));
        assert_eq!(nothing, Answer::NothingInRange);
        let (_, listens) = answer(BusSonarKind::Srf08, &all(read([0, 0]).with_error(NOBODY)));
        assert_eq!(listens, Answer::None);
    }

    #[test]
    fn an_srf02_is_asked_alone_for_it_cannot_be_told_how_long_to_listen() {
        let expected = [write([0, 0x52]), read([0x04, 0x00])];
        let (is_sent, echo) = answer(BusSonarKind::Srf02, &expected);
        assert!(is_sent && matches!(echo, Answer::Echo { .. }), "{echo:?}");
    }

    #[test]
    fn one_that_is_not_there_has_no_answer_and_is_asked_for_none() {
        let expected = [write([2, 99]).with_error(NOBODY)];
        assert_eq!(
            answer(BusSonarKind::Srf08, &expected),
            (false, Answer::None)
        );
    }
}
