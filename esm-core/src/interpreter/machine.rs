//! A machine between and in its macro steps: its memory, its numbers, and how both are read and
//! written.

use core::ops::Range;

use super::clock::Clock;
use super::events::Fault;
use crate::arena::{ArenaLayout, WORD_BITS};
use crate::format::{self, Section};
use crate::layout::{Field, mission, region_instance, slot, state, task_instance};
use crate::reads::{Checked, access::Access};
use crate::tables::{Tables, record_bytes};

/// The blob that a machine runs, borrowed.
pub(super) type Blob<'b, R> = <R as Access>::Blob<'b>;

/// A machine that runs, without the blob, which all that reads tables is given.
///
/// Who keeps the blob is no matter of it: so there is one walk for all of them.
#[derive(Debug)]
// The order is that of `Places`.
#[repr(C)]
pub(super) struct Machine<'m, R: Access> {
    pub(super) places: Places<R::Place, R::Part>,
    /// Events that were put into the queue in this macro step. The queue is a ring, as long as a
    /// power of two: the low bits of the two numbers say the place.
    pub(super) queued: u32,
    pub(super) queue_capacity: u32,
    /// Events that were taken out of it: the number of the micro step.
    pub(super) taken: u32,
    pub(super) clock: Clock,
    pub(super) period_us: u32,
    /// Whether a transition was taken in this macro step.
    pub(super) changed: bool,
    pub(super) fault: Option<Fault>,
    pub(super) layout: ArenaLayout,
    pub(super) arena: &'m mut [u32],
}

/// Where tables and parts of the arena begin. What is needed together stands together: a core loads
/// two words that do as fast as one.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub(super) struct Places<P, A> {
    pub(super) current: A,
    region_instances: P,
    states: P,
    transitions: P,
    pub(super) active: A,
    listeners: P,
    pub(super) flags: A,
    pub(super) enabled: A,
    pub(super) queue: A,
    pub(super) queue_mask: u32,
    instances: P,
    channels: P,
    pub(super) entered: A,
    containers: P,
    code: P,
    timers: P,
    task_instances: P,
    pub(super) params: P,
}

/// 32 region instances, which have their bits in one word.
#[derive(Clone, Copy)]
pub(super) struct Word<P> {
    /// The first of them.
    pub(super) first: usize,
    /// The two words with their bits: see [`Mark`].
    pub(super) marks: P,
}

/// Which of the two words of 32 region instances: who is active, and who is awake.
#[derive(Clone, Copy)]
pub(super) enum Mark {
    Active,
    Awake,
}

/// A region instance and its bit.
#[derive(Clone, Copy)]
pub(super) struct Here<P> {
    pub(super) region: usize,
    pub(super) bit: u32,
    /// The two words with its bits.
    pub(super) marks: P,
}

/// The first region instance of a word.
pub(super) const FIRST: u32 = 1 << (u32::BITS - 1);

/// The region instances of its word that are not before a region instance.
#[cfg_attr(feature = "speed", inline(always))]
pub(super) fn from_place(region: usize) -> u32 {
    u32::MAX >> (region % WORD_BITS)
}

/// The bit of a region instance in its word.
#[cfg_attr(feature = "speed", inline(always))]
pub(super) fn bit_of(region: usize) -> u32 {
    FIRST >> (region % WORD_BITS)
}

impl<'m, R: Access> Machine<'m, R> {
    /// A machine before its first macro step, in an arena that is large enough.
    pub(super) fn new(tables: &Tables<'_>, arena: &'m mut [u32]) -> Self {
        let blob = R::blob(tables.bytes());
        let mission = R::place(tables.bytes(), tables.start_at(Section::Mission as usize));
        let number =
            |field: Field| -> usize { R::half(blob, R::ahead(mission, field.offset())).into() };
        let queue_capacity = number(mission::QUEUE);
        let layout = ArenaLayout::new(
            tables.region_instance_count(),
            tables.task_instance_count(),
            number(mission::FLAGS),
            queue_capacity,
        );
        arena
            .iter_mut()
            .take(layout.words())
            .for_each(|word| *word = 0);
        let table = |section| R::place(tables.bytes(), tables.start_at(section as usize));
        let mut part = |word| R::part(arena, word);
        let places = Places {
            current: part(0),
            region_instances: table(Section::RegionInstances),
            states: table(Section::States),
            transitions: table(Section::Transitions),
            active: part(layout.active),
            listeners: table(Section::Listeners),
            flags: part(layout.flags),
            enabled: part(layout.enabled),
            queue: part(layout.queue),
            // Where there is one place only, the word has a second one.
            queue_mask: (2 * (layout.end - layout.queue) - 1) as u32,
            instances: table(Section::Instances),
            channels: table(Section::Channels),
            entered: part(layout.entered),
            containers: table(Section::Containers),
            code: table(Section::Code),
            timers: table(Section::Timers),
            task_instances: table(Section::TaskInstances),
            params: table(Section::Params),
        };
        let slot = record_bytes(Section::Slots) * number(mission::INTERPRETER_SLOT);
        let period = R::ahead(table(Section::Slots), slot + slot::PERIOD.offset());
        let mut machine = Self {
            places,
            queued: 0,
            queue_capacity: queue_capacity as u32,
            taken: 0,
            clock: Clock::at(0, u32::MAX),
            period_us: R::word(blob, period),
            changed: false,
            fault: None,
            layout,
            arena,
        };
        for region in 0..layout.regions {
            let record = machine.record(Section::RegionInstances, region);
            let initial = machine.field(blob, record, region_instance::INITIAL);
            machine.set_current(region, initial);
        }
        machine.start_regions(blob, 0, layout.regions);
        machine
    }

    // ─── Tables ──────────────────────────────────────────────────────────────────────────────────

    /// Where a record of one of these sections begins.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn record(&self, section: Section, index: usize) -> R::Place {
        let places = &self.places;
        let start = match section {
            Section::Containers => places.containers,
            Section::States => places.states,
            Section::Transitions => places.transitions,
            Section::Code => places.code,
            Section::Timers => places.timers,
            Section::Instances => places.instances,
            Section::RegionInstances => places.region_instances,
            Section::Channels => places.channels,
            Section::Listeners => places.listeners,
            _ => places.task_instances,
        };
        R::ahead(start, record_bytes(section) * index)
    }

    /// A field of a record.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn field(&self, blob: Blob<'_, R>, record: R::Place, field: Field) -> usize {
        R::half(blob, R::ahead(record, field.offset())).into()
    }

    /// Which events a state's transitions are on. It is the first field of a state.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn events(&self, blob: Blob<'_, R>, state: R::Place) -> u32 {
        R::word(blob, state)
    }

    /// The next region instance that is not inside this one.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn next(&self, blob: Blob<'_, R>, region: usize) -> usize {
        let record = self.record(Section::RegionInstances, region);
        self.field(blob, record, region_instance::NEXT)
    }

    /// The first own flag of a state in a region instance.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn first_flag(&self, blob: Blob<'_, R>, region: usize, state: R::Place) -> usize {
        let region = self.record(Section::RegionInstances, region);
        self.field(blob, region, region_instance::FIRST_FLAG)
            + self.field(blob, state, state::FIRST_FLAG)
    }

    // ─── Memory ──────────────────────────────────────────────────────────────────────────────────

    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn load(&self, part: R::Part, word: usize) -> u32 {
        R::load(self.arena, part, word)
    }

    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn store(&mut self, part: R::Part, word: usize, value: u32) {
        R::store(self.arena, part, word, value);
    }

    /// Words of the arena.
    pub(super) fn words(&self, words: Range<usize>) -> &[u32] {
        self.arena.get(words).unwrap_or(&[])
    }

    /// The record of a region instance's current state.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn current_record(&self, region: usize) -> R::Place {
        let current = R::load_half(self.arena, self.places.current, region);
        self.record(Section::States, current.into())
    }

    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn set_current(&mut self, region: usize, state: usize) {
        R::store_half(self.arena, self.places.current, region, state as u16);
    }

    /// The word of region instances with this one.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn word_of(&self, region: usize) -> Word<R::Part> {
        Word {
            first: region & !(WORD_BITS - 1),
            marks: R::further(self.places.active, 2 * (region / WORD_BITS)),
        }
    }

    /// Who is active, or awake, of a word of region instances.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn marked(&self, marks: R::Part, mark: Mark) -> u32 {
        self.load(marks, mark as usize)
    }

    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn set_marked(&mut self, marks: R::Part, mark: Mark, marked: u32) {
        self.store(marks, mark as usize, marked);
    }

    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn here(&self, region: usize) -> Here<R::Part> {
        Here {
            region,
            bit: bit_of(region),
            marks: self.word_of(region).marks,
        }
    }

    pub(super) fn is_active_at(&self, region: usize) -> bool {
        self.marked(self.word_of(region).marks, Mark::Active) & bit_of(region) != 0
    }

    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn activate(&mut self, region: usize) {
        let Here { bit, marks, .. } = self.here(region);
        let active = self.marked(marks, Mark::Active);
        self.set_marked(marks, Mark::Active, active | bit);
    }

    /// Wakes a region instance, or lets it sleep.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn set_awake(&mut self, here: Here<R::Part>, is_awake: bool) {
        self.take_awake_of(here, 0u32.wrapping_sub(is_awake.into()));
    }

    /// The same by the bit that a region instance has in a word.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn take_awake_of(&mut self, Here { bit, marks, .. }: Here<R::Part>, word: u32) {
        let awake = self.marked(marks, Mark::Awake);
        self.set_marked(marks, Mark::Awake, awake & !bit | word & bit);
    }

    /// Marks several region instances, or takes the mark from them.
    #[inline(never)]
    pub(super) fn mark(&mut self, regions: Range<usize>, mark: Mark, is_set: bool) {
        let Range { start: mut at, end } = regions;
        let value = 0u32.wrapping_sub(is_set.into());
        while at < end {
            let marks = self.word_of(at).marks;
            let mut those = from_place(at);
            at |= WORD_BITS - 1;
            if end <= at {
                those &= !from_place(end);
            }
            at += 1;
            let marked = self.marked(marks, mark);
            self.set_marked(marks, mark, marked ^ (marked ^ value) & those);
        }
    }

    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn flag_at(&self, flag: usize) -> bool {
        self.load(self.places.flags, flag / WORD_BITS) >> (flag % WORD_BITS) & 1 != 0
    }

    pub(super) fn set_flag_to(&mut self, flag: usize, value: bool) {
        self.write_bit(self.places.flags, flag, value);
    }

    /// Writes a bit of a part of the arena, the first in the lowest bit. Returns whether it
    /// changed.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn write_bit(&mut self, part: R::Part, index: usize, value: bool) -> bool {
        let place = index / WORD_BITS;
        let bit = 1 << (index % WORD_BITS);
        let word = self.load(part, place);
        let written = if value { word | bit } else { word & !bit };
        self.store(part, place, written);
        written != word
    }

    /// Sets an enable bit. Returns whether it was set already.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn enable(&mut self, task: usize) -> bool {
        !self.write_bit(self.places.enabled, task, true)
    }

    /// Resets an enable bit. Returns whether it was set.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn disable(&mut self, task: usize) -> bool {
        self.write_bit(self.places.enabled, task, false)
    }

    // ─── What comes from outside ─────────────────────────────────────────────────────────────────

    /// Writes a bit of a task instance's flag block, if there is such a task and its block has it.
    #[inline(never)]
    pub(super) fn write_task_flag(
        &mut self,
        blob: Blob<'_, R>,
        task: usize,
        flag: usize,
        value: bool,
    ) {
        if task >= self.layout.tasks {
            return;
        }
        let record = self.record(Section::TaskInstances, task);
        let state = self.field(blob, record, task_instance::STATE);
        let state = self.record(Section::States, state);
        let flags = self.field(blob, state, state::SHAPE) & usize::from(format::STATE_FLAGS_MASK);
        if flag < flags {
            let first = self.field(blob, record, task_instance::FIRST_FLAG);
            let region = self.field(blob, record, task_instance::REGION);
            self.write_flag(first + flag, region, value);
        }
    }

    /// Writes some of the flags from `first` on, 16 at most: those whose bit is set in `written`
    /// become what it is in `values`. If one changes, it wakes the region that they belong to.
    /// Nothing is written where this machine has no such region, or not so many flags.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn write_flags(&mut self, first: usize, region: u16, written: u32, values: u32) {
        let region = usize::from(region);
        // Most tasks have the flags of others behind theirs, and theirs need not be counted.
        let has_flags = first + u16::BITS as usize <= self.layout.flag_bits
            || first + (u32::BITS - written.leading_zeros()) as usize <= self.layout.flag_bits;
        // Behind the flags other words follow: so a window that begins in them is in the arena.
        let is_inside = has_flags && region < self.layout.regions;
        if is_inside && R::write_window(self.arena, self.places.flags, first, written, values) {
            self.set_awake(self.here(region), true);
        }
    }

    /// Writes a flag, and wakes the region that it belongs to if it changes.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn write_flag(&mut self, flag: usize, region: usize, value: bool) {
        if self.write_bit(self.places.flags, flag, value) {
            self.set_awake(self.here(region), true);
        }
    }

    // ─── What it shows ───────────────────────────────────────────────────────────────────────────

    /// The current state of a region instance; 0 if there is none.
    pub(super) fn current(&self, region: usize) -> usize {
        if region < self.layout.regions {
            Checked::load_half(self.arena, 0, region).into()
        } else {
            0
        }
    }

    /// Whether a region instance has a mark; false if there is none.
    pub(super) fn is_marked(&self, region: usize, mark: Mark) -> bool {
        let word = 2 * (region / WORD_BITS) + mark as usize;
        let marked = Checked::load(self.arena, self.layout.active, word);
        region < self.layout.regions && marked & bit_of(region) != 0
    }

    /// Whether a task instance is enabled; false if there is none.
    pub(super) fn is_enabled(&self, task: usize) -> bool {
        let word = Checked::load(self.arena, self.layout.enabled, task / WORD_BITS);
        task < self.layout.tasks && word >> (task % WORD_BITS) & 1 != 0
    }

    /// The words with all flags.
    pub(super) fn flag_words(&self) -> &[u32] {
        self.words(self.layout.flags..self.layout.enabled)
    }

    /// A flag by its bit in the whole machine; false if there is none.
    pub(super) fn flag(&self, flag: usize) -> bool {
        self.flag_words()
            .get(flag / WORD_BITS)
            .is_some_and(|word| word >> (flag % WORD_BITS) & 1 != 0)
    }
}
