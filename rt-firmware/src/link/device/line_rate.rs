//! Another rate of the line, for a while: what a selftest tries.
//!
//! *Invariant:* the line has its own rate again when the time is over, whatever was heard of it in
//! between.

use super::port::LinkPort;

/// Which rate the line has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum LineRate {
    /// Its own.
    Own,
    /// Its own still: another one is wanted, as soon as that is answered.
    Wanted { baud: u32, ms: u32 },
    /// Another one, until then on the board's clock.
    Other { until_us: u64 },
}

impl LineRate {
    /// The line's own rate comes back where its time is over.
    pub(super) fn look(&mut self, port: &mut impl LinkPort) {
        if let LineRate::Other { until_us } = *self
            && port.now_us() >= until_us
        {
            port.set_line_rate(None);
            *self = LineRate::Own;
        }
    }

    /// All is out that was to be sent: the rate that is wanted begins.
    pub(super) fn begin(&mut self, port: &mut impl LinkPort) {
        if let LineRate::Wanted { baud, ms } = *self {
            port.set_line_rate(Some(baud));
            let until_us = port.now_us().saturating_add(u64::from(ms) * 1_000);
            *self = LineRate::Other { until_us };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A line whose rate is looked at.
    #[derive(Default)]
    struct Line {
        now_us: u64,
        rates: std::vec::Vec<Option<u32>>,
    }

    impl LinkPort for Line {
        fn now_us(&mut self) -> u64 {
            self.now_us
        }

        fn receive(&mut self) -> Option<u8> {
            None
        }

        fn send(&mut self, _byte: u8) -> bool {
            true
        }

        fn set_line_rate(&mut self, baud: Option<u32>) {
            self.rates.push(baud);
        }
    }

    #[test]
    fn another_rate_begins_behind_its_answer_and_ends_in_time() {
        let mut line = Line {
            now_us: 5_000,
            ..Line::default()
        };
        let mut rate = LineRate::Wanted {
            baud: 921_600,
            ms: 100,
        };
        rate.look(&mut line);
        assert!(line.rates.is_empty());
        rate.begin(&mut line);
        assert_eq!(line.rates, [Some(921_600)]);
        line.now_us = 104_999;
        rate.look(&mut line);
        rate.begin(&mut line);
        assert_eq!(line.rates.len(), 1);
        line.now_us += 1;
        rate.look(&mut line);
        rate.look(&mut line);
        assert_eq!(line.rates, [Some(921_600), None]);
        assert_eq!(rate, LineRate::Own);
    }
}
