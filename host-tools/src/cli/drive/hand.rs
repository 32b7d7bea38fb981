//! Who sends movements to the robot, again and again, in a thread of its own: a robot that does not
//! answer must not keep a person from quitting.

use std::fmt;
use std::io;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use esm_link::message::LinkError;
use rt_firmware::tasks::Twist;

use crate::cli::exit::CommandError;
use crate::cli::robot::Robot;
use crate::link_client::ClientError;
use crate::link_client::behaviours::Pilot;

/// Time between two movements that are sent. Two may get lost, and the robot drives on.
const INTERVAL: Duration = Duration::from_millis(100);

/// What came of the movements so far.
#[derive(Clone, Copy, Debug, Default)]
pub struct Told {
    /// How many were sent.
    sent: u64,
    /// How many came too late, and were refused.
    late: u64,
    /// How long the last one took until it was answered.
    took: Option<Duration>,
    /// The last one came too late.
    was_late: bool,
}

impl Told {
    /// Whether the robot does what it is told.
    pub fn is_good(&self) -> bool {
        !self.was_late
    }
}

impl fmt::Display for Told {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            sent,
            late,
            took,
            was_late,
        } = self;
        if *was_late {
            write!(
                f,
                "the line is too slow: movements come later than they hold, and the robot stands still"
            )?;
        } else if let Some(took) = took {
            write!(f, "answered after {} ms", took.as_millis())?;
        } else {
            write!(f, "nothing sent yet")?;
        }
        write!(f, "; {sent} movements sent, {late} of them too late")
    }
}

/// What both threads know.
#[derive(Default)]
struct Shared {
    state: Mutex<State>,
    /// The wish has changed.
    changed: Condvar,
}

#[derive(Default)]
struct State {
    wanted: Option<Twist>,
    is_over: bool,
    has_ended: bool,
    told: Told,
}

impl Shared {
    fn state(&self) -> MutexGuard<'_, State> {
        // Nothing is done to it that could end in between.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The thread that sends.
pub struct Hand {
    shared: Arc<Shared>,
    thread: JoinHandle<Result<(), ClientError>>,
}

impl Hand {
    /// Steers this robot from now on.
    ///
    /// # Errors
    /// What the system says of another thread.
    pub fn start(mut robot: Robot) -> io::Result<Self> {
        let shared = Arc::new(Shared::default());
        let of_thread = Arc::clone(&shared);
        let thread = std::thread::Builder::new()
            .name("steering".to_owned())
            .spawn(move || {
                let result = send(&mut robot, &of_thread);
                of_thread.state().has_ended = true;
                result
            })?;
        Ok(Self { shared, thread })
    }

    /// From now on the robot is to move like this; with none, it is not steered.
    pub fn ask(&self, wanted: Option<Twist>) {
        let mut state = self.shared.state();
        if state.wanted != wanted {
            state.wanted = wanted;
            self.shared.changed.notify_one();
        }
    }

    /// Whether nothing is sent any more.
    pub fn has_ended(&self) -> bool {
        self.shared.state().has_ended
    }

    /// What came of it so far.
    pub fn told(&self) -> Told {
        self.shared.state().told
    }

    /// Steers no more.
    ///
    /// # Errors
    /// Why nothing could be sent any more.
    pub fn end(self) -> Result<(), CommandError> {
        {
            let mut state = self.shared.state();
            (state.wanted, state.is_over) = (None, true);
            self.shared.changed.notify_one();
        }
        match self.thread.join() {
            Ok(result) => Ok(result?),
            // It has said why.
            Err(_) => Err(CommandError::Told),
        }
    }
}

fn send(robot: &mut Robot, shared: &Shared) -> Result<(), ClientError> {
    let mut pilot = Pilot::default();
    let mut is_driving = false;
    loop {
        let (wanted, is_over) = {
            let state = shared.state();
            (state.wanted, state.is_over)
        };
        let began = Instant::now();
        match wanted {
            Some(twist) => {
                is_driving = true;
                let driven = pilot.drive(robot, twist);
                let was_late = match &driven {
                    Err(error) if error.refusal() == Some(LinkError::Late) => true,
                    Err(_) => return driven,
                    Ok(()) => false,
                };
                let told = &mut shared.state().told;
                told.sent += 1;
                told.late += u64::from(was_late);
                (told.took, told.was_late) = (Some(began.elapsed()), was_late);
            }
            None if is_driving => {
                is_driving = false;
                robot.end_drive()?;
            }
            None => {}
        }
        if is_over && !is_driving {
            return Ok(());
        }
        let wait = INTERVAL.saturating_sub(began.elapsed());
        let is_same = |state: &mut State| state.wanted == wanted && !state.is_over;
        let waited = (shared.changed).wait_timeout_while(shared.state(), wait, is_same);
        drop(waited);
    }
}
