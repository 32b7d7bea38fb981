//! Where a mission's blob is kept while it arrives and while it runs.

use core::ops::Deref;

/// A buffer for one blob. There are two: one holds the mission that runs, the other takes the next.
pub struct BlobBuffer<'m> {
    storage: &'m mut [u8],
    len: usize,
}

impl<'m> BlobBuffer<'m> {
    /// An empty buffer.
    pub fn new(storage: &'m mut [u8]) -> Self {
        BlobBuffer { storage, len: 0 }
    }

    /// Greatest number of bytes that fit.
    pub fn capacity(&self) -> usize {
        self.storage.len()
    }

    /// Forgets all bytes.
    pub fn clear(&mut self) {
        self.len = 0;
    }

    /// Replaces all bytes by those that `fill` puts at the beginning of the room. It says how many.
    pub fn fill(&mut self, fill: impl FnOnce(&mut [u8]) -> usize) {
        self.len = 0;
        self.len = fill(self.storage).min(self.storage.len());
    }

    /// Appends bytes. Returns false, and changes nothing, if they do not fit.
    pub fn push(&mut self, bytes: &[u8]) -> bool {
        let place = self
            .len
            .checked_add(bytes.len())
            .and_then(|end| self.storage.get_mut(self.len..end));
        let Some(place) = place else { return false };
        place.copy_from_slice(bytes);
        self.len += bytes.len();
        true
    }
}

impl Deref for BlobBuffer<'_> {
    type Target = [u8];

    fn deref(&self) -> &[u8] {
        self.storage.get(..self.len).unwrap_or_default()
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
}
