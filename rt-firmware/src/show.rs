//! What a value on a net is made of: the names and types of its fields, which a host asks for, and their bits, which
//! [telemetry](esm_link::telemetry) carries. Nothing is formatted here.

use core::sync::atomic::{AtomicU32, Ordering};

/// Says what a port type is made of, inside its [`PortType`](crate::PortType): all of its fields that are to be seen from outside, in this order, each of `bool`, an integer of up to
/// 32 bits, `f32`, or a row of such, whose length is written as a number. A name says what the field is, and ends in its unit where it has one.
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
        const FIELDS: &'static str = concat!($(stringify!($name), ":", $crate::__field_type!($type), "\n"),+);

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

impl<F: Field, const N: usize> Field for [F; N] {
    fn show(&self, show: &mut Show<'_>) {
        for item in self {
            item.show(show);
        }
    }
}

macro_rules! field_types {
    ($($name:ty: $value:ident => $bits:expr;)+) => {
        $(impl Field for $name {
            fn show(&self, show: &mut Show<'_>) {
                let $value = *self;
                show.word($bits);
            }
        })+
    };
}

field_types! {
    bool: value => value.into();
    u8: value => value.into();
    u16: value => value.into();
    u32: value => value;
    i8: value => i32::from(value).cast_unsigned();
    i16: value => i32::from(value).cast_unsigned();
    i32: value => value.cast_unsigned();
    f32: value => value.to_bits();
}
