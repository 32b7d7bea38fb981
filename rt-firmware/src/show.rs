//! What a value on a net is made of: the names and types of its fields, which a host asks for, and
//! their bits, which [telemetry](esm_link::telemetry) carries. Nothing is formatted here.
//!
//! The same fields, one behind the other and little endian, are the payload of a
//! [frame](crate::frames): a `bool` is a byte, 0 or 1; a row has no gaps.

use core::sync::atomic::{AtomicU32, Ordering};

/// Says what a port type is made of, inside its [`PortType`](crate::PortType): all of its fields
/// that are to be seen from outside, in this order, each of `bool`, an integer of up to 32 bits,
/// `f32`, or a row of such, whose length is written as a number. A name says what the field is, and
/// ends in its unit where it has one.
///
/// ```
/// use rt_firmware::{PortType, fields};
///
/// #[derive(Clone, Copy)]
/// struct Beam {
///     angle_rad: f32,
///     range_m: [f32; 2],
///     hits: u8,
/// }
/// impl PortType for Beam {
///     const NAME: &'static str = "Beam";
///     const INIT: Self = Beam { angle_rad: 0.0, range_m: [0.0; 2], hits: 0 };
///     fields! { angle_rad: f32, range_m: [f32; 2], hits: u8 }
/// }
/// assert_eq!(Beam::FIELDS, "angle_rad:f32\nrange_m:[f32;2]\nhits:u8\n");
/// ```
#[macro_export]
macro_rules! fields {
    ($($name:ident : $type:tt),+ $(,)?) => {
        const FIELDS: &'static str = concat!($(stringify!($name), ":", $crate::show::__field_type!($type), "\n"),+);

        fn show(&self, show: &mut $crate::Show<'_>) {
            $(
                let field: &$type = &self.$name;
                $crate::show::Field::show(field, show);
            )+
        }

        const PAYLOAD_BYTES: usize = 0 $(+ <$type as $crate::show::Field>::BYTES)+;

        fn put(&self, payload: &mut [u8]) {
            let rest = payload;
            $(let rest = $crate::show::put_first::<$type>(&self.$name, rest);)+
            let _ = rest;
        }

        fn take(&mut self, payload: &[u8]) {
            let rest = payload;
            $(let rest = $crate::show::take_first::<$type>(&mut self.$name, rest);)+
            let _ = rest;
        }
    };
}

/// Writes a field to the beginning of a payload, and gives what is behind it.
#[doc(hidden)]
#[inline(always)]
pub fn put_first<'p, F: Field>(field: &F, payload: &'p mut [u8]) -> &'p mut [u8] {
    match payload.split_at_mut_checked(F::BYTES) {
        Some((first, rest)) => {
            field.put(first);
            rest
        }
        None => &mut [],
    }
}

/// Reads a field from the beginning of a payload, and gives what is behind it.
#[doc(hidden)]
#[inline(always)]
pub fn take_first<'p, F: Field>(field: &mut F, payload: &'p [u8]) -> &'p [u8] {
    match payload.split_at_checked(F::BYTES) {
        Some((first, rest)) => {
            field.take(first);
            rest
        }
        None => &[],
    }
}

/// How a field's type is told.
#[doc(hidden)]
#[macro_export]
macro_rules! __field_type {
    ([$item:ident; $count:literal]) => {
        concat!("[", stringify!($item), ";", $count, "]")
    };
    ($item:ident) => {
        stringify!($item)
    };
}

#[doc(hidden)]
pub use __field_type;

/// Whoever looks at a value: takes the bits of its fields, one behind the other.
pub struct Show<'s> {
    words: &'s [AtomicU32],
    /// Words so far, those that there was no room for among them.
    len: usize,
}

impl<'s> Show<'s> {
    /// Bits go into these words, as far as there are some.
    #[cfg(feature = "telemetry")]
    pub(crate) fn new(words: &'s [AtomicU32]) -> Self {
        Show { words, len: 0 }
    }

    /// How many words there were.
    #[cfg(feature = "telemetry")]
    pub(crate) fn len(&self) -> usize {
        self.len
    }

    fn word(&mut self, bits: u32) {
        if let Some(word) = self.words.get(self.len) {
            word.store(bits, Ordering::Relaxed);
        }
        self.len += 1;
    }
}

/// What a field can be.
#[doc(hidden)]
pub trait Field {
    /// Bytes of it in a payload.
    const BYTES: usize;
    fn show(&self, show: &mut Show<'_>);
    /// Writes it into so many bytes.
    fn put(&self, bytes: &mut [u8]);
    /// Reads it from so many bytes.
    fn take(&mut self, bytes: &[u8]);
}

/// What a row can be made of: so many bits of a word.
trait Item: Copy {
    const BITS: u32;
    /// Bytes of it in a payload.
    const BYTES: usize;
    fn bits(self) -> u32;
    fn of_bits(bits: u32) -> Self;
}

/// Writes an item into as many bytes, little endian.
#[inline(always)]
fn put_item<I: Item>(item: I, bytes: &mut [u8]) {
    let bits = item.bits().to_le_bytes();
    if let (Some(place), Some(bits)) = (bytes.get_mut(..I::BYTES), bits.get(..I::BYTES)) {
        place.copy_from_slice(bits);
    }
}

/// Reads an item from as many bytes, little endian.
#[inline(always)]
fn item<I: Item>(bytes: &[u8]) -> I {
    let mut bits = [0; size_of::<u32>()];
    if let (Some(bits), Some(bytes)) = (bits.get_mut(..I::BYTES), bytes.get(..I::BYTES)) {
        bits.copy_from_slice(bytes);
    }
    I::of_bits(u32::from_le_bytes(bits))
}

/// A row of small integers has as many of them in a word as fit: a sample has few words.
impl<I: Item, const N: usize> Field for [I; N] {
    const BYTES: usize = N * I::BYTES;

    fn put(&self, bytes: &mut [u8]) {
        for (item, bytes) in self.iter().zip(bytes.chunks_mut(I::BYTES)) {
            put_item(*item, bytes);
        }
    }

    fn take(&mut self, bytes: &[u8]) {
        for (place, bytes) in self.iter_mut().zip(bytes.chunks(I::BYTES)) {
            *place = item(bytes);
        }
    }

    fn show(&self, show: &mut Show<'_>) {
        let mask = u32::MAX >> (u32::BITS - I::BITS);
        for items in self.chunks((u32::BITS / I::BITS) as usize) {
            let (mut word, mut shift) = (0, 0);
            for item in items {
                word |= (item.bits() & mask) << shift;
                shift += I::BITS;
            }
            show.word(word);
        }
    }
}

macro_rules! field_types {
    ($($name:ty, $bits_of_row:literal: $value:ident => $bits:expr, $of_bits:expr;)+) => {
        $(impl Item for $name {
            const BITS: u32 = $bits_of_row;
            const BYTES: usize = size_of::<$name>();
            fn bits(self) -> u32 {
                let $value = self;
                $bits
            }
            fn of_bits($value: u32) -> Self {
                $of_bits
            }
        }

        impl Field for $name {
            const BYTES: usize = <Self as Item>::BYTES;
            #[inline(always)]
            fn put(&self, bytes: &mut [u8]) {
                put_item(*self, bytes);
            }
            #[inline(always)]
            fn take(&mut self, bytes: &[u8]) {
                *self = item(bytes);
            }
            fn show(&self, show: &mut Show<'_>) {
                show.word(self.bits());
            }
        })+
    };
}

field_types! {
    bool, 32: value => value.into(), value != 0;
    u8, 8: value => value.into(), value as u8;
    u16, 16: value => value.into(), value as u16;
    u32, 32: value => value, value;
    i8, 8: value => i32::from(value).cast_unsigned(), value as i8;
    i16, 16: value => i32::from(value).cast_unsigned(), value as i16;
    i32, 32: value => value.cast_unsigned(), value.cast_signed();
    f32, 32: value => value.to_bits(), f32::from_bits(value);
}

#[cfg(test)]
mod payload_tests {
    use crate::PortType;

    #[derive(Clone, Copy, Debug, PartialEq)]
    struct Beam {
        is_on: bool,
        hits: [u8; 3],
        angle: i16,
        range_m: f32,
        rows: [i16; 2],
        hidden: u32,
    }

    impl PortType for Beam {
        const NAME: &'static str = "Beam";
        const INIT: Self = Beam {
            is_on: false,
            hits: [0; 3],
            angle: 0,
            range_m: 0.0,
            rows: [0; 2],
            hidden: 9,
        };
        fields! { is_on: bool, hits: [u8; 3], angle: i16, range_m: f32, rows: [i16; 2] }
    }

    #[test]
    fn fields_are_the_payload_without_gaps_and_little_endian() {
        let beam = Beam {
            is_on: true,
            hits: [1, 2, 3],
            angle: -2,
            range_m: 1.5,
            rows: [256, -1],
            hidden: 7,
        };
        let mut payload = [0; Beam::PAYLOAD_BYTES];
        beam.put(&mut payload);
        let expected = [1, 1, 2, 3, 0xFE, 0xFF, 0, 0, 0xC0, 0x3F, 0, 1, 0xFF, 0xFF];
        assert_eq!(payload, expected);
        let mut taken = Beam::INIT;
        taken.take(&payload);
        // What is not to be seen from outside does not travel.
        assert_eq!(taken, Beam { hidden: 9, ..beam });
        // One that is cut is read as far as its fields are whole.
        let mut cut = Beam::INIT;
        cut.take(&payload[..7]);
        assert_eq!((cut.angle, cut.range_m), (-2, 0.0));
    }
}

#[cfg(all(test, feature = "telemetry"))]
mod tests {
    use super::*;

    #[test]
    fn rows_of_small_integers_share_words() {
        let words = [const { AtomicU32::new(0) }; 8];
        let mut show = Show::new(&words);
        [1_u8, 2, 3, 4, 5].show(&mut show);
        [-1_i16, 2, 3].show(&mut show);
        7_u8.show(&mut show);
        [8_u32, 9].show(&mut show);
        assert_eq!(show.len(), 7);
        let words: std::vec::Vec<u32> = (words.iter())
            .map(|word| word.load(Ordering::Relaxed))
            .collect();
        let expected = [0x0403_0201, 5, 0x0002_FFFF, 3, 7, 8, 9, 0];
        assert_eq!(words, expected);
    }
}
