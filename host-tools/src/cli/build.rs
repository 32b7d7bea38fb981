//! `esm build`: a mission as the blob that a robot takes.

use std::io::Write;
use std::path::PathBuf;

use clap::Args;
use esm_core::Verified;
use esm_core::tables::{State, StateKind};
use serde::Serialize;

use super::console::Console;
use super::exit::CommandError;
use super::file;
use super::mission::{self, Audience};

/// Compiles a mission to the blob that a robot takes
///
/// The blob holds the machine, its schedule, data paths and parameters, and the names that traces and status need. OUT appears
/// whole or not at all: a build that fails leaves the old file alone.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  esm build missions/patrol.esm -o patrol.blob
  esm build missions/patrol.esm -o patrol.blob --json | jq .bytes

With --json: bytes, states, transitions, containers, instances, events, flags, ram_bytes.")]
pub struct BuildArgs {
    /// The mission
    #[arg(value_name = "FILE")]
    pub file: PathBuf,

    /// Where the blob goes
    #[arg(short, long, value_name = "OUT")]
    pub output: PathBuf,

    /// What was built as one JSON object, for programs
    #[arg(long)]
    pub json: bool,
}

/// What was built, in the form of its JSON.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct BuildReport {
    /// Length of the blob.
    pub bytes: usize,
    /// States as the source declares them; `initial` and `final` are not counted.
    pub states: usize,
    /// Transitions as the source declares them.
    pub transitions: usize,
    /// Containers, the machine included, each counted once however often it is used.
    pub containers: usize,
    /// Container instances: the machine, and one for each superstate in it, at any depth.
    pub instances: usize,
    /// Event names.
    pub events: usize,
    /// Flags of all instances, in bits of memory.
    pub flags: usize,
    /// Memory that the interpreter needs to run the mission.
    pub ram_bytes: usize,
}

impl BuildReport {
    /// Counts what is in a blob.
    pub fn of(verified: &Verified<Vec<u8>>) -> Self {
        let tables = verified.tables();
        let is_declared =
            |state: &State| !matches!(state.kind, StateKind::Initial | StateKind::Final);
        BuildReport {
            bytes: verified.bytes().len(),
            states: (0..tables.state_count())
                .filter_map(|state| tables.state(state))
                .filter(is_declared)
                .count(),
            transitions: tables.transition_count(),
            containers: tables.containers().len(),
            instances: tables.instance_count(),
            events: tables.event_count(),
            flags: tables.flag_count(),
            ram_bytes: verified.ram_bytes(),
        }
    }
}

/// Runs the command.
///
/// # Errors
/// If the mission cannot be compiled or the blob cannot be written.
pub fn execute(args: &BuildArgs, console: &mut Console) -> Result<(), CommandError> {
    let audience = if args.json {
        Audience::Program
    } else {
        Audience::Person
    };
    let verified = mission::compiled(&args.file, audience, console)?;
    file::write_whole(&args.output, verified.bytes(), "blob")?;
    let report = BuildReport::of(&verified);
    if args.json {
        return console.json_line(&report);
    }
    let BuildReport {
        bytes,
        states,
        transitions,
        containers,
        instances,
        events,
        flags,
        ram_bytes,
    } = report;
    let out = console.out();
    writeln!(
        out,
        "{}: {bytes} bytes, mission {:08x}",
        args.output.display(),
        verified.hash()
    )?;
    writeln!(
        out,
        "  {states} states and {transitions} transitions in {containers} containers, {instances} instances of them"
    )?;
    writeln!(
        out,
        "  {events} events, {flags} flags; runs in {ram_bytes} bytes of memory"
    )?;
    Ok(())
}
