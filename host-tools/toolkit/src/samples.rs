//! Machines and timetables that several tests share, those of the packages above among them.

use std::sync::Arc;

use crate::compile::compile;
use crate::lang;
use crate::schedule::Limit;
use crate::timetable::{TimedSlot, Timetable};
use crate::trace::directory::Directory;

/// Work that start times of these machines' slots are found with, many times over.
const PIECES: u64 = 1_000_000;

/// A machine with all kinds of states: two regions, a container used twice, flags through `^`, an
/// event, a background task.
pub const ROVER: &str = "
    interpreter slot 1;
    slot 1 period 10 ms duration 1 ms;
    slot 2 period 10 ms duration 1 ms;
    task Drive slot 2 { out flag near; in flag fast; }
    task Log slot 0 { }
    container Dodge {
        in flag fast;
        out flag done;
        out flag idle;
        region turn {
            task Back: Drive timeout 20 ms;
            task Turn: Drive;
            initial -> Back [^fast] / set .fast;
            initial -> Back;
            Back -> Turn [exit or timeout] / set ^done, clear ^idle;
            Turn -> final on *;
        }
    }
    machine Rover {
        event Obstacle;
        region motion {
            task Cruise: Drive;
            super Escape: Dodge;
            super Again: Dodge;
            initial -> Cruise;
            Cruise -> Escape [.near] / set .fast, send Obstacle;
            Escape -> Again [.done and exit];
            Again -> Cruise on *;
        }
        region safety {
            state Watch timeout 30 ms;
            task Note: Log;
            initial -> Watch;
            Watch -> Note on Obstacle;
            Note -> Watch on *;
            Note -> Watch [not busy and timeout];
            Watch -> Watch [timeout];
        }
    }";

/// In the second macro step one transition sends two events, each of which sends two more.
pub const FLOOD: &str = "
    interpreter slot 1; queue 4;
    slot 1 period 10 ms duration 1 ms;
    machine Flood {
        event E;
        region first { state A; state B; initial -> A; A -> B / send E; B -> B on E / send E, send E; }
        region second { state A; state B; initial -> A; A -> B on E; }
    }";

/// Its names, and the blob that the compiler makes of it.
pub fn directory_and_blob(machine: &str) -> (Arc<Directory>, Vec<u8>) {
    let mut checked = lang::load_text("machine.esm", machine);
    let schedule = checked.lay_out(Limit::pieces(PIECES));
    let (Some(model), Some(schedule)) = (&checked.model, schedule) else {
        panic!("{}", checked.render(false));
    };
    let blob = compile(model, &schedule).unwrap();
    let verified = esm_core::verify(&blob[..]).unwrap();
    (Arc::new(Directory::of(&verified.tables()).unwrap()), blob)
}

/// Slots by start, period and duration in microseconds, numbered from `first`.
pub fn numbered_from(first: u32, slots: &[(u32, u32, u32)]) -> Timetable {
    let timed = |(&(start_us, period_us, duration_us), number)| TimedSlot {
        number,
        start_us,
        period_us,
        duration_us,
    };
    Timetable::new(slots.iter().zip(first..).map(timed).collect())
}

/// The same, numbered from 1.
pub fn timetable(slots: &[(u32, u32, u32)]) -> Timetable {
    numbered_from(1, slots)
}
