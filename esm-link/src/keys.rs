//! The robot's key: what is kept of it, and what it is asked to allow.
//!
//! What an attacker in the line can do at most is to keep requests from arriving. To that end each
//! thing that is signed holds what makes it good for once: a request the robot's nonce, which is
//! used up by the first try and lives for [`NONCE_LIFE_US`]; an upload a counter, which only goes
//! up, and which is kept before the mission runs.
//!
//! A signature takes a tenth of a second to verify. So it is looked at in the owner's session only,
//! which strangers have no part in: its requests have a [proof](crate::proof), which takes next to
//! no time. After a wrong signature the robot looks at none for [`PAUSE_AFTER_WRONG_US`].

use ed25519_compact::{PublicKey, Signature, VerifyingState};

use crate::access::{
    self, Access, KEY_BYTES, MAX_COUNTER_STEP, NO_UPLOAD, NONCE_BYTES, NONCE_LIFE_US, Recurrence,
    SALT_BYTES, SECRET_BYTES, SIGNATURE_BYTES,
};
use crate::key_store::{KeyStore, NotStored, STORED_KEY_BYTES, StoredKey, WriteError};
use crate::message::{Identity, LinkError};
pub use crate::proof::Session;
use crate::proof::{KeyedSecret, Proof, RequestChecker, Secret, is_same, mask};

/// The number of a request in the owner's session is above that of the one before by so much at
/// most: a client counts on by one.
const MOST_AHEAD: u32 = 64;
/// How long no signature is looked at after a wrong one, in microseconds.
pub const PAUSE_AFTER_WRONG_US: u64 = 1_000_000;

/// An upload that the key has signed.
#[derive(Clone, Copy)]
pub struct SignedUpload {
    counter: u64,
    signature: [u8; SIGNATURE_BYTES],
}

impl SignedUpload {
    /// Whether it was signed with this.
    pub fn is(&self, counter: u64, signature: &[u8]) -> bool {
        self.counter == counter && self.signature == signature
    }
}

/// What the link knows of the robot's key.
pub struct Keys {
    lock: Lock,
    /// Made when a proof was asked for first.
    keyed: Option<KeyedSecret>,
    /// Of the last upload that was accepted.
    counter: u64,
    /// Which start of the robot this is, once it has been counted.
    start: Option<u64>,
    session: Option<OpenSession>,
    /// Nonces given out for signed requests since the start.
    challenges: u64,
    /// Good for one signed request.
    nonce: Option<Nonce>,
    /// No signature is looked at before.
    closed_until_us: u64,
}

/// What robot and owner agreed upon when the key was installed.
#[derive(Clone, Copy)]
struct Owner {
    key: [u8; KEY_BYTES],
    salt: [u8; SALT_BYTES],
    secret: Secret,
}

/// The owner's session.
struct OpenSession {
    session: Session,
    checker: RequestChecker,
    client: [u8; NONCE_BYTES],
    robot: [u8; NONCE_BYTES],
    /// Number of the last request.
    number: u32,
    /// The key was changed or removed in it: nothing follows but what was lost.
    is_over: bool,
}

/// A number that is good for one signed request, for some time.
#[derive(Clone, Copy)]
struct Nonce {
    bytes: [u8; NONCE_BYTES],
    until_us: u64,
}

#[derive(Clone, Copy)]
enum Lock {
    /// Nobody has looked yet.
    Unread,
    Open,
    Locked(Owner),
    Unreadable,
    /// The records are damaged, and this is the owner from before that.
    Recovering(Owner),
    /// The records are damaged, and there was no owner.
    Damaged,
}

impl Lock {
    fn secret(&self) -> Option<Secret> {
        match self {
            Lock::Locked(owner) | Lock::Recovering(owner) => Some(owner.secret),
            Lock::Unread | Lock::Open | Lock::Unreadable | Lock::Damaged => None,
        }
    }
}

impl Default for Keys {
    fn default() -> Self {
        Self::new()
    }
}

impl Keys {
    /// A robot of which nothing has been read yet.
    pub const fn new() -> Self {
        Keys {
            lock: Lock::Unread,
            keyed: None,
            counter: 0,
            start: None,
            session: None,
            challenges: 0,
            nonce: None,
            closed_until_us: 0,
        }
    }

    /// Whether the robot has a key.
    pub fn access(&mut self, safe: Option<&mut dyn KeyStore>) -> Access {
        let Some(safe) = safe else {
            return Access::Unsupported;
        };
        self.look(safe);
        match self.lock {
            Lock::Open => Access::Open,
            Lock::Locked(_) => Access::Locked,
            Lock::Unread | Lock::Unreadable => Access::Unreadable,
            Lock::Recovering(_) => Access::Recovering,
            Lock::Damaged => Access::Damaged,
        }
    }

    /// Reads what is kept, if nobody has yet.
    fn look(&mut self, safe: &mut dyn KeyStore) {
        if matches!(self.lock, Lock::Unread) {
            (self.lock, self.counter) = read(safe);
        }
    }

    fn owner(&mut self, safe: &mut dyn KeyStore) -> Result<Owner, LinkError> {
        self.look(safe);
        match self.lock {
            Lock::Locked(owner) | Lock::Recovering(owner) => Ok(owner),
            Lock::Open | Lock::Unread | Lock::Damaged => Err(LinkError::NoKey),
            Lock::Unreadable => Err(LinkError::NotStored),
        }
    }

    /// The owner's secret, for proofs.
    fn keyed(&mut self, secret: &Secret) -> &KeyedSecret {
        // The key may have been changed since.
        let known = self.keyed.take().filter(|keyed| keyed.is_of(secret));
        self.keyed.insert(known.unwrap_or_else(|| secret.keyed()))
    }

    /// The number of this start, which no other one has.
    fn start(&mut self, safe: &mut dyn KeyStore) -> Result<u64, WriteError> {
        if let Some(start) = self.start {
            return Ok(start);
        }
        // Nothing can be written beside damage, and what its owner has to say is said in one
        // session.
        let start = match self.lock {
            Lock::Recovering(_) => 0,
            _ => {
                let start = number(safe, StoredKey::Starts)?.wrapping_add(1);
                safe.write(StoredKey::Starts, &start.to_le_bytes())?;
                start
            }
        };
        Ok(*self.start.insert(start))
    }

    /// Which key the robot has, with a nonce for a session. Nothing is kept of it, so that
    /// who asks again and again takes nothing from the owner.
    // Not inlined: what it needs of the stack is needed for no other request.
    #[inline(never)]
    pub fn identify(
        &mut self,
        safe: &mut dyn KeyStore,
        now_us: u64,
        client: &[u8; NONCE_BYTES],
    ) -> Result<Identity, LinkError> {
        let Owner { key, salt, secret } = self.owner(safe)?;
        let start = self.start(safe)?;
        let counter = self.counter;
        let secret = self.keyed(&secret);
        let nonce = session_nonce(secret, start, now_us, client);
        Ok(Identity {
            key,
            salt,
            nonce,
            counter,
            proof: secret.of_identity(client, &key, &salt, &nonce, counter),
        })
    }

    /// Begins a session, in place of the one before. Its first answer has the number 0.
    #[inline(never)]
    pub fn open_session(
        &mut self,
        safe: &mut dyn KeyStore,
        now_us: u64,
        client: &[u8; NONCE_BYTES],
        robot: &[u8; NONCE_BYTES],
        proof: &Proof,
    ) -> Result<(), LinkError> {
        let Owner { secret, .. } = self.owner(safe)?;
        let start = self.start(safe)?;
        let at_us = given_at_us(robot);
        let age_us = now_us.checked_sub(at_us);
        let is_young = age_us.is_some_and(|age_us| age_us <= NONCE_LIFE_US);
        if !is_young && !mutant!(OldSessionOpened) {
            return Err(LinkError::NoChallenge);
        }
        let secret = self.keyed(&secret);
        // A robot's nonce that was made up is not worth a session's key.
        let is_nonce_ours = is_same(robot, &session_nonce(secret, start, at_us, client));
        if !is_nonce_ours && !mutant!(SessionUnproven) {
            return Err(LinkError::WrongProof);
        }
        let session = secret.session(client, robot);
        if !is_same(proof, &session.opening()) && !mutant!(SessionUnproven) {
            return Err(LinkError::WrongProof);
        }
        match &self.session {
            // The answer to it was lost.
            Some(open) if (open.client, open.robot) == (*client, *robot) => return Ok(()),
            // One that somebody has kept. With the key before it went what follows from its secret.
            Some(open)
                if !open.is_over
                    && given_at_us(&open.robot) >= at_us
                    && !mutant!(SessionReplayed) =>
            {
                return Err(LinkError::NoChallenge);
            }
            _ => {}
        }
        self.session = Some(OpenSession {
            session,
            checker: session.checker(),
            client: *client,
            robot: *robot,
            number: 0,
            is_over: false,
        });
        self.nonce = None;
        Ok(())
    }

    /// Whether a request is of the owner's session, and whether it is a new one.
    #[inline(never)]
    pub fn check_proven(
        &mut self,
        number: u32,
        proof: &Proof,
        request: &[u8],
    ) -> Result<Recurrence, LinkError> {
        let open = self.session.as_mut().ok_or(LinkError::NoSession)?;
        // What cannot be the owner's next request costs no proof.
        let is_old = number < open.number && !mutant!(NumberRepeated);
        if is_old || number.saturating_sub(open.number) > MOST_AHEAD {
            return Err(LinkError::WrongProof);
        }
        if !is_same(proof, &open.checker.of_request(number, request)) && !mutant!(ProofUnchecked) {
            return Err(LinkError::WrongProof);
        }
        if number > open.number || mutant!(NumberRepeated) {
            if open.is_over {
                return Err(LinkError::NoSession);
            }
            open.number = number;
            Ok(Recurrence::New)
        } else {
            Ok(Recurrence::Again)
        }
    }

    /// The owner's session, to prove answers with.
    pub fn session(&self) -> Option<Session> {
        self.session.as_ref().map(|open| open.session)
    }

    /// Ends the session behind the answer that is made now.
    fn end_session(&mut self) {
        self.nonce = None;
        if let Some(open) = &mut self.session {
            open.is_over = true;
        }
    }

    /// A nonce for the next signed request; the one before is void. With the counter of the last
    /// upload.
    // Not inlined: what it needs of the stack is needed for no other request.
    #[inline(never)]
    pub fn challenge(
        &mut self,
        safe: &mut dyn KeyStore,
        now_us: u64,
    ) -> Result<([u8; NONCE_BYTES], u64), LinkError> {
        let Owner { secret, .. } = self.owner(safe)?;
        let start = self.start(safe)?;
        self.challenges = self.challenges.wrapping_add(1);
        let challenges = self.challenges.to_le_bytes();
        let bytes =
            self.keyed(&secret)
                .nonce(&[&start.to_le_bytes(), &challenges, &now_us.to_le_bytes()]);
        self.nonce = Some(Nonce {
            bytes,
            until_us: now_us.saturating_add(NONCE_LIFE_US),
        });
        Ok((bytes, self.counter))
    }

    /// Whether the key has signed an upload, which must be newer than the last one.
    pub fn check_upload(
        &mut self,
        safe: &mut dyn KeyStore,
        now_us: u64,
        counter: u64,
        signature: &[u8],
        blob: &[u8],
    ) -> Result<SignedUpload, LinkError> {
        let Owner { key, salt, .. } = self.owner(safe)?;
        let signature = signature_of(signature)?;
        let is_old = if mutant!(CounterRepeated) {
            counter < self.counter
        } else {
            counter <= self.counter
        };
        if is_old {
            return Err(LinkError::OldCounter { last: self.counter });
        }
        if counter - self.counter > MAX_COUNTER_STEP && !mutant!(CounterUnlimited) {
            return Err(LinkError::CounterTooFar { last: self.counter });
        }
        let counter_bytes = counter.to_le_bytes();
        let message = access::upload(&salt, &counter_bytes, blob);
        self.check(now_us, &key, &signature, &message)?;
        Ok(SignedUpload { counter, signature })
    }

    /// Whether the key has signed a request, with the nonce that was given out last. That is used
    /// up, whatever comes of it. Answers when the nonce's life ends.
    pub fn check_command(
        &mut self,
        safe: &mut dyn KeyStore,
        now_us: u64,
        signature: &[u8],
        upload: Option<&SignedUpload>,
        request: &[u8],
    ) -> Result<u64, LinkError> {
        let Owner { key, .. } = self.owner(safe)?;
        let signature = signature_of(signature)?;
        let nonce = self.nonce.take().ok_or(LinkError::NoChallenge)?;
        if mutant!(NonceKept) {
            self.nonce = Some(nonce);
        }
        if now_us > nonce.until_us && !mutant!(NonceForEver) {
            return Err(LinkError::NoChallenge);
        }
        let upload = upload.map_or(&NO_UPLOAD, |upload| &upload.signature);
        let message = access::command(&nonce.bytes, upload, request);
        self.check(now_us, &key, &signature, &message)?;
        Ok(nonce.until_us)
    }

    /// Takes over a key, which must have signed itself. Who may do that was asked before.
    pub fn install(
        &mut self,
        safe: &mut dyn KeyStore,
        now_us: u64,
        key: &[u8],
        salt: &[u8],
        secret: &[u8],
        signature: &[u8],
    ) -> Result<(), LinkError> {
        let key: [u8; KEY_BYTES] = key.try_into().map_err(|_| LinkError::Malformed)?;
        let salt: [u8; SALT_BYTES] = salt.try_into().map_err(|_| LinkError::Malformed)?;
        let secret: [u8; SECRET_BYTES] = secret.try_into().map_err(|_| LinkError::Malformed)?;
        let signature = signature_of(signature)?;
        let message = access::install(&key, &salt, &secret);
        self.check(now_us, &key, &signature, &message)?;
        let sent = Secret(secret);
        let secret = match (self.lock, &self.session) {
            // Who listens does not learn it.
            (Lock::Locked(_) | Lock::Recovering(_), Some(open)) => mask(sent, &open.session, &salt),
            _ => sent,
        };
        let mut record = [0; STORED_KEY_BYTES];
        let bytes = key.iter().chain(&salt).chain(&secret.0);
        for (place, byte) in record.iter_mut().zip(bytes) {
            *place = *byte;
        }
        if matches!(self.lock, Lock::Recovering(_) | Lock::Damaged) {
            safe.renew(&record)?;
            // Signatures of before hold another salt.
            self.counter = 0;
        } else {
            self.write(safe, StoredKey::Key, &record)?;
        }
        self.lock = Lock::Locked(Owner { key, salt, secret });
        self.end_session();
        Ok(())
    }

    /// Forgets the key. The counter stays: an old upload is no newer for it.
    pub fn remove(&mut self, safe: &mut dyn KeyStore) -> Result<(), LinkError> {
        self.owner(safe)?;
        self.write(safe, StoredKey::Key, &[])?;
        self.lock = Lock::Open;
        self.end_session();
        Ok(())
    }

    /// The mission of this upload is about to run: from now on only newer ones are accepted.
    pub fn accept(
        &mut self,
        safe: &mut dyn KeyStore,
        upload: &SignedUpload,
    ) -> Result<(), LinkError> {
        self.write(safe, StoredKey::Counter, &upload.counter.to_le_bytes())?;
        self.counter = upload.counter;
        Ok(())
    }

    /// Keeps a record. Where that is refused it may be kept all the same: then what holds is what
    /// will be read at the next start.
    fn write(
        &mut self,
        safe: &mut dyn KeyStore,
        record: StoredKey,
        bytes: &[u8],
    ) -> Result<(), WriteError> {
        let written = safe.write(record, bytes);
        if written.is_err() {
            let before = self.lock.secret();
            match read(safe) {
                // Where nobody knows whether there is a key now, the one before stays.
                (Lock::Unreadable | Lock::Recovering(_) | Lock::Damaged, _)
                    if matches!(self.lock, Lock::Locked(_)) => {}
                kept => (self.lock, self.counter) = kept,
            }
            if self.lock.secret() != before {
                self.end_session();
            }
            self.nonce = None;
        }
        written
    }

    fn check(
        &mut self,
        now_us: u64,
        key: &[u8; KEY_BYTES],
        signature: &[u8; SIGNATURE_BYTES],
        message: &[&[u8]],
    ) -> Result<(), LinkError> {
        let left_us = self.closed_until_us.saturating_sub(now_us);
        if left_us > 0 {
            return Err(LinkError::TooSoon {
                // A second at most. A division of 64 bits would take a routine of its own.
                ms: u32::try_from(left_us).unwrap_or(u32::MAX).div_ceil(1_000),
            });
        }
        if is_signed(key, signature, message) {
            return Ok(());
        }
        if !mutant!(PauseForgotten) {
            self.closed_until_us = now_us.saturating_add(PAUSE_AFTER_WRONG_US);
        }
        Err(LinkError::WrongSignature)
    }
}

/// Whether a key has signed a message, which is given in pieces.
///
/// Verification is cut in three, none of them inlined, so that only the hungriest is on the stack:
/// 4.5 KiB instead of 6.
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

/// Reads key and signature. Leaves nothing where they are no points of the curve, or points that
/// every message would fit.
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

/// A nonce for a session: the time at which it is given out, and what only this robot makes of
/// that, of its start and of the client's nonce. So it need not be kept to be known again.
fn session_nonce(
    secret: &KeyedSecret,
    start: u64,
    at_us: u64,
    client: &[u8; NONCE_BYTES],
) -> [u8; NONCE_BYTES] {
    let at_us = at_us.to_le_bytes();
    let tag: [u8; TIME_BYTES] = secret.nonce(&[&start.to_le_bytes(), &at_us, client]);
    let mut nonce = [0; NONCE_BYTES];
    for (place, byte) in nonce.iter_mut().zip(at_us.iter().chain(&tag)) {
        *place = *byte;
    }
    nonce
}

/// Bytes of a time in a nonce.
const TIME_BYTES: usize = size_of::<u64>();

/// When a session's nonce was given out.
fn given_at_us(nonce: &[u8; NONCE_BYTES]) -> u64 {
    nonce
        .first_chunk()
        .map_or(0, |bytes| u64::from_le_bytes(*bytes))
}

/// A record that is a number; 0 where there is none.
fn number(safe: &mut dyn KeyStore, record: StoredKey) -> Result<u64, NotStored> {
    let mut bytes = [0; size_of::<u64>()];
    match safe.read(record, &mut bytes)? {
        0 => Ok(0),
        8 => Ok(u64::from_le_bytes(bytes)),
        _ => Err(NotStored),
    }
}

/// The lock and the counter, as they are kept.
fn read(safe: &mut dyn KeyStore) -> (Lock, u64) {
    match read_records(safe) {
        Ok(kept) => kept,
        Err(NotStored) => (remembered(safe), u64::MAX),
    }
}

/// Who may have the records begun anew, where they cannot be read.
fn remembered(safe: &mut dyn KeyStore) -> Lock {
    let mut bytes = [0; STORED_KEY_BYTES];
    match safe.remembered_key(&mut bytes) {
        Ok(0) => Lock::Damaged,
        Ok(STORED_KEY_BYTES) => owner_of(&bytes).map_or(Lock::Unreadable, Lock::Recovering),
        // Where nobody knows whether there is a key, nobody may.
        _ => Lock::Unreadable,
    }
}

fn read_records(safe: &mut dyn KeyStore) -> Result<(Lock, u64), NotStored> {
    let mut bytes = [0; STORED_KEY_BYTES];
    let lock = match safe.read(StoredKey::Key, &mut bytes)? {
        0 => Lock::Open,
        STORED_KEY_BYTES => Lock::Locked(owner_of(&bytes)?),
        _ => return Err(NotStored),
    };
    Ok((lock, number(safe, StoredKey::Counter)?))
}

fn owner_of(record: &[u8; STORED_KEY_BYTES]) -> Result<Owner, NotStored> {
    let (key, rest) = record.split_first_chunk().ok_or(NotStored)?;
    let (salt, secret) = rest.split_first_chunk().ok_or(NotStored)?;
    Ok(Owner {
        key: *key,
        salt: *salt,
        secret: Secret(secret.try_into().map_err(|_| NotStored)?),
    })
}
