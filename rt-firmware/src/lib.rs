#![cfg_attr(not(test), no_std)]
//! The runtime that a board is made of.

pub mod body;
pub mod drivers;
