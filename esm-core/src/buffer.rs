//! Where a mission's blob is kept while it arrives and while it runs.

use core::ops::Deref;

use crate::reads::{Reader, Storage, stable::Sealed};

/// A buffer for one blob. There are two: one holds the mission that runs, the other takes the next.
///
/// The bytes can be [lent](Self::lend): then there is somebody else who reads them, and they do not
/// change until the reader is [back](Self::take_back).
pub struct BlobBuffer<'m> {
    storage: Storage<'m>,
    len: usize,
}

/// Reads the blob in a [`BlobBuffer`] that is elsewhere.
pub struct BlobReader<'m> {
    reader: Reader<'m>,
    len: usize,
}

// Its bytes are elsewhere, and change only through `&mut`.
impl Sealed for BlobBuffer<'_> {}

impl<'m> BlobBuffer<'m> {
    /// An empty buffer.
    pub fn new(storage: &'m mut [u8]) -> Self {
        BlobBuffer {
            storage: Storage::new(storage),
            len: 0,
        }
    }

    /// Greatest number of bytes that fit.
    pub fn capacity(&self) -> usize {
        self.storage.bytes().len()
    }

    /// Somebody else who reads the blob. None if there is one already, or if it was built without
    /// the feature `unchecked`.
    pub fn lend(&mut self) -> Option<BlobReader<'m>> {
        let len = self.len;
        (self.storage.lend()).map(|reader| BlobReader { reader, len })
    }

    /// Takes the reader of this buffer back; after that its bytes can change.
    ///
    /// # Errors
    /// It reads another buffer.
    pub fn take_back(&mut self, reader: BlobReader<'m>) -> Result<(), BlobReader<'m>> {
        let len = reader.len;
        (self.storage.take_back(reader.reader)).map_err(|reader| BlobReader { reader, len })
    }

    /// Forgets all bytes.
    pub fn clear(&mut self) {
        self.len = 0;
    }

    /// Replaces all bytes by those that `fill` puts at the beginning of the room. It says how many.
    /// While somebody reads them there is no room.
    pub fn fill(&mut self, fill: impl FnOnce(&mut [u8]) -> usize) {
        self.len = 0;
        let room = self.storage.bytes_mut();
        self.len = fill(room).min(room.len());
    }

    /// Appends bytes. Returns false, and changes nothing, if they do not fit, or somebody reads the
    /// buffer.
    pub fn push(&mut self, bytes: &[u8]) -> bool {
        let place = self
            .len
            .checked_add(bytes.len())
            .and_then(|end| self.storage.bytes_mut().get_mut(self.len..end));
        let Some(place) = place else { return false };
        place.copy_from_slice(bytes);
        self.len += bytes.len();
        true
    }
}

impl Deref for BlobBuffer<'_> {
    type Target = [u8];

    #[cfg_attr(feature = "speed", inline(always))]
    fn deref(&self) -> &[u8] {
        self.storage.bytes().get(..self.len).unwrap_or_default()
    }
}

impl Deref for BlobReader<'_> {
    type Target = [u8];

    fn deref(&self) -> &[u8] {
        self.reader.bytes().get(..self.len).unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_are_appended_as_long_as_they_fit() {
        let mut storage = [0; 5];
        let mut blob = BlobBuffer::new(&mut storage);
        assert!(blob.push(&[1, 2, 3]));
        assert!(!blob.push(&[4, 5, 6]));
        assert_eq!(*blob, [1, 2, 3]);
        assert!(blob.push(&[4, 5]));
        assert_eq!(*blob, [1, 2, 3, 4, 5]);
        assert!(!blob.push(&[6]));
        blob.clear();
        assert!(blob.is_empty());
        assert_eq!(blob.capacity(), 5);
    }

    #[cfg(feature = "unchecked")]
    #[test]
    fn bytes_that_are_lent_do_not_change() {
        let (mut first, mut second) = ([0; 4], [0; 4]);
        let (mut blob, mut other) = (BlobBuffer::new(&mut first), BlobBuffer::new(&mut second));
        assert!(blob.push(&[1, 2]) && other.push(&[3]));
        let reader = blob.lend().unwrap();
        assert!(blob.lend().is_none(), "there is one reader");
        assert!(!blob.push(&[4]));
        blob.fill(|room| {
            room.fill(9);
            room.len()
        });
        blob.clear();
        assert_eq!(*reader, [1, 2]);
        assert!(other.lend().is_some());
        let Err(reader) = other.take_back(reader) else {
            panic!("it reads another buffer");
        };
        assert!(!other.push(&[4]), "its own is out");
        assert!(blob.take_back(reader).is_ok());
        assert!(blob.push(&[7]));
        assert_eq!(*blob, [7]);
    }
}
