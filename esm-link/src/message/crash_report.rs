//! Why a robot started, and how the run before ended.

use serde::{Deserialize, Serialize};

/// Greatest length of the path of a file that panicked, of which the end is kept.
pub const MAX_PLACE_BYTES: usize = 40;

/// Why a robot started.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum ResetReason {
    /// The power came on, or nothing is known.
    PowerOn,
    /// The reset pin.
    Pin,
    /// The hardware watchdog: a task did not return.
    Watchdog,
    /// The program panicked.
    Panic,
    /// The processor met a fault (bad access, bad instruction, stack overflow).
    CpuFault,
    /// The supply voltage fell.
    BrownOut,
    /// The firmware asked for it.
    Software,
}

/// How a run of the firmware ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct CrashReport {
    /// Why, and so why the robot started the last time.
    pub reason: ResetReason,
    /// Robot time of the last activation of the interpreter's slot, in µs since that run's first
    /// macro step of its first mission; 0 if not known.
    pub after_us: u64,
    /// The task instance that was being executed by a slot, by its index in the mission's blob.
    pub task: Option<u16>,
    /// The line of the panic, if it was one.
    pub line: u32,
    /// What the processor said of its fault, if it was one; zeros otherwise.
    pub fault: CoreFault,
    /// Who showed no heartbeat, so that the watchdog was fed no more.
    pub silent: Option<Silent>,
    /// Starts after a watchdog, a panic or a fault in a row, this one included, none of which was
    /// healthy for long.
    pub bad_starts: u32,
}

impl CrashReport {
    /// Of a run that left nothing but its reason.
    pub const fn of(reason: ResetReason) -> Self {
        CrashReport {
            reason,
            after_us: 0,
            task: None,
            line: 0,
            fault: CoreFault {
                pc: 0,
                lr: 0,
                status: 0,
                hard_status: 0,
                address: 0,
            },
            silent: None,
            bad_starts: 0,
        }
    }
}

/// A fault of a processor, in the registers of an ARMv7-M core.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct CoreFault {
    /// The instruction that faulted, or [`STACK_OVERFLOW`](Self::STACK_OVERFLOW).
    pub pc: u32,
    /// Where its function was called from.
    pub lr: u32,
    /// Configurable fault status (CFSR).
    pub status: u32,
    /// Hard fault status (HFSR).
    pub hard_status: u32,
    /// The address of a bad access (MMFAR or BFAR), 0 if it is not known.
    pub address: u32,
}

impl CoreFault {
    /// In the place of an instruction: the stack had no room for what the core keeps of one. No
    /// instruction has an odd address.
    pub const STACK_OVERFLOW: u32 = u32::MAX;
}

/// Who was silent for too long.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Silent {
    /// The slot with this index in the mission's blob was executed no more; 255 stands for more,
    /// too.
    Slot(u8),
    /// The link got no turn.
    Link,
    /// A background task did not return, or slots left it no time.
    Background,
    /// The link took the time of slot 0, with what came over the line: no doing of the mission's.
    BackgroundForLink,
}

/// Behind the numbers of slots.
const BACKGROUND_FOR_LINK: u32 = 3 + u8::MAX as u32 + 1;

impl Silent {
    /// Whether it came of what somebody sent over the line. Such a reset is not counted against the
    /// mission.
    pub fn is_load_from_outside(self) -> bool {
        self == Silent::BackgroundForLink
    }

    /// Its number, as it is kept across a reset: 0 stands for nobody.
    pub fn number(self) -> u32 {
        match self {
            Silent::Link => 1,
            Silent::Background => 2,
            Silent::Slot(slot) => 3 + u32::from(slot),
            Silent::BackgroundForLink => BACKGROUND_FOR_LINK,
        }
    }

    /// Who has this number.
    pub fn from_number(number: u32) -> Option<Silent> {
        match number {
            0 => None,
            1 => Some(Silent::Link),
            2 => Some(Silent::Background),
            BACKGROUND_FOR_LINK => Some(Silent::BackgroundForLink),
            slot => u8::try_from(slot - 3).ok().map(Silent::Slot),
        }
    }
}

impl ResetReason {
    /// All reasons, in the order of their numbers.
    const ALL: [ResetReason; 7] = [
        ResetReason::PowerOn,
        ResetReason::Pin,
        ResetReason::Watchdog,
        ResetReason::Panic,
        ResetReason::CpuFault,
        ResetReason::BrownOut,
        ResetReason::Software,
    ];

    /// The reason with this number, which is its place in the enum.
    pub fn from_number(number: u8) -> Option<ResetReason> {
        Self::ALL.get(usize::from(number)).copied()
    }
}
