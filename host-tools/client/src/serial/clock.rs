//! The clock by which the bytes of a line come.
//!
//! On a wire that is the clock on the wall. Inside a simulation bytes come at simulated times,
//! however long this machine takes over them, and who talks over such a line must wait by the same
//! clock, or no two runs are the same.

use std::fmt;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Time that passes in a simulation.
pub trait SimulatedTime: Send + Sync {
    /// What has passed since the simulation began.
    fn elapsed(&self) -> Duration;

    /// Lets so much of it pass; less where the simulation ends.
    fn pause(&self, time: Duration);
}

/// A clock. Its instants compare with each other, and with those of no other clock.
#[derive(Clone)]
pub struct Clock {
    origin: Instant,
    simulated: Option<Arc<dyn SimulatedTime>>,
}

impl Clock {
    /// The clock on the wall.
    pub fn wall() -> Self {
        Clock {
            origin: Instant::now(),
            simulated: None,
        }
    }

    /// The clock of a simulation.
    pub fn simulated(time: Arc<dyn SimulatedTime>) -> Self {
        Clock {
            origin: Instant::now(),
            simulated: Some(time),
        }
    }

    /// What it shows.
    pub fn now(&self) -> Instant {
        match &self.simulated {
            None => Instant::now(),
            Some(time) => self.origin + time.elapsed(),
        }
    }

    /// What has passed on it since `then`.
    pub fn since(&self, then: Instant) -> Duration {
        self.now().saturating_duration_since(then)
    }

    /// Lets so much of its time pass.
    pub fn pause(&self, time: Duration) {
        match &self.simulated {
            None => std::thread::sleep(time),
            Some(simulated) => simulated.pause(time),
        }
    }

    /// Whether runs by this clock repeat, so that nothing may enter them that is this process's
    /// own.
    pub fn is_simulated(&self) -> bool {
        self.simulated.is_some()
    }
}

impl fmt::Debug for Clock {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self.simulated {
            None => "Clock::wall",
            Some(_) => "Clock::simulated",
        })
    }
}
