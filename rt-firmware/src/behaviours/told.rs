//! What of the list of behaviours has been told: to the trace, and to the flight recorder.

use heapless::Vec;

use super::list::{BehaviourList, Key, MAX_BEHAVIOURS};
use esm_link::black_box::Event;

/// Changes that are told in one activation. What is more is told in the next: a list that is given
/// up at once takes three. A behaviour that comes and goes between two looks of the list's owner is
/// not told of.
pub(super) const MAX_CHANGES: usize = 4;

/// A behaviour as it was told of last.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Told {
    key: Key,
    task: u16,
    state: u8,
}

/// The list as it was told of last.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct ToldList {
    told: [Option<Told>; MAX_BEHAVIOURS + 1],
    /// [`BehaviourList::changes`] where all of it was told.
    changes: Option<u8>,
}

impl ToldList {
    /// Nobody is on it: another mission begins.
    pub(super) fn forget(&mut self) {
        *self = Self::default();
    }

    /// The lower half of the signature hash of a behaviour's task, if it was told of.
    pub(super) fn task(&self, key: Key) -> Option<u16> {
        let mut known = self.told.iter().flatten();
        known.find(|told| told.key == key).map(|told| told.task)
    }

    /// What has changed, and counts as told from now on.
    pub(super) fn changes(&mut self, list: &BehaviourList) -> Vec<Event, MAX_CHANGES> {
        let mut changes = Vec::new();
        if self.changes == Some(list.changes()) {
            return changes;
        }
        // First who has left, then who goes on in another state, then who is new.
        for place in &mut self.told {
            if let Some(told) = place
                && list.state(told.key).is_none()
                && changes.push(event(told, Some(told.state), None)).is_ok()
            {
                *place = None;
            }
        }
        for told in self.told.iter_mut().flatten() {
            if let Some(state) = list.state(told.key).map(|state| state as u8)
                && state != told.state
                && changes
                    .push(event(told, Some(told.state), Some(state)))
                    .is_ok()
            {
                told.state = state;
            }
        }
        for (key, task, state, _) in list.entries() {
            let is_known = self.told.iter().flatten().any(|told| told.key == key);
            let room = self.told.iter_mut().find(|place| place.is_none());
            let told = Told {
                key,
                task,
                state: state as u8,
            };
            if let Some(room) = room.filter(|_| !is_known)
                && changes.push(event(&told, None, Some(told.state))).is_ok()
            {
                *room = Some(told);
            }
        }
        // Where there was no room for more, the next activation looks again.
        self.changes = (changes.len() < MAX_CHANGES).then_some(list.changes());
        changes
    }
}

fn event(told: &Told, from: Option<u8>, to: Option<u8>) -> Event {
    Event::Behaviour {
        key: told.key.number(),
        task: told.task,
        from,
        to,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::behaviours::LifeState;

    const INITIAL: Option<u8> = Some(LifeState::Initial as u8);
    const EXECUTE: Option<u8> = Some(LifeState::Execute as u8);
    const RESUME: Option<u8> = Some(LifeState::Resume as u8);

    #[test]
    fn each_change_is_told_once_and_more_than_there_is_room_for_in_the_next_activation() {
        let mut list = BehaviourList::EMPTY;
        let mut told = ToldList::default();
        let change = |key: Key, task, from, to| Event::Behaviour {
            key: key.number(),
            task,
            from,
            to,
        };
        let first = list.insert_at_tail(7).unwrap();
        assert_eq!(told.changes(&list)[..], [change(first, 7, None, INITIAL)]);
        assert!(told.changes(&list).is_empty());
        list.dispatch();
        list.idle();
        let changes = told.changes(&list);
        let expected = [
            change(first, 7, INITIAL, RESUME),
            change(Key::IDLE, 0, None, EXECUTE),
        ];
        assert_eq!(changes[..], expected);
        list.end(Key::IDLE);
        list.end(first);
        for _ in 0..MAX_BEHAVIOURS {
            list.insert_at_tail(9).unwrap();
        }
        let all: std::vec::Vec<Event> = (0..4).flat_map(|_| told.changes(&list)).collect();
        assert_eq!(all.len(), 2 + MAX_BEHAVIOURS);
        assert_eq!(all[0], change(first, 7, RESUME, None));
        assert_eq!(all[1], change(Key::IDLE, 0, EXECUTE, None));
        let are_new = all[2..].iter().all(|event| {
            matches!(
                event,
                Event::Behaviour {
                    from: None,
                    task: 9,
                    ..
                }
            )
        });
        assert!(are_new, "{all:?}");
        assert!(told.changes(&list).is_empty());
    }
}
