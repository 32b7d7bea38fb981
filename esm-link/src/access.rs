//! Who may ask for what: which requests need a key's signature, and what is signed. Both ends of a
//! link follow it.
//!
//! A robot with a key carries out a request that changes something only if the key has signed it:
//! those bytes, for this once ([`Request::Signed`]). What only reads is open to everyone, and so
//! are [`Request::Stop`] and [`Request::EmergencyStop`]: whoever sees a robot do harm may stop it.

pub use crate::credentials::{
    Access, KEY_BYTES, NONCE_BYTES, PROOF_BYTES, SALT_BYTES, SECRET_BYTES, SIGNATURE_BYTES,
};
use crate::message::Request;

/// Greatest number of bytes of a request that is signed, as it is serialized: the longest is
/// [`Request::InstallKey`] within a time.
pub const MAX_SIGNED_BYTES: usize = 148;
/// Greatest number of bytes of a request in the owner's session, as it is serialized: the longest
/// is [`Request::Signed`].
pub const MAX_PROVEN_BYTES: usize = 4 + SIGNATURE_BYTES + MAX_SIGNED_BYTES;
/// How far the counter of an upload may be from the one before: an owner who was told a wrong
/// one cannot use them all up.
pub const MAX_COUNTER_STEP: u64 = 1 << 16;
/// How long a nonce is good for, in microseconds of the robot's clock.
pub const NONCE_LIFE_US: u64 = 10_000_000;
/// How far ahead a [deadline](Request::Within) may be, in microseconds of the robot's clock.
pub const MAX_DEADLINE_US: u64 = 30_000_000;

/// What a signed message begins with, so that a signature for one thing is none for another.
const CONTEXT_BYTES: usize = 16;
/// Context of a request.
const COMMAND: [u8; CONTEXT_BYTES] = *b"esm command v1\0\0";
/// Context of a mission's blob.
const UPLOAD: [u8; CONTEXT_BYTES] = *b"esm upload v2\0\0\0";
/// Context of a key that is installed.
const INSTALL: [u8; CONTEXT_BYTES] = *b"esm install v2\0\0";

/// Stands for the signature of an upload where a request has nothing to do with one.
pub const NO_UPLOAD: [u8; SIGNATURE_BYTES] = [0; SIGNATURE_BYTES];

/// What a robot with a key asks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Needs {
    /// Nothing: everyone may.
    Nothing,
    /// The owner's [session](Request::OpenSession): it costs the robot time, or what the owner
    /// uploads.
    Session,
    /// The key's signature.
    Key,
}

/// What a request in the owner's session is, by its number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Recurrence {
    /// The next one.
    New,
    /// The last one, once more.
    Again,
}

/// What a request needs. Each one is named, so that none is forgotten.
pub fn needs(request: &Request<'_>) -> Needs {
    match request {
        // They read.
        Request::Hello
        | Request::Status
        | Request::Task { .. }
        | Request::ReadBlob { .. }
        | Request::States { .. }
        | Request::SlotCounters { .. }
        | Request::TaskCounters { .. }
        | Request::FrameCounters { .. }
        | Request::Subscribe { .. }
        | Request::Watch { .. }
        | Request::CrashReport
        | Request::BlackBox { .. }
        | Request::Param { .. }
        | Request::Clock
        | Request::Features
        | Request::BehaviourList
        | Request::Values { .. } => Needs::Nothing,
        // They bring a proof, which is looked at, or ask for one.
        Request::Identify { .. } | Request::OpenSession { .. } | Request::Proven { .. } => {
            Needs::Nothing
        }
        // What it holds is looked at in its place.
        Request::Within { .. } => Needs::Nothing,
        // There is one buffer for the next mission, and one nonce.
        Request::Begin { .. } | Request::Chunk { .. } | Request::Abort | Request::Challenge => {
            Needs::Session
        }
        // They bring a signature, and verifying takes time.
        Request::Sign { .. } | Request::Signed { .. } => Needs::Session,
        // Whoever changes the rate keeps others from the line for a while.
        Request::Selftest { .. } => Needs::Session,
        // Many in a second: a signature each would take longer than they hold, and they hold for a
        // moment alone.
        Request::Drive { .. } | Request::EndDrive => Needs::Session,
        // Standing still is safe.
        Request::Stop | Request::EmergencyStop => Needs::Nothing,
        Request::Commit(_)
        | Request::Confirm { .. }
        | Request::FallBack { .. }
        | Request::Start
        | Request::Release
        | Request::SetParam { .. }
        | Request::SaveParams { .. }
        | Request::Behaviours(_)
        | Request::InstallKey { .. }
        | Request::RemoveKey => Needs::Key,
    }
}

/// Whether a request may be brought [within a time](Request::Within). A session's beginning and the
/// parts of an upload may come at any time, and what holds another request is held by none but
/// [`Request::Signed`] and [`Request::Proven`].
pub fn may_have_deadline(request: &Request<'_>) -> bool {
    !matches!(
        request,
        Request::Hello
            | Request::Chunk { .. }
            | Request::Signed { .. }
            | Request::Within { .. }
            | Request::Identify { .. }
            | Request::OpenSession { .. }
            | Request::Proven { .. }
    )
}

/// Whether a request may be part of the owner's session. Its beginning cannot, and there is one in
/// another nowhere.
pub fn may_be_proven(request: &Request<'_>) -> bool {
    !matches!(
        request,
        Request::Hello
            | Request::Identify { .. }
            | Request::OpenSession { .. }
            | Request::Proven { .. }
    )
}

/// What is signed for a request: the bytes of `request` as they are in [`Request::Signed`], the
/// robot's nonce, and, if it is a [`Request::Commit`], the signature of the upload that it is
/// about; otherwise [`NO_UPLOAD`].
pub fn command<'a>(
    nonce: &'a [u8; NONCE_BYTES],
    upload: &'a [u8; SIGNATURE_BYTES],
    request: &'a [u8],
) -> [&'a [u8]; 4] {
    [&COMMAND, nonce, upload, request]
}

/// What is signed for an upload: the robot's salt, so that it is for one installation of one key,
/// its counter, as eight bytes, little endian, and its blob.
pub fn upload<'a>(
    salt: &'a [u8; SALT_BYTES],
    counter: &'a [u8; 8],
    blob: &'a [u8],
) -> [&'a [u8]; 4] {
    [&UPLOAD, salt, counter, blob]
}

/// What a key signs itself to be installed, with salt and secret as they are sent.
pub fn install<'a>(
    key: &'a [u8; KEY_BYTES],
    salt: &'a [u8; SALT_BYTES],
    secret: &'a [u8; SECRET_BYTES],
) -> [&'a [u8]; 4] {
    [&INSTALL, key, salt, secret]
}
