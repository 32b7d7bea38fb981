//! What requests have to do with the robot's key: signatures of requests and uploads, and the key
//! itself.

use super::handler::{RequestHandler, Upload};
use super::port::LinkPort;
use esm_link::access::{Needs, needs};
use esm_link::key_store::KeyStore;
use esm_link::keys::SignedUpload;
use esm_link::message::{LinkError, Request, Response};

impl RequestHandler<'_, '_> {
    /// Whether the key has signed this request, which `bytes` are. Answers until when that is good.
    pub(super) fn check_signed(
        &mut self,
        request: &Request<'_>,
        signature: &[u8],
        bytes: &[u8],
        port: &mut impl LinkPort,
    ) -> Result<u64, LinkError> {
        let now_us = port.now_us();
        let safe = port.key_store().ok_or(LinkError::NoKeySupport)?;
        if needs(request) != Needs::Key {
            return Err(LinkError::Malformed);
        }
        // So that a nonce is not spent on what cannot be done now.
        if self.command.is_none() {
            return Err(LinkError::Busy);
        }
        let upload = match (request, &self.upload) {
            (
                Request::Commit(_),
                Some(Upload {
                    signed: Some(signed),
                    ..
                }),
            ) => Some(signed),
            _ => None,
        };
        self.keys
            .check_command(safe, now_us, signature, upload, bytes)
    }

    /// Answers what is about keys alone.
    #[inline(never)]
    pub(super) fn of_keys(
        &mut self,
        request: &Request<'_>,
        safe: &mut dyn KeyStore,
        now_us: u64,
    ) -> Result<Response<'_>, LinkError> {
        match *request {
            Request::Identify { ref nonce } => {
                Ok(Response::Identity(self.keys.identify(safe, now_us, nonce)?))
            }
            Request::Challenge => {
                let (nonce, counter) = self.keys.challenge(safe, now_us)?;
                Ok(Response::Challenge { nonce, counter })
            }
            Request::Sign { counter, signature } => {
                let upload = self.upload.as_mut().ok_or(LinkError::NoUpload)?;
                if upload.received() != upload.len {
                    return Err(LinkError::Incomplete {
                        received: upload.received(),
                    });
                }
                // Whoever listens could send it again and again, and verifying takes time.
                if (upload.signed.as_ref()).is_some_and(|signed| signed.is(counter, signature)) {
                    return Ok(Response::Done);
                }
                let checked =
                    self.keys
                        .check_upload(safe, now_us, counter, signature, &upload.blob);
                let is_unsigned = upload.signed.is_none();
                match checked {
                    Ok(signed) => upload.signed = Some(signed),
                    // The bytes may be somebody else's, under the owner's length and checksum: who
                    // went on with them would be refused for ever.
                    Err(LinkError::WrongSignature) if is_unsigned && !mutant!(OthersBytesKept) => {
                        self.end_upload();
                    }
                    Err(_) => {}
                }
                checked.map(|_| Response::Done)
            }
            Request::InstallKey {
                key,
                salt,
                secret,
                signature,
            } => {
                let installed = self
                    .keys
                    .install(safe, now_us, key, salt, secret, signature);
                // What another key has signed is not signed. It may be there although the flash
                // said no.
                if let Some(upload) = &mut self.upload {
                    upload.signed = None;
                }
                installed.map(|()| Response::Done)
            }
            Request::RemoveKey => {
                self.keys.remove(safe)?;
                Ok(Response::Done)
            }
            _ => Err(LinkError::Malformed),
        }
    }

    /// Keeps the counter of a signed upload, before its mission runs: what follows is newer,
    /// whatever happens.
    pub(super) fn accept(
        &mut self,
        signed: Option<&SignedUpload>,
        port: &mut impl LinkPort,
    ) -> Result<(), LinkError> {
        match (signed, port.key_store()) {
            (Some(signed), Some(safe)) => self.keys.accept(safe, signed),
            _ => Ok(()),
        }
    }
}
