//! How a firmware gets onto a board: as a [UF2](uf2) file over the boot loader's [`drive`], or by
//! [`programs`] of others.

pub mod drive;
pub mod programs;
pub mod uf2;
