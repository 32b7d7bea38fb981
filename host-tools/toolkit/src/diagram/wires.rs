//! Data paths, led around what stands already.
//!
//! Each net is a tree of level and upright lines between its ports. It grows port by port: the
//! cheapest way from a port to the tree is searched (Lee 1961, directed by distance after Hart,
//! Nilsson, Raphael 1968), where length, bends, crossings and narrow passages cost. When all nets
//! lie, each is taken up once more and led anew among the others (rip-up and reroute), for the
//! first ones could not know of the later ones.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use super::grid::{Area, Spot};

/// Cells of a container in which data paths are drawn as lines, at most. In a larger one ports
/// carry the number of their net instead.
pub const MAX_CELLS: usize = 2_000_000;
/// Ports on the nets of a container whose paths are drawn as lines, at most.
pub const MAX_ENDS: usize = 160;
/// Steps of the search for the ways of a container's nets, at most.
pub const MAX_STEPS: usize = 6_000_000;
/// Steps of the search for the ways of all nets of a diagram, at most.
pub const MAX_STEPS_IN_ALL: usize = 20_000_000;

/// Rounds in which nets are led anew.
const IMPROVEMENTS: usize = 1;

/// What a way costs. A step is a cell.
const STEP: u32 = 2;
const BEND: u32 = 12;
/// A bend right at a port is worse than one before it.
const TURN_IN: u32 = 18;
const CROSSING_TRANSITION: u32 = 9;
const CROSSING_NET: u32 = 11;
const CROSSING_DIVIDER: u32 = 2;
const BESIDE_BOX: u32 = 4;
const BESIDE_LINE: u32 = 3;

/// Whose a line is.
type Owner = u32;
const NOBODY: Owner = 0;
const DIVIDER: Owner = 1;
const TRANSITION: Owner = 2;
/// The first net; those after it follow.
const NETS: Owner = 3;

/// A direction on the raster.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Heading {
    /// To the right.
    Right,
    /// Downwards.
    Down,
    /// To the left.
    Left,
    /// Upwards.
    Up,
}

const HEADINGS: [Heading; 4] = [Heading::Right, Heading::Down, Heading::Left, Heading::Up];

impl Heading {
    fn is_level(self) -> bool {
        matches!(self, Heading::Right | Heading::Left)
    }
}

/// Where a wire begins: next to its port.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Terminal {
    /// The place.
    pub at: Spot,
    /// The direction that leads away from the port.
    pub heading: Heading,
}

/// The lines of a net.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Wiring {
    /// Lines by their corners.
    pub lines: Vec<Vec<Spot>>,
    /// Where lines of the net join: the net's connectors.
    pub joints: Vec<Spot>,
}

/// Why nets have no lines.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NoWay {
    /// It is too narrow.
    Narrow,
    /// The search took more than [`MAX_STEPS`] steps, or with those before it more than
    /// [`MAX_STEPS_IN_ALL`].
    Effort,
}

/// What stands already in a container: a raster of points, and the owners of the lines between
/// them.
pub struct Board {
    width: i32,
    height: i32,
    blocked: Vec<bool>,
    beside_box: Vec<bool>,
    /// Owner of the line from a point to the right, and from a point downwards.
    level: Vec<Owner>,
    upright: Vec<Owner>,
    /// Who has a corner, an end or a port at a point: no other line may pass there.
    knot: Vec<Owner>,
}

impl Board {
    /// An empty board with points from the origin to `size`, both included. Its rim is blocked.
    pub fn new([width, height]: Spot) -> Self {
        let (width, height) = (width.max(0) + 1, height.max(0) + 1);
        let points = (width as usize) * (height as usize);
        let mut board = Board {
            width,
            height,
            blocked: vec![false; points],
            beside_box: vec![false; points],
            level: vec![NOBODY; points],
            upright: vec![NOBODY; points],
            knot: vec![NOBODY; points],
        };
        for column in 0..width {
            for row in [0, height - 1] {
                board.block(Area::new([column, row], [0, 0]));
            }
        }
        for row in 0..height {
            for column in [0, width - 1] {
                board.block(Area::new([column, row], [0, 0]));
            }
        }
        board
    }

    fn index(&self, [column, row]: Spot) -> Option<usize> {
        let inside = (0..self.width).contains(&column) && (0..self.height).contains(&row);
        inside.then(|| row as usize * self.width as usize + column as usize)
    }

    /// Lets no wire onto an area or its rim, and few right beside it.
    pub fn block(&mut self, area: Area) {
        for row in area.top - 1..=area.bottom + 1 {
            for column in area.left - 1..=area.right + 1 {
                let Some(index) = self.index([column, row]) else {
                    continue;
                };
                let is_inside = (area.left..=area.right).contains(&column)
                    && (area.top..=area.bottom).contains(&row);
                if is_inside {
                    self.blocked[index] = true;
                } else {
                    self.beside_box[index] = true;
                }
            }
        }
    }

    /// Puts a transition's line onto the board. Its arrow head is not to be crossed either.
    pub fn transition(&mut self, points: &[Spot]) {
        self.lay(points, TRANSITION);
        if let [.., before, end] = points {
            let towards = |from: i32, to: i32| from + (to - from).signum();
            let head = [towards(end[0], before[0]), towards(end[1], before[1])];
            self.tie(head, TRANSITION);
        }
    }

    /// Puts the line between two regions onto the board.
    pub fn divider(&mut self, ends: [Spot; 2]) {
        self.lay(&ends, DIVIDER);
    }

    /// Keeps the place next to a port for its net, or, for a port on no net, for nobody.
    pub fn port(&mut self, at: Spot, net: Option<usize>) {
        match (self.index(at), net) {
            (Some(index), Some(net)) => {
                self.blocked[index] = false;
                self.tie(at, NETS + net as Owner);
            }
            (Some(index), None) => self.blocked[index] = true,
            (None, _) => {}
        }
    }

    fn tie(&mut self, at: Spot, owner: Owner) {
        if let Some(index) = self.index(at) {
            self.knot[index] = owner;
        }
    }

    fn lay(&mut self, points: &[Spot], owner: Owner) {
        for [from, to] in points.array_windows() {
            let (left, right) = (from[0].min(to[0]), from[0].max(to[0]));
            let (top, bottom) = (from[1].min(to[1]), from[1].max(to[1]));
            for column in left..right {
                if let Some(index) = self.index([column, top]) {
                    self.level[index] = owner;
                }
            }
            for row in top..bottom {
                if let Some(index) = self.index([left, row]) {
                    self.upright[index] = owner;
                }
            }
        }
        for point in points {
            self.tie(*point, owner);
        }
    }

    /// The owner of the line from a point in a direction.
    fn line(&self, index: usize, heading: Heading) -> Owner {
        let width = self.width as usize;
        let (lines, at) = match heading {
            Heading::Right => (&self.level, Some(index)),
            Heading::Left => (&self.level, index.checked_sub(1)),
            Heading::Down => (&self.upright, Some(index)),
            Heading::Up => (&self.upright, index.checked_sub(width)),
        };
        at.and_then(|at| lines.get(at)).copied().unwrap_or(NOBODY)
    }

    fn neighbour(&self, index: usize, heading: Heading) -> Option<usize> {
        let width = self.width as usize;
        // The rim is blocked, so that no way ever stands on it and steps over its end.
        match heading {
            Heading::Right => Some(index + 1).filter(|next| *next < self.blocked.len()),
            Heading::Left => index.checked_sub(1),
            Heading::Down => Some(index + width).filter(|next| *next < self.blocked.len()),
            Heading::Up => index.checked_sub(width),
        }
    }

    /// Whether lines of others touch a point.
    fn is_shared(&self, index: usize, owner: Owner) -> bool {
        HEADINGS
            .iter()
            .any(|heading| ![NOBODY, owner].contains(&self.line(index, *heading)))
            || ![NOBODY, owner].contains(&self.knot[index])
    }

    fn spot(&self, index: usize) -> Spot {
        let width = self.width as usize;
        [(index % width) as i32, (index / width) as i32]
    }
}

/// A net that lies: its ways, each a list of neighbouring points, and what they cost.
#[derive(Default)]
struct Tree {
    ways: Vec<Vec<usize>>,
    cost: u32,
}

/// Leads wires for `nets` over a board. `steps` are those that the diagram may still take, and are
/// used up.
///
/// # Errors
/// If a net finds no way, or the search takes too long.
pub fn lead(
    board: &mut Board,
    nets: &[Vec<Terminal>],
    steps: &mut usize,
) -> Result<Vec<Wiring>, NoWay> {
    let mut search = Search::new(board, MAX_STEPS.min(*steps));
    let wirings = search.lead(board, nets);
    *steps = steps.saturating_sub(search.steps);
    wirings
}

fn span(terminals: &[Terminal]) -> i32 {
    let extent = |axis: usize| {
        let places = terminals.iter().map(|terminal| terminal.at[axis]);
        places.clone().max().unwrap_or(0) - places.min().unwrap_or(0)
    };
    extent(0) + extent(1)
}

fn tie_terminals(board: &mut Board, terminals: &[Terminal], owner: Owner) {
    for terminal in terminals {
        board.tie(terminal.at, owner);
    }
}

/// Gives the lines of ways an owner, or takes them up.
fn lay_ways(board: &mut Board, ways: &[Vec<usize>], owner: Owner) {
    let width = board.width as usize;
    for way in ways {
        for (index, [from, to]) in way.array_windows().enumerate() {
            let first = *from.min(to);
            let is_upright = from.abs_diff(*to) == width;
            if is_upright {
                board.upright[first] = owner;
            } else {
                board.level[first] = owner;
            }
            let turns = index == 0 || way[index - 1].abs_diff(*from) != from.abs_diff(*to);
            if turns {
                board.knot[*from] = owner;
            }
        }
        if let Some(last) = way.last() {
            board.knot[*last] = owner;
        }
    }
}

/// What a way costs on a board on which it does not lie.
fn cost_of(board: &Board, way: &[usize], owner: Owner) -> u32 {
    let width = board.width as usize;
    let heading = |from: usize, to: usize| match (to > from, from.abs_diff(to) == width) {
        (true, true) => Heading::Down,
        (false, true) => Heading::Up,
        (true, false) => Heading::Right,
        (false, false) => Heading::Left,
    };
    let mut cost = 0;
    for (index, [from, to]) in way.array_windows().enumerate() {
        let now = heading(*from, *to);
        cost += step_cost(board, *from, *to, now, owner);
        if index > 0 && heading(way[index - 1], *from) != now {
            cost += BEND;
        }
    }
    cost
}

fn step_cost(board: &Board, from: usize, to: usize, heading: Heading, owner: Owner) -> u32 {
    let across = if heading.is_level() {
        [Heading::Up, Heading::Down]
    } else {
        [Heading::Left, Heading::Right]
    };
    let crossed = across.map(|side| board.line(to, side));
    let crossing = match crossed
        .into_iter()
        .find(|line| ![NOBODY, owner].contains(line))
    {
        None => 0,
        Some(DIVIDER) => CROSSING_DIVIDER,
        Some(TRANSITION) => CROSSING_TRANSITION,
        Some(_) => CROSSING_NET,
    };
    let beside = across
        .iter()
        .filter_map(|side| board.neighbour(from, *side))
        .filter(|next| ![NOBODY, owner].contains(&board.line(*next, heading)))
        .count() as u32;
    let narrow = if board.beside_box[to] { BESIDE_BOX } else { 0 };
    STEP + crossing + beside * BESIDE_LINE + narrow
}

/// Memory of the search, kept from one to the next. A state is a point and the direction in which
/// it was reached.
struct Search {
    cost: Vec<u32>,
    came_from: Vec<u8>,
    /// The search in which a state was last seen.
    seen: Vec<u32>,
    /// The search for which a point is a goal.
    goal: Vec<u32>,
    round: u32,
    steps: usize,
    most_steps: usize,
}

impl Search {
    fn new(board: &Board, most_steps: usize) -> Self {
        let points = board.blocked.len();
        Search {
            cost: vec![0; 4 * points],
            came_from: vec![0; 4 * points],
            seen: vec![0; 4 * points],
            goal: vec![0; points],
            round: 0,
            steps: 0,
            most_steps,
        }
    }

    /// Leads all nets, one after the other, and then each once more among the others.
    fn lead(&mut self, board: &mut Board, nets: &[Vec<Terminal>]) -> Result<Vec<Wiring>, NoWay> {
        for (net, terminals) in nets.iter().enumerate() {
            for terminal in terminals {
                board.port(terminal.at, Some(net));
            }
        }
        // Short nets have the least choice.
        let mut order: Vec<usize> = (0..nets.len()).collect();
        order.sort_by_key(|net| (span(&nets[*net]), *net));
        let mut trees: Vec<Tree> = Vec::new();
        trees.resize_with(nets.len(), Tree::default);
        for net in &order {
            let owner = NETS + *net as Owner;
            trees[*net] = self.grow(board, owner, &nets[*net])?;
        }
        for _ in 0..IMPROVEMENTS {
            for net in &order {
                let owner = NETS + *net as Owner;
                let old = std::mem::take(&mut trees[*net]);
                lay_ways(board, &old.ways, NOBODY);
                tie_terminals(board, &nets[*net], owner);
                let old_cost = old.ways.iter().map(|way| cost_of(board, way, owner)).sum();
                match self.grow(board, owner, &nets[*net]) {
                    Ok(new) if new.cost < old_cost => trees[*net] = new,
                    Ok(new) => {
                        lay_ways(board, &new.ways, NOBODY);
                        tie_terminals(board, &nets[*net], owner);
                        lay_ways(board, &old.ways, owner);
                        trees[*net] = old;
                    }
                    Err(NoWay::Effort) => return Err(NoWay::Effort),
                    // The old way is there still.
                    Err(NoWay::Narrow) => {
                        lay_ways(board, &old.ways, owner);
                        trees[*net] = old;
                    }
                }
            }
        }
        Ok((NETS..)
            .zip(&trees)
            .map(|(owner, tree)| wiring(board, owner, tree))
            .collect())
    }

    /// Joins the terminals of a net.
    fn grow(
        &mut self,
        board: &mut Board,
        owner: Owner,
        terminals: &[Terminal],
    ) -> Result<Tree, NoWay> {
        let mut tree = Tree::default();
        let Some((first, others)) = terminals.split_first() else {
            return Ok(tree);
        };
        let mut joined: Vec<Terminal> = vec![*first];
        let mut waiting: Vec<Terminal> = others.to_vec();
        let mut points: Vec<usize> = board.index(first.at).into_iter().collect();
        while !waiting.is_empty() {
            let distance = |one: &Terminal| {
                let to = |other: &Terminal| {
                    one.at[0].abs_diff(other.at[0]) + one.at[1].abs_diff(other.at[1])
                };
                joined.iter().map(to).min().unwrap_or(0)
            };
            let nearest = (0..waiting.len())
                .min_by_key(|index| distance(&waiting[*index]))
                .unwrap_or(0);
            let terminal = waiting.remove(nearest);
            let found = self.way(board, owner, terminal, terminals, &points);
            let (way, cost) = match found {
                Ok(found) => found,
                Err(reason) => {
                    lay_ways(board, &tree.ways, NOBODY);
                    tie_terminals(board, terminals, owner);
                    return Err(reason);
                }
            };
            lay_ways(board, std::slice::from_ref(&way), owner);
            points.extend(&way);
            tree.ways.push(way);
            tree.cost += cost;
            joined.push(terminal);
        }
        Ok(tree)
    }

    /// The cheapest way from a terminal to one of the goals. `all` are the terminals of the net.
    fn way(
        &mut self,
        board: &Board,
        owner: Owner,
        terminal: Terminal,
        all: &[Terminal],
        goals: &[usize],
    ) -> Result<(Vec<usize>, u32), NoWay> {
        self.round += 1;
        let mut bounds: Option<Area> = None;
        for goal in goals {
            self.goal[*goal] = self.round;
            let [column, row] = board.spot(*goal);
            let known = bounds.get_or_insert(Area::new([column, row], [0, 0]));
            known.left = known.left.min(column);
            known.right = known.right.max(column);
            known.top = known.top.min(row);
            known.bottom = known.bottom.max(row);
        }
        let (Some(start), Some(bounds)) = (board.index(terminal.at), bounds) else {
            return Err(NoWay::Narrow);
        };
        // What is left at least: the distance to the goals, and a bend where they are not straight
        // ahead.
        let ahead = |state: usize| {
            let [column, row] = board.spot(state / 4);
            let (to_left, to_right) = (column - bounds.right, bounds.left - column);
            let (upwards, downwards) = (row - bounds.bottom, bounds.top - row);
            let (across, along) = (to_left.max(to_right).max(0), upwards.max(downwards).max(0));
            let is_ahead = match HEADINGS[state % 4] {
                Heading::Right => along == 0 && to_left <= 0,
                Heading::Left => along == 0 && to_right <= 0,
                Heading::Down => across == 0 && upwards <= 0,
                Heading::Up => across == 0 && downwards <= 0,
            };
            STEP * (across + along) as u32 + if is_ahead { 0 } else { BEND }
        };
        let first = 4 * start + terminal.heading as usize;
        let mut waiting = BinaryHeap::new();
        self.seen[first] = self.round;
        self.cost[first] = 0;
        waiting.push(Reverse((ahead(first), 0_u32, first)));
        while let Some(Reverse((_, cost, state))) = waiting.pop() {
            if self.cost[state] < cost {
                continue;
            }
            let point = state / 4;
            if self.goal[point] == self.round && (point == start || !board.is_shared(point, owner))
            {
                return Ok((self.trace(board, state, first), cost));
            }
            self.steps += 1;
            if self.steps > self.most_steps {
                return Err(NoWay::Effort);
            }
            let heading = HEADINGS[state % 4];
            let may_turn = !board.is_shared(point, owner);
            for next_heading in HEADINGS {
                let turns = next_heading != heading;
                let turns_back = next_heading.is_level() == heading.is_level();
                if turns && (turns_back || !may_turn) {
                    continue;
                }
                let Some(next) = board.neighbour(point, next_heading) else {
                    continue;
                };
                let is_taken = board.line(point, next_heading) != NOBODY;
                let is_tied = ![NOBODY, owner].contains(&board.knot[next]);
                if board.blocked[next] || is_taken || is_tied {
                    continue;
                }
                // Whoever comes to a port from above or below would turn into it.
                let turns_in = board.knot[next] == owner
                    && !next_heading.is_level()
                    && all.iter().any(|one| board.index(one.at) == Some(next));
                let bend = BEND * u32::from(turns) + TURN_IN * u32::from(turns_in);
                let next_cost = cost + bend + step_cost(board, point, next, next_heading, owner);
                let next_state = 4 * next + next_heading as usize;
                if self.seen[next_state] == self.round && self.cost[next_state] <= next_cost {
                    continue;
                }
                self.seen[next_state] = self.round;
                self.cost[next_state] = next_cost;
                self.came_from[next_state] = heading as u8;
                waiting.push(Reverse((
                    next_cost + ahead(next_state),
                    next_cost,
                    next_state,
                )));
            }
        }
        Err(NoWay::Narrow)
    }

    /// The points from the first state to the last.
    fn trace(&self, board: &Board, last: usize, first: usize) -> Vec<usize> {
        let width = board.width as usize;
        let mut state = last;
        let mut way = vec![state / 4];
        while state != first {
            let point = state / 4;
            let before = match HEADINGS[state % 4] {
                Heading::Right => point - 1,
                Heading::Left => point + 1,
                Heading::Down => point - width,
                Heading::Up => point + width,
            };
            state = 4 * before + usize::from(self.came_from[state]);
            way.push(before);
        }
        way.reverse();
        way
    }
}

/// Lines and joints of a net that lies.
fn wiring(board: &Board, owner: Owner, tree: &Tree) -> Wiring {
    let mut joints: Vec<usize> = tree
        .ways
        .iter()
        .filter_map(|way| way.last().copied())
        .filter(|point| {
            let lines = HEADINGS
                .iter()
                .filter(|heading| board.line(*point, **heading) == owner);
            lines.count() > 2
        })
        .collect();
    joints.sort_unstable();
    joints.dedup();
    Wiring {
        lines: tree
            .ways
            .iter()
            .map(|way| corners(way.iter().map(|point| board.spot(*point))))
            .collect(),
        joints: joints.into_iter().map(|point| board.spot(point)).collect(),
    }
}

/// The ends and bends of a line.
pub fn corners(points: impl IntoIterator<Item = Spot>) -> Vec<Spot> {
    let mut corners: Vec<Spot> = Vec::new();
    for point in points {
        if let [.., before, last] = corners[..] {
            let is_straight = (before[0] == last[0] && last[0] == point[0])
                || (before[1] == last[1] && last[1] == point[1]);
            if is_straight {
                corners.pop();
            }
        }
        if corners.last() != Some(&point) {
            corners.push(point);
        }
    }
    corners
}

#[cfg(test)]
mod tests {
    use super::*;

    fn terminal(at: Spot, heading: Heading) -> Terminal {
        Terminal { at, heading }
    }

    #[test]
    fn a_wire_goes_around_a_box_and_bends_no_more_than_it_must() {
        let mut board = Board::new([40, 20]);
        board.block(Area::new([15, 5], [6, 8]));
        let nets = [vec![
            terminal([5, 9], Heading::Right),
            terminal([30, 9], Heading::Left),
        ]];
        let wiring = &lead(&mut board, &nets, &mut { MAX_STEPS }).unwrap()[0];
        assert_eq!(wiring.lines.len(), 1);
        assert_eq!(wiring.lines[0].len(), 6, "{wiring:?}");
        assert!(wiring.joints.is_empty());
    }

    #[test]
    fn three_ports_meet_in_a_joint() {
        let mut board = Board::new([40, 20]);
        let nets = [vec![
            terminal([5, 5], Heading::Right),
            terminal([30, 5], Heading::Left),
            terminal([15, 15], Heading::Right),
        ]];
        let wiring = &lead(&mut board, &nets, &mut { MAX_STEPS }).unwrap()[0];
        assert_eq!((wiring.lines.len(), wiring.joints.len()), (2, 1));
    }

    #[test]
    fn two_nets_cross_at_right_angles_only() {
        let mut board = Board::new([40, 40]);
        let nets = [
            vec![
                terminal([5, 20], Heading::Right),
                terminal([30, 20], Heading::Left),
            ],
            vec![
                terminal([17, 5], Heading::Right),
                terminal([18, 30], Heading::Left),
            ],
        ];
        let wirings = lead(&mut board, &nets, &mut { MAX_STEPS }).unwrap();
        assert_eq!(wirings[0].lines[0], [[30, 20], [5, 20]]);
        assert_eq!(wirings[1].lines.len(), 1);
    }

    #[test]
    fn a_diagram_that_has_no_steps_left_is_told() {
        let nets = [vec![
            terminal([5, 20], Heading::Right),
            terminal([30, 20], Heading::Left),
        ]];
        let mut steps = 60;
        assert!(lead(&mut Board::new([40, 40]), &nets, &mut steps).is_ok());
        assert!(steps < 60);
        let second = lead(&mut Board::new([40, 40]), &nets, &mut steps);
        assert_eq!((second, steps), (Err(NoWay::Effort), 0));
    }

    #[test]
    fn a_port_behind_walls_is_told() {
        let mut board = Board::new([40, 20]);
        board.block(Area::new([20, 0], [1, 20]));
        let nets = [vec![
            terminal([5, 9], Heading::Right),
            terminal([30, 9], Heading::Left),
        ]];
        assert_eq!(
            lead(&mut board, &nets, &mut { MAX_STEPS }),
            Err(NoWay::Narrow)
        );
    }
}
