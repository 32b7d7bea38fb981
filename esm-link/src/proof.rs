//! Proofs: what robot and owner show each other of the secret that they share.
//!
//! A robot with a key has a secret besides, which came with the key. The owner derives it from the
//! private part of the key and the robot's salt, so that it is kept nowhere else. A proof is
//! HMAC-SHA-256 (RFC 2104, FIPS 180-4) of a context and what it is about, cut to
//! [`PROOF_BYTES`]. It takes a hundredth of the time that a signature takes to verify.
//!
//! A session begins with two nonces, one of each side, from which both derive its key. Each
//! request in it has a number that goes up, and a proof; its answer has a proof for the same
//! number. So an answer belongs to one request of one session, and none comes twice.
//!
//! A proof shows that the other side knows the secret. What changes the robot needs a signature
//! besides: who reads the robot's flash learns the secret, and not the owner's private key.

use hmac::{Hmac, Mac};
use sha2::Sha256;

use crate::access::{KEY_BYTES, NONCE_BYTES, PROOF_BYTES, SALT_BYTES, SECRET_BYTES};

/// Bytes of a context.
const CONTEXT_BYTES: usize = 16;
/// What a proof begins with, so that one for one thing is none for another.
type Context = [u8; CONTEXT_BYTES];
const SECRET: Context = *b"esm secret v1\0\0\0";
const SESSION: Context = *b"esm session v1\0\0";
const IDENTITY: Context = *b"esm identity v1\0";
const OPENING: Context = *b"esm opening v1\0\0";
const REQUEST: Context = *b"esm request v1\0\0";
const ANSWER: Context = *b"esm answer v1\0\0\0";
const MASK: Context = *b"esm mask v1\0\0\0\0\0";
const NONCE: Context = *b"esm nonce v2\0\0\0\0";

/// Bytes of HMAC-SHA-256.
pub const MAC_BYTES: usize = 32;

/// A proof.
pub type Proof = [u8; PROOF_BYTES];

/// What robot and owner know alone.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct Secret(pub [u8; SECRET_BYTES]);

// Not derived: a secret is nobody's business.
impl core::fmt::Debug for Secret {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str("Secret")
    }
}

impl Secret {
    /// That of the robot with this salt, for the owner of a key, by the bytes of its private part.
    pub fn of_owner(private: &[u8], salt: &[u8; SALT_BYTES]) -> Self {
        Secret(cut(&mac(private, &SECRET, &[salt])))
    }

    /// The secret, worked into the hash.
    pub fn keyed(&self) -> KeyedSecret {
        KeyedSecret {
            secret: *self,
            mac: keyed(&self.0),
        }
    }
}

/// A secret that has been worked into the hash, which is half of what a short proof takes:
/// strangers have a robot work out proofs.
pub struct KeyedSecret {
    secret: Secret,
    mac: Hmac<Sha256>,
}

impl KeyedSecret {
    /// Whether it is of this secret.
    pub fn is_of(&self, secret: &Secret) -> bool {
        self.secret == *secret
    }

    /// The proof of an [`Identity`](crate::message::Identity), by its fields and the nonce of the
    /// request.
    pub fn of_identity(
        &self,
        client: &[u8; NONCE_BYTES],
        key: &[u8; KEY_BYTES],
        salt: &[u8; SALT_BYTES],
        robot: &[u8; NONCE_BYTES],
        counter: u64,
    ) -> Proof {
        let fields: [&[u8]; 5] = [client, key, salt, robot, &counter.to_le_bytes()];
        cut(&self.mac(&IDENTITY, &fields))
    }

    /// The session of these nonces.
    pub fn session(&self, client: &[u8; NONCE_BYTES], robot: &[u8; NONCE_BYTES]) -> Session {
        Session {
            key: self.mac(&SESSION, &[client, robot]),
        }
    }

    /// Bytes that nobody foretells, made of what no two nonces have in common.
    #[inline(never)]
    pub(crate) fn nonce<const N: usize>(&self, of: &[&[u8]]) -> [u8; N] {
        cut(&self.mac(&NONCE, of))
    }

    fn mac(&self, context: &Context, pieces: &[&[u8]]) -> [u8; MAC_BYTES] {
        finished(self.mac.clone(), context, pieces)
    }
}

/// A session of an owner with a robot.
#[derive(Clone, Copy)]
pub struct Session {
    key: [u8; MAC_BYTES],
}

impl Session {
    /// The key that both sides have worked out.
    pub fn key(&self) -> &[u8; MAC_BYTES] {
        &self.key
    }

    /// The owner's proof that the session is open.
    pub fn opening(&self) -> Proof {
        cut(&mac(&self.key, &OPENING, &[]))
    }

    /// The proof of a request, by its number in the session and its bytes as they are in
    /// [`Request::Proven`](crate::message::Request::Proven).
    pub fn of_request(&self, number: u32, request: &[u8]) -> Proof {
        self.checker().of_request(number, request)
    }

    /// What checks the proofs of requests.
    pub fn checker(&self) -> RequestChecker {
        RequestChecker(keyed(&self.key))
    }

    /// The proof of an answer, by the number of the request and the bytes of the message
    /// [behind the proof](crate::message::PROVEN_HEADER_BYTES).
    pub fn of_answer(&self, number: u32, answer: &[u8]) -> Proof {
        cut(&mac(&self.key, &ANSWER, &[&number.to_le_bytes(), answer]))
    }
}

/// Works out the proofs of a session's requests. Its key has been worked into the hash already,
/// which is half of what a proof of a short request takes: strangers send wrong ones.
pub struct RequestChecker(Hmac<Sha256>);

impl RequestChecker {
    /// The same as [`Session::of_request`].
    pub fn of_request(&self, number: u32, request: &[u8]) -> Proof {
        let pieces = [&number.to_le_bytes(), request];
        cut(&finished(self.0.clone(), &REQUEST, &pieces))
    }
}

/// The secret that comes with a key, as it travels in the session of the key before: applied
/// twice, it is as it was.
pub fn mask(secret: Secret, session: &Session, salt: &[u8; SALT_BYTES]) -> Secret {
    let mask: [u8; SECRET_BYTES] = cut(&mac(&session.key, &MASK, &[salt]));
    let mut masked = secret;
    for (byte, mask) in masked.0.iter_mut().zip(mask) {
        *byte ^= mask;
    }
    masked
}

/// Whether two proofs are the same. Takes as long for those that differ, wherever they do.
pub fn is_same(one: &Proof, other: &Proof) -> bool {
    let pairs = one.iter().zip(other);
    pairs.fold(0, |differs, (one, other)| differs | (one ^ other)) == 0
}

fn mac(key: &[u8], context: &Context, pieces: &[&[u8]]) -> [u8; MAC_BYTES] {
    finished(keyed(key), context, pieces)
}

/// HMAC-SHA-256 of nothing yet, with this key.
#[inline(never)]
fn keyed(key: &[u8]) -> Hmac<Sha256> {
    match Hmac::new_from_slice(key) {
        Ok(mac) => mac,
        // HMAC takes keys of any length, so there is no error: the type is that of all MACs.
        Err(_) => unreachable!(),
    }
}

// Not inlined: the hash is on the stack of one function alone.
#[inline(never)]
fn finished(mut mac: Hmac<Sha256>, context: &Context, pieces: &[&[u8]]) -> [u8; MAC_BYTES] {
    mac.update(context);
    for piece in pieces {
        mac.update(piece);
    }
    mac.finalize().into_bytes().into()
}

fn cut<const N: usize>(mac: &[u8; MAC_BYTES]) -> [u8; N] {
    const { assert!(N <= MAC_BYTES) };
    let mut proof = [0; N];
    for (place, byte) in proof.iter_mut().zip(mac) {
        *place = *byte;
    }
    proof
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_proof_is_hmac_sha_256_of_context_and_what_it_is_about() {
        // RFC 4231, test case 2, cut: with the key `Jefe`.
        let hmac = |key: &[u8], text: &[u8]| {
            let mut mac = keyed(key);
            mac.update(text);
            mac.finalize().into_bytes()
        };
        assert_eq!(
            hmac(b"Jefe", b"what do ya want for nothing?")[..4],
            [0x5b, 0xdc, 0xc1, 0x46]
        );
        let session = Secret([7; SECRET_BYTES])
            .keyed()
            .session(&[1; NONCE_BYTES], &[2; NONCE_BYTES]);
        let whole = [&REQUEST[..], &[3, 0, 0, 0], b"request"].concat();
        assert_eq!(
            session.of_request(3, b"request"),
            hmac(session.key(), &whole)[..PROOF_BYTES]
        );
    }

    #[test]
    fn whatever_differs_has_another_proof() {
        let secret = Secret::of_owner(b"private", &[0; SALT_BYTES]);
        assert_ne!(secret, Secret::of_owner(b"private", &[1; SALT_BYTES]));
        assert_ne!(secret, Secret::of_owner(b"pirvate", &[0; SALT_BYTES]));
        let session = secret.keyed().session(&[1; NONCE_BYTES], &[2; NONCE_BYTES]);
        let others = [
            secret.keyed().session(&[2; NONCE_BYTES], &[1; NONCE_BYTES]),
            Secret::of_owner(b"private", &[1; SALT_BYTES])
                .keyed()
                .session(&[1; NONCE_BYTES], &[2; NONCE_BYTES]),
        ];
        for other in others {
            assert_ne!(session.opening(), other.opening());
        }
        let proof = session.of_request(1, b"stop");
        assert!(is_same(&proof, &session.of_request(1, b"stop")));
        for other in [
            session.of_request(2, b"stop"),
            session.of_request(1, b"stap"),
            session.of_answer(1, b"stop"),
        ] {
            assert!(!is_same(&proof, &other));
        }
    }

    #[test]
    fn a_mask_is_taken_off_by_who_has_put_it_on() {
        let old = Secret([1; SECRET_BYTES])
            .keyed()
            .session(&[2; NONCE_BYTES], &[3; NONCE_BYTES]);
        let new = Secret([4; SECRET_BYTES]);
        let masked = mask(new, &old, &[5; SALT_BYTES]);
        assert_ne!(masked, new);
        assert_eq!(mask(masked, &old, &[5; SALT_BYTES]), new);
        assert_ne!(mask(masked, &old, &[6; SALT_BYTES]), new);
    }
}
