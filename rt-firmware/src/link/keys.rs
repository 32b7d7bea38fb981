//! The robot's key: what is kept of it, and what it is asked to allow.
//!
//! What an attacker in the line can do at most is to keep requests from arriving. To that end each thing that is signed holds what makes it good for once:
//! a request the robot's nonce, which is used up by the first try; an upload a counter, which only goes up, and which is kept before the mission runs.
//!
//! A signature takes a tenth of a second to verify. Everything that costs nothing is looked at before, and after a wrong one the robot looks at none for
//! [`PAUSE_AFTER_WRONG_US`]: who sends wrong ones takes a tenth of the time that slots leave.

use ed25519_compact::{PublicKey, Signature, VerifyingState, sha512};

use super::access::{
    self, Access, KEY_BYTES, NO_UPLOAD, NONCE_BYTES, NONCE_CONTEXT, SEED_BYTES, SIGNATURE_BYTES,
};
use super::key_safe::{KEY_RECORD_BYTES, KeyRecord, KeySafe, NotKept};
use super::message::LinkError;

/// How long no signature is looked at after a wrong one, in microseconds.
pub const PAUSE_AFTER_WRONG_US: u64 = 1_000_000;

/// An upload that the key has signed.
#[derive(Clone, Copy)]
pub(crate) struct SignedUpload {
    counter: u64,
    signature: [u8; SIGNATURE_BYTES],
}

impl SignedUpload {
    /// Whether it was signed with this.
    pub(crate) fn is(&self, counter: u64, signature: &[u8]) -> bool {
        self.counter == counter && self.signature == signature
    }
}

/// What the link knows of the robot's key.
pub(crate) struct Keys {
    lock: Lock,
    /// Of the last upload that was accepted.
    counter: u64,
    /// Which start of the robot this is, once it has been counted.
    start: Option<u64>,
    /// Nonces given out since the start.
    challenges: u64,
    /// Good for one request.
    nonce: Option<[u8; NONCE_BYTES]>,
    /// No signature is looked at before.
    closed_until_us: u64,
}

#[derive(Clone, Copy)]
enum Lock {
    /// Nobody has looked yet.
    Unread,
    Open,
    Locked {
        key: [u8; KEY_BYTES],
        seed: [u8; SEED_BYTES],
    },
    Unreadable,
}

impl Keys {
    pub(crate) const fn new() -> Self {
        Keys {
            lock: Lock::Unread,
            counter: 0,
            start: None,
            challenges: 0,
            nonce: None,
            closed_until_us: 0,
        }
    }

    /// Whether the robot has a key.
    pub(crate) fn access(&mut self, safe: Option<&mut dyn KeySafe>) -> Access {
        let Some(safe) = safe else {
            return Access::Unsupported;
        };
        if matches!(self.lock, Lock::Unread) {
            (self.lock, self.counter) = match read(safe) {
                Ok(kept) => kept,
                // Where nobody knows whether there is a key, nobody may.
                Err(NotKept) => (Lock::Unreadable, u64::MAX),
            };
        }
        match self.lock {
            Lock::Open => Access::Open,
            Lock::Locked { .. } => Access::Locked,
            Lock::Unread | Lock::Unreadable => Access::Unreadable,
        }
    }

    fn locked(&self) -> Result<([u8; KEY_BYTES], [u8; SEED_BYTES]), LinkError> {
        match self.lock {
            Lock::Locked { key, seed } => Ok((key, seed)),
            Lock::Open | Lock::Unread => Err(LinkError::NoKey),
            Lock::Unreadable => Err(LinkError::NotKept),
        }
    }

    /// A nonce for the next signed request; the one before is void. With the counter of the last upload and the key.
    // Not inlined: what it needs of the stack is needed for no other request.
    #[inline(never)]
    pub(crate) fn challenge(
        &mut self,
        safe: &mut dyn KeySafe,
    ) -> Result<([u8; NONCE_BYTES], u64, [u8; KEY_BYTES]), LinkError> {
        let (key, seed) = self.locked()?;
        let start = match self.start {
            Some(start) => start,
            None => {
                let start = number(safe, KeyRecord::Starts)?.wrapping_add(1);
                safe.write(KeyRecord::Starts, &start.to_le_bytes())?;
                *self.start.insert(start)
            }
        };
        self.challenges = self.challenges.wrapping_add(1);
        let mut hash = sha512::Hash::new();
        hash.update(NONCE_CONTEXT);
        hash.update(seed);
        hash.update(start.to_le_bytes());
        hash.update(self.challenges.to_le_bytes());
        hash.update(safe.now_us().to_le_bytes());
        let mut nonce = [0; NONCE_BYTES];
        for (place, byte) in nonce.iter_mut().zip(hash.finalize()) {
            *place = byte;
        }
        self.nonce = Some(nonce);
        Ok((nonce, self.counter, key))
    }

    /// Whether the key has signed an upload, which must be newer than the last one.
    pub(crate) fn check_upload(
        &mut self,
        safe: &mut dyn KeySafe,
        counter: u64,
        signature: &[u8],
        blob: &[u8],
    ) -> Result<SignedUpload, LinkError> {
        let (key, _) = self.locked()?;
        let signature = signature_of(signature)?;
        let is_old = if planted!(CounterRepeated) {
            counter < self.counter
        } else {
            counter <= self.counter
        };
        if is_old {
            return Err(LinkError::OldCounter { last: self.counter });
        }
        let counter_bytes = counter.to_le_bytes();
        let message = access::upload(&counter_bytes, blob);
        self.check(safe, &key, &signature, &message)?;
        Ok(SignedUpload { counter, signature })
    }

    /// Whether the key has signed a request, with the nonce that was given out last. That is used up, whatever comes of it.
    pub(crate) fn check_command(
        &mut self,
        safe: &mut dyn KeySafe,
        signature: &[u8],
        upload: Option<&SignedUpload>,
        request: &[u8],
    ) -> Result<(), LinkError> {
        let (key, _) = self.locked()?;
        let signature = signature_of(signature)?;
        let nonce = self.nonce.take().ok_or(LinkError::NoChallenge)?;
        if planted!(NonceKept) {
            self.nonce = Some(nonce);
        }
        let upload = upload.map_or(&NO_UPLOAD, |upload| &upload.signature);
        let message = access::command(&nonce, upload, request);
        self.check(safe, &key, &signature, &message)
    }

    /// Takes over a key, which must have signed itself. Who may do that was asked before.
    pub(crate) fn install(
        &mut self,
        safe: &mut dyn KeySafe,
        key: &[u8],
        seed: &[u8],
        signature: &[u8],
    ) -> Result<(), LinkError> {
        let key: [u8; KEY_BYTES] = key.try_into().map_err(|_| LinkError::Malformed)?;
        let seed: [u8; SEED_BYTES] = seed.try_into().map_err(|_| LinkError::Malformed)?;
        let signature = signature_of(signature)?;
        self.check(safe, &key, &signature, &access::install(&key, &seed))?;
        // Who listens now does not know what the seed was before.
        let seed = match self.lock {
            Lock::Locked { seed: before, .. } => mixed(&before, &seed),
            _ => seed,
        };
        let mut record = [0; KEY_RECORD_BYTES];
        for (place, byte) in record.iter_mut().zip(key.iter().chain(&seed)) {
            *place = *byte;
        }
        self.write(safe, KeyRecord::Key, &record)?;
        self.lock = Lock::Locked { key, seed };
        self.nonce = None;
        Ok(())
    }

    /// Forgets the key. The counter stays: an old upload is no newer for it.
    pub(crate) fn remove(&mut self, safe: &mut dyn KeySafe) -> Result<(), LinkError> {
        self.locked()?;
        self.write(safe, KeyRecord::Key, &[])?;
        self.lock = Lock::Open;
        self.nonce = None;
        Ok(())
    }

    /// The mission of this upload is about to run: from now on only newer ones are accepted.
    pub(crate) fn accept(
        &mut self,
        safe: &mut dyn KeySafe,
        upload: &SignedUpload,
    ) -> Result<(), LinkError> {
        self.write(safe, KeyRecord::Counter, &upload.counter.to_le_bytes())?;
        self.counter = upload.counter;
        Ok(())
    }

    /// Keeps a record. Where that is refused it may be kept all the same: then what holds is what will be read at the next start.
    fn write(
        &mut self,
        safe: &mut dyn KeySafe,
        record: KeyRecord,
        bytes: &[u8],
    ) -> Result<(), NotKept> {
        let written = safe.write(record, bytes);
        if written.is_err() {
            match read(safe) {
                Ok(kept) => (self.lock, self.counter) = kept,
                // Whether there is a key now nobody knows.
                Err(NotKept) if matches!(self.lock, Lock::Open) => self.lock = Lock::Unreadable,
                Err(NotKept) => {}
            }
            self.nonce = None;
        }
        written
    }

    fn check(
        &mut self,
        safe: &mut dyn KeySafe,
        key: &[u8; KEY_BYTES],
        signature: &[u8; SIGNATURE_BYTES],
        message: &[&[u8]],
    ) -> Result<(), LinkError> {
        let left_us = self.closed_until_us.saturating_sub(safe.now_us());
        if left_us > 0 {
            return Err(LinkError::TooSoon {
                // A second at most. A division of 64 bits would take a routine of its own.
                ms: u32::try_from(left_us).unwrap_or(u32::MAX).div_ceil(1_000),
            });
        }
        if is_signed(key, signature, message) {
            return Ok(());
        }
        if !planted!(PauseForgotten) {
            self.closed_until_us = safe.now_us().saturating_add(PAUSE_AFTER_WRONG_US);
        }
        Err(LinkError::WrongSignature)
    }
}

/// Whether a key has signed a message, which is given in pieces.
///
/// Verification is cut in three, none of them inlined, so that only the hungriest is on the stack: 4.5 KiB instead of 6.
pub fn is_signed(
    key: &[u8; KEY_BYTES],
    signature: &[u8; SIGNATURE_BYTES],
    message: &[&[u8]],
) -> bool {
    let mut state = None;
    begin(key, signature, &mut state);
    let Some(state) = &mut state else {
        return false;
    };
    for piece in message {
        absorb(state, piece);
    }
    end(state)
}

/// Reads key and signature. Leaves nothing where they are no points of the curve, or points that every message would fit.
#[inline(never)]
fn begin(
    key: &[u8; KEY_BYTES],
    signature: &[u8; SIGNATURE_BYTES],
    state: &mut Option<VerifyingState>,
) {
    *state = PublicKey::new(*key)
        .verify_incremental(&Signature::new(*signature))
        .ok();
}

#[inline(never)]
fn absorb(state: &mut VerifyingState, piece: &[u8]) {
    state.absorb(piece);
}

#[inline(never)]
fn end(state: &VerifyingState) -> bool {
    state.verify().is_ok()
}

fn signature_of(bytes: &[u8]) -> Result<[u8; SIGNATURE_BYTES], LinkError> {
    bytes.try_into().map_err(|_| LinkError::Malformed)
}

#[inline(never)]
fn mixed(before: &[u8; SEED_BYTES], with: &[u8; SEED_BYTES]) -> [u8; SEED_BYTES] {
    let mut hash = sha512::Hash::new();
    hash.update(NONCE_CONTEXT);
    hash.update(before);
    hash.update(with);
    let mut seed = [0; SEED_BYTES];
    for (place, byte) in seed.iter_mut().zip(hash.finalize()) {
        *place = byte;
    }
    seed
}

/// A record that is a number; 0 where there is none.
fn number(safe: &mut dyn KeySafe, record: KeyRecord) -> Result<u64, NotKept> {
    let mut bytes = [0; size_of::<u64>()];
    match safe.read(record, &mut bytes)? {
        0 => Ok(0),
        8 => Ok(u64::from_le_bytes(bytes)),
        _ => Err(NotKept),
    }
}

/// The lock and the counter, as they are kept.
fn read(safe: &mut dyn KeySafe) -> Result<(Lock, u64), NotKept> {
    let mut bytes = [0; KEY_RECORD_BYTES];
    let lock = match safe.read(KeyRecord::Key, &mut bytes)? {
        0 => Lock::Open,
        KEY_RECORD_BYTES => {
            let (key, seed) = bytes.split_first_chunk().ok_or(NotKept)?;
            Lock::Locked {
                key: *key,
                seed: seed.try_into().map_err(|_| NotKept)?,
            }
        }
        _ => return Err(NotKept),
    };
    Ok((lock, number(safe, KeyRecord::Counter)?))
}
