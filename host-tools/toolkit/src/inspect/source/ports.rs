//! Data ports and paths of each container, from the nets of the instance tree.
//!
//! A blob has no containers' ports and no paths: it has, for each port of each task instance, the
//! net that it is on. What comes back are containers' ports and paths that give the same nets; they
//! are not always those of the source, but they are the simplest.
//!
//! Containers are taken one after another, each behind those that it uses. Its *ends* are the ports
//! of its task states, and those that were given to the containers of its superstates. Ends that
//! are on one net in every instance of the container are a *group*, joined by one path. Where the
//! net of a group, in any instance, has ports outside of the group, the container gets a port for
//! it, which is an end of the containers around. So what is on one net is joined at the latest in
//! the machine, which has one instance; and as only ends on one net are ever joined, the nets are
//! those of the blob.
//!
//! A net needs a writer, and a path something on both sides of its arrow. A group that lacks either
//! has it from a port of its container that may stay open. The machine has no ports; there, a
//! superstate's container gets one for the purpose.

use std::collections::{HashMap, HashSet};
use std::hash::Hash;

use esm_core::signature::{Direction, Port as SignaturePort};
use esm_core::tables::StateKind;

use super::tree::Tree;
use super::{NoSource, Reader};
use crate::inspect::reader::readable;

/// Ends of all containers beyond this are too many, as are more looks at the net of one in an
/// instance.
const MAX_ENDS: usize = 1 << 20;
const MAX_LOOKS: usize = 1 << 26;

/// What a container has of ports and paths.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Wiring {
    pub(super) ports: Vec<Port>,
    pub(super) paths: Vec<Path>,
}

/// A data port of a container.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Port {
    pub(super) name: String,
    pub(super) type_name: String,
    /// `out`, otherwise `in`.
    pub(super) is_out: bool,
    /// Some superstate leaves it open.
    pub(super) is_optional: bool,
}

/// A path: its ends before and behind the arrow.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Path {
    pub(super) from: Vec<End>,
    pub(super) to: Vec<End>,
}

/// One end of a path.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum End {
    /// A port of the container, by its place.
    Own(usize),
    /// A port of a state, by the state's index in the tables.
    State { state: usize, port: String },
}

/// A port of a task instance, relative to the container instance: task instance and place among its
/// data ports.
#[derive(Clone, Copy)]
struct Leaf {
    task: usize,
    port: usize,
}

/// A port of a task state or superstate of a container.
struct Candidate {
    state: usize,
    name: String,
    type_name: String,
    direction: Direction,
    /// One of the task ports that it is joined with inside, or itself.
    leaf: Leaf,
    /// How many of them there are.
    leaves: usize,
    /// For a superstate: its container, and the place among that one's ports.
    inside: Option<(usize, usize)>,
}

/// Works out the wiring of every container.
///
/// # Errors
/// If no paths give the nets that the blob has.
pub(super) fn wirings(reader: &Reader<'_>, tree: &Tree) -> Result<Vec<Wiring>, NoSource> {
    let count = reader.tables.containers().len();
    let mut wirer = Wirer {
        reader,
        tree,
        net_sizes: net_sizes(reader),
        wirings: vec![Wiring::default(); count],
        leaves: vec![Vec::new(); count],
        names: vec![NamesInUse::default(); count],
        first_superstate: reader.states_of(0).into_iter().find_map(|state| {
            match reader.tables.state(state)?.kind {
                StateKind::Super { .. } => Some((state, reader.container_inside(state)?)),
                _ => None,
            }
        }),
        ends: 0,
        looks: 0,
    };
    for container in children_first(reader, count) {
        wirer.wire(container)?;
    }
    Ok(wirer.wirings)
}

/// The task ports on each net.
fn net_sizes(reader: &Reader<'_>) -> Vec<usize> {
    let mut sizes = vec![0; reader.tables.net_count()];
    for net in (0..)
        .map_while(|index| reader.tables.connection(index))
        .flatten()
    {
        if let Some(size) = sizes.get_mut(net) {
            *size += 1;
        }
    }
    sizes
}

/// The containers, each behind all that it uses.
pub(super) fn children_first(reader: &Reader<'_>, count: usize) -> Vec<usize> {
    let mut order = Vec::with_capacity(count);
    let mut seen = vec![false; count];
    let mut open = Vec::new();
    if let Some(seen) = seen.first_mut() {
        *seen = true;
        open.push((0, reader.used_by(0).into_iter()));
    }
    while let Some((container, uses)) = open.last_mut() {
        match uses.next() {
            Some(used) => {
                if let Some(seen) = seen.get_mut(used)
                    && !std::mem::replace(seen, true)
                {
                    open.push((used, reader.used_by(used).into_iter()));
                }
            }
            None => {
                order.push(*container);
                open.pop();
            }
        }
    }
    order
}

/// The names of a container's ports, so that new ones are others.
#[derive(Clone, Default)]
struct NamesInUse {
    taken: HashSet<String>,
    /// How often each was asked for.
    asked: HashMap<String, usize>,
}

impl NamesInUse {
    /// The name, with a number behind it if it is taken.
    fn take(&mut self, name: &str) -> String {
        let asked = self.asked.entry(name.to_owned()).or_insert(0);
        loop {
            *asked += 1;
            let candidate = match *asked {
                1 => name.to_owned(),
                number => format!("{name}_{number}"),
            };
            if self.taken.insert(candidate.clone()) {
                return candidate;
            }
        }
    }
}

struct Wirer<'r> {
    reader: &'r Reader<'r>,
    tree: &'r Tree,
    net_sizes: Vec<usize>,
    wirings: Vec<Wiring>,
    /// For each port of each container: one of the task ports that it is joined with inside, and
    /// how many there are.
    leaves: Vec<Vec<(Leaf, usize)>>,
    names: Vec<NamesInUse>,
    /// The first superstate of the machine, and its container.
    first_superstate: Option<(usize, usize)>,
    ends: usize,
    looks: usize,
}

impl Wirer<'_> {
    fn wire(&mut self, container: usize) -> Result<(), NoSource> {
        let candidates = self.candidates(container)?;
        for group in self.groups(container, &candidates)? {
            self.join(container, &candidates, &group)?;
        }
        Ok(())
    }

    /// The ends of a container, in the order of its states.
    fn candidates(&mut self, container: usize) -> Result<Vec<Candidate>, NoSource> {
        let tables = &self.reader.tables;
        let mut candidates = Vec::new();
        let instance = tables
            .container(container)
            .map_or(0, |container| container.first_instance);
        let first_task = self.first_task(instance);
        for state in self.reader.states_of(container) {
            match tables.state(state).map(|state| state.kind) {
                Some(StateKind::Task { task_offset, .. }) => {
                    let task_state = self.reader.task_state(state);
                    let task = task_state.and_then(|task_state| tables.task(task_state.task));
                    let ports = task.into_iter().flat_map(|task| task.signature.ports());
                    let data = ports.filter_map(|port| match port {
                        SignaturePort::Data {
                            direction,
                            name,
                            type_name,
                            ..
                        } => Some((direction, name, type_name)),
                        _ => None,
                    });
                    for (port, (direction, name, type_name)) in data.enumerate() {
                        candidates.push(Candidate {
                            state,
                            name: readable(name),
                            type_name: readable(type_name),
                            direction,
                            leaf: Leaf {
                                task: task_offset,
                                port,
                            },
                            leaves: 1,
                            inside: None,
                        });
                    }
                }
                Some(StateKind::Super { instance_offset }) => {
                    let inside = instance + instance_offset;
                    let begin = self.first_task(inside).saturating_sub(first_task);
                    let content = self.tree.container(inside);
                    let (Some(wiring), Some(leaves)) =
                        (self.wirings.get(content), self.leaves.get(content))
                    else {
                        continue;
                    };
                    for (index, (port, (leaf, leaves))) in
                        wiring.ports.iter().zip(leaves).enumerate()
                    {
                        candidates.push(Candidate {
                            state,
                            name: port.name.clone(),
                            type_name: port.type_name.clone(),
                            direction: if port.is_out {
                                Direction::Out
                            } else {
                                Direction::In
                            },
                            leaf: Leaf {
                                task: begin + leaf.task,
                                port: leaf.port,
                            },
                            leaves: *leaves,
                            inside: Some((content, index)),
                        });
                    }
                }
                _ => {}
            }
            if self.ends + candidates.len() > MAX_ENDS {
                return Err(NoSource::TooMuch {
                    what: "ends of data paths",
                    limit: MAX_ENDS,
                });
            }
        }
        self.ends += candidates.len();
        self.looks += candidates.len() * self.instances(container).len();
        if self.looks > MAX_LOOKS {
            return Err(NoSource::TooMuch {
                what: "ends of data paths in all instances",
                limit: MAX_LOOKS,
            });
        }
        Ok(candidates)
    }

    fn first_task(&self, instance: usize) -> usize {
        self.tree
            .instances
            .get(instance)
            .map_or(0, |instance| instance.first_task)
    }

    fn instances(&self, container: usize) -> &[usize] {
        self.tree
            .of_containers
            .get(container)
            .map_or(&[], Vec::as_slice)
    }

    /// The net of a task port in an instance.
    fn net(&self, instance: usize, leaf: Leaf) -> Option<usize> {
        let tables = &self.reader.tables;
        let task = tables.task_instance(self.first_task(instance) + leaf.task)?;
        tables
            .connection(task.first_connection + leaf.port)
            .flatten()
    }

    /// The ends that are on one net in every instance; ends on no net are in no group.
    fn groups(
        &self,
        container: usize,
        candidates: &[Candidate],
    ) -> Result<Vec<Vec<usize>>, NoSource> {
        let mut class_of = vec![0; candidates.len()];
        let mut is_connected = vec![false; candidates.len()];
        for (turn, instance) in self.instances(container).iter().enumerate() {
            let mut classes = Classes::default();
            for ((candidate, class), is_connected) in
                candidates.iter().zip(&mut class_of).zip(&mut is_connected)
            {
                let net = self.net(*instance, candidate.leaf);
                if turn == 0 {
                    *is_connected = net.is_some();
                }
                if *is_connected != net.is_some() {
                    return Err(NoSource::HalfOpen {
                        state: self.reader.state_name(candidate.state),
                        port: candidate.name.clone(),
                    });
                }
                *class = classes.number((*class, net));
            }
        }
        let mut groups: Vec<Vec<usize>> = Vec::new();
        let mut numbers = Classes::default();
        for (index, class) in class_of.iter().enumerate() {
            if is_connected.get(index) != Some(&true) {
                continue;
            }
            let number = numbers.number(*class);
            match groups.get_mut(number) {
                Some(group) => group.push(index),
                None => groups.push(vec![index]),
            }
        }
        Ok(groups)
    }

    /// Joins the ends of a group by a path, and gives the container a port for it where one is
    /// needed.
    fn join(
        &mut self,
        container: usize,
        candidates: &[Candidate],
        group: &[usize],
    ) -> Result<(), NoSource> {
        let members: Vec<&Candidate> = group
            .iter()
            .filter_map(|index| candidates.get(*index))
            .collect();
        let Some(first) = members.first() else {
            return Ok(());
        };
        let leaves = members.iter().map(|member| member.leaves).sum();
        let goes_outside = self.instances(container).iter().any(|instance| {
            let size = self
                .net(*instance, first.leaf)
                .and_then(|net| self.net_sizes.get(net));
            size.is_some_and(|size| *size > leaves)
        });
        if let ([only], false) = (&members[..], goes_outside)
            && let Some(inside) = only.inside
        {
            // All of the net is inside: its port stays open here.
            self.leave_open(inside);
            return Ok(());
        }
        let mut path = Path::default();
        let mut both_ways = Vec::new();
        for member in &members {
            let end = End::State {
                state: member.state,
                port: member.name.clone(),
            };
            match member.direction {
                Direction::Out => path.from.push(end),
                Direction::In => path.to.push(end),
                Direction::InOut => both_ways.push(end),
            }
        }
        let has_writer = !path.from.is_empty() || !both_ways.is_empty();
        for end in both_ways {
            if path.from.is_empty() {
                path.from.push(end);
            } else {
                path.to.push(end);
            }
        }
        // A port of both directions can stand on both sides.
        if let ([only], true, false) = (&path.from[..], path.to.is_empty(), goes_outside)
            && first.direction == Direction::InOut
        {
            path.to.push(only.clone());
        }
        let is_machine = container == 0;
        let needs_port = goes_outside || path.from.is_empty() || path.to.is_empty();
        if needs_port && !is_machine {
            let port = self.add_port(container, first, has_writer, (first.leaf, leaves));
            let side = if has_writer {
                &mut path.to
            } else {
                &mut path.from
            };
            side.push(End::Own(port));
        } else if path.from.is_empty() {
            let end = self.spare(first, true)?;
            path.from.push(end);
        } else if path.to.is_empty() {
            let end = self.spare(first, false)?;
            path.to.push(end);
        }
        if let Some(wiring) = self.wirings.get_mut(container) {
            wiring.paths.push(path);
        }
        Ok(())
    }

    fn leave_open(&mut self, (container, port): (usize, usize)) {
        let wiring = self.wirings.get_mut(container);
        if let Some(port) = wiring.and_then(|wiring| wiring.ports.get_mut(port)) {
            port.is_optional = !port.is_out;
        }
    }

    /// Gives a container a port like another, and returns its place.
    fn add_port(
        &mut self,
        container: usize,
        like: &Candidate,
        is_out: bool,
        leaves: (Leaf, usize),
    ) -> usize {
        let (Some(wiring), Some(names), Some(all_leaves)) = (
            self.wirings.get_mut(container),
            self.names.get_mut(container),
            self.leaves.get_mut(container),
        ) else {
            return 0;
        };
        wiring.ports.push(Port {
            name: names.take(&like.name),
            type_name: like.type_name.clone(),
            is_out,
            is_optional: false,
        });
        all_leaves.push(leaves);
        wiring.ports.len() - 1
    }

    /// An end in the machine that adds no task port to a net: a port of a superstate's container,
    /// made for it.
    fn spare(&mut self, like: &Candidate, is_writer: bool) -> Result<End, NoSource> {
        let (state, container) = self.first_superstate.ok_or_else(|| NoSource::Net {
            state: self.reader.state_name(like.state),
            port: like.name.clone(),
        })?;
        let input = self.add_port(container, like, false, (like.leaf, 0));
        self.leave_open((container, input));
        let port = if is_writer {
            // What could come in at one could go out at the other.
            let output = self.add_port(container, like, true, (like.leaf, 0));
            if let Some(wiring) = self.wirings.get_mut(container) {
                wiring.paths.push(Path {
                    from: vec![End::Own(input)],
                    to: vec![End::Own(output)],
                });
            }
            output
        } else {
            input
        };
        let ports = self.wirings.get(container).map(|wiring| &wiring.ports);
        let name = ports
            .and_then(|ports| ports.get(port))
            .map(|port| port.name.clone());
        Ok(End::State {
            state,
            port: name.unwrap_or_default(),
        })
    }
}

/// Numbers for things in the order in which they are first seen.
struct Classes<K> {
    numbers: HashMap<K, usize>,
}

impl<K> Default for Classes<K> {
    fn default() -> Self {
        Self {
            numbers: HashMap::new(),
        }
    }
}

impl<K: Eq + Hash> Classes<K> {
    fn number(&mut self, key: K) -> usize {
        let next = self.numbers.len();
        *self.numbers.entry(key).or_insert(next)
    }
}
