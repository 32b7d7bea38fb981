//! Who may ask for what: which requests need a key's signature, and what is signed. Both ends of a
//! link follow it.
//!
//! A robot with a key carries out a request that changes something only if the key has signed it:
//! those bytes, for this once ([`Request::Signed`]). What only reads is open to everyone, and so
//! are [`Request::Stop`] and [`Request::EmergencyStop`]: whoever sees a robot do harm may stop it.

use serde::{Deserialize, Serialize};

use crate::message::Request;

/// Bytes of a public key.
pub const KEY_BYTES: usize = 32;
/// Bytes of a signature.
pub const SIGNATURE_BYTES: usize = 64;
/// Bytes of the number that a robot gives out for one signed request.
pub const NONCE_BYTES: usize = 16;
/// Bytes of the random number that names a robot's secret.
pub const SALT_BYTES: usize = 16;
/// Bytes of what robot and owner know alone.
pub const SECRET_BYTES: usize = 16;
/// Bytes of a proof: a message authentication code, cut to this length.
pub const PROOF_BYTES: usize = 16;
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

/// Whether a robot has a key, as it tells with its [`Hello`](crate::message::Response::Hello).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Access {
    /// It cannot have one: its firmware was built without, or has nowhere to keep it. It takes
    /// requests from anyone.
    #[default]
    Unsupported,
    /// It has none. It takes requests from anyone, [`Request::InstallKey`] among them.
    Open,
    /// It has one.
    Locked,
    /// What it keeps of its key cannot be read. It takes nothing that needs a key.
    Unreadable,
    /// Its records cannot be read, but it remembers the key that it had. It takes nothing but a key
    /// that this one has signed: that begins its records anew.
    Recovering,
    /// Its records cannot be read, and it is certain that it had no key. It takes nothing but a
    /// key, from anyone: that begins its records anew.
    Damaged,
}

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
    /// One from before the last: what somebody has kept.
    Old,
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
        | Request::Subscribe { .. }
        | Request::Watch { .. }
        | Request::LastWords
        | Request::BlackBox { .. }
        | Request::Param { .. }
        | Request::Clock
        | Request::Features
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
        // Standing still is safe.
        Request::Stop | Request::EmergencyStop => Needs::Nothing,
        Request::Commit(_)
        | Request::Confirm { .. }
        | Request::FallBack { .. }
        | Request::Start
        | Request::Release
        | Request::SetParam { .. }
        | Request::SaveParams { .. }
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
