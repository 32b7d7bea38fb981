//! An upload: chunks sent ahead of their answers, as many as the robot lets be on their way.
//!
//! The robot takes chunks in order and answers how much of the blob it has, without a gap. So one
//! answer speaks for all chunks before it, and one that is lost costs nothing. What a robot would
//! have to remember to take chunks out of their order, it has no room for.
//!
//! The next chunk is the one that brings most: answers tell how often the line [loses](super::loss)
//! a chunk, which tells how likely the robot has each chunk that was sent and not answered yet. On
//! a good line that is the chunk behind those, and all that were sent have arrived. On a bad one
//! chunks are short, and one is sent again, unasked, as long as that is likelier to bring something
//! than what is behind it.

use std::time::{Duration, Instant};

use esm_link::frame;
use esm_link::message::{LinkError, MAX_CHUNK, Request, Response, Uploads};

use super::loss::{Loss, OVERHEAD};
use super::session::{Answer, Expected};
use super::timing::{Patience, ReplyTime};
use super::{ClientError, LinkClient, STOP_LOOK};
use crate::serial::ByteLink;

/// A chunk that is likely to bring less than this part of its bytes is not sent: better wait for an
/// answer.
const LEAST_WORTH: f64 = 0.05;

/// Chunks that are remembered, so that their answers are known: fewer than there are numbers.
const MAX_CHUNKS: usize = 100;

/// How often an upload may begin again before it is given up.
const BEGIN_LIMIT: u32 = 20;

const NAME: &str = "upload";

/// The kind of a chunk.
const CHUNK_KIND: u8 = Request::Chunk {
    offset: 0,
    data: &[],
}
.kind();

/// A chunk that was sent and not answered.
#[derive(Clone, Copy)]
struct Sent {
    seq: u8,
    /// Its first byte, and the one behind its last.
    from: usize,
    to: usize,
    at: Instant,
    /// What its answer must be.
    expected: Expected,
    /// Its answer was waited for in vain.
    given_up: bool,
}

impl Sent {
    fn bytes(&self) -> usize {
        self.to - self.from
    }
}

/// Where an upload stands.
struct Standing {
    /// Length of the blob.
    len: usize,
    /// Bytes that the robot is known to have.
    there: usize,
    /// Bytes of a chunk at most.
    largest_chunk: usize,
    /// How far beyond what the robot has may be sent.
    window: usize,
    /// The first byte that was never sent.
    unsent: usize,
    /// Chunks, in the order in which they were sent.
    sent: Vec<Sent>,
    /// The robot has forgotten the upload.
    forgotten: bool,
    /// The robot refuses a chunk for good.
    refused: Option<LinkError>,
}

impl Standing {
    fn new(len: usize, there: usize, uploads: Uploads) -> Self {
        let window = usize::from(uploads.window_bytes).max(1);
        Standing {
            len,
            there,
            largest_chunk: usize::from(uploads.chunk_bytes).clamp(1, window.min(MAX_CHUNK)),
            window,
            unsent: there,
            sent: Vec::new(),
            forgotten: false,
            refused: None,
        }
    }

    /// Bytes that the line may have to carry at a time: of a window in the largest chunks, or as
    /// many in shorter ones, sent once or again.
    fn frame_bytes_ahead(&self) -> usize {
        self.window * (self.largest_chunk + OVERHEAD) / self.largest_chunk
    }

    /// How many bytes the robot has by now, and how likely, in the order of the bytes. A chunk that
    /// arrives brings it from anywhere within the chunk to its end.
    fn likely(&self, loss: &Loss) -> Vec<(usize, f64)> {
        let mut likely = vec![(self.there, 1.0)];
        for chunk in self.waited_for() {
            let passes = loss.passes(chunk.bytes());
            let mut moved = 0.0;
            for (at, probability) in &mut likely {
                if (chunk.from..chunk.to).contains(at) {
                    moved += *probability * passes;
                    *probability *= 1.0 - passes;
                }
            }
            if moved > 0.0 {
                match likely.binary_search_by_key(&chunk.to, |(at, _)| *at) {
                    Ok(found) => likely[found].1 += moved,
                    Err(place) => likely.insert(place, (chunk.to, moved)),
                }
            }
        }
        likely
    }

    /// The chunk that brings most in its time on the line, if one may be sent now and is worth it.
    fn next_chunk(&self, loss: &Loss) -> Option<(usize, usize)> {
        let under_way: usize = (self.waited_for())
            .map(|chunk| chunk.bytes() + OVERHEAD)
            .sum();
        let length = loss.best_chunk(self.largest_chunk);
        let window = self.there + self.window;
        let likely = self.likely(loss);
        let mut best = None;
        let mut most = 0.0;
        for (place, &(from, _)) in likely.iter().enumerate() {
            let mut to = self.len.min(from + length);
            if !mutant!(WindowOverrun) {
                to = to.min(window);
            }
            let bytes = to.saturating_sub(from);
            let is_too_much = under_way + bytes + OVERHEAD > self.frame_bytes_ahead();
            if bytes == 0 || (is_too_much && !mutant!(WindowOverrun)) {
                continue;
            }
            // Bytes that it brings if it passes.
            let brings: f64 = (likely[place..].iter())
                .take_while(|(at, _)| *at < to)
                .map(|(at, probability)| (to - at) as f64 * probability)
                .sum();
            let by_time = brings * loss.passes(bytes) / (bytes + OVERHEAD) as f64;
            if brings >= LEAST_WORTH * bytes as f64 && by_time > most {
                most = by_time;
                best = Some((from, to));
            }
        }
        best
    }

    fn chunk_sent(&mut self, seq: u8, (from, to): (usize, usize), at: Instant, expected: Expected) {
        if self.sent.len() >= MAX_CHUNKS {
            self.sent.remove(0);
        }
        self.unsent = self.unsent.max(to);
        self.sent.push(Sent {
            seq,
            from,
            to,
            at,
            expected,
            given_up: false,
        });
    }

    /// Whether an answer is the robot's own, and to a chunk. Anybody may say that there is no
    /// session.
    fn accepts(&mut self, answer: &Answer<'_>) -> bool {
        let chunk = (self.sent.iter()).rfind(|chunk| chunk.seq == answer.seq);
        let Some(chunk) = chunk else {
            return mutant!(StaleChunkAnswerTaken);
        };
        if chunk.expected.is_ended_by(answer) {
            self.forgotten = true;
        }
        answer.is_of(CHUNK_KIND) && chunk.expected.accepts(answer)
    }

    /// Takes the answer to the request of this number, and lets it tell how bad the line is.
    /// Answers when the chunk was sent, if it was one.
    fn take(
        &mut self,
        seq: u8,
        result: Result<Response<'_>, LinkError>,
        loss: &mut Loss,
    ) -> Option<Instant> {
        // A number comes again after others, so that the last chunk of this one is meant.
        let Some(place) = self.sent.iter().rposition(|chunk| chunk.seq == seq) else {
            if let (Ok(Response::Received { len }), true) = (result, mutant!(StaleChunkAnswerTaken))
            {
                self.there = self.there.max(len as usize);
            }
            // Not of this upload, or nothing new.
            return None;
        };
        let there = match result {
            Ok(Response::Received { len }) => len as usize,
            Err(LinkError::WrongOffset { .. }) if mutant!(GapIgnored) => return None,
            Err(LinkError::WrongOffset { expected }) => expected as usize,
            Err(LinkError::NoUpload) => {
                self.forgotten = !mutant!(LossForgotten);
                return None;
            }
            // Noise whose checksum is right, once in four thousand million corrupt frames: as good
            // as a lost chunk.
            Err(LinkError::Malformed) => self.there,
            Err(error) => {
                self.refused = Some(error);
                return None;
            }
            Ok(_) => return None,
        };
        if there > self.len && !mutant!(ClaimBelieved) {
            // More than there is: no robot says that.
            return None;
        }
        let before = self.there;
        self.there = self.there.max(there);
        // The answers to those before it were lost, or left out.
        let decided: Vec<Sent> = self.sent.drain(..=place).collect();
        for (at, chunk) in decided.iter().enumerate() {
            let bytes = chunk.bytes();
            let is_alone = || {
                let is_other = |&(other, another): &(usize, &Sent)| {
                    other != at && another.from < chunk.to && chunk.from < another.to
                };
                !decided.iter().enumerate().any(|other| is_other(&other))
            };
            if at == place || (chunk.to <= self.there && is_alone()) {
                loss.chunk_passed(bytes);
            } else if chunk.to > self.there && chunk.from <= before && !chunk.given_up {
                // It would have fitted.
                loss.chunk_lost(bytes);
            }
        }
        decided.last().map(|chunk| chunk.at)
    }

    /// Nothing came: all that was sent is lost, or its answers are.
    fn give_up_what_was_sent(&mut self, loss: &mut Loss) {
        for chunk in self.sent.iter_mut().filter(|chunk| !chunk.given_up) {
            chunk.given_up = true;
            loss.chunk_lost(chunk.bytes());
        }
    }

    /// Bytes of chunks whose answers are waited for.
    fn on_the_way(&self) -> usize {
        self.waited_for().map(Sent::bytes).sum()
    }

    /// Chunks whose answers may still come.
    fn waited_for(&self) -> impl Iterator<Item = &Sent> {
        self.sent.iter().filter(|chunk| !chunk.given_up)
    }
}

impl<L: ByteLink> LinkClient<L> {
    /// Brings a mission to the robot, signed if the robot has a key, without letting it take over.
    /// `progress` is told the bytes that are there. An upload of the same blob that was broken off
    /// goes on where it was.
    ///
    /// # Errors
    /// [`ClientError`]
    pub fn stage(
        &mut self,
        blob: &[u8],
        progress: &mut dyn FnMut(usize),
    ) -> Result<(), ClientError> {
        let mut loss = Loss::UNKNOWN;
        let mut stuck = LinkError::NoUpload;
        // Bytes that the robot had at most: each of the others earns its time once, however often
        // it is sent.
        let mut most = None;
        for _ in 0..BEGIN_LIMIT {
            let there = self.begin(blob)?;
            let most = most.get_or_insert(there);
            if !self.send_from(blob, there, most, &mut loss, progress)? {
                continue;
            }
            if !self.signing.has_owner() {
                return Ok(());
            }
            match self.sign_upload(blob) {
                // The key is the robot's, so that the bytes are others: somebody has sent them
                // under this checksum, or something else meanwhile.
                Err(ClientError::Refused { error, .. }) if is_of_other_bytes(error) => {
                    stuck = error;
                }
                signed => return signed,
            }
        }
        Err(ClientError::UploadStuck { error: stuck })
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
        Ok(if mutant!(ResumedElsewhere) {
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
        most: &mut usize,
        loss: &mut Loss,
        progress: &mut dyn FnMut(usize),
    ) -> Result<bool, ClientError> {
        let mut standing = Standing::new(blob.len(), there, self.uploads);
        let mut patience = Patience::new(self.clock.now());
        // What answers to chunks take. Each chunk has a number of its own, so that it is known
        // which sending was answered.
        let mut chunk_time = ReplyTime::default();
        // Waits in a row in which nothing was heard.
        let mut attempt = 0;
        let mut last_sign = self.clock.now();
        progress(there);
        while standing.there < blob.len() {
            let before = standing.there;
            let wait = match standing.next_chunk(loss) {
                Some((from, to)) => {
                    self.counts.retries += u64::from(from < standing.unsent);
                    let chunk = blob.get(from..to).unwrap_or_default();
                    let (seq, expected) = self.send_chunk(from, chunk)?;
                    last_sign = self.clock.now();
                    standing.chunk_sent(seq, (from, to), last_sign, expected);
                    None
                }
                None if chunk_time.is_known() => Some(chunk_time.wait(attempt, 0)),
                None => Some(self.reply_time.wait(attempt, standing.on_the_way())),
            };
            let left = wait.map_or(Duration::ZERO, |wait| {
                wait.saturating_sub(self.clock.since(last_sign))
                    .min(STOP_LOOK)
            });
            self.check_stop(NAME)?;
            let bad_before = self.incoming.bad_frames;
            let mut answered = None;
            let heard = self.incoming.receive(&mut self.link, left, |answer| {
                if standing.accepts(answer) {
                    let taken = standing.take(answer.seq, answer.result, loss);
                    answered = taken.or(answered);
                }
            })?;
            let now = self.clock.now();
            patience.look(now);
            let corrupt = self.incoming.bad_frames - bad_before;
            patience.corrupt(corrupt);
            if heard || corrupt > 0 {
                patience.sign_of_life();
                attempt = 0;
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
            if let Some(sent) = answered {
                chunk_time.seen(now.saturating_duration_since(sent));
                last_sign = now;
            }
            if standing.there > before {
                let new = standing.there.saturating_sub(*most);
                self.allowance.bytes_there(new);
                *most += new;
                progress(standing.there);
                patience = Patience::new(now);
            } else {
                // A robot that misses what it was sent, again and again, is no progress either.
                patience.check(NAME)?;
            }
            if wait.is_some_and(|wait| self.clock.since(last_sign) >= wait) {
                attempt += 1;
                standing.give_up_what_was_sent(loss);
                last_sign = now;
            }
        }
        Ok(true)
    }

    /// Sends a chunk and waits for nothing. Answers its number, and what its answer must be.
    fn send_chunk(&mut self, offset: usize, data: &[u8]) -> Result<(u8, Expected), ClientError> {
        // `begin` has seen that the blob's length fits.
        let offset = offset as u32;
        let frame = self.next_frame(NAME, Request::Chunk { offset, data })?;
        self.send_wire(frame.wire())?;
        Ok((frame.seq, frame.expected))
    }
}

/// Whether the robot has not what was sent to it, as it says when that is signed.
fn is_of_other_bytes(error: LinkError) -> bool {
    matches!(
        error,
        LinkError::WrongSignature | LinkError::NoUpload | LinkError::Incomplete { .. }
    )
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

    const UPLOADS: Uploads = Uploads {
        chunk_bytes: 100,
        window_bytes: 250,
    };

    fn line(rate: f64) -> Loss {
        let mut line = Loss::UNKNOWN;
        // As frames tell it that are as long as are best.
        for _ in 0..200 {
            let chunk = line.best_chunk(100);
            if line.rate() < rate {
                line.chunk_lost(chunk);
            } else {
                line.chunk_passed(chunk);
            }
        }
        line
    }

    /// Sends chunks as long as one is worth it, from this number on. Answers them.
    fn sent(standing: &mut Standing, loss: &Loss, first: u8) -> Vec<(usize, usize)> {
        let mut sent = Vec::new();
        while let Some(chunk) = standing.next_chunk(loss) {
            standing.chunk_sent(
                first + sent.len() as u8,
                chunk,
                Instant::now(),
                Expected::Plain,
            );
            sent.push(chunk);
        }
        sent
    }

    #[test]
    fn on_a_good_line_the_window_is_filled_and_never_more() {
        let mut loss = Loss::UNKNOWN;
        let mut standing = Standing::new(1000, 0, UPLOADS);
        // 250 bytes are the most, in as many bytes of the line as 100 at a time would be.
        assert_eq!(sent(&mut standing, &loss, 1), [(0, 100), (100, 200)]);
        standing.take(1, received(100), &mut loss);
        assert_eq!(sent(&mut standing, &loss, 3), [(200, 300)]);
        standing.take(3, received(1000), &mut loss);
        assert_eq!(standing.next_chunk(&loss), None, "all of it is there");
    }

    #[test]
    fn on_a_bad_line_a_chunk_is_sent_again_before_anything_is_heard_and_the_window_holds() {
        let loss = line(0.05);
        let mut standing = Standing::new(1000, 0, UPLOADS);
        let sent = sent(&mut standing, &loss, 1);
        let (first, second) = (sent[0], sent[1]);
        assert!(first.1 < 20 && second == first, "{sent:?}");
        let later = |(from, _): &&(usize, usize)| *from >= first.1;
        assert!(sent.iter().filter(later).count() > 0, "{sent:?}");
        let bytes: usize = sent.iter().map(|(from, to)| to - from + OVERHEAD).sum();
        assert!(bytes <= 280 && sent.iter().all(|(_, to)| *to <= 250));
    }

    #[test]
    fn one_gap_is_sent_once_however_many_chunks_behind_it_are_answered() {
        let mut loss = Loss::UNKNOWN;
        let mut standing = Standing::new(
            1000,
            0,
            Uploads {
                window_bytes: 500,
                ..UPLOADS
            },
        );
        assert_eq!(sent(&mut standing, &loss, 1).len(), 5);
        // The second was lost: the third finds a gap.
        standing.take(1, received(100), &mut loss);
        let before = loss.rate();
        standing.take(3, gap(100), &mut loss);
        assert!(loss.rate() > before);
        assert_eq!(standing.next_chunk(&loss).unwrap().0, 100);
        let again = standing.next_chunk(&loss).unwrap();
        standing.chunk_sent(9, again, Instant::now(), Expected::Plain);
        let worse = loss.rate();
        for seq in [4, 5] {
            standing.take(seq, gap(100), &mut loss);
            assert_eq!(standing.next_chunk(&loss).unwrap().0, again.1);
        }
        assert!(loss.rate() < worse, "they have passed");
    }

    #[test]
    fn answers_of_other_requests_say_nothing() {
        let mut loss = Loss::UNKNOWN;
        let mut standing = Standing::new(1000, 0, UPLOADS);
        standing.chunk_sent(0, (0, 100), Instant::now(), Expected::Plain);
        for seq in [255, 1] {
            assert_eq!(standing.take(seq, received(900), &mut loss), None);
        }
        assert_eq!(standing.there, 0);
        standing.take(0, received(2000), &mut loss);
        assert_eq!(standing.there, 0, "more than the blob has");
    }

    #[test]
    fn a_chunk_that_arrived_after_all_is_not_sent_a_third_time() {
        let mut loss = Loss::UNKNOWN;
        let mut standing = Standing::new(1000, 0, UPLOADS);
        standing.chunk_sent(1, (0, 100), Instant::now(), Expected::Plain);
        standing.give_up_what_was_sent(&mut loss);
        assert_eq!(standing.next_chunk(&loss).unwrap().0, 0);
        standing.take(1, received(100), &mut loss);
        assert_eq!(standing.next_chunk(&loss).unwrap().0, 100);
    }

    #[test]
    fn a_robot_that_takes_nothing_at_a_time_gets_single_bytes() {
        let uploads = Uploads {
            chunk_bytes: 0,
            window_bytes: 0,
        };
        let standing = Standing::new(1000, 0, uploads);
        assert_eq!(standing.next_chunk(&line(0.2)), Some((0, 1)));
    }
}
