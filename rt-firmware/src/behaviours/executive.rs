//! The owner of the list of behaviours.

use super::inserted::{At, Inserted, Surroundings};
use super::landmarks::Landmarks;
use super::list::{BehaviourList, Key, MAX_BEHAVIOURS};
use super::place::Turn;
use super::remote_control::RemoteControl;
use super::repertoire::Repertoire;
use super::script::{Script, StepEnd};
use super::shipped::ShippedLaws;
use super::told::{MAX_CHANGES, ToldList};
use crate::features::NOTES;
use crate::list_command::{Answer, Call, ListCommand, MAX_ENTRIES, Report};
use crate::notes::MAX_NOTES;
use crate::odometry::pose_events;
use crate::ports::Io;
use crate::task;
use crate::task::{Step, Task};
use crate::tasks::{Battery, Pose, Ranges, Twist};
use esm_link::behaviours::{ListEntry, Origin, Reaction};
use esm_link::black_box::{Event, PoseFrame};
use esm_link::message::LinkError;
use heapless::Vec;

const _: () = assert!(MAX_ENTRIES == MAX_BEHAVIOURS + 1);

/// How many behaviours the link and the script can have on the list at once, each with its law:
/// they take 400 bytes of RAM each. Those of task states bring their own.
pub const MAX_INSERTED: usize = 5;
const _: () = assert!(MAX_INSERTED <= MAX_BEHAVIOURS);

/// Owns the list: makes it, takes off whose task state was left, and passes on what the behaviour
/// that executes asks for. Where nobody does, the robot stands still. It executes those itself that
/// the link or a script has inserted: whatever is in its [`Repertoire`].
#[derive(Debug)]
pub struct Behaviours<R = ShippedLaws> {
    inserted: [Option<Inserted<R>>; MAX_INSERTED],
    remote: Option<RemoteControl>,
    script: Script,
    landmarks: Landmarks,
    /// Somebody watches for one.
    looks_for_landmarks: bool,
    told: ToldList,
    /// Something was told, and not yet where the robot was.
    owes_pose: bool,
    /// What its flags say, in the order in which they are declared: they are written where one
    /// changes. None where nobody knows.
    says: Option<[bool; 4]>,
}

impl<R> Default for Behaviours<R> {
    fn default() -> Self {
        Self {
            inserted: [const { None }; MAX_INSERTED],
            remote: None,
            script: Script::default(),
            landmarks: Landmarks::NONE,
            looks_for_landmarks: false,
            told: ToldList::default(),
            owes_pose: false,
            says: None,
        }
    }
}

task! {
    /// Owns the list of behaviours, and moves as the one says that executes; it stands still while
    /// none does. Behaviours run in its slot, and share its lists: `path Run.made -> Run.list,
    /// Go.list;`. With `pose` and `ranges` it can be steered by hand (`esm drive`), and behaviours
    /// can be inserted while the mission runs (`esm behaviours insert`, `esm script`).
    impl[R: Repertoire] Behaviours<R> {
        slot 2;
        wcet 600 us;
        endless;
        data {
            /// A list with nobody on it, once.
            out made: BehaviourList;
            /// The list of behaviours.
            inout list: BehaviourList optional;
            /// How the robot is to move.
            out twist: Twist;
            /// Where the robot is.
            in pose: Pose optional within 100 ms;
            /// What is around it.
            in ranges: Ranges optional within 200 ms;
            /// The battery, for who watches it.
            in battery: Battery optional;
        }
        flags {
            /// Nobody is on the list, or IDLE executes.
            out idle;
            /// A situation has come up whose reaction is `flag`.
            out noticed;
            /// It is steered by hand.
            out remote;
            /// A script is under way.
            out script;
        }
    }
}

/// What follows one that has left the list.
#[derive(Clone, Copy, Debug)]
enum Follows {
    /// The next step of its script, or none.
    Step(StepEnd),
    /// A step that takes its place, and is held where that was.
    Replacement { step: u8, at: At, is_held: bool },
}

/// Situations that are told of one activation: one for each behaviour, and one that each has.
const MAX_CAME_UP: usize = MAX_BEHAVIOURS + 1;

/// Those and the changes of the list are the most that is noted in one activation.
const _: () = assert!(MAX_CAME_UP + MAX_CHANGES <= MAX_NOTES);

struct Situations(Vec<Event, MAX_CAME_UP>);

impl Situations {
    const fn new() -> Self {
        Self(Vec::new())
    }

    /// One more, if there is room.
    fn note(&mut self, key: Key, task: u16, situation: u8, reaction: Reaction) {
        let _ = self.0.push(Event::Situation {
            key: key.number(),
            task,
            situation,
            reaction: reaction.kind(),
        });
    }
}

impl<R: Repertoire> Task for Behaviours<R> {
    fn reset(&mut self) {
        self.forget_all();
    }

    fn enter(&mut self) {
        self.says = None;
    }

    fn step(&mut self, io: &mut Io<'_>) -> Step {
        let around = Surroundings {
            pose: io.try_read(Self::POSE).copied(),
            ranges: io.try_read(Self::RANGES),
            battery_v: (io.try_read(Self::BATTERY)).map(|battery| battery.voltage_v),
            period_us: io.period_us(),
            robot_us: io.robot_us(),
        };
        let command = io.take_list_command();
        let Some(list) = io.try_update(Self::LIST) else {
            // The list of the mission before is gone, and who was on it.
            self.forget_all();
            *io.write(Self::MADE) = BehaviourList::EMPTY;
            *io.write(Self::TWIST) = Twist::STILL;
            io.set(Self::IDLE, true);
            self.says = None;
            if command.is_some() {
                io.answer_list_command(Answer::Refused(LinkError::NoBehaviours));
            }
            return Step::Run;
        };
        let answer = (command.as_ref()).map(|command| self.carry_out(command, list, &around));
        let mut came_up = Situations::new();
        let noticed = self.execute(list, &around, &mut came_up);
        for told in list.take_came_up().into_iter().flatten() {
            // Of one that came and went in this activation nothing is told.
            if let Some(task) = list.task(told.key).or_else(|| self.told.task(told.key)) {
                came_up.note(told.key, task, told.situation, told.reaction);
            }
        }
        let twist = list.take_asked();
        list.look();
        let changes = if NOTES {
            self.told.changes(list)
        } else {
            Vec::new()
        };
        let is_idle = list.is_empty() || list.head() == Some(Key::IDLE);
        if let Some(answer) = answer {
            io.answer_list_command(answer);
        }
        *io.write(Self::TWIST) = twist;
        // First why, then what has changed. Where that was follows in the next activation without
        // anything new, so that no single one takes the time for all of it.
        let happened = came_up.0.iter().chain(&changes);
        happened.for_each(|event| io.note(*event));
        if !came_up.0.is_empty() || !changes.is_empty() {
            self.owes_pose = true;
        } else if let Some(pose) = around.pose.filter(|_| self.owes_pose) {
            let events = pose_events(&pose, PoseFrame::Counted);
            events.into_iter().for_each(|event| io.note(event));
            self.owes_pose = false;
        }
        let flags = [
            (Self::IDLE, is_idle),
            (Self::NOTICED, noticed),
            (Self::REMOTE, self.remote.is_some()),
            (Self::SCRIPT, self.script.is_under_way()),
        ];
        let says = flags.map(|(_, is_set)| is_set);
        if self.says != Some(says) {
            self.says = Some(says);
            flags
                .into_iter()
                .for_each(|(flag, is_set)| io.set(flag, is_set));
        }
        Step::Run
    }
}

impl<R: Repertoire> Behaviours<R> {
    /// Nobody was inserted. In place, for a second one of these would take kilobytes of the stack.
    fn forget_all(&mut self) {
        for place in &mut self.inserted {
            *place = None;
        }
        self.remote = None;
        self.script.forget_all();
        self.told.forget();
        self.owes_pose = false;
    }

    /// Lets all execute that no task state has inserted. Whether a situation is up that is to be
    /// noticed.
    fn execute(
        &mut self,
        list: &mut BehaviourList,
        around: &Surroundings<'_>,
        came_up: &mut Situations,
    ) -> bool {
        let remote = self.remote.take();
        self.remote = remote.filter(|remote| remote.step(list, around));
        let mut has_heard = false;
        let mut noticed = false;
        for place in 0..MAX_INSERTED {
            let Some(Some(inserted)) = self.inserted.get_mut(place) else {
                continue;
            };
            let (key, origin, task) = (inserted.key, inserted.origin, inserted.task);
            let when_failed = inserted.when_failed();
            let at = At::Place(list.place_of(key).unwrap_or(0));
            let is_held = list.is_held(key);
            let (turn, reactions) = inserted.step(list, around, &self.landmarks);
            for (situation, reaction) in reactions.came_up.into_iter().flatten() {
                came_up.note(key, task, situation as u8, reaction);
            }
            noticed |= reactions.flag;
            has_heard |= inserted.has_heard();
            if reactions.end_script {
                self.end_script(list);
            }
            if let Turn::Ends { failed } = turn {
                let replace = |step| Follows::Replacement { step, at, is_held };
                let follows = match (reactions.go_on, reactions.replace, when_failed) {
                    (Some(step), _, _) => Follows::Step(StepEnd::GoOn(step)),
                    (None, Some(step), _) => replace(step),
                    _ if !failed => Follows::Step(StepEnd::Done),
                    (None, None, Reaction::Cancel) => Follows::Step(StepEnd::Done),
                    (None, None, Reaction::GoOn(step)) => Follows::Step(StepEnd::GoOn(step)),
                    (None, None, Reaction::Replace(step)) => replace(step),
                    _ => Follows::Step(StepEnd::Failed),
                };
                self.follow(list, key, follows, around);
            }
            // Where there is no room, the behaviour goes on as if nothing were.
            if let Some(step) = reactions.insert
                && origin == Origin::Script
                && let Some(call) = self.script.call(step)
            {
                let _ = self.insert(list, &call, Origin::Script, At::Head, around.pose);
            }
        }
        self.go_on(list, around);
        self.look_for_landmarks(list, around, has_heard);
        noticed
    }

    /// Looks for landmarks, as long as somebody watches for one, behind those who watch: so it can
    /// do less where a law had much to do.
    fn look_for_landmarks(
        &mut self,
        list: &BehaviourList,
        around: &Surroundings<'_>,
        is_busy: bool,
    ) {
        let mut inserted = self.inserted.iter().flatten();
        if !inserted.any(Inserted::has_landmarks) {
            // Once: they take 200 bytes.
            if core::mem::take(&mut self.looks_for_landmarks) {
                self.landmarks = Landmarks::NONE;
            }
            return;
        }
        self.looks_for_landmarks = true;
        let way_round = list.way_round;
        let mut room = None;
        let ranges = way_round.ranges(around.ranges, &mut room);
        let pose = around.pose.map(|pose| way_round.pose(pose));
        (self.landmarks).look(pose.as_ref(), ranges, around.period_us, is_busy);
    }

    /// Puts the next step of the script onto the list, if it is its turn. Where there is no room,
    /// it waits.
    fn go_on(&mut self, list: &mut BehaviourList, around: &Surroundings<'_>) {
        let Some(call) = self.script.next() else {
            return;
        };
        match self.insert(list, &call, Origin::Script, At::Tail, around.pose) {
            Ok(key) => self.script.current = Some(key),
            Err(LinkError::ListFull | LinkError::NoBehaviours) => {}
            Err(_) => self.script.end(),
        }
    }

    fn insert(
        &mut self,
        list: &mut BehaviourList,
        call: &Call,
        origin: Origin,
        at: At,
        pose: Option<Pose>,
    ) -> Result<Key, LinkError> {
        let place = self.inserted.iter_mut().find(|place| place.is_none());
        let place = place.ok_or(LinkError::ListFull)?;
        let inserted = Inserted::new(list, call, origin, at, pose)?;
        let key = inserted.key;
        *place = Some(inserted);
        Ok(key)
    }

    /// One has left the list, and this follows it.
    fn follow(
        &mut self,
        list: &mut BehaviourList,
        key: Key,
        follows: Follows,
        around: &Surroundings<'_>,
    ) {
        let (step, at, is_held) = match follows {
            Follows::Step(end) => return self.forget(key, end),
            Follows::Replacement { step, at, is_held } => (step, at, is_held),
        };
        let is_step = self.script.current == Some(key);
        let inserted = (self.take_off(key))
            .filter(|origin| *origin == Origin::Script)
            .and_then(|_| self.script.call(step))
            .and_then(|call| (self.insert(list, &call, Origin::Script, at, around.pose)).ok());
        if let Some(key) = inserted {
            list.hold(key, is_held);
        }
        match inserted {
            Some(_) if is_step => self.script.current = inserted,
            // Nobody knows where the robot is.
            None if is_step => self.script.end_step(StepEnd::Failed),
            _ => {}
        }
    }

    /// Gives a place back, and says who had put the behaviour onto the list.
    fn take_off(&mut self, key: Key) -> Option<Origin> {
        let is_this = |inserted: &mut Inserted<R>| inserted.key == key;
        let mut places = self.inserted.iter_mut();
        let taken = places.find_map(|place| place.take_if(is_this))?;
        Some(taken.origin)
    }

    /// One that has left the list.
    fn forget(&mut self, key: Key, end: StepEnd) {
        self.take_off(key);
        if self.script.current == Some(key) {
            self.script.end_step(end);
        }
    }

    /// The script ends, and what it has put onto the list leaves it.
    fn end_script(&mut self, list: &mut BehaviourList) {
        self.script.end();
        self.take_script_off(list);
    }

    fn take_script_off(&mut self, list: &mut BehaviourList) {
        for place in &mut self.inserted {
            let of_script = |inserted: &mut Inserted<R>| inserted.origin == Origin::Script;
            if let Some(inserted) = place.take_if(of_script) {
                list.end(inserted.key);
            }
        }
    }

    fn carry_out(
        &mut self,
        command: &ListCommand,
        list: &mut BehaviourList,
        around: &Surroundings<'_>,
    ) -> Answer {
        let result = match *command {
            ListCommand::Read => return Answer::List(self.report(list)),
            ListCommand::Insert { at_head, ref call } => {
                let at = if at_head { At::Head } else { At::Tail };
                let inserted = self.insert(list, call, Origin::Link, at, around.pose);
                return inserted.map_or_else(Answer::Refused, |key| Answer::Inserted(key.number()));
            }
            ListCommand::Cancel(key) => self.cancel(list, Key::of_number(key)),
            ListCommand::Hold(key, is_held) => {
                let key = Key::of_number(key);
                let is_remote = self.remote.is_some_and(|remote| remote.key() == key);
                if !is_remote && list.hold(key, is_held) {
                    Ok(())
                } else {
                    Err(LinkError::NotOnList)
                }
            }
            ListCommand::Drive {
                forward_m_per_s,
                turn_rad_per_s,
                until_us,
            } => {
                let twist = Twist {
                    forward_m_per_s,
                    turn_rad_per_s,
                };
                RemoteControl::drive(self.remote, list, twist, until_us, around.robot_us)
                    .map(|remote| self.remote = Some(remote))
            }
            ListCommand::EndDrive => {
                if let Some(remote) = self.remote.take() {
                    list.end(remote.key());
                }
                Ok(())
            }
            ListCommand::Step {
                script,
                index,
                call,
            } => match R::of_task(call.task) {
                Some(_) => self.script.put(script, index, call),
                None => Err(LinkError::NotABehaviour),
            },
            ListCommand::Run { script, steps, all } => self.run(list, script, steps, all),
            ListCommand::EndScript => {
                self.end_script(list);
                Ok(())
            }
            ListCommand::HoldScript(is_held) => self.hold_script(list, is_held),
            // It does not come here.
            ListCommand::Position(..) => Err(LinkError::NoPosition),
        };
        result.map_or_else(Answer::Refused, |()| Answer::Done)
    }

    /// Begins a script in the place of the one before.
    fn run(
        &mut self,
        list: &mut BehaviourList,
        script: u32,
        steps: u8,
        all: u8,
    ) -> Result<(), LinkError> {
        self.script.run(script, steps, all)?;
        self.take_script_off(list);
        Ok(())
    }

    fn hold_script(&mut self, list: &mut BehaviourList, is_held: bool) -> Result<(), LinkError> {
        self.script.hold(is_held)?;
        for inserted in self.inserted.iter().flatten() {
            if inserted.origin == Origin::Script {
                list.hold(inserted.key, is_held);
            }
        }
        Ok(())
    }

    /// Takes one off, whoever has put it there. A script goes on with its next step. A task state
    /// of the mission finds out in its next step, and has failed.
    fn cancel(&mut self, list: &mut BehaviourList, key: Key) -> Result<(), LinkError> {
        if key == Key::IDLE || !list.end(key) {
            return Err(LinkError::NotOnList);
        }
        self.forget(key, StepEnd::Done);
        let _ = self.remote.take_if(|remote| remote.key() == key);
        Ok(())
    }

    fn report(&self, list: &BehaviourList) -> Report {
        let mut report = Report::new(self.script.status());
        for (key, task, state, is_held) in list.entries() {
            let mut inserted = self.inserted.iter().flatten();
            let origin = if key == Key::IDLE {
                Origin::Idle
            } else if self.remote.is_some_and(|remote| remote.key() == key) {
                Origin::Remote
            } else {
                let of_key = inserted.find(|inserted| inserted.key == key);
                of_key.map_or(Origin::Mission, |inserted| inserted.origin)
            };
            report.push(ListEntry {
                key: key.number(),
                task,
                state: state as u8,
                origin,
                is_held,
            });
        }
        report
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::TaskBench;
    use crate::behaviours::{GoTo, LifeState, Move, TurnTo};
    use crate::declaration::Params;
    use crate::declaration_of;
    use esm_link::behaviours::{MAX_WATCHES, ScriptState, Situation, Watch};

    type Owner = Behaviours;

    const PERIOD_US: u64 = 20_000;
    const AHEAD: Twist = forwards(0.2);

    const fn forwards(forward_m_per_s: f32) -> Twist {
        Twist {
            forward_m_per_s,
            turn_rad_per_s: 0.0,
        }
    }

    /// An owner with its list, at the start, with free way all around.
    struct Robot {
        bench: TaskBench<'static>,
        now_us: u64,
    }

    impl Robot {
        fn new() -> Self {
            let mut bench = TaskBench::new(Owner::default());
            bench
                .period_us(PERIOD_US as u32)
                .give(Owner::POSE, Pose::START)
                .give(Owner::RANGES, Ranges::FREE);
            bench.step();
            let made: BehaviourList = bench.output(Owner::MADE).unwrap();
            bench.give(Owner::LIST, made);
            Self {
                bench,
                now_us: PERIOD_US,
            }
        }

        /// How it moves after the next activation.
        fn moves(&mut self) -> Twist {
            self.bench.step();
            self.now_us += PERIOD_US;
            self.bench.output(Owner::TWIST).unwrap()
        }

        fn asks(&mut self, command: ListCommand) -> Answer {
            self.bench.list_command(command);
            self.moves();
            self.bench.list_answer().unwrap()
        }

        fn inserts(&mut self, at_head: bool, call: Call) -> u16 {
            match self.asks(ListCommand::Insert { at_head, call }) {
                Answer::Inserted(key) => key,
                other => panic!("{other:?}"),
            }
        }

        fn report(&mut self) -> (ScriptState, std::vec::Vec<ListEntry>) {
            let Answer::List(report) = self.asks(ListCommand::Read) else {
                panic!("no list");
            };
            let entries = report.bytes().as_chunks().0.iter();
            let entries = entries.map(|bytes| ListEntry::of_bytes(*bytes).unwrap());
            (report.script.state, entries.collect())
        }

        /// A script whose first `steps` are its own, and the others what its situations insert.
        fn takes_script(&mut self, script: u32, steps: u8, calls: &[Call]) {
            for (index, call) in (0..).zip(calls.iter().copied()) {
                let step = ListCommand::Step {
                    script,
                    index,
                    call,
                };
                assert_eq!(self.asks(step), Answer::Done);
            }
            let run = ListCommand::Run {
                script,
                steps,
                all: calls.len() as u8,
            };
            assert_eq!(self.asks(run), Answer::Done);
        }

        fn drives(&mut self, twist: Twist, for_us: u64) -> Answer {
            self.asks(ListCommand::Drive {
                forward_m_per_s: twist.forward_m_per_s,
                turn_rad_per_s: twist.turn_rad_per_s,
                until_us: self.now_us + for_us,
            })
        }

        fn is_at(&mut self, pose: Pose) {
            self.bench.give(Owner::POSE, pose);
        }
    }

    fn call(task: u64, params: &[f32]) -> Call {
        let mut bits = [0; 8];
        for (place, value) in bits.iter_mut().zip(params) {
            *place = value.to_bits();
        }
        Call {
            task,
            params: Params::from(bits),
            watches: [None; MAX_WATCHES],
        }
    }

    fn ahead() -> Call {
        call(declaration_of::<Move>().signature_hash, &[0.2])
    }

    fn turn() -> Call {
        call(declaration_of::<TurnTo>().signature_hash, &[1.0])
    }

    fn go_to(x_m: f32) -> Call {
        call(declaration_of::<GoTo>().signature_hash, &[x_m, 0.0, 0.25])
    }

    fn watched(call: Call, situation: Situation, value: f32, reaction: Reaction) -> Call {
        let watch = Watch {
            situation,
            value,
            reaction,
        };
        Call {
            watches: [Some(watch), None, None],
            ..call
        }
    }

    #[test]
    fn behaviours_are_inserted_at_both_ends_and_taken_off() {
        let mut robot = Robot::new();
        let first = robot.inserts(false, ahead());
        assert_eq!(robot.moves(), AHEAD);
        let second = robot.inserts(true, turn());
        assert_eq!(robot.moves().forward_m_per_s, 0.0);
        assert!(robot.moves().turn_rad_per_s > 0.0);
        let (_, entries) = robot.report();
        let states = entries.iter().map(|entry| (entry.key, entry.state));
        let expected = [
            (second, LifeState::Execute as u8),
            (first, LifeState::Resume as u8),
        ];
        assert!(states.eq(expected), "{entries:?}");
        assert!(entries.iter().all(|entry| entry.origin == Origin::Link));
        assert_eq!(robot.asks(ListCommand::Cancel(second)), Answer::Done);
        assert_eq!(robot.moves(), AHEAD);
        let refused = Answer::Refused(LinkError::NotOnList);
        for key in [second, Key::IDLE.number(), 999] {
            assert_eq!(robot.asks(ListCommand::Cancel(key)), refused);
            assert_eq!(robot.asks(ListCommand::Hold(key, true)), refused);
        }
    }

    #[test]
    fn a_full_list_refuses_and_says_so_and_so_does_one_without_a_pose() {
        let mut robot = Robot::new();
        for _ in 0..MAX_INSERTED {
            robot.inserts(false, ahead());
        }
        let insert = |at_head| ListCommand::Insert {
            at_head,
            call: ahead(),
        };
        let full = Answer::Refused(LinkError::ListFull);
        assert_eq!(robot.asks(insert(false)), full);
        assert_eq!(robot.asks(insert(true)), full);
        // Who steers by hand has a place of his own.
        assert_eq!(robot.drives(AHEAD, 100_000), Answer::Done);
        let mut robot = Robot::new();
        robot.bench.take_away(Owner::POSE);
        let lost = Answer::Refused(LinkError::NoBehaviours);
        assert_eq!(robot.asks(insert(false)), lost);
        let strange = ListCommand::Insert {
            at_head: false,
            call: call(1, &[]),
        };
        let none = Answer::Refused(LinkError::NotABehaviour);
        assert_eq!(robot.asks(strange), none);
    }

    #[test]
    fn one_that_is_suspended_by_hand_waits_until_it_is_resumed() {
        let mut robot = Robot::new();
        let key = robot.inserts(false, ahead());
        assert_eq!(robot.asks(ListCommand::Hold(key, true)), Answer::Done);
        for _ in 0..100 {
            assert_eq!(robot.moves(), Twist::STILL);
        }
        let (_, entries) = robot.report();
        assert_eq!(entries[0].origin, Origin::Idle);
        assert!(entries[1].is_held);
        assert_eq!(robot.asks(ListCommand::Hold(key, false)), Answer::Done);
        let resumed = (0..40).find(|_| robot.moves() == AHEAD);
        assert!(resumed.is_some(), "half a second later");
    }

    #[test]
    fn who_steers_by_hand_is_before_all_others_for_as_long_as_it_holds() {
        let mut robot = Robot::new();
        robot.inserts(false, ahead());
        assert_eq!(robot.moves(), AHEAD);
        let back = forwards(-0.1);
        assert_eq!(robot.drives(back, 300_000), Answer::Done);
        let by_hand = (0..100).take_while(|_| robot.moves() == back).count();
        assert_eq!(by_hand, 15, "300 ms after the activation that began it");
        assert!(!robot.bench.flag(Owner::REMOTE));
        assert_eq!(robot.moves(), AHEAD, "the one before goes on");
        // Renewed in time it goes on, and its end is at once.
        for _ in 0..10 {
            assert_eq!(robot.drives(back, 200_000), Answer::Done);
            assert_eq!(robot.moves(), back);
        }
        assert!(robot.bench.flag(Owner::REMOTE));
        let (_, entries) = robot.report();
        assert_eq!((entries.len(), entries[0].origin), (2, Origin::Remote));
        assert_eq!(robot.asks(ListCommand::EndDrive), Answer::Done);
        assert_eq!(robot.moves(), AHEAD);
        // What comes too late does nothing.
        let late = ListCommand::Drive {
            forward_m_per_s: -0.1,
            turn_rad_per_s: 0.0,
            until_us: robot.now_us - 1,
        };
        assert_eq!(robot.asks(late), Answer::Refused(LinkError::Late));
        assert_eq!(robot.moves(), AHEAD);
    }

    #[test]
    fn nobody_steers_into_what_is_in_the_way() {
        let mut robot = Robot::new();
        let mut wall = Ranges::FREE;
        wall.range_m[0] = 0.25;
        robot.bench.give(Owner::RANGES, wall);
        for (twist, is_free) in [
            (forwards(0.3), false),
            (forwards(-0.3), true),
            (
                Twist {
                    forward_m_per_s: 0.0,
                    turn_rad_per_s: 1.0,
                },
                true,
            ),
        ] {
            robot.drives(twist, 200_000);
            let expected = if is_free { twist } else { Twist::STILL };
            assert_eq!(robot.moves(), expected, "{twist:?}");
        }
        robot.bench.take_away(Owner::RANGES);
        robot.drives(forwards(0.1), 200_000);
        assert_eq!(robot.moves(), Twist::STILL, "nobody knows the way");
    }

    #[test]
    fn a_script_does_its_steps_one_after_the_other() {
        let mut robot = Robot::new();
        for (index, call) in [go_to(1.0), turn(), go_to(1.0)].into_iter().enumerate() {
            let step = ListCommand::Step {
                script: 3,
                index: index as u8,
                call,
            };
            assert_eq!(robot.asks(step), Answer::Done);
        }
        let run = |steps, all| ListCommand::Run {
            script: 3,
            steps,
            all,
        };
        let missing = Answer::Refused(LinkError::NoScript);
        assert_eq!(robot.asks(run(4, 4)), missing);
        assert_eq!(robot.moves(), Twist::STILL);
        assert_eq!(robot.asks(run(3, 3)), Answer::Done);
        assert!(robot.moves().forward_m_per_s > 0.0);
        assert!(robot.bench.flag(Owner::SCRIPT));
        let mut pose = Pose {
            x_m: 1.0,
            ..Pose::START
        };
        robot.is_at(pose);
        robot.moves();
        assert!(robot.moves().turn_rad_per_s > 0.0, "the second step");
        // Held, it stands; going on, it turns on.
        assert_eq!(robot.asks(ListCommand::HoldScript(true)), Answer::Done);
        for _ in 0..60 {
            assert_eq!(robot.moves(), Twist::STILL);
        }
        assert_eq!(robot.asks(ListCommand::HoldScript(false)), Answer::Done);
        let resumed = (0..40).find(|_| robot.moves().turn_rad_per_s > 0.0);
        assert!(resumed.is_some());
        pose.heading_rad = 1.0;
        robot.is_at(pose);
        robot.moves();
        assert!(robot.moves().forward_m_per_s > 0.0, "the third step");
        robot.is_at(pose.translate(1.0, 0.0));
        robot.moves();
        assert_eq!(robot.moves(), Twist::STILL);
        let (state, entries) = robot.report();
        assert_eq!((state, entries.len()), (ScriptState::Done, 0));
        assert!(!robot.bench.flag(Owner::SCRIPT));
    }

    /// A script of one step with a situation, and one step that the situation may insert.
    fn with_situation(reaction: Reaction) -> Robot {
        let mut robot = Robot::new();
        let step = watched(go_to(5.0), Situation::OutsideRange, 2.0, reaction);
        robot.takes_script(1, 1, &[step, turn()]);
        assert!(robot.moves().forward_m_per_s > 0.0);
        robot.is_at(Pose {
            x_m: 2.1,
            ..Pose::START
        });
        robot
    }

    #[test]
    fn a_situation_does_what_its_reaction_says() {
        for (reaction, moves, state, len) in [
            (Reaction::Cancel, Twist::STILL, ScriptState::Done, 0),
            (Reaction::EndScript, Twist::STILL, ScriptState::Ended, 0),
            (Reaction::Suspend, Twist::STILL, ScriptState::Runs, 2),
            (Reaction::Flag, forwards(0.25), ScriptState::Runs, 1),
        ] {
            let mut robot = with_situation(reaction);
            robot.moves();
            assert_eq!(robot.moves(), moves, "{reaction:?}");
            assert_eq!(robot.bench.flag(Owner::NOTICED), reaction == Reaction::Flag);
            let (is, entries) = robot.report();
            assert_eq!((is, entries.len()), (state, len), "{reaction:?}");
        }
        // Suspended only as long as it lasts.
        let mut robot = with_situation(Reaction::Suspend);
        robot.moves();
        robot.is_at(Pose {
            x_m: 1.9,
            ..Pose::START
        });
        let resumed = (0..40).find(|_| robot.moves().forward_m_per_s > 0.0);
        assert_eq!(resumed, Some(25), "half a second");
    }

    #[test]
    fn a_situation_inserts_a_step_before_it_which_resumes_afterwards() {
        let mut robot = with_situation(Reaction::Insert(1));
        robot.moves();
        assert!(robot.moves().turn_rad_per_s > 0.0);
        let (_, entries) = robot.report();
        assert!(entries.iter().all(|entry| entry.origin == Origin::Script));
        assert_eq!(entries.len(), 2);
        robot.is_at(Pose {
            x_m: 2.1,
            y_m: 0.0,
            heading_rad: 1.0,
        });
        robot.moves();
        let (state, entries) = robot.report();
        assert_eq!(
            (state, entries.len()),
            (ScriptState::Runs, 1),
            "{entries:?}"
        );
        // Its end takes what it has inserted with it.
        let mut robot = with_situation(Reaction::Insert(1));
        robot.moves();
        assert_eq!(robot.asks(ListCommand::EndScript), Answer::Done);
        let (state, entries) = robot.report();
        assert_eq!((state, entries.len()), (ScriptState::Ended, 0));
    }

    #[test]
    fn a_step_in_the_place_of_another_executes_there_and_the_script_goes_on_behind_it() {
        let mut robot = Robot::new();
        let first = watched(
            go_to(5.0),
            Situation::OutsideRange,
            2.0,
            Reaction::Replace(2),
        );
        robot.takes_script(1, 2, &[first, go_to(0.5), turn()]);
        // One that waits behind it still does.
        let waits = robot.inserts(false, ahead());
        robot.is_at(Pose {
            x_m: 2.1,
            ..Pose::START
        });
        robot.moves();
        assert!(robot.moves().turn_rad_per_s > 0.0);
        let (state, entries) = robot.report();
        let places = entries.iter().map(|entry| (entry.origin, entry.key));
        let expected = [(Origin::Script, waits + 1), (Origin::Link, waits)];
        assert!(places.eq(expected), "{entries:?}");
        assert_eq!(state, ScriptState::Runs);
        // Suspended by hand it does not turn, which is one step with what it replaces.
        assert_eq!(robot.asks(ListCommand::HoldScript(true)), Answer::Done);
        assert_eq!(robot.moves(), Twist::STILL);
        assert_eq!(robot.asks(ListCommand::HoldScript(false)), Answer::Done);
        let turns = (0..40).find(|_| robot.moves().turn_rad_per_s > 0.0);
        assert!(turns.is_some());
        assert_eq!(robot.asks(ListCommand::Cancel(waits)), Answer::Done);
        robot.is_at(Pose {
            x_m: 2.1,
            y_m: 0.0,
            heading_rad: 1.0,
        });
        let goes = (0..4).find(|_| robot.moves().forward_m_per_s > 0.0);
        assert!(goes.is_some(), "the second step");
        let Answer::List(report) = robot.asks(ListCommand::Read) else {
            panic!("no list");
        };
        assert_eq!((report.script.ended, report.script.steps), (1, 2));
    }

    #[test]
    fn what_takes_the_place_of_one_that_is_suspended_by_hand_is_suspended() {
        let mut robot = with_situation(Reaction::Replace(1));
        robot.is_at(Pose::START);
        robot.moves();
        assert_eq!(robot.asks(ListCommand::HoldScript(true)), Answer::Done);
        robot.is_at(Pose {
            x_m: 2.1,
            ..Pose::START
        });
        for _ in 0..100 {
            assert_eq!(robot.moves(), Twist::STILL);
        }
        let (state, entries) = robot.report();
        assert_eq!((state, entries.len()), (ScriptState::Suspended, 2));
        assert!(entries[1].is_held, "{entries:?}");
        assert_eq!(robot.asks(ListCommand::HoldScript(false)), Answer::Done);
        let turns = (0..40).find(|_| robot.moves().turn_rad_per_s > 0.0);
        assert!(turns.is_some());
    }

    #[test]
    fn what_follows_a_step_that_has_failed_is_what_its_situation_says() {
        for (reaction, state, ended) in [
            (None, ScriptState::Ended, 0),
            (Some(Reaction::EndScript), ScriptState::Ended, 0),
            (Some(Reaction::Cancel), ScriptState::Runs, 1),
            (Some(Reaction::GoOn(2)), ScriptState::Runs, 2),
            (Some(Reaction::Replace(1)), ScriptState::Runs, 0),
        ] {
            let mut robot = Robot::new();
            let mut first = go_to(1.0);
            first.watches[0] = reaction.map(|reaction| Watch {
                situation: Situation::Failed,
                value: 0.0,
                reaction,
            });
            robot.takes_script(3, 3, &[first, turn(), go_to(1.0)]);
            robot.moves();
            // A situation of the mission cancels it.
            let mut list: BehaviourList = robot.bench.output(Owner::LIST).unwrap();
            assert!(list.end(list.head().unwrap()));
            robot.bench.give(Owner::LIST, list);
            robot.moves();
            let moves = robot.moves();
            let turns = ended == 1 || reaction == Some(Reaction::Replace(1));
            assert_eq!(moves.turn_rad_per_s > 0.0, turns, "{reaction:?}");
            assert_eq!(moves.forward_m_per_s > 0.0, ended == 2, "{reaction:?}");
            let Answer::List(report) = robot.asks(ListCommand::Read) else {
                panic!("no list");
            };
            let script = report.script;
            assert_eq!((script.state, script.ended), (state, ended), "{reaction:?}");
        }
    }

    #[test]
    fn a_step_that_lasts_too_long_ends_and_the_script_goes_on_where_it_says() {
        let mut robot = Robot::new();
        let mut first = turn();
        first.watches[0] = Some(Watch {
            situation: Situation::Lasts,
            value: 0.5,
            reaction: Reaction::GoOn(1),
        });
        robot.takes_script(3, 2, &[first, go_to(1.0)]);
        let turns = (0..100).take_while(|_| robot.moves().forward_m_per_s <= 0.0);
        let turns = turns.count();
        assert!((22..=27).contains(&turns), "{turns} activations of 20 ms");
    }

    #[test]
    fn a_step_that_is_taken_off_by_hand_lets_the_next_one_begin() {
        let mut robot = with_situation(Reaction::Flag);
        let (_, entries) = robot.report();
        assert_eq!(
            robot.asks(ListCommand::Cancel(entries[0].key)),
            Answer::Done
        );
        assert_eq!(robot.report().0, ScriptState::Done, "it was the last one");
    }

    #[test]
    fn a_mission_that_starts_anew_has_forgotten_all() {
        let mut robot = with_situation(Reaction::Flag);
        robot.bench.take_away(Owner::LIST);
        assert_eq!(robot.moves(), Twist::STILL);
        let made: BehaviourList = robot.bench.output(Owner::MADE).unwrap();
        robot.bench.give(Owner::LIST, made);
        assert_eq!(robot.report(), (ScriptState::None, std::vec![]));
    }
}
