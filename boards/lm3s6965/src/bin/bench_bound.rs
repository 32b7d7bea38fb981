//! Counts the instructions of macro steps: `cargo xtask bench bound` builds, runs and reads it.
//!
//! The host writes a file `plan`: missions, and for each what happens before each of its macro
//! steps. For each macro step this program writes the ticks that it took into a file `counts`, four
//! bytes, little endian. Nothing else runs here, so that they are those of the interpreter and of
//! telling an observer, to the instruction: with `-icount shift=9` one takes 512 ns, and a tick is
//! 20 ns.
//!
//! A plan is made of records, all numbers little endian:
//!
//! | record | bytes |
//! |---|---|
//! | mission | `M`; 32 bits: length of the blob; the blob |
//! | macro step | `S`; 32 bits: deadline misses before it; 16 bits: changes; each 16 bits task instance, 16 bits what |
//! | end | `E` |
//!
//! What changes: 0 busy off, 1 busy on, 2 exit, 4 + 2 *f* + *v*: control flag *f* becomes *v*.
#![no_std]
#![no_main]

use core::hint::black_box;
use core::ptr;

use esm_core::{Interpreter, Observer, TransitionTaken, verify};
use lm3s6965::clock;
use lm3s6965::cortex_m_board::sys_tick;
use semihosting::fd::{AsFd, OwnedFd};
use semihosting::process::exit;
use semihosting::sys::arm_compat::{OpenMode, sys_open, sys_read_orig, sys_write_orig};

/// Room for a mission.
const BLOB_BYTES: usize = 24 * 1024;
/// Room for its machine.
const ARENA_WORDS: usize = 4 * 1024;

/// Exit status where the plan cannot be read.
const BAD_PLAN: i32 = 2;
/// Exit status where a mission is refused, or has no room.
const BAD_MISSION: i32 = 3;
/// Exit status where the counts cannot be written.
const NO_OUTPUT: i32 = 4;

/// The plan, read in pieces.
struct Plan {
    file: OwnedFd,
    piece: [u8; 512],
    at: usize,
    length: usize,
}

impl Plan {
    fn byte(&mut self) -> u8 {
        if self.at == self.length {
            let Ok(left) = sys_read_orig(self.file.as_fd(), &mut self.piece) else {
                exit(BAD_PLAN)
            };
            self.length = self.piece.len().saturating_sub(left);
            self.at = 0;
        }
        let Some(byte) = self.piece.get(self.at) else {
            exit(BAD_PLAN)
        };
        self.at += 1;
        *byte
    }

    fn number(&mut self) -> u16 {
        u16::from_le_bytes([self.byte(), self.byte()])
    }

    fn long(&mut self) -> u32 {
        u32::from(self.number()) | u32::from(self.number()) << 16
    }
}

/// Is told of everything, each time by a call with all that there is to tell.
#[derive(Default)]
struct Told {
    last: u32,
}

impl Told {
    fn note(&mut self, word: u32) {
        // SAFETY: a place of our own, to which nothing else refers meanwhile; volatile, so that
        // what is told is worked out.
        unsafe { ptr::write_volatile(&mut self.last, word) };
    }
}

impl Observer for Told {
    #[inline(never)]
    fn transition(&mut self, taken: TransitionTaken) {
        self.note(u32::from(taken.micro));
        self.note(u32::from(taken.region_instance));
        self.note(u32::from(taken.transition));
    }

    #[inline(never)]
    fn enabled(&mut self, task_instance: u16) {
        self.note(u32::from(task_instance));
    }

    #[inline(never)]
    fn disabled(&mut self, task_instance: u16) {
        self.note(u32::from(task_instance));
    }
}

/// The ticks of one macro step.
#[inline(never)]
fn macro_step(interpreter: &mut Interpreter<'_, &[u8]>, told: &mut Told) -> u32 {
    let before = sys_tick::current();
    let ended = interpreter.macro_step(told);
    let after = sys_tick::current();
    let _ = black_box(ended);
    before.wrapping_sub(after) & sys_tick::MAX
}

/// What reading the clock takes.
#[inline(never)]
fn nothing() -> u32 {
    let before = sys_tick::current();
    let after = sys_tick::current();
    before.wrapping_sub(after) & sys_tick::MAX
}

/// Runs one mission, up to a record that is none of its own; returns that.
fn run(plan: &mut Plan, counts: &OwnedFd, blob: &[u8], arena: &mut [u32]) -> u8 {
    let Ok(verified) = verify(blob) else {
        exit(BAD_MISSION)
    };
    let Ok(mut interpreter) = Interpreter::new(verified, arena) else {
        exit(BAD_MISSION)
    };
    let own = nothing();
    let mut told = Told::default();
    loop {
        match plan.byte() {
            b'S' => {}
            other => return other,
        }
        interpreter.skip(plan.long());
        for _ in 0..plan.number() {
            let instance = usize::from(plan.number());
            match plan.number() {
                busy @ (0 | 1) => interpreter.set_busy(instance, busy == 1),
                2 => interpreter.report_exit(instance),
                flag => {
                    let flag = usize::from(flag.saturating_sub(4));
                    interpreter.set_flag(instance, flag / 2, flag % 2 == 1);
                }
            }
        }
        let ticks = macro_step(&mut interpreter, &mut told).saturating_sub(own);
        if !matches!(sys_write_orig(counts.as_fd(), &ticks.to_le_bytes()), Ok(0)) {
            exit(NO_OUTPUT);
        }
    }
}

#[lm3s6965::rt::entry]
fn main() -> ! {
    // Not on the stack, which has less room.
    static mut BLOB: [u8; BLOB_BYTES] = [0; BLOB_BYTES];
    static mut ARENA: [u32; ARENA_WORDS] = [0; ARENA_WORDS];
    clock::start();
    let (Ok(file), Ok(counts)) = (
        sys_open(c"plan", OpenMode::RDONLY_BINARY),
        sys_open(c"counts", OpenMode::WRONLY_TRUNC_BINARY),
    ) else {
        exit(BAD_PLAN)
    };
    let mut plan = Plan {
        file,
        piece: [0; 512],
        at: 0,
        length: 0,
    };
    let mut record = plan.byte();
    while record == b'M' {
        let length = plan.long() as usize;
        let Some(blob) = BLOB.get_mut(..length) else {
            exit(BAD_MISSION)
        };
        for byte in blob.iter_mut() {
            *byte = plan.byte();
        }
        record = run(&mut plan, &counts, blob, ARENA);
    }
    exit(if record == b'E' { 0 } else { BAD_PLAN })
}
