use std::collections::VecDeque;
use std::fmt::Write as _;
use std::time::Duration;

use esm_link::frame::{FrameReader, MAX_FRAME_BYTES, checksum, decode, encode};
use esm_link::message::{
    Capacities, Capacity, FromDevice, LinkError, MAX_CHUNK, Request, Swap, ToDevice,
};
use rt_firmware::{
    About, Io, Limits, LinkPort, Mailbox, Memory, Step, Task, TaskPool, registry, split, task,
};

use super::*;
use crate::boards;
use crate::lang::load_text;

// ─── A robot with little room ────────────────────────────────────────────────────────────────────

const BLOB_BYTES: usize = 4_000;
const ARENA_WORDS: usize = 40;
const SLOTS: usize = 3;
const TASKS: usize = 8;
const NETS: usize = 2;
const GROUPS: usize = 2;

const SMALL: Board = Board {
    name: "small",
    description: "little room",
    capacities: Capacities {
        blob_bytes: BLOB_BYTES as u32,
        arena_words: ARENA_WORDS as u32,
        slots: SLOTS as u16,
        task_instances: TASKS as u16,
        nets: NETS as u16,
        exclusive_groups: GROUPS as u16,
    },
    firmware: None,
    flashing: None,
    links: None,
    interpreter: None,
};

struct Give;
task! { impl Give { data { out value: u32; } } }
impl Task for Give {
    fn step(&mut self, io: &mut Io<'_>) -> Step {
        *io.write(Self::VALUE) = 1;
        Step::Run
    }
}

struct Take;
task! { impl Take { data { in value: u32; } } }
impl Task for Take {
    fn step(&mut self, _: &mut Io<'_>) -> Step {
        Step::Run
    }
}

struct Rest;
task! { impl Rest { } }
impl Task for Rest {
    fn step(&mut self, _: &mut Io<'_>) -> Step {
        Step::Run
    }
}

registry! {
    /// Room for more tasks of each type than the board has for all.
    struct Toy {
        give: Give[12],
        take: Take[12],
        rest: Rest[12],
    }
}

struct Timer(u64);
impl rt_firmware::Board for Timer {
    const TICKS_PER_US: u32 = 1;
    fn now_ticks(&mut self) -> u64 {
        self.0
    }
    fn motors_off(&mut self) {}
}

#[derive(Default)]
struct Wire {
    to_robot: VecDeque<u8>,
    to_host: VecDeque<u8>,
}
impl LinkPort for Wire {
    // Nothing here has a deadline.
    fn now_us(&mut self) -> u64 {
        0
    }

    fn receive(&mut self) -> Option<u8> {
        self.to_robot.pop_front()
    }
    fn send(&mut self, byte: u8) -> bool {
        self.to_host.push_back(byte);
        true
    }
}

/// Uploads a blob to a robot that has just started; gives its refusal.
fn upload(blob: &[u8]) -> Result<(), LinkError> {
    let mut toy = Toy {
        give: TaskPool::new([const { Give }; 12]),
        take: TaskPool::new([const { Take }; 12]),
        rest: TaskPool::new([const { Rest }; 12]),
    };
    let mut banks = toy.banks();
    let mut memory = Memory::<BLOB_BYTES, ARENA_WORDS, SLOTS, TASKS, NETS, GROUPS, 512>::new();
    let mut mail = Mailbox::new();
    let about = About::new("toy 0.1", "small");
    let (mut real_time, _, mut link) =
        split(&mut memory, &mut banks, &mut mail, about, Limits::default()).unwrap();
    let (mut timer, mut wire, mut reader) = (Timer(0), Wire::default(), FrameReader::new());
    let mut seq = 0;
    let mut ask = |request: Request<'_>| -> Result<(), LinkError> {
        seq += 1;
        let mut frame = [0; MAX_FRAME_BYTES];
        let len = encode(&ToDevice { seq, request }, &mut frame).unwrap();
        wire.to_robot.extend(&frame[..len]);
        for _ in 0..1_000 {
            while link.poll(&mut wire) {}
            while let Some(byte) = wire.to_host.pop_front() {
                if let Some(frame) = reader.push(byte)
                    && let Ok(FromDevice::Reply { result, .. }) = decode(frame)
                {
                    return result.map(drop);
                }
            }
            timer.0 = real_time.on_timer(&mut timer);
        }
        panic!("no answer to {request:?}");
    };
    ask(Request::Begin {
        len: blob.len() as u32,
        crc: checksum(blob),
    })?;
    for (part, data) in blob.chunks(MAX_CHUNK).enumerate() {
        let offset = (part * MAX_CHUNK) as u32;
        ask(Request::Chunk { offset, data })?;
    }
    ask(Request::Commit(Swap::default()))
}

// ─── Missions of every size ──────────────────────────────────────────────────────────────────────

/// A mission of a size.
type Mission = fn(usize) -> String;

const HEAD: &str = "interpreter slot 1; queue 4; slot 1 period 10 ms duration 1 ms;\n";
const TASKS_OF_THE_ROBOT: &str = "task Give slot 1 exclusive a { out data value: u32; }\n\
     task Take slot 1 exclusive b { in data value: u32; }\ntask Rest slot 1 exclusive c { }\n";

fn with_slots(count: usize) -> String {
    let mut text = HEAD.to_owned();
    for number in 2..=count {
        let _ = writeln!(text, "slot {number} period 10 ms duration 1 ms;");
    }
    text + "machine M { region r { state A; initial -> A; } }"
}

/// Half of the task states in a container that is used twice.
fn with_task_states(count: usize) -> String {
    let mut text = format!("{HEAD}{TASKS_OF_THE_ROBOT}container C {{ region c {{\n");
    for number in 0..count / 2 {
        let _ = writeln!(text, "task T{number}: Rest; initial -> T{number};");
    }
    text += "state Idle; initial -> Idle; } }\nmachine M { region r { super A: C; super B: C;\n";
    if count % 2 == 1 {
        text += "task Odd: Rest; B -> Odd;\n";
    }
    text + "initial -> A; A -> B; } }"
}

fn with_nets(count: usize) -> String {
    let mut text = format!("{HEAD}{TASKS_OF_THE_ROBOT}machine M {{\n");
    for number in 0..count {
        let _ = writeln!(
            text,
            "region g{number} {{ task G: Give; initial -> G; }} region t{number} {{ task T: Take; initial -> T; }}\n\
             path g{number}.G.value -> t{number}.T.value;"
        );
    }
    text + "region r { state A; initial -> A; } }"
}

fn with_groups(count: usize) -> String {
    let mut text =
        format!("{HEAD}{TASKS_OF_THE_ROBOT}machine M {{\nregion r {{ state S; initial -> S;\n");
    let states = ["Give", "Rest", "Take"];
    for name in &states[..count.min(states.len())] {
        let _ = writeln!(text, "task {name}: {name}; S -> {name};");
    }
    text += "}\n";
    if count >= states.len() {
        text += "path Give.value -> Take.value;";
    }
    text + "}"
}

fn with_regions(count: usize) -> String {
    let mut text = format!("{HEAD}machine M {{\n");
    for number in 0..count {
        let _ = writeln!(text, "region r{number} {{ state A; initial -> A; }}");
    }
    text + "}"
}

/// Long names, the last of them of a given length.
fn with_name_of(length: usize) -> String {
    let [a, b, c, d] = ["a", "b", "c", "d"].map(|letter| letter.repeat(800));
    let last = "x".repeat(length);
    format!(
        "{HEAD}machine M {{ region r {{ state {a}; state {b}; state {c}; state {d}; state {last}; initial -> {last}; }} }}"
    )
}

/// The blob made without regard to a board.
fn blob_of(text: &str) -> Vec<u8> {
    let mut checked = load_text("t.esm", text);
    let schedule = checked.lay_out(Duration::from_secs(5)).unwrap();
    let blob = compile_to_fit(&mut checked, &schedule, None, NameTable::Kept).unwrap();
    blob.unwrap_or_else(|| panic!("{}", checked.render(false)))
        .into_bytes()
}

/// What is said for the small board: lines with messages.
fn told(text: &str) -> Vec<(u32, String)> {
    let mut checked = load_text("t.esm", text);
    let schedule = checked.lay_out(Duration::from_secs(5)).unwrap();
    let blob = compile_to_fit(&mut checked, &schedule, Some(&SMALL), NameTable::Kept).unwrap();
    assert_eq!(blob.is_none(), checked.has_errors());
    let errors = checked
        .diagnostics
        .iter()
        .filter(|found| found.code == Code::E012);
    errors
        .map(|found| (checked.position(found.span).line, found.text()))
        .collect()
}

#[test]
fn what_is_said_of_a_mission_is_what_the_robot_says() {
    // Missions by size, the sizes, what the robot has too little of in the end, and the first size
    // that is too great.
    type Case = (Mission, std::ops::Range<usize>, Capacity, usize);
    let name_that_fits = BLOB_BYTES - blob_of(&with_name_of(0x100)).len() + 0x100;
    let cases: [Case; 6] = [
        (with_slots, 1..6, Capacity::Slots, SLOTS + 1),
        (with_task_states, 1..12, Capacity::TaskInstances, TASKS + 1),
        (with_nets, 1..5, Capacity::Nets, NETS + 1),
        (with_groups, 1..4, Capacity::ExclusiveGroups, GROUPS + 1),
        // 5 words hold flags, enabled tasks, queue, and which regions are active and awake; each
        // region takes one and a half.
        (with_regions, 20..27, Capacity::ArenaWords, 24),
        (
            with_name_of,
            name_that_fits - 3..name_that_fits + 4,
            Capacity::BlobBytes,
            name_that_fits + 1,
        ),
    ];
    for (mission, sizes, expected, first_too_great) in cases {
        for size in sizes {
            let text = mission(size);
            let answer = upload(&blob_of(&text));
            let errors = told(&text);
            match answer {
                Ok(()) => {
                    assert_eq!(errors, [], "{expected:?} {size}");
                    assert!(size < first_too_great, "{expected:?} {size}");
                }
                Err(LinkError::CapacityExceeded {
                    what,
                    needed,
                    available,
                }) => {
                    assert!(size >= first_too_great, "{expected:?} {size}");
                    assert_eq!(what, expected, "{size}");
                    let [(_, message)] = errors.as_slice() else {
                        panic!("{expected:?} {size}: {errors:?}");
                    };
                    let said = format!("{needed} ");
                    assert!(message.starts_with(&said), "{message}");
                    let said = format!(
                        ", {} more than the {available} that board `small`",
                        needed - available
                    );
                    assert!(message.contains(&said), "{message}");
                }
                Err(other) => panic!("{expected:?} {size}: {other:?}"),
            }
        }
    }
}

#[test]
fn the_place_is_the_first_declaration_for_which_there_is_no_room() {
    let cases: [(Mission, usize, u32); 6] = [
        // The fourth slot.
        (with_slots, 5, 4),
        // The ninth task state: the container's first one, in its second use.
        (with_task_states, 16, 6),
        // The one behind both uses.
        (with_task_states, 9, 12),
        // The third path.
        (with_nets, 3, 11),
        // The task that brings the third group.
        (with_groups, 3, 3),
        // The machine.
        (with_regions, 40, 2),
    ];
    for (mission, size, line) in cases {
        let lines: Vec<u32> = told(&mission(size)).iter().map(|(line, _)| *line).collect();
        assert!(lines.contains(&line), "{lines:?} for\n{}", mission(size));
    }
}

#[test]
fn all_capacities_that_are_exceeded_are_told_at_once() {
    let text = with_nets(6);
    let errors = told(&text);
    for what in ["nets", "task states"] {
        assert!(
            errors.iter().any(|(_, message)| message.contains(what)),
            "{what}: {errors:?}"
        );
    }
}

#[test]
fn what_no_blob_can_hold_is_told_for_every_board_and_for_none() {
    let many = |count: usize, what: fn(usize) -> String| (0..count).map(what).collect::<String>();
    let cases = [
        (
            "states",
            format!(
                "{HEAD}machine M {{ region r {{ {} initial -> S0; }} }}",
                many(65_533, |number| format!("state S{number};"))
            ),
            2,
        ),
        (
            "tests in one guard",
            format!(
                "{HEAD}machine M {{ region r {{ state A timeout 1 s; initial -> A;\nA -> A [timeout{}]; }} }}",
                " or timeout".repeat(8_192)
            ),
            3,
        ),
        (
            "flags of one state",
            format!(
                "{HEAD}container C {{ {} region r {{ state A; initial -> A; }} }}\nmachine M {{ region r {{\nsuper S: C; initial -> S; }} }}",
                many(4_096, |number| format!("in flag f{number};"))
            ),
            4,
        ),
        (
            "flag bits",
            format!(
                "{HEAD}container C0 {{ region r {{ state A; initial -> A; }} }}\n{}machine M {{ region r {{ super S: C30; initial -> S; }} }}",
                many(30, |number| format!(
                    "container C{} {{ region r {{ super A: C{number}; super B: C{number}; initial -> A; A -> B; }} }}\n",
                    number + 1
                ))
            ),
            // The container with which it is too much: each is twice the one before it.
            17,
        ),
    ];
    for (what, text, line) in cases {
        for board in [None, Some(&SMALL)] {
            let mut checked = load_text("t.esm", &text);
            let schedule = checked.lay_out(Duration::from_secs(5)).unwrap();
            assert!(
                compile_to_fit(&mut checked, &schedule, board, NameTable::Kept)
                    .unwrap()
                    .is_none(),
                "{what}"
            );
            let errors: Vec<_> = checked
                .diagnostics
                .iter()
                .filter(|found| found.code == Code::E012)
                .map(|found| (checked.position(found.span).line, found.message.clone()))
                .collect();
            let [(at, message)] = errors.as_slice() else {
                panic!("{what}: {errors:?}");
            };
            assert!(message.contains("that a blob can hold"), "{message}");
            assert!(message.contains(what), "{what}: {message}");
            assert_eq!(*at, line, "{what}");
        }
    }
}

#[test]
fn files_with_other_errors_are_not_compared() {
    let mut checked = load_text("t.esm", &(with_slots(9) + " container C { }"));
    assert!(checked.has_errors());
    let before = checked.diagnostics.clone();
    let schedule = checked.lay_out(Duration::from_secs(5)).unwrap();
    let blob = compile_to_fit(&mut checked, &schedule, Some(&SMALL), NameTable::Kept).unwrap();
    assert!(blob.is_none());
    assert_eq!(checked.diagnostics, before);
}

/// A chain of events through three regions, in an interpreter's slot of this duration; with
/// `circle`, the last event causes the first.
fn chain(duration_us: u32, circle: bool) -> String {
    let last = if circle { " / send First" } else { "" };
    format!(
        "interpreter slot 1; slot 1 period 10 ms duration {duration_us} us;
         machine M {{
           event First, Second;
           region a {{ state S; initial -> S; S -> S / send First; }}
           region b {{ state S; initial -> S; S -> S on First / send Second; }}
           region c {{ state S; initial -> S; S -> S on Second{last}; }}
         }}"
    )
}

#[test]
fn a_macro_step_that_can_take_longer_than_its_slot_is_an_error_where_the_interpreter_was_measured()
{
    let default = boards::find(boards::DEFAULT).unwrap();
    let host = boards::find("host").unwrap();
    let cases = [
        (chain(1_000, false), default, false),
        (chain(5, false), default, true),
        // Nobody measured it there.
        (chain(5, false), host, false),
        // What ends it is a limit, of which W104 warns.
        (chain(5, true), default, false),
    ];
    for (text, board, is_wrong) in cases {
        let mut checked = load_text("mission.esm", &text);
        let schedule = checked.lay_out(Duration::from_secs(5)).unwrap();
        let blob = compile_to_fit(&mut checked, &schedule, Some(board), NameTable::Kept).unwrap();
        assert_eq!(blob.is_none(), is_wrong, "{text}");
        let found = checked.diagnostics.iter().find(|it| it.code == Code::E010);
        assert_eq!(found.is_some(), is_wrong, "{text}");
        if let Some(found) = found {
            assert_eq!(checked.position(found.span).line, 1);
            let hint = found.hint.as_deref().unwrap();
            assert!(
                found.message.starts_with("a macro step takes up to "),
                "{found:?}"
            );
            assert!(
                found
                    .message
                    .ends_with("; the interpreter's slot 1 lasts 5 us"),
                "{found:?}"
            );
            assert!(
                hint.contains("most of it takes ") && hint.contains("b/S -> b/S"),
                "{hint}"
            );
        }
    }
}
