//! What a task does that is a behaviour.

use super::law::Behaviour;
use super::list::BehaviourList;
use super::place::{Around, Begins, Place, Turn};
use crate::declaration::Params;
use crate::features::SPEED;
use crate::ports::Io;
use crate::task::{OptIn, OptInOut, OutFlag, Param, Step};
use crate::tasks::{Pose, Ranges};

/// The ports, flags and parameters that all behaviours have.
#[derive(Clone, Copy)]
pub struct Ports {
    /// The list of behaviours.
    pub list: OptInOut<BehaviourList>,
    /// Where the robot is.
    pub pose: OptIn<Pose>,
    /// What is around it.
    pub ranges: OptIn<Ranges>,
    /// It waits.
    pub suspended: OutFlag,
    /// It has ended without being done.
    pub failed: OutFlag,
    /// Where it ends.
    pub outside_m: Param<f32>,
    /// Where on the list it comes.
    pub at_head: Param<bool>,
    /// What the list names it by.
    pub task: u16,
}

/// A behaviour between its entry and its end.
#[derive(Debug, Default)]
pub struct Runner<B> {
    law: B,
    /// It remembers what the flag `suspended` says, which is written where that changes.
    place: Place,
}

impl<B: Behaviour + Default> Runner<B> {
    /// A mission starts, with a list of its own.
    pub fn reset(&mut self) {
        self.place = Place::default();
    }

    /// Its state was entered anew.
    pub fn enter(&mut self) {
        self.law = B::default();
        self.place.begin_anew();
        self.place.is_suspended = false;
    }

    /// Takes part in the list, and in its turn says how to move.
    #[cfg_attr(feature = "speed", inline(always))]
    pub fn step(&mut self, io: &mut Io<'_>, ports: &Ports) -> Step {
        let params = io.params();
        let around = Around {
            pose: io.try_read(ports.pose),
            ranges: io.try_read(ports.ranges),
            period_us: io.period_us(),
            outside_m: params.get(ports.outside_m),
        };
        // Most steps are no more than this, for each law by itself: what follows is there once for
        // all laws.
        if SPEED
            && !self.place.is_suspended
            && let Some(list) = io.try_update(ports.list)
        {
            let turn = (self.place).go_on(list, &around, &params, &mut self.law);
            match turn {
                Some(Turn::Goes { suspended: false }) => return Step::Run,
                Some(turn) => return become_of(turn, &mut self.place, io, ports),
                None => {}
            }
        }
        let Self { law, place } = self;
        step(place, io, ports, &around, &params, law)
    }
}

/// Takes part in the list, whatever is to be found out.
#[inline(never)]
fn step(
    place: &mut Place,
    io: &mut Io<'_>,
    ports: &Ports,
    around: &Around<'_>,
    params: &Params,
    law: &mut dyn Behaviour,
) -> Step {
    let turn = match io.try_update(ports.list) {
        Some(list) => {
            let begins = Begins {
                at_head: params.get(ports.at_head),
                task: ports.task,
            };
            // Where this is made for speed, it is known that it does not go on as before.
            if SPEED && !place.is_suspended {
                place.take_part(list, around, begins, params, law)
            } else {
                place.step(list, around, begins, params, law)
            }
        }
        None => place.without_list(),
    };
    become_of(turn, place, io, ports)
}

/// Says what became of it in this step.
#[inline(never)]
fn become_of(turn: Turn, place: &mut Place, io: &mut Io<'_>, ports: &Ports) -> Step {
    let suspended = match turn {
        Turn::NotYet => return Step::Run,
        Turn::Goes { suspended } => suspended,
        Turn::Ends { failed } => {
            io.set(ports.suspended, false);
            io.set(ports.failed, failed);
            return Step::Finished;
        }
    };
    if suspended != place.is_suspended {
        place.is_suspended = suspended;
        io.set(ports.suspended, suspended);
    }
    Step::Run
}

#[cfg(test)]
mod tests {
    use super::super::list::Key;
    use super::super::place::FREE_FOR_US;
    use super::*;
    use crate::TaskBench;
    use crate::behaviours::{Behaviours, LifeState, Move, TurnTo};
    use crate::tasks::Twist;

    type Owner = Behaviours;

    const PERIOD_US: u32 = 20_000;

    /// A state `Move` that asks for 0.3 m/s, at a pose, with free way all around.
    fn bench() -> TaskBench<'static> {
        let mut bench = TaskBench::new(Move::default());
        bench
            .period_us(PERIOD_US)
            .param(Move::SPEED_M_PER_S, 0.3)
            .give(Move::LIST, BehaviourList::EMPTY)
            .give(Move::POSE, Pose::START)
            .give(Move::RANGES, Ranges::FREE);
        bench
    }

    fn list(bench: &TaskBench<'_>) -> BehaviourList {
        bench.output(Move::LIST).expect("a list")
    }

    /// What it asks for in the next step.
    fn asks(bench: &mut TaskBench<'_>) -> Twist {
        bench.step();
        let mut list = list(bench);
        let twist = list.take_asked();
        bench.give(Move::LIST, list);
        twist
    }

    fn ahead(range_m: f32) -> Ranges {
        let mut ranges = Ranges::FREE;
        ranges.range_m[0] = range_m;
        ranges
    }

    const FORWARDS: Twist = Twist {
        forward_m_per_s: 0.3,
        turn_rad_per_s: 0.0,
    };

    #[test]
    fn a_state_that_is_entered_comes_onto_the_list_and_moves() {
        let mut bench = bench();
        assert_eq!(asks(&mut bench), FORWARDS);
        let head = list(&bench).head().expect("somebody");
        assert_eq!(list(&bench).state(head), Some(LifeState::Execute));
        assert!(!bench.flag(Move::SUSPENDED));
        // Entered anew it is a new one, and the old one is gone.
        bench.enter_anew();
        assert_eq!(asks(&mut bench), FORWARDS);
        assert_ne!(list(&bench).head(), Some(head));
        assert_eq!(list(&bench).len(), 1);
    }

    #[test]
    fn nothing_moves_without_a_list_or_a_pose() {
        let mut bench = bench();
        bench.take_away(Move::POSE);
        assert_eq!(asks(&mut bench), Twist::STILL);
        assert!(list(&bench).is_empty());
        bench.give(Move::POSE, Pose::START).take_away(Move::LIST);
        assert_eq!(bench.step(), Some(Step::Run));
        bench.give(Move::LIST, BehaviourList::EMPTY);
        assert_eq!(asks(&mut bench), FORWARDS);
        bench.take_away(Move::POSE);
        assert_eq!(asks(&mut bench), Twist::STILL);
        assert_eq!(list(&bench).len(), 1, "it keeps its place");
    }

    #[test]
    fn it_is_suspended_while_the_way_is_not_free_and_resumes_by_itself() {
        let mut bench = bench();
        asks(&mut bench);
        let key = list(&bench).head().expect("somebody");
        bench.give(Move::RANGES, ahead(0.3));
        assert_eq!(asks(&mut bench), Twist::STILL);
        assert!(bench.flag(Move::SUSPENDED));
        assert_eq!(list(&bench).head(), Some(Key::IDLE));
        assert_eq!(list(&bench).state(key), Some(LifeState::Resume));
        // Free for a moment is not free.
        bench.give(Move::RANGES, ahead(1.0));
        for _ in 0..10 {
            assert_eq!(asks(&mut bench), Twist::STILL);
        }
        bench.give(Move::RANGES, ahead(0.3));
        asks(&mut bench);
        bench.give(Move::RANGES, ahead(1.0));
        let steps = (1..100).find(|_| asks(&mut bench) == FORWARDS);
        assert_eq!(steps, Some((FREE_FOR_US / PERIOD_US) as usize + 1));
        assert!(!bench.flag(Move::SUSPENDED));
        assert_eq!(list(&bench).head(), Some(key), "the same one goes on");
    }

    #[test]
    fn one_that_says_so_comes_before_the_head_which_it_interrupts() {
        let mut others = BehaviourList::EMPTY;
        let first = others.insert_at_tail(1).expect("room");
        others.dispatch();
        let mut bench = bench();
        bench.param(Move::AT_HEAD, true).give(Move::LIST, others);
        assert_eq!(asks(&mut bench), FORWARDS);
        assert_eq!(list(&bench).second(), Some(first));
        assert_eq!(list(&bench).state(first), Some(LifeState::Resume));
    }

    #[test]
    fn it_waits_behind_others_and_for_one_that_is_put_before_it() {
        let mut bench = bench();
        let mut others = BehaviourList::EMPTY;
        let first = others.insert_at_tail(1).expect("room");
        bench.give(Move::LIST, others);
        assert_eq!(asks(&mut bench), Twist::STILL);
        assert!(bench.flag(Move::SUSPENDED));
        let mut now = list(&bench);
        now.end(first);
        bench.give(Move::LIST, now);
        assert_eq!(asks(&mut bench), FORWARDS);
        let mut now = list(&bench);
        let urgent = now.insert_at_head(1).expect("room");
        bench.give(Move::LIST, now);
        assert_eq!(asks(&mut bench), Twist::STILL);
        let mut now = list(&bench);
        now.end(urgent);
        bench.give(Move::LIST, now);
        assert_eq!(asks(&mut bench), FORWARDS);
    }

    #[test]
    fn it_ends_outside_its_radius_and_fails_where_it_is_taken_off_or_finds_no_room() {
        let mut bench = bench();
        bench.param(Move::OUTSIDE_M, 1.0);
        asks(&mut bench);
        let beyond = Pose {
            x_m: 0.0,
            y_m: -1.01,
            heading_rad: 2.0,
        };
        assert_eq!(bench.give(Move::POSE, beyond).step(), Some(Step::Finished));
        assert!(list(&bench).is_empty() && !bench.flag(Move::FAILED));

        bench.enter_anew();
        assert_eq!(
            asks(&mut bench),
            FORWARDS,
            "its radius is about where it begins"
        );
        bench.give(Move::LIST, BehaviourList::EMPTY);
        assert_eq!(bench.step(), Some(Step::Finished));
        assert!(bench.flag(Move::FAILED), "somebody took it off");

        let mut full = BehaviourList::EMPTY;
        while full.insert_at_tail(1).is_ok() {}
        bench.enter_anew();
        assert_eq!(bench.give(Move::LIST, full).step(), Some(Step::Finished));
        assert!(bench.flag(Move::FAILED), "there is no room");
    }

    #[test]
    fn a_turn_ends_at_its_angle_though_it_was_suspended_on_the_way() {
        let mut bench = TaskBench::new(TurnTo::default());
        bench
            .period_us(PERIOD_US)
            .param(TurnTo::ANGLE_RAD, 1.0)
            .give(TurnTo::LIST, BehaviourList::EMPTY)
            .give(TurnTo::RANGES, Ranges::FREE);
        let mut pose = Pose {
            x_m: 3.0,
            y_m: 1.0,
            heading_rad: 2.8,
        };
        for step in 0..400 {
            if bench.give(TurnTo::POSE, pose).step() == Some(Step::Finished) {
                break;
            }
            let mut list = bench.output(TurnTo::LIST).expect("a list");
            let twist = list.take_asked();
            if step == 20 {
                list.insert_at_head(1).expect("room");
            } else if step == 60 {
                list.end(list.head().expect("the one before it"));
            }
            bench.give(TurnTo::LIST, list);
            assert_eq!(twist == Twist::STILL, (21..=60).contains(&step), "{step}");
            pose.heading_rad =
                crate::odometry::wrapped_rad(pose.heading_rad + twist.turn_rad_per_s * 0.02);
        }
        let goal_rad = 3.8 - core::f32::consts::TAU;
        assert!((pose.heading_rad - goal_rad).abs() < 0.03, "{pose:?}");
        assert!(!bench.flag(TurnTo::FAILED));
    }

    #[test]
    fn the_owner_makes_the_list_passes_on_what_is_asked_and_stands_still_without() {
        let mut bench = TaskBench::new(Owner::default());
        bench.step();
        assert_eq!(bench.output(Owner::MADE), Some(BehaviourList::EMPTY));
        assert_eq!(bench.output(Owner::TWIST), Some(Twist::STILL));
        assert!(bench.flag(Owner::IDLE));
        let mut list = BehaviourList::EMPTY;
        let key = list.insert_at_tail(1).expect("room");
        list.ask(FORWARDS);
        bench.give(Owner::LIST, list).step();
        assert_eq!(bench.output(Owner::TWIST), Some(FORWARDS));
        assert!(!bench.flag(Owner::IDLE));
        // Nobody asks any more: it stands; nobody shows itself: it leaves.
        bench.step();
        assert_eq!(bench.output(Owner::TWIST), Some(Twist::STILL));
        bench.step();
        let list: BehaviourList = bench.output(Owner::LIST).expect("a list");
        assert_eq!(list.state(key), None);
        assert!(bench.flag(Owner::IDLE));
    }
}
