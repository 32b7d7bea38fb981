//! Listens for stops among the bytes of the line, where they come in: ahead of the link's queue,
//! and of whatever the link is at.
//!
//! A board gives it each byte in the interrupt that takes bytes off the line. It knows the whole
//! frame of a [`Stop`](Request::Stop) or an [`EmergencyStop`](Request::EmergencyStop), with the
//! right checksum and any number, also one with a proof of who sent it or with a deadline:
//! everybody may stop a robot, and a stop that comes late is a stop, so that nobody looks at those
//! here. The frame goes to the link all the same, which answers it.
//!
//! A byte costs a few instructions, one that ends a short frame the checksum of `LONGEST` bytes
//! besides.

#[cfg(doc)]
use esm_link::message::Request;

use crate::heartbeats::Heartbeats;
use crate::retained_ram::RetainedRam;
use esm_link::frame::{CRC_BYTES, DELIMITER, checksum};

/// Numbers of the requests that it knows.
const STOP: u8 = 6;
const EMERGENCY_STOP: u8 = 27;
/// Of a request that is in another, which proves who sent it: a number of at most 5 bytes, the
/// proof, the length of the request that it holds, and that.
const PROVEN: u8 = 35;
const LONGEST_NUMBER: usize = 5;
const PROOF_BYTES: usize = 16;
/// Of a request that brings the deadline of another: that, of at most 10 bytes, the length of the
/// request that it holds, and that.
const WITHIN: u8 = 30;
const LONGEST_DEADLINE: usize = 10;

/// Bytes of the longest request that is a stop with a deadline.
const LONGEST_WITHIN: usize = 1 + LONGEST_DEADLINE + 1 + 1;
/// Bytes of the longest frame that holds a stop, as COBS makes them, without delimiter: a number,
/// what it is, number and proof, length, the stop with its deadline, the checksum, and the first
/// byte of COBS.
const LONGEST: usize = 1 + 1 + LONGEST_NUMBER + PROOF_BYTES + 1 + LONGEST_WITHIN + CRC_BYTES + 1;

/// Hears stops. A board has one for its line, from
/// [`LinkSide::stop_listener`](crate::LinkSide::stop_listener).
pub struct StopListener<'m> {
    frame: [u8; LONGEST],
    /// Bytes of the frame so far; more than there is room for if it is too long to be a stop.
    len: u8,
    /// Bytes that were kept for the link; wraps.
    kept_bytes: u32,
    heartbeats: &'m Heartbeats,
    kept: Option<&'m RetainedRam>,
}

/// What it knows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Heard {
    Stop,
    EmergencyStop,
}

impl<'m> StopListener<'m> {
    pub(crate) const fn new(heartbeats: &'m Heartbeats, kept: Option<&'m RetainedRam>) -> Self {
        StopListener {
            frame: [0; LONGEST],
            len: 0,
            kept_bytes: 0,
            heartbeats,
            kept,
        }
    }

    /// A byte came off the line. `is_kept` says whether the link will get it; one that found no
    /// room is counted as lost.
    ///
    /// Returns whether it ended a stop. Then the wish is there, and the board calls
    /// [`RealTime::on_timer`](crate::RealTime::on_timer) as soon as it can: the slot timer's
    /// interrupt, pended by software.
    #[must_use]
    pub fn hear(&mut self, byte: u8, is_kept: bool) -> bool {
        if is_kept {
            self.kept_bytes = self.kept_bytes.wrapping_add(1);
            self.heartbeats.stops.keep_bytes(self.kept_bytes);
        } else {
            self.heartbeats.stops.lose_byte();
        }
        if byte != DELIMITER {
            if let Some(place) = self.frame.get_mut(usize::from(self.len)) {
                *place = byte;
            }
            // One more than there is room for says that it is too long.
            self.len = (self.len + 1).min(LONGEST as u8 + 1);
            return false;
        }
        let len = usize::from(core::mem::take(&mut self.len));
        let Some(heard) = self.frame.get_mut(..len).and_then(stop_in) else {
            return false;
        };
        // Where its last byte is lost, whatever the link gets next comes behind it.
        let behind = self.kept_bytes.wrapping_add(u32::from(!is_kept));
        self.heartbeats.stops.hear(behind);
        match heard {
            Heard::Stop => self.heartbeats.stops.call(),
            Heard::EmergencyStop => self.heartbeats.latch_emergency_stop(self.kept),
        }
        true
    }
}

/// The stop that is in a frame without its delimiter, if there is one.
fn stop_in(frame: &mut [u8]) -> Option<Heard> {
    let len = cobs::decode_in_place(frame).ok()?;
    let (message, crc) = frame.get(..len)?.split_last_chunk::<CRC_BYTES>()?;
    let heard = match message {
        [_, PROVEN, rest @ ..] => {
            let proven = behind_varint(rest, LONGEST_NUMBER)?;
            timely(held(proven.get(PROOF_BYTES..)?)?)
        }
        [_, request @ ..] => timely(request),
        [] => None,
    }?;
    let is_whole = checksum(message) == u32::from_le_bytes(*crc) || mutant!(NoiseStops);
    is_whole.then_some(heard)
}

/// The stop that a request is, or that it brings a deadline for.
fn timely(request: &[u8]) -> Option<Heard> {
    match request {
        [WITHIN, rest @ ..] => match held(behind_varint(rest, LONGEST_DEADLINE)?)? {
            [request] => named(*request),
            _ => None,
        },
        [request] => named(*request),
        _ => None,
    }
}

/// What is behind a number of at most so many bytes.
fn behind_varint(bytes: &[u8], longest: usize) -> Option<&[u8]> {
    let len = bytes.iter().position(|byte| byte & 0x80 == 0)? + 1;
    bytes.get(len..).filter(|_| len <= longest)
}

/// The request that is held by another, behind its length.
fn held(bytes: &[u8]) -> Option<&[u8]> {
    let (len, request) = bytes.split_first()?;
    (usize::from(*len) == request.len()).then_some(request)
}

fn named(request: u8) -> Option<Heard> {
    match request {
        STOP => Some(Heard::Stop),
        EMERGENCY_STOP => Some(Heard::EmergencyStop),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use std::vec::Vec;

    use proptest::prelude::*;
    use serde::Serialize;

    use super::*;
    use esm_link::frame::{FrameError, FrameReader, MAX_FRAME_BYTES, decode, encode};
    use esm_link::message::{Request, ToDevice};

    fn framed(message: &impl Serialize) -> Vec<u8> {
        let mut frame = [0; MAX_FRAME_BYTES];
        let len = encode(message, &mut frame).expect("it fits");
        frame[..len].to_vec()
    }

    fn request(seq: u8, request: Request<'_>) -> Vec<u8> {
        framed(&ToDevice { seq, request })
    }

    /// As the layout says: a varint, bytes without a length, bytes with one.
    fn proven(seq: u8, number: u32, proof: [u8; PROOF_BYTES], request: Request<'_>) -> Vec<u8> {
        let mut room = [0; MAX_FRAME_BYTES];
        let request: &[u8] = postcard::to_slice(&request, &mut room).expect("it fits");
        framed(&(seq, PROVEN, number, proof, request))
    }

    fn within(by_us: u64, request: Request<'_>) -> Vec<u8> {
        let mut room = [0; MAX_FRAME_BYTES];
        let request: &[u8] = postcard::to_slice(&request, &mut room).expect("it fits");
        let mut other = [0; MAX_FRAME_BYTES];
        let within = Request::Within { by_us, request };
        postcard::to_slice(&within, &mut other)
            .expect("it fits")
            .to_vec()
    }

    /// How many stops are heard among these bytes.
    fn heard(bytes: &[u8]) -> (u32, bool) {
        let heartbeats = Heartbeats::new();
        let mut listener = StopListener::new(&heartbeats, None);
        let calls = bytes.iter().filter(|byte| listener.hear(**byte, true));
        let calls = calls.count() as u32;
        assert_eq!(heartbeats.stops.count(), calls);
        assert_eq!(heartbeats.stops.is_called(), calls > 0);
        (calls, heartbeats.is_emergency_stopped())
    }

    #[test]
    fn a_stop_is_known_under_every_number_with_and_without_a_proof() {
        for seq in 0..=255 {
            assert_eq!(heard(&request(seq, Request::Stop)), (1, false));
            assert_eq!(heard(&request(seq, Request::EmergencyStop)), (1, true));
            for number in [0, 1, 127, 128, 1 << 14, 1 << 21, 1 << 28, u32::MAX] {
                let proof = [seq.wrapping_mul(31); PROOF_BYTES];
                let stop = proven(seq, number, proof, Request::Stop);
                assert_eq!(heard(&stop), (1, false), "{stop:?}");
                let stop = proven(seq, number, proof, Request::EmergencyStop);
                assert_eq!(heard(&stop), (1, true), "{stop:?}");
                assert_eq!(heard(&proven(seq, number, proof, Request::Status)).0, 0);
            }
        }
    }

    #[test]
    fn a_stop_with_a_deadline_is_known_with_and_without_a_proof() {
        for by_us in [0, 1, 127, 128, 6_000_000, 1 << 35, u64::MAX] {
            for (request, is_emergency) in [(Request::Stop, false), (Request::EmergencyStop, true)]
            {
                let inner = within(by_us, request);
                let Ok(held) = postcard::from_bytes::<Request<'_>>(&inner) else {
                    panic!("{inner:?}");
                };
                assert_eq!(heard(&self::request(9, held)), (1, is_emergency));
                let stop = proven(9, 300, [by_us as u8; PROOF_BYTES], held);
                assert_eq!(heard(&stop), (1, is_emergency), "{stop:?}");
            }
            let other = within(by_us, Request::Start);
            let Ok(held) = postcard::from_bytes::<Request<'_>>(&other) else {
                panic!("{other:?}");
            };
            assert_eq!(heard(&request(9, held)).0, 0);
        }
    }

    #[test]
    fn the_longest_stop_just_fits() {
        let inner = within(u64::MAX, Request::Stop);
        let Ok(held) = postcard::from_bytes::<Request<'_>>(&inner) else {
            panic!("{inner:?}");
        };
        let stop = proven(255, u32::MAX, [255; PROOF_BYTES], held);
        assert_eq!(stop.len(), LONGEST + 1);
        assert_eq!(heard(&stop).0, 1);
    }

    #[test]
    fn nothing_else_is_a_stop() {
        for seq in [0, 7, 255] {
            for other in [
                Request::Hello,
                Request::Start,
                Request::Status,
                Request::Release,
                Request::Chunk {
                    offset: 6,
                    data: &[6, 27, 0, 6],
                },
            ] {
                assert_eq!(heard(&request(seq, other)).0, 0, "{other:?}");
            }
        }
        // With bytes behind it, it is no message at all.
        assert_eq!(heard(&framed(&(7_u8, STOP, 0_u8))).0, 0);
        assert_eq!(heard(&framed(&(STOP,))).0, 0);
    }

    #[test]
    fn a_changed_bit_makes_a_stop_none() {
        for stop in [
            request(9, Request::Stop),
            proven(9, 300, [6; PROOF_BYTES], Request::EmergencyStop),
        ] {
            for at in 0..stop.len() - 1 {
                for bit in 0..8 {
                    let mut changed = stop.clone();
                    changed[at] ^= 1 << bit;
                    assert_eq!(heard(&changed).0, 0, "byte {at}, bit {bit}");
                }
            }
        }
    }

    /// What the link makes of a line's bytes.
    fn stops_read(bytes: &[u8]) -> u32 {
        let mut reader = FrameReader::new();
        let mut count = 0;
        for byte in bytes {
            let Some(frame) = reader.push(*byte) else {
                continue;
            };
            let message: Result<ToDevice<'_>, FrameError> = decode(frame);
            let is_stop = |message: &ToDevice<'_>| {
                matches!(message.request, Request::Stop | Request::EmergencyStop)
            };
            count += u32::from(message.is_ok_and(|message| is_stop(&message)));
        }
        count
    }

    proptest! {
        #[test]
        fn what_is_heard_is_what_the_link_reads(
            parts in prop::collection::vec((0..5_u8, any::<u8>(), prop::collection::vec(any::<u8>(), 0..40)), 0..12)
        ) {
            let mut bytes = Vec::new();
            for (kind, seq, noise) in parts {
                match kind {
                    0 => bytes.extend(request(seq, Request::Stop)),
                    1 => bytes.extend(request(seq, Request::EmergencyStop)),
                    2 => bytes.extend(request(seq, Request::Chunk { offset: 3, data: &noise })),
                    3 => bytes.extend(noise),
                    _ => bytes.push(DELIMITER),
                }
            }
            prop_assert_eq!(heard(&bytes).0, stops_read(&bytes));
        }
    }
}
