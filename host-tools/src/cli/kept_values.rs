//! Whether a recording keeps values, and how often: for the commands that record.

use std::time::Duration;

use clap::Args;

use super::argument::Time;

/// Time of the mission from one sample to the next, where none is said.
pub const PERIOD: Duration = Duration::from_millis(100);

/// What a recording keeps of the values on the mission's nets.
#[derive(Clone, Copy, Debug, Default, Args)]
pub struct KeptValues {
    /// How often the recording keeps the values on the nets (poses, twists, ranges and others): a
    /// sample each TIME of the mission's at most; with '0 s' after each macro step [default:
    /// 100 ms]
    #[arg(long, value_name = "TIME", requires = "record")]
    pub sample: Option<Time>,

    /// Keeps no values in the recording
    #[arg(long, requires = "record", conflicts_with = "sample")]
    pub no_values: bool,
}

impl KeptValues {
    /// Time from one sample to the next; none where there are none.
    pub fn period(&self) -> Option<Duration> {
        let period = (self.sample).map_or(PERIOD, |sample| Duration::from_micros(sample.us));
        (!self.no_values).then_some(period)
    }
}
