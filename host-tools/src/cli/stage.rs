//! What `run`, `board` and `tasks` set a robot up with: the board by its name, the world, the mission.

use std::path::{Path, PathBuf};

use anyhow::anyhow;
use esm_core::Verified;

use super::console::Console;
use super::exit::CommandError;
use super::file;
use super::mission::{self, Audience};
use crate::host_board::{self, RobotMaker};
use crate::inspect::refusal::Explained;
use crate::qemu::firmware::{self, FirmwareError};
use crate::run::board::Board;
use crate::run::mission::Mission;
use crate::world::World;

/// The world to drive in where none is named.
const DEFAULT_WORLD: &str = include_str!("../../../missions/worlds/office.world");

/// How a blob begins, so that it is told from a source.
const BLOB_MARK: &[u8] = b"ESM1";

/// The board of that name, with its firmware found or built.
///
/// # Errors
/// If there is no such board, or no firmware for it.
pub fn board(
    name: &str,
    named_firmware: Option<&Path>,
    robot: RobotMaker,
    console: &mut Console,
) -> Result<Board, CommandError> {
    match name {
        host_board::BOARD => Ok(Board::Host { robot }),
        firmware::BOARD => Ok(Board::Emulated {
            firmware: find_firmware(named_firmware, console)?,
        }),
        other => Err(CommandError::Usage(anyhow!(
            "there is no board `{other}`; the boards are `{}` and `{}`",
            firmware::BOARD,
            host_board::BOARD
        ))),
    }
}

/// The emulated board's firmware: the named one, or that of the checkout, which is built if need be.
///
/// # Errors
/// If there is none.
pub fn find_firmware(named: Option<&Path>, console: &mut Console) -> Result<PathBuf, CommandError> {
    let here = std::env::current_dir()?;
    firmware::find(named, &here, |told| console.note(told))
        .map_err(|error: FirmwareError| CommandError::World(error.into()))
}

/// The world in a file, or the office.
///
/// # Errors
/// If the file cannot be read or has errors.
pub fn world(path: Option<&Path>) -> Result<World, CommandError> {
    match path {
        Some(path) => World::load(path),
        None => World::parse(DEFAULT_WORLD),
    }
    .map_err(|error| CommandError::Input(error.into()))
}

/// The mission in a file: a source is compiled, a blob taken as it is.
///
/// # Errors
/// If it cannot be read, has errors, or has no names.
pub fn mission(path: &Path, console: &mut Console) -> Result<Mission, CommandError> {
    let bytes = file::read(path, "mission")?;
    let verified = if bytes.starts_with(BLOB_MARK) {
        verified(path, bytes)?
    } else {
        mission::compiled(path, Audience::Person, console)?
    };
    Mission::new(path, verified).map_err(|error| CommandError::Input(error.into()))
}

/// A blob that is one.
///
/// # Errors
/// If it is none.
pub fn verified(path: &Path, blob: Vec<u8>) -> Result<Verified<Vec<u8>>, CommandError> {
    esm_core::verify(blob).map_err(|(_, refusal)| {
        CommandError::Input(anyhow!(
            "{} is no valid blob: {}",
            path.display(),
            Explained(refusal)
        ))
    })
}
