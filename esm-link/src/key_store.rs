//! Where a board keeps what belongs to the robot's key.

use crate::access::{KEY_BYTES, SALT_BYTES, SECRET_BYTES};
use crate::message::LinkError;

/// Bytes of [`StoredKey::Key`].
pub const STORED_KEY_BYTES: usize = KEY_BYTES + SALT_BYTES + SECRET_BYTES;

/// What is kept through resets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StoredKey {
    /// The public key, the salt and the secret: [`STORED_KEY_BYTES`]. None where there is no key.
    Key,
    /// The counter of the last upload that was accepted: 8 bytes, little endian.
    Counter,
    /// How often the robot has started and was asked for a nonce: 8 bytes, little endian.
    Starts,
}

/// A record could not be read or written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NotStored;

/// Why a record was not written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WriteError {
    /// The flash did not take it, or there is damage.
    NotStored,
    /// The flash was erased too often of late.
    Budget {
        /// Seconds until it may be tried again.
        s: u32,
    },
}

impl core::fmt::Display for NotStored {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str("the record cannot be read or written")
    }
}

impl core::error::Error for NotStored {}

impl core::fmt::Display for WriteError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            WriteError::NotStored => f.write_str("the flash did not take the record"),
            WriteError::Budget { s } => {
                write!(
                    f,
                    "the flash was erased too often of late: try again in {s} s"
                )
            }
        }
    }
}

impl core::error::Error for WriteError {}

impl From<NotStored> for WriteError {
    fn from(_: NotStored) -> Self {
        WriteError::NotStored
    }
}

/// Where a board keeps what belongs to its key.
pub trait KeyStore {
    /// Reads a record into the beginning of `room`. Answers its length; 0 where there is none, or
    /// an empty one.
    ///
    /// # Errors
    /// [`NotStored`]: there may be one, and it cannot be read, or has no room.
    fn read(&mut self, record: StoredKey, room: &mut [u8]) -> Result<usize, NotStored>;

    /// Replaces a record. When it returns, the new one outlasts a loss of power; cut before, the
    /// old one stays as it was.
    ///
    /// # Errors
    /// [`WriteError::NotStored`]: the old one may have stayed. [`WriteError::Budget`]: it has.
    fn write(&mut self, record: StoredKey, bytes: &[u8]) -> Result<(), WriteError>;

    /// Where the records cannot be read: reads the [key record](StoredKey::Key) that was written
    /// last into the beginning of `room`. Answers its length; 0 where it is certain that there was
    /// none.
    ///
    /// # Errors
    /// [`NotStored`]: it is not known, or has no room; or a board keeps no such thing.
    fn remembered_key(&mut self, room: &mut [u8]) -> Result<usize, NotStored> {
        let _ = room;
        Err(NotStored)
    }

    /// Where the records cannot be read: writes them anew, with this key record and an emergency
    /// stop that is latched, and with nothing else. When it returns, they can be read. To be called
    /// for who has proven to be the owner of the key that is
    /// [remembered](KeyStore::remembered_key). The counter of uploads starts anew.
    ///
    /// # Errors
    /// They are damaged as before; or new ones are there all the same, and can be read.
    fn renew(&mut self, key: &[u8]) -> Result<(), WriteError> {
        let _ = key;
        Err(WriteError::NotStored)
    }
}

/// A place that keeps nothing beyond a reset: for a board that is a part of a process, and for
/// tests.
#[derive(Clone, Debug, Default)]
pub struct Volatile {
    key: Option<[u8; STORED_KEY_BYTES]>,
    counter: Option<[u8; 8]>,
    starts: Option<[u8; 8]>,
}

impl Volatile {
    /// Reads a record, as [`KeyStore::read`] does.
    ///
    /// # Errors
    /// [`NotStored`]: it has no room.
    pub fn read(&self, record: StoredKey, room: &mut [u8]) -> Result<usize, NotStored> {
        let kept = match record {
            StoredKey::Key => self.key.as_ref().map(<[u8; _]>::as_slice),
            StoredKey::Counter => self.counter.as_ref().map(<[u8; _]>::as_slice),
            StoredKey::Starts => self.starts.as_ref().map(<[u8; _]>::as_slice),
        }
        .unwrap_or_default();
        let room = room.get_mut(..kept.len()).ok_or(NotStored)?;
        room.copy_from_slice(kept);
        Ok(kept.len())
    }

    /// Replaces a record, as [`KeyStore::write`] does.
    ///
    /// # Errors
    /// [`NotStored`]: it has another length than that kind has.
    pub fn write(&mut self, record: StoredKey, bytes: &[u8]) -> Result<(), NotStored> {
        fn kept<const N: usize>(bytes: &[u8]) -> Result<Option<[u8; N]>, NotStored> {
            if bytes.is_empty() {
                return Ok(None);
            }
            bytes.try_into().map(Some).map_err(|_| NotStored)
        }
        match record {
            StoredKey::Key => self.key = kept(bytes)?,
            StoredKey::Counter => self.counter = kept(bytes)?,
            StoredKey::Starts => self.starts = kept(bytes)?,
        }
        Ok(())
    }
}

impl From<WriteError> for LinkError {
    fn from(error: WriteError) -> Self {
        match error {
            WriteError::NotStored => LinkError::NotStored,
            WriteError::Budget { s } => LinkError::FlashBudget { s },
        }
    }
}

impl From<NotStored> for LinkError {
    fn from(_: NotStored) -> Self {
        LinkError::NotStored
    }
}
