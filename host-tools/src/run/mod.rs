//! The main job: a mission on a board, in a world, from the compiler to the summary.

pub mod board;
pub mod drive;
pub mod entered;
pub mod interrupt;
pub mod mission;
pub mod story;
pub mod summary;

#[cfg(test)]
mod tests;
