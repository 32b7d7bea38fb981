//! Running missions that a plan names. A line of the plan is `ROW DRIVE MISSION`: the row's name,
//! what is done, and the mission's number.

use esm_core::{Interpreter, verify};

use crate::esm::{Machine, TRANSITIONS, TransitionCounters};
use crate::{Meter, SCRIPT_EVENTS, pass};

/// What is done with a mission.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Drive {
    /// The script of the CD player, one macro step an event.
    Script,
    /// Macro steps while nothing changes.
    Still,
    /// Macro steps before each of which a flag changes that nothing looks at: the interpreter
    /// cannot know that nothing is to be done.
    Stirred,
    /// Changes of a flag alone.
    Set,
    /// Sets this flag of the panel for one macro step, after a rest.
    Flag(u8),
    /// Checks the mission.
    Verify,
    /// From a machine that stopped to the end of the first macro step of this one.
    Start,
}

impl Drive {
    /// What a word of a plan means.
    #[must_use]
    pub fn from_word(word: &str) -> Option<Self> {
        Some(match word {
            "script" => Self::Script,
            "still" => Self::Still,
            "stirred" => Self::Stirred,
            "set" => Self::Set,
            "verify" => Self::Verify,
            "start" => Self::Start,
            _ => Self::Flag(word.strip_prefix("flag-")?.parse().ok()?),
        })
    }
}

/// A line of a plan.
#[derive(Clone, Copy, Debug)]
pub struct Line<'p> {
    /// The name of the row.
    pub row: &'p str,
    /// What is done.
    pub drive: Drive,
    /// The number of the mission.
    pub mission: &'p str,
}

/// The lines of a plan; `None` for one that is none.
pub fn lines(plan: &str) -> impl Iterator<Item = Option<Line<'_>>> {
    plan.lines().map(|line| {
        let mut words = line.split(' ');
        Some(Line {
            row: words.next()?,
            drive: Drive::from_word(words.next()?)?,
            mission: words.next()?,
        })
    })
}

/// Why a line could not be run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Problem {
    /// The verifier refuses the mission.
    Refused,
    /// The arena has not room for it.
    Arena,
}

/// Macro steps after which nothing happens any more: more than any mission is deep.
const REST_STEPS: usize = 20;
/// Macro steps that are measured.
const STEPS: usize = 16;
/// A flag that nothing looks at: the panel's first.
const STIR: usize = 0;

/// Runs one line.
///
/// # Errors
/// [`Problem`].
pub fn run(
    meter: &mut impl Meter,
    Line { row, drive, .. }: Line<'_>,
    blob: &[u8],
    arena: &mut [u32],
) -> Result<(), Problem> {
    if drive == Drive::Verify {
        meter.measure(row, blob.len(), || {
            core::hint::black_box(verify(core::hint::black_box(blob)).is_ok());
        });
        return Ok(());
    }
    let verified = verify(blob).map_err(|_| Problem::Refused)?;
    // The interpreter clears all that it is lent.
    let words = verified.arena_words();
    let arena = arena.get_mut(..words).ok_or(Problem::Arena)?;
    let counters = TransitionCounters::new();
    if drive == Drive::Start {
        let running = Interpreter::new(verified.clone(), arena).map_err(|_| Problem::Arena)?;
        meter.measure_once(row, 1, || {
            let (_, arena) = running.into_parts();
            if let Ok(interpreter) = Interpreter::new(verified, arena) {
                Machine::new(interpreter, &counters).step();
            }
        });
        return Ok(());
    }
    let interpreter = Interpreter::new(verified, arena).map_err(|_| Problem::Arena)?;
    let mut machine = Machine::new(interpreter, &counters);
    for _ in 0..REST_STEPS {
        machine.step();
    }
    let before = counters.read();
    match drive {
        Drive::Script => {
            pass(&mut machine);
            meter.tell(row, &since(&before, &counters));
            meter.measure(row, SCRIPT_EVENTS, || pass(&mut machine));
            return Ok(());
        }
        Drive::Still => meter.measure(row, STEPS, || {
            for _ in 0..STEPS {
                machine.step();
            }
        }),
        Drive::Stirred => meter.measure(row, STEPS, || {
            for step in 0..STEPS {
                machine.set(STIR, step % 2 == 0);
                machine.step();
            }
        }),
        Drive::Set => meter.measure(row, STEPS, || {
            for step in 0..STEPS {
                machine.set(STIR, step % 2 == 0);
            }
        }),
        Drive::Flag(flag) => meter.measure_once(row, 1, || {
            machine.set(usize::from(flag), true);
            machine.step();
        }),
        Drive::Verify | Drive::Start => {}
    }
    meter.tell(row, &[since(&before, &counters).iter().sum()]);
    Ok(())
}

/// What was counted since.
fn since(before: &[u32; TRANSITIONS], counters: &TransitionCounters) -> [u32; TRANSITIONS] {
    let now = counters.read();
    core::array::from_fn(|index| now[index].wrapping_sub(before[index]))
}
