//! Traces: what a machine did, as JSON Lines.
//!
//! A [`TraceWriter`] is told what an interpreter did, in the indices of the blob, and writes lines
//! in the names of the source. Whether the interpreter runs in this process or on a robot that
//! streams its records makes no difference: there is one writer, so that traces can be compared
//! byte by byte.
//!
//! ```text
//! {"kind":"transition","step":3,"micro":0,"t_us":30000,"event":"pulse","from":"motion/Cruise","to":"motion/Escape","sent":["Obstacle"],"set":["motion/Escape.fast"],"cleared":[]}
//! {"kind":"step","step":3,"t_us":30000,"micro_steps":2,"active":["motion/Escape","motion/Escape/turn/initial","safety/Watch"],"enabled":[]}
//! {"kind":"fault","step":9,"t_us":90000,"code":"event-queue-overflow"}
//! ```

pub mod directory;
pub mod records;

use std::borrow::BorrowMut;
use std::collections::HashMap;
use std::io::{self, Write};
use std::sync::Arc;

use directory::{Directory, StateId};

/// A macro step: its number and its time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Step {
    /// Number of the macro step, from 0.
    pub step: u64,
    /// Nominal start, in microseconds from the first macro step.
    pub t_us: u64,
}

/// What is current between two macro steps, in the indices of the blob.
pub trait Snapshot {
    /// The index in the blob of a region instance's current local state.
    fn current(&self, region: usize) -> usize;
    /// Whether a task instance has its enable flag set.
    fn is_enabled(&self, task: usize) -> bool;
}

/// Writes a trace line by line.
pub struct TraceWriter<W, L = Lines> {
    out: W,
    lines: L,
}

/// What lines of a mission's trace are made of.
pub struct Lines {
    directory: Arc<Directory>,
    /// Paths of the local states as JSON strings, by region instance and local state.
    quoted: Vec<Vec<Box<str>>>,
    /// What a transition line says behind its time, by region instance and transition: the same
    /// each time it is taken.
    tails: HashMap<(usize, usize), Box<str>>,
    /// Room for a line, kept from one to the next.
    line: Vec<u8>,
}

impl Lines {
    /// Takes time and memory in proportion to the machine's state instances.
    pub fn of(directory: Arc<Directory>) -> Self {
        let quoted = directory.regions().iter().map(|region| {
            region
                .locals
                .iter()
                .map(|state| quote(&state.path))
                .collect()
        });
        Lines {
            quoted: quoted.collect(),
            directory,
            tails: HashMap::new(),
            line: Vec::new(),
        }
    }
}

impl<W: Write> TraceWriter<W> {
    /// A writer for one mission's run. Takes time and memory in proportion to the machine's state
    /// instances.
    pub fn new(out: W, directory: Arc<Directory>) -> Self {
        TraceWriter {
            out,
            lines: Lines::of(directory),
        }
    }
}

impl<W: Write, L: BorrowMut<Lines>> TraceWriter<W, L> {
    /// A writer for one of several runs of a mission, which share what their lines are made of.
    pub fn with(out: W, lines: L) -> Self {
        TraceWriter { out, lines }
    }

    /// A transition was taken, in the micro step with that number (from 0) of the macro step. One
    /// that the machine does not have is left out.
    ///
    /// # Errors
    /// When the line cannot be written.
    pub fn transition(
        &mut self,
        at: Step,
        micro: u32,
        region: usize,
        transition: usize,
    ) -> io::Result<()> {
        let lines = self.lines.borrow_mut();
        let tail = match lines.tails.entry((region, transition)) {
            std::collections::hash_map::Entry::Occupied(known) => known.into_mut(),
            std::collections::hash_map::Entry::Vacant(new) => {
                match transition_tail(&lines.directory, region, transition) {
                    Some(tail) => new.insert(tail),
                    None => return Ok(()),
                }
            }
        };
        let Step { step, t_us } = at;
        writeln!(
            self.out,
            "{{\"kind\":\"transition\",\"step\":{step},\"micro\":{micro},\"t_us\":{t_us},{tail}"
        )
    }

    /// A macro step has ended after that many micro steps, in that state.
    ///
    /// # Errors
    /// When the line cannot be written.
    pub fn step(&mut self, at: Step, micro_steps: u32, snapshot: &impl Snapshot) -> io::Result<()> {
        let lines = self.lines.borrow_mut();
        let Step { step, t_us } = at;
        lines.line.clear();
        write!(
            lines.line,
            "{{\"kind\":\"step\",\"step\":{step},\"t_us\":{t_us},\"micro_steps\":{micro_steps},\"active\":["
        )?;
        for state in lines.directory.active(|region| snapshot.current(region)) {
            push_item(&mut lines.line, &lines.quoted, state);
        }
        end_list(&mut lines.line);
        lines.line.extend_from_slice(b",\"enabled\":[");
        for (task, state) in lines.directory.task_states().iter().enumerate() {
            if snapshot.is_enabled(task) {
                push_item(&mut lines.line, &lines.quoted, *state);
            }
        }
        end_list(&mut lines.line);
        lines.line.extend_from_slice(b"}\n");
        self.out.write_all(&lines.line)
    }

    /// The machine has faulted: the last line of a trace.
    ///
    /// # Errors
    /// When the line cannot be written.
    pub fn fault(&mut self, at: Step, code: &str) -> io::Result<()> {
        let Step { step, t_us } = at;
        writeln!(
            self.out,
            "{{\"kind\":\"fault\",\"step\":{step},\"t_us\":{t_us},\"code\":{}}}",
            quote(code)
        )
    }

    /// Hands what was written so far to whoever reads it.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn flush(&mut self) -> io::Result<()> {
        self.out.flush()
    }

    /// Where the lines went.
    pub fn into_inner(self) -> W {
        self.out
    }
}

/// `"event":…}`, all of a transition line that does not depend on the time.
fn transition_tail(directory: &Directory, region: usize, transition: usize) -> Option<Box<str>> {
    let words = directory.transition(region, transition)?;
    let (event, from, to) = (quote(words.event), quote(words.from), quote(words.to));
    let list = |items: Vec<Box<str>>| items.join(",");
    let sent = list(words.sent.iter().map(|event| quote(event)).collect());
    let set = list(words.set.iter().map(|path| quote(path)).collect());
    let cleared = list(words.cleared.iter().map(|path| quote(path)).collect());
    let lists = format!("\"sent\":[{sent}],\"set\":[{set}],\"cleared\":[{cleared}]");
    Some(format!("\"event\":{event},\"from\":{from},\"to\":{to},{lists}}}").into())
}

/// Text as a JSON string.
fn quote(text: &str) -> Box<str> {
    serde_json::Value::from(text).to_string().into()
}

/// Adds a path and a comma to a list.
fn push_item(line: &mut Vec<u8>, quoted: &[Vec<Box<str>>], state: StateId) {
    if let Some(path) = quoted
        .get(state.region)
        .and_then(|locals| locals.get(state.local))
    {
        line.extend_from_slice(path.as_bytes());
        line.push(b',');
    }
}

/// Ends a list that may end with a comma.
fn end_list(line: &mut Vec<u8>) {
    if line.last() == Some(&b',') {
        line.pop();
    }
    line.push(b']');
}
