//! The owner's end of a session with a robot, without a line: requests are proven, and answers
//! looked at.

use esm_link::access::{KEY_BYTES, NONCE_BYTES, SALT_BYTES, SIGNATURE_BYTES, install};
use esm_link::message::{Identity, PROVEN_HEADER_BYTES, Request};
use esm_link::proof::{Proof, Secret, Session, is_same};
use host_tools::keys::SigningKey;

/// A session of an owner.
#[derive(Clone, Copy)]
pub struct Owner {
    /// What both sides have worked out.
    pub session: Session,
    /// Number of the last request.
    pub number: u32,
}

/// A request in a session.
pub struct ProvenRequest {
    /// Its number.
    pub number: u32,
    /// Its proof.
    pub proof: Proof,
    /// Its bytes.
    pub bytes: Vec<u8>,
}

impl ProvenRequest {
    /// As it goes over the line.
    pub fn request(&self) -> Request<'_> {
        Request::Proven {
            number: self.number,
            proof: self.proof,
            request: &self.bytes,
        }
    }
}

impl Owner {
    /// The session that follows from what a robot answered to this nonce.
    ///
    /// # Panics
    /// It is not the robot's own answer.
    pub fn of(key: &SigningKey, client: &[u8; NONCE_BYTES], identity: &Identity) -> Self {
        assert!(key.is_known_to(identity, client), "the robot has this key");
        let secret = key.secret(&identity.salt).keyed();
        Owner {
            session: secret.session(client, &identity.nonce),
            number: 0,
        }
    }

    /// What opens it.
    pub fn opening(&self, client: [u8; NONCE_BYTES], identity: &Identity) -> Request<'static> {
        Request::OpenSession {
            client,
            robot: identity.nonce,
            proof: self.session.opening(),
        }
    }

    /// The next request.
    ///
    /// # Panics
    /// It is longer than any.
    pub fn prove(&mut self, request: &Request<'_>) -> ProvenRequest {
        self.number += 1;
        let bytes = bytes_of(request);
        ProvenRequest {
            number: self.number,
            proof: self.session.of_request(self.number, &bytes),
            bytes,
        }
    }

    /// Whether this message is the robot's own answer to the request of this number.
    pub fn accepts(&self, number: u32, proof: &Proof, message: &[u8]) -> bool {
        let answer = message.get(PROVEN_HEADER_BYTES..).unwrap_or_default();
        is_same(proof, &self.session.of_answer(number, answer))
    }
}

/// A request as it is serialized, without a number.
///
/// # Panics
/// It is longer than any.
pub fn bytes_of(request: &Request<'_>) -> Vec<u8> {
    let mut room = [0; 256];
    let bytes = postcard::to_slice(request, &mut room);
    bytes.expect("requests are shorter").to_vec()
}

/// What brings a key to a robot that has none.
pub struct Installation {
    key: [u8; KEY_BYTES],
    salt: [u8; SALT_BYTES],
    secret: Secret,
    signature: [u8; SIGNATURE_BYTES],
}

impl Installation {
    /// With the secret as it is.
    pub fn of(key: &SigningKey, salt: [u8; SALT_BYTES]) -> Self {
        Self::with(key, salt, key.secret(&salt))
    }

    /// With this secret, masked or not.
    pub fn with(key: &SigningKey, salt: [u8; SALT_BYTES], secret: Secret) -> Self {
        let public = key.public().0;
        Installation {
            key: public,
            salt,
            secret,
            signature: key.sign(&install(&public, &salt, &secret.0)),
        }
    }

    /// As it goes over the line.
    pub fn request(&self) -> Request<'_> {
        Request::InstallKey {
            key: &self.key,
            salt: &self.salt,
            secret: &self.secret.0,
            signature: &self.signature,
        }
    }
}
