//! How the interpreter reads a verified blob and its arena: checked or unchecked.
//!
//! Both versions give the same for every place inside. Outside, [`Checked`] reads 0 and writes
//! nothing, and [`Unchecked`] must not be asked. So each caller relies on an invariant, of which
//! there are three:
//!
//! 1. *The blob is the one that was verified.* Bytes behind a [`StableBytes`] stay where they are
//!    and do not change, and a [`Verified`](crate::Verified) is made by the verifier alone. Then
//!    sections are where its layout says, and each index, offset and span in a record points into
//!    its table.
//! 2. *What the arena holds are indices out of the blob.* The interpreter is its only writer: a
//!    current state is an initial state or the target of a transition of that region, and an event
//!    in the queue is the channel of an action.
//! 3. *The arena is as long as the blob asks for*, which is compared when the interpreter is made.
//!    An index that comes from outside is compared before it is used.
//!
//! Besides, two can read one blob: who lends the bytes of a [`BlobBuffer`](crate::BlobBuffer)
//! cannot change them until the reader is back.
//!
//! This is the only file of the crate with `unsafe`, and without the feature `unchecked`, which is
//! a default, it has none. Tests run every input through both versions.

use core::ops::Deref;

const WORD_BITS: usize = u32::BITS as usize;

/// Reads that are never outside: what they rely on is checked each time.
#[derive(Clone, Copy, Debug, Default)]
pub struct Checked;

/// Reads that rely on what was proved of the blob once.
#[cfg(feature = "unchecked")]
#[derive(Clone, Copy, Debug, Default)]
pub struct Unchecked;

/// The reads of an interpreter for which none are named.
#[cfg(feature = "unchecked")]
pub type DefaultReads = Unchecked;
/// The reads of an interpreter for which none are named.
#[cfg(not(feature = "unchecked"))]
pub type DefaultReads = Checked;

/// A way to read blobs that are kept in a `B`: [`Checked`] for all, [`Unchecked`] where they are
/// [`StableBytes`].
pub trait Reads<B: ?Sized>: access::Access {}

impl<B: Deref<Target = [u8]>> Reads<B> for Checked {}

/// Bytes that stay the same, wherever their owner is moved to: slices,
/// [`BlobBuffer`](crate::BlobBuffer), and on hosts `Vec`, `Box`, `Rc` and `Arc`. Others can be read
/// by [`Checked`].
pub trait StableBytes: Deref<Target = [u8]> + stable::Sealed {}

impl<B: Deref<Target = [u8]> + stable::Sealed> StableBytes for B {}

#[cfg(feature = "unchecked")]
impl<B: StableBytes> Reads<B> for Unchecked {}

pub(crate) mod stable {
    /// What gives the same bytes whenever it is dereferenced, as do its clones.
    pub trait Sealed {}

    impl Sealed for &[u8] {}
    impl Sealed for &mut [u8] {}

    #[cfg(not(target_os = "none"))]
    mod on_hosts {
        extern crate std;

        impl super::Sealed for std::vec::Vec<u8> {}
        impl super::Sealed for std::boxed::Box<[u8]> {}
        impl super::Sealed for std::rc::Rc<[u8]> {}
        impl super::Sealed for std::sync::Arc<[u8]> {}
    }
}

pub(crate) mod access {
    /// The reads and writes. Indices are words, halves or bits of a part of the arena, halves and
    /// bits low ones first.
    pub trait Access {
        /// The bytes of a blob, borrowed.
        type Blob<'b>: Copy;
        /// A byte of the blob. It was made from the same bytes that it is read with, whose owner
        /// may have been moved since.
        type Place: Copy + PartialEq + core::fmt::Debug;
        /// A part of the arena, from some word on. It was made from the same arena that it is read
        /// with.
        type Part: Copy + core::fmt::Debug;

        /// Borrows the bytes of a blob.
        fn blob(bytes: &[u8]) -> Self::Blob<'_>;
        /// The place of a byte.
        fn place(bytes: &[u8], at: usize) -> Self::Place;
        /// The place `count` bytes ahead.
        fn ahead(place: Self::Place, count: usize) -> Self::Place;
        /// Bytes from one place to another that is not before it.
        fn distance(from: Self::Place, to: Self::Place) -> usize;

        /// A number of the blob that the verifier found to be below 32.
        fn below_32(number: usize) -> u32;
        /// 16 bits of the blob.
        fn half(blob: Self::Blob<'_>, at: Self::Place) -> u16;
        /// 32 bits of the blob.
        fn word(blob: Self::Blob<'_>, at: Self::Place) -> u32;

        /// The part that begins with a word.
        fn part(arena: &mut [u32], word: usize) -> Self::Part;
        /// The part that begins so many words further on.
        fn further(part: Self::Part, words: usize) -> Self::Part;
        /// A word of the arena.
        fn load(arena: &[u32], part: Self::Part, index: usize) -> u32;
        /// Writes a word of the arena.
        fn store(arena: &mut [u32], part: Self::Part, index: usize, value: u32);
        /// Half a word of the arena.
        fn load_half(arena: &[u32], part: Self::Part, index: usize) -> u16;
        /// Writes half a word of the arena.
        fn store_half(arena: &mut [u32], part: Self::Part, index: usize, value: u16);
        /// At least 25 bits of the arena, from bit `at` on; the bits above mean nothing. The word
        /// behind is in the arena, too.
        fn window(arena: &[u32], part: Self::Part, at: usize) -> u32;
        /// Clears `count` bits of the arena, at most 25, from bit `at` on.
        fn clear_window(arena: &mut [u32], part: Self::Part, at: usize, count: u32);
        /// Writes the bits of the arena that are set in `written`, all among its lowest 25, from
        /// bit `at` on, as they are in `values`. Returns whether one changed.
        fn write_window(
            arena: &mut [u32],
            part: Self::Part,
            at: usize,
            written: u32,
            values: u32,
        ) -> bool;
    }
}

/// Bits that a window has at least: it begins at a byte.
pub(crate) const WINDOW_BITS: u32 = u32::BITS - 7;

impl access::Access for Checked {
    type Blob<'b> = &'b [u8];
    type Place = usize;
    type Part = usize;

    #[inline(always)]
    fn blob(bytes: &[u8]) -> &[u8] {
        bytes
    }

    #[inline(always)]
    fn place(_: &[u8], at: usize) -> usize {
        at
    }

    #[inline(always)]
    fn ahead(place: usize, count: usize) -> usize {
        place + count
    }

    #[inline(always)]
    fn distance(from: usize, to: usize) -> usize {
        to - from
    }

    #[inline(always)]
    fn below_32(number: usize) -> u32 {
        number as u32 % u32::BITS
    }

    #[inline(always)]
    fn half(bytes: &[u8], at: usize) -> u16 {
        let found = bytes.get(at..).and_then(<[u8]>::first_chunk);
        found.map_or(0, |half| u16::from_le_bytes(*half))
    }

    #[inline(always)]
    fn word(bytes: &[u8], at: usize) -> u32 {
        let found = bytes.get(at..).and_then(<[u8]>::first_chunk);
        found.map_or(0, |word| u32::from_le_bytes(*word))
    }

    #[inline(always)]
    fn part(_: &mut [u32], word: usize) -> usize {
        word
    }

    #[inline(always)]
    fn further(part: usize, words: usize) -> usize {
        part + words
    }

    #[inline(always)]
    fn load(arena: &[u32], part: usize, index: usize) -> u32 {
        arena.get(part + index).copied().unwrap_or(0)
    }

    #[inline(always)]
    fn store(arena: &mut [u32], part: usize, index: usize, value: u32) {
        if let Some(word) = arena.get_mut(part + index) {
            *word = value;
        }
    }

    #[inline(always)]
    fn load_half(arena: &[u32], part: usize, index: usize) -> u16 {
        (Self::load(arena, part, index / 2) >> (index % 2 * 16)) as u16
    }

    #[inline(always)]
    fn store_half(arena: &mut [u32], part: usize, index: usize, value: u16) {
        if let Some(word) = arena.get_mut(part + index / 2) {
            let shift = index % 2 * 16;
            *word = *word & !(0xFFFF << shift) | u32::from(value) << shift;
        }
    }

    #[inline(always)]
    fn window(arena: &[u32], part: usize, at: usize) -> u32 {
        let index = at / WORD_BITS;
        let low = u64::from(Self::load(arena, part, index));
        let high = u64::from(Self::load(arena, part, index + 1));
        ((high << WORD_BITS | low) >> (at % WORD_BITS)) as u32
    }

    #[inline(always)]
    fn clear_window(arena: &mut [u32], part: usize, at: usize, count: u32) {
        let index = part + at / WORD_BITS;
        let mask = ((1u64 << count) - 1) << (at % WORD_BITS);
        if let Some(word) = arena.get_mut(index) {
            *word &= !(mask as u32);
        }
        if let Some(word) = arena.get_mut(index + 1) {
            *word &= !((mask >> WORD_BITS) as u32);
        }
    }

    #[inline(always)]
    fn write_window(arena: &mut [u32], part: usize, at: usize, written: u32, values: u32) -> bool {
        let before = Self::window(arena, part, at);
        let index = part + at / WORD_BITS;
        let changed = u64::from((before ^ values) & written) << (at % WORD_BITS);
        if let Some(word) = arena.get_mut(index) {
            *word ^= changed as u32;
        }
        if let Some(word) = arena.get_mut(index + 1) {
            *word ^= (changed >> WORD_BITS) as u32;
        }
        changed != 0
    }
}

#[cfg(feature = "unchecked")]
#[allow(
    unsafe_code,
    reason = "each relies on an invariant of this module's; it is named there"
)]
mod unchecked {
    use core::marker::PhantomData;

    use super::{Unchecked, WINDOW_BITS, access::Access};

    /// A byte of a blob.
    #[derive(Clone, Copy, Debug, PartialEq)]
    pub struct Byte(*const u8);

    // SAFETY: what it points to is only read, and stays where it is: invariant 1.
    unsafe impl Send for Byte {}
    // SAFETY: as above.
    unsafe impl Sync for Byte {}

    /// A word of an arena. It is no more than an address: whoever reads or writes there must bring
    /// the arena, too.
    #[derive(Clone, Copy, Debug)]
    pub struct Word(usize);

    /// The bytes of a blob, borrowed for `'b`. Which they are is looked at with debug assertions
    /// only.
    #[derive(Clone, Copy)]
    pub struct Lent<'b> {
        #[cfg(debug_assertions)]
        bytes: &'b [u8],
        borrowed: PhantomData<&'b [u8]>,
    }

    /// `T` at a byte of the blob, which need not lie as a `T` of its own would.
    #[inline(always)]
    #[cfg_attr(not(debug_assertions), expect(unused_variables, reason = "see `Lent`"))]
    fn in_blob<T: Copy>(lent: Lent<'_>, Byte(at): Byte) -> T {
        #[cfg(debug_assertions)]
        {
            let from = at.addr().wrapping_sub(lent.bytes.as_ptr().addr());
            assert!(
                from + size_of::<T>() <= lent.bytes.len(),
                "invariant 1: {from}"
            );
        }
        let at = core::ptr::with_exposed_provenance::<T>(at.addr());
        // SAFETY: invariant 1: a record that the verified tables speak of is inside. The bytes are
        // borrowed as long as `lent` lives, and were exposed when it was made. `T` is a number,
        // which any bytes are.
        unsafe { at.read_unaligned() }
    }

    /// The place of `T` so many bytes behind a word of the arena.
    #[inline(always)]
    fn in_arena<T>(arena: &[u32], Word(part): Word, bytes: usize) -> *const T {
        // The arena may have been moved with its owner since the word was made, so it is used as it
        // is borrowed now. It costs nothing: the address is the same.
        let from = part.wrapping_sub(arena.as_ptr().expose_provenance());
        debug_assert!(
            from + bytes + size_of::<T>() <= size_of_val(arena),
            "invariants 2 and 3: {from} + {bytes}"
        );
        core::ptr::with_exposed_provenance(part + bytes)
    }

    /// The same to write to.
    #[inline(always)]
    fn in_arena_mut<T>(arena: &mut [u32], Word(part): Word, bytes: usize) -> *mut T {
        let from = part.wrapping_sub(arena.as_mut_ptr().expose_provenance());
        debug_assert!(
            from + bytes + size_of::<T>() <= size_of_val(arena),
            "invariants 2 and 3: {from} + {bytes}"
        );
        core::ptr::with_exposed_provenance_mut(part + bytes)
    }

    impl Access for Unchecked {
        type Blob<'b> = Lent<'b>;
        type Place = Byte;
        type Part = Word;

        #[inline(always)]
        fn blob(bytes: &[u8]) -> Lent<'_> {
            // Their owner may have been moved since places were made, and one that alone may use
            // them, as a `&mut` does, then ends what was borrowed from it before. So it is from the
            // bytes as they are borrowed now that they are read. It costs nothing: the address is
            // the same.
            bytes.as_ptr().expose_provenance();
            Lent {
                #[cfg(debug_assertions)]
                bytes,
                borrowed: PhantomData,
            }
        }

        #[inline(always)]
        fn place(bytes: &[u8], at: usize) -> Byte {
            Byte(bytes.as_ptr().wrapping_add(at))
        }

        #[inline(always)]
        fn ahead(Byte(place): Byte, count: usize) -> Byte {
            Byte(place.wrapping_add(count))
        }

        #[inline(always)]
        fn distance(Byte(from): Byte, Byte(to): Byte) -> usize {
            to.addr().wrapping_sub(from.addr())
        }

        #[inline(always)]
        fn below_32(number: usize) -> u32 {
            // SAFETY: invariant 1. With debug assertions it is looked at.
            unsafe { core::hint::assert_unchecked(number < 32) };
            number as u32
        }

        #[inline(always)]
        fn half(blob: Lent<'_>, at: Byte) -> u16 {
            u16::from_le(in_blob(blob, at))
        }

        #[inline(always)]
        fn word(blob: Lent<'_>, at: Byte) -> u32 {
            u32::from_le(in_blob(blob, at))
        }

        #[inline(always)]
        fn part(arena: &mut [u32], word: usize) -> Word {
            Word(arena.as_mut_ptr().wrapping_add(word).addr())
        }

        #[inline(always)]
        fn further(Word(part): Word, words: usize) -> Word {
            Word(part + 4 * words)
        }

        #[inline(always)]
        fn load(arena: &[u32], part: Word, index: usize) -> u32 {
            // SAFETY: invariants 2 and 3: what the blob speaks of has its place in the arena, and
            // so has what the arena itself speaks of. It is a whole word.
            unsafe { in_arena::<u32>(arena, part, 4 * index).read() }
        }

        #[inline(always)]
        fn store(arena: &mut [u32], part: Word, index: usize, value: u32) {
            // SAFETY: as above.
            unsafe { in_arena_mut::<u32>(arena, part, 4 * index).write(value) }
        }

        #[inline(always)]
        fn load_half(arena: &[u32], part: Word, index: usize) -> u16 {
            // SAFETY: as above, and a whole half.
            u16::from_le(unsafe { in_arena::<u16>(arena, part, 2 * index).read() })
        }

        #[inline(always)]
        fn store_half(arena: &mut [u32], part: Word, index: usize, value: u16) {
            // SAFETY: as above.
            unsafe { in_arena_mut::<u16>(arena, part, 2 * index).write(value.to_le()) }
        }

        #[inline(always)]
        fn window(arena: &[u32], part: Word, at: usize) -> u32 {
            // SAFETY: as above; any four bytes are a number.
            let word = unsafe { in_arena::<u32>(arena, part, at / 8).read_unaligned() };
            word >> (at % 8)
        }

        #[inline(always)]
        fn clear_window(arena: &mut [u32], part: Word, at: usize, count: u32) {
            debug_assert!(count <= WINDOW_BITS);
            let place = in_arena_mut::<u32>(arena, part, at / 8);
            let mask = ((1u32 << count) - 1) << (at % 8);
            // SAFETY: as above.
            unsafe { place.write_unaligned(place.read_unaligned() & !mask) }
        }

        #[inline(always)]
        fn write_window(
            arena: &mut [u32],
            part: Word,
            at: usize,
            written: u32,
            values: u32,
        ) -> bool {
            debug_assert!(written >> WINDOW_BITS == 0);
            let place = in_arena_mut::<u32>(arena, part, at / 8);
            let shift = at % 8;
            // SAFETY: as above.
            let before = unsafe { place.read_unaligned() };
            let changed = (before ^ values << shift) & written << shift;
            // SAFETY: as above.
            unsafe { place.write_unaligned(before ^ changed) }
            changed != 0
        }
    }
}

pub(crate) use storage::{Reader, Storage};

/// Memory that one may write, or else two may read.
#[cfg(feature = "unchecked")]
#[allow(
    unsafe_code,
    reason = "the bytes are written by their owner alone, and only while no reader is out"
)]
mod storage {
    use core::marker::PhantomData;
    use core::ptr::NonNull;

    /// Bytes, and whether a reader of them is out.
    pub(crate) struct Storage<'m> {
        /// From a `&'m mut [u8]` that nobody uses otherwise. A reader has a copy of it.
        bytes: NonNull<[u8]>,
        is_lent: bool,
        owned: PhantomData<&'m mut [u8]>,
    }

    /// Reads the bytes of a storage. There is one at most.
    pub(crate) struct Reader<'m> {
        bytes: NonNull<[u8]>,
        borrowed: PhantomData<&'m [u8]>,
    }

    // SAFETY: it is what a `&mut [u8]` is, or as long as a reader is out a `&[u8]`.
    unsafe impl Send for Storage<'_> {}
    // SAFETY: through a shared one bytes are only read.
    unsafe impl Sync for Storage<'_> {}
    // SAFETY: it is what a `&[u8]` is.
    unsafe impl Send for Reader<'_> {}
    // SAFETY: as above.
    unsafe impl Sync for Reader<'_> {}

    impl<'m> Storage<'m> {
        pub(crate) fn new(bytes: &'m mut [u8]) -> Self {
            Storage {
                bytes: NonNull::from(bytes),
                is_lent: false,
                owned: PhantomData,
            }
        }

        #[inline(always)]
        pub(crate) fn bytes(&self) -> &[u8] {
            // SAFETY: they are borrowed for `'m`, and written by `bytes_mut` alone, whose borrow of
            // all of this excludes the one here.
            unsafe { self.bytes.as_ref() }
        }

        /// The bytes, to be written. None while a reader is out.
        pub(crate) fn bytes_mut(&mut self) -> &mut [u8] {
            if self.is_lent {
                return &mut [];
            }
            // SAFETY: they are borrowed for `'m`; nobody else has this, and no reader is out.
            unsafe { self.bytes.as_mut() }
        }

        /// A reader of the bytes, if none is out.
        pub(crate) fn lend(&mut self) -> Option<Reader<'m>> {
            (!core::mem::replace(&mut self.is_lent, true)).then_some(Reader {
                bytes: self.bytes,
                borrowed: PhantomData,
            })
        }

        /// Takes the reader back, if it is the one of this storage.
        pub(crate) fn take_back(&mut self, reader: Reader<'m>) -> Result<(), Reader<'m>> {
            // Of two storages that begin at one address, one is empty.
            if !core::ptr::eq(self.bytes.as_ptr(), reader.bytes.as_ptr()) {
                return Err(reader);
            }
            self.is_lent = false;
            Ok(())
        }
    }

    impl Reader<'_> {
        pub(crate) fn bytes(&self) -> &[u8] {
            // SAFETY: they are borrowed for `'m`, and the storage writes none as long as this is
            // out.
            unsafe { self.bytes.as_ref() }
        }
    }
}

/// Memory that one may write: without `unsafe`, nobody else can read it meanwhile.
#[cfg(not(feature = "unchecked"))]
mod storage {
    use core::convert::Infallible;
    use core::marker::PhantomData;

    /// Bytes.
    pub(crate) struct Storage<'m> {
        bytes: &'m mut [u8],
    }

    /// There is none.
    pub(crate) struct Reader<'m> {
        never: Infallible,
        borrowed: PhantomData<&'m [u8]>,
    }

    impl<'m> Storage<'m> {
        pub(crate) fn new(bytes: &'m mut [u8]) -> Self {
            Storage { bytes }
        }

        pub(crate) fn bytes(&self) -> &[u8] {
            self.bytes
        }

        pub(crate) fn bytes_mut(&mut self) -> &mut [u8] {
            self.bytes
        }

        #[expect(clippy::unused_self, reason = "the other one has something to lend")]
        pub(crate) fn lend(&mut self) -> Option<Reader<'m>> {
            None
        }

        #[expect(clippy::unused_self, reason = "as above")]
        pub(crate) fn take_back(&mut self, reader: Reader<'m>) -> Result<(), Reader<'m>> {
            Err(reader)
        }
    }

    impl Reader<'_> {
        pub(crate) fn bytes(&self) -> &[u8] {
            match self.never {}
        }
    }
}

#[cfg(all(feature = "unchecked", target_endian = "big"))]
compile_error!(
    "flags are read across words, low bytes first: build without the feature `unchecked`"
);
