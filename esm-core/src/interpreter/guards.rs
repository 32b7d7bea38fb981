//! Guards: what lets a transition be taken.

use super::machine::{Blob, Machine};
use crate::format::{self, Section};
use crate::layout::{code, region_instance, state};
use crate::reads::access::Access;
use crate::tables::record_bytes;

/// What guards see: in the low half the first own flags of a state, in the high half their
/// complement. Cores that test the highest bit of a shifted word at no cost have it the other way
/// round.
#[derive(Clone, Copy)]
pub(super) struct Window<const REVERSED: bool = { cfg!(target_arch = "arm") }>(u32);

impl<const REVERSED: bool> Window<REVERSED> {
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn of(flags: u32) -> Self {
        let flags = flags & ((1 << format::WINDOW_FLAGS) - 1);
        let bits = flags | !flags << format::GUARD_IF_CLEAR;
        Self(if REVERSED { bits.reverse_bits() } else { bits })
    }

    /// The first that is true of guards that ask for one bit each, `count` of them, from this one
    /// on.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn first_of<R: Access>(self, guard: usize, count: usize) -> Option<usize> {
        let (guard, count) = (R::below_32(guard), R::below_32(count));
        let first = if REVERSED {
            let bits = (self.0 << guard) & !(u32::MAX >> count);
            (bits != 0).then(|| bits.leading_zeros())
        } else {
            let bits = (self.0 >> guard) & ((1 << count) - 1);
            (bits != 0).then(|| bits.trailing_zeros())
        };
        first.map(|first| first as usize)
    }

    /// Whether a guard that asks for one bit is true.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn holds(self, guard: usize) -> bool {
        let guard = guard as u32 % u32::BITS;
        if REVERSED {
            (self.0 << guard) >> (u32::BITS - 1) != 0
        } else {
            self.0 >> guard & 1 != 0
        }
    }
}

/// The low and the high half of a word.
fn halves(word: u32) -> (u16, u16) {
    (word as u16, (word >> 16) as u16)
}

impl<R: Access> Machine<'_, R> {
    /// What guards see of a state with this first flag.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn window(&self, first_flag: usize) -> Window {
        Window::of(R::window(self.arena, self.places.flags, first_flag))
    }

    /// A guard of any form, of a transition out of the current state of a region instance.
    #[inline(never)]
    pub(super) fn is_true(&mut self, blob: Blob<'_, R>, guard: usize, region: usize) -> bool {
        let current = self.current_record(region);
        let here = self.record(Section::RegionInstances, region);
        let first_flag = self.field(blob, here, region_instance::FIRST_FLAG);
        let own = first_flag + self.field(blob, current, state::FIRST_FLAG);
        let flags = R::window(self.arena, self.places.flags, own);
        if guard < usize::from(format::GUARD_PROGRAM) {
            let window: Window = Window::of(flags);
            return window.holds(guard);
        }
        if guard >= usize::from(format::GUARD_MASK) {
            let at = self.record(Section::Code, guard % usize::from(format::GUARD_MASK));
            let (mask, value) = halves(R::word(blob, at));
            return (flags as u16 ^ value) & mask == 0;
        }
        let mut at = self.record(Section::Code, guard - usize::from(format::GUARD_PROGRAM));
        loop {
            let control = self.field(blob, at, code::CONTROL) as u16;
            let operation = control >> format::CODE_OPERATION_SHIFT;
            let is_set = match operation {
                format::CODE_END => return true,
                format::CODE_JUMP_IF_CLEAR | format::CODE_JUMP_IF_SET => {
                    self.flag_at(first_flag + self.field(blob, at, code::OPERAND))
                }
                // Those that ask for what is busy inside: others are not in guards.
                _ => {
                    // Tasks get busy without waking anyone but their own region.
                    self.set_awake(self.here(region), true);
                    self.is_busy_within(blob, region)
                }
            };
            // Those that jump if it is set have even numbers.
            let mut ahead = 1;
            if (operation ^ u16::from(is_set)) & 1 != 0 {
                ahead = usize::from(control & format::CODE_LOW_MASK);
                if ahead == 0 {
                    return false;
                }
            }
            at = R::ahead(at, record_bytes(Section::Code) * ahead);
        }
    }

    /// Whether the busy flag of a current task state is set anywhere inside the current superstate
    /// of a region instance.
    #[inline(never)]
    pub(super) fn is_busy_within(&self, blob: Blob<'_, R>, region: usize) -> bool {
        (region + 1..self.next(blob, region)).any(|inside| {
            let current = self.current_record(inside);
            let shape = self.field(blob, current, state::SHAPE) as u16;
            let kind = shape >> format::STATE_KIND_SHIFT;
            self.is_active_at(inside)
                && matches!(kind, format::STATE_TASK | format::STATE_BACKGROUND_TASK)
                && self.flag_at(self.first_flag(blob, inside, current) + format::FLAG_BUSY)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reads::Checked;

    /// Holds each guard that asks for one bit, and each row of them, against the meaning of its
    /// number.
    fn assert_guards_mean_what_they_say<const REVERSED: bool>() {
        let one_flag = (0..format::WINDOW_FLAGS).map(|flag| 1u32 << flag);
        // What is above the window is of other states.
        let patterns = [0, u32::MAX, 0x7FFF, 0xFFFF_8000, 0x5555_5555, 0xDEAD_BEEF];
        for flags in one_flag
            .clone()
            .chain(one_flag.map(|it| !it))
            .chain(patterns)
        {
            let holds = |guard: u32| match guard {
                0..15 => flags >> guard & 1 != 0,
                15 => false,
                16..31 => flags >> (guard - 16) & 1 == 0,
                _ => guard == u32::from(format::GUARD_TRUE),
            };
            let window = Window::<REVERSED>::of(flags);
            for guard in 0..u32::from(format::GUARD_PROGRAM) {
                let found = window.holds(guard as usize);
                assert_eq!(found, holds(guard), "{flags:#x} {guard}");
                for count in 2..=(u32::from(format::GUARD_PROGRAM) - guard).min(16) {
                    let first = (0..count).find(|ahead| holds(guard + ahead));
                    let found = window.first_of::<Checked>(guard as usize, count as usize);
                    assert_eq!(
                        found,
                        first.map(|it| it as usize),
                        "{flags:#x} {guard} {count}"
                    );
                }
            }
        }
    }

    #[test]
    fn guards_mean_the_same_whichever_way_round_a_core_has_them() {
        assert_guards_mean_what_they_say::<false>();
        assert_guards_mean_what_they_say::<true>();
    }
}
