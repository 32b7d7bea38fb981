//! What `cargo xtask bench` measures and tells: missions of many shapes ([`charts`]), running the programs that drive them ([`measured`]), and the report, with
//! what is promised of its figures ([`limits`]).

pub mod charts;
pub mod limits;
pub mod measured;
pub mod report;
pub mod table;
