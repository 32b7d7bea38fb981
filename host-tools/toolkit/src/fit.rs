//! Whether a mission fits: into a blob, onto a board (E012), and its macro steps into their slot
//! (E010).
//!
//! What a mission needs of a board is worked out by the firmware's own code, on the blob that the
//! board would be given. So what is said here before anything is uploaded is what the board says
//! itself. How long macro steps take is a [bound](crate::bound) with what was measured on the
//! board.

use esm_core::Verified;
use esm_core::tables::{Slot, Tables};
use esm_link::message::Capacity;
use rt_firmware::check::{Need, needs};

use crate::boards::Board;
use crate::bound::report::Report;
use crate::bound::worst::Events;
use crate::bound::{Machine, bound};
use crate::compile::{self, CompileError, NameTable};
use crate::lang::{Checked, Code, Diagnostic};
use crate::model::{Model, PathEnd, Span, StateKind};
use crate::schedule::LaidOut;

/// Compiles a checked set of files with a machine. What does not fit into a blob, or onto `board`
/// where one is named, is added as E012, macro steps that can last longer than their slot on that
/// board as E010, and then there is no blob; nor is there one where the files have errors.
///
/// # Errors
/// The machine has nothing to run; or a defect of this program: the files are right, and no blob
/// could be made of them.
pub fn compile_to_fit(
    checked: &mut Checked,
    schedule: &LaidOut,
    board: Option<&Board>,
    names: NameTable,
) -> Result<Option<Verified<Vec<u8>>>, CompileError> {
    let Some(model) = checked.model.as_ref() else {
        return Ok(None);
    };
    let whole = machine_span(model);
    let compiled = compile::compile_with(model, schedule, names).and_then(|blob| {
        esm_core::verify(blob).map_err(|(_, refusal)| CompileError::Refused(refusal))
    });
    let verified = match compiled {
        Ok(verified) => verified,
        Err(CompileError::Limit {
            capacity,
            found,
            limit,
            at,
        }) => {
            let message = format!(
                "at least {found} {capacity} are needed, {} more than the {limit} that a blob can hold",
                found.saturating_sub(limit)
            );
            checked.add(
                Diagnostic::new(Code::E012, at.unwrap_or(whole), message)
                    .hint("split the mission, or use fewer and smaller containers"),
            );
            return Ok(None);
        }
        Err(defect) => return Err(defect),
    };
    let exceeded: Vec<Diagnostic> = board
        .map(|board| {
            exceeded(&verified, board)
                .map(|need| too_much(model, &verified.tables(), board.name, need))
                .collect()
        })
        .unwrap_or_default();
    let too_long = board
        .and_then(|board| Overlong::of(&verified, board))
        .map(|overlong| overlong.diagnostic(model));
    let wrong = exceeded.into_iter().chain(too_long);
    let wrong: Vec<Diagnostic> = wrong.collect();
    let fits = wrong.is_empty();
    for diagnostic in wrong {
        checked.add(diagnostic);
    }
    Ok(fits.then_some(verified))
}

/// What of a board a mission exceeds, a sentence each: for those who do not ask for that board.
pub fn shortages(verified: &Verified<Vec<u8>>, board: &Board) -> Vec<String> {
    let too_long = Overlong::of(verified, board).map(|overlong| overlong.message());
    exceeded(verified, board)
        .map(|need| Shortage::of(need).message(board.name))
        .chain(too_long)
        .collect()
}

/// A macro step that can take longer than the interpreter's slot lasts.
struct Overlong<'b> {
    board: &'b Board,
    slot: Slot,
    time_us: u64,
    instruction_ns: u32,
    report: Report,
}

impl<'b> Overlong<'b> {
    /// Looks for one, where it is known how fast the board's interpreter is. Where events cause
    /// each other in a circle (W104) or are more than a macro step may have, that is what stops the
    /// machine, and no slot is long enough for it.
    fn of(verified: &Verified<Vec<u8>>, board: &'b Board) -> Option<Self> {
        let (speed, costs) = (board.interpreter?, board.costs()?);
        let tables = verified.tables();
        let slot = tables.slot(tables.interpreter_slot())?;
        let bound = bound(&Machine::of(&tables), &costs);
        let time_us = speed.time_us(bound.instructions);
        let is_overlong = bound.events == Events::Counted && time_us > u64::from(slot.duration_us);
        is_overlong.then(|| Overlong {
            board,
            slot,
            time_us,
            instruction_ns: speed.instruction_ns,
            report: Report::of(&bound, &tables),
        })
    }

    fn message(&self) -> String {
        format!(
            "a macro step takes up to {} instructions, {} us at {} ns each on board `{}`; the interpreter's slot {} lasts {} us",
            self.report.instructions,
            self.time_us,
            self.instruction_ns,
            self.board.name,
            self.slot.number,
            self.slot.duration_us
        )
    }

    fn diagnostic(&self, model: &Model) -> Diagnostic {
        /// As many of the greatest parts are named.
        const NAMED: usize = 3;
        let slot = model
            .interpreter_slot
            .and_then(|slot| model.slots.get(slot));
        let parts = self.report.parts.iter().take(NAMED);
        let parts: Vec<String> = parts
            .map(|part| format!("{} ({})", part.says(), part.instructions))
            .collect();
        Diagnostic::new(
            Code::E010,
            slot.map(|slot| slot.span).unwrap_or_default(),
            self.message(),
        )
        .hint(format!(
            "give the slot at least {} us; most of it takes {}, and `esm bound` shows the rest",
            self.time_us,
            parts.join(", ")
        ))
    }
}

fn exceeded(verified: &Verified<Vec<u8>>, board: &Board) -> impl Iterator<Item = Need> {
    let tables = verified.tables();
    let (links, frames) = board.link_room();
    let of_links = [
        (Capacity::Links, tables.links().len(), links),
        (Capacity::Frames, tables.frames().len(), frames),
    ];
    let of_links = of_links.map(|(what, needed, available)| Need {
        what,
        needed: needed as u32,
        available: available as u32,
    });
    needs(verified, &board.capacities)
        .into_iter()
        .chain(of_links)
        .filter(|need| need.needed > need.available)
}

/// A capacity that is exceeded, in words.
struct Shortage {
    need: Need,
    what: &'static str,
    hint: &'static str,
}

impl Shortage {
    fn of(need: Need) -> Self {
        let (what, hint) = match need.what {
            Capacity::BlobBytes => (
                "bytes of blob",
                "leave the names out (`esm build --strip`), and use one container several times where there are copies of it",
            ),
            Capacity::ArenaWords => (
                "words for the interpreter",
                "use fewer regions (two words each), fewer flags, or a shorter `queue` (half a word a place)",
            ),
            Capacity::Slots => ("slots", "let tasks of the same period share a slot"),
            Capacity::TaskInstances => (
                "task states",
                "enter one task state from several places; each use of a container counts its task states anew",
            ),
            Capacity::Nets => (
                "nets",
                "leave out paths that nobody reads; paths that share a port are one net",
            ),
            Capacity::ExclusiveGroups => (
                "exclusive groups",
                "put tasks into one group that are never active together anyway",
            ),
            // It is of two missions, and asked for when one takes over from the other warm.
            Capacity::Pairs => ("entries in common", "upload it without `--warm`"),
            // Scripts are no missions.
            Capacity::ScriptSteps => ("steps of a script", "make two of it"),
            Capacity::Links if need.available == 0 => (
                "links",
                "no firmware of this board serves links: leave them out",
            ),
            Capacity::Frames if need.available == 0 => (
                "frames",
                "no firmware of this board serves links: leave them out",
            ),
            Capacity::Links => ("links", "send over one link what goes the same way"),
            Capacity::Frames => ("frames", "send several values in one frame"),
        };
        Shortage { need, what, hint }
    }

    /// How much of what is needed, and how much there is.
    fn message(&self, board: &str) -> String {
        let Need {
            needed, available, ..
        } = self.need;
        format!(
            "{needed} {} are needed, {} more than the {available} that board `{board}` has room for",
            self.what,
            needed.saturating_sub(available)
        )
    }
}

/// A capacity of a board that a mission exceeds.
fn too_much(model: &Model, tables: &Tables<'_>, board: &str, need: Need) -> Diagnostic {
    let shortage = Shortage::of(need);
    let place = beyond(model, tables, need.what, need.available as usize);
    Diagnostic::new(
        Code::E012,
        place.unwrap_or(machine_span(model)),
        shortage.message(board),
    )
    .hint(format!(
        "{}; or name another board with `--board`",
        shortage.hint
    ))
}

fn machine_span(model: &Model) -> Span {
    model
        .machine
        .and_then(|machine| model.containers.get(machine))
        .map(|machine| machine.span)
        .unwrap_or_default()
}

/// The declaration of the first thing for which there is no room, if one can be told.
fn beyond(model: &Model, tables: &Tables<'_>, what: Capacity, available: usize) -> Option<Span> {
    match what {
        Capacity::BlobBytes | Capacity::ArenaWords | Capacity::Pairs | Capacity::ScriptSteps => {
            None
        }
        Capacity::Slots => model.slots.get(available).map(|slot| slot.span),
        Capacity::Links => model.links.get(available).map(|link| link.declaration),
        Capacity::Frames => model.frames.get(available).map(|frame| frame.declaration),
        Capacity::TaskInstances => {
            let place = task_instances(model).nth(available)?;
            let container = model.containers.get(place.container)?;
            let state = container.regions.get(place.region)?.states.get(place.state);
            state.map(|state| state.declaration)
        }
        Capacity::Nets => net_path(model, tables, available),
        Capacity::ExclusiveGroups => {
            let group = u16::try_from(available).ok()?;
            let task = tables.tasks().find(|task| task.exclusive == Some(group))?;
            let name = task.signature.name();
            let declared = model.tasks.iter().find(|task| task.name.as_bytes() == name);
            declared.map(|task| task.span)
        }
    }
}

/// The path that puts the first port on a net, which is named by its number in the blob.
fn net_path(model: &Model, tables: &Tables<'_>, net: usize) -> Option<Span> {
    for (index, place) in task_instances(model).enumerate() {
        let first = tables.task_instance(index)?.first_connection;
        let container = model.containers.get(place.container)?;
        let state = container
            .regions
            .get(place.region)?
            .states
            .get(place.state)?;
        let StateKind::Task { task, .. } = state.kind else {
            continue;
        };
        let ports = model.tasks.get(task)?.data.len();
        let on_net = (0..ports).find(|port| tables.connection(first + port) == Some(Some(net)));
        if let Some(port) = on_net {
            let end = PathEnd::State {
                region: place.region,
                state: place.state,
                port,
            };
            let path = container
                .paths
                .iter()
                .find(|path| path.from.contains(&end) || path.to.contains(&end))?;
            return Some(path.span);
        }
    }
    None
}

/// Where a task state stands.
#[derive(Clone, Copy, Debug)]
struct Place {
    container: usize,
    region: usize,
    state: usize,
}

/// The task states of all instances in the order in which a blob numbers them: depth first, regions
/// and states in source order. The model is one that was compiled, so the limits of the format
/// bound the walk.
fn task_instances(model: &Model) -> impl Iterator<Item = Place> + '_ {
    let start = |container| Place {
        container,
        region: 0,
        state: 0,
    };
    let mut way: Vec<Place> = model.machine.map(start).into_iter().collect();
    std::iter::from_fn(move || {
        while let Some(at) = way.last_mut() {
            let here = *at;
            let regions = model.containers.get(here.container).map(|it| &it.regions);
            let Some(region) = regions.and_then(|regions| regions.get(here.region)) else {
                way.pop();
                continue;
            };
            let Some(state) = region.states.get(here.state) else {
                at.region += 1;
                at.state = 0;
                continue;
            };
            at.state += 1;
            match state.kind {
                StateKind::Simple => {}
                StateKind::Task { .. } => return Some(here),
                StateKind::Super { container } => way.push(start(container)),
            }
        }
        None
    })
}

#[cfg(test)]
mod tests;
