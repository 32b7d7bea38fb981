//! Colours that several pictures have.

use super::scene::Colour;

/// Words.
pub const INK: Colour = Colour::opaque(0x1d232b);
/// Words that are read second.
pub const QUIET_INK: Colour = Colour::opaque(0x5c6672);
/// Lines that numbers are read by.
pub const GRID: Colour = Colour::opaque(0xe6e9ed);
/// What is drawn on.
pub const PAPER: Colour = Colour::opaque(0xffffff);
