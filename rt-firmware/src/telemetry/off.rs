//! A firmware without telemetry.

use core::marker::PhantomData;

use crate::ports::Executor;
use esm_link::message::MAX_STREAM_BYTES;

/// No memory.
pub(crate) struct TelemetryMemory;

impl TelemetryMemory {
    pub(crate) const fn new() -> Self {
        TelemetryMemory
    }

    pub(crate) fn split(&mut self) -> (Sampler<'_>, SampleReader<'_>) {
        (Sampler(PhantomData), SampleReader(PhantomData))
    }
}

/// Writes nothing.
pub(crate) struct Sampler<'m>(PhantomData<&'m ()>);

impl Sampler<'_> {
    pub(crate) fn begin(
        &mut self,
        _number: u8,
        _mission: u32,
        _period_ms: u16,
        _nets: impl Iterator<Item = u16>,
    ) {
    }

    #[cfg_attr(feature = "speed", inline(always))]
    pub(crate) fn started(&mut self, _mission: u32) {}

    #[cfg_attr(feature = "speed", inline(always))]
    pub(crate) fn after_step(&mut self, _executor: &Executor<'_>, _t_us: u64) {}
}

/// Has nothing to read.
pub(crate) struct SampleReader<'m>(PhantomData<&'m ()>);

impl SampleReader<'_> {
    #[cfg_attr(feature = "speed", inline(always))]
    pub(crate) fn begin(&mut self, _number: u8, _mission: u32) {}

    #[cfg_attr(feature = "speed", inline(always))]
    pub(crate) fn end(&mut self) {}

    #[cfg_attr(feature = "speed", inline(always))]
    pub(crate) fn read(
        &mut self,
        _room: &mut [u8; MAX_STREAM_BYTES],
        _runs: impl FnOnce() -> Option<Option<u32>>,
    ) -> usize {
        0
    }

    #[cfg_attr(feature = "speed", inline(always))]
    pub(crate) fn dropped(&self) -> u32 {
        0
    }
}
