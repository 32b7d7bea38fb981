//! An order of a container's transitions.
//!
//! A blob keeps the transitions state by state, in each those on the pulse first, and that is the
//! order to give them back in. But a container also has its events in the order in which its
//! transitions first send them, and so a source in which that is not the order of the states is
//! given back with some of its transitions in another place.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BinaryHeap, HashMap};
use std::ops::Range;

/// The events of a container that have been sent up to some transition.
#[derive(Default)]
pub(super) struct Sent {
    /// The first event that none of them sends, counted in the container.
    next: usize,
}

impl Sent {
    /// Puts the transitions of a region in order. `chains` are those that must keep their order
    /// among themselves; `sends` gives the events of one, counted in the container. `None` if there
    /// is no order.
    pub(super) fn order(
        &mut self,
        chains: &[Range<usize>],
        sends: impl Fn(usize) -> Vec<usize>,
    ) -> Option<Vec<usize>> {
        let count = chains.iter().map(ExactSizeIterator::len).sum();
        let mut order = Vec::with_capacity(count);
        // Transitions whose turn it is in their chain: those that can come now, and those that need
        // some event to be sent before.
        let mut ready = BinaryHeap::new();
        let mut waiting: BTreeMap<usize, Vec<(usize, usize)>> = BTreeMap::new();
        for chain in chains.iter().filter(|chain| !chain.is_empty()) {
            let needs = first_needed(&sends(chain.start));
            waiting
                .entry(needs)
                .or_default()
                .push((chain.start, chain.end));
        }
        loop {
            while let Some(entry) = waiting.first_entry()
                && *entry.key() <= self.next
            {
                ready.extend(entry.remove().into_iter().map(Reverse));
            }
            let Some(Reverse((transition, end))) = ready.pop() else {
                break;
            };
            order.push(transition);
            let highest = sends(transition).into_iter().max();
            self.next = self.next.max(highest.map_or(0, |highest| highest + 1));
            if transition + 1 < end {
                let needs = first_needed(&sends(transition + 1));
                waiting
                    .entry(needs)
                    .or_default()
                    .push((transition + 1, end));
            }
        }
        (order.len() == count).then_some(order)
    }
}

/// How many events must have been sent before a transition, so that those which it is the first to
/// send come in their order.
fn first_needed(sends: &[usize]) -> usize {
    let mut places = HashMap::new();
    for (place, event) in sends.iter().enumerate() {
        places.entry(*event).or_insert(place);
    }
    let Some(mut needed) = sends.iter().copied().max() else {
        return 0;
    };
    while needed > 0
        && let (Some(before), Some(at)) = (places.get(&(needed - 1)), places.get(&needed))
        && before < at
    {
        needed -= 1;
    }
    needed
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn transitions_come_state_by_state_unless_the_events_say_otherwise() {
        // The chains, what each transition sends, the order.
        type Case<'a> = (&'a [[usize; 2]], &'a [&'a [usize]], Option<&'a [usize]>);
        let cases: &[Case<'_>] = &[
            (&[], &[], Some(&[])),
            (&[[0, 2], [2, 3]], &[&[], &[0], &[1]], Some(&[0, 1, 2])),
            // The second state sends first.
            (&[[0, 2], [2, 3]], &[&[1], &[], &[0]], Some(&[2, 0, 1])),
            // Each is the first to send one, in turn.
            (
                &[[0, 2], [2, 4]],
                &[&[0], &[2], &[1], &[3]],
                Some(&[0, 2, 1, 3]),
            ),
            // Two in one transition.
            (&[[0, 1], [1, 2]], &[&[1, 2], &[0]], Some(&[1, 0])),
            (&[[0, 1]], &[&[0, 1, 0, 2]], Some(&[0])),
            (&[[0, 1], [1, 2]], &[&[1, 0], &[0]], Some(&[1, 0])),
            // What comes later in the same state must come first.
            (&[[0, 2]], &[&[1], &[0]], None),
            (&[[0, 1]], &[&[1, 0]], None),
        ];
        for (chains, sends, expected) in cases {
            let ranges: Vec<_> = chains.iter().map(|[start, end]| *start..*end).collect();
            let order = Sent::default().order(&ranges, |transition| sends[transition].to_vec());
            assert_eq!(order.as_deref(), *expected, "{chains:?} {sends:?}");
        }
    }
}
