//! What a command can end with.

use std::fmt;
use std::io;
use std::process::ExitCode;

/// The exit status of the `esm` command. Scripts rely on the numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum ExitStatus {
    /// All was done.
    Done = 0,
    /// The input has errors, or an expectation failed.
    BadInput = 1,
    /// The command line makes no sense.
    WrongUsage = 2,
    /// The outside world failed: no port, no emulator, link lost, disk full.
    WorldFailed = 3,
}

impl From<ExitStatus> for ExitCode {
    fn from(status: ExitStatus) -> Self {
        ExitCode::from(status as u8)
    }
}

/// Why a command did not end well. One variant an exit status, so that whoever makes one says whose
/// fault it is.
#[derive(Debug)]
pub enum CommandError {
    /// The input has errors or an expectation failed; the command has said so already, in full.
    Told,
    /// The input has errors.
    Input(anyhow::Error),
    /// The command line makes no sense in a way that the argument parser cannot see.
    Usage(anyhow::Error),
    /// The outside world failed.
    World(anyhow::Error),
    /// Whoever read the output has closed it (`esm … | head`): nothing is wrong, and there is
    /// nobody to tell.
    NobodyListens,
}

impl CommandError {
    /// The exit status that this error stands for.
    pub fn status(&self) -> ExitStatus {
        match self {
            CommandError::Told | CommandError::Input(_) => ExitStatus::BadInput,
            CommandError::Usage(_) => ExitStatus::WrongUsage,
            CommandError::World(_) => ExitStatus::WorldFailed,
            CommandError::NobodyListens => ExitStatus::Done,
        }
    }

    /// What a person is to read, where the command has not said it already.
    pub fn message(&self) -> Option<&anyhow::Error> {
        match self {
            CommandError::Input(error)
            | CommandError::Usage(error)
            | CommandError::World(error) => Some(error),
            CommandError::Told | CommandError::NobodyListens => None,
        }
    }
}

impl fmt::Display for CommandError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.message() {
            Some(error) => write!(f, "{error:#}"),
            None => Ok(()),
        }
    }
}

/// Writing to standard output failed: either nobody listens any more, or the world is broken.
impl From<io::Error> for CommandError {
    fn from(error: io::Error) -> Self {
        match error.kind() {
            io::ErrorKind::BrokenPipe => CommandError::NobodyListens,
            _ => CommandError::World(anyhow::Error::new(error)),
        }
    }
}
