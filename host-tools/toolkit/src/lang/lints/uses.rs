//! Which containers contain which.

use std::collections::HashSet;

use crate::lang::analysis::holes::Holes;
use crate::model::{Model, StateKind};

/// The uses of containers by containers. Lists are indexed as [`Model::containers`].
pub(super) struct Uses {
    /// The containers that a container uses, each once, in the order of their first use.
    pub(super) inside: Vec<Vec<usize>>,
    /// The containers that use a container, each once.
    pub(super) around: Vec<Vec<usize>>,
    /// All containers, each behind all that it uses.
    pub(super) children_first: Vec<usize>,
    /// Whether the machine has an instance of it.
    pub(super) is_in_machine: Vec<bool>,
    /// Whether no use is hidden in what could not be read or resolved.
    pub(super) are_whole: bool,
}

impl Uses {
    /// Finds all uses; `None` where a container contains itself.
    pub(super) fn of(model: &Model, holes: &Holes) -> Option<Uses> {
        let mut inside: Vec<Vec<usize>> = Vec::with_capacity(model.containers.len());
        let mut around = vec![Vec::new(); model.containers.len()];
        for (index, (container, holes)) in
            model.containers.iter().zip(&holes.containers).enumerate()
        {
            let mut seen = HashSet::new();
            let mut uses = Vec::new();
            for (region, holes) in container.regions.iter().zip(&holes.regions) {
                for (state, holes) in region.states.iter().zip(&holes.states) {
                    if let (StateKind::Super { container: used }, false) = (&state.kind, holes.kind)
                        && seen.insert(*used)
                    {
                        uses.push(*used);
                        if let Some(around) = around.get_mut(*used) {
                            around.push(index);
                        }
                    }
                }
            }
            inside.push(uses);
        }
        let children_first = children_first(&inside, &around)?;
        let mut is_in_machine = vec![false; inside.len()];
        if let Some(mark) = model
            .machine
            .and_then(|machine| is_in_machine.get_mut(machine))
        {
            *mark = true;
        }
        for &container in children_first.iter().rev() {
            if is_in_machine.get(container) != Some(&true) {
                continue;
            }
            for &used in inside.get(container).into_iter().flatten() {
                if let Some(mark) = is_in_machine.get_mut(used) {
                    *mark = true;
                }
            }
        }
        let are_whole = !holes.set
            && holes.containers.iter().all(|container| {
                !container.declarations
                    && !container.is_twin
                    && container
                        .regions
                        .iter()
                        .all(|region| !region.body && region.states.iter().all(|state| !state.kind))
            });
        Some(Uses {
            inside,
            around,
            children_first,
            is_in_machine,
            are_whole,
        })
    }

    /// Whether a container may be used in ways that are not known here: in a set without a machine,
    /// by whoever takes the file in.
    pub(super) fn has_unknown_surroundings(&self, model: &Model, container: usize) -> bool {
        model.machine != Some(container)
            && (!self.are_whole || self.is_in_machine.get(container) != Some(&true))
    }

    /// A way from a container down to another: the containers on it, both ends included.
    pub(super) fn way_down(&self, from: usize, to: usize) -> Option<Vec<usize>> {
        // From the bottom up, so that the way can be read off forwards.
        let mut below: Vec<Option<usize>> = vec![None; self.inside.len()];
        let mut open = vec![to];
        let mut seen = HashSet::from([to]);
        while let Some(at) = open.pop() {
            if at == from {
                let mut way = vec![at];
                while let Some(next) = way.last().and_then(|&at| *below.get(at)?) {
                    way.push(next);
                }
                return Some(way);
            }
            for &around in self.around.get(at).into_iter().flatten() {
                if seen.insert(around) {
                    if let Some(place) = below.get_mut(around) {
                        *place = Some(at);
                    }
                    open.push(around);
                }
            }
        }
        None
    }
}

/// Orders containers so that each stands behind all that it uses; `None` where there is a circle.
fn children_first(inside: &[Vec<usize>], around: &[Vec<usize>]) -> Option<Vec<usize>> {
    let mut waits_for: Vec<usize> = inside.iter().map(Vec::len).collect();
    let mut order: Vec<usize> = (0..inside.len())
        .filter(|&container| waits_for.get(container) == Some(&0))
        .collect();
    let mut next = 0;
    while let Some(&container) = order.get(next) {
        next += 1;
        for &user in around.get(container).into_iter().flatten() {
            if let Some(count) = waits_for.get_mut(user) {
                *count -= 1;
                if *count == 0 {
                    order.push(user);
                }
            }
        }
    }
    (order.len() == inside.len()).then_some(order)
}
