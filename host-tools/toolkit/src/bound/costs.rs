//! What a macro step is made of, and how many instructions each of that takes on a board.

use std::fmt;

/// Takes note of constructs that a macro step consists of: counts them, or adds up what they cost.
pub trait Ledger {
    /// `times` of a construct.
    fn add(&mut self, construct: Construct, times: usize);
}

macro_rules! constructs {
    ($( $(#[doc = $doc:literal])* $variant:ident $name:literal, )*) => {
        /// What a macro step is made of.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
        #[repr(usize)]
        pub enum Construct { $( $(#[doc = $doc])* $variant, )* }

        impl Construct {
            /// All of them.
            pub const ALL: [Self; [$(Self::$variant),*].len()] = [$(Self::$variant),*];

            /// Its name in files and tables.
            #[must_use]
            pub const fn name(self) -> &'static str {
                match self { $(Self::$variant => $name,)* }
            }

            /// What it is, in a line.
            #[must_use]
            pub const fn says(self) -> &'static str {
                match self { $(Self::$variant => concat!($($doc),*),)* }
            }
        }
    };
}

constructs! {
    /// A macro step in which nothing is awake.
    Quiet "quiet",
    /// What it is more where something is.
    Step "step",
    /// On a pulse, 32 regions of the machine.
    PulseWord "pulse_word",
    /// On a pulse, 32 regions of which some are visited.
    PulseWordVisit "pulse_word_visit",
    /// A look at all timers, because one may be due.
    Timers "timers",
    /// A region in that look.
    TimerRegion "timer_region",
    /// A timer that runs in that look.
    TimerRuns "timer_runs",
    /// A region that is visited on the pulse.
    PulseVisit "pulse_visit",
    /// A transition that is looked at on the pulse, with its guard of one flag.
    PulseTransition "pulse_transition",
    /// An event that is taken from the queue.
    Event "event",
    /// For an event, 32 regions among which some listen.
    EventWord "event_word",
    /// For an event, 32 regions of which some are visited.
    EventWordVisit "event_word_visit",
    /// A region that listens.
    Listener "listener",
    /// A region that listens and whose state waits for the event.
    EventVisit "event_visit",
    /// A transition that is looked at for an event.
    EventTransition "event_transition",
    /// A guard of one flag on an event.
    FlagGuard "flag_guard",
    /// A guard that compares several flags with a mask.
    MaskGuard "mask_guard",
    /// A guard that is a program.
    Program "program",
    /// A test of a flag in a program.
    Test "test",
    /// A test for what is busy inside a superstate.
    BusyTest "busy_test",
    /// A region that such a test looks at.
    BusyRegion "busy_region",
    /// A transition that changes nothing but the current state.
    Plain "plain",
    /// A real-time task state that is entered anew from itself on the pulse and sends one event,
    /// with all of that.
    Again "again",
    /// Any other transition.
    Taken "taken",
    /// A task state that is left.
    LeaveTask "leave_task",
    /// A superstate that is left.
    LeaveSuper "leave_super",
    /// 32 regions among which it has some.
    LeaveWord "leave_word",
    /// A task state inside it.
    TaskInside "task_inside",
    /// A task inside it that is disabled.
    TaskDisabled "task_disabled",
    /// Each 25 flags of the state that is entered, beyond the first.
    MoreFlags "more_flags",
    /// A state with a timeout that is entered.
    EnterTimed "enter_timed",
    /// A task state that is entered.
    EnterTask "enter_task",
    /// A `final` that is entered.
    EnterFinal "enter_final",
    /// A superstate that is entered.
    EnterSuper "enter_super",
    /// A region inside it.
    RegionInside "region_inside",
    /// A single action that sends an event.
    Send "send",
    /// A row of actions.
    Row "row",
    /// An action in a row that sends an event.
    RowSend "row_send",
    /// An action in a row that writes a flag.
    RowWrite "row_write",
    /// A flag of the superstate around that is written.
    WriteAround "write_around",
    /// 32 regions that are woken together.
    WakeWord "wake_word",
    /// The end of a machine by a fault.
    Fault "fault",
}

/// Number of constructs.
pub const CONSTRUCTS: usize = Construct::ALL.len();

/// How often each construct occurs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Counts([u64; CONSTRUCTS]);

impl Default for Counts {
    fn default() -> Self {
        Self([0; CONSTRUCTS])
    }
}

impl Counts {
    /// How often this one does.
    #[must_use]
    pub fn of(&self, construct: Construct) -> u64 {
        self.0[construct as usize]
    }
}

impl Ledger for Counts {
    fn add(&mut self, construct: Construct, times: usize) {
        let count = &mut self.0[construct as usize];
        *count = count.saturating_add(times as u64);
    }
}

/// Instructions that each construct takes at most, with one core and one way of compiling the
/// interpreter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Costs([u32; CONSTRUCTS]);

impl Default for Costs {
    fn default() -> Self {
        Self([0; CONSTRUCTS])
    }
}

/// Why a text does not say what constructs cost.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CostsError {
    /// It does not say what this one takes.
    #[error("what `{}` takes is missing", .0.name())]
    Missing(Construct),
    /// A line that is none of `name = number`, a comment, or empty.
    #[error("line {0}: neither `construct = instructions` nor a comment")]
    Line(usize),
}

impl Costs {
    /// Reads lines `construct = instructions`; what follows `#` is a comment.
    ///
    /// # Errors
    /// [`CostsError`]
    pub fn parse(text: &str) -> Result<Self, CostsError> {
        let mut found = [None; CONSTRUCTS];
        for (index, line) in text.lines().enumerate() {
            let line = line.split_once('#').map_or(line, |(before, _)| before);
            if line.trim().is_empty() {
                continue;
            }
            let place = || {
                let (name, number) = line.split_once('=')?;
                let construct = Construct::ALL
                    .into_iter()
                    .find(|known| known.name() == name.trim())?;
                Some((construct, number.trim().parse().ok()?))
            };
            let (construct, number) = place().ok_or(CostsError::Line(index + 1))?;
            found[construct as usize] = Some(number);
        }
        let mut costs = Self::default();
        for construct in Construct::ALL {
            let number = found[construct as usize].ok_or(CostsError::Missing(construct))?;
            costs.set(construct, number);
        }
        Ok(costs)
    }

    /// What one takes.
    #[must_use]
    pub fn of(&self, construct: Construct) -> u32 {
        self.0[construct as usize]
    }

    /// Says what one takes.
    pub fn set(&mut self, construct: Construct, instructions: u32) {
        self.0[construct as usize] = instructions;
    }

    /// What all that was counted takes.
    #[must_use]
    pub fn total(&self, counts: &Counts) -> u64 {
        let each = Construct::ALL
            .into_iter()
            .map(|construct| u64::from(self.of(construct)).saturating_mul(counts.of(construct)));
        each.fold(0, u64::saturating_add)
    }

    /// A ledger that adds up.
    #[must_use]
    pub fn sum(&self) -> Sum<'_> {
        Sum {
            costs: self,
            instructions: 0,
        }
    }
}

impl fmt::Display for Costs {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for construct in Construct::ALL {
            writeln!(
                f,
                "{} = {} #{}",
                construct.name(),
                self.of(construct),
                construct.says()
            )?;
        }
        Ok(())
    }
}

/// Adds up what constructs cost.
#[derive(Clone, Debug)]
pub struct Sum<'c> {
    costs: &'c Costs,
    /// The sum so far.
    pub instructions: u64,
}

impl Ledger for Sum<'_> {
    fn add(&mut self, construct: Construct, times: usize) {
        let cost = u64::from(self.costs.of(construct)).saturating_mul(times as u64);
        self.instructions = self.instructions.saturating_add(cost);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn costs_are_read_as_they_are_written() {
        let mut costs = Costs::default();
        for (number, construct) in Construct::ALL.into_iter().enumerate() {
            costs.set(construct, 10 + number as u32);
        }
        assert_eq!(Costs::parse(&costs.to_string()), Ok(costs));
    }

    #[test]
    fn what_is_no_list_of_costs_is_told_by_its_line_or_by_what_is_missing() {
        let whole = Costs::default().to_string();
        let cases = [
            (
                whole.clone() + "new = 3\n",
                CostsError::Line(CONSTRUCTS + 1),
            ),
            (format!("step\n{whole}"), CostsError::Line(1)),
            (format!("# all\n\nstep = x\n{whole}"), CostsError::Line(3)),
            (
                whole.replace("program = 0", "# program = 0"),
                CostsError::Missing(Construct::Program),
            ),
        ];
        for (text, expected) in cases {
            assert_eq!(Costs::parse(&text), Err(expected), "{text}");
        }
    }

    #[test]
    fn counts_cost_what_a_sum_of_the_same_constructs_says() {
        let mut costs = Costs::default();
        costs.set(Construct::Send, 7);
        costs.set(Construct::Step, 100);
        let (mut counts, mut sum) = (Counts::default(), costs.sum());
        for (construct, times) in [(Construct::Step, 1), (Construct::Send, 3)] {
            counts.add(construct, times);
            sum.add(construct, times);
        }
        assert_eq!((costs.total(&counts), sum.instructions), (121, 121));
    }
}
