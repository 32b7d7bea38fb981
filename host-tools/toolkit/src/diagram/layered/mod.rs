//! Layered layout of one region: states in ranks from top to bottom, transitions in the channels
//! between.
//!
//! The stages are those of Sugiyama, Tagawa and Toda, "Methods for Visual Understanding of
//! Hierarchical System Structures" (1981): `rank`, `order`, `column`, `channel`. Between any two
//! ranks lies a layer for labels, so that a label is a vertex with a size, and nothing is ever led
//! through it.

mod channel;
mod column;
mod order;
mod rank;

use super::grid::{Area, LANE, Spot};
use channel::Line;

/// Vertices of a region at most, those included that long lines have in the layers they pass.
pub const MAX_VERTICES: usize = 100_000;

/// A state to be placed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Node {
    /// Lanes from its middle to its left and right edge.
    pub half: i32,
    /// Lanes to the right of it that belong to it: its loops.
    pub beside: i32,
    /// Cells from top to bottom.
    pub height: i32,
    /// Whether it may become wider so that its lines become straight.
    pub may_grow: bool,
}

/// A transition between two different states.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Edge {
    /// Index of the state that it leaves.
    pub from: usize,
    /// Index of the state that it enters.
    pub to: usize,
    /// Width and height of its label in cells; zeros for none.
    pub label: Spot,
}

/// Distances that a layout keeps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Spacing {
    /// Lanes between a state and what stands beside it.
    pub beside_nodes: i32,
    /// Rows between a layer and the first track of the channel next to it.
    pub around_tracks: i32,
}

/// The finished layout of a region, its upper left corner at the origin.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Placement {
    /// For each node its box, without what stands beside it: wider than asked for where its lines
    /// need that.
    pub nodes: Vec<Area>,
    /// For each edge its corners from source to target.
    pub routes: Vec<Vec<Spot>>,
    /// For each edge its label.
    pub labels: Vec<Option<Area>>,
    /// Width and height.
    pub size: Spot,
}

/// More vertices than [`MAX_VERTICES`] would be needed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TooTangled;

/// A vertex of a layer: a node, a label, or a place where a line passes.
#[derive(Clone, Copy, Debug)]
struct Vertex {
    layer: usize,
    /// Lanes to the left and right of its middle or line that it takes.
    left: i32,
    right: i32,
    /// Whether a line passes here, with or without its label.
    passes: bool,
}

/// The graph in layers: every line leads from one layer to the next.
struct Ladder {
    vertices: Vec<Vertex>,
    layers: Vec<Vec<usize>>,
    above: Vec<Vec<usize>>,
    below: Vec<Vec<usize>>,
    /// For each vertex its place in its layer.
    position: Vec<usize>,
    beside_nodes: i32,
}

impl Ladder {
    fn add(&mut self, vertex: Vertex) -> usize {
        let index = self.vertices.len();
        self.vertices.push(vertex);
        self.above.push(Vec::new());
        self.below.push(Vec::new());
        self.layers[vertex.layer].push(index);
        index
    }

    fn join(&mut self, upper: usize, lower: usize) {
        self.below[upper].push(lower);
        self.above[lower].push(upper);
    }

    fn number(&mut self) {
        self.position.resize(self.vertices.len(), 0);
        for layer in 0..self.layers.len() {
            self.number_layer(layer);
        }
    }

    fn number_layer(&mut self, layer: usize) {
        for (place, vertex) in self.layers[layer].iter().enumerate() {
            self.position[*vertex] = place;
        }
    }

    /// Lanes between the middles of two neighbours of a layer, at least.
    fn distance(&self, left: usize, right: usize) -> i32 {
        let (left, right) = (&self.vertices[left], &self.vertices[right]);
        let gap = match (left.passes, right.passes) {
            // A label has more room to the next line than to its own.
            (true, true) => 2,
            _ => self.beside_nodes,
        };
        left.right + gap + right.left
    }

    fn least_left(&self, columns: &[i32]) -> i32 {
        let lefts = self.vertices.iter().zip(columns);
        lefts
            .map(|(vertex, column)| column - vertex.left)
            .min()
            .unwrap_or(0)
    }

    fn greatest_right(&self, columns: &[i32]) -> i32 {
        let rights = self.vertices.iter().zip(columns);
        rights
            .map(|(vertex, column)| column + vertex.right)
            .max()
            .unwrap_or(0)
    }
}

/// The way of an edge through the layers.
struct Chain {
    /// The node at the upper and at the lower end.
    ends: [usize; 2],
    /// The vertices between, downwards; at least one.
    passing: Vec<usize>,
    /// Which of them is the label.
    label: Option<usize>,
}

/// Lays a region out.
///
/// # Errors
/// If its transitions are so many and so long that they would need more than [`MAX_VERTICES`]
/// vertices.
pub fn arrange(nodes: &[Node], edges: &[Edge], spacing: Spacing) -> Result<Placement, TooTangled> {
    let pairs: Vec<[usize; 2]> = edges.iter().map(|edge| [edge.from, edge.to]).collect();
    let rank = rank::ranks(nodes.len(), &pairs).rank;
    let nodes = &widened(nodes, &pairs, &rank);
    let (mut ladder, chains) = build(nodes, edges, &rank, spacing)?;
    ladder.number();
    order::sort(&mut ladder);
    let columns: Vec<i32> = column::columns(&ladder)
        .iter()
        .map(|lanes| lanes * LANE)
        .collect();
    let nodes = &straightened(nodes, &ladder, &columns);
    let left = nodes
        .iter()
        .zip(&columns)
        .map(|(node, column)| column - node.half * LANE);
    let beyond = left.min().unwrap_or(0).min(0);
    let columns: Vec<i32> = columns.iter().map(|column| column - beyond).collect();
    Ok(trace(nodes, edges, &ladder, &chains, &columns, spacing))
}

/// Nodes with room for all their lines: above and below, each has a column of its own between the
/// corners.
fn widened(nodes: &[Node], pairs: &[[usize; 2]], rank: &[usize]) -> Vec<Node> {
    let mut lines = vec![[0_i32; 2]; nodes.len()];
    for [from, to] in pairs {
        let leads_down = rank[*from] < rank[*to];
        lines[*from][usize::from(leads_down)] += 1;
        lines[*to][usize::from(!leads_down)] += 1;
    }
    let wide = |(node, [above, below]): (&Node, [i32; 2])| Node {
        half: node.half.max((above.max(below) + 2) / 2),
        ..*node
    };
    nodes.iter().zip(lines).map(wide).collect()
}

/// Makes vertices of nodes and of the layers that lines pass. Node `n` is vertex `n`.
fn build(
    nodes: &[Node],
    edges: &[Edge],
    rank: &[usize],
    spacing: Spacing,
) -> Result<(Ladder, Vec<Chain>), TooTangled> {
    let passed: usize = edges
        .iter()
        .map(|edge| 2 * rank[edge.from].abs_diff(rank[edge.to]))
        .sum();
    if passed + nodes.len() > MAX_VERTICES {
        return Err(TooTangled);
    }
    let ranks = rank.iter().max().map_or(0, |last| last + 1);
    let mut ladder = Ladder {
        vertices: Vec::new(),
        layers: vec![Vec::new(); (2 * ranks).saturating_sub(1)],
        above: Vec::new(),
        below: Vec::new(),
        position: Vec::new(),
        beside_nodes: spacing.beside_nodes,
    };
    for (node, rank) in nodes.iter().zip(rank) {
        ladder.add(Vertex {
            layer: 2 * rank,
            left: node.half,
            right: node.half + node.beside,
            passes: false,
        });
    }
    // Labels of long transitions stand where there is most room.
    let mut label_widths = vec![0; ladder.layers.len()];
    let mut chains = Vec::with_capacity(edges.len());
    for edge in edges {
        let (upper, lower) = if rank[edge.from] < rank[edge.to] {
            (edge.from, edge.to)
        } else {
            (edge.to, edge.from)
        };
        let between = 2 * rank[upper] + 1..=2 * rank[lower] - 1;
        let label_layer = between
            .clone()
            .step_by(2)
            .filter(|_| edge.label[0] > 0)
            .min_by_key(|layer| label_widths[*layer]);
        let mut chain = Chain {
            ends: [upper, lower],
            passing: Vec::new(),
            label: None,
        };
        let mut above = upper;
        for layer in between {
            let right = if Some(layer) == label_layer {
                label_widths[layer] += edge.label[0];
                chain.label = Some(chain.passing.len());
                (edge.label[0] + 1 + LANE - 1) / LANE
            } else {
                0
            };
            let vertex = ladder.add(Vertex {
                layer,
                left: 0,
                right,
                passes: true,
            });
            ladder.join(above, vertex);
            chain.passing.push(vertex);
            above = vertex;
        }
        ladder.join(above, lower);
        chains.push(chain);
    }
    Ok((ladder, chains))
}

/// Lanes by which a node grows on each side, at most, so that its lines become straight.
const GROWTH: i32 = 8;

/// Nodes that grow a little where that makes lines straight and there is room. `columns` are in
/// cells.
fn straightened(nodes: &[Node], ladder: &Ladder, columns: &[i32]) -> Vec<Node> {
    let grown = |(index, node): (usize, &Node)| {
        let layer = &ladder.layers[ladder.vertices[index].layer];
        let place = ladder.position[index];
        let room_to = |neighbour: Option<&usize>, is_left: bool| {
            neighbour.map_or(GROWTH, |other| {
                let apart = (columns[*other] - columns[index]).abs() / LANE;
                let (left, right) = if is_left {
                    (*other, index)
                } else {
                    (index, *other)
                };
                let room = apart - ladder.distance(left, right);
                // A neighbour that is a node may grow as well.
                if ladder.vertices[*other].passes {
                    room
                } else {
                    room / 2
                }
            })
        };
        let left = place.checked_sub(1).and_then(|before| layer.get(before));
        let room = room_to(left, true).min(room_to(layer.get(place + 1), false));
        let most = node.half + GROWTH.min(room);
        let mut half = node.half;
        if node.may_grow {
            for lines in [&ladder.above[index], &ladder.below[index]] {
                for sign in [-1, 1] {
                    let mut apart: Vec<i32> = lines
                        .iter()
                        .map(|line| sign * (columns[*line] - columns[index]) / LANE)
                        .filter(|apart| *apart > 0)
                        .collect();
                    apart.sort_unstable_by_key(|apart| std::cmp::Reverse(*apart));
                    // Those farther out come in between it and the corner.
                    let wanted = (1..).zip(apart).map(|(outer, apart)| apart + outer);
                    half = half.max(wanted.filter(|half| *half <= most).max().unwrap_or(0));
                }
            }
        }
        Node { half, ..*node }
    };
    nodes.iter().enumerate().map(grown).collect()
}

/// Columns at which the lines of a side of a node leave it.
fn spread(wanted: &mut [(i32, usize)], middle: i32, half: i32) {
    // Beside the corners: they are round.
    let (least, greatest) = (middle - half + LANE, middle + half - LANE);
    let mut next = least;
    for (column, _) in wanted.iter_mut() {
        *column = (*column).clamp(least, greatest).max(next);
        next = *column + LANE;
    }
    let mut last = greatest;
    for (column, _) in wanted.iter_mut().rev() {
        *column = (*column).min(last);
        last = *column - LANE;
    }
}

/// From columns to boxes, labels and routes.
fn trace(
    nodes: &[Node],
    edges: &[Edge],
    ladder: &Ladder,
    chains: &[Chain],
    columns: &[i32],
    spacing: Spacing,
) -> Placement {
    // Where each chain leaves its upper node and enters its lower one.
    let mut sides: Vec<[Vec<(i32, usize)>; 2]> = vec![Default::default(); nodes.len()];
    for (index, chain) in chains.iter().enumerate() {
        let [upper, lower] = chain.ends;
        if let (Some(first), Some(last)) = (chain.passing.first(), chain.passing.last()) {
            sides[upper][1].push((columns[*first], index));
            sides[lower][0].push((columns[*last], index));
        }
    }
    let mut ends = vec![[0; 2]; chains.len()];
    for (node, [top, bottom]) in sides.iter_mut().enumerate() {
        for (side, end) in [(top, 1), (bottom, 0)] {
            side.sort_unstable();
            spread(side, columns[node], nodes[node].half * LANE);
            for (column, chain) in side {
                ends[*chain][end] = *column;
            }
        }
    }

    // Which chains cross which channel, in which columns.
    let mut lines: Vec<Vec<Line>> = vec![Vec::new(); ladder.layers.len()];
    let mut places: Vec<Vec<usize>> = Vec::with_capacity(chains.len());
    for (chain, [top, bottom]) in chains.iter().zip(&ends) {
        let mut own = Vec::with_capacity(chain.passing.len() + 1);
        let first_layer = ladder.vertices[chain.ends[0]].layer;
        let mut from = *top;
        let stations = chain
            .passing
            .iter()
            .map(|vertex| columns[*vertex])
            .chain([*bottom]);
        for (layer, to) in (first_layer..).zip(stations) {
            own.push(lines[layer].len());
            lines[layer].push(Line {
                top: from,
                bottom: to,
            });
            from = to;
        }
        places.push(own);
    }
    let channels: Vec<_> = lines.iter().map(|lines| channel::lead(lines)).collect();

    // Rows.
    let mut heights = vec![0; ladder.layers.len()];
    for (node, vertex) in nodes.iter().zip(&ladder.vertices) {
        heights[vertex.layer] = heights[vertex.layer].max(node.height);
    }
    for (chain, edge) in chains.iter().zip(edges) {
        if let Some(label) = chain.label {
            let layer = ladder.vertices[chain.passing[label]].layer;
            heights[layer] = heights[layer].max(edge.label[1]);
        }
    }
    let mut tops = Vec::with_capacity(heights.len());
    let mut row = 0;
    for (layer, height) in heights.iter().enumerate() {
        tops.push(row);
        row += height;
        if layer + 1 < heights.len() {
            row += match channels[layer].tracks {
                0 => spacing.around_tracks + 1,
                tracks => 2 * spacing.around_tracks + LANE * (tracks - 1),
            };
        }
    }

    let boxes: Vec<Area> = nodes
        .iter()
        .enumerate()
        .map(|(index, node)| {
            let layer = ladder.vertices[index].layer;
            let top = tops[layer] + (heights[layer] - node.height) / 2;
            Area::new(
                [columns[index] - node.half * LANE, top],
                [2 * node.half * LANE, node.height],
            )
        })
        .collect();
    let mut routes = Vec::with_capacity(edges.len());
    let mut labels = Vec::with_capacity(edges.len());
    for (index, (chain, edge)) in chains.iter().zip(edges).enumerate() {
        let [upper, lower] = chain.ends;
        let first_layer = ladder.vertices[upper].layer;
        let mut route = vec![[ends[index][0], boxes[upper].bottom]];
        let mut column = ends[index][0];
        for (layer, place) in (first_layer..).zip(&places[index]) {
            let start = tops[layer] + heights[layer] + spacing.around_tracks;
            for turn in &channels[layer].turns[*place] {
                let row = start + LANE * turn.track;
                route.push([column, row]);
                route.push([turn.column, row]);
                column = turn.column;
            }
        }
        route.push([column, boxes[lower].top]);
        if edge.from != upper {
            route.reverse();
        }
        routes.push(route);
        labels.push(chain.label.map(|label| {
            let vertex = chain.passing[label];
            let layer = ladder.vertices[vertex].layer;
            let top = tops[layer] + (heights[layer] - edge.label[1]) / 2;
            Area::new([columns[vertex] + 1, top], edge.label)
        }));
    }
    let passing = ladder.vertices.iter().zip(columns);
    let right = passing
        .map(|(vertex, column)| column + vertex.right * LANE)
        .chain(
            boxes
                .iter()
                .zip(nodes)
                .map(|(area, node)| area.right + node.beside * LANE),
        )
        .max();
    Placement {
        nodes: boxes,
        routes,
        labels,
        size: [right.unwrap_or(0), row],
    }
}
