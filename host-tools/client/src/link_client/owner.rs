//! A robot with a key: requests that change something are signed, each one for itself.

use std::time::Duration;

use esm_link::access::{
    self, MAX_SIGNED_BYTES, NONCE_BYTES, Needs, SALT_BYTES, SIGNATURE_BYTES, may_be_proven, needs,
};
use esm_link::message::{Identity, LinkError, Request, Response};
use esm_link::proof::mask;

use super::session::{Expected, OwnerSession};
use super::signing::{KeyLoader, RobotIdentity, Signer};
use super::timing::Patience;
use super::{ClientError, LinkClient};
use crate::keys::{self, PublicKey, SigningKey};
use crate::serial::ByteLink;

impl<L: ByteLink> LinkClient<L> {
    /// The key for this session, in case the robot asks for one.
    pub fn use_key(&mut self, load: KeyLoader) {
        self.signing.signer = Signer::Unread(load);
        self.signing.only_reads = false;
    }

    /// A robot that says that it has no key is refused: somebody may answer in its place.
    pub fn insist_on_key(&mut self) {
        self.signing.insists = true;
    }

    /// Whether what the robot says is proven to be its own, as far as it must be: it has an owner,
    /// and this is its session.
    pub fn is_proven(&self) -> bool {
        self.signing.session.is_some() || !self.signing.has_owner()
    }

    /// Which key the robot says that it has. Anybody may answer in its place: in a session with the
    /// owner of that key it has shown it.
    ///
    /// # Errors
    /// [`ClientError`]; refused with [`LinkError::NoKey`] where the robot has none.
    pub fn identity(&mut self) -> Result<RobotIdentity, ClientError> {
        let nonce = keys::random()?;
        let request = Request::Identify { nonce };
        self.ask("identify", request, |response| match response {
            Response::Identity(Identity { key, counter, .. }) => Some(RobotIdentity {
                key: PublicKey(key),
                counter,
            }),
            _ => None,
        })
    }

    /// Opens a session with the robot's owner, if a request is for one and there is none yet. Who
    /// has no key may read.
    pub(super) fn open_session_for(
        &mut self,
        request: &Request<'_>,
        patience: &mut Patience,
    ) -> Result<(), ClientError> {
        let signing = &mut self.signing;
        if !may_be_proven(request) || signing.session.is_some() {
            return Ok(());
        }
        if !signing.has_owner() {
            return if signing.insists {
                Err(ClientError::NotLocked)
            } else {
                Ok(())
            };
        }
        let only_reads = needs(request) == Needs::Nothing && !signing.insists;
        if signing.only_reads && only_reads {
            return Ok(());
        }
        match self.open_session(patience) {
            // A stop needs no key, nor does who reads.
            Err(ClientError::NoKey | ClientError::Key(_) | ClientError::OtherKey { .. })
                if only_reads || request.is_stop() && !self.signing.insists =>
            {
                self.signing.only_reads = true;
                Ok(())
            }
            // The robot is to stop, whoever will say that it has.
            Err(error) if request.is_stop() => {
                let stop = self.frame("stop", *request, Expected::Plain)?;
                self.send_wire(stop.wire())?;
                Err(error)
            }
            opened => opened,
        }
    }

    /// Opens a session: the robot shows that it has the key's secret, and so does this side.
    fn open_session(&mut self, patience: &mut Patience) -> Result<(), ClientError> {
        const NAME: &str = "open a session";
        // Not before it is known that there is a key to go on with.
        self.signing.signer.key()?;
        loop {
            let client = keys::random()?;
            let identity = self.identify(client, patience)?;
            let key = self.signing.signer.key()?;
            let session = key
                .secret(&identity.salt)
                .keyed()
                .session(&client, &identity.nonce);
            let request = Request::OpenSession {
                client,
                robot: identity.nonce,
                proof: session.opening(),
            };
            let frame = self.frame(NAME, request, Expected::Proven { session, number: 0 })?;
            let mut read = |response: Response<'_>| match response {
                Response::Done => Some(()),
                _ => None,
            };
            match self.exchange_frame(NAME, request, &frame, Duration::ZERO, patience, &mut read)? {
                Ok(Some(())) => {
                    self.signing.session = Some(OwnerSession::new(session, identity.salt));
                    return Ok(());
                }
                // It took too long, or another session was opened meanwhile.
                Err(LinkError::NoChallenge | LinkError::NoSession) if patience.lasts() => {
                    self.pause(NAME, super::BUSY_WAIT, patience)?;
                }
                Ok(None) => return Err(ClientError::BadAnswer { request: NAME }),
                Err(error) => {
                    return Err(ClientError::Refused {
                        request: NAME,
                        error,
                    });
                }
            }
        }
    }

    /// Lets the robot show that it has the secret of this session's key.
    fn identify(
        &mut self,
        client: [u8; NONCE_BYTES],
        patience: &mut Patience,
    ) -> Result<Identity, ClientError> {
        const NAME: &str = "identify";
        let request = Request::Identify { nonce: client };
        loop {
            let frame = self.frame(NAME, request, Expected::Plain)?;
            let key = self.signing.signer.key()?;
            let ours = key.public();
            // Each salt has a secret of its own.
            let mut read = |response: Response<'_>| {
                let Response::Identity(identity) = response else {
                    return None;
                };
                let is_shown = key.is_known_to(&identity, &client) || mutant!(IdentityBelieved);
                Some((identity, is_shown))
            };
            match self.exchange_frame(NAME, request, &frame, Duration::ZERO, patience, &mut read)? {
                Ok(Some((identity, true))) => return Ok(identity),
                Ok(Some((identity, false))) if PublicKey(identity.key) != ours => {
                    return Err(ClientError::OtherKey {
                        robot: PublicKey(identity.key),
                        ours,
                    });
                }
                // Somebody has answered in its place.
                Ok(_) if patience.lasts() => self.pause(NAME, super::BUSY_WAIT, patience)?,
                Ok(_) => return Err(ClientError::Unproven { request: NAME }),
                Err(error) => {
                    return Err(ClientError::Refused {
                        request: NAME,
                        error,
                    });
                }
            }
        }
    }

    /// Asks for a nonce, which is good for one signed request, and for the counter of the last
    /// upload.
    fn challenge(&mut self) -> Result<([u8; NONCE_BYTES], u64), ClientError> {
        self.ask("challenge", Request::Challenge, |response| match response {
            Response::Challenge { nonce, counter } => Some((nonce, counter)),
            _ => None,
        })
    }

    /// From now on the robot has this key. It must have none, or the session's.
    ///
    /// # Errors
    /// [`ClientError`]
    pub fn install_key(&mut self, key: &SigningKey) -> Result<(), ClientError> {
        const NAME: &str = "install a key";
        /// Sessions may end, and what is masked for one is of no use in another.
        const ATTEMPTS: u32 = 5;
        let public = key.public().0;
        let salt: [u8; SALT_BYTES] = keys::random()?;
        let mut attempt = 1;
        loop {
            self.open_session_for(&Request::RemoveKey, &mut Patience::new(self.clock.now()))?;
            let mut secret = key.secret(&salt);
            if let Some(open) = &self.signing.session {
                // Who listens does not learn it.
                secret = mask(secret, &open.session, &salt);
            }
            let signature = key.sign(&access::install(&public, &salt, &secret.0));
            let request = Request::InstallKey {
                key: &public,
                salt: &salt,
                secret: &secret.0,
                signature: &signature,
            };
            match self.change_key(NAME, request) {
                Err(error)
                    if attempt < ATTEMPTS && error.refusal() == Some(LinkError::NoSession) =>
                {
                    self.signing.end_session();
                    attempt += 1;
                }
                changed => return changed,
            }
        }
    }

    /// From now on the robot has no key.
    ///
    /// # Errors
    /// [`ClientError`]
    pub fn remove_key(&mut self) -> Result<(), ClientError> {
        self.change_key("remove the key", Request::RemoveKey)
    }

    /// Has the key changed, and asks what holds then: also where the flash is said not to have
    /// taken it.
    fn change_key(&mut self, name: &'static str, request: Request<'_>) -> Result<(), ClientError> {
        let changed = self.ask_to_do(name, request);
        let greeted = match &changed {
            Err(error) if error.refusal() != Some(LinkError::NotStored) => Ok(()),
            _ => {
                self.signing.end_session();
                self.hello().map(drop)
            }
        };
        changed.and(greeted)
    }

    /// Signs the blob that was uploaded.
    pub(super) fn sign_upload(&mut self, blob: &[u8]) -> Result<(), ClientError> {
        let (_, counter) = self.challenge()?;
        let counter = counter.checked_add(1).ok_or(ClientError::Refused {
            request: "sign",
            error: LinkError::OldCounter { last: counter },
        })?;
        let salt = self.salt()?;
        let key = self.signing.signer.key()?;
        let signature = key.sign(&access::upload(&salt, &counter.to_le_bytes(), blob));
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

    /// The salt of the robot's secret.
    fn salt(&self) -> Result<[u8; SALT_BYTES], ClientError> {
        let session = self.signing.session.as_ref();
        session
            .map(|open| open.salt)
            .ok_or(ClientError::Unproven { request: "sign" })
    }

    /// Has a request signed, with the signature of the upload that it is about or
    /// [`NO_UPLOAD`](access::NO_UPLOAD), and sends it until its answer is there.
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
        let (nonce, _) = self.challenge()?;
        let key = self.signing.signer.key()?;
        let signature = key.sign(&access::command(&nonce, &upload, bytes));
        let signed = Request::Signed {
            signature: &signature,
            request: bytes,
        };
        self.exchange(name, signed, longer, patience, read)
    }
}
