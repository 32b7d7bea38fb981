//! Sizes of keys, signatures, nonces and proofs, and whether a robot has a key.

use serde::{Deserialize, Serialize};

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

/// Whether a robot has a key, as it tells with its [`Hello`](crate::message::Response::Hello).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Access {
    /// It cannot have one: its firmware was built without, or has nowhere to keep it. It takes
    /// requests from anyone.
    #[default]
    Unsupported,
    /// It has none. It takes requests from anyone,
    /// [`InstallKey`](crate::message::Request::InstallKey) among them.
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
