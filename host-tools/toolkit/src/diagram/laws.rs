//! What every diagram promises, as statements about its layout, and tests that hold many diagrams
//! to it.

use std::collections::{BTreeMap, BTreeSet};

use super::drawing::Drawing;
use super::face::Kind;
use super::grid::{Area, Spot};
use super::wires;
use super::{Options, draw, lay_out};
use crate::model::{Model, PathEnd, Source, StateKind, Target};
use crate::test_golden;

/// A column (true) or row of the raster.
type Track = (bool, i32);

/// A level or upright piece of a line, and whose it is.
#[derive(Clone, Copy, Debug)]
struct Piece {
    from: Spot,
    to: Spot,
    owner: usize,
}

impl Piece {
    fn is_upright(&self) -> bool {
        self.from[0] == self.to[0]
    }

    /// The piece as a flat rectangle.
    fn area(&self) -> Area {
        Area {
            left: self.from[0].min(self.to[0]),
            right: self.from[0].max(self.to[0]),
            top: self.from[1].min(self.to[1]),
            bottom: self.from[1].max(self.to[1]),
        }
    }
}

fn touch(one: &Area, other: &Area) -> bool {
    one.left <= other.right
        && other.left <= one.right
        && one.top <= other.bottom
        && other.top <= one.bottom
}

/// Whether something lies inside a rectangle, its edges excluded.
fn enters(line: &Area, area: &Area) -> bool {
    line.left < area.right
        && area.left < line.right
        && line.top < area.bottom
        && area.top < line.bottom
        || line.left == line.right
            && area.left < line.left
            && line.left < area.right
            && line.top < area.bottom
            && area.top < line.bottom
        || line.top == line.bottom
            && area.top < line.top
            && line.top < area.bottom
            && line.left < area.right
            && area.left < line.right
}

fn is_inside(inner: &Area, outer: &Area) -> bool {
    outer.left < inner.left
        && inner.right < outer.right
        && outer.top < inner.top
        && inner.bottom < outer.bottom
}

/// Pieces of a line through corners.
fn pieces_of(line: &[Spot], owner: usize) -> impl Iterator<Item = Piece> {
    line.array_windows().map(move |[from, to]| Piece {
        from: *from,
        to: *to,
        owner,
    })
}

/// Everything that is wrong with a layout.
fn violations(drawing: &Drawing) -> Vec<String> {
    let mut found = Vec::new();
    boxes_stand_apart(drawing, &mut found);
    words_stand_apart(drawing, &mut found);
    lines_keep_clear(drawing, &mut found);
    lines_lead_where_they_say(drawing, &mut found);
    found
}

fn boxes_stand_apart(drawing: &Drawing, found: &mut Vec<String>) {
    let sheet = Area::new([0, 0], drawing.size);
    let mut children: BTreeMap<Option<usize>, Vec<usize>> = BTreeMap::new();
    for (index, placed) in drawing.boxes.iter().enumerate() {
        let outer = placed
            .parent
            .map_or(sheet, |parent| drawing.boxes[parent].area);
        if !is_inside(&placed.area, &outer) {
            found.push(format!("`{}` leaves its parent", placed.name));
        }
        if let Some(parent) = placed.parent {
            let heading = drawing.boxes[parent].heading();
            if touch(&placed.area, &heading) {
                found.push(format!(
                    "`{}` stands in the heading of its parent",
                    placed.name
                ));
            }
        }
        children.entry(placed.parent).or_default().push(index);
    }
    for siblings in children.values() {
        for (place, one) in siblings.iter().enumerate() {
            for other in &siblings[place + 1..] {
                if touch(&drawing.boxes[*one].area, &drawing.boxes[*other].area) {
                    found.push(format!(
                        "`{}` and `{}` overlap",
                        drawing.boxes[*one].name, drawing.boxes[*other].name
                    ));
                }
            }
        }
    }
}

fn is_ancestor(drawing: &Drawing, ancestor: usize, of: usize) -> bool {
    let mut at = Some(of);
    while let Some(index) = at {
        if index == ancestor {
            return true;
        }
        at = drawing.boxes[index].parent;
    }
    false
}

/// All words on the sheet outside of headings: where they stand, and the box around them.
fn words(drawing: &Drawing) -> Vec<(Area, usize, String)> {
    let mut words = Vec::new();
    for arrow in &drawing.transitions {
        if let (Some((area, lines)), Some(parent)) =
            (&arrow.label, drawing.boxes[arrow.from].parent)
        {
            words.push((*area, parent, format!("label `{}`", lines[0])));
        }
    }
    for region in &drawing.region_names {
        words.push((
            region.area,
            region.parent,
            format!("region `{}`", region.name),
        ));
    }
    for port in &drawing.ports {
        words.push((port.name_area, port.owner, format!("port `{}`", port.name)));
    }
    words
}

fn words_stand_apart(drawing: &Drawing, found: &mut Vec<String>) {
    let words = words(drawing);
    for (index, (area, parent, name)) in words.iter().enumerate() {
        if !is_inside(area, &drawing.boxes[*parent].area) {
            found.push(format!("{name} leaves its box"));
        }
        for (place, placed) in drawing.boxes.iter().enumerate() {
            if !is_ancestor(drawing, place, *parent) && touch(area, &placed.area) {
                found.push(format!("{name} overlaps the box `{}`", placed.name));
            }
        }
        for (other, _, other_name) in &words[index + 1..] {
            // Names of ports stand row by row without a gap.
            let overlap = area.left < other.right
                && other.left < area.right
                && area.top < other.bottom
                && other.top < area.bottom;
            if overlap {
                found.push(format!("{name} overlaps {other_name}"));
            }
        }
        for divider in &drawing.dividers {
            for piece in pieces_of(&divider.ends, 0) {
                if touch(area, &piece.area()) {
                    found.push(format!("{name} overlaps a border of regions"));
                }
            }
        }
    }
}

/// All lines on the sheet; transitions first, then nets, then all borders of regions as one.
fn pieces(drawing: &Drawing) -> Vec<Piece> {
    let mut pieces = Vec::new();
    for (owner, arrow) in drawing.transitions.iter().enumerate() {
        pieces.extend(pieces_of(&arrow.route, owner));
    }
    let nets = drawing.transitions.len();
    for (net, placed) in drawing.nets.iter().enumerate() {
        for line in &placed.lines {
            pieces.extend(pieces_of(line, nets + net));
        }
    }
    for divider in &drawing.dividers {
        pieces.extend(pieces_of(&divider.ends, nets + drawing.nets.len()));
    }
    pieces
}

fn lines_keep_clear(drawing: &Drawing, found: &mut Vec<String>) {
    let pieces = pieces(drawing);
    let nets = drawing.transitions.len();
    let borders = nets + drawing.nets.len();
    let words = words(drawing);
    for piece in &pieces {
        if piece.from[0] != piece.to[0] && piece.from[1] != piece.to[1] {
            found.push(format!("{piece:?} is neither level nor upright"));
        }
        let area = piece.area();
        let (around, ends) = if piece.owner < nets {
            let arrow = &drawing.transitions[piece.owner];
            (drawing.boxes[arrow.from].parent, vec![arrow.from, arrow.to])
        } else if piece.owner < borders {
            (Some(drawing.nets[piece.owner - nets].parent), Vec::new())
        } else {
            continue;
        };
        for (place, placed) in drawing.boxes.iter().enumerate() {
            let is_around = around.is_some_and(|around| is_ancestor(drawing, place, around));
            let bad = if ends.contains(&place) {
                enters(&area, &placed.area)
            } else {
                touch(&area, &placed.area)
            };
            if !is_around && bad {
                found.push(format!("{piece:?} runs through `{}`", placed.name));
            }
        }
        for (word, _, name) in &words {
            if touch(&area, word) {
                found.push(format!("{piece:?} runs through {name}"));
            }
        }
    }
    // Lines in one row or column, and corners on lines.
    let mut tracks: BTreeMap<Track, Vec<(i32, i32, usize)>> = BTreeMap::new();
    for piece in &pieces {
        let area = piece.area();
        let entry = if piece.is_upright() {
            ((true, area.left), (area.top, area.bottom, piece.owner))
        } else {
            ((false, area.top), (area.left, area.right, piece.owner))
        };
        tracks.entry(entry.0).or_default().push(entry.1);
    }
    for (track, lines) in &mut tracks {
        lines.sort_unstable();
        let mut reach: Option<(i32, usize)> = None;
        for (start, end, owner) in lines.iter() {
            if let Some((last, other)) = reach
                && (*start < last || *start == last && ![*owner, other].contains(&borders))
                && other != *owner
            {
                found.push(format!(
                    "lines {other} and {owner} share {track:?} at {start}"
                ));
            }
            if reach.is_none_or(|(last, _)| *end > last) {
                reach = Some((*end, *owner));
            }
        }
    }
    for piece in pieces.iter().filter(|piece| piece.owner < borders) {
        for [column, row] in [piece.from, piece.to] {
            for (track, at) in [((true, column), row), ((false, row), column)] {
                for (start, end, owner) in tracks.get(&track).into_iter().flatten() {
                    // A border of regions ends at the edge of its box, and on the other side a
                    // transition may begin.
                    let only_ends = *owner == borders && (*start == at || *end == at);
                    if *owner != piece.owner && !only_ends && (*start..=*end).contains(&at) {
                        found.push(format!("{piece:?} has a corner on line {owner}"));
                    }
                }
            }
        }
    }
}

fn lines_lead_where_they_say(drawing: &Drawing, found: &mut Vec<String>) {
    for arrow in &drawing.transitions {
        for (end, owner) in [
            (arrow.route.first(), arrow.from),
            (arrow.route.last(), arrow.to),
        ] {
            let area = drawing.boxes[owner].area;
            let is_on_edge = end.is_some_and(|[column, row]| {
                let inside = (area.left..=area.right).contains(column)
                    && (area.top..=area.bottom).contains(row);
                inside && (*row == area.top || *row == area.bottom || *column == area.right)
            });
            if !is_on_edge {
                found.push(format!(
                    "a transition misses `{}`",
                    drawing.boxes[owner].name
                ));
            }
        }
    }
    for (index, net) in drawing.nets.iter().enumerate() {
        if net.lines.is_empty() {
            continue;
        }
        // Points that can be reached from the first port along the net's lines.
        let pieces: Vec<Area> = net
            .lines
            .iter()
            .flat_map(|line| pieces_of(line, 0))
            .map(|piece| piece.area())
            .collect();
        let mut reached = vec![false; pieces.len()];
        let mut waiting: Vec<Area> = net
            .ends
            .first()
            .map(|(_, at)| Area::new(*at, [0, 0]))
            .into_iter()
            .collect();
        while let Some(area) = waiting.pop() {
            for (piece, reached) in pieces.iter().zip(&mut reached) {
                if !*reached && touch(piece, &area) {
                    *reached = true;
                    waiting.push(*piece);
                }
            }
        }
        for (port, at) in &net.ends {
            let at = Area::new(*at, [0, 0]);
            let is_joined = pieces
                .iter()
                .zip(&reached)
                .any(|(piece, reached)| *reached && touch(piece, &at));
            if !is_joined {
                found.push(format!(
                    "port `{}` is not on net {index}",
                    drawing.ports[*port].name
                ));
            }
        }
        if reached.contains(&false) {
            found.push(format!("a line of net {index} hangs loose"));
        }
    }
}

/// What must be drawn, one line each, worked out from the model alone.
#[derive(Default)]
struct Content {
    boxes: Vec<String>,
    transitions: Vec<String>,
    ports: Vec<String>,
    joined: Vec<String>,
}

impl Content {
    fn sorted(mut self) -> [Vec<String>; 4] {
        for list in [
            &mut self.boxes,
            &mut self.transitions,
            &mut self.ports,
            &mut self.joined,
        ] {
            list.sort_unstable();
        }
        [self.boxes, self.transitions, self.ports, self.joined]
    }

    fn of_model(model: &Model, container: usize, path: &str, content: &mut Content) {
        let body = &model.containers[container];
        let data = |state: &StateKind| match state {
            StateKind::Simple => Vec::new(),
            StateKind::Task { task, .. } => model.tasks[*task].data.clone(),
            StateKind::Super { container } => model.containers[*container].data.clone(),
        };
        for region in &body.regions {
            let initial = region
                .transitions
                .iter()
                .any(|one| one.source == Source::Initial);
            let last = region
                .transitions
                .iter()
                .any(|one| one.target == Target::Final);
            content
                .boxes
                .extend(initial.then(|| format!("{path}/initial")));
            content.boxes.extend(last.then(|| format!("{path}/final")));
            for state in &region.states {
                let path = format!("{path}/{}", state.name);
                content.boxes.push(path.clone());
                content.ports.extend(
                    data(&state.kind)
                        .iter()
                        .map(|port| format!("{path}.{}", port.name)),
                );
                if let StateKind::Super { container } = state.kind {
                    Content::of_model(model, container, &path, content);
                }
            }
            for transition in &region.transitions {
                let from = match transition.source {
                    Source::Initial => "initial",
                    Source::State(state) => &region.states[state].name,
                };
                let to = match transition.target {
                    Target::Final => "final",
                    Target::State(state) => &region.states[state].name,
                };
                content.transitions.push(format!("{path}/{from} -> {to}"));
            }
        }
        let end = |end: &PathEnd| match *end {
            PathEnd::Container { port } => format!("{path}.{}", body.data[port].name),
            PathEnd::State {
                region,
                state,
                port,
            } => {
                let state = &body.regions[region].states[state];
                format!("{path}/{}.{}", state.name, data(&state.kind)[port].name)
            }
        };
        for path in &body.paths {
            let ends: Vec<String> = path.from.iter().chain(&path.to).map(end).collect();
            content.joined.extend(
                ends.windows(2)
                    .map(|pair| format!("{} = {}", pair[0], pair[1])),
            );
        }
    }

    /// The same as far as it can be read off a drawing. Of `joined`, those are given that the
    /// drawing joins.
    fn of_drawing(drawing: &Drawing, joined: &[String]) -> Content {
        let mut content = Content::default();
        let name = |index: usize| {
            let placed = &drawing.boxes[index];
            match placed.kind {
                Kind::Initial => "initial".to_owned(),
                Kind::Final => "final".to_owned(),
                // The name of an open superstate is followed by its container's.
                _ => placed
                    .name
                    .to_string()
                    .split(' ')
                    .next()
                    .unwrap_or("")
                    .to_owned(),
            }
        };
        let mut paths: Vec<String> = Vec::new();
        for (index, placed) in drawing.boxes.iter().enumerate() {
            paths.push(placed.parent.map_or(String::new(), |parent| {
                format!("{}/{}", paths[parent], name(index))
            }));
            if placed.parent.is_some() {
                content.boxes.push(paths[index].clone());
            }
        }
        for arrow in &drawing.transitions {
            content
                .transitions
                .push(format!("{} -> {}", paths[arrow.from], name(arrow.to)));
        }
        let port_name = |port: usize| {
            let port = &drawing.ports[port];
            format!(
                "{}.{}",
                paths[port.owner],
                port.name.split(' ').next().unwrap_or("")
            )
        };
        content.ports = (0..drawing.ports.len()).map(port_name).collect();
        // For each port the nets that it is on, with the container of each: a superstate's port is
        // on one outside and on one inside.
        let mut nets: BTreeMap<String, Vec<(usize, usize)>> = BTreeMap::new();
        for (index, net) in drawing.nets.iter().enumerate() {
            for (port, _) in &net.ends {
                let of_port = nets.entry(port_name(*port)).or_default();
                of_port.push((net.parent, index));
            }
        }
        for pair in joined {
            let (one, other) = pair.split_once(" = ").unwrap();
            let of = |port: &str| nets.get(port).map_or(&[][..], Vec::as_slice);
            let is_joined = of(one).iter().any(|net| of(other).contains(net));
            content.joined.extend(is_joined.then(|| pair.clone()));
        }
        content
    }
}

fn model_of(name: &str, text: &str) -> Model {
    let checked = crate::lang::load_text(name, text);
    checked
        .model
        .clone()
        .unwrap_or_else(|| panic!("{}\n{text}", checked.render(false)))
}

fn mission(name: &str) -> Model {
    let path = format!("../../missions/{name}");
    let checked = crate::lang::load_from(&path, &crate::test_disk::Disk).unwrap();
    checked
        .model
        .clone()
        .unwrap_or_else(|| panic!("{}", checked.render(false)))
}

/// Holds a drawing of all of a machine to all laws, with data paths or without: leading them takes
/// most of the time.
fn assert_lawful(model: &Model, context: &str, data: bool) -> Drawing {
    let options = Options {
        data,
        ..Options::default()
    };
    let drawing = lay_out(model, &options).unwrap();
    let found = violations(&drawing);
    assert!(found.is_empty(), "{context}\n{}", found.join("\n"));
    let mut expected = Content::default();
    Content::of_model(model, model.machine.unwrap(), "", &mut expected);
    if !data {
        expected.ports.clear();
        expected.joined.clear();
    }
    let shown = Content::of_drawing(&drawing, &expected.joined);
    // The ports of the machine itself are none.
    assert_eq!(shown.sorted(), expected.sorted(), "{context}");
    drawing
}

#[test]
fn the_missions_are_drawn_by_the_laws_and_with_all_their_paths() {
    for name in ["patrol.esm", "follow_wall.esm"] {
        let drawing = assert_lawful(&mission(name), name, true);
        assert!(
            drawing.nets.iter().all(|net| !net.lines.is_empty()),
            "{name}"
        );
    }
}

/// Numbers that look random and are the same in every run.
struct Dice(u64);

impl Dice {
    fn below(&mut self, end: usize) -> usize {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) as usize % end.max(1)
    }

    fn chance(&mut self, percent: usize) -> bool {
        self.below(100) < percent
    }
}

/// A machine without errors, tangled at random: containers in containers, loops, parallel
/// transitions, long labels, ports and paths.
fn random_text(seed: u64) -> String {
    use std::fmt::Write;
    let mut dice = Dice(seed.wrapping_mul(77).wrapping_add(5));
    let mut text = "interpreter slot 1;\nslot 1 period 10 ms duration 1 ms;\nslot 2 period 10 ms duration 1 ms;\n\
        task Source slot 2 { out data a: T; out flag seen; }\n\
        task Filter slot 2 { in data a: T optional; out data b: T; out flag seen; out flag a_flag_with_a_long_name; in flag fast; }\n\
        task Sink slot 2 { in data a: T optional; in data b: T optional; out flag seen; in flag fast; }\n\
        task Both slot 0 { inout data a: T; out flag seen; }\n"
        .to_owned();
    let containers = dice.below(4);
    for index in 0..=containers {
        let is_machine = index == containers;
        if is_machine {
            text += "machine M {\n  event Go, Stop, A_rather_long_event;\n";
        } else {
            let _ = writeln!(
                text,
                "container C{index} {{\n  event Go, Stop, A_rather_long_event; in data a: T optional; out data b: T; out flag seen;"
            );
        }
        let mut readers = Vec::new();
        let mut writers = Vec::new();
        for region in 0..1 + dice.below(3) {
            let _ = writeln!(text, "  region r{region} {{");
            let mut states: Vec<(String, usize)> = Vec::new();
            for state in 0..1 + dice.below(7) {
                let name = format!(
                    "{}{region}{state}",
                    ["S", "State", "AStateWithALongName"][dice.below(3)]
                );
                let kind = dice.below(if index > 0 { 6 } else { 5 });
                let timeout = if dice.chance(20) {
                    " timeout 1500 ms"
                } else {
                    ""
                };
                let _ = match kind {
                    0 => writeln!(text, "    state {name}{timeout};"),
                    1 => writeln!(text, "    task {name}: Source{timeout};"),
                    2 => writeln!(text, "    task {name}: Filter{timeout};"),
                    3 => writeln!(text, "    task {name}: Sink slot 2{timeout};"),
                    4 => writeln!(text, "    task {name}: Both{timeout};"),
                    _ => writeln!(text, "    super {name}: C{}{timeout};", dice.below(index)),
                };
                let port = |port: &str| format!("r{region}.{name}.{port}");
                match kind {
                    1 => writers.push(port("a")),
                    2 => {
                        readers.push(port("a"));
                        writers.push(port("b"));
                    }
                    3 => readers.extend([port("a"), port("b")]),
                    4 => writers.push(port("a")),
                    5 => {
                        readers.push(port("a"));
                        writers.push(port("b"));
                    }
                    _ => {}
                }
                states.push((name, kind));
            }
            let _ = writeln!(text, "    initial -> {};", states[0].0);
            for _ in 0..dice.below(3 * states.len()) {
                let (from, kind) = &states[dice.below(states.len())];
                let (to, target) = &states[dice.below(states.len())];
                let to = if dice.chance(10) {
                    "final"
                } else {
                    to.as_str()
                };
                let event = ["", " on Go", " on Stop", " on A_rather_long_event"][dice.below(4)];
                let guard = match (kind, dice.below(4)) {
                    (0, 1) => " [timeout]",
                    (1..=5, 1) => " [.seen]",
                    (1..=5, 2) => " [exit and not (.seen or busy) and timeout]",
                    (2, 3) => " [.a_flag_with_a_long_name or .seen and not exit]",
                    _ => "",
                };
                let action = match (target, to, dice.below(3)) {
                    (2 | 3, to, 0) if to != "final" => " / set .fast, send Stop",
                    (_, _, 1) => " / send A_rather_long_event, send Go",
                    _ => "",
                };
                let _ = writeln!(text, "    {from} -> {to}{event}{guard}{action};");
            }
            text += "  }\n";
        }
        if !is_machine {
            readers.push("b".to_owned());
        }
        // Every reader gets a writer, so that no required input stays open; with several nets.
        let nets = 1 + dice.below(3);
        let outer = if is_machine {
            None
        } else {
            Some("a".to_owned())
        };
        for net in 0..nets {
            let pick = |list: &[String]| -> Vec<String> {
                list.iter()
                    .enumerate()
                    .filter(|(at, _)| at % nets == net)
                    .map(|(_, name)| name.clone())
                    .collect()
            };
            let (mut from, to) = (pick(&writers), pick(&readers));
            if net == 0 {
                from.extend(outer.clone());
            }
            if !from.is_empty() && !to.is_empty() {
                let _ = writeln!(text, "  path {} -> {};", from.join(", "), to.join(", "));
            }
        }
        text += "}\n";
    }
    text
}

#[test]
fn random_machines_are_drawn_by_the_laws() {
    let mut with_lines = 0;
    let mut skipped = 0;
    for seed in 0..60 {
        let text = random_text(seed);
        let checked = crate::lang::load_text("random.esm", &text);
        // A net without a writer, now and then: that is not for the pictures to judge.
        let Some(model) = &checked.model else {
            skipped += 1;
            continue;
        };
        let drawing = assert_lawful(model, &format!("seed {seed}\n{text}"), seed % 6 == 0);
        with_lines += usize::from(drawing.nets.iter().any(|net| !net.lines.is_empty()));
    }
    assert!(
        skipped < 30 && with_lines > 3,
        "{skipped} skipped, {with_lines} with lines"
    );
}

#[test]
fn equal_input_gives_equal_bytes() {
    let model = mission("patrol.esm");
    let first = draw(&model, &Options::default()).unwrap();
    let second = draw(&model.clone(), &Options::default()).unwrap();
    assert_eq!(first.to_svg(), second.to_svg());
}

#[test]
fn every_law_bites() {
    type Damage = fn(&mut Drawing);
    let cases: [(&str, Damage); 9] = [
        ("overlap", |drawing| {
            let area = drawing.boxes[1].area;
            drawing.boxes[2].area = area.moved([1, 1]);
        }),
        ("leaves its parent", |drawing| {
            drawing.boxes[3].area.right = drawing.size[0]
        }),
        ("overlaps the box", |drawing| {
            let area = drawing.boxes[2].area;
            drawing
                .transitions
                .last_mut()
                .unwrap()
                .label
                .as_mut()
                .unwrap()
                .0 = area;
        }),
        ("overlaps a border", |drawing| {
            let at = drawing.dividers[0].ends[0];
            drawing.region_names[0].area = Area::new(at, [5, 2]);
        }),
        ("runs through `Corner`", |drawing| {
            let corner = drawing
                .boxes
                .iter()
                .find(|placed| placed.name.to_string() == "Corner")
                .unwrap()
                .area;
            drawing.transitions[0].route[0] = [corner.left + 1, corner.top + 1];
            drawing.transitions[0].route[1] = [corner.left + 1, corner.bottom + 9];
        }),
        ("share", |drawing| {
            let line = drawing.nets[0].lines[0].clone();
            drawing.nets[1].lines.push(line);
        }),
        ("misses", |drawing| {
            drawing.transitions[2].route.pop().map_or((), drop)
        }),
        ("is not on net", |drawing| {
            drawing.nets[0].lines.pop();
        }),
        ("hangs loose", |drawing| {
            drawing.nets[0].lines.push(vec![[1, 1], [2, 1]])
        }),
    ];
    let whole = lay_out(&mission("follow_wall.esm"), &Options::default()).unwrap();
    for (law, damage) in cases {
        let mut drawing = whole.clone();
        damage(&mut drawing);
        let found = violations(&drawing).join("\n");
        assert!(found.contains(law), "{law}: {found}");
    }
}

#[test]
fn wide_and_deep_machines_are_told_to_be_so() {
    let head = "interpreter slot 1; slot 1 period 10 ms duration 1 ms;\n";
    let nested = |levels: usize, each: usize| {
        let mut text = format!("{head}container C0 {{ region r {{ state S; initial -> S; }} }}\n");
        for level in 1..=levels {
            text += &format!("container C{level} {{ region r {{");
            for index in 0..each {
                text += &format!(" super S{index}: C{};", level - 1);
            }
            text += " initial -> S0; } }\n";
        }
        text + &format!("machine M {{ region r {{ super S: C{levels}; initial -> S; }} }}")
    };
    let wide = model_of("wide.esm", &nested(40, 2));
    let error = draw(&wide, &Options::default()).unwrap_err().to_string();
    assert!(
        error.contains("--depth") && error.contains("--container"),
        "{error}"
    );
    let deep = model_of("deep.esm", &nested(100, 1));
    let error = draw(&deep, &Options::default()).unwrap_err().to_string();
    assert!(error.contains("101 levels"), "{error}");
    let shallow = Options {
        depth: Some(3),
        ..Options::default()
    };
    assert_eq!(
        lay_out(&wide, &shallow).unwrap().boxes.len(),
        3 + 3 + 6 + 12
    );
    assert!(
        draw(
            &model_of("deepest.esm", &nested(63, 1)),
            &Options::default()
        )
        .is_ok()
    );
}

#[test]
fn superstates_are_folded_and_opened_by_themselves() {
    let model = mission("patrol.esm");
    let all = Options::default();
    let whole = lay_out(&model, &all).unwrap();
    let open = |drawing: &Drawing| -> BTreeSet<String> {
        let boxes = drawing
            .boxes
            .iter()
            .filter(|it| it.kind == Kind::Super && it.is_open);
        boxes.map(|it| it.path.clone()).collect()
    };
    let paths = open(&whole);
    assert!(paths.len() > 2, "{paths:?}");
    for path in &paths {
        let one = Options {
            otherwise: BTreeSet::from([path.clone()]),
            ..all.clone()
        };
        let drawing = lay_out(&model, &one).unwrap();
        assert_eq!(violations(&drawing), Vec::<String>::new(), "{path}");
        let below = format!("{path}/");
        let expected = paths
            .iter()
            .filter(|it| *it != path && !it.starts_with(&below));
        assert_eq!(open(&drawing), expected.cloned().collect(), "{path}");
        let folded = drawing.boxes.iter().find(|it| it.path == *path).unwrap();
        assert!(!folded.is_open);
    }
    // Opened one by one, they make the same picture as all at once.
    let opened = Options {
        depth: Some(0),
        otherwise: paths,
        ..all.clone()
    };
    let [opened, whole] = [&opened, &all].map(|options| draw(&model, options).unwrap().to_svg());
    assert!(opened == whole);
    // What is not there changes nothing, and what is too deep is refused.
    let nothing = Options {
        otherwise: BTreeSet::from(["no/Such".to_owned()]),
        ..all.clone()
    };
    assert!(draw(&model, &nothing).unwrap().to_svg() == whole);
    let deep = Options {
        otherwise: BTreeSet::from(["r/S/".repeat(70)]),
        ..all
    };
    let error = draw(&model, &deep).unwrap_err().to_string();
    assert!(error.contains("70 levels"), "{error}");
}

/// Slots, and a machine of one region with these lines.
fn one_region(declarations: &str, lines: &str) -> Model {
    let text = format!(
        "interpreter slot 1; slot 1 period 10 ms duration 1 ms; slot 2 period 10 ms duration 1 ms;\n\
         {declarations}\nmachine M {{ event E; region r {{ {lines} }} }}"
    );
    model_of("region.esm", &text)
}

/// `state S0; … initial -> S0;`
fn states(count: usize) -> String {
    let states: Vec<String> = (0..count).map(|index| format!("state S{index};")).collect();
    format!("{} initial -> S0;", states.join(" "))
}

#[test]
fn a_region_that_nobody_could_follow_is_not_drawn() {
    // Everything to everything: every pair of ranks is joined.
    let each = |from: usize| (0..70).map(move |to| (from, to));
    let lines: Vec<String> = (0..70)
        .flat_map(each)
        .filter(|(from, to)| from != to)
        .map(|(from, to)| format!("S{from} -> S{to} on E;"))
        .collect();
    let model = one_region("", &format!("{} {}", states(70), lines.join(" ")));
    let error = draw(&model, &Options::default()).unwrap_err();
    assert_eq!(error, super::DrawError::TooTangled);
    assert!(
        error.to_string().contains("100000 places") && error.to_string().contains("--container"),
        "{error}"
    );
}

#[test]
fn more_states_or_transitions_than_the_limit_are_counted_and_refused() {
    let draw = |lines: String| draw(&one_region("", &lines), &Options::default()).unwrap_err();
    assert_eq!(
        draw(states(2_001)),
        super::DrawError::TooLarge {
            states: 2_001,
            transitions: 1
        }
    );
    let loops = "S0 -> S0 on E; ".repeat(6_000);
    assert_eq!(
        draw(format!("{} {loops}", states(1))),
        super::DrawError::TooLarge {
            states: 1,
            transitions: 6_001
        }
    );
}

#[test]
fn a_container_with_too_many_ports_on_paths_carries_the_numbers_of_its_nets() {
    let mut declarations = "task T slot 2 { out data q: D; in data p: D optional; }".to_owned();
    let mut lines = String::new();
    let mut paths = String::new();
    for index in 0..81 {
        lines += &format!("task A{index}: T; ");
        paths += &format!("path r.A{index}.q -> r.A{}.p; ", (index + 1) % 81);
    }
    declarations += &format!(" container Many {{ region r {{ {lines} initial -> A0; }} {paths} }}");
    let model = one_region(&declarations, "super S: Many; initial -> S;");
    let drawing = lay_out(&model, &Options::default()).unwrap();
    const { assert!(2 * 81 > wires::MAX_ENDS) };
    assert_eq!(drawing.nets.len(), 81);
    assert!(drawing.nets.iter().all(|net| net.lines.is_empty()));
    // Both ends of a net, and nobody else, have its number.
    for (number, net) in (1..).zip(&drawing.nets) {
        let named: Vec<&str> = net
            .ends
            .iter()
            .map(|(port, _)| drawing.ports[*port].name.as_str())
            .collect();
        assert_eq!(named, [format!("q #{number}"), format!("p #{number}")]);
    }
    let found = violations(&drawing);
    assert!(found.is_empty(), "{}", found.join("\n"));
}

#[test]
fn what_is_too_long_to_be_read_is_cut_and_what_has_many_parts_goes_over() {
    let long = "x".repeat(1_000);
    let flags: Vec<String> = (0..8).map(|index| format!("out flag f{index};")).collect();
    let terms: Vec<String> = (0..1_000).map(|index| format!(".f{}", index % 8)).collect();
    let sends = vec!["send E"; 500].join(", ");
    let model = one_region(
        &format!("task T slot 2 {{ {} }}", flags.join(" ")),
        &format!(
            "task {long}: T; state B; initial -> {long}; {long} -> B on E [exit and ({})] / {sends}; B -> {long} on E [timeout] / send E;",
            terms.join(" or ")
        ),
    );
    let drawing = lay_out(&model, &Options::default()).unwrap();
    let found = violations(&drawing);
    assert!(found.is_empty(), "{}", found.join("\n"));
    let named = drawing
        .boxes
        .iter()
        .find(|placed| placed.name.to_string().starts_with('x'))
        .unwrap();
    assert_eq!(
        named.name.to_string().chars().count(),
        super::label::MAX_NAME
    );
    let labels = || {
        drawing
            .transitions
            .iter()
            .filter_map(|one| one.label.as_ref())
    };
    let longest = labels().map(|(_, lines)| lines.len()).max().unwrap();
    assert_eq!(longest, super::label::MAX_LINES);
    let (area, lines) = labels().find(|(_, lines)| lines.len() == longest).unwrap();
    assert!(
        lines.last().unwrap().to_string().ends_with('…'),
        "{lines:?}"
    );
    assert!(area.width() < 25, "{area:?}");
}

#[test]
fn headings_say_which_flags_and_events_a_container_has() {
    let model = model_of(
        "headings.esm",
        "interpreter slot 1; slot 1 period 10 ms duration 1 ms;\n\
         container C { in flag left; out flag found; in flag fast; in event Halt; in event Resume; event Own;\n\
           region r { state A; initial -> A; A -> A on Halt [^left and ^fast] / set ^found, send Own; A -> A on Own; A -> A on Resume; } }\n\
         machine M { event Halt, Resume; region r { super S: C; state T; initial -> T; T -> S / set .left, set .fast; S -> T [.found] / send Halt; } }",
    );
    let drawing = lay_out(&model, &Options::default()).unwrap();
    let heading = |name: &str| {
        let placed = drawing
            .boxes
            .iter()
            .find(|placed| placed.name.to_string() == name);
        let lines = placed.unwrap().details.iter().map(ToString::to_string);
        lines.collect::<Vec<_>>()
    };
    assert_eq!(heading("machine M"), ["event Halt, Resume"]);
    assert_eq!(
        heading("S : C"),
        [
            "in flag left, fast · out flag found · event Own",
            "   · in event Halt, Resume"
        ]
    );
}

#[test]
fn corners_of_a_straight_line_are_its_ends() {
    assert_eq!(
        wires::corners([[0, 0], [0, 1], [0, 2], [3, 2], [4, 2]]),
        [[0, 0], [0, 2], [4, 2]]
    );
}

fn assert_golden(path: &str, model: &Model, options: &Options) {
    let found = draw(model, options).unwrap().to_svg();
    test_golden::assert_golden(path, found.as_bytes());
}

#[test]
fn the_missions_look_as_they_did() {
    for name in ["patrol", "follow_wall"] {
        assert_golden(
            &format!("src/diagram/golden/{name}.svg"),
            &mission(&format!("{name}.esm")),
            &Options::default(),
        );
    }
}

#[test]
fn the_pictures_of_the_book_are_those_that_the_command_draws() {
    let roaming = Options {
        container: Some("Roaming".into()),
        depth: Some(0),
        ..Options::default()
    };
    assert_golden(
        "../../docs/src/img/roaming.svg",
        &mission("patrol.esm"),
        &roaming,
    );
    let page = include_str!("../../../../docs/src/diagrams.md");
    let (_, rest) = page.split_once("```esm\n").unwrap();
    let (text, _) = rest.split_once("```").unwrap();
    assert_golden(
        "../../docs/src/img/symbols.svg",
        &model_of("symbols.esm", text),
        &Options::default(),
    );
}
