//! The sides of a robot's runtime, in their places.

use core::mem::MaybeUninit;

use rt_firmware::{
    About, AnyTaskPool, Background, Limits, LinkSide, Mailbox, Memory, RealTime, split,
};

/// The sides of a runtime: for the slot timer's interrupt, for the idle loop, for the link's task.
/// The large ones by reference: RTIC moves what it is given on the stack.
pub struct Sides {
    /// For the slot timer's interrupt.
    pub real_time: &'static mut RealTime<'static, 'static>,
    /// For the idle loop.
    pub background: Background<'static, 'static>,
    /// For the link's task.
    pub link: &'static mut LinkSide<'static, 'static>,
}

/// Makes a runtime of its memory and a robot's banks, and puts its sides into their places.
///
/// # Panics
/// If two tasks have one name, or two port types do.
// Not inlined, so that what making them takes of the stack is given back.
#[inline(never)]
pub fn make<
    const BLOB_BYTES: usize,
    const ARENA_WORDS: usize,
    const SLOTS: usize,
    const TASKS: usize,
    const NETS: usize,
    const GROUPS: usize,
    const TRACE_BYTES: usize,
>(
    (real_time_place, link_place): (
        &'static mut MaybeUninit<RealTime<'static, 'static>>,
        &'static mut MaybeUninit<LinkSide<'static, 'static>>,
    ),
    memory: &'static mut Memory<
        'static,
        BLOB_BYTES,
        ARENA_WORDS,
        SLOTS,
        TASKS,
        NETS,
        GROUPS,
        TRACE_BYTES,
    >,
    banks: &'static mut [&'static mut (dyn AnyTaskPool + 'static)],
    mailbox: &'static mut Mailbox<'static>,
    about: About<'static>,
) -> Sides {
    match split(memory, banks, mailbox, about, Limits::default()) {
        Ok((real_time, background, link)) => Sides {
            real_time: real_time_place.write(real_time),
            background,
            link: link_place.write(link),
        },
        Err(_) => panic!("two tasks have one name, or two port types do"),
    }
}
