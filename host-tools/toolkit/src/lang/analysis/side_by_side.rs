//! Which states can be active together.
//!
//! Of the states of a region one is current, and the regions of a container run side by side. So
//! two states can be active together if an instance of some container has one of them in one
//! region, at any depth, and the other in another region; or if one is a superstate and the other
//! is inside it. A container that is used twice side by side makes its states active together with
//! themselves.
//!
//! Instances may be far more than containers, so each container is looked at once for all of its
//! instances: on the way up from the states that are asked about, which of them are inside; on the
//! way down, which of them can be active outside.

use crate::model::Model;

use super::activity::{Activity, StateId, Uses};
use super::holes::Holes;

/// How many superstates are looked at for all questions about one set of files together.
pub const MAX_STEPS: usize = 4_000_000;

/// How two states come to be active together.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Meeting {
    /// They are in two regions of one container, at any depth.
    Regions {
        /// Index into [`Model::containers`].
        container: usize,
        /// The region of the one that was asked about: index into
        /// [`Container::regions`](crate::model::Container).
        own: usize,
        /// The region of the other one.
        other: usize,
    },
    /// One is inside the other.
    Inside,
}

/// A state that can be active together with the one asked about.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Partner {
    /// Which one it is: index into the list of states that was asked about.
    pub member: usize,
    /// Where they meet.
    pub meeting: Meeting,
}

/// The nesting of the containers of a model, as far as it can be active.
pub struct SideBySide<'a> {
    activity: &'a Activity,
    /// Per container, the superstates that are instances of it and can be active.
    outside: Vec<Vec<StateId>>,
    /// Per container, its place in an order in which each stands behind all that it uses.
    rank: Vec<usize>,
    steps_left: usize,
    /// Per container; empty between questions.
    found: Vec<Found>,
    /// The containers of which something is in `found`.
    opened: Vec<usize>,
}

/// What is known of a container during a question.
#[derive(Clone, Default)]
struct Found {
    is_open: bool,
    /// Members directly in it, with their indices.
    members: Vec<(StateId, usize)>,
    /// Its superstates that have members inside, with their containers; ascending once all are
    /// there.
    supers: Vec<(StateId, usize)>,
    /// The first member inside it and its region; and the first one in another region than that.
    first: Option<(usize, usize)>,
    second: Option<(usize, usize)>,
    /// The first member that can be active outside an instance of it.
    outside: Option<Partner>,
}

impl Found {
    fn add(&mut self, member: usize, region: usize) {
        let new = (member, region);
        match self.first {
            Some(first) if first.1 == region => self.first = Some(first.min(new)),
            Some(first) if first < new => {
                self.second = Some(self.second.map_or(new, |second| second.min(new)));
            }
            Some(first) => {
                // The second, if there is one, is of another region than the first, and may be of
                // the new one's.
                self.second = Some(first);
                self.first = Some(new);
            }
            None => self.first = Some(new),
        }
    }

    /// The first member in another region.
    fn beside(&self, container: usize, region: usize) -> Option<Partner> {
        let (member, other) = match self.first {
            Some(first) if first.1 != region => first,
            _ => self.second?,
        };
        Some(Partner {
            member,
            meeting: Meeting::Regions {
                container,
                own: region,
                other,
            },
        })
    }
}

fn earlier(a: Option<Partner>, b: Option<Partner>) -> Option<Partner> {
    match (a, b) {
        (Some(a), Some(b)) => Some(a.min(b)),
        (a, b) => a.or(b),
    }
}

impl<'a> SideBySide<'a> {
    /// Prepares questions about a model; `None` where a container uses itself.
    pub fn new(model: &Model, holes: &Holes, activity: &'a Activity) -> Option<Self> {
        let order = activity.children_first()?;
        let mut rank = vec![0; model.containers.len()];
        for (place, &container) in order.iter().enumerate() {
            if let Some(rank) = rank.get_mut(container) {
                *rank = place;
            }
        }
        let mut outside = Uses::of(model, holes).outside();
        for users in &mut outside {
            users.retain(|state| activity.is_active(*state));
        }
        Some(SideBySide {
            activity,
            found: vec![Found::default(); outside.len()],
            opened: Vec::new(),
            outside,
            rank,
            steps_left: MAX_STEPS,
        })
    }

    /// Whether two states can be active together; a state with itself: whether two instances of it
    /// can.
    ///
    /// Gives `None` where the question is too large for what is left of [`MAX_STEPS`].
    pub fn can_be_together(&mut self, a: StateId, b: StateId) -> Option<bool> {
        if a == b {
            return Some(self.partners(&[a])?.first()?.is_some());
        }
        let partners = self.partners(&[a, b])?;
        Some(partners.get(1)?.is_some_and(|partner| partner.member == 0))
    }

    /// For each of `members`, the first in the list that can be active together with it; that may
    /// be itself.
    ///
    /// The work is in proportion to the superstates around the members, not to their pairs. Gives
    /// `None` where [`MAX_STEPS`] does not suffice.
    pub fn partners(&mut self, members: &[StateId]) -> Option<Vec<Option<Partner>>> {
        let partners = self.open(members).map(|()| {
            self.look_inside();
            self.look_outside();
            members.iter().map(|member| self.partner(*member)).collect()
        });
        // Also of a question that was given up.
        for container in std::mem::take(&mut self.opened) {
            self.put(container, Found::default());
        }
        partners
    }

    fn put(&mut self, container: usize, new: Found) {
        if let Some(found) = self.found.get_mut(container) {
            *found = new;
        }
    }

    fn take(&mut self, container: usize) -> Found {
        self.found
            .get_mut(container)
            .map(std::mem::take)
            .unwrap_or_default()
    }

    /// Finds the containers around the members, each behind all that it uses.
    fn open(&mut self, members: &[StateId]) -> Option<()> {
        for (index, member) in members.iter().enumerate() {
            if self.activity.is_active(*member)
                && let Some(found) = self.found.get_mut(member.container)
            {
                found.members.push((*member, index));
                if !std::mem::replace(&mut found.is_open, true) {
                    self.opened.push(member.container);
                }
            }
        }
        let mut next = 0;
        while let Some(&inside) = self.opened.get(next) {
            next += 1;
            for user in self.outside.get(inside).into_iter().flatten() {
                self.steps_left = self.steps_left.checked_sub(1)?;
                if let Some(found) = self.found.get_mut(user.container) {
                    found.supers.push((*user, inside));
                    if !std::mem::replace(&mut found.is_open, true) {
                        self.opened.push(user.container);
                    }
                }
            }
        }
        self.opened
            .sort_by_key(|&container| self.rank.get(container));
        Some(())
    }

    /// From the inside out: which members are inside each container.
    fn look_inside(&mut self) {
        for place in 0..self.opened.len() {
            let Some(&container) = self.opened.get(place) else {
                return;
            };
            let mut found = self.take(container);
            found.members.sort_unstable();
            found.supers.sort_unstable();
            for place in 0..found.members.len() {
                if let Some(&(state, member)) = found.members.get(place) {
                    found.add(member, state.region);
                }
            }
            for place in 0..found.supers.len() {
                if let Some(&(state, inside)) = found.supers.get(place)
                    && let Some(member) = self.first_inside(inside)
                {
                    found.add(member, state.region);
                }
            }
            self.put(container, found);
        }
    }

    fn first_inside(&self, container: usize) -> Option<usize> {
        Some(self.found.get(container)?.first?.0)
    }

    /// From the outside in: which members can be active outside each container.
    fn look_outside(&mut self) {
        for place in (0..self.opened.len()).rev() {
            let Some(&container) = self.opened.get(place) else {
                return;
            };
            let found = self.take(container);
            for (state, inside) in &found.supers {
                // A superstate that is asked about is active with all that is inside it.
                let itself = found
                    .members
                    .binary_search_by_key(state, |(member, _)| *member)
                    .ok()
                    .and_then(|at| found.members.get(at))
                    .map(|(_, member)| Partner {
                        member: *member,
                        meeting: Meeting::Inside,
                    });
                let beside = found.beside(container, state.region);
                let outside = earlier(earlier(found.outside, beside), itself);
                if let Some(inside) = self.found.get_mut(*inside) {
                    inside.outside = earlier(inside.outside, outside);
                }
            }
            self.put(container, found);
        }
    }

    fn partner(&self, member: StateId) -> Option<Partner> {
        if !self.activity.is_active(member) {
            return None;
        }
        let found = self.found.get(member.container)?;
        let beside = found.beside(member.container, member.region);
        let inside = found
            .supers
            .binary_search_by_key(&member, |(state, _)| *state)
            .ok()
            .and_then(|at| self.first_inside(found.supers.get(at)?.1))
            .map(|member| Partner {
                member,
                meeting: Meeting::Inside,
            });
        earlier(earlier(found.outside, beside), inside)
    }
}
