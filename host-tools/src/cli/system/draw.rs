//! `esm system draw`: a picture of a system.

use std::path::PathBuf;

use clap::Args;

use super::loaded::Loaded;
use crate::cli::console::Console;
use crate::cli::exit::CommandError;
use crate::cli::file;
use crate::cli::mission::Audience;
use crate::system::drawing;

/// Draws a system: its processors with their missions, the frames of their links, and the media
///
/// Each link of a mission is shown with its dispatchers and all frames that they send and receive,
/// each with its identifier, payload and period. The picture is SVG, or PNG where OUT ends in .png.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  esm system draw robot.system -o robot.svg
  esm system draw robot.system -o robot.png")]
pub struct DrawArgs {
    /// The system file
    #[arg(value_name = "FILE")]
    pub file: PathBuf,

    /// Where the picture goes: a PNG if the name ends in .png, else an SVG
    #[arg(short, long, value_name = "OUT")]
    pub output: PathBuf,
}

/// Runs the command.
///
/// # Errors
/// If the file cannot be read, something in the system has errors, or the picture cannot be
/// written.
pub fn execute(args: &DrawArgs, console: &mut Console) -> Result<(), CommandError> {
    let loaded = Loaded::load(&args.file)?;
    loaded.tell(Audience::Person, console)?;
    let Some(system) = loaded.system.as_ref().filter(|_| loaded.counts().0 == 0) else {
        return Err(CommandError::Told);
    };
    let missions = loaded.all_missions().map(|it| it.path.as_path());
    file::keep_sources(&args.output, missions.chain([args.file.as_path()]))?;
    let title = args.file.file_name().unwrap_or(args.file.as_os_str());
    let scene = drawing::draw(system, &loaded.models(), &title.to_string_lossy());
    file::write_picture(&args.output, &scene)
}
