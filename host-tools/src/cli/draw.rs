//! `esm draw`: the state diagram of a machine.

use std::path::PathBuf;

use clap::Args;

use super::console::Console;
use super::exit::CommandError;
use super::file;
use super::mission::{self, Audience};
use crate::diagram::{self, DrawError, Options};

/// Draws the state diagram of a mission, in the symbols of the ESM language
///
/// Superstates are drawn with the machine that is inside them, task states with their data ports
/// and the paths between. A file without a machine shows its containers, one under the other. The
/// picture is SVG, or PNG where OUT ends in .png.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  esm draw missions/patrol.esm -o patrol.svg
  esm draw missions/patrol.esm -o avoid.svg --container Avoid --legend
  esm draw missions/patrol.esm -o overview.png --depth 0 --no-data")]
pub struct DrawArgs {
    /// The mission, or a file of containers
    #[arg(value_name = "FILE")]
    pub file: PathBuf,

    /// Where the picture goes: a PNG if the name ends in .png, else an SVG
    #[arg(short, long, value_name = "OUT")]
    pub output: PathBuf,

    /// Draws this container alone
    #[arg(long, value_name = "NAME")]
    pub container: Option<String>,

    /// Shows the inside of superstates down to this level; 0 shows none
    #[arg(long, value_name = "N")]
    pub depth: Option<u32>,

    /// Leaves data ports and data paths away
    #[arg(long)]
    pub no_data: bool,

    /// Says below the picture what the symbols mean
    #[arg(long)]
    pub legend: bool,

    /// Puts below the picture what the `///` lines say of what it shows
    #[arg(long)]
    pub notes: bool,
}

/// Runs the command.
///
/// # Errors
/// If the file cannot be read or has errors, if what it says is too large for a picture, or if the
/// picture cannot be written.
pub fn execute(args: &DrawArgs, console: &mut Console) -> Result<(), CommandError> {
    file::keep_sources(&args.output, [args.file.as_path()])?;
    let checked = mission::read(&args.file)?;
    mission::tell(&checked, Audience::Person, console)?;
    let Some(model) = &checked.model else {
        return Err(CommandError::Told);
    };
    let options = Options {
        container: args.container.clone(),
        depth: args.depth,
        data: !args.no_data,
        legend: args.legend,
        notes: args.notes,
        ..Options::default()
    };
    let scene = diagram::draw(model, &options).map_err(|error| match error {
        DrawError::NoContainer { .. } => CommandError::Usage(error.into()),
        _ => CommandError::Input(error.into()),
    })?;
    file::write_picture(&args.output, &scene)
}
