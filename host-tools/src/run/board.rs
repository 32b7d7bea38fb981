//! A board of either kind, from its name to its line.

use std::path::PathBuf;

use rt_firmware::body::flash::ERASE_BYTES;
use rt_firmware::store::keep;
use thiserror::Error;

use super::entered::Entered;
use crate::host_board::{self, HostBoard, HostBoardError, RobotMaker};
use crate::link_client::log_lines::{LogReader, LogTableError};
use crate::lockstep::plant_side::PlantSide;
use crate::qemu::{Emulator, EmulatorError, Idle, firmware};
use crate::serial::pacing::Paced;
use crate::serial::{ByteLink, DEFAULT_BAUD};

/// Which board to run on.
pub enum Board {
    /// A firmware in the emulator.
    Emulated {
        /// Its ELF file.
        firmware: PathBuf,
    },
    /// This process.
    Host {
        /// Makes the robot whose tasks run.
        robot: RobotMaker,
    },
}

impl Board {
    /// Its name, as `--board` takes it.
    pub fn name(&self) -> &'static str {
        match self {
            Board::Emulated { .. } => firmware::BOARD,
            Board::Host { .. } => host_board::BOARD,
        }
    }

    /// Bytes of its flash for missions.
    pub fn flash_bytes(&self) -> u32 {
        let capacities = crate::boards::find(self.name()).map(|board| board.capacities);
        let blob_bytes = capacities.map_or(0, |capacities| capacities.blob_bytes);
        keep::flash_bytes(blob_bytes, ERASE_BYTES as u32)
    }

    /// What decodes its log.
    ///
    /// # Errors
    /// [`LogTableError`]: what is wrong with the firmware's file.
    pub fn log_reader(&self) -> Result<LogReader, LogTableError> {
        match self {
            Board::Emulated { firmware } => LogReader::firmware(firmware),
            Board::Host { .. } => Ok(LogReader::text()),
        }
    }
}

/// Why a board does not run.
#[derive(Debug, Error)]
pub enum BoardError {
    /// The emulator.
    #[error(transparent)]
    Emulator(#[from] EmulatorError),
    /// The host board.
    #[error(transparent)]
    Host(#[from] HostBoardError),
    /// Only the host board takes what a recording holds.
    #[error("a recording can be replayed on the board `host` only")]
    CannotReplay,
}

/// A running board of either kind. Dropping it ends it.
pub enum RunningBoard {
    /// A firmware in the emulator.
    Emulated(Box<Emulator>),
    /// A thread of this process.
    Host(HostBoard),
}

impl RunningBoard {
    /// Starts a board with `plant` behind its pins; answers it and its line.
    ///
    /// # Errors
    /// [`BoardError`]
    pub fn start(
        board: Board,
        plant: &PlantSide,
        replay: Option<&Entered>,
    ) -> Result<(Self, Box<dyn ByteLink>), BoardError> {
        let flash_bytes = board.flash_bytes();
        match board {
            Board::Emulated { firmware } => {
                if replay.is_some() {
                    return Err(BoardError::CannotReplay);
                }
                let served = plant.clone();
                let flash = plant.flash(flash_bytes);
                let answer = move |request: &_| served.exchange(request);
                let mut emulator = Emulator::start(&firmware, Idle::Passes, answer, flash)?;
                let uart = emulator.take_uart().ok_or(EmulatorError::NotStarted {
                    console: String::new(),
                })?;
                // The emulated UART knows no rate.
                let line = Box::new(Paced::new(uart, DEFAULT_BAUD));
                Ok((RunningBoard::Emulated(Box::new(emulator)), line))
            }
            Board::Host { robot } => {
                let (board, line) = HostBoard::start(robot, plant.clone(), replay)?;
                Ok((RunningBoard::Host(board), Box::new(line)))
            }
        }
    }

    /// Looks whether it still runs.
    ///
    /// # Errors
    /// [`BoardError`]: why not.
    pub fn check(&mut self) -> Result<(), BoardError> {
        match self {
            RunningBoard::Emulated(emulator) => Ok(emulator.check_alive()?),
            RunningBoard::Host(board) => Ok(board.check()?),
        }
    }

    /// What an emulator and its firmware printed last.
    pub fn console(&self) -> String {
        match self {
            RunningBoard::Emulated(emulator) => emulator.console(),
            RunningBoard::Host(_) => String::new(),
        }
    }
}
