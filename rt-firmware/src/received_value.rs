//! Places for the values that come over links.

use core::cell::UnsafeCell;

/// The largest value that can be received, with what is kept beside it.
pub(crate) const VALUE_BYTES: usize = 256;

const WORDS: usize = VALUE_BYTES / size_of::<u64>();

/// The place of a value of any type, zeros before anything was received. [`crate::ports`] alone
/// looks into it.
#[repr(transparent)]
pub(crate) struct ReceivedValue(pub(crate) UnsafeCell<[u64; WORDS]>);

impl ReceivedValue {
    #[expect(
        clippy::declare_interior_mutable_const,
        reason = "it is what the memory is made of, not a value to share"
    )]
    pub(crate) const EMPTY: Self = ReceivedValue(UnsafeCell::new([0; WORDS]));
}
