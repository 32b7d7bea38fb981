//! The finished layout: every box, line and word of a diagram at its place on the sheet.
//!
//! Containers that are used several times stand here once for each use. What a diagram promises
//! (nothing overlaps, every transition is there, …) is a statement about this, and so is tested on
//! it; [`paint`](super::paint) only gives it colours.

use super::body::{self, Body, NetEnd, PlacedState};
use super::face::{Kind, Port, Side, heading_rows};
use super::grid::{self, Area, Spot};
use super::label::Line;
use crate::model::{Direction, Span};

/// A diagram, laid out.
#[derive(Clone, Debug, Default)]
pub struct Drawing {
    /// Width and height of the sheet.
    pub size: Spot,
    /// Boxes, each after the one that it stands in.
    pub boxes: Vec<Placed>,
    /// Transitions.
    pub transitions: Vec<Arrow>,
    /// Names of regions.
    pub region_names: Vec<RegionName>,
    /// Lines between regions.
    pub dividers: Vec<Divider>,
    /// Data ports.
    pub ports: Vec<PlacedPort>,
    /// Nets.
    pub nets: Vec<PlacedNet>,
}

/// A box.
#[derive(Clone, Debug)]
pub struct Placed {
    /// Where it is.
    pub area: Area,
    /// Index into [`Drawing::boxes`] of the box that it stands in.
    pub parent: Option<usize>,
    /// What it stands for.
    pub kind: Kind,
    /// The path of the state in the machine, as traces have it; none of a container.
    pub path: String,
    /// Where the source declares it.
    pub span: Option<Span>,
    /// Whether its inside is shown.
    pub is_open: bool,
    /// The name.
    pub name: Line,
    /// What stands below the name: of an open box, its flags and events.
    pub details: Vec<Line>,
}

/// A transition.
#[derive(Clone, Debug)]
pub struct Arrow {
    /// Index into [`Drawing::boxes`] of the source.
    pub from: usize,
    /// Index into [`Drawing::boxes`] of the target.
    pub to: usize,
    /// Its corners, from the edge of the source to that of the target.
    pub route: Vec<Spot>,
    /// Its label.
    pub label: Option<(Area, Vec<Line>)>,
    /// Where the source has it.
    pub span: Span,
}

/// The name of a region.
#[derive(Clone, Debug)]
pub struct RegionName {
    /// Index into [`Drawing::boxes`] of the container.
    pub parent: usize,
    /// Where it stands.
    pub area: Area,
    /// The name.
    pub name: String,
}

/// A line between regions.
#[derive(Clone, Debug)]
pub struct Divider {
    /// Index into [`Drawing::boxes`] of the container.
    pub parent: usize,
    /// Where it begins and ends.
    pub ends: [Spot; 2],
}

/// A data port.
#[derive(Clone, Debug)]
pub struct PlacedPort {
    /// Index into [`Drawing::boxes`] of its box.
    pub owner: usize,
    /// The place on the edge of the box.
    pub at: Spot,
    /// The side.
    pub side: Side,
    /// Direction.
    pub direction: Direction,
    /// Whether it may stay open.
    pub optional: bool,
    /// Where its name stands.
    pub name_area: Area,
    /// Its name.
    pub name: String,
}

/// A net.
#[derive(Clone, Debug)]
pub struct PlacedNet {
    /// Index into [`Drawing::boxes`] of the container that it belongs to.
    pub parent: usize,
    /// Indices into [`Drawing::ports`] and, for each, where its wire begins.
    pub ends: Vec<(usize, Spot)>,
    /// Its lines by their corners; none where the ports carry its number.
    pub lines: Vec<Vec<Spot>>,
    /// Where its lines join.
    pub joints: Vec<Spot>,
}

/// Cells around the boxes of a sheet.
const SHEET_MARGIN: i32 = 3;
/// Rows between containers that stand one under the other.
const BETWEEN_ROOTS: i32 = 5;

impl Drawing {
    /// Puts containers, each with its name, one under the other.
    pub fn of(roots: &[(Line, std::rc::Rc<Body>)]) -> Self {
        let mut drawing = Drawing::default();
        let mut row = SHEET_MARGIN;
        let mut right = 0;
        for (name, body) in roots {
            let corner = [SHEET_MARGIN, row];
            let owner = drawing.boxes.len();
            drawing.boxes.push(Placed {
                area: Area::new(corner, body.size),
                parent: None,
                kind: Kind::Root,
                path: String::new(),
                span: None,
                is_open: true,
                name: name.clone(),
                details: body.declarations.clone(),
            });
            let own_ports = drawing.add_ports(owner, &body.ports);
            drawing.add_body(owner, own_ports, body, corner);
            row += body.size[1] + BETWEEN_ROOTS;
            right = right.max(SHEET_MARGIN + body.size[0]);
        }
        drawing.size = [
            right + SHEET_MARGIN,
            (row - BETWEEN_ROOTS).max(0) + SHEET_MARGIN,
        ];
        drawing
    }

    /// Adds the ports of a box; gives the index of the first.
    fn add_ports(&mut self, owner: usize, ports: &[Port]) -> usize {
        let first = self.ports.len();
        let area = self.boxes[owner].area;
        for port in ports {
            let column = match port.side {
                Side::Left => area.left,
                Side::Right => area.right,
            };
            self.ports.push(PlacedPort {
                owner,
                at: [column, area.top + port.row],
                side: port.side,
                direction: port.direction,
                optional: port.optional,
                name_area: port.name_area(area),
                name: port.name.clone(),
            });
        }
        first
    }

    /// Adds what is inside a box. Superstates are nested no deeper than [`super::MAX_LEVELS`], and
    /// so is this.
    fn add_body(&mut self, owner: usize, own_ports: usize, body: &Body, by: Spot) {
        for ends in &body.dividers {
            self.dividers.push(Divider {
                parent: owner,
                ends: ends.map(|end| grid::moved(end, by)),
            });
        }
        // For each region, for each state: its box and its first port.
        let mut placed: Vec<Vec<(usize, usize)>> = Vec::with_capacity(body.regions.len());
        for region in &body.regions {
            self.region_names.push(RegionName {
                parent: owner,
                area: region.name_area.moved(by),
                name: region.name.clone(),
            });
            let mut boxes = Vec::with_capacity(region.states.len());
            for state in &region.states {
                boxes.push(self.add_state(owner, &region.source_name, state, by));
            }
            for transition in &region.transitions {
                self.transitions.push(Arrow {
                    from: boxes[transition.from].0,
                    to: boxes[transition.to].0,
                    route: transition
                        .route
                        .iter()
                        .map(|spot| grid::moved(*spot, by))
                        .collect(),
                    label: transition
                        .label
                        .as_ref()
                        .map(|(area, lines)| (area.moved(by), lines.clone())),
                    span: transition.span,
                });
            }
            placed.push(boxes);
        }
        for net in &body.nets {
            let end = |end: &NetEnd| {
                let port = match *end {
                    NetEnd::Own(port) => own_ports + port,
                    NetEnd::State {
                        region,
                        state,
                        port,
                    } => placed.get(region)?.get(state)?.1 + port,
                };
                Some((port, grid::moved(body::terminal(body, *end)?.at, by)))
            };
            let wiring = net.wiring.clone().unwrap_or_default();
            let moved = |spots: Vec<Spot>| -> Vec<Spot> {
                spots
                    .into_iter()
                    .map(|spot| grid::moved(spot, by))
                    .collect()
            };
            self.nets.push(PlacedNet {
                parent: owner,
                ends: net.ends.iter().filter_map(end).collect(),
                lines: wiring.lines.into_iter().map(moved).collect(),
                joints: moved(wiring.joints),
            });
        }
    }

    /// Adds a state with all that is in it; gives its box and its first port.
    fn add_state(
        &mut self,
        parent: usize,
        region: &str,
        state: &PlacedState,
        by: Spot,
    ) -> (usize, usize) {
        let (area, face) = (state.area.moved(by), &state.face);
        let around = self.boxes.get(parent).map_or("", |it| it.path.as_str());
        let path = match around {
            "" => format!("{region}/{}", face.state),
            around => format!("{around}/{region}/{}", face.state),
        };
        let index = self.boxes.len();
        self.boxes.push(Placed {
            area,
            parent: Some(parent),
            kind: face.kind,
            path,
            span: face.span,
            is_open: state.inside.is_some(),
            name: face.name.clone(),
            details: face.details.clone(),
        });
        let ports = self.add_ports(index, &face.ports);
        if let Some(body) = &state.inside {
            self.add_body(index, ports, body, [area.left, area.top]);
        }
        (index, ports)
    }
}

impl Placed {
    /// The part of an open box that holds its name and declarations.
    pub fn heading(&self) -> Area {
        Area {
            bottom: self.area.top + heading_rows(self.details.len()),
            ..self.area
        }
    }
}
