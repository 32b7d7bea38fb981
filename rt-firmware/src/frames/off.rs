//! A firmware without links: what a mission has of them is refused, and the rest takes no memory.

use core::marker::PhantomData;

use esm_core::tables::Tables;
use esm_link::message::LinkError;

use crate::ports::Registry;

/// Nothing.
pub(crate) struct FrameMemory;

impl FrameMemory {
    pub(crate) const fn new() -> Self {
        FrameMemory
    }
}

/// Nothing.
#[derive(Default)]
pub(crate) struct FrameLists<'m>(PhantomData<&'m ()>);

/// Tasks of links are unknown tasks, which is told where tasks are looked at.
pub(crate) fn check(_tables: &Tables<'_>, _registry: Registry<'_>) -> Result<(), LinkError> {
    Ok(())
}
