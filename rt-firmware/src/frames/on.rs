//! A firmware with links: its two dispatchers.

use core::ops::Range;

use esm_core::frames::dispatcher_of;
use esm_core::layout::Frame;
use esm_core::tables::Tables;
use esm_link::frames::wire::Header;
use esm_link::message::FrameCounters;

use super::device::LinkDevice;
use super::limits::{FRAMES, LINKS, MAX_OCCURRENCES, NO_DISPATCHER, VALUES};
use super::table::{self, FrameEntry, FrameState, LinkEntry, NO_NET, Received, count};
use crate::declaration::ValueKind;
use crate::features::MISSIONS;
use crate::ports::{Executor, Registry};
use crate::received_value::ReceivedValue;

/// Memory for the links of each mission that is there, and for the values that they receive.
pub(crate) struct FrameMemory {
    frames: [[FrameEntry; FRAMES]; MISSIONS],
    values: [ReceivedValue; VALUES],
}

impl FrameMemory {
    pub(crate) const fn new() -> Self {
        FrameMemory {
            frames: [const { [const { FrameEntry::EMPTY }; FRAMES] }; MISSIONS],
            values: [const { ReceivedValue::EMPTY }; VALUES],
        }
    }

    /// The lists of each mission, and the values.
    pub(crate) fn split(&mut self) -> (impl Iterator<Item = FrameLists<'_>>, &mut [ReceivedValue]) {
        let lists = self.frames.iter_mut().map(|frames| FrameLists {
            frames,
            ..FrameLists::default()
        });
        (lists, &mut self.values)
    }
}

/// The flags of the task instances of a mission.
pub(crate) trait Flags {
    /// Whether a control flag of a task instance is set.
    fn flag(&self, instance: u16, flag: u16) -> bool;
    /// Sets or clears one.
    fn set_flag(&mut self, instance: u16, flag: u16, value: bool);
    /// The net of a data port.
    fn net(&self, instance: u16, port: u8) -> Option<usize>;
}

/// An activation of a dispatcher.
#[derive(Clone, Copy)]
pub(crate) struct Activation {
    /// The task instance.
    pub(crate) instance: u16,
    /// Whether its state was entered since the one before.
    pub(crate) is_fresh: bool,
    /// Nominal start on the robot's clock.
    pub(crate) robot_us: u64,
    /// Period and duration of its slot.
    pub(crate) period_us: u32,
    pub(crate) duration_us: u32,
}

/// What is kept for the links of a mission.
#[derive(Default)]
pub(crate) struct FrameLists<'m> {
    links: [LinkEntry; LINKS],
    frames: &'m mut [FrameEntry],
    count: usize,
    /// Where the time of the mission's slots begins, on the robot's clock.
    origin_us: u64,
}

impl FrameLists<'_> {
    /// Finds what is to be kept for the links of a mission that was [checked](super::check()).
    pub(crate) fn prepare(&mut self, tables: &Tables<'_>, registry: Registry<'_>) {
        self.count = table::prepare(tables, registry, &mut self.links, self.frames);
    }

    /// The dispatcher that a task of the mission is, or [`NO_DISPATCHER`].
    pub(crate) fn dispatcher(&self, tables: &Tables<'_>, task: usize) -> u8 {
        match dispatcher_of(tables, task) {
            Some((link, is_received)) => 2 * link as u8 + u8::from(is_received),
            None => NO_DISPATCHER,
        }
    }

    /// The mission starts: all dispatchers begin anew.
    pub(crate) fn begin_anew(&mut self) {
        for frame in self.frames.iter_mut().take(self.count) {
            frame.state = FrameState::NEW;
        }
        for link in &mut self.links {
            (link.has_errors, link.has_news) = (false, false);
            (link.error_count, link.dropped_count) = (0, 0);
        }
    }

    /// The mission takes over at a time from another with these lists, and its slots count from
    /// `origin_us` on. Links that are declared in the same way go on.
    pub(crate) fn begin(&mut self, before: Option<&FrameLists<'_>>, origin_us: u64, robot_us: u64) {
        self.begin_anew();
        self.origin_us = origin_us;
        let Some(before) = before else { return };
        for (link, other) in self.links.iter_mut().zip(&before.links) {
            let others = slice(before.frames, all_of(other));
            let own = self.frames.get_mut(range(all_of(link)));
            let own = own.unwrap_or_default();
            let is_same = link.times == other.times
                && own.len() == others.len()
                && own
                    .iter()
                    .zip(others)
                    .all(|(own, other)| own.is_same(other));
            if is_same {
                for (own, other) in own.iter_mut().zip(others) {
                    own.state.clone_from(&other.state);
                }
                (link.error_count, link.dropped_count) = (other.error_count, other.dropped_count);
            } else {
                // A state that goes on receives from here on, and nothing is late yet.
                (link.entered_us, link.listens_us) = (robot_us, robot_us);
                for own in own {
                    own.state = FrameState {
                        at_us: robot_us.into(),
                        ..FrameState::NEW
                    };
                }
            }
        }
    }

    /// Lists of one link, for tests.
    #[cfg(test)]
    pub(super) fn of(link: LinkEntry, frames: &mut [FrameEntry]) -> FrameLists<'_> {
        let count = frames.len();
        let mut links = [LinkEntry::default(); LINKS];
        links[0] = link;
        FrameLists {
            links,
            frames,
            count,
            origin_us: 0,
        }
    }

    /// Number of the last occurrence of a frame that was received.
    #[cfg(test)]
    pub(super) fn last_number(&self, frame: usize) -> Option<u8> {
        self.frames[frame].state.occurrences.get().last()
    }

    /// What was counted of a frame of the mission, and of its link.
    pub(crate) fn counters(&self, tables: &Tables<'_>, frame: usize) -> Option<FrameCounters> {
        let record = tables.frames().get(frame)?;
        self.counters_of(record.link.get(), record.is_received(), record.identifier())
    }

    /// The same of a frame of a link. No two of a link in one direction have the same identifier.
    pub(super) fn counters_of(
        &self,
        link: usize,
        is_received: bool,
        identifier: u16,
    ) -> Option<FrameCounters> {
        let link = self.links.get(link)?;
        let of_link = match is_received {
            true => link.received,
            false => link.sent,
        };
        let is_it =
            |entry: &&FrameEntry| entry.record.as_ref().map(Frame::identifier) == Some(identifier);
        let FrameState {
            occurrences,
            passed,
            unsent,
            older,
            ..
        } = &slice(self.frames, of_link).iter().find(is_it)?.state;
        let occurrences = occurrences.get();
        Some(FrameCounters {
            passed: passed.get(),
            missing: occurrences.missing().saturating_add(unsent.get()),
            repeated: occurrences.repeated(),
            older: older.get(),
            link_errors: link.error_count,
            link_dropped: link.dropped_count,
        })
    }

    /// The device that serves a dispatcher.
    pub(crate) fn device_of(dispatcher: u8) -> usize {
        usize::from(dispatcher / 2)
    }

    /// The kind of the values on a data port of a dispatcher.
    pub(crate) fn kind(&self, dispatcher: u8, port: usize) -> Option<ValueKind> {
        let link = self.links.get(Self::device_of(dispatcher))?;
        let of_it = match dispatcher.is_multiple_of(2) {
            true => link.sent,
            false => link.received,
        };
        let mut frames = slice(self.frames, of_it).iter();
        let frame = frames.find(|frame| frame.kind.is_some() && usize::from(frame.port) == port)?;
        frame.kind
    }

    /// The state of a dispatcher was entered in a macro step at this time.
    pub(crate) fn enter(&mut self, dispatcher: u8, robot_us: u64) {
        if let Some(link) = self.receiver(dispatcher) {
            // What came while another state received is not lost.
            if link.left_us != Some(robot_us) {
                link.listens_us = robot_us;
            }
            link.entered_us = robot_us;
        }
    }

    /// It was left.
    pub(crate) fn leave(&mut self, dispatcher: u8, robot_us: u64) {
        if let Some(link) = self.receiver(dispatcher) {
            link.left_us = Some(robot_us);
        }
    }

    /// The link of a dispatcher, if that receives.
    fn receiver(&mut self, dispatcher: u8) -> Option<&mut LinkEntry> {
        let link = self.links.get_mut(Self::device_of(dispatcher));
        link.filter(|_| dispatcher % 2 == 1)
    }

    /// Executes a dispatcher once.
    pub(crate) fn run(
        &mut self,
        dispatcher: u8,
        at: &Activation,
        mut device: Option<&mut (dyn LinkDevice + '_)>,
        executor: &mut Executor<'_>,
        flags: &mut impl Flags,
    ) {
        let origin_us = self.origin_us;
        let Some(link) = self.links.get_mut(Self::device_of(dispatcher)) else {
            return;
        };
        if at.is_fresh
            && let Some(device) = &mut device
        {
            device.set_rate(link.times.0);
        }
        if dispatcher.is_multiple_of(2) {
            let sent = slice(self.frames, link.sent);
            bind(&mut link.sender, sent, at.instance, flags);
            transmit(sent, origin_us, at, device, executor, flags);
        } else {
            let received = slice(self.frames, link.received);
            bind(&mut link.receiver, received, at.instance, flags);
            receive(link, received, at, device, executor, flags);
        }
    }

    /// A macro step has seen all flags that are true for one: they are cleared.
    pub(crate) fn clear_seen(&mut self, flags: &mut impl Flags) {
        for link in self.links.iter_mut().filter(|link| link.has_news) {
            link.has_news = false;
            let Some(receiver) = link.receiver else {
                continue;
            };
            if core::mem::take(&mut link.has_errors) {
                flags.set_flag(receiver, link.errors, false);
            }
            for frame in slice(self.frames, link.received) {
                if frame.state.is_available.replace(false) {
                    flags.set_flag(receiver, frame.by_itself, false);
                }
            }
        }
    }
}

fn range(range: (u16, u16)) -> Range<usize> {
    range.0.into()..range.1.into()
}

fn slice(frames: &[FrameEntry], of: (u16, u16)) -> &[FrameEntry] {
    frames.get(range(of)).unwrap_or_default()
}

/// All frames of a link.
fn all_of(link: &LinkEntry) -> (u16, u16) {
    (link.sent.0, link.received.1.max(link.sent.1))
}

/// Finds the nets of a dispatcher's frames, where they are not known for this task instance.
#[inline(always)]
fn bind(known: &mut Option<u16>, frames: &[FrameEntry], instance: u16, flags: &impl Flags) {
    if *known == Some(instance) {
        return;
    }
    *known = Some(instance);
    for frame in frames {
        let net = flags.net(instance, frame.port);
        let net = net.and_then(|net| u16::try_from(net).ok());
        frame.net.set(net.unwrap_or(NO_NET));
    }
}

/// Hands over the frames whose starts come between the nominal end of this activation and that of
/// the next: this is the last one that ends by their starts.
fn transmit(
    sent: &[FrameEntry],
    origin_us: u64,
    at: &Activation,
    mut device: Option<&mut (dyn LinkDevice + '_)>,
    executor: &Executor<'_>,
    flags: &mut impl Flags,
) {
    let end_us = at.robot_us + u64::from(at.duration_us);
    let until_us = end_us + u64::from(at.period_us.max(1));
    for frame in sent {
        let (Some(record), Some(configuration)) = (&frame.record, frame.configuration) else {
            continue;
        };
        let state = &frame.state;
        let period_us = u64::from(record.period_us.get().max(1));
        let mut at_us = state.at_us.get();
        // As a rule the activation before has left off here.
        if at.is_fresh || at_us < end_us || at_us >= end_us + period_us {
            let first_us = origin_us + u64::from(record.start_us.get());
            let number = end_us.saturating_sub(first_us).div_ceil(period_us);
            at_us = first_us + number * period_us;
            state.at_us.set(at_us);
            state.number.set(number as u8);
        }
        if at_us >= until_us {
            continue;
        }
        let flag_count = record.flags.get() as u16;
        let value = match flag_count {
            0 => executor.value_to_send(frame.net.get().into()),
            _ => None,
        };
        let has_payload = flag_count > 0 || value.is_some();
        let mut number = state.number.get();
        let mut left = MAX_OCCURRENCES;
        while at_us < until_us {
            let header = Header {
                identifier: record.identifier(),
                number,
                configuration,
            };
            let mut write = |payload: &mut [u8]| match &value {
                Some(value) => value.put(payload),
                None => put_flags(flags, at.instance, frame.carried, flag_count, payload),
            };
            let is_sent = match &mut device {
                Some(device) if has_payload && left > 0 => {
                    device.send(at_us, header, record.payload.get(), &mut write)
                }
                _ => false,
            };
            left = left.saturating_sub(1);
            // Nobody sends what has no value, and nothing is wrong with that.
            let is_full = has_payload && !is_sent;
            if has_payload && state.is_full.replace(is_full) != is_full {
                flags.set_flag(at.instance, frame.by_itself, is_full);
            }
            if !is_sent {
                // Those behind it find no room, either, or have no value.
                let rest = (until_us - at_us).div_ceil(period_us);
                if has_payload {
                    count(&state.unsent, rest.try_into().unwrap_or(u32::MAX));
                }
                at_us += rest * period_us;
                number = number.wrapping_add(rest as u8);
                break;
            }
            count(&state.passed, 1);
            at_us += period_us;
            number = number.wrapping_add(1);
        }
        state.at_us.set(at_us);
        state.number.set(number);
    }
    if let Some(device) = device {
        device.start_sending();
    }
}

/// Writes flags into a payload, the first in the lowest bit of the first byte.
fn put_flags(flags: &impl Flags, instance: u16, first: u16, count: u16, payload: &mut [u8]) {
    payload.fill(0);
    for flag in 0..count {
        if flags.flag(instance, first + flag)
            && let Some(byte) = payload.get_mut(usize::from(flag / 8))
        {
            *byte |= 1 << (flag % 8);
        }
    }
}

/// Takes what has arrived by the nominal start of this activation.
fn receive(
    link: &mut LinkEntry,
    received: &[FrameEntry],
    at: &Activation,
    device: Option<&mut (dyn LinkDevice + '_)>,
    executor: &mut Executor<'_>,
    flags: &mut impl Flags,
) {
    if at.is_fresh {
        // Entering has cleared all flags.
        (link.has_errors, link.has_news) = (false, false);
        for FrameEntry { state, .. } in received {
            state.at_us.set(link.entered_us);
            for mark in [&state.has_come, &state.is_available, &state.is_delayed] {
                mark.set(false);
            }
        }
    }
    if let Some(device) = device {
        let listens_us = link.listens_us;
        device.receive(
            at.robot_us,
            &Received(received),
            &mut |arrived, arrived_us| {
                if arrived_us <= listens_us {
                    // No state was there to receive it.
                    link.dropped_count = link.dropped_count.saturating_add(1);
                    return;
                }
                let Ok(arrived) = arrived else {
                    link.has_errors = true;
                    link.error_count = link.error_count.saturating_add(1);
                    return;
                };
                let Some(frame) = received.get(arrived.index) else {
                    return;
                };
                let state = &frame.state;
                let mut occurrences = state.occurrences.get();
                // Where no number repeats, nobody asks.
                let is_delayed = occurrences.last() == Some(arrived.number)
                    && (state.is_delayed.get() || is_late(frame, at.robot_us));
                let is_used = occurrences.take(arrived.number, is_delayed);
                state.occurrences.set(occurrences);
                if !is_used {
                    return;
                }
                count(&state.passed, 1);
                if state.has_come.replace(true) {
                    count(&state.older, 1);
                }
                match frame.kind {
                    Some(kind) => {
                        let net = frame.net.get().into();
                        executor.take_value(net, kind, arrived.payload, at.robot_us);
                    }
                    None => take_flags(flags, at.instance, frame, arrived.payload),
                }
            },
        );
    }
    if link.has_errors {
        link.has_news = true;
        flags.set_flag(at.instance, link.errors, true);
    }
    for frame in received {
        let state = &frame.state;
        let is_delayed = if state.has_come.replace(false) {
            state.at_us.set(at.robot_us);
            state.is_available.set(true);
            link.has_news = true;
            flags.set_flag(at.instance, frame.by_itself, true);
            false
        } else {
            state.is_delayed.get() || is_late(frame, at.robot_us)
        };
        if state.is_delayed.replace(is_delayed) != is_delayed {
            flags.set_flag(at.instance, frame.by_itself + 1, is_delayed);
        }
    }
}

/// Sets and clears the flags that a frame carries.
fn take_flags(flags: &mut impl Flags, instance: u16, frame: &FrameEntry, payload: &[u8]) {
    let count = frame.record.map_or(0, |record| record.flags.get());
    for flag in 0..count as u16 {
        let byte = payload.get(usize::from(flag / 8)).copied().unwrap_or(0);
        let is_set = byte >> (flag % 8) & 1 != 0;
        flags.set_flag(instance, frame.carried + flag, is_set);
    }
}

/// Whether none came for longer than may be.
#[inline(always)]
fn is_late(frame: &FrameEntry, robot_us: u64) -> bool {
    let late_us = frame.record.as_ref().map_or(0, |record| record.late_us());
    robot_us.saturating_sub(frame.state.at_us.get()) > late_us
}
