//! Quadrature encoders, counted by PIO: a state machine an encoder looks at both of its outputs and
//! counts each edge, in 32 bits.
//!
//! A state machine executes 2 million instructions a second here, and takes at most
//! [`LONGEST_ROUND`] of them from one look to the next: it follows edges at
//! 181,000 a second. A wheel with 1,440 counts a turn makes so many at 126 turns a second.

use crate::hal::gpio::{FunctionPio0, PullUp};
use crate::hal::pac::{PIO0, RESETS};
use crate::hal::pio::{
    Buffers, InstalledProgram, PIOBuilder, PIOExt, Rx, SM0, SM1, ShiftDirection, StateMachineIndex,
    UninitStateMachine,
};
use pio::pio_asm;
use pio::{Program, RP2040_MAX_PROGRAM_SIZE};
use rt_firmware::drivers::EncoderCounter;

use crate::clock::PIO_DIVISOR;
use crate::free_pins::{FreePins, take};
use crate::wiring::Wheel;

/// Instructions that a state machine executes from one look at its pins to the next, at most.
pub const LONGEST_ROUND: u32 = 11;

/// Counts that the state machine's FIFO holds.
const FIFO_COUNTS: usize = 8;

/// Looks at the FIFO for a new count, which are many more than a round lasts: a state machine that
/// does not go on keeps nobody waiting.
const LOOKS: u32 = 1_000;

/// The program. It must lie at address 0, where its first sixteen instructions are a table: what
/// to do when the pins were `old` and are `new`, by `old << 2 | new`. Forwards is when A is ahead
/// of B.
fn program() -> Program<RP2040_MAX_PROGRAM_SIZE> {
    pio_asm!(
        ".origin 0",
        // Pins are read as B, A: A is the lower bit.
        "    jmp same", // 00 -> 00
        "    jmp up",   // 00 -> 01: A rises
        "    jmp down", // 00 -> 10: B rises
        "    jmp same", // 00 -> 11: two edges at once cannot be told
        "    jmp down", // 01 -> 00
        "    jmp same", // 01 -> 01
        "    jmp same", // 01 -> 10
        "    jmp up",   // 01 -> 11
        "    jmp up",   // 10 -> 00
        "    jmp same", // 10 -> 01
        "    jmp same", // 10 -> 10
        "    jmp down", // 10 -> 11
        "    jmp same", // 11 -> 00
        "    jmp down", // 11 -> 01
        "    jmp up",   // 11 -> 10
        "    jmp same", // 11 -> 11
        "down:",
        "    jmp x-- same",
        "same:",
        ".wrap_target",
        // The count goes out as long as there is room, so that a reader has a new one at once.
        "    mov isr, x",
        "    push noblock",
        "    mov isr, null",
        "    in y, 2",
        "    in pins, 2",
        "    mov y, isr",
        "    mov pc, isr",
        "up:",
        // A state machine cannot add, but it can subtract from the complement.
        "    mov x, ~x",
        "    jmp x-- less",
        "less:",
        "    mov x, ~x",
        ".wrap",
    )
    .program
}

/// The count of an encoder.
pub struct Counter<SM: StateMachineIndex> {
    counts: Rx<(PIO0, SM)>,
    last: u32,
    is_reversed: bool,
}

/// The encoders of the left wheel and the right one.
///
/// # Panics
/// If a pin is taken.
pub(crate) fn start(
    wheels: [&Wheel; 2],
    pins: &mut FreePins,
    pio: PIO0,
    resets: &mut RESETS,
) -> (Counter<SM0>, Counter<SM1>) {
    for wheel in wheels {
        // Outputs of an encoder are often open collectors.
        for pin in [wheel.encoder, wheel.encoder + 1] {
            let _pin = take!(pins, pin, FunctionPio0, PullUp);
        }
    }
    let (mut pio, left, right, ..) = pio.split(resets);
    let Ok(program) = pio.install(&program()) else {
        panic!("the program that counts encoders fits");
    };
    // SAFETY: a program may be shared by state machines as long as nobody takes it away.
    let shared = unsafe { program.share() };
    (
        Counter::new(program, left, wheels[0]),
        Counter::new(shared, right, wheels[1]),
    )
}

impl<SM: StateMachineIndex> Counter<SM> {
    fn new(
        program: InstalledProgram<PIO0>,
        machine: UninitStateMachine<(PIO0, SM)>,
        wheel: &Wheel,
    ) -> Self {
        let (mut machine, counts, _) = PIOBuilder::from_installed_program(program)
            .in_pin_base(wheel.encoder)
            .in_shift_direction(ShiftDirection::Left)
            .buffers(Buffers::OnlyRx)
            .clock_divisor_fixed_point(PIO_DIVISOR.0, PIO_DIVISOR.1)
            .build(machine);
        // The first look begins at 0, and with whatever the pins show.
        machine.exec_instruction(set_x_to_zero());
        machine.start();
        Self {
            counts,
            last: 0,
            is_reversed: wheel.encoder_reversed,
        }
    }
}

/// `set x, 0`
fn set_x_to_zero() -> pio::Instruction {
    pio::Instruction {
        operands: pio::InstructionOperands::SET {
            destination: pio::SetDestination::X,
            data: 0,
        },
        delay: 0,
        side_set: None,
    }
}

impl<SM: StateMachineIndex> EncoderCounter for Counter<SM> {
    const BITS: u32 = u32::BITS;

    fn count(&mut self) -> u16 {
        self.wide_count() as u16
    }

    fn wide_count(&mut self) -> u32 {
        // What is in the FIFO is old. A new count comes with the next look at the pins.
        for _ in 0..FIFO_COUNTS {
            if self.counts.read().is_none() {
                break;
            }
        }
        for _ in 0..LOOKS {
            if let Some(count) = self.counts.read() {
                self.last = count;
                break;
            }
        }
        match self.is_reversed {
            true => self.last.wrapping_neg(),
            false => self.last,
        }
    }
}
