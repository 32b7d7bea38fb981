//! The one pass that a blob must survive before anything is taken from it.
//!
//! What it proves is what the [format](mod@crate::format) says: every index points into its table,
//! every part begins where the one before ended, every jump goes ahead, and each record of the
//! instance tree is what its template makes of it.
//!
//! It walks the instances in the order of their numbers, and of each its regions, and of each
//! region its states. An instance says what must stand in the records of its region instances and
//! task instances, and in those of the instances inside its superstates. The first instance of a
//! container is its *model*: there the walk checks the template, too, with transitions and code,
//! and that the container's spans (flags, tasks, regions, instances that one instance of it takes)
//! are the sums of its parts. So no container can hold itself, and the machine's spans are what the
//! tables hold: nothing is claimed twice, and nothing is left out. Other tables are checked a
//! record at a time. Time grows with the number of state instances, which is bounded, and with the
//! square of the number of slots, which is, too; the depth of the stack is constant.
//!
//! [`check`] below is the table of contents. Each step has a function; it reads records where they
//! lie, by the structs of [`crate::layout`], and the first rule that does not hold ends it. `tree`
//! has instances and templates, `transitions` and `code` what templates hold, `slots` the schedule.
//! No function calls itself.
//!
//! # What stands when a blob has passed
//!
//! Reads that check nothing again name the one of these that they rely on.
//!
//! * **mission**: the queue holds 1 to 255 events; the interpreter's slot exists; no event's number
//!   is above the mission's count. The flags of the whole machine are as many as the mission says.
//! * **tree**: the region instances of an instance, and all that is inside them, stand together;
//!   `next` of a region instance is above its number and at most their count, and what lies between
//!   is inside it. The instance of a region instance, the container and the region instance around
//!   of an instance, the instance inside a superstate (the instance plus *a*) with its first region
//!   instance exist, and the numbers of what is inside are above.
//! * **current**: `initial` of a region instance, and each target of a transition out of a state of
//!   its region, is a state of its region; a target is never `initial`.
//! * **flags**: the first flag of an instance plus any relative flag that a state, test or action
//!   of its container names is below the mission's count of flags; so are all flags of a state's
//!   block. Tests name flags at the head of the block of their instance, or own ones of the state
//!   that is left; actions the same of the state that is entered.
//! * **transitions**: those of a state are a range in the table, as long as the next state's begin
//!   behind. Those on the pulse come first, up to *first not on the pulse*; the others are sorted
//!   by their events. `events` has a bit for each, and no other. `final` has none.
//! * **plain**: the mark is set on every transition from `initial` or a simple state to a simple
//!   state without flags that has no action; on every one on the pulse from a real-time task state
//!   without timeout and with at most [`format::PLAIN_FLAGS`] flags to itself whose action is one
//!   `send`; and on no other.
//! * **guards**: a bit is one of the state's own flags; a mask has two bits at least, all own
//!   flags, its value no others; a program ends, its jumps lead ahead and to its end at most, it
//!   looks inside superstates only. All code records that they need exist. Where *b* of a state
//!   without timeout is not 0, that many of its first transitions are on the pulse, with guards
//!   that are bits, each one more than the guard before.
//! * **actions**: a row ends. The channels of an instance exist: its first plus the one that is
//!   named. No action writes `exit` or `timeout` of a state or superstate.
//! * **timers**: a state with a timeout has a flag for it and a record among the timers, of at most
//!   [`format::MAX_TIME_US`]. So nothing but entering its state resets a timeout flag.
//! * **rows**: a channel's words are in the table of listeners, and those of its region words that
//!   exist; a bit is that of a region instance. Its event is not the pulse.
//! * **tasks**: a task instance exists for each task state of each instance; its state, region
//!   instance, first flag, task state are right. The task of a task state, its slot, its parameters
//!   and the connections of a task instance exist, as many as the task has; the state has as many
//!   flags as the task.
//! * **slots**: their periods are not 0, and no two are ever due at once.
//!
//! Texts are not looked at: see [`crate::texts`].

mod code;
mod finding;
mod pass;
mod slots;
mod transitions;
mod tree;

use core::ops::Deref;

use crate::buffer::{BlobBuffer, BlobReader};
use crate::format::{self, Section};
use crate::layout::{
    Channel, Connection, Container, Listener, Mission, Slot, Task, TaskInstance, TaskState,
    record_bytes,
};
use crate::refusal::{Cause, Refusal};
use crate::tables::{self, Tables};

use finding::Finding;
use pass::Pass;

/// Where the sections of a blob are, and what was worked out on the way.
#[derive(Clone, Copy, Debug)]
struct Layout {
    sections: tables::Sections,
    crc: u32,
}

/// A blob that passed [`verify`]. Only such a blob can be interpreted.
///
/// `B` must give the same bytes whenever it is dereferenced, as every slice, vector or array does.
/// If it does not, the interpreter may do nonsense, but no memory is at risk.
#[derive(Clone, Debug)]
pub struct Verified<B> {
    bytes: B,
    layout: Layout,
}

/// Checks a blob from the first byte to the last.
///
/// # Errors
/// Gives the bytes back, with the first thing that is wrong.
pub fn verify<B: Deref<Target = [u8]>>(bytes: B) -> Result<Verified<B>, (B, Refusal)> {
    let mut layout = Layout {
        sections: [(0, 0); _],
        crc: 0,
    };
    match layout.read(&bytes) {
        Ok(()) => Ok(Verified { bytes, layout }),
        Err(refusal) => Err((bytes, refusal)),
    }
}

impl<B: Deref<Target = [u8]>> Verified<B> {
    /// The tables.
    #[inline]
    #[must_use]
    pub fn tables(&self) -> Tables<'_> {
        self.layout.tables(&self.bytes)
    }

    /// The blob as it was given to [`verify`].
    #[must_use]
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// The same blob, borrowed: for another machine of it, which need not be checked again.
    #[must_use]
    pub fn by_ref(&self) -> Verified<&[u8]> {
        Verified {
            bytes: &self.bytes,
            layout: self.layout,
        }
    }

    /// Gives the blob back.
    pub fn into_bytes(self) -> B {
        self.bytes
    }

    /// The mission hash: the CRC-32 at the blob's end.
    #[must_use]
    pub fn hash(&self) -> u32 {
        self.layout.crc
    }
}

impl<'m> Verified<BlobBuffer<'m>> {
    /// The same for somebody else, as long as the blob is where it is: see [`BlobBuffer::lend`].
    pub fn lend(&mut self) -> Option<Verified<BlobReader<'m>>> {
        let layout = self.layout;
        (self.bytes.lend()).map(|bytes| Verified { bytes, layout })
    }
}

impl Layout {
    #[inline]
    fn tables<'a>(&'a self, bytes: &'a [u8]) -> Tables<'a> {
        Tables::new(bytes, &self.sections)
    }

    /// Reads the envelope: the postcard encoding of [`format::Envelope`].
    fn read(&mut self, bytes: &[u8]) -> Result<(), Refusal> {
        if !bytes.starts_with(&format::MAGIC) {
            return Err(Refusal::Magic);
        }
        let (body, crc) = bytes
            .split_last_chunk::<{ format::CRC_BYTES }>()
            .ok_or(Refusal::Cut)?;
        let stored = u32::from_le_bytes(*crc);
        let computed = format::crc32(body);
        if stored != computed {
            return Err(Refusal::Checksum { stored, computed });
        }
        self.crc = stored;
        let mut at = format::MAGIC.len();
        for (section, place) in Section::ALL.into_iter().zip(&mut self.sections) {
            if section as usize == Section::ALWAYS && at == body.len() {
                break;
            }
            let length = format::read_varint(body, &mut at).ok_or(Refusal::Cut)?;
            let record_bytes = record_bytes(section) as u32;
            let records = length / record_bytes;
            *place = (at as u32, records);
            if body.len().wrapping_sub(at) < length as usize {
                return Err(Refusal::Cut);
            }
            at += length as usize;
            // Before the first of them is looked at: the time that slots take grows with their
            // square.
            let most = match section {
                Section::Slots => format::MAX_SLOTS,
                _ => format::NONE - 1,
            };
            let is_too_long = record_bytes > 1 && records > u32::from(most);
            if records * record_bytes != length || is_too_long {
                return Err(Refusal::SectionLength(section));
            }
        }
        if at != body.len() {
            return Err(Refusal::TrailingBytes);
        }
        check(self.tables(bytes)).map_err(Refusal::from)
    }
}

/// Whether all these times are ones that can be, and no two of them are ever due at once.
pub(crate) fn are_apart(times: &[Slot]) -> bool {
    slots::check(times, usize::MAX).is_ok()
}

/// Checks all tables.
#[inline(never)]
fn check(tables: Tables<'_>) -> Result<(), Finding> {
    let mut pass = Pass::of(tables);
    let mission = pass.check_mission()?;
    slots::check(tables.records(), mission.interpreter_slot.get())?;
    pass.check_instances(mission)?;
    pass.check_channels(mission)?;
    pass.check_tasks(mission)?;
    pass.check_task_instances()?;
    pass.check_connections()?;
    pass.check_ends()
}

/// Tables of which each record must have been come to. Of the others each was checked by itself, or
/// any number may be.
const WHOLE: [Section; 14] = [
    Section::Containers,
    Section::Regions,
    Section::States,
    Section::Transitions,
    Section::Code,
    Section::Timers,
    Section::Instances,
    Section::RegionInstances,
    Section::Channels,
    Section::Signatures,
    Section::TaskStates,
    Section::Params,
    Section::TaskInstances,
    Section::Connections,
];

impl<'a> Pass<'a> {
    /// Checks the numbers of the mission. There is one record.
    fn check_mission(&mut self) -> Result<&'a Mission, Finding> {
        if self.tables.count(Section::Mission) != 1 {
            return Err(Finding::new(Section::Mission, 1, Cause::Order));
        }
        let mission = self.entry::<Mission>(0, Cause::Order)?;
        let is_in_range = (1..=format::MAX_QUEUE).contains(&mission.queue.get())
            && mission.events.get() <= format::MAX_EVENT.into();
        mission.ensure(is_in_range, Cause::Range)?;
        let has_slot = mission.interpreter_slot.get() < self.tables.count(Section::Slots);
        mission.ensure(has_slot, Cause::Index)?;
        // What the machine takes is all there is.
        let machine = self.entry::<Container>(0, Cause::Template)?;
        machine.ensure(mission.flags == machine.flag_span, Cause::Template)?;
        self.checked[Section::Instances] = machine.instance_span.get();
        self.checked[Section::RegionInstances] = machine.region_span.get();
        self.checked[Section::TaskInstances] = machine.task_span.get();
        Ok(mission.record)
    }

    /// Checks channels: their events exist, and the words that their rows have.
    fn check_channels(&self, mission: &Mission) -> Result<(), Finding> {
        const WORD_BITS: usize = u32::BITS as usize;
        let regions = self.tables.count(Section::RegionInstances);
        let words = self.tables.count(Section::Listeners);
        for index in self.numbers(Section::Channels) {
            let channel = self.entry::<Channel>(index, Cause::Order)?;
            let event = usize::from(channel.event.get());
            let row_words = channel.region_words.get();
            let end = channel.first_region_word.get() + row_words;
            let row_end = channel.first_row_word.get() + row_words;
            let exists = event != format::PULSE.into()
                && event <= mission.events.get()
                && end <= regions.div_ceil(WORD_BITS)
                && row_end <= words;
            channel.ensure(exists, Cause::Index)?;
            // No bit of a row stands for what is behind the last region instance.
            if row_words != 0 && end > regions / WORD_BITS {
                let last = self.entry::<Listener>(row_end - 1, Cause::Range)?;
                let is_clear = last.regions.get() << (regions % WORD_BITS) == 0;
                last.ensure(is_clear, Cause::Range)?;
            }
        }
        Ok(())
    }

    /// Checks tasks: their texts stand one behind the other, and their groups exist.
    fn check_tasks(&mut self, mission: &Mission) -> Result<(), Finding> {
        let groups = mission.exclusive_groups.get();
        for index in self.numbers(Section::Tasks) {
            let task = self.entry::<Task>(index, Cause::Order)?;
            let in_order = task.text_start.get() == self.checked[Section::Signatures];
            task.ensure(in_order, Cause::Order)?;
            self.checked[Section::Signatures] += task.text_length.get();
            let exists = task.exclusive.index().is_none_or(|group| group < groups);
            task.ensure(exists, Cause::Range)?;
        }
        Ok(())
    }

    /// Checks that task instances have their connections one behind the other, as many as their
    /// tasks have data ports.
    fn check_task_instances(&mut self) -> Result<(), Finding> {
        for index in self.numbers(Section::TaskInstances) {
            let instance = self.entry::<TaskInstance>(index, Cause::Order)?;
            let first = instance.first_connection.get();
            instance.ensure(first == self.checked[Section::Connections], Cause::Order)?;
            let task_state = self.tables.record::<TaskState>(instance.task_state.get());
            let task = task_state.and_then(|it| self.tables.record::<Task>(it.task.get()));
            self.checked[Section::Connections] += task.map_or(0, |task| task.data.get());
        }
        Ok(())
    }

    /// Checks that connections lead to nets.
    fn check_connections(&self) -> Result<(), Finding> {
        let nets = self.tables.count(Section::Nets);
        for index in self.numbers(Section::Connections) {
            let connection = self.entry::<Connection>(index, Cause::Order)?;
            let exists = connection.net.index().is_none_or(|net| net < nets);
            connection.ensure(exists, Cause::Index)?;
        }
        Ok(())
    }

    /// Checks that nothing is missing or left over.
    fn check_ends(&self) -> Result<(), Finding> {
        for section in WHOLE {
            let checked = self.checked[section];
            if checked != self.tables.count(section) {
                return Err(Finding::new(section, checked, Cause::Order));
            }
        }
        Ok(())
    }
}
