//! The source as text.

use std::collections::HashMap;
use std::fmt::Write as _;

use esm_core::Verified;
use esm_core::format::PULSE;
use esm_core::frames::dispatcher_of;
use esm_core::signature::{Direction, Port, Signature};
use esm_core::tables::{Region, StateKind, Task, TaskState};

use super::events::Listed;
use super::ports::{End, Path, Wiring};
use super::{NoSource, Reader};
use crate::inspect::links::{self, FrameRow, LinkRow};
use crate::inspect::names::Names;
use crate::inspect::reader::readable;

/// The capacity of the event queue where nothing is said.
const DEFAULT_QUEUE: usize = 32;

/// What a link has where nothing is said.
const DEFAULT_HEADER_BYTES: u32 = 4;
const DEFAULT_BITS: u32 = 10;

/// What was worked out for the containers and regions of a blob, by their numbers.
pub(super) struct Parts {
    pub(super) events: Vec<Vec<Listed>>,
    pub(super) flags_out: Vec<Vec<bool>>,
    pub(super) wirings: Vec<Wiring>,
    pub(super) transitions: Vec<Vec<usize>>,
    /// The containers in the order in which to write them.
    pub(super) containers: Vec<usize>,
}

/// What the task states of a task have in common.
#[derive(Clone, Default)]
struct Habits {
    /// The slot that most of them have; `Some(None)` is slot 0.
    slot: Option<Option<usize>>,
    /// The value that most of them have, by parameter.
    params: Vec<u32>,
}

/// Writes the source.
///
/// # Errors
/// If something in it has no form in the language.
pub(super) fn write(
    reader: &Reader<'_>,
    blob: &Verified<Vec<u8>>,
    parts: &Parts,
) -> Result<String, NoSource> {
    let mut writer = Writer {
        reader,
        parts,
        habits: habits(reader),
        text: String::new(),
    };
    writer.head(blob);
    writer.slots();
    writer.links();
    writer.tasks()?;
    for container in &parts.containers {
        writer.container(*container)?;
    }
    Ok(writer.text)
}

/// Slot and parameter values that most states of each task have; where several are as frequent, the
/// first.
fn habits(reader: &Reader<'_>) -> Vec<Habits> {
    let tables = &reader.tables;
    let mut slots = vec![Votes::default(); tables.tasks().len()];
    let mut params: Vec<Vec<Votes<u32>>> = tables
        .tasks()
        .map(|task| vec![Votes::default(); task.ports.params])
        .collect();
    for state in (0..tables.task_state_count()).filter_map(|index| tables.task_state(index)) {
        if let Some(votes) = slots.get_mut(state.task) {
            votes.cast(state.slot);
        }
        for (index, votes) in params.get_mut(state.task).into_iter().flatten().enumerate() {
            votes.cast(tables.param(state.first_param + index).unwrap_or(0));
        }
    }
    let of_task = |(slot, params): (Votes<Option<usize>>, Vec<Votes<u32>>)| Habits {
        slot: slot.winner(),
        params: params.into_iter().filter_map(Votes::winner).collect(),
    };
    slots.into_iter().zip(params).map(of_task).collect()
}

/// Counts how often a value comes.
#[derive(Clone)]
struct Votes<V> {
    places: HashMap<V, usize>,
    /// Values with their counts, in the order of their first coming.
    counts: Vec<(V, usize)>,
}

impl<V> Default for Votes<V> {
    fn default() -> Self {
        Self {
            places: HashMap::new(),
            counts: Vec::new(),
        }
    }
}

impl<V: Copy + Eq + std::hash::Hash> Votes<V> {
    fn cast(&mut self, value: V) {
        let next = self.counts.len();
        let place = *self.places.entry(value).or_insert(next);
        match self.counts.get_mut(place) {
            Some((_, count)) => *count += 1,
            None => self.counts.push((value, 1)),
        }
    }

    fn winner(self) -> Option<V> {
        let mut best: Option<(V, usize)> = None;
        for (value, count) in self.counts {
            if best.is_none_or(|(_, most)| count > most) {
                best = Some((value, count));
            }
        }
        best.map(|(value, _)| value)
    }
}

struct Writer<'w, 't> {
    reader: &'w Reader<'t>,
    parts: &'w Parts,
    habits: Vec<Habits>,
    text: String,
}

impl Writer<'_, '_> {
    fn line(&mut self, line: &str) {
        self.text.push_str(line);
        self.text.push('\n');
    }

    fn head(&mut self, blob: &Verified<Vec<u8>>) {
        let machine = Names::get(&self.reader.names.containers, 0);
        let (hash, bytes) = (blob.hash(), blob.bytes().len());
        let head = format!(
            "// Mission {machine}, read back from the blob {hash:08x} of {bytes} bytes, to which it compiles again."
        );
        self.line(&head);
        self.line("// A blob keeps no comments, no execution times, no ranges of parameters, and no names of containers' data ports.");
        if !self.reader.names.are_original {
            self.line("// Its names were left out, and so they are to be when it is compiled again; all but those of tasks are made up.");
        }
        self.line("");
    }

    fn slots(&mut self) {
        let tables = self.reader.tables;
        let interpreter = self.reader.slot_number(Some(tables.interpreter_slot()));
        self.line(&format!("interpreter slot {interpreter};"));
        if tables.queue_capacity() != DEFAULT_QUEUE {
            self.line(&format!("queue {};", tables.queue_capacity()));
        }
        for slot in tables.slots() {
            self.line(&format!(
                "slot {} period {} duration {};",
                slot.number,
                time(slot.period_us),
                time(slot.duration_us)
            ));
        }
    }

    fn links(&mut self) {
        for link in links::rows(&self.reader.tables) {
            self.line("");
            self.line(&link_line(&link));
            for frame in &link.frames {
                self.line(&frame_line(frame, &link.link));
            }
        }
    }

    fn tasks(&mut self) -> Result<(), NoSource> {
        let tables = self.reader.tables;
        let of_files = |task: &(usize, Task<'_>)| dispatcher_of(&tables, task.0).is_none();
        for (index, task) in tables.tasks().enumerate().filter(of_files) {
            let habits = self.habits.get(index).cloned().unwrap_or_default();
            let mut head = format!("\ntask {}", readable(task.signature.name()));
            if let Some(slot) = habits.slot {
                let _ = write!(head, " slot {}", self.reader.slot_number(slot));
            }
            if let Some(group) = task.exclusive {
                let group = Names::get(&self.reader.names.groups, usize::from(group));
                let _ = write!(head, " exclusive {group}");
            }
            self.line(&format!("{head} {{"));
            let mut params = habits.params.into_iter();
            for port in task.signature.ports() {
                let line = match port {
                    Port::Data {
                        direction,
                        name,
                        type_name,
                        optional,
                        within_us,
                    } => format!(
                        "{} data {}: {}{}{};",
                        direction_word(direction),
                        readable(name),
                        readable(type_name),
                        if optional { " optional" } else { "" },
                        match within_us {
                            0 => String::new(),
                            _ => format!(" within {}", time(within_us)),
                        }
                    ),
                    Port::Flag { direction, name } => {
                        format!("{} flag {};", direction_word(direction), readable(name))
                    }
                    Port::Param { name, type_name } => {
                        let default = match params.next() {
                            Some(bits) => {
                                let value =
                                    literal(type_name, bits).ok_or_else(|| NoSource::Value {
                                        state: readable(task.signature.name()),
                                        param: readable(name),
                                        bits,
                                    })?;
                                format!(" = {value}")
                            }
                            None => String::new(),
                        };
                        format!(
                            "param {}: {}{default};",
                            readable(name),
                            readable(type_name)
                        )
                    }
                };
                self.line(&format!("    {line}"));
            }
            self.line("}");
        }
        Ok(())
    }

    fn container(&mut self, index: usize) -> Result<(), NoSource> {
        let Some(container) = self.reader.tables.container(index) else {
            return Ok(());
        };
        let parts = self.parts;
        let word = if index == 0 { "machine" } else { "container" };
        let name = Names::get(&self.reader.names.containers, index);
        self.line(&format!("\n{word} {name} {{"));
        self.events(parts.events.get(index).map_or(&[], Vec::as_slice));
        let flags = self.reader.names.flags.get(index).into_iter().flatten();
        let flags_out = parts.flags_out.get(index).into_iter().flatten();
        for (flag, is_out) in flags.zip(flags_out) {
            let direction = if *is_out { "out" } else { "in" };
            self.line(&format!("    {direction} flag {flag};"));
        }
        let wiring = parts.wirings.get(index);
        for port in wiring.into_iter().flat_map(|wiring| &wiring.ports) {
            let direction = if port.is_out { "out" } else { "in" };
            let optional = if port.is_optional { " optional" } else { "" };
            self.line(&format!(
                "    {direction} data {}: {}{optional};",
                port.name, port.type_name
            ));
        }
        let mut is_first = self.text.ends_with("{\n");
        for (number, region) in self.reader.regions_of(index, &container) {
            if !std::mem::replace(&mut is_first, false) {
                self.line("");
            }
            self.region(number, region)?;
        }
        if let Some(wiring) = wiring
            && !wiring.paths.is_empty()
        {
            self.line("");
            self.paths(index, wiring);
        }
        self.line("}");
        Ok(())
    }

    /// Writes the lists of events: neighbours that are local share a line.
    fn events(&mut self, list: &[Listed]) {
        let is_local = |listed: &Listed| !listed.is_in && !listed.is_out;
        let names = &self.reader.names.events;
        for neighbours in list.chunk_by(|a, b| is_local(a) && is_local(b)) {
            let all: Vec<_> = neighbours
                .iter()
                .map(|listed| Names::get(names, listed.event))
                .collect();
            if neighbours.iter().all(is_local) {
                self.line(&format!("    event {};", all.join(", ")));
                continue;
            }
            for (listed, name) in neighbours.iter().zip(all) {
                if listed.is_in {
                    self.line(&format!("    in event {name};"));
                }
                if listed.is_out {
                    self.line(&format!("    out event {name};"));
                }
            }
        }
    }

    fn region(&mut self, number: usize, region: Region) -> Result<(), NoSource> {
        let name = Names::get(&self.reader.names.regions, number);
        self.line(&format!("    region {name} {{"));
        let mut has_states = false;
        for state in self.reader.states_of_region(region.first_state) {
            if let Some(line) = self.state(state)? {
                self.line(&format!("        {line};"));
                has_states = true;
            }
        }
        let parts = self.parts;
        let transitions = parts.transitions.get(number).map_or(&[][..], Vec::as_slice);
        if has_states && !transitions.is_empty() {
            self.line("");
        }
        for transition in transitions {
            let line = self.transition(*transition)?;
            self.line(&format!("        {line};"));
        }
        self.line("    }");
        Ok(())
    }

    /// A state without its semicolon; nothing for pseudo-states.
    fn state(&self, index: usize) -> Result<Option<String>, NoSource> {
        let tables = self.reader.tables;
        let Some(state) = tables.state(index) else {
            return Ok(None);
        };
        let name = Names::get(&self.reader.names.states, index);
        let mut line = match state.kind {
            StateKind::Initial | StateKind::Final => return Ok(None),
            StateKind::Simple => format!("state {name}"),
            StateKind::Super { .. } => {
                let container = self.reader.container_inside(index).unwrap_or(0);
                let container = Names::get(&self.reader.names.containers, container);
                format!("super {name}: {container}")
            }
            StateKind::Task { .. } => {
                let task_state = self.reader.task_state(index);
                let Some((task_state, task)) =
                    task_state.and_then(|state| Some((state, tables.task(state.task)?)))
                else {
                    return Ok(None);
                };
                let mut line = format!("task {name}: {}", readable(task.signature.name()));
                let habits = self.habits.get(task_state.task);
                let usual = habits.and_then(|habits| habits.slot);
                if usual != Some(task_state.slot)
                    || dispatcher_of(&tables, task_state.task).is_some()
                {
                    let _ = write!(line, " slot {}", self.reader.slot_number(task_state.slot));
                }
                line
            }
        };
        if let Some(timeout_us) = state.timeout_us {
            let _ = write!(line, " timeout {}", time(timeout_us));
        }
        if let Some(task_state) = self.reader.task_state(index)
            && let Some(task) = tables.task(task_state.task)
        {
            let values = self.values(name, task_state, task.signature)?;
            if !values.is_empty() {
                let _ = write!(line, " with {{ {} }}", values.join(", "));
            }
        }
        Ok(Some(line))
    }

    /// The parameters that a task state gives another value than most.
    fn values(
        &self,
        state: &str,
        task_state: TaskState,
        signature: Signature<'_>,
    ) -> Result<Vec<String>, NoSource> {
        let habits = self.habits.get(task_state.task);
        let usual = habits.map_or(&[][..], |habits| &habits.params);
        let params = signature.ports().filter_map(|port| match port {
            Port::Param { name, type_name } => Some((name, type_name)),
            _ => None,
        });
        let mut values = Vec::new();
        for (index, (name, type_name)) in params.enumerate() {
            let bits = self
                .reader
                .tables
                .param(task_state.first_param + index)
                .unwrap_or(0);
            if usual.get(index) == Some(&bits) {
                continue;
            }
            let value = literal(type_name, bits).ok_or_else(|| NoSource::Value {
                state: state.to_owned(),
                param: readable(name),
                bits,
            })?;
            values.push(format!("{} = {value}", readable(name)));
        }
        Ok(values)
    }

    /// A transition without its semicolon.
    fn transition(&self, index: usize) -> Result<String, NoSource> {
        let tables = self.reader.tables;
        let from = tables.source_of_transition(index);
        let (Some(transition), Some(source)) = (tables.transition(index), tables.state(from))
        else {
            return Ok(String::new());
        };
        let names = &self.reader.names;
        let mut line = format!(
            "{} -> {}",
            Names::get(&names.states, from),
            Names::get(&names.states, transition.target)
        );
        let guard = self.reader.guard_text(from, &source, index)?;
        let actions = self.reader.actions(from, index).unwrap_or_default();
        let on_pulse = transition.event == PULSE;
        match (on_pulse, guard) {
            (true, Some(guard)) if guard == "exit" => line.push_str(" on *"),
            (true, None) if source.kind == StateKind::Initial => {}
            (_, guard) => {
                let event = Names::get(&names.events, usize::from(transition.event));
                let _ = write!(line, " on {event}");
                if let Some(guard) = guard {
                    let _ = write!(line, " [{guard}]");
                }
            }
        }
        if !actions.is_empty() {
            let _ = write!(line, " / {}", actions.join(", "));
        }
        Ok(line)
    }

    fn paths(&mut self, container: usize, wiring: &Wiring) {
        let mut namesakes: HashMap<&str, usize> = HashMap::new();
        let reader = self.reader;
        for state in reader.states_of(container) {
            *namesakes
                .entry(Names::get(&reader.names.states, state))
                .or_default() += 1;
        }
        let end = |end: &End| match end {
            End::Own(port) => wiring
                .ports
                .get(*port)
                .map_or("", |port| &port.name)
                .to_owned(),
            End::State { state, port } => {
                let name = Names::get(&reader.names.states, *state);
                if namesakes.get(name) == Some(&1) {
                    return format!("{name}.{port}");
                }
                let region = reader.tables.region_of_state(*state);
                format!(
                    "{}.{name}.{port}",
                    Names::get(&reader.names.regions, region)
                )
            }
        };
        let side = |ends: &[End]| ends.iter().map(end).collect::<Vec<_>>().join(", ");
        let lines: Vec<_> = wiring
            .paths
            .iter()
            .map(|Path { from, to }| format!("    path {} -> {};", side(from), side(to)))
            .collect();
        for line in lines {
            self.line(&line);
        }
    }
}

fn link_line(link: &LinkRow) -> String {
    let mut line = format!("link {} rate {} bps", link.link, link.rate_bps);
    if link.header_bytes != DEFAULT_HEADER_BYTES {
        let _ = write!(line, " header {} bytes", link.header_bytes);
    }
    if link.gap_us != 0 {
        let _ = write!(line, " gap {}", time(link.gap_us));
    }
    if link.bits != DEFAULT_BITS {
        let _ = write!(line, " bits {}", link.bits);
    }
    line + ";"
}

fn frame_line(frame: &FrameRow, link: &str) -> String {
    let FrameRow {
        frame: name,
        id,
        direction,
        payload_bytes,
        ..
    } = frame;
    let content = match &frame.type_name {
        Some(type_name) => format!(": {type_name}"),
        None => format!(" flags {}", frame.flags.join(", ")),
    };
    let period = time(frame.period_us);
    let late = match frame.late_us {
        Some(late_us) => format!(" late {}", time(late_us)),
        None => String::new(),
    };
    format!(
        "frame {name} {id} {direction} on {link}{content} payload {payload_bytes} bytes period {period}{late};"
    )
}

fn direction_word(direction: Direction) -> &'static str {
    match direction {
        Direction::In => "in",
        Direction::Out => "out",
        Direction::InOut => "inout",
    }
}

/// A time in the greatest unit that makes it a whole number.
fn time(us: u32) -> String {
    const US_PER_S: u32 = 1_000_000;
    const US_PER_MS: u32 = 1_000;
    if us > 0 && us.is_multiple_of(US_PER_S) {
        format!("{} s", us / US_PER_S)
    } else if us > 0 && us.is_multiple_of(US_PER_MS) {
        format!("{} ms", us / US_PER_MS)
    } else {
        format!("{us} us")
    }
}

/// The literal that stands for the bits of a value, if there is one. That of an `f32` is the
/// shortest that reads as the same bits.
fn literal(type_name: &[u8], bits: u32) -> Option<String> {
    match (type_name, bits) {
        (b"bool", 0) => Some("false".to_owned()),
        (b"bool", 1) => Some("true".to_owned()),
        (b"i32", _) => Some((bits as i32).to_string()),
        (b"u32", _) => Some(bits.to_string()),
        (b"f32", _) => {
            let value = f32::from_bits(bits);
            // `{:?}` keeps a point or an exponent, so that nobody takes it for a whole number.
            value.is_finite().then(|| format!("{value:?}"))
        }
        _ => None,
    }
}
