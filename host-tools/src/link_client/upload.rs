//! An upload: chunks sent ahead of their answers, as many as the robot lets be on their way.
//!
//! The robot takes chunks in order and answers how much of the blob it has, without a gap. So one answer speaks for all chunks before it, and one that is
//! lost costs nothing. Where the line lost a chunk, the robot names the byte to go on at, and all behind it is sent again: what a robot would have to
//! remember for more than that, it has no room for. On a bad line chunks become shorter, since a short frame is likelier to pass, and longer again
//! when some have passed in a row.

use std::time::Duration;

use rt_firmware::link::access::Access;
use rt_firmware::link::frame;
use rt_firmware::link::message::{LinkError, Request, Response, Uploads};

use super::timing::Patience;
use super::{ClientError, LinkClient, STOP_LOOK};
use crate::serial::ByteLink;

/// The smallest chunk that a noisy line brings an upload down to, in bytes.
const SMALLEST_CHUNK: usize = 16;

/// Chunks in a row that must pass before longer ones are tried again.
const CHUNKS_BEFORE_GROWTH: u32 = 4;

/// Chunks on their way at most, whatever their size: on a line that loses some, the fewer are sent again.
const MAX_CHUNKS_AHEAD: usize = 8;

/// How often an upload may begin again before it is given up.
const BEGIN_LIMIT: u32 = 20;

const NAME: &str = "upload";

/// How large chunks are, and how many of them are on their way.
#[derive(Clone, Copy, Debug)]
struct Rate {
    chunk: usize,
    largest_chunk: usize,
    window: usize,
    /// Chunks that passed since one was lost, or since they became longer.
    passed: u32,
}

impl Rate {
    fn new(uploads: Uploads) -> Self {
        let window = usize::from(uploads.window_bytes).max(1);
        let chunk = usize::from(uploads.chunk_bytes).clamp(1, window);
        Rate {
            chunk,
            largest_chunk: chunk,
            window,
            passed: 0,
        }
    }

    /// How far beyond what the robot has may be sent now.
    fn ahead(&self) -> usize {
        self.window.min(self.chunk * MAX_CHUNKS_AHEAD)
    }

    fn chunk_passed(&mut self) {
        self.passed += 1;
        if self.passed >= CHUNKS_BEFORE_GROWTH {
            self.chunk = self.largest_chunk.min(self.chunk * 2);
            self.passed = 0;
        }
    }

    fn chunk_lost(&mut self) {
        let smallest = SMALLEST_CHUNK.min(self.largest_chunk);
        self.chunk = smallest.max(self.chunk / 2);
        self.passed = 0;
    }
}

/// Where an upload stands.
#[derive(Debug)]
struct Standing {
    /// Length of the blob.
    len: usize,
    /// Bytes that the robot is known to have.
    there: usize,
    /// The first byte of the next chunk.
    next: usize,
    /// Number of the chunk that was sent last.
    seq: u8,
    /// Chunks that were sent so far; no more than can be told apart.
    sent: u8,
    /// Chunks that were sent since the last step back.
    sent_since_step_back: u8,
    /// A chunk that was sent since the last step back did not fit to those before.
    has_gap: bool,
    /// The robot has forgotten the upload.
    forgotten: bool,
    /// The robot refuses a chunk for good.
    refused: Option<LinkError>,
}

impl Standing {
    fn new(len: usize, there: usize) -> Self {
        Standing {
            len,
            there,
            next: there,
            seq: 0,
            sent: 0,
            sent_since_step_back: 0,
            has_gap: false,
            forgotten: false,
            refused: None,
        }
    }

    /// The next chunk ends here, if one may be sent.
    fn next_end(&self, rate: &Rate) -> Option<usize> {
        let end = self.len.min(self.next + rate.chunk);
        let fits = end - self.there <= rate.ahead() || planted!(WindowOverrun);
        (end > self.next && fits).then_some(end)
    }

    fn chunk_sent(&mut self, seq: u8, end: usize) {
        const LAST: u8 = u8::MAX / 2;
        self.seq = seq;
        self.next = end;
        self.sent = LAST.min(self.sent + 1);
        self.sent_since_step_back = LAST.min(self.sent_since_step_back + 1);
    }

    /// Takes the answer to the request of this number.
    fn take(&mut self, seq: u8, result: Result<Response<'_>, LinkError>) {
        let age = self.seq.wrapping_sub(seq);
        if age >= self.sent && !planted!(StaleChunkAnswerTaken) {
            // Not of this upload.
            return;
        }
        let is_recent = age < self.sent_since_step_back;
        match result {
            Ok(Response::Received { len }) => self.has_arrived(len as usize),
            Err(LinkError::WrongOffset { expected }) => {
                self.has_arrived(expected as usize);
                self.has_gap |= is_recent && !planted!(GapIgnored);
            }
            Err(LinkError::NoUpload) => self.forgotten |= is_recent && !planted!(LossForgotten),
            // Noise whose checksum is right, once in four thousand million spoiled frames: as good as a lost chunk.
            Err(LinkError::Malformed) => self.has_gap |= is_recent,
            Err(error) => self.refused = Some(error),
            Ok(_) => {}
        }
    }

    fn has_arrived(&mut self, bytes: usize) {
        if bytes <= self.len || planted!(ClaimBelieved) {
            self.there = self.there.max(bytes);
            // More may have arrived than was thought when the last step back was taken.
            self.next = self.next.max(self.there);
        }
    }

    fn step_back(&mut self) {
        self.next = self.there;
        self.sent_since_step_back = 0;
        self.has_gap = false;
    }
}

impl<L: ByteLink> LinkClient<L> {
    /// Brings a mission to the robot, signed if the robot has a key, without letting it take over. `progress` is told the bytes that are there. An upload of the same blob that was
    /// broken off goes on where it was.
    ///
    /// # Errors
    /// [`ClientError`]
    pub fn stage(
        &mut self,
        blob: &[u8],
        progress: &mut dyn FnMut(usize),
    ) -> Result<(), ClientError> {
        let mut rate = Rate::new(self.uploads);
        for _ in 0..BEGIN_LIMIT {
            let there = self.begin(blob)?;
            if self.send_from(blob, there, &mut rate, progress)? {
                return match self.signing.access {
                    Access::Locked => self.sign_upload(blob),
                    Access::Unsupported | Access::Open | Access::Unreadable => Ok(()),
                };
            }
        }
        Err(ClientError::UploadStuck {
            error: LinkError::NoUpload,
        })
    }

    /// Announces an upload. Answers how many bytes of it the robot has already.
    pub(super) fn begin(&mut self, blob: &[u8]) -> Result<usize, ClientError> {
        let len = u32::try_from(blob.len()).map_err(|_| ClientError::Refused {
            request: NAME,
            error: LinkError::TooLong,
        })?;
        let crc = frame::checksum(blob);
        let there = self.ask(
            NAME,
            Request::Begin { len, crc },
            |response| match response {
                Response::Received { len } => Some(len as usize),
                _ => None,
            },
        )?;
        if there > blob.len() {
            return Err(ClientError::BadAnswer { request: NAME });
        }
        Ok(if planted!(ResumedElsewhere) {
            there + 1
        } else {
            there
        })
    }

    /// Sends what the robot lacks. Answers false where it has forgotten the upload meanwhile.
    fn send_from(
        &mut self,
        blob: &[u8],
        there: usize,
        rate: &mut Rate,
        progress: &mut dyn FnMut(usize),
    ) -> Result<bool, ClientError> {
        let mut standing = Standing::new(blob.len(), there);
        let mut patience = Patience::new(self.clock.now());
        // Sendings in a row of which nothing was heard.
        let mut attempt = 0;
        let mut last_sign = self.clock.now();
        progress(there);
        while standing.there < blob.len() {
            let before = standing.there;
            let wait = match standing.next_end(rate) {
                Some(end) => {
                    let offset = standing.next;
                    let seq = self.send_chunk(offset, blob.get(offset..end).unwrap_or_default())?;
                    standing.chunk_sent(seq, end);
                    last_sign = self.clock.now();
                    None
                }
                None => {
                    let on_the_way = standing.next - standing.there;
                    Some(self.reply_time.wait(attempt, on_the_way))
                }
            };
            let left = wait.map_or(Duration::ZERO, |wait| {
                wait.saturating_sub(self.clock.since(last_sign))
                    .min(STOP_LOOK)
            });
            self.check_stop(NAME)?;
            let bad_before = self.incoming.bad_frames;
            let heard = self.incoming.receive(&mut self.link, left, |seq, result| {
                standing.take(seq, result);
            })?;
            patience.look(self.clock.now());
            if heard || self.incoming.bad_frames != bad_before {
                patience.sign_of_life();
            }
            if let Some(error) = standing.refused {
                return Err(ClientError::Refused {
                    request: NAME,
                    error,
                });
            }
            if standing.forgotten {
                return Ok(false);
            }
            if standing.there > before {
                progress(standing.there);
                rate.chunk_passed();
                patience = Patience::new(self.clock.now());
                last_sign = self.clock.now();
                attempt = 0;
            }
            let timed_out = wait.is_some_and(|wait| self.clock.since(last_sign) >= wait);
            attempt += u32::from(timed_out);
            if standing.has_gap || timed_out {
                // A robot that misses what it was sent, again and again, is no progress either.
                patience.check(NAME)?;
                self.counts.retries += 1;
                rate.chunk_lost();
                standing.step_back();
            }
        }
        Ok(true)
    }

    /// Sends a chunk and waits for nothing. Answers its number.
    fn send_chunk(&mut self, offset: usize, data: &[u8]) -> Result<u8, ClientError> {
        // `begin` has seen that the blob's length fits.
        let offset = offset as u32;
        let (seq, wire, length) = self.next_frame(NAME, Request::Chunk { offset, data })?;
        self.send_wire(wire.get(..length).unwrap_or_default())?;
        Ok(seq)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn received(len: u32) -> Result<Response<'static>, LinkError> {
        Ok(Response::Received { len })
    }

    fn gap(expected: u32) -> Result<Response<'static>, LinkError> {
        Err(LinkError::WrongOffset { expected })
    }

    #[test]
    fn the_window_is_filled_and_never_more() {
        let uploads = Uploads {
            chunk_bytes: 100,
            window_bytes: 250,
        };
        let mut standing = Standing::new(1000, 0);
        let rate = Rate::new(uploads);
        for end in [100, 200] {
            assert_eq!(standing.next_end(&rate), Some(end));
            standing.chunk_sent(end as u8 / 100, end);
        }
        assert_eq!(standing.next_end(&rate), None, "250 bytes are the most");
        standing.take(1, received(100));
        assert_eq!(standing.next_end(&rate), Some(300));
        standing.take(2, received(1000));
        assert_eq!(standing.next_end(&rate), None, "all of it is there");
    }

    #[test]
    fn one_gap_is_one_step_back_however_many_chunks_are_behind_it() {
        let mut standing = Standing::new(1000, 0);
        for seq in 1..=5 {
            standing.chunk_sent(seq, usize::from(seq) * 100);
        }
        // The second was lost: the third finds a gap.
        standing.take(1, received(100));
        standing.take(3, gap(100));
        assert!(standing.has_gap && standing.there == 100);
        standing.step_back();
        assert_eq!(standing.next, 100);
        standing.chunk_sent(6, 200);
        for seq in [4, 5] {
            standing.take(seq, gap(100));
            assert!(!standing.has_gap, "of before the step back");
        }
        standing.take(6, received(200));
        standing.chunk_sent(7, 300);
        standing.chunk_sent(8, 400);
        standing.take(8, gap(200));
        assert!(standing.has_gap, "another one");
    }

    #[test]
    fn answers_of_other_requests_say_nothing() {
        let mut standing = Standing::new(1000, 0);
        standing.chunk_sent(0, 100);
        standing.take(255, received(900));
        standing.take(1, received(900));
        assert_eq!(standing.there, 0);
        standing.take(0, received(2000));
        assert_eq!(standing.there, 0, "more than the blob has");
    }

    #[test]
    fn a_chunk_that_arrived_after_all_is_not_sent_a_third_time() {
        let mut standing = Standing::new(1000, 0);
        standing.chunk_sent(1, 500);
        standing.step_back();
        standing.take(1, received(500));
        assert_eq!(standing.next, 500);
    }

    #[test]
    fn chunks_become_shorter_on_a_bad_line_and_longer_again() {
        let mut rate = Rate::new(Uploads {
            chunk_bytes: 176,
            window_bytes: 528,
        });
        for expected in [88, 44, 22, 16, 16] {
            rate.chunk_lost();
            assert_eq!(rate.chunk, expected);
        }
        for _ in 0..5 * CHUNKS_BEFORE_GROWTH {
            rate.chunk_passed();
        }
        assert_eq!(rate.chunk, 176);
        // A robot that takes less than any of this.
        let mut rate = Rate::new(Uploads {
            chunk_bytes: 0,
            window_bytes: 0,
        });
        rate.chunk_lost();
        assert_eq!((rate.chunk, rate.ahead()), (1, 1));
    }
}
