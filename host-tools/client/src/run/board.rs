//! A board of either kind, from its name to its line.

use std::ops::Range;
use std::path::PathBuf;

use embedded_storage::nor_flash::NorFlash;
use rt_firmware::body::flash::ERASE_BYTES;
use rt_firmware::store::flash_store::{self, FlashStore};
use thiserror::Error;

use crate::flash::{Flash, InSectors};
use crate::host_board::{self, HostBoard, HostBoardError, RobotMaker};
use crate::link_client::log_lines::{LogReader, LogTableError};
use crate::lockstep::line;
use crate::lockstep::plant_side::PlantSide;
use crate::qemu::{ChipSerial, Emulator, EmulatorError, Idle, firmware};
use crate::serial::pacing::Paced;
use crate::serial::{ByteLink, DEFAULT_BAUD};
use esm_toolkit::boards;
use esm_toolkit::recording::entered::Entered;

/// Which board to run on.
pub enum Board {
    /// A firmware in an emulator.
    Emulated {
        /// Which board the emulator is of.
        board: &'static boards::Board,
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
    /// A firmware on the default board.
    ///
    /// # Panics
    /// Never: there is a default board.
    pub fn emulated(firmware: PathBuf) -> Self {
        let board = boards::find(boards::DEFAULT).expect("the default board is one of them");
        Board::Emulated { board, firmware }
    }

    /// Its name, as `--board` takes it.
    pub fn name(&self) -> &'static str {
        match self {
            Board::Emulated { board, .. } => board.name,
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
            (Board::Host { .. }, LinkWay::Exchange | LinkWay::Usb) => {
                Err(BoardError::CannotReplayInStep)
            }
            (Board::Host { .. }, LinkWay::Uart) => Ok(()),
        }
    }

    /// Whether its link can go this way.
    ///
    /// # Errors
    /// [`BoardError::NoUsb`]
    pub fn check_link(&self, link: LinkWay) -> Result<(), BoardError> {
        let has_usb = match self {
            Board::Emulated { board, .. } => firmware::about(board).script().is_some(),
            Board::Host { .. } => false,
        };
        if link == LinkWay::Usb && !has_usb {
            return Err(BoardError::NoUsb { board: self.name() });
        }
        Ok(())
    }

    /// What is erased at once in its flash.
    fn erase_bytes(&self) -> u32 {
        match self {
            Board::Emulated { board, .. } => firmware::about(board).flash.erase_bytes,
            Board::Host { .. } => ERASE_BYTES as u32,
        }
    }

    /// The longest mission in bytes.
    fn blob_bytes(&self) -> u32 {
        boards::find(self.name()).map_or(0, |board| board.capacities.blob_bytes)
    }

    /// Bytes of its flash for missions, records and a script, whether its firmware keeps one or
    /// not.
    pub fn flash_bytes(&self) -> u32 {
        flash_store::flash_bytes_with_script(self.blob_bytes(), self.erase_bytes())
    }

    /// Where in its flash the second copy of its records is.
    pub fn second_records(&self) -> Range<usize> {
        let erase_bytes = self.erase_bytes();
        let mission = flash_store::bank_bytes(self.blob_bytes(), erase_bytes);
        let records = flash_store::bank_bytes(flash_store::RECORD_BYTES as u32, erase_bytes);
        let from = (2 * mission + records) as usize;
        from..from + records as usize
    }

    /// A flash without missions, for a run: a robot that has one of its own waits for the run's.
    pub fn flash_of_a_run(&self) -> Flash {
        let flash = Flash::blank(self.flash_bytes());
        // Blank cells take it.
        let _ = match self.erase_bytes() {
            InSectors::<ERASE_BYTES>::BYTES => self.wait_for_host(flash.clone()),
            InSectors::<4096>::BYTES => self.wait_for_host(InSectors::<4096>(flash.clone())),
            // Where it would lie in others is not known.
            _ => None,
        };
        flash
    }

    /// Lets a robot with this flash wait for a mission.
    fn wait_for_host(&self, flash: impl NorFlash + Clone) -> Option<()> {
        let mut records = [0; flash_store::RECORD_BYTES];
        let keep = FlashStore::open(flash, self.blob_bytes(), None, &mut records);
        keep.ok()?.wait_for_host().ok()
    }

    /// What decodes its log.
    ///
    /// # Errors
    /// [`LogTableError`]: what is wrong with the firmware's file.
    pub fn log_reader(&self) -> Result<LogReader, LogTableError> {
        match self {
            Board::Emulated { firmware, .. } => LogReader::firmware(firmware),
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
    /// Over the USB of an emulated chip, in its virtual time, as [`Exchange`](Self::Exchange).
    Usb,
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
    /// Only an emulated chip has USB.
    #[error("the board `{board}` has no USB: leave `--link usb` out")]
    NoUsb {
        /// The board's name.
        board: &'static str,
    },
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
        board.check_link(link)?;
        let flash_bytes = board.flash_bytes();
        match board {
            Board::Host { robot } if link == LinkWay::Exchange => {
                let (board, line) = HostBoard::start_in_step(robot, plant.clone())?;
                Ok((RunningBoard::Host(board), Box::new(line)))
            }
            Board::Emulated { board, firmware } => {
                let served = plant.clone();
                let flash = plant.flash(flash_bytes);
                if firmware::about(board).script().is_some() {
                    // Its link always goes by the clock of the chip.
                    let (near, line) = line::pair();
                    let serial = match link {
                        LinkWay::Usb => ChipSerial::Usb,
                        LinkWay::Uart | LinkWay::Exchange => ChipSerial::Uart,
                    };
                    let emulator =
                        Emulator::start_chip(board, &firmware, served, flash, (serial, near))?;
                    return Ok((RunningBoard::Emulated(Box::new(emulator)), Box::new(line)));
                }
                let answer = move |request: &_| served.exchange(request);
                if link == LinkWay::Exchange {
                    let (near, line) = line::pair();
                    let idle = Idle::Passes;
                    let ends = (Some(near), plant.system());
                    let emulator =
                        Emulator::start_linked(board, &firmware, idle, answer, flash, ends)?;
                    return Ok((RunningBoard::Emulated(Box::new(emulator)), Box::new(line)));
                }
                let mut emulator = Emulator::start(board, &firmware, Idle::Passes, answer, flash)?;
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

#[cfg(test)]
mod tests {
    use embedded_storage::nor_flash::ReadNorFlash;

    use super::*;

    #[test]
    fn a_robot_in_a_run_waits_for_the_runs_mission_whatever_its_flash_erases_at_once() {
        for board in boards::all().filter(|board| board.firmware.is_some()) {
            let emulated = Board::Emulated {
                board,
                firmware: PathBuf::new(),
            };
            let mut flash = emulated.flash_of_a_run();
            assert_eq!(flash.capacity(), emulated.flash_bytes() as usize);
            let mut cells = vec![0; flash.capacity()];
            flash.read(0, &mut cells).unwrap();
            let written = cells.iter().position(|cell| *cell != 0xFF);
            assert!(written.is_some(), "{}", board.name);
        }
    }
}
