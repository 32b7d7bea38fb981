//! The recorder: writes what enters the interpreter, if somebody wants it, for the link to
//! [send](esm_link::recording).
//!
//! It has two sides, as everything between real-time side and link: [`Recorder`] writes,
//! [`RecordReader`] reads and says whether anything is wanted. Without the feature `record` both
//! are there, take neither flash nor memory, and a recording is refused.

#[cfg(not(feature = "record"))]
mod off;
#[cfg(feature = "record")]
mod on;

#[cfg(not(feature = "record"))]
pub(crate) use off::{RecordReader, Recorder, RecorderMemory};
#[cfg(feature = "record")]
pub(crate) use on::{RecordReader, Recorder, RecorderMemory};
