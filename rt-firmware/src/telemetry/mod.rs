//! Between real-time side and link: one [sample](esm_link::telemetry) of values on nets.
//!
//! It has two sides, as the recorder has: [`Sampler`] writes, [`SampleReader`] reads and says
//! whether anything is wanted. There is room for one sample. Whoever writes finds it empty or drops
//! what it would have written, and counts that; so a full wire costs samples, and no time. Without
//! the feature `telemetry` both are there, take neither flash nor memory, and nobody can ask for
//! anything.

#[cfg(not(feature = "telemetry"))]
mod off;
#[cfg(feature = "telemetry")]
mod on;

#[cfg(not(feature = "telemetry"))]
pub(crate) use off::{SampleReader, Sampler, TelemetryMemory};
#[cfg(feature = "telemetry")]
pub(crate) use on::{SampleReader, Sampler, TelemetryMemory};
