//! The main job: a mission on a board, in a world, from the compiler to the summary.

pub mod board;
pub mod by_hand;
pub mod drive;
pub mod in_memory;
pub mod mission;
pub mod summary;
pub mod touches;

pub use crate::interrupt;
pub use esm_toolkit::recording::entered;
pub use esm_toolkit::story;

#[cfg(test)]
mod tests;
