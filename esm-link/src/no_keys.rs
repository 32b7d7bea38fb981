//! Takes the place of `keys` in a firmware that is built without: the robot has no key and says so.
#![expect(missing_docs, reason = "each item is as in `keys`")]

use crate::access::{Access, NONCE_BYTES, PROOF_BYTES, Recurrence};
use crate::key_store::KeyStore;
use crate::message::{Identity, LinkError};

/// There is none.
#[derive(Clone, Copy)]
pub enum SignedUpload {}

impl SignedUpload {
    pub fn is(&self, _: u64, _: &[u8]) -> bool {
        match *self {}
    }
}

/// There is none.
#[derive(Clone, Copy)]
pub enum Session {}

impl Session {
    pub fn of_answer(&self, _: u32, _: &[u8]) -> [u8; PROOF_BYTES] {
        match *self {}
    }
}

/// Nothing.
pub struct Keys;

impl Default for Keys {
    fn default() -> Self {
        Self::new()
    }
}

impl Keys {
    pub const fn new() -> Self {
        Keys
    }

    pub fn access(&mut self, _: Option<&mut dyn KeyStore>) -> Access {
        Access::Unsupported
    }

    pub fn identify(
        &mut self,
        _: &mut dyn KeyStore,
        _: u64,
        _: &[u8; NONCE_BYTES],
    ) -> Result<Identity, LinkError> {
        Err(LinkError::NoKeySupport)
    }

    pub fn open_session(
        &mut self,
        _: &mut dyn KeyStore,
        _: u64,
        _: &[u8; NONCE_BYTES],
        _: &[u8; NONCE_BYTES],
        _: &[u8; PROOF_BYTES],
    ) -> Result<(), LinkError> {
        Err(LinkError::NoKeySupport)
    }

    pub fn check_proven(
        &mut self,
        _: u32,
        _: &[u8; PROOF_BYTES],
        _: &[u8],
    ) -> Result<Recurrence, LinkError> {
        Err(LinkError::NoKeySupport)
    }

    pub fn session(&self) -> Option<Session> {
        None
    }

    pub fn challenge(
        &mut self,
        _: &mut dyn KeyStore,
        _: u64,
    ) -> Result<([u8; NONCE_BYTES], u64), LinkError> {
        Err(LinkError::NoKeySupport)
    }

    pub fn check_upload(
        &mut self,
        _: &mut dyn KeyStore,
        _: u64,
        _: u64,
        _: &[u8],
        _: &[u8],
    ) -> Result<SignedUpload, LinkError> {
        Err(LinkError::NoKeySupport)
    }

    pub fn check_command(
        &mut self,
        _: &mut dyn KeyStore,
        _: u64,
        _: &[u8],
        _: Option<&SignedUpload>,
        _: &[u8],
    ) -> Result<u64, LinkError> {
        Err(LinkError::NoKeySupport)
    }

    pub fn install(
        &mut self,
        _: &mut dyn KeyStore,
        _: u64,
        _: &[u8],
        _: &[u8],
        _: &[u8],
        _: &[u8],
    ) -> Result<(), LinkError> {
        Err(LinkError::NoKeySupport)
    }

    pub fn remove(&mut self, _: &mut dyn KeyStore) -> Result<(), LinkError> {
        Err(LinkError::NoKeySupport)
    }

    pub fn accept(&mut self, _: &mut dyn KeyStore, upload: &SignedUpload) -> Result<(), LinkError> {
        match *upload {}
    }
}
