//! A board of either kind, from its name to its line.

use std::path::PathBuf;

use rt_firmware::body::flash::ERASE_BYTES;
use rt_firmware::store::flash_store::{self, FlashStore};
use thiserror::Error;

use crate::flash::Flash;
use crate::host_board::{self, HostBoard, HostBoardError, RobotMaker};
use crate::link_client::log_lines::{LogReader, LogTableError};
use crate::lockstep::line;
use crate::lockstep::plant_side::PlantSide;
use crate::qemu::{Emulator, EmulatorError, Idle, firmware};
use crate::serial::pacing::Paced;
use crate::serial::{ByteLink, DEFAULT_BAUD};
use esm_toolkit::recording::entered::Entered;

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

    /// Whether what a recording holds can enter it, when its link goes this way.
    ///
    /// # Errors
    /// [`BoardError::CannotReplay`], [`BoardError::CannotReplayInStep`]
    pub fn check_replay(&self, link: LinkWay) -> Result<(), BoardError> {
        match (self, link) {
            (Board::Emulated { .. }, _) => Err(BoardError::CannotReplay),
            (Board::Host { .. }, LinkWay::Exchange) => Err(BoardError::CannotReplayInStep),
            (Board::Host { .. }, LinkWay::Uart) => Ok(()),
        }
    }

    /// Bytes of its flash for missions.
    pub fn flash_bytes(&self) -> u32 {
        let capacities = esm_toolkit::boards::find(self.name()).map(|board| board.capacities);
        let blob_bytes = capacities.map_or(0, |capacities| capacities.blob_bytes);
        flash_store::flash_bytes(blob_bytes, ERASE_BYTES as u32)
    }

    /// A flash without missions, for a run: a robot that has one of its own waits for the run's.
    pub fn flash_of_a_run(&self) -> Flash {
        let bytes = self.flash_bytes();
        let flash = Flash::blank(bytes);
        let blob_bytes =
            esm_toolkit::boards::find(self.name()).map_or(0, |board| board.capacities.blob_bytes);
        let mut records = [0; flash_store::RECORD_BYTES];
        if let Ok(mut keep) = FlashStore::open(flash.clone(), blob_bytes, None, &mut records) {
            // Blank cells take it.
            let _ = keep.wait_for_host();
        }
        flash
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

/// How the bytes of a run's link come to the board.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum LinkWay {
    /// Over the emulated board's UART, and to the host board by a pipe: by the clock on the wall.
    #[default]
    Uart,
    /// Inside the plant exchange, in the board's virtual time: the run repeats to the byte, uploads
    /// included.
    Exchange,
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
    /// A replay says itself when missions take over.
    #[error("a recording is replayed with `--link uart` only")]
    CannotReplayInStep,
}

/// A running board of either kind. Dropping it ends it.
pub enum RunningBoard {
    /// A firmware in the emulator.
    Emulated(Box<Emulator>),
    /// A thread of this process.
    Host(HostBoard),
}

impl RunningBoard {
    /// Starts a board with `plant` behind its pins; answers it and its line, which goes the way of
    /// `link`.
    ///
    /// # Errors
    /// [`BoardError`]
    pub fn start(
        board: Board,
        plant: &PlantSide,
        replay: Option<&Entered>,
        link: LinkWay,
    ) -> Result<(Self, Box<dyn ByteLink>), BoardError> {
        if replay.is_some() {
            board.check_replay(link)?;
        }
        let flash_bytes = board.flash_bytes();
        match board {
            Board::Host { robot } if link == LinkWay::Exchange => {
                let (board, line) = HostBoard::start_in_step(robot, plant.clone())?;
                Ok((RunningBoard::Host(board), Box::new(line)))
            }
            Board::Emulated { firmware } => {
                let served = plant.clone();
                let flash = plant.flash(flash_bytes);
                let answer = move |request: &_| served.exchange(request);
                if link == LinkWay::Exchange {
                    let (near, line) = line::pair();
                    let emulator =
                        Emulator::start_linked(&firmware, Idle::Passes, answer, flash, Some(near))?;
                    return Ok((RunningBoard::Emulated(Box::new(emulator)), Box::new(line)));
                }
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
