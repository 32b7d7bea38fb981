//! Sonars that answer a trigger with a pulse (HC-SR04 and its kind), timed by PIO: a state machine
//! a sonar sends the trigger and measures its echo, to a microsecond, while nobody waits.
//!
//! A state machine executes two instructions a microsecond, and looks at one echo pin. There are
//! four of them, and up to eight sonars: neighbours may share one, since they hear each other and
//! so never ping at once. Their echo outputs share its pin, each through a diode, or through an OR
//! gate.

use crate::hal::gpio::{FunctionPio1, PullDown, PullNone};
use crate::hal::pac::{PIO1, RESETS, SIO, pio0};
use crate::hal::pio::{
    InstalledProgram, PIOBuilder, PIOExt, PinDir, StateMachineIndex, UninitStateMachine,
};
use cortex_m_board::pings::{Ping, Pings};
use embedded_hal::digital::{self, OutputPin};
use pio::pio_asm;
use pio::{
    InstructionOperands, JmpCondition, MovDestination, MovOperation, MovSource, Program,
    RP2040_MAX_PROGRAM_SIZE,
};
#[cfg(feature = "ranges")]
use rt_firmware::drivers::BusSonar;
use rt_firmware::drivers::{EchoPulse, EchoTimer};

use crate::clock::PIO_DIVISOR;
use crate::free_pins::{FreePins, take};
#[cfg(feature = "ranges")]
use crate::i2c::Bus;
use crate::wiring::Sonar;

/// State machines that time echoes.
pub const MACHINES: usize = 4;

/// The program: a word from the processor is a trigger. A data sheet asks for 10 µs of it at least
/// (HC-SR04); it lasts 16 µs.
fn program() -> Program<RP2040_MAX_PROGRAM_SIZE> {
    pio_asm!(
        ".wrap_target",
        "    pull block",
        "    set pins, 1 [31]",
        "    set pins, 0",
        "    wait 1 pin 0",
        "    mov x, ~null",
        "count:",
        "    jmp pin high",
        // What was counted is the complement: the counter went down from all ones.
        "    mov isr, ~x",
        "    push noblock",
        ".wrap",
        "high:",
        "    jmp x-- count",
    )
    .program
}

/// The last trigger of each state machine: its number, and the pin that it went to. What was
/// counted is the echo of no other.
static PINGS: Pings<MACHINES> = Pings::new();

/// A sonar, as the state machine that times it knows it.
#[derive(Clone, Copy)]
struct Timer {
    /// Which state machine.
    machine: u8,
    /// Where its program begins.
    program: u8,
    trigger_pin: u8,
    echo_pin: u8,
}

impl Timer {
    fn registers() -> &'static pio0::RegisterBlock {
        // SAFETY: the registers are there for the chip's whole life. A state machine's own are
        // written by the trigger and the echo of its sonar alone, which one task has; of those
        // that all share, what is written restarts one of them.
        unsafe { &*PIO1::ptr() }
    }

    /// Lets the state machine do something out of turn. It takes effect within an instruction.
    fn execute(self, what: InstructionOperands) {
        // SAFETY: any instruction can be executed; these touch its registers and its FIFO.
        (Self::registers().sm(self.machine.into()).sm_instr())
            .write(|w| unsafe { w.bits(what.encode().into()) });
    }

    /// The next count of its FIFO.
    fn read(self) -> Option<u32> {
        let is_empty = Self::registers().fstat().read().rxempty().bits() >> self.machine & 1 != 0;
        (!is_empty).then(|| Self::registers().rxf(self.machine.into()).read().bits())
    }

    /// Begins anew, wherever it was: a sonar that hangs keeps its echo pin at a level for ever.
    fn ping(self) {
        /// Counts that the FIFO holds.
        const FIFO_COUNTS: usize = 4;
        self.execute(InstructionOperands::JMP {
            condition: JmpCondition::Always,
            address: self.program,
        });
        // Also out of a wait for an echo that does not come.
        // SAFETY: a state machine that there is.
        (Self::registers().ctrl()).modify(|_, w| unsafe { w.sm_restart().bits(1 << self.machine) });
        for _ in 0..FIFO_COUNTS {
            self.read();
        }
        // SAFETY: a pin that there is, and one of it.
        (Self::registers().sm(self.machine.into()).sm_pinctrl())
            .modify(|_, w| unsafe { w.set_base().bits(self.trigger_pin).set_count().bits(1) });
        // SAFETY: any word is a trigger.
        (Self::registers().txf(self.machine.into())).write(|w| unsafe { w.bits(1) });
    }

    fn is_echo_high(self) -> bool {
        // SAFETY: the register is there for the chip's whole life, and is read.
        let levels = unsafe { (*SIO::ptr()).gpio_in().read().bits() };
        levels >> self.echo_pin & 1 != 0
    }

    /// How long the echo pin has been high so far, in microseconds. Only while it is.
    fn so_far(self) -> Option<u32> {
        /// Looks at the FIFO that are many more than two instructions last.
        const LOOKS: usize = 100;
        // The program uses the shift register only where it is done counting.
        self.execute(InstructionOperands::MOV {
            destination: MovDestination::ISR,
            op: MovOperation::Invert,
            source: MovSource::X,
        });
        self.execute(InstructionOperands::PUSH {
            if_full: false,
            block: false,
        });
        (0..LOOKS).find_map(|_| self.read())
    }
}

/// The trigger of a sonar: a high sends it.
pub enum Trigger {
    /// A state machine sends it.
    Pin(PinTrigger),
    /// It is a command at the bus.
    #[cfg(feature = "ranges")]
    Bus(BusSonar<Bus>),
}

/// What times a sonar's echo.
pub enum Echo {
    /// A state machine.
    Pin(PinEcho),
    /// The sonar.
    #[cfg(feature = "ranges")]
    Bus(BusSonar<Bus>),
}

/// The trigger of a sonar with two pins.
pub struct PinTrigger(Timer);

/// What the echo pin of a sonar does.
pub struct PinEcho {
    timer: Timer,
    /// Trigger that `over_us` belongs to.
    ping: Ping,
    over_us: Option<u16>,
}

/// The sonars, in their order.
///
/// # Panics
/// If a pin is taken, there are more echo pins than state machines, or there is no bus for a sonar
/// at one.
pub(crate) fn start<const SONARS: usize>(
    sonars: &[Sonar; SONARS],
    pins: &mut FreePins,
    pio: PIO1,
    #[cfg(feature = "ranges")] bus: Option<Bus>,
    resets: &mut RESETS,
) -> ([Trigger; SONARS], [Echo; SONARS]) {
    let (mut pio, machine_0, machine_1, machine_2, machine_3) = pio.split(resets);
    let Ok(program) = pio.install(&program()) else {
        panic!("the program that times echoes fits");
    };
    let mut echo_pins = [None; MACHINES];
    for (trigger, echo) in pulses(sonars) {
        let _trigger = take!(pins, trigger, FunctionPio1, PullNone);
        if !echo_pins.contains(&Some(echo)) {
            let Some(free) = echo_pins.iter_mut().find(|pin| pin.is_none()) else {
                panic!("there are {MACHINES} echo pins at most");
            };
            *free = Some(echo);
            // Diodes leave a pin that no sonar drives to its resistor.
            let _echo = take!(pins, echo, FunctionPio1, PullDown);
        }
    }
    start_machine(sonars, echo_pins[0], &program, machine_0);
    start_machine(sonars, echo_pins[1], &program, machine_1);
    start_machine(sonars, echo_pins[2], &program, machine_2);
    start_machine(sonars, echo_pins[3], &program, machine_3);
    let timer = |trigger_pin, echo_pin| Timer {
        machine: (echo_pins.iter())
            .position(|pin| *pin == Some(echo_pin))
            .unwrap_or_default() as u8,
        program: program.offset(),
        trigger_pin,
        echo_pin,
    };
    #[cfg(feature = "ranges")]
    let at_bus = |kind, address| match bus {
        Some(bus) => BusSonar::new(bus, kind, address),
        None => panic!("a sonar at a bus has one"),
    };
    let triggers = sonars.map(|sonar| match sonar {
        Sonar::Pulse { trigger, echo } => Trigger::Pin(PinTrigger(timer(trigger, echo))),
        #[cfg(feature = "ranges")]
        Sonar::AtBus { kind, address } => Trigger::Bus(at_bus(kind, address)),
        #[cfg(not(feature = "ranges"))]
        Sonar::AtBus { .. } => panic!("a sonar at a bus takes the feature `ranges`"),
    });
    let echoes = sonars.map(|sonar| match sonar {
        Sonar::Pulse { trigger, echo } => Echo::Pin(PinEcho {
            timer: timer(trigger, echo),
            ping: Ping::default(),
            over_us: None,
        }),
        #[cfg(feature = "ranges")]
        Sonar::AtBus { kind, address } => Echo::Bus(at_bus(kind, address)),
        #[cfg(not(feature = "ranges"))]
        Sonar::AtBus { .. } => panic!("a sonar at a bus takes the feature `ranges`"),
    });
    (triggers, echoes)
}

/// The pins of the sonars that have some: trigger and echo.
fn pulses(sonars: &[Sonar]) -> impl Iterator<Item = (u8, u8)> {
    sonars.iter().filter_map(|sonar| match *sonar {
        Sonar::Pulse { trigger, echo } => Some((trigger, echo)),
        Sonar::AtBus { .. } => None,
    })
}

/// Starts a state machine for the sonars of an echo pin, if there are any.
fn start_machine<SM: StateMachineIndex>(
    sonars: &[Sonar],
    echo_pin: Option<u8>,
    program: &InstalledProgram<PIO1>,
    machine: UninitStateMachine<(PIO1, SM)>,
) {
    let Some(echo_pin) = echo_pin else { return };
    // SAFETY: a program may be shared by state machines as long as nobody takes it away.
    let program = unsafe { program.share() };
    let (mut machine, ..) = PIOBuilder::from_installed_program(program)
        .in_pin_base(echo_pin)
        .jmp_pin(echo_pin)
        .clock_divisor_fixed_point(PIO_DIVISOR.0, PIO_DIVISOR.1)
        .build(machine);
    let its = pulses(sonars).filter(|(_, echo)| *echo == echo_pin);
    machine.set_pindirs(its.map(|(trigger, _)| (trigger, PinDir::Output)));
    machine.start();
}

/// A ping could not be sent: nobody answers at the bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NotSent;

impl digital::Error for NotSent {
    fn kind(&self) -> digital::ErrorKind {
        digital::ErrorKind::Other
    }
}

impl digital::ErrorType for Trigger {
    type Error = NotSent;
}

impl OutputPin for Trigger {
    /// It ends by itself.
    fn set_low(&mut self) -> Result<(), NotSent> {
        Ok(())
    }

    fn set_high(&mut self) -> Result<(), NotSent> {
        match self {
            Trigger::Pin(PinTrigger(timer)) => {
                timer.ping();
                PINGS.begin(timer.machine.into(), timer.trigger_pin);
                Ok(())
            }
            #[cfg(feature = "ranges")]
            Trigger::Bus(sonar) => sonar.set_high().map_err(|_| NotSent),
        }
    }
}

impl EchoTimer for Echo {
    fn pulse(&mut self) -> EchoPulse {
        match self {
            Echo::Pin(echo) => echo.pulse(),
            #[cfg(feature = "ranges")]
            Echo::Bus(sonar) => sonar.pulse(),
        }
    }
}

impl PinEcho {
    fn pulse(&mut self) -> EchoPulse {
        let timer = self.timer;
        let ping = PINGS.last(timer.machine.into());
        if ping != self.ping {
            self.ping = ping;
            self.over_us = None;
        }
        if !ping.is_of(timer.trigger_pin) {
            return EchoPulse::None;
        }
        let us = |count: u32| u16::try_from(count).unwrap_or(u16::MAX);
        if let Some(count) = timer.read() {
            self.over_us = Some(us(count));
        }
        if let Some(us) = self.over_us {
            return EchoPulse::Over { us };
        }
        if timer.is_echo_high()
            && let Some(count) = timer.so_far()
        {
            return EchoPulse::High { us: us(count) };
        }
        EchoPulse::None
    }
}
