//! Takes the place of `keys` in a firmware that is built without: the robot has no key and says so.

use super::access::{Access, NONCE_BYTES, PROOF_BYTES, Recurrence};
use super::key_safe::KeySafe;
use super::message::{Identity, LinkError};

/// There is none.
#[derive(Clone, Copy)]
pub(crate) enum SignedUpload {}

impl SignedUpload {
    pub(crate) fn is(&self, _: u64, _: &[u8]) -> bool {
        match *self {}
    }
}

/// There is none.
#[derive(Clone, Copy)]
pub(crate) enum Session {}

impl Session {
    pub(crate) fn of_answer(&self, _: u32, _: &[u8]) -> [u8; PROOF_BYTES] {
        match *self {}
    }
}

/// Nothing.
pub(crate) struct Keys;

impl Keys {
    pub(crate) const fn new() -> Self {
        Keys
    }

    pub(crate) fn access(&mut self, _: Option<&mut dyn KeySafe>) -> Access {
        Access::Unsupported
    }

    pub(crate) fn identify(
        &mut self,
        _: &mut dyn KeySafe,
        _: u64,
        _: &[u8; NONCE_BYTES],
    ) -> Result<Identity, LinkError> {
        Err(LinkError::NoKeySupport)
    }

    pub(crate) fn open_session(
        &mut self,
        _: &mut dyn KeySafe,
        _: u64,
        _: &[u8; NONCE_BYTES],
        _: &[u8; NONCE_BYTES],
        _: &[u8; PROOF_BYTES],
    ) -> Result<(), LinkError> {
        Err(LinkError::NoKeySupport)
    }

    pub(crate) fn check_proven(
        &mut self,
        _: u32,
        _: &[u8; PROOF_BYTES],
        _: &[u8],
    ) -> Result<Recurrence, LinkError> {
        Err(LinkError::NoKeySupport)
    }

    pub(crate) fn session(&self) -> Option<Session> {
        None
    }

    pub(crate) fn challenge(
        &mut self,
        _: &mut dyn KeySafe,
        _: u64,
    ) -> Result<([u8; NONCE_BYTES], u64), LinkError> {
        Err(LinkError::NoKeySupport)
    }

    pub(crate) fn check_upload(
        &mut self,
        _: &mut dyn KeySafe,
        _: u64,
        _: u64,
        _: &[u8],
        _: &[u8],
    ) -> Result<SignedUpload, LinkError> {
        Err(LinkError::NoKeySupport)
    }

    pub(crate) fn check_command(
        &mut self,
        _: &mut dyn KeySafe,
        _: u64,
        _: &[u8],
        _: Option<&SignedUpload>,
        _: &[u8],
    ) -> Result<u64, LinkError> {
        Err(LinkError::NoKeySupport)
    }

    pub(crate) fn install(
        &mut self,
        _: &mut dyn KeySafe,
        _: u64,
        _: &[u8],
        _: &[u8],
        _: &[u8],
        _: &[u8],
    ) -> Result<(), LinkError> {
        Err(LinkError::NoKeySupport)
    }

    pub(crate) fn remove(&mut self, _: &mut dyn KeySafe) -> Result<(), LinkError> {
        Err(LinkError::NoKeySupport)
    }

    pub(crate) fn accept(
        &mut self,
        _: &mut dyn KeySafe,
        upload: &SignedUpload,
    ) -> Result<(), LinkError> {
        match *upload {}
    }
}
