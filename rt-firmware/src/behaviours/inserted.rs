//! A behaviour that no task state has put onto the list, but a command or a script.

use super::landmarks::Landmarks;
use super::list::{BehaviourList, Key};
use super::place::{Around, Begins, Place, Turn};
use super::repertoire::Repertoire;
use super::situation::Circumstances;
use super::watches::{Reactions, Watches};
use crate::declaration::Params;
use crate::list_command::Call;
use crate::tasks::{Pose, Ranges, Twist};
use esm_link::behaviours::{Origin, Reaction};
use esm_link::message::LinkError;

/// What the owner of the list finds in one activation.
#[derive(Clone, Copy, Debug)]
pub(super) struct Surroundings<'a> {
    /// Where the robot is, if anybody knows.
    pub(super) pose: Option<Pose>,
    /// What is around the robot; none where nobody knows.
    pub(super) ranges: Option<&'a Ranges>,
    /// Of the battery, in volts, if anybody knows.
    pub(super) battery_v: Option<f32>,
    /// Time between two activations, in microseconds.
    pub(super) period_us: u32,
    /// Nominal start of this one, on the robot's clock.
    pub(super) robot_us: u64,
}

/// Where a behaviour comes onto the list.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum At {
    /// Before the head.
    Head,
    /// Behind all others, or before the head where its parameter says so.
    Tail,
    /// In the place of one that has left it, counted from the head.
    Place(usize),
}

/// A behaviour on the list that its owner executes.
#[derive(Debug)]
pub(super) struct Inserted<R> {
    pub(super) key: Key,
    pub(super) origin: Origin,
    pub(super) task: u16,
    law: R,
    params: Params,
    place: Place,
    watches: Watches,
}

impl<R: Repertoire> Inserted<R> {
    /// Comes onto the list.
    ///
    /// # Errors
    /// [`LinkError::NotABehaviour`], [`LinkError::ListFull`], [`LinkError::NoBehaviours`] where
    /// nobody knows where the robot is.
    pub(super) fn new(
        list: &mut BehaviourList,
        call: &Call,
        origin: Origin,
        at: At,
        pose: Option<Pose>,
    ) -> Result<Self, LinkError> {
        let mut law = R::of_task(call.task).ok_or(LinkError::NotABehaviour)?;
        let pose = pose.ok_or(LinkError::NoBehaviours)?;
        let task = call.task as u16;
        let key = match at {
            At::Head => list.insert_at_head(task),
            At::Tail => list.insert(call.params.get(law.at_head()), task),
            At::Place(place) => list.insert_at(place, task),
        };
        let key = key.map_err(|_| LinkError::ListFull)?;
        let centre = (law.law()).centre(list.way_round.pose(pose), &call.params);
        let mut place = Place::at(key, centre);
        place.is_suspended = true;
        Ok(Self {
            key,
            origin,
            task,
            place,
            law,
            params: call.params,
            watches: Watches::new(call.watches),
        })
    }

    /// Whether a landmark is watched for.
    pub(super) fn has_landmarks(&self) -> bool {
        self.watches.has_landmarks()
    }

    /// Whether its law had much to do in this activation.
    pub(super) fn has_heard(&mut self) -> bool {
        !self.place.is_suspended && self.law.law().has_heard()
    }

    /// What is to be done where it has failed.
    pub(super) fn when_failed(&self) -> Reaction {
        self.watches.when_failed()
    }

    /// Looks for its situations, takes part in the list, and in its turn says how to move.
    pub(super) fn step(
        &mut self,
        list: &mut BehaviourList,
        around: &Surroundings<'_>,
        landmarks: &Landmarks,
    ) -> (Turn, Reactions) {
        let asked = if self.place.is_suspended {
            Twist::STILL
        } else {
            self.place.asked()
        };
        let way_round = list.way_round;
        let mut room = None;
        let seen = Circumstances {
            pose: (around.pose).map(|pose| self.place.see(way_round.pose(pose))),
            asked,
            ranges: way_round.ranges(around.ranges, &mut room),
            battery_v: around.battery_v,
            period_us: around.period_us,
        };
        let reactions = (self.watches).look(&seen, landmarks, list.is_held(self.key));
        if reactions.cancel {
            return (self.place.end(list, false), reactions);
        }
        self.place.bar(reactions.suspend);
        let around = Around {
            pose: around.pose.as_ref(),
            ranges: around.ranges,
            period_us: around.period_us,
            outside_m: self.params.get(self.law.outside()),
        };
        // It is on the list already.
        let begins = Begins {
            at_head: false,
            task: self.task,
        };
        let turn = (self.place).step(list, &around, begins, &self.params, self.law.law());
        self.place.is_suspended = turn != Turn::Goes { suspended: false };
        (turn, reactions)
    }
}
