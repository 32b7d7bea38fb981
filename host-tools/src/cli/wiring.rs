//! `esm wiring`: what a robot's file says, as a table and a picture.

use std::path::PathBuf;

use clap::Args;

use super::console::Console;
use super::exit::CommandError;
use super::{file, stage};

/// Checks a robot's file, and shows which pin is what
///
/// The table is Markdown, ordered by pins. The picture shows the chassis from above, with its
/// wheels and sonars and their pins.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  esm wiring boards/pico/robot.toml
  esm wiring examples/my_pico/robot.toml --svg wiring.svg")]
pub struct WiringArgs {
    /// The robot's file
    #[arg(value_name = "ROBOT.toml")]
    pub file: PathBuf,

    /// Writes the picture there, as SVG
    #[arg(long, value_name = "OUT")]
    pub svg: Option<PathBuf>,
}

/// Runs the command.
///
/// # Errors
/// If the file cannot be read, what it says cannot be built, or the picture cannot be written.
pub fn execute(args: &WiringArgs, console: &mut Console) -> Result<(), CommandError> {
    if let Some(picture) = &args.svg {
        file::keep_sources(picture, [args.file.as_path()])?;
    }
    let robot = stage::robot(&args.file)?;
    console.text(&robot.wiring())?;
    match &args.svg {
        Some(picture) => file::write_whole(picture, robot.picture().as_bytes(), "picture"),
        None => Ok(()),
    }
}
