//! The owner's session with a robot that has a key: requests that the robot can tell from those of
//! others, and answers that are the robot's own.
//!
//! What a robot says outside of it may be anybody's. So nothing that a signature rests on is taken
//! from there, and where a session is open, an answer without its proof is none.

use esm_link::access::{MAX_PROVEN_BYTES, NONCE_BYTES, PROOF_BYTES, SALT_BYTES};
use esm_link::message::{LinkError, Request, Response, UNKNOWN};
use esm_link::proof::{Proof, Session, is_same};

/// A session, and how far it has come.
#[derive(Clone, Copy)]
pub(super) struct OwnerSession {
    pub(super) session: Session,
    /// Names the robot's secret, and is part of what is signed.
    pub(super) salt: [u8; SALT_BYTES],
    /// Number of the last request.
    number: u32,
}

impl OwnerSession {
    pub(super) fn new(session: Session, salt: [u8; SALT_BYTES]) -> Self {
        OwnerSession {
            session,
            salt,
            number: 0,
        }
    }

    /// The next request, with its proof; its bytes are put into `room`.
    pub(super) fn prove<'a>(
        &mut self,
        request: &Request<'_>,
        room: &'a mut [u8; MAX_PROVEN_BYTES],
    ) -> Option<(Request<'a>, Expected)> {
        let bytes = postcard::to_slice(request, room).ok()?;
        self.number = self.number.checked_add(1)?;
        let number = self.number;
        let proven = Request::Proven {
            number,
            proof: self.session.of_request(number, bytes),
            request: bytes,
        };
        let session = self.session;
        Some((proven, Expected::Proven { session, number }))
    }
}

/// An answer, as it came.
pub(super) struct Answer<'a> {
    pub(super) seq: u8,
    /// The kind of the request that it is to.
    pub(super) of: u8,
    pub(super) result: Result<Response<'a>, LinkError>,
    /// Its proof, and the bytes that this is of.
    pub(super) proof: Option<(Proof, &'a [u8])>,
}

impl Answer<'_> {
    /// Whether it is to a request of this kind. A robot that did not understand a message cannot
    /// tell.
    pub(super) fn is_of(&self, kind: u8) -> bool {
        let is_misunderstood = matches!(self.result, Err(LinkError::Malformed));
        self.of == kind || self.of == UNKNOWN && is_misunderstood || mutant!(OtherKindTaken)
    }
}

/// What makes an answer the robot's own.
#[derive(Clone, Copy)]
pub(super) enum Expected {
    /// Nothing: the robot has no key, or this session is no owner's.
    Plain,
    /// The proof for the request of this number.
    Proven { session: Session, number: u32 },
}

impl Expected {
    /// Whether an answer is the robot's own.
    pub(super) fn accepts(&self, answer: &Answer<'_>) -> bool {
        match (self, answer.proof) {
            (Expected::Plain, None) => true,
            (Expected::Proven { session, number }, Some((proof, bytes))) => {
                is_same(&proof, &session.of_answer(*number, bytes)) || mutant!(ForgeryTaken)
            }
            (Expected::Proven { .. }, None) => mutant!(UnprovenTaken),
            (Expected::Plain, Some(_)) => false,
        }
    }

    /// Whether the robot may say so without a proof: it knows of no session, or of another one.
    /// Whoever else says so can do no more than have another one begun.
    pub(super) fn is_ended_by(&self, answer: &Answer<'_>) -> bool {
        const PROVEN: u8 = Request::Proven {
            number: 0,
            proof: [0; PROOF_BYTES],
            request: &[],
        }
        .kind();
        const OPEN: u8 = Request::OpenSession {
            client: [0; NONCE_BYTES],
            robot: [0; NONCE_BYTES],
            proof: [0; PROOF_BYTES],
        }
        .kind();
        matches!(self, Expected::Proven { .. })
            && answer.proof.is_none()
            && !mutant!(SessionEndIgnored)
            && matches!(
                (answer.of, answer.result),
                (PROVEN, Err(LinkError::NoSession | LinkError::WrongProof))
                    | (OPEN, Err(LinkError::NoChallenge | LinkError::WrongProof))
            )
    }
}

/// The kind of a request, or of what it holds.
pub(super) fn innermost_kind(request: &Request<'_>) -> u8 {
    match request {
        Request::Within { request: bytes, .. } | Request::Signed { request: bytes, .. } => {
            // What this program has put there can be read.
            postcard::from_bytes(bytes).map_or(UNKNOWN, |request| innermost_kind(&request))
        }
        request => request.kind(),
    }
}
