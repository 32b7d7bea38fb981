//! A mission that takes over on a processor during a run.

use std::path::PathBuf;
use std::str::FromStr;

use thiserror::Error;

use crate::cli::argument::Time;
use crate::cli::run::{Then, ThenError};

/// A mission that takes over on one of the processors.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ThenOn {
    /// Plant time.
    pub at: Time,
    /// The processor's name.
    pub processor: String,
    /// The mission.
    pub file: PathBuf,
}

/// Why a text is no [`ThenOn`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum ThenOnError {
    /// It does not start with a time, or nothing is behind it.
    #[error("{0}, and the processor between both, as in '5 s head missions/look.esm'")]
    Then(#[from] ThenError),
    /// No mission.
    #[error(
        "write a time, a processor and a mission, as in '5 s head missions/look.esm': one of them is missing"
    )]
    NoFile,
}

impl FromStr for ThenOn {
    type Err = ThenOnError;

    fn from_str(text: &str) -> Result<Self, ThenOnError> {
        let Then { at, file } = text.parse()?;
        let rest = file.to_string_lossy();
        let (processor, file) = rest
            .split_once(char::is_whitespace)
            .ok_or(ThenOnError::NoFile)?;
        Ok(ThenOn {
            at,
            processor: processor.to_owned(),
            file: file.trim().into(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_has_a_time_a_processor_and_a_file() {
        let then: ThenOn = "5 s head  missions/look here.esm".parse().unwrap();
        assert_eq!((then.at.us, then.processor.as_str()), (5_000_000, "head"));
        assert_eq!(then.file, PathBuf::from("missions/look here.esm"));
        for wrong in ["", "5 s", "5 s head", "head look.esm", "5 head look.esm"] {
            assert!(wrong.parse::<ThenOn>().is_err(), "{wrong}");
        }
    }
}
