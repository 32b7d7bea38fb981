//! How long to wait for a reply before the request is sent again: as long as replies have taken,
//! and some more. And when to give up.

use std::time::{Duration, Instant};

use super::ClientError;

/// How long a request may take in all, repetitions included, while nothing at all comes from the
/// robot.
pub(super) const REQUEST_DEADLINE: Duration = Duration::from_secs(6);

/// How long it may take while something does come: a robot is there, and the line is bad.
pub const NOISY_DEADLINE: Duration = Duration::from_secs(30);

const FIRST_WAIT: Duration = Duration::from_millis(200);
const SHORTEST_WAIT: Duration = Duration::from_millis(40);
const LONGEST_WAIT: Duration = Duration::from_secs(1);

/// How often a wait is doubled at most. On a line that spoils one byte in ten, one sending in six
/// is answered.
const MOST_DOUBLINGS: u32 = 2;

/// What a byte of a request may take until the robot has it: as on a line of 19,200 bits per
/// second. The replies to short requests say nothing of this. An emulated board that keeps to the
/// wall clock needs two thirds of it, since its serial port stands still while it waits for its
/// plant.
const BYTE_TIME: Duration = Duration::from_micros(500);

/// Estimates the time that a reply takes, in the manner of TCP (Jacobson 1988): a running mean and
/// a running deviation.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct ReplyTime {
    estimate: Option<(Duration, Duration)>,
}

impl ReplyTime {
    /// After one reply, which took so long.
    pub(super) fn of(took: Duration) -> Self {
        let mut time = ReplyTime::default();
        time.seen(took);
        time
    }

    /// A reply took this long. Only of requests that were sent once: of the others nobody knows
    /// which sending was answered.
    pub(super) fn seen(&mut self, took: Duration) {
        self.estimate = Some(match self.estimate {
            None => (took, took / 2),
            Some((mean, deviation)) => {
                let off = mean.abs_diff(took);
                ((mean * 7 + took) / 8, (deviation * 3 + off) / 4)
            }
        });
    }

    /// Whether one was seen.
    pub(super) fn is_known(&self) -> bool {
        self.estimate.is_some()
    }

    /// How long to wait the `attempt`-th time, from 0, for the reply to a request of
    /// `request_bytes`. Later attempts wait longer, should the line be slow and not lossy; but not
    /// much longer, should it be lossy.
    pub(super) fn wait(&self, attempt: u32, request_bytes: usize) -> Duration {
        let base = match self.estimate {
            None => FIRST_WAIT,
            Some((mean, deviation)) => (mean + deviation * 4).max(SHORTEST_WAIT),
        };
        let growth = 1 << (attempt / 3).min(MOST_DOUBLINGS);
        let on_the_way = BYTE_TIME.saturating_mul(u32::try_from(request_bytes).unwrap_or(u32::MAX));
        ((base + on_the_way) * growth).min(LONGEST_WAIT)
    }
}

/// What a look at the clock counts at most. Who looks seldomer was suspended, or got no processor:
/// he has heard nothing meanwhile, and the answer that he waits for may lie in the line.
const LONGEST_LOOK: Duration = Duration::from_secs(1);

/// How long a request, or the next step of an upload, has been waited for.
#[derive(Clone, Copy, Debug)]
pub(super) struct Patience {
    started: Instant,
    looked: Instant,
    spent: Duration,
    /// Of that, since the last heartbeat.
    silent: Duration,
    /// Frames that came corrupt meanwhile.
    corrupt_frames: u64,
}

impl Patience {
    pub(super) fn new(now: Instant) -> Self {
        Patience {
            started: now,
            looked: now,
            spent: Duration::ZERO,
            silent: Duration::ZERO,
            corrupt_frames: 0,
        }
    }

    /// Counts what has passed since the last look.
    pub(super) fn look(&mut self, now: Instant) {
        let passed = now.saturating_duration_since(self.looked);
        self.count(passed.min(LONGEST_LOOK), now);
    }

    /// Counts what somebody else has counted meanwhile.
    pub(super) fn adopt(&mut self, other: Self) {
        self.count(other.spent, other.looked);
        self.corrupt_frames += other.corrupt_frames;
    }

    fn count(&mut self, time: Duration, now: Instant) {
        self.looked = now;
        self.spent += time;
        self.silent += time;
    }

    /// So many frames came corrupt.
    pub(super) fn corrupt(&mut self, frames: u64) {
        self.corrupt_frames += frames;
    }

    /// A frame came, whole or corrupt.
    pub(super) fn sign_of_life(&mut self) {
        self.silent = Duration::ZERO;
    }

    /// Whether it is worth while to go on.
    pub(super) fn lasts(&self) -> bool {
        self.silent < REQUEST_DEADLINE && self.spent < NOISY_DEADLINE
    }

    /// Whether a request is still as fresh as the person who asked for it expects: a command that
    /// was put off for longer is not sent anew.
    pub(super) fn is_fresh(&self, now: Instant) -> bool {
        now.saturating_duration_since(self.started) < REQUEST_DEADLINE
    }

    /// Fails where it is not worth while.
    pub(super) fn check(&self, request: &'static str) -> Result<(), ClientError> {
        if self.lasts() {
            return Ok(());
        }
        Err(ClientError::NoReply {
            request,
            waited: self.spent,
            corrupt_frames: self.corrupt_frames,
        })
    }
}

/// How long all requests together may wait, where that has an end.
#[derive(Clone, Copy, Debug)]
pub(super) struct Allowance {
    limit: Option<Duration>,
    /// For each byte of an upload that the robot has taken, so much more.
    each_byte: Duration,
    looked: Instant,
    spent: Duration,
}

impl Allowance {
    /// From now on, so long.
    pub(super) fn new(limit: Option<Duration>, now: Instant) -> Self {
        Allowance {
            limit,
            each_byte: Duration::ZERO,
            looked: now,
            spent: Duration::ZERO,
        }
    }

    /// From now on each byte that arrives earns so much time.
    pub(super) fn set_each_byte(&mut self, time: Duration) {
        self.each_byte = time;
    }

    /// So many bytes of an upload have arrived that had not before.
    pub(super) fn bytes_there(&mut self, bytes: usize) {
        let bytes = u32::try_from(bytes).unwrap_or(u32::MAX);
        self.extend(self.each_byte.saturating_mul(bytes));
    }

    /// So much more.
    pub(super) fn extend(&mut self, more: Duration) {
        self.limit = self.limit.map(|limit| limit.saturating_add(more));
    }

    /// Counts what has passed since the last look.
    ///
    /// # Errors
    /// It is over.
    pub(super) fn look(&mut self, now: Instant, request: &'static str) -> Result<(), ClientError> {
        let passed = now.saturating_duration_since(self.looked);
        self.spent += passed.min(LONGEST_LOOK);
        self.looked = now;
        match self.limit {
            Some(limit) if self.spent >= limit && !mutant!(SlownessBorne) => {
                Err(ClientError::TooSlow { request, limit })
            }
            _ => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn waits_follow_what_replies_take() {
        let ms = Duration::from_millis;
        let mut time = ReplyTime::default();
        assert_eq!(time.wait(0, 0), ms(200), "nothing is known yet");
        for _ in 0..50 {
            time.seen(ms(2));
        }
        assert_eq!(time.wait(0, 0), ms(40), "no reply is waited for shorter");
        assert_eq!(time.wait(0, 140), ms(110), "a long request takes its time");
        for _ in 0..50 {
            time.seen(ms(200));
        }
        let wait = time.wait(0, 0);
        assert!(wait > ms(200) && wait < ms(260), "{wait:?}");
        assert_eq!(time.wait(2, 0), wait);
        assert_eq!(
            [3, 6, 100].map(|attempt| time.wait(attempt, 0)),
            [2, 4, 4].map(|times| wait * times)
        );
        assert_eq!(time.wait(100, 1000), ms(1000), "the longest");
    }
}
