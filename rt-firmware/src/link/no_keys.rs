//! Takes the place of `keys` in a firmware that is built without: the robot has no key and says so.

use super::access::{Access, KEY_BYTES, NONCE_BYTES};
use super::key_safe::KeySafe;
use super::message::LinkError;

/// There is none.
#[derive(Clone, Copy)]
pub(crate) enum SignedUpload {}

impl SignedUpload {
    pub(crate) fn is(&self, _: u64, _: &[u8]) -> bool {
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

    pub(crate) fn challenge(
        &mut self,
        _: &mut dyn KeySafe,
    ) -> Result<([u8; NONCE_BYTES], u64, [u8; KEY_BYTES]), LinkError> {
        Err(LinkError::NoKeySupport)
    }

    pub(crate) fn check_upload(
        &mut self,
        _: &mut dyn KeySafe,
        _: u64,
        _: &[u8],
        _: &[u8],
    ) -> Result<SignedUpload, LinkError> {
        Err(LinkError::NoKeySupport)
    }

    pub(crate) fn check_command(
        &mut self,
        _: &mut dyn KeySafe,
        _: &[u8],
        _: Option<&SignedUpload>,
        _: &[u8],
    ) -> Result<(), LinkError> {
        Err(LinkError::NoKeySupport)
    }

    pub(crate) fn install(
        &mut self,
        _: &mut dyn KeySafe,
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
