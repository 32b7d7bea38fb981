//! What a value on a net is made of: the names and types of its fields, which a host asks for, and
//! their bits, which [telemetry](esm_link::telemetry) carries. Nothing is formatted here.

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
    };
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
    fn show(&self, show: &mut Show<'_>);
}

/// What a row can be made of: so many bits of a word.
trait Item: Copy {
    const BITS: u32;
    fn bits(self) -> u32;
}

/// A row of small integers has as many of them in a word as fit: a sample has few words.
impl<I: Item, const N: usize> Field for [I; N] {
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
    ($($name:ty, $bits_of_row:literal: $value:ident => $bits:expr;)+) => {
        $(impl Item for $name {
            const BITS: u32 = $bits_of_row;
            fn bits(self) -> u32 {
                let $value = self;
                $bits
            }
        }

        impl Field for $name {
            fn show(&self, show: &mut Show<'_>) {
                show.word(self.bits());
            }
        })+
    };
}

field_types! {
    bool, 32: value => value.into();
    u8, 8: value => value.into();
    u16, 16: value => value.into();
    u32, 32: value => value;
    i8, 8: value => i32::from(value).cast_unsigned();
    i16, 16: value => i32::from(value).cast_unsigned();
    i32, 32: value => value.cast_unsigned();
    f32, 32: value => value.to_bits();
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
