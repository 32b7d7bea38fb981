//! The inside of a container: its regions laid out, packed, and wired.
//!
//! How a container looks depends on nothing but itself, the levels shown below it and the room
//! asked for. So each is laid out once and drawn wherever it is used.

use std::collections::HashMap;
use std::rc::Rc;

use super::face::{
    self, Face, Kind, LOOP_REACH, Loop, PORT_NAME_GAP, PORT_ROWS, Port, Side, heading_rows,
};
use super::grid::{self, Area, LANE, Spot};
use super::label::{self, Line};
use super::layered::{self, Edge, Node, Placement, Spacing, TooTangled};
use super::options::{Options, Shown};
use super::pack;
use super::wires::{self, Board, Heading, NoWay, Terminal, Wiring};
use crate::model::{
    Container, Model, PathEnd, Region, Source, Span, StateKind, Target, Transition, Trigger,
};

/// Rows of a region's name.
const REGION_NAME_ROWS: i32 = 4;
/// Cells around the contents of a region.
const REGION_MARGIN: i32 = 3;
/// Cells that nets add to that, at most.
const NETS_MARGIN: i32 = 4;
/// How often a container is laid out with more room, when its data paths find no way, before its
/// ports carry numbers instead.
const WIDENINGS: i32 = 3;
/// Cells between the names of the ports on the left and on the right.
const BETWEEN_PORT_NAMES: i32 = 6;

/// A container, laid out; the upper left corner is the origin.
#[derive(Clone, Debug)]
pub struct Body {
    /// Width and height.
    pub size: Spot,
    /// Flags and events of the container, in words for its heading.
    pub declarations: Vec<Line>,
    /// Its ports, seen from inside.
    pub ports: Vec<Port>,
    /// The regions in source order.
    pub regions: Vec<RegionPart>,
    /// Lines between regions.
    pub dividers: Vec<[Spot; 2]>,
    /// The nets of its data paths, in the order of their first path.
    pub nets: Vec<Net>,
}

/// A region, laid out.
#[derive(Clone, Debug)]
pub struct RegionPart {
    /// Its name.
    pub name: String,
    /// The same as the source has it.
    pub source_name: String,
    /// Where the name stands.
    pub name_area: Area,
    /// The states, `initial` and `final` included where they are used.
    pub states: Vec<PlacedState>,
    /// The transitions in source order.
    pub transitions: Vec<PlacedTransition>,
}

/// A state at its place.
#[derive(Clone, Debug)]
pub struct PlacedState {
    /// Its box.
    pub area: Area,
    /// What is in the box.
    pub face: Face,
    /// What is inside a superstate, where that is shown.
    pub inside: Option<Rc<Body>>,
}

/// A transition at its place.
#[derive(Clone, Debug)]
pub struct PlacedTransition {
    /// Index into [`RegionPart::states`] of its source.
    pub from: usize,
    /// Index into [`RegionPart::states`] of its target.
    pub to: usize,
    /// Its corners, from source to target.
    pub route: Vec<Spot>,
    /// Its label.
    pub label: Option<(Area, Vec<Line>)>,
    /// Where the source has it.
    pub span: Span,
}

/// A port on a net.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NetEnd {
    /// Index into [`Body::ports`].
    Own(usize),
    /// A port of a state.
    State {
        /// Index into [`Body::regions`].
        region: usize,
        /// Index into [`RegionPart::states`].
        state: usize,
        /// Index into [`Face::ports`].
        port: usize,
    },
}

/// A net: ports that data paths join.
#[derive(Clone, Debug)]
pub struct Net {
    /// Its ports.
    pub ends: Vec<NetEnd>,
    /// Its lines; none where the ports carry its number.
    pub wiring: Option<Wiring>,
}

/// What a container's looks depend on.
type Request = (usize, Shown, Spot);

/// Lays containers out, each once.
pub struct Workshop<'a> {
    model: &'a Model,
    options: &'a Options,
    done: HashMap<Request, Rc<Body>>,
    /// Steps that the search for the ways of nets may still take.
    steps: usize,
}

impl<'a> Workshop<'a> {
    /// An empty workshop for the containers of a model.
    pub fn new(model: &'a Model, options: &'a Options) -> Self {
        Workshop {
            model,
            options,
            done: HashMap::new(),
            steps: wires::MAX_STEPS_IN_ALL,
        }
    }

    /// The container laid out with what is shown of the superstates in it, at least as large as
    /// `least`. The caller has made sure that no more than [`super::MAX_LEVELS`] levels are.
    ///
    /// # Errors
    /// If a region is too tangled to be drawn.
    pub(super) fn body(
        &mut self,
        container: usize,
        shown: Shown,
        least: Spot,
    ) -> Result<Rc<Body>, TooTangled> {
        let request = (container, shown, least);
        if let Some(body) = self.done.get(&request) {
            return Ok(Rc::clone(body));
        }
        let body = Rc::new(self.make(&request)?);
        self.done.insert(request, Rc::clone(&body));
        Ok(body)
    }

    fn make(&mut self, (index, shown, least): &Request) -> Result<Body, TooTangled> {
        let (model, least) = (self.model, *least);
        let container = &model.containers[*index];
        let nets = if self.options.data {
            nets_of(container)
        } else {
            Vec::new()
        };
        let ends: usize = nets.iter().map(Vec::len).sum();
        if ends <= wires::MAX_ENDS {
            for widening in 0..=WIDENINGS {
                let mut body = self.arrange(container, &nets, shown, least, Some(widening))?;
                match wire(&mut body, &nets, &mut self.steps) {
                    Ok(()) => return Ok(body),
                    Err(NoWay::Narrow) => {}
                    Err(NoWay::Effort) => break,
                }
            }
        }
        self.arrange(container, &nets, shown, least, None)
    }

    /// The container without wires. `widening` says how much more room there is between states;
    /// without it, ports carry the numbers of their nets.
    fn arrange(
        &mut self,
        container: &'a Container,
        nets: &[Vec<PathEnd>],
        shown: &Shown,
        least: Spot,
        widening: Option<i32>,
    ) -> Result<Body, TooTangled> {
        let numbers = if widening.is_none() {
            numbers_of(nets)
        } else {
            HashMap::new()
        };
        let room = widening.unwrap_or(0);
        let declarations = face::declarations(self.model, container);
        let heading = heading_rows(declarations.len());
        let ports = if self.options.data {
            face::ports(&container.data, heading + PORT_ROWS / 2, |port| {
                numbers.get(&PathEnd::Container { port }).copied()
            })
        } else {
            Vec::new()
        };
        let band_rows = match face::port_rows(&ports) {
            0 => 0,
            rows => rows + 1,
        };
        let mut parts = Vec::with_capacity(container.regions.len());
        for (region_index, region) in container.regions.iter().enumerate() {
            parts.push(self.region(container, region_index, region, shown, room, &numbers)?);
        }
        // Nets run between regions.
        let margin = REGION_MARGIN + (nets.len() as i32 / 2).min(NETS_MARGIN) + room;
        let sizes: Vec<Spot> = parts
            .iter()
            .map(|(part, size)| {
                let width = size[0].max(part.name_area.width() - margin);
                [width + 2 * margin, size[1] + REGION_NAME_ROWS + margin]
            })
            .collect();
        let names: i32 = [Side::Left, Side::Right]
            .iter()
            .map(|side| face::widest_name(&ports, *side))
            .sum();
        let top = heading + band_rows;
        let packing = pack::pack(
            &sizes,
            [
                least[0].max(if ports.is_empty() {
                    0
                } else {
                    names + BETWEEN_PORT_NAMES
                }),
                least[1] - top,
            ],
        );
        // Even, so that the middle of the box is a lane.
        let width = (packing.size[0] + 2 * LANE - 1) / (2 * LANE) * (2 * LANE);
        let mut body = Body {
            size: [width, packing.size[1] + top],
            declarations,
            ports,
            regions: Vec::with_capacity(parts.len()),
            dividers: Vec::new(),
            nets: Vec::new(),
        };
        let stretch = |column: i32| {
            if column == packing.size[0] {
                width
            } else {
                column
            }
        };
        for [start, end] in &packing.dividers {
            body.dividers.push([
                [stretch(start[0]), start[1] + top],
                [stretch(end[0]), end[1] + top],
            ]);
        }
        for ((mut part, size), area) in parts.into_iter().zip(&packing.parts) {
            // In the middle of its part, from the top on.
            let left = area.left + (stretch(area.right) - area.left - size[0]) / 2;
            // Lanes of all regions are even columns.
            let by = [
                left - left.rem_euclid(LANE),
                area.top + top + REGION_NAME_ROWS,
            ];
            part.name_area = part.name_area.moved([area.left + 1, area.top + top + 1]);
            for state in &mut part.states {
                state.area = state.area.moved(by);
            }
            for transition in &mut part.transitions {
                for spot in &mut transition.route {
                    *spot = grid::moved(*spot, by);
                }
                if let Some((area, _)) = &mut transition.label {
                    *area = area.moved(by);
                }
            }
            body.regions.push(part);
        }
        body.nets = nets
            .iter()
            .map(|ends| Net {
                ends: ends.iter().filter_map(|end| net_end(&body, *end)).collect(),
                wiring: None,
            })
            .collect();
        Ok(body)
    }

    /// A region at the origin, and its size.
    fn region(
        &mut self,
        container: &'a Container,
        region_index: usize,
        region: &'a Region,
        shown: &Shown,
        room: i32,
        numbers: &HashMap<PathEnd, usize>,
    ) -> Result<(RegionPart, Spot), TooTangled> {
        let states = region.states.len();
        let initial = region
            .transitions
            .iter()
            .any(|transition| transition.source == Source::Initial);
        let finals = region
            .transitions
            .iter()
            .any(|transition| transition.target == Target::Final);
        // `initial` comes first, so that the layout begins with it; `final` last.
        let first = usize::from(initial);
        let from = |transition: &Transition| match transition.source {
            Source::Initial => 0,
            Source::State(state) => first + state,
        };
        let to = |transition: &Transition| match transition.target {
            Target::Final => first + states,
            Target::State(state) => first + state,
        };
        let turns = turns(region);
        let label = |index: usize| {
            label::of_transition(
                self.model,
                container,
                region_index,
                &region.transitions[index],
                turns[index],
            )
        };
        let labels: Vec<Vec<Line>> = (0..region.transitions.len()).map(label).collect();

        let mut faces = Vec::with_capacity(first + states + 1);
        let mut insides = Vec::with_capacity(first + states + 1);
        if initial {
            faces.push(Face::pseudo(Kind::Initial));
            insides.push(None);
        }
        for state in 0..states {
            let loops: Vec<&[Line]> = region
                .transitions
                .iter()
                .zip(&labels)
                .filter(|(one, _)| {
                    one.source == Source::State(state) && one.target == Target::State(state)
                })
                .map(|(_, label)| label.as_slice())
                .collect();
            let number = |port| {
                let end = PathEnd::State {
                    region: region_index,
                    state,
                    port,
                };
                numbers.get(&end).copied()
            };
            let state = &region.states[state];
            let inside = match state.kind {
                StateKind::Super { container } => {
                    let inner = shown.inside(&region.name, &state.name);
                    inner.map(|inner| (container, inner))
                }
                _ => None,
            };
            let mut face = Face::of_state(
                self.model,
                state,
                self.options.data,
                inside.is_some(),
                number,
            );
            face.add_loops(&loops);
            let body = match inside {
                Some((inner, shown)) => Some(self.body(inner, shown, face.size)?),
                None => None,
            };
            if let Some(body) = &body {
                face.size = body.size;
            }
            faces.push(face);
            insides.push(body);
        }
        if finals {
            faces.push(Face::pseudo(Kind::Final));
            insides.push(None);
        }

        let nodes: Vec<Node> = faces
            .iter()
            .map(|face| Node {
                half: face.size[0] / (2 * LANE),
                beside: (face.beside() + LANE - 1) / LANE,
                height: face.size[1],
                may_grow: !matches!(face.kind, Kind::Initial | Kind::Final),
            })
            .collect();
        let mut edges = Vec::new();
        let mut edge_of = vec![None; region.transitions.len()];
        for (index, transition) in region.transitions.iter().enumerate() {
            if from(transition) != to(transition) {
                edge_of[index] = Some(edges.len());
                edges.push(Edge {
                    from: from(transition),
                    to: to(transition),
                    label: label::size(&labels[index]),
                });
            }
        }
        let spacing = Spacing {
            beside_nodes: 2 + room + i32::from(self.options.data),
            around_tracks: 2 + room / 2,
        };
        let placement = layered::arrange(&nodes, &edges, spacing)?;
        let Placement {
            nodes: areas,
            routes,
            labels: label_areas,
            size,
        } = placement;

        let mut placed = Vec::with_capacity(faces.len());
        for ((mut face, inside), area) in faces.into_iter().zip(insides).zip(areas) {
            face.size = [area.width(), area.height()];
            let inside = inside.map(|inside| {
                if inside.size[0] < face.size[0] {
                    Rc::new(inside.widened(face.size[0]))
                } else {
                    inside
                }
            });
            placed.push(PlacedState { area, face, inside });
        }
        let mut transitions = Vec::with_capacity(region.transitions.len());
        let mut loops_seen = vec![0; placed.len()];
        for ((index, transition), label) in region.transitions.iter().enumerate().zip(labels) {
            let (from, to) = (from(transition), to(transition));
            let (route, area) = match edge_of[index] {
                Some(edge) => (
                    wires::corners(routes[edge].iter().copied()),
                    label_areas[edge],
                ),
                None => {
                    let state = &placed[from];
                    let Loop { row, rows, label } = state.face.loops[loops_seen[from]];
                    loops_seen[from] += 1;
                    let [right, top] = [state.area.right, state.area.top + row];
                    let route = vec![
                        [right, top],
                        [right + LOOP_REACH, top],
                        [right + LOOP_REACH, top + rows],
                        [right, top + rows],
                    ];
                    let corner = [right + LOOP_REACH + 1, top + (rows - label[1]) / 2];
                    (route, Some(Area::new(corner, label)))
                }
            };
            transitions.push(PlacedTransition {
                from,
                to,
                route,
                label: area.map(|area| (area, label)),
                span: transition.span,
            });
        }
        let name = label::name(&region.name);
        let name_width = grid::cells(Line::words(name.as_ref()).width(label::REGION));
        let part = RegionPart {
            name: name.into_owned(),
            source_name: region.name.clone(),
            name_area: Area::new([0, 0], [name_width, label::LINE_ROWS]),
            states: placed,
            transitions,
        };
        Ok((part, size))
    }
}

impl Body {
    /// The same body in a wider box, for a state whose transitions need that. The room is added at
    /// the right; ports there move, and their wires grow.
    fn widened(&self, width: i32) -> Body {
        let mut wide = self.clone();
        wide.size[0] = width;
        for end in wide.dividers.iter_mut().flatten() {
            if end[0] == self.size[0] {
                end[0] = width;
            }
        }
        for index in 0..wide.nets.len() {
            let ends = wide.nets[index].ends.clone();
            for end in ends {
                let (Some(old), Some(new)) = (terminal(self, end), terminal(&wide, end)) else {
                    continue;
                };
                if old == new {
                    continue;
                }
                if let Some(wiring) = &mut wide.nets[index].wiring {
                    let touching = wiring.lines.iter().filter(|line| {
                        line.first() == Some(&old.at) || line.last() == Some(&old.at)
                    });
                    if touching.count() > 1 && !wiring.joints.contains(&old.at) {
                        wiring.joints.push(old.at);
                    }
                    wiring.lines.push(vec![old.at, new.at]);
                }
            }
        }
        wide
    }
}

/// For each transition its place among those of its source that the same event can trigger, from 1,
/// where there are several. The first that can be taken is taken.
fn turns(region: &Region) -> Vec<Option<usize>> {
    let key = |transition: &Transition| {
        let event = match transition.trigger {
            Trigger::Pulse | Trigger::Star => None,
            Trigger::Event(event) => Some(event),
        };
        (transition.source, event)
    };
    let mut counts: HashMap<_, usize> = HashMap::new();
    for transition in &region.transitions {
        *counts.entry(key(transition)).or_default() += 1;
    }
    let mut seen: HashMap<_, usize> = HashMap::new();
    region
        .transitions
        .iter()
        .map(|transition| {
            let turn = seen.entry(key(transition)).or_default();
            *turn += 1;
            (counts.get(&key(transition)).copied().unwrap_or(0) > 1).then_some(*turn)
        })
        .collect()
}

/// Ports joined by data paths, in the order of the source.
fn nets_of(container: &Container) -> Vec<Vec<PathEnd>> {
    let mut net_of: HashMap<PathEnd, usize> = HashMap::new();
    let mut nets: Vec<Vec<PathEnd>> = Vec::new();
    for path in &container.paths {
        let ends: Vec<PathEnd> = path.from.iter().chain(&path.to).copied().collect();
        let known = ends.iter().filter_map(|end| net_of.get(end).copied()).min();
        let home = known.unwrap_or_else(|| {
            nets.push(Vec::new());
            nets.len() - 1
        });
        for end in ends {
            match net_of.insert(end, home) {
                None => nets[home].push(end),
                Some(old) if old != home => {
                    // The path joins two nets: the later one moves into the earlier.
                    let moving = std::mem::take(&mut nets[old]);
                    for other in &moving {
                        net_of.insert(*other, home);
                    }
                    nets[home].extend(moving);
                }
                Some(_) => {}
            }
        }
    }
    nets.retain(|ends| !ends.is_empty());
    nets
}

/// For each port the number of its net, from 1.
fn numbers_of(nets: &[Vec<PathEnd>]) -> HashMap<PathEnd, usize> {
    let numbered = (1..).zip(nets);
    numbered
        .flat_map(|(number, ends)| ends.iter().map(move |end| (*end, number)))
        .collect()
}

fn net_end(body: &Body, end: PathEnd) -> Option<NetEnd> {
    match end {
        PathEnd::Container { port } => {
            let port = body.ports.iter().position(|other| other.index == port)?;
            Some(NetEnd::Own(port))
        }
        PathEnd::State {
            region,
            state,
            port,
        } => {
            let part = body.regions.get(region)?;
            let pseudo = part.states.first()?.face.kind == Kind::Initial;
            let state = state + usize::from(pseudo);
            let ports = &part.states.get(state)?.face.ports;
            let port = ports.iter().position(|other| other.index == port)?;
            Some(NetEnd::State {
                region,
                state,
                port,
            })
        }
    }
}

/// Where a wire to this port begins, inside the body.
pub fn terminal(body: &Body, end: NetEnd) -> Option<Terminal> {
    match end {
        NetEnd::Own(port) => {
            let port = body.ports.get(port)?;
            let name = port.name_cells() + PORT_NAME_GAP + 1;
            Some(match port.side {
                Side::Left => Terminal {
                    at: [name, port.row],
                    heading: Heading::Right,
                },
                Side::Right => Terminal {
                    at: [body.size[0] - name, port.row],
                    heading: Heading::Left,
                },
            })
        }
        NetEnd::State {
            region,
            state,
            port,
        } => {
            let state = body.regions.get(region)?.states.get(state)?;
            let port = state.face.ports.get(port)?;
            Some(outer_terminal(&state.area, port))
        }
    }
}

/// Where a wire to a port of a state begins.
fn outer_terminal(area: &Area, port: &Port) -> Terminal {
    let row = area.top + port.row;
    match port.side {
        Side::Left => Terminal {
            at: [area.left - 1, row],
            heading: Heading::Left,
        },
        Side::Right => Terminal {
            at: [area.right + 1, row],
            heading: Heading::Right,
        },
    }
}

/// Leads the wires of a body around what is in it.
fn wire(body: &mut Body, nets: &[Vec<PathEnd>], steps: &mut usize) -> Result<(), NoWay> {
    if nets.is_empty() {
        return Ok(());
    }
    let [width, height] = body.size;
    if (width as usize + 1) * (height as usize + 1) > wires::MAX_CELLS {
        return Err(NoWay::Effort);
    }
    let mut board = Board::new(body.size);
    let heading = heading_rows(body.declarations.len());
    board.block(Area::new([0, 0], [width, heading - 1]));
    for port in &body.ports {
        board.block(port.name_area(Area::new([0, 0], body.size)));
    }
    for divider in &body.dividers {
        board.divider(*divider);
    }
    for region in &body.regions {
        for state in &region.states {
            for port in &state.face.ports {
                // No wire runs past a port; those that are on a net get their own back.
                board.port(outer_terminal(&state.area, port).at, None);
            }
            board.block(state.area);
        }
        board.block(region.name_area);
        for transition in &region.transitions {
            if let Some((area, _)) = &transition.label {
                board.block(*area);
            }
            board.transition(&transition.route);
            if transition.from == transition.to {
                // No wire runs between a loop and its state.
                let [start, .., end] = transition.route[..] else {
                    continue;
                };
                board.block(Area {
                    left: start[0] + 1,
                    top: start[1],
                    right: start[0] + LOOP_REACH,
                    bottom: end[1],
                });
            }
        }
    }
    let mut terminals = Vec::with_capacity(body.nets.len());
    for net in &body.nets {
        terminals.push(
            net.ends
                .iter()
                .filter_map(|end| terminal(body, *end))
                .collect(),
        );
    }
    let wirings = wires::lead(&mut board, &terminals, steps)?;
    for (net, wiring) in body.nets.iter_mut().zip(wirings) {
        net.wiring = Some(wiring);
    }
    Ok(())
}
