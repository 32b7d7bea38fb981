//! A robot with a key: requests that change something are signed, each one for itself.

use std::time::Duration;

use rt_firmware::link::access::{
    self, Access, MAX_SIGNED_BYTES, NO_UPLOAD, NONCE_BYTES, Needs, SIGNATURE_BYTES, needs,
};
use rt_firmware::link::message::{LinkError, Request, Response};

use super::timing::Patience;
use super::{ClientError, LinkClient};
use crate::keys::{self, KeyError, PublicKey, SigningKey};
use crate::serial::ByteLink;

/// Gives the key when a robot asks for it for the first time.
pub type KeyLoader = Box<dyn FnMut() -> Result<SigningKey, KeyError> + Send>;

/// What a session knows of the robot's key.
pub(super) struct Signing {
    /// Whether the robot has one.
    pub(super) access: Access,
    signer: Signer,
    /// Of the last upload that was signed.
    pub(super) upload: [u8; SIGNATURE_BYTES],
}

impl Default for Signing {
    fn default() -> Self {
        Signing {
            access: Access::default(),
            signer: Signer::Nobody,
            upload: NO_UPLOAD,
        }
    }
}

impl Signing {
    /// Whether the robot takes a request signed only.
    pub(super) fn is_for(&self, request: &Request<'_>) -> bool {
        self.access == Access::Locked && needs(request) == Needs::Key
    }
}

/// The key of a session.
enum Signer {
    /// There is none.
    Nobody,
    /// It has not been asked for.
    Unread(KeyLoader),
    Key(SigningKey),
}

impl Signer {
    fn key(&mut self) -> Result<&SigningKey, ClientError> {
        if let Signer::Unread(load) = self {
            *self = Signer::Key(load()?);
        }
        match self {
            Signer::Key(key) => Ok(key),
            Signer::Nobody | Signer::Unread(_) => Err(ClientError::NoKey),
        }
    }
}

/// What a robot says when it is asked for a nonce.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Challenge {
    /// Good for one signed request.
    pub nonce: [u8; NONCE_BYTES],
    /// Counter of the last upload that the robot accepted.
    pub counter: u64,
    /// The robot's key.
    pub key: PublicKey,
}

impl<L: ByteLink> LinkClient<L> {
    /// The key for this session, in case the robot asks for one.
    pub fn use_key(&mut self, load: KeyLoader) {
        self.signing.signer = Signer::Unread(load);
    }

    /// Asks for a nonce, which is good for one signed request. Says also what the robot's key is.
    ///
    /// # Errors
    /// [`ClientError`]; refused with [`LinkError::NoKey`] where the robot has none.
    pub fn challenge(&mut self) -> Result<Challenge, ClientError> {
        self.ask("challenge", Request::Challenge, |response| match response {
            Response::Challenge {
                nonce,
                counter,
                key,
            } => Some(Challenge {
                nonce,
                counter,
                key: PublicKey(key),
            }),
            _ => None,
        })
    }

    /// From now on the robot has this key. It must have none, or the session's.
    ///
    /// # Errors
    /// [`ClientError`]
    pub fn install_key(&mut self, key: &SigningKey) -> Result<(), ClientError> {
        let public = key.public().0;
        let seed = keys::seed()?;
        let signature = key.sign(&access::install(&public, &seed));
        let request = Request::InstallKey {
            key: &public,
            seed: &seed,
            signature: &signature,
        };
        self.change_key("install a key", request)
    }

    /// From now on the robot has no key.
    ///
    /// # Errors
    /// [`ClientError`]
    pub fn remove_key(&mut self) -> Result<(), ClientError> {
        self.change_key("remove the key", Request::RemoveKey)
    }

    /// Has the key changed, and asks what holds then: also where the flash is said not to have taken it.
    fn change_key(&mut self, name: &'static str, request: Request<'_>) -> Result<(), ClientError> {
        let changed = self.ask_to_do(name, request);
        let greeted = match &changed {
            Err(error) if error.refusal() != Some(LinkError::NotKept) => Ok(()),
            _ => self.hello().map(drop),
        };
        changed.and(greeted)
    }

    /// Signs the blob that was uploaded.
    pub(super) fn sign_upload(&mut self, blob: &[u8]) -> Result<(), ClientError> {
        let challenge = self.challenge()?;
        let counter = challenge
            .counter
            .checked_add(1)
            .ok_or(ClientError::Refused {
                request: "sign",
                error: LinkError::OldCounter {
                    last: challenge.counter,
                },
            })?;
        let key = self.key_of(&challenge)?;
        let signature = key.sign(&access::upload(&counter.to_le_bytes(), blob));
        self.ask_to_do(
            "sign",
            Request::Sign {
                counter,
                signature: &signature,
            },
        )?;
        self.signing.upload = signature;
        Ok(())
    }

    /// Has a request signed, with the signature of the upload that it is about or [`NO_UPLOAD`], and sends it until its answer is there.
    pub(super) fn exchange_signed<T>(
        &mut self,
        name: &'static str,
        request: Request<'_>,
        upload: [u8; SIGNATURE_BYTES],
        longer: Duration,
        patience: &mut Patience,
        read: &mut impl FnMut(Response<'_>) -> Option<T>,
    ) -> Result<Result<Option<T>, LinkError>, ClientError> {
        let mut room = [0; MAX_SIGNED_BYTES];
        let bytes = postcard::to_slice(&request, &mut room).map_err(|_| ClientError::Refused {
            request: name,
            error: LinkError::TooLong,
        })?;
        let challenge = self.challenge()?;
        let key = self.key_of(&challenge)?;
        let signature = key.sign(&access::command(&challenge.nonce, &upload, bytes));
        let signed = Request::Signed {
            signature: &signature,
            request: bytes,
        };
        self.exchange(name, signed, longer, patience, read)
    }

    /// The session's key, if it is the robot's.
    fn key_of(&mut self, challenge: &Challenge) -> Result<&SigningKey, ClientError> {
        let key = self.signing.signer.key()?;
        if key.public() == challenge.key {
            Ok(key)
        } else {
            Err(ClientError::OtherKey {
                robot: challenge.key,
                ours: key.public(),
            })
        }
    }
}
