//! What happens on the real-time side: one vocabulary, from which trace and black box each take
//! what they tell.

use esm_core::{Fault, TransitionTaken};
use esm_link::black_box;
use esm_link::message::Mode;
use esm_link::trace::{EMERGENCY, FaultCode, TraceEvent};
use esm_link::trial::FallBack;

/// Something that happens.
#[derive(Clone, Copy)]
pub(super) enum Event {
    /// A mission starts; its first macro step is next.
    Started {
        /// Its hash.
        mission: u32,
        /// When, on the robot's clock.
        start_us: u64,
    },
    /// A mission on trial was given up.
    FellBack(FallBack),
    /// A transition was taken.
    Transition(TransitionTaken),
    /// The machine stopped.
    Fault {
        /// Number of the macro step.
        step: u64,
        /// Why.
        fault: Fault,
    },
    /// The motors are off.
    MotorsOff {
        /// Why: what the robot does from now on, or would do if it had not stopped before.
        mode: Mode,
        /// The robot had not stopped before.
        is_new: bool,
    },
    /// A task took longer than its slot.
    Overrun {
        /// The task instance.
        task_instance: u16,
        /// What it took, in microseconds.
        took_us: u32,
    },
    /// Activations of a slot did not start within their period.
    DeadlineMiss {
        /// Index of the slot.
        slot: usize,
        /// How many.
        count: u32,
    },
    /// A background run started.
    BackgroundRunStarted {
        /// The task instance.
        task_instance: u16,
        /// The activation at whose end this was.
        activation: u64,
    },
    /// A background run ended.
    BackgroundRunEnded {
        /// The task instance.
        task_instance: u16,
        /// The activation at whose start this became known.
        activation: u64,
    },
    /// A task noted something.
    Noted(black_box::Event),
}

impl Event {
    /// What the trace tells of it.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn trace_record(self) -> TraceEvent<'static> {
        match self {
            Event::Started { mission, start_us } => TraceEvent::Started { mission, start_us },
            Event::FellBack(fell_back) => TraceEvent::FellBack {
                mission: fell_back.mission,
                reason: fell_back.reason.number(),
            },
            Event::Transition(taken) => TraceEvent::Transition {
                micro: taken.micro,
                region_instance: taken.region_instance,
                transition: taken.transition,
            },
            Event::Fault { step, fault } => TraceEvent::Fault {
                step,
                code: match fault {
                    Fault::EventQueueOverflow => FaultCode::EventQueueOverflow,
                    Fault::MacroStepLimit => FaultCode::MacroStepLimit,
                },
            },
            Event::MotorsOff { mode, .. } => TraceEvent::MotorsOff {
                reason: match mode {
                    Mode::Safe(reason) => Some(reason.number()),
                    Mode::EmergencyStopped => Some(EMERGENCY),
                    _ => None,
                },
            },
            Event::Overrun {
                task_instance,
                took_us,
            } => TraceEvent::Overrun {
                task_instance,
                took_us,
            },
            Event::DeadlineMiss { slot, count } => TraceEvent::DeadlineMiss {
                slot: slot as u16,
                count,
            },
            Event::BackgroundRunStarted {
                task_instance,
                activation,
            } => TraceEvent::BackgroundRunStarted {
                task_instance,
                activation,
            },
            Event::BackgroundRunEnded {
                task_instance,
                activation,
            } => TraceEvent::BackgroundRunEnded {
                task_instance,
                activation,
            },
            Event::Noted(event) => TraceEvent::Noted(event),
        }
    }

    /// What the black box keeps of it, if it does.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn black_box_record(self) -> Option<black_box::Event> {
        Some(match self {
            Event::Started { mission, .. } => black_box::Event::Mission { hash: mission },
            Event::Transition(taken) => black_box::Event::Transition {
                region_instance: taken.region_instance,
                transition: taken.transition,
            },
            Event::MotorsOff { mode, is_new: true } => black_box::Event::Mode(mode),
            Event::Overrun {
                task_instance,
                took_us,
            } => black_box::Event::Overrun {
                task_instance,
                took_us: u16::try_from(took_us).unwrap_or(u16::MAX),
            },
            Event::DeadlineMiss { slot, count } => black_box::Event::DeadlineMiss {
                slot: u8::try_from(slot).unwrap_or(u8::MAX),
                count,
            },
            Event::Noted(event) => event,
            _ => return None,
        })
    }
}
