//! What a session knows of the robot's key, and who signs.

use std::sync::Arc;

use esm_link::access::{Access, NO_UPLOAD, Needs, SIGNATURE_BYTES, needs};
use esm_link::message::Request;

use super::error::ClientError;
use super::session::OwnerSession;
use crate::keys::{KeyError, PublicKey, SigningKey};

/// Gives the key when a robot asks for it for the first time.
pub type KeyLoader = Box<dyn FnMut() -> Result<SigningKey, KeyError> + Send>;

/// What a session knows of the robot's key.
pub(super) struct Signing {
    /// Whether the robot has one, as it says.
    pub(super) access: Access,
    pub(super) signer: Signer,
    /// A robot without this session's key is another one.
    pub(super) insists: bool,
    /// Of the last upload that was signed.
    pub(super) upload: [u8; SIGNATURE_BYTES],
    /// The owner's session, once it is open.
    pub(super) session: Option<OwnerSession>,
    /// There is none to be had: this client only reads.
    pub(super) only_reads: bool,
}

impl Default for Signing {
    fn default() -> Self {
        Signing {
            access: Access::default(),
            signer: Signer::Nobody,
            insists: false,
            upload: NO_UPLOAD,
            session: None,
            only_reads: false,
        }
    }
}

impl Signing {
    /// Whether the robot takes a request signed only.
    pub(super) fn is_for(&self, request: &Request<'_>) -> bool {
        self.has_owner() && needs(request) == Needs::Key
    }

    /// Whether the robot has an owner: in a session it has shown that it does, whatever is said
    /// outside.
    pub(super) fn has_owner(&self) -> bool {
        self.session.is_some() || matches!(self.access, Access::Locked | Access::Recovering)
    }

    /// What the robot says of its access, outside of a session, where anybody may answer in its
    /// place.
    pub(super) fn told(&mut self, access: Access) {
        self.access = access;
        self.only_reads = false;
    }

    /// The session has ended.
    pub(super) fn end_session(&mut self) {
        self.session = None;
        self.upload = NO_UPLOAD;
    }
}

/// The key of a session.
pub(super) enum Signer {
    /// There is none.
    Nobody,
    /// It has not been asked for.
    Unread(KeyLoader),
    Key(Arc<SigningKey>),
}

impl Signer {
    /// The key, which is read when it is asked for the first time.
    pub(super) fn key(&mut self) -> Result<Arc<SigningKey>, ClientError> {
        if let Signer::Unread(load) = self {
            *self = Signer::Key(Arc::new(load()?));
        }
        match self {
            Signer::Key(key) => Ok(Arc::clone(key)),
            Signer::Nobody | Signer::Unread(_) => Err(ClientError::NoKey),
        }
    }
}

/// Who a robot says that it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RobotIdentity {
    /// The robot's key.
    pub key: PublicKey,
    /// Counter of the last upload that the robot accepted.
    pub counter: u64,
}
