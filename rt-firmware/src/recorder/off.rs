//! A firmware that records nothing.

use core::marker::PhantomData;
use core::ops::Deref;

use esm_core::Interpreter;

use crate::ring::Part;
use esm_link::message::LinkError;

/// No memory.
pub(crate) struct RecorderMemory<const WORDS: usize>;

impl<const WORDS: usize> RecorderMemory<WORDS> {
    pub(crate) const fn new() -> Self {
        RecorderMemory
    }

    pub(crate) fn split(&mut self) -> (Recorder<'_>, RecordReader<'_>) {
        (Recorder(PhantomData), RecordReader(PhantomData))
    }
}

/// Writes nothing.
pub(crate) struct Recorder<'m>(PhantomData<&'m ()>);

impl Recorder<'_> {
    #[cfg_attr(feature = "speed", inline(always))]
    pub(crate) fn started(&mut self, _mission: u32, _start_us: u64, _warm: bool) {}

    #[cfg_attr(feature = "speed", inline(always))]
    pub(crate) fn skipped(&mut self, _missed: u32) {}

    #[cfg_attr(feature = "speed", inline(always))]
    pub(crate) fn before_step<B: Deref<Target = [u8]>>(&mut self, _: &Interpreter<'_, B>) {}

    #[cfg_attr(feature = "speed", inline(always))]
    pub(crate) fn after_step<B: Deref<Target = [u8]>>(&mut self, _: &Interpreter<'_, B>) {}
}

/// Has nothing to read.
pub(crate) struct RecordReader<'m>(PhantomData<&'m ()>);

impl RecordReader<'_> {
    pub(crate) fn want(&mut self, wanted: bool) -> Result<(), LinkError> {
        if wanted {
            return Err(LinkError::NotBuiltIn);
        }
        Ok(())
    }

    pub(crate) fn is_wanted(&self) -> bool {
        false
    }

    pub(crate) fn read(&mut self, _room: &mut [u8]) -> Part {
        Part {
            len: 0,
            continues: false,
        }
    }

    pub(crate) fn is_empty(&self) -> bool {
        true
    }

    pub(crate) fn dropped(&self) -> u32 {
        0
    }
}
