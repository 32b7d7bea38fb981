//! Who may ask for what: which requests need a key's signature, and what is signed. Both ends of a link follow it.
//!
//! A robot with a key carries out a request that changes something only if the key has signed it: those bytes, for this once
//! ([`Request::Signed`]). What only reads is open to everyone, and so are [`Request::Stop`] and [`Request::EmergencyStop`]: whoever sees a robot do harm may stop it.

use serde::{Deserialize, Serialize};

use super::message::Request;

/// Bytes of a public key.
pub const KEY_BYTES: usize = 32;
/// Bytes of a signature.
pub const SIGNATURE_BYTES: usize = 64;
/// Bytes of the number that a robot gives out for one signed request.
pub const NONCE_BYTES: usize = 16;
/// Bytes of what a robot's nonces are made from, which is brought with its key.
pub const SEED_BYTES: usize = 16;
/// Greatest number of bytes of a request that is signed, as it is serialized: what a message has room for beside the signature.
pub const MAX_SIGNED_BYTES: usize = 120;

/// What a signed message begins with, so that a signature for one thing is none for another.
const CONTEXT_BYTES: usize = 16;
/// Context of a request.
const COMMAND: [u8; CONTEXT_BYTES] = *b"esm command v1\0\0";
/// Context of a mission's blob.
const UPLOAD: [u8; CONTEXT_BYTES] = *b"esm upload v1\0\0\0";
/// Context of a key that is installed.
const INSTALL: [u8; CONTEXT_BYTES] = *b"esm install v1\0\0";
/// Context of what nonces are made from. Nothing is signed under it.
pub const NONCE_CONTEXT: [u8; CONTEXT_BYTES] = *b"esm nonce v1\0\0\0\0";

/// Stands for the signature of an upload where a request has nothing to do with one.
pub const NO_UPLOAD: [u8; SIGNATURE_BYTES] = [0; SIGNATURE_BYTES];

/// Whether a robot has a key, as it tells with its [`Hello`](super::message::Response::Hello).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Access {
    /// It cannot have one: its firmware was built without, or has nowhere to keep it. It takes requests from anyone.
    #[default]
    Unsupported,
    /// It has none. It takes requests from anyone, [`Request::InstallKey`] among them.
    Open,
    /// It has one.
    Locked,
    /// What it keeps of its key cannot be read. It takes nothing that needs a key.
    Unreadable,
}

/// What a robot with a key asks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Needs {
    /// Nothing: everyone may.
    Nothing,
    /// The key's signature.
    Key,
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
        | Request::Values { .. }
        | Request::Challenge => Needs::Nothing,
        // What it holds is looked at in its place.
        Request::Within { .. } => Needs::Nothing,
        // They fill a buffer that nothing runs from.
        Request::Begin { .. } | Request::Chunk { .. } | Request::Abort => Needs::Nothing,
        // They bring a signature, which is looked at.
        Request::Sign { .. } | Request::Signed { .. } => Needs::Nothing,
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

/// Whether a request may be brought [within a time](Request::Within). A session's beginning and the parts of an upload may come at any time, and what holds another
/// request is held by none but [`Request::Signed`].
pub fn may_have_deadline(request: &Request<'_>) -> bool {
    !matches!(
        request,
        Request::Hello | Request::Chunk { .. } | Request::Signed { .. } | Request::Within { .. }
    )
}

/// What is signed for a request: the bytes of `request` as they are in [`Request::Signed`], the robot's nonce, and, if it is a [`Request::Commit`], the
/// signature of the upload that it is about; otherwise [`NO_UPLOAD`].
pub fn command<'a>(
    nonce: &'a [u8; NONCE_BYTES],
    upload: &'a [u8; SIGNATURE_BYTES],
    request: &'a [u8],
) -> [&'a [u8]; 4] {
    [&COMMAND, nonce, upload, request]
}

/// What is signed for an upload: its counter, as eight bytes, little endian, and its blob.
pub fn upload<'a>(counter: &'a [u8; 8], blob: &'a [u8]) -> [&'a [u8]; 3] {
    [&UPLOAD, counter, blob]
}

/// What a key signs itself to be installed.
pub fn install<'a>(key: &'a [u8; KEY_BYTES], seed: &'a [u8; SEED_BYTES]) -> [&'a [u8]; 3] {
    [&INSTALL, key, seed]
}
