//! Scripts: behaviours one after the other, without a mission that says so.

use super::list::Key;
use crate::list_command::Call;
use esm_link::behaviours::{MAX_SCRIPT_STEPS, Reaction, ScriptState, ScriptStatus};
use esm_link::message::{Capacity, LinkError};

/// The steps of a script, as far as they are there.
#[derive(Clone, Copy, Debug)]
struct Steps {
    script: u32,
    calls: [Option<Call>; MAX_SCRIPT_STEPS],
}

impl Steps {
    fn forget_all(&mut self) {
        self.script = 0;
        for call in &mut self.calls {
            *call = None;
        }
    }

    const NONE: Self = Self {
        script: 0,
        calls: [None; MAX_SCRIPT_STEPS],
    };
}

/// How a step has ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum StepEnd {
    /// The next one follows.
    Done,
    /// The script ends with it.
    Failed,
    /// This one follows, which is a later one.
    GoOn(u8),
}

/// The script that runs, and the one whose steps arrive meanwhile.
#[derive(Debug)]
pub(super) struct Script {
    steps: [Steps; 2],
    /// Which of the two runs.
    runs: usize,
    status: ScriptStatus,
    /// Its step that is on the list.
    pub(super) current: Option<Key>,
}

impl Default for Script {
    fn default() -> Self {
        Self {
            steps: [Steps::NONE; 2],
            runs: 0,
            status: ScriptStatus::default(),
            current: None,
        }
    }
}

impl Script {
    /// There is none. In place, see [`Behaviours`](super::Behaviours).
    pub(super) fn forget_all(&mut self) {
        for steps in &mut self.steps {
            steps.forget_all();
        }
        self.status = ScriptStatus::default();
        self.current = None;
    }

    /// How it is.
    pub(super) fn status(&self) -> ScriptStatus {
        self.status
    }

    /// Whether it has not come to its end.
    pub(super) fn is_under_way(&self) -> bool {
        matches!(
            self.status.state,
            ScriptState::Runs | ScriptState::Suspended
        )
    }

    /// Puts a step away until all are there.
    ///
    /// # Errors
    /// [`LinkError::CapacityExceeded`]
    pub(super) fn put(&mut self, script: u32, index: u8, call: Call) -> Result<(), LinkError> {
        let Some(arriving) = self.steps.get_mut(1 - self.runs) else {
            return Err(LinkError::NoScript);
        };
        if arriving.script != script {
            arriving.forget_all();
            arriving.script = script;
        }
        match arriving.calls.get_mut(usize::from(index)) {
            Some(place) => {
                *place = Some(call);
                Ok(())
            }
            None => Err(too_many(index.saturating_add(1))),
        }
    }

    /// Begins the script whose steps have arrived: so many, and `all` with those that situations
    /// insert.
    ///
    /// # Errors
    /// [`LinkError::NoScript`] where some of them are not there, [`LinkError::NoSituation`] where
    /// one names a step that is not there, or goes on with one that is not later, or has one in its
    /// place that is not later, [`LinkError::CapacityExceeded`]
    pub(super) fn run(&mut self, script: u32, steps: u8, all: u8) -> Result<(), LinkError> {
        if usize::from(all) > MAX_SCRIPT_STEPS {
            return Err(too_many(all));
        }
        let arrived = (self.steps.get(1 - self.runs)).filter(|steps| steps.script == script);
        let calls = arrived.and_then(|arrived| arrived.calls.get(..usize::from(all)));
        let are_there = calls.is_some_and(|calls| calls.iter().all(Option::is_some));
        if !are_there || steps == 0 || steps > all {
            return Err(LinkError::NoScript);
        }
        let calls = (0..).zip(calls.into_iter().flatten().flatten());
        if !calls
            .into_iter()
            .all(|(index, call)| leads_on(index, call, steps, all))
        {
            return Err(LinkError::NoSituation);
        }
        self.runs = 1 - self.runs;
        if let Some(before) = self.steps.get_mut(1 - self.runs) {
            before.forget_all();
        }
        self.current = None;
        self.status = ScriptStatus {
            script,
            steps,
            ended: 0,
            state: ScriptState::Runs,
        };
        Ok(())
    }

    /// The step that is to come onto the list, if one is.
    pub(super) fn next(&self) -> Option<Call> {
        let is_due = self.status.state == ScriptState::Runs && self.current.is_none();
        is_due.then(|| self.call(self.status.ended)).flatten()
    }

    /// What a step inserts.
    pub(super) fn call(&self, step: u8) -> Option<Call> {
        let calls = &self.steps.get(self.runs)?.calls;
        calls.get(usize::from(step)).copied().flatten()
    }

    /// Its step is over.
    pub(super) fn end_step(&mut self, end: StepEnd) {
        self.current = None;
        match end {
            StepEnd::Failed => self.end(),
            StepEnd::GoOn(step) => self.status.ended = step,
            StepEnd::Done => self.status.ended += 1,
        }
        if self.status.ended == self.status.steps && self.is_under_way() {
            self.status.state = ScriptState::Done;
        }
    }

    /// It ends here.
    pub(super) fn end(&mut self) {
        self.current = None;
        if self.is_under_way() {
            self.status.state = ScriptState::Ended;
        }
    }

    /// It is suspended, or goes on.
    ///
    /// # Errors
    /// [`LinkError::NoScript`] where none is under way.
    pub(super) fn hold(&mut self, is_held: bool) -> Result<(), LinkError> {
        if !self.is_under_way() {
            return Err(LinkError::NoScript);
        }
        self.status.state = if is_held {
            ScriptState::Suspended
        } else {
            ScriptState::Runs
        };
        Ok(())
    }
}

/// Whether what a step names is there, and what follows it is behind it, so that each script comes
/// to an end.
fn leads_on(index: u8, call: &Call, steps: u8, all: u8) -> bool {
    let mut watches = call.watches.iter().flatten();
    watches.all(|watch| match watch.reaction {
        Reaction::GoOn(step) => index < step && step < steps,
        Reaction::Replace(step) => index < step && step < all,
        Reaction::Insert(step) => step < all,
        Reaction::Suspend | Reaction::Cancel | Reaction::EndScript | Reaction::Flag => true,
    })
}

fn too_many(needed: u8) -> LinkError {
    LinkError::CapacityExceeded {
        what: Capacity::ScriptSteps,
        needed: needed.into(),
        available: MAX_SCRIPT_STEPS as u32,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::declaration::Params;
    use esm_link::behaviours::{Situation, Watch};

    fn call(task: u64) -> Call {
        Call {
            task,
            params: Params::default(),
            watches: [None; 3],
        }
    }

    fn with_steps(count: u8) -> Script {
        let mut script = Script::default();
        for index in 0..count {
            script.put(7, index, call(index.into())).unwrap();
        }
        script
    }

    #[test]
    fn a_script_runs_only_whole_and_its_steps_follow_each_other() {
        let mut script = with_steps(3);
        assert_eq!(script.run(8, 3, 3), Err(LinkError::NoScript));
        assert_eq!(script.run(7, 3, 4), Err(LinkError::NoScript));
        assert_eq!(script.run(7, 0, 3), Err(LinkError::NoScript));
        assert_eq!(script.run(7, 3, 2), Err(LinkError::NoScript));
        assert_eq!(script.status().state, ScriptState::None);
        assert_eq!(script.run(7, 2, 3), Ok(()));
        assert_eq!(script.next(), Some(call(0)));
        script.current = Some(Key::of_number(5));
        assert_eq!(script.next(), None, "it is on the list");
        script.end_step(StepEnd::Done);
        assert_eq!(script.next(), Some(call(1)));
        script.end_step(StepEnd::Done);
        assert_eq!(
            (script.next(), script.status().state),
            (None, ScriptState::Done)
        );
        // What ran is no more there to be run once more.
        assert_eq!(script.run(7, 2, 3), Err(LinkError::NoScript));
    }

    #[test]
    fn one_that_arrives_leaves_the_one_that_runs_alone() {
        let mut script = with_steps(2);
        script.run(7, 2, 2).unwrap();
        script.put(9, 0, call(90)).unwrap();
        assert_eq!(script.next(), Some(call(0)));
        assert_eq!(script.call(1), Some(call(1)));
        script.run(9, 1, 1).unwrap();
        assert_eq!(script.next(), Some(call(90)));
    }

    #[test]
    fn steps_of_another_script_are_forgotten() {
        let mut script = with_steps(2);
        script.put(8, 0, call(80)).unwrap();
        assert_eq!(script.run(7, 2, 2), Err(LinkError::NoScript));
        assert_eq!(script.run(8, 1, 2), Err(LinkError::NoScript));
        assert_eq!(script.run(8, 1, 1), Ok(()));
    }

    #[test]
    fn a_step_that_fails_ends_it_and_a_held_one_goes_on_where_it_was() {
        let mut script = with_steps(2);
        assert_eq!(script.hold(true), Err(LinkError::NoScript));
        script.run(7, 2, 2).unwrap();
        script.hold(true).unwrap();
        assert_eq!(script.next(), None);
        script.hold(false).unwrap();
        assert_eq!(script.next(), Some(call(0)));
        script.end_step(StepEnd::Failed);
        assert_eq!(script.status().state, ScriptState::Ended);
        assert_eq!(script.next(), None);
        assert_eq!(script.hold(false), Err(LinkError::NoScript));
    }

    #[test]
    fn a_script_names_only_steps_that_are_there_and_goes_on_only_with_later_ones() {
        let with_reaction = |from: u8, reaction| {
            let mut script = with_steps(5);
            let mut step = call(from.into());
            step.watches[1] = Some(Watch {
                situation: Situation::Stuck,
                value: 0.0,
                reaction,
            });
            script.put(7, from, step).unwrap();
            let begun = script.run(7, 4, 5);
            (script, begun)
        };
        for (from, reaction, is_right) in [
            (1, Reaction::GoOn(2), true),
            (0, Reaction::GoOn(3), true),
            (1, Reaction::GoOn(1), false),
            (2, Reaction::GoOn(0), false),
            // Behind the last one, and from one that a situation inserts.
            (1, Reaction::GoOn(4), false),
            (4, Reaction::GoOn(3), false),
            // In its place also one that is no step by itself, but none before it.
            (1, Reaction::Replace(4), true),
            (1, Reaction::Replace(3), true),
            (1, Reaction::Replace(5), false),
            (1, Reaction::Replace(1), false),
            (4, Reaction::Replace(4), false),
            (4, Reaction::Replace(1), false),
            (1, Reaction::Insert(4), true),
            (1, Reaction::Insert(5), false),
        ] {
            let expected = if is_right {
                Ok(())
            } else {
                Err(LinkError::NoSituation)
            };
            let (_, begun) = with_reaction(from, reaction);
            assert_eq!(begun, expected, "{from}: {reaction:?}");
        }
        let (mut script, _) = with_reaction(0, Reaction::GoOn(3));
        script.current = Some(Key::of_number(5));
        script.end_step(StepEnd::GoOn(3));
        assert_eq!((script.next(), script.status().ended), (Some(call(3)), 3));
        script.end_step(StepEnd::Done);
        assert_eq!(script.status().state, ScriptState::Done);
    }

    #[test]
    fn there_is_room_for_so_many_steps_and_more_are_refused() {
        let mut script = with_steps(MAX_SCRIPT_STEPS as u8);
        let too_many = script.put(7, MAX_SCRIPT_STEPS as u8, call(0));
        assert!(matches!(
            too_many,
            Err(LinkError::CapacityExceeded {
                needed: 17,
                available: 16,
                ..
            })
        ));
        assert!(script.run(7, 16, 17).is_err());
        assert_eq!(script.run(7, 16, 16), Ok(()));
    }
}
