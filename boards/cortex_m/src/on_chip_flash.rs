//! A part of a chip's own flash, in which missions are kept.

use core::marker::PhantomData;
use core::slice;

use embedded_storage::nor_flash::{
    ErrorType, NorFlash, NorFlashErrorKind, ReadNorFlash, check_erase, check_read, check_write,
};

/// What a chip does to the part of its flash that is the store's. Only the store calls it.
pub trait Cells: 'static {
    /// Address of the first byte, as it is read.
    const READ_AT: u32;
    /// How many there are.
    const BYTES: u32;
    /// What is erased at once.
    const ERASE_BYTES: usize;
    /// What is written at once.
    const WRITE_BYTES: usize;

    /// Erases what is erased at once, from there on.
    ///
    /// # Errors
    /// The flash did not take it.
    fn erase(offset: u32) -> Result<(), NorFlashErrorKind>;

    /// Writes a multiple of what is written at once, from there on.
    ///
    /// # Errors
    /// The flash did not take it.
    fn write(offset: u32, bytes: &[u8]) -> Result<(), NorFlashErrorKind>;
}

/// The part of the flash. The link alone has it.
#[derive(Debug)]
pub struct OnChip<C>(PhantomData<C>);

impl<C> OnChip<C> {
    /// The store's, which alone may have one.
    #[allow(clippy::new_without_default, reason = "there is one")]
    pub const fn new() -> Self {
        OnChip(PhantomData)
    }
}

impl<C> Clone for OnChip<C> {
    fn clone(&self) -> Self {
        Self::new()
    }
}

impl<C> ErrorType for OnChip<C> {
    type Error = NorFlashErrorKind;
}

impl<C: Cells> ReadNorFlash for OnChip<C> {
    const READ_SIZE: usize = 1;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), NorFlashErrorKind> {
        check_read(&*self, offset, bytes.len())?;
        let at = (C::READ_AT + offset) as *const u8;
        // SAFETY: bytes of the flash, which are always there, and which nobody changes meanwhile:
        // whoever could has `self`.
        bytes.copy_from_slice(unsafe { slice::from_raw_parts(at, bytes.len()) });
        Ok(())
    }

    fn capacity(&self) -> usize {
        C::BYTES as usize
    }
}

impl<C: Cells> NorFlash for OnChip<C> {
    const WRITE_SIZE: usize = C::WRITE_BYTES;
    const ERASE_SIZE: usize = C::ERASE_BYTES;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), NorFlashErrorKind> {
        check_erase(&*self, from, to)?;
        (from..to).step_by(C::ERASE_BYTES).try_for_each(C::erase)
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), NorFlashErrorKind> {
        check_write(&*self, offset, bytes.len())?;
        C::write(offset, bytes)
    }
}
