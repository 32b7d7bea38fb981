//! A frame on its way out.
//!
//! *Invariant:* once its first byte is sent, a frame is sent to its end before another.

use super::port::LinkPort;
use crate::features::{KEYS, PARAMS, STATUS_EVENTS};
use esm_link::frame::{CRC_BYTES, encode_with};
use esm_link::keys::Session;
use esm_link::message::{FromDevice, PROVEN_HEADER_BYTES, Response};

/// Bytes of a stream's frame beside those of the stream: kind, channel, number, continuation, count
/// of dropped records (5), length, checksum, COBS, delimiter.
pub(super) const STREAM_OVERHEAD: usize = 1 + 1 + 1 + 1 + 5 + 1 + CRC_BYTES + 1 + 1;

/// Streams.
pub(super) const CHANNELS: usize = 4;

/// A frame on its way out.
pub(super) struct Outgoing<const N: usize> {
    frame: [u8; N],
    len: u8,
    sent: u8,
}

impl<const N: usize> Outgoing<N> {
    pub(super) const NOTHING: Self = Outgoing {
        frame: [0; N],
        len: 0,
        sent: 0,
    };

    pub(super) fn is_done(&self) -> bool {
        self.sent == self.len
    }

    pub(super) fn is_begun(&self) -> bool {
        self.sent > 0 && !self.is_done()
    }

    pub(super) fn set(&mut self, message: &FromDevice<'_>) {
        self.set_proven(message, None);
    }

    /// The same, with the proof of an answer in the owner's session, if it is one.
    pub(super) fn set_proven(&mut self, message: &FromDevice<'_>, proof: Option<&ProofOf>) {
        const { assert!(N <= u8::MAX as usize) };
        self.len = write(message, proof, &mut self.frame);
        self.sent = 0;
    }

    /// The frame is to be sent once more.
    pub(super) fn again(&mut self) {
        self.sent = 0;
    }

    /// None of it has been sent yet, if there is one.
    pub(super) fn is_unsent(&self) -> bool {
        self.sent == 0
    }

    /// Sends what the port takes. Returns whether the frame is gone.
    pub(super) fn send(&mut self, port: &mut impl LinkPort) -> bool {
        while self.sent < self.len {
            let Some(byte) = self.frame.get(usize::from(self.sent)) else {
                break;
            };
            if !port.send(*byte) {
                return false;
            }
            self.sent += 1;
        }
        true
    }
}

/// What the proof of an answer is made with.
pub(super) struct ProofOf {
    pub(super) session: Session,
    /// The number of the request.
    pub(super) number: u32,
}

/// Writes a message as a frame; returns its length.
#[inline(never)]
fn write(message: &FromDevice<'_>, proof: Option<&ProofOf>, frame: &mut [u8]) -> u8 {
    // What the firmware was built without it never says, and need not be able to write.
    if !is_said(message) {
        return 0;
    }
    let prove = |message: &mut [u8]| {
        let Some(ProofOf { session, number }) = proof else {
            return;
        };
        let Some((head, answer)) = message.split_at_mut_checked(PROVEN_HEADER_BYTES) else {
            return;
        };
        if let Some(place) = head.last_chunk_mut() {
            *place = session.of_answer(*number, answer);
        }
    };
    // What does not fit is a defect of the message types, for which there is a test; then nothing
    // is sent.
    encode_with(message, frame, prove).unwrap_or(0) as u8
}

/// Whether this firmware has what a message is about.
fn is_said(message: &FromDevice<'_>) -> bool {
    match message {
        FromDevice::StatusEvent(_) => STATUS_EVENTS,
        FromDevice::Reply {
            result:
                Ok(
                    Response::Param { .. }
                    | Response::ParamSet { .. }
                    | Response::ParamsSaved { .. },
                ),
            ..
        } => PARAMS,
        FromDevice::Proven { .. }
        | FromDevice::Reply {
            result: Ok(Response::Challenge { .. } | Response::Identity(_)),
            ..
        } => KEYS,
        _ => true,
    }
}
