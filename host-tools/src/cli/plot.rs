//! `esm plot`: a recording as a picture.

use std::io::Write;
use std::path::PathBuf;

use anyhow::anyhow;
use clap::{Args, ValueEnum};
use serde::Serialize;

use super::console::Console;
use super::exit::CommandError;
use super::record::note_end;
use super::run::read_recording;
use super::{file, stage};
use crate::recording::plot::{self, Parts, Shown};
use crate::recording::told::Told;

/// Draws a recording: the path, speeds, ranges and states over time
///
/// The picture is SVG, or PNG where OUT ends in .png. The same recording gives the same picture,
/// byte for byte. Path, speeds and ranges are the values that the recording holds; states are those
/// of the machine, which is run again.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  esm plot patrol.rec -o patrol.svg
  esm plot patrol.rec -o patrol.png --world office
  esm plot patrol.rec -o speeds.svg --show speeds,states --json")]
pub struct PlotArgs {
    /// The recording
    #[arg(value_name = "REC")]
    pub recording: PathBuf,

    /// Where the picture goes: a PNG if the name ends in .png, else an SVG
    #[arg(short, long, value_name = "OUT")]
    pub output: PathBuf,

    /// What is drawn [default: all that the recording holds]
    #[arg(long, value_name = "PART", value_delimiter = ',')]
    pub show: Vec<Part>,

    /// The world whose map lies below the path: a file, or the name of one that ships. The path
    /// begins where the robot of that world starts
    #[arg(long, value_name = "WORLD")]
    pub world: Option<PathBuf>,

    /// Says as one JSON object what is drawn, for programs
    #[arg(long)]
    pub json: bool,
}

/// A part of the picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Part {
    /// Where the robot was, by the first net with poses
    Path,
    /// Numbers in m/s and rad/s
    Speeds,
    /// Ranges of sensors
    Ranges,
    /// States of all regions
    States,
}

/// What `--json` prints.
#[derive(Serialize)]
struct Report<'r> {
    #[serde(flatten)]
    shown: &'r Shown,
    /// Why it ends early, or `null`.
    error: Option<String>,
}

/// Runs the command.
///
/// # Errors
/// What kept it from ending well.
pub fn execute(args: &PlotArgs, console: &mut Console) -> Result<(), CommandError> {
    let world = args.world.as_deref();
    let inputs = [Some(args.recording.as_path()), world];
    file::keep_sources(&args.output, inputs.into_iter().flatten())?;
    let recording = read_recording(&args.recording)?;
    let world = world
        .map(|world| stage::world(Some(world), None))
        .transpose()?;
    let is_shown = |part| args.show.is_empty() || args.show.contains(&part);
    let parts = Parts {
        path: is_shown(Part::Path),
        speeds: is_shown(Part::Speeds),
        ranges: is_shown(Part::Ranges),
        states: is_shown(Part::States),
    };
    let (told, ended) = Told::of(&recording);
    let drawn = plot::draw(&recording, &told, parts, world.as_ref());
    let (picture, shown) = drawn
        .map_err(|error| CommandError::Input(anyhow!("{}: {error}", args.recording.display())))?;
    if shown.path.is_none() && shown.curves.is_empty() && !parts.states {
        return Err(CommandError::Input(anyhow!(
            "{} holds nothing of that: values are in what `esm run --record`, `esm log --record` and `esm record` write, where the mission has such nets; `--show states` draws the states",
            args.recording.display()
        )));
    }
    file::write_picture(&args.output, &picture.scene())?;
    let error = ended.as_ref().err().map(ToString::to_string);
    if args.json {
        let shown = &shown;
        console.json_line(&Report { shown, error })?;
    } else {
        let length =
            (shown.path.as_ref()).map(|path| format!(", a path of {:.2} m", path.length_m));
        writeln!(
            console.out(),
            "{:.3} s with {} samples{}, {} curves in {}",
            shown.time_s,
            shown.samples,
            length.unwrap_or_default(),
            shown.curves.len(),
            args.output.display()
        )?;
    }
    note_end(&recording, &args.recording, console);
    ended.map_err(|error| CommandError::Input(error.into()))
}
