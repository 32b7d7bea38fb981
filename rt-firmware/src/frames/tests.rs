//! What dispatchers send and when, what they publish and say.
#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

use std::boxed::Box;
use std::collections::{BTreeMap, VecDeque};
use std::format;
use std::string::String;
use std::vec;
use std::vec::Vec;

use esm_core::format::FRAME_IS_RECEIVED;
use esm_core::layout::{Frame, Short};
use esm_link::frames::configuration::{Configuration, Content};
use esm_link::frames::receiver::{InFrames, Receiver};
use esm_link::frames::wire::{self, Header, MAX_WIRE_BYTES};
use esm_link::message::FrameCounters;

use super::device::{LinkDevice, Taken};
use super::on::{Activation, Flags, FrameLists};
use super::table::{FrameEntry, LinkEntry};
use crate::declaration::{PortType, ValueKind};
use crate::features::MISSIONS;
use crate::ports::{AnyTaskPool, Buffered, Executor, Net, assemble};
use crate::received_value::ReceivedValue;

const NETS: usize = 4;

fn executor() -> Executor<'static> {
    let banks: &'static mut [&'static mut (dyn AnyTaskPool + 'static)] = &mut [];
    let nets = Box::leak(Box::new([[Net::EMPTY; NETS]; MISSIONS]));
    let (executor, _) = assemble(banks, nets).unwrap();
    executor.with_received(Box::leak(Box::new([const { ReceivedValue::EMPTY }; 2])))
}

fn publish<V: PortType>(executor: &mut Executor<'static>, net: usize, value: V) {
    executor.inject(net, value, Box::leak(Box::new(Buffered::<V>::EMPTY)));
}

/// The payload that a frame of the value on a net would have.
fn value_on(executor: &Executor<'_>, net: usize) -> Option<u32> {
    let mut payload = [0; 4];
    executor.value_to_send(net)?.put(&mut payload);
    Some(u32::from_le_bytes(payload))
}

/// Flags of one task instance, whose data port *n* is on net *n*.
#[derive(Default)]
struct Board {
    flags: BTreeMap<u16, bool>,
}

impl Board {
    /// The flags that are set.
    fn set(&self) -> Vec<u16> {
        let set = self.flags.iter().filter(|(_, value)| **value);
        set.map(|(flag, _)| *flag).collect()
    }
}

impl Flags for Board {
    fn flag(&self, _instance: u16, flag: u16) -> bool {
        self.flags.get(&flag).copied().unwrap_or(false)
    }
    fn set_flag(&mut self, _instance: u16, flag: u16, value: bool) {
        self.flags.insert(flag, value);
    }
    fn net(&self, _instance: u16, port: u8) -> Option<usize> {
        Some(port.into())
    }
}

/// A line that keeps what is put on it, and gives what is put into it, both as bytes.
#[derive(Default)]
struct Line {
    sent: Vec<(u64, Header, Vec<u8>)>,
    /// How many frames still find room.
    room: usize,
    arriving: VecDeque<(u64, Vec<u8>)>,
}

impl Line {
    /// What was sent, as start, number, payload.
    fn taken(&mut self) -> Vec<(u64, u8, Vec<u8>)> {
        let sent = std::mem::take(&mut self.sent).into_iter();
        sent.map(|(start_us, header, payload)| (start_us, header.number, payload))
            .collect()
    }

    fn arrives(&mut self, at_us: u64, header: Header, payload: &[u8]) {
        let mut bytes = [0; MAX_WIRE_BYTES];
        let length = wire::encode(header, payload, &mut bytes).unwrap();
        self.arriving.push_back((at_us, bytes[..length].to_vec()));
    }
}

impl LinkDevice for Line {
    fn send(
        &mut self,
        start_us: u64,
        header: Header,
        payload_bytes: usize,
        write: &mut dyn FnMut(&mut [u8]),
    ) -> bool {
        if self.room == 0 {
            return false;
        }
        self.room -= 1;
        let mut payload = vec![0; payload_bytes];
        write(&mut payload);
        self.sent.push((start_us, header, payload));
        true
    }

    fn receive(&mut self, until_us: u64, frames: &dyn InFrames, take: Taken<'_>) {
        let mut receiver = Receiver::new();
        while let Some((at_us, bytes)) = self.arriving.pop_front_if(|(at_us, _)| *at_us <= until_us)
        {
            let mut bytes = &bytes[..];
            while let Some(arrived) = receiver.take(&mut bytes, frames) {
                take(arrived, at_us);
            }
        }
    }
}

const POSE: Content<'_> = Content::Value("u32");

/// A frame with this identifier and these times.
fn frame(id: u16, content: Content<'_>, period_us: u32, start_us: u32, late_us: u32) -> FrameEntry {
    let (payload, flags) = match content {
        Content::Value(_) => (4, 0),
        Content::Flags(count) => (2, count),
    };
    let configuration = Configuration::of(id & !FRAME_IS_RECEIVED, content, payload, period_us);
    FrameEntry {
        record: Some(Frame {
            configuration: configuration.hash().into(),
            period_us: period_us.into(),
            start_us: start_us.into(),
            late_us: late_us.into(),
            id: id.into(),
            link: Short::new(0),
            payload: Short::new(payload.into()),
            flags: Short::new(flags.into()),
        }),
        configuration: Some(configuration),
        kind: (flags == 0).then(ValueKind::of::<u32>),
        ..FrameEntry::EMPTY
    }
}

fn header(of: &FrameEntry, number: u8) -> Header {
    Header {
        identifier: of.record.unwrap().identifier(),
        number,
        configuration: of.configuration.unwrap(),
    }
}

/// Lists of one link with these frames, and its dispatcher: 0 sends, 1 receives.
fn lists(frames: Vec<FrameEntry>, is_received: bool) -> FrameLists<'static> {
    let count = frames.len();
    let all = (0, count as u16);
    let mut link = LinkEntry::default();
    if is_received {
        (link.sent, link.received) = ((0, 0), all);
        link.errors = 100;
    } else {
        (link.sent, link.received) = (all, (all.1, all.1));
    }
    FrameLists::of(link, Box::leak(frames.into_boxed_slice()))
}

fn at(robot_us: u64, is_fresh: bool) -> Activation {
    Activation {
        instance: 0,
        is_fresh,
        robot_us,
        period_us: 20_000,
        duration_us: 1_000,
    }
}

#[test]
fn a_frame_carries_what_was_there_at_the_last_activation_that_ends_by_its_start() {
    // At 21 ms the activation of 20 ms has ended just by then; at 20.9 ms that of 0 is the last.
    for (start_us, expected_us) in [
        (1_000, vec![0, 40_000, 80_000]),
        (900, vec![20_000, 60_000]),
    ] {
        let mut sent = lists(vec![frame(3, POSE, 40_000, start_us, 0)], false);
        let (mut executor, mut board) = (executor(), Board::default());
        let mut line = Line {
            room: 100,
            ..Line::default()
        };
        let mut sampled = Vec::new();
        for step in 0..5_u32 {
            publish(&mut executor, 0, step);
            let robot_us = u64::from(step) * 20_000;
            let at = at(robot_us, step == 0);
            sent.run(0, &at, Some(&mut line), &mut executor, &mut board);
            for (at_us, number, payload) in line.taken() {
                assert_eq!(u64::from(start_us) + u64::from(number) * 40_000, at_us);
                assert_eq!(payload, step.to_le_bytes());
                sampled.push(robot_us);
            }
        }
        assert_eq!(sampled, expected_us, "{start_us}");
        assert_eq!(board.set(), [0_u16; 0]);
    }
}

#[test]
fn occurrences_that_were_not_sent_are_counted_all_the_same() {
    let mut sent = lists(vec![frame(3, POSE, 10_000, 5_000, 0)], false);
    let (mut executor, mut board) = (executor(), Board::default());
    let mut line = Line {
        room: 100,
        ..Line::default()
    };
    let mut numbers = |executor: &mut Executor<'static>, robot_us, is_fresh| {
        let at = at(robot_us, is_fresh);
        sent.run(0, &at, Some(&mut line), executor, &mut board);
        let taken = line.taken();
        taken
            .into_iter()
            .map(|(at_us, number, _)| (at_us, number))
            .collect::<Vec<_>>()
    };
    // Without a value nothing is sent, and nothing is wrong.
    assert_eq!(numbers(&mut executor, 0, true), []);
    publish(&mut executor, 0, 1_u32);
    let second = numbers(&mut executor, 20_000, false);
    assert_eq!(second, [(25_000, 2), (35_000, 3)]);
    // The state was left for a while: 256 occurrences and some.
    let later = numbers(&mut executor, 2_620_000, true);
    assert_eq!(later, [(2_625_000, 6), (2_635_000, 7)]);
    assert_eq!(board.set(), [0_u16; 0]);
}

#[test]
fn a_full_device_is_told_until_a_frame_finds_room() {
    let mut sent = lists(vec![frame(3, POSE, 10_000, 5_000, 0)], false);
    let (mut executor, mut board) = (executor(), Board::default());
    publish(&mut executor, 0, 1_u32);
    let mut line = Line {
        room: 1,
        ..Line::default()
    };
    sent.run(0, &at(0, true), Some(&mut line), &mut executor, &mut board);
    assert_eq!((line.taken().len(), board.set()), (1, vec![0]));
    sent.run(0, &at(20_000, false), None, &mut executor, &mut board);
    assert_eq!(board.set(), [0]);
    line.room = 5;
    let next = at(40_000, false);
    sent.run(0, &next, Some(&mut line), &mut executor, &mut board);
    let taken = line.taken();
    assert_eq!((taken[0].0, taken[0].1), (45_000, 4));
    assert_eq!((taken.len(), board.set()), (2, vec![]));
    let counters = FrameCounters {
        passed: 3,
        missing: 3,
        ..FrameCounters::default()
    };
    assert_eq!(sent.counters_of(0, false, 3), Some(counters));
    assert_eq!(sent.counters_of(0, true, 3), None);
}

#[test]
fn a_period_that_is_too_short_for_the_slot_is_told_and_takes_no_time_without_end() {
    let mut sent = lists(vec![frame(3, POSE, 1, 0, 0)], false);
    let (mut executor, mut board) = (executor(), Board::default());
    publish(&mut executor, 0, 1_u32);
    let mut line = Line {
        room: usize::MAX,
        ..Line::default()
    };
    let longest = Activation {
        period_us: 4_000_000_000,
        ..at(0, true)
    };
    sent.run(0, &longest, Some(&mut line), &mut executor, &mut board);
    let taken = line.taken();
    assert_eq!((taken.len(), taken[31].0), (32, 1_031));
    assert_eq!(board.set(), [0]);
}

#[test]
fn flags_travel_the_first_in_the_lowest_bit() {
    let entry = |id| FrameEntry {
        carried: 0,
        by_itself: 10,
        ..frame(id, Content::Flags(10), 20_000, 2_000, 0)
    };
    let (mut executor, mut board) = (executor(), Board::default());
    for flag in [0, 3, 9] {
        board.set_flag(0, flag, true);
    }
    let mut line = Line {
        room: 1,
        ..Line::default()
    };
    let mut sent = lists(vec![entry(3)], false);
    sent.run(0, &at(0, true), Some(&mut line), &mut executor, &mut board);
    let payload = line.taken()[0].2.clone();
    assert_eq!(payload, [0b0000_1001, 0b10]);

    let other = entry(3 | FRAME_IS_RECEIVED);
    line.arrives(5, header(&other, 0), &payload);
    let mut received = lists(vec![other], true);
    let mut board = Board::default();
    board.set_flag(0, 1, true);
    let run = at(20_000, true);
    received.run(1, &run, Some(&mut line), &mut executor, &mut board);
    assert_eq!(board.set(), [0, 3, 9, 10]);
}

/// What a receiver is shown, and what must be said then.
#[test]
fn what_comes_is_published_and_told_for_one_macro_step() {
    let first = frame(3 | FRAME_IS_RECEIVED, POSE, 20_000, 0, 0);
    let entry = FrameEntry {
        by_itself: 0,
        ..first.clone()
    };
    let mut received = lists(vec![entry], true);
    let (mut executor, mut board) = (executor(), Board::default());
    let mut line = Line::default();
    let other = frame(3, POSE, 30_000, 0, 0);
    let mut spoiled = [0; MAX_WIRE_BYTES];
    let length = wire::encode(header(&first, 7), &9_u32.to_le_bytes(), &mut spoiled).unwrap();
    spoiled[6] ^= 0x40;
    // The state is entered at 10 ms; late is what is older than three periods.
    received.enter(1, 10_000);
    line.arrives(9_999, header(&first, 1), &1_u32.to_le_bytes());
    line.arrives(15_000, header(&first, 2), &2_u32.to_le_bytes());
    line.arrives(16_000, header(&first, 3), &3_u32.to_le_bytes());
    line.arrives(35_000, header(&first, 3), &4_u32.to_le_bytes());
    line.arrives(36_000, header(&other, 4), &5_u32.to_le_bytes());
    line.arrives(55_000, header(&first, 4), &6_u32.to_le_bytes());
    line.arriving
        .push_back((56_000, spoiled[..length].to_vec()));
    line.arrives(135_000, header(&first, 4), &8_u32.to_le_bytes());
    // Time of the activation; value on the net; flags before and after the macro step behind it:
    // 0 available, 1 delayed, 100 errors.
    type Case<'c> = (u64, Option<u32>, &'c [u16], &'c [u16]);
    let cases: [Case<'_>; 8] = [
        (20_000, Some(3), &[0], &[]),
        // A repetition, and a frame of another configuration.
        (40_000, Some(3), &[100], &[]),
        (60_000, Some(6), &[0, 100], &[]),
        (80_000, Some(6), &[], &[]),
        (100_000, Some(6), &[], &[]),
        // 60 ms are not too long, and more are.
        (120_000, Some(6), &[], &[]),
        (120_001, Some(6), &[1], &[1]),
        // A number that repeats counts where the frame is delayed.
        (140_000, Some(8), &[0], &[]),
    ];
    for (robot_us, value, before, after) in cases {
        let run = at(robot_us, robot_us == 20_000);
        received.run(1, &run, Some(&mut line), &mut executor, &mut board);
        assert_eq!(value_on(&executor, 0), value, "{robot_us}");
        assert_eq!(board.set(), before, "{robot_us}");
        received.clear_seen(&mut board);
        assert_eq!(board.set(), after, "{robot_us}");
    }
    let counters = FrameCounters {
        passed: 4,
        // The last number again: all others between were lost.
        missing: 255,
        repeated: 1,
        older: 1,
        link_errors: 2,
        link_dropped: 1,
    };
    assert_eq!(received.counters_of(0, true, 3), Some(counters));
}

#[test]
fn what_comes_between_two_states_that_receive_is_not_lost() {
    let entry = || frame(3 | FRAME_IS_RECEIVED, POSE, 20_000, 0, 0);
    // When the one was left and the other entered, and whether what comes at 15 ms is taken.
    for (left_us, entered_us, is_taken) in [(20_000, 20_000, true), (10_000, 20_000, false)] {
        let mut received = lists(vec![entry()], true);
        let (mut executor, mut board) = (executor(), Board::default());
        let mut line = Line::default();
        received.enter(1, 0);
        let first = at(1_000, true);
        received.run(1, &first, Some(&mut line), &mut executor, &mut board);
        line.arrives(15_000, header(&entry(), 1), &1_u32.to_le_bytes());
        received.leave(1, left_us);
        received.enter(1, entered_us);
        let second = at(21_000, true);
        received.run(1, &second, Some(&mut line), &mut executor, &mut board);
        assert_eq!(value_on(&executor, 0), is_taken.then_some(1), "{left_us}");
    }
}

#[test]
fn a_link_that_another_mission_declares_in_the_same_way_goes_on() {
    let entries = || vec![frame(3 | FRAME_IS_RECEIVED, POSE, 20_000, 0, 0)];
    let mut before = lists(entries(), true);
    let (mut executor, mut board) = (executor(), Board::default());
    let mut line = Line::default();
    line.arrives(5, header(&entries()[0], 9), &1_u32.to_le_bytes());
    let run = at(20_000, true);
    before.run(1, &run, Some(&mut line), &mut executor, &mut board);
    board = Board::default();
    for (late_us, goes_on) in [(0, true), (50_000, false)] {
        let frames = vec![frame(3 | FRAME_IS_RECEIVED, POSE, 20_000, 0, late_us)];
        let mut after = lists(frames, true);
        after.begin(Some(&before), 0, 100_000);
        let last = after.last_number(0);
        assert_eq!(last, goes_on.then_some(9), "{late_us}");
        let counted = after.counters_of(0, true, 3).map(|counted| counted.passed);
        assert_eq!(counted, Some(u32::from(goes_on)), "{late_us}");
        // The state goes on. One that begins anew waits from here on, for what comes from here on.
        let mut line = Line::default();
        line.arrives(99_999, header(&entries()[0], 10), &7_u32.to_le_bytes());
        for (robot_us, flags) in [
            (101_000, if goes_on { &[0][..] } else { &[] }),
            (150_000, &[]),
            (150_001, if goes_on { &[] } else { &[1][..] }),
        ] {
            let run = at(robot_us, false);
            after.run(1, &run, Some(&mut line), &mut executor, &mut board);
            assert_eq!(board.set(), flags, "{late_us} {robot_us}");
            after.clear_seen(&mut board);
        }
        board = Board::default();
    }
}

#[test]
fn values_find_a_place_as_long_as_there_is_one() {
    let (mut executor, kind) = (executor(), ValueKind::of::<u32>());
    let mut said = String::new();
    // Two places, three nets: one that is written again keeps its own.
    for (net, value) in [(0, 1_u32), (1, 2), (0, 3), (2, 4), (1, 5)] {
        let taken = executor.take_value(net, kind, &value.to_le_bytes(), 0);
        said += &format!("{net} {taken} {:?}; ", value_on(&executor, net));
    }
    assert_eq!(
        said,
        "0 true Some(1); 1 true Some(2); 0 true Some(3); 2 false None; 1 true Some(5); "
    );
    executor.empty(0);
    assert!(executor.take_value(2, kind, &7_u32.to_le_bytes(), 0));
    assert_eq!(value_on(&executor, 2), Some(7));
    assert_eq!(value_on(&executor, 1), Some(5));
    assert!(!executor.take_value(2, kind, &[1, 2, 3], 0), "too short");
}
