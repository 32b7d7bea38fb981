//! What `cargo xtask bench` measures and tells: missions of many shapes ([`charts`]), running the
//! programs that drive them ([`measured`]), swaps in a firmware ([`swap`], on an [`emulated`]
//! board), frames of a link ([`link_costs`]), and the report, with what is promised of its figures
//! ([`limits`]).

pub mod charts;
pub mod emulated;
pub mod limits;
pub mod link_costs;
pub mod measured;
pub mod report;
pub mod swap;
pub mod table;
