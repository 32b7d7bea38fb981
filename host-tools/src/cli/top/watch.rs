//! The robot read in a thread of its own, so that a request that waits for its answer keeps nobody from pressing a key. A robot that does not answer
//! is looked for until it does.

use std::sync::mpsc::{self, Receiver, RecvTimeoutError, Sender, TryRecvError};
use std::time::{Duration, Instant};

use anyhow::anyhow;

use crate::cli::robot::{Robot, RobotArgs};
use crate::link_client::RobotInfo;
use crate::reading::{Reader, Reading, Tasks};

/// How long to wait before a robot that was lost is looked for again.
const RETRY_WAIT: Duration = Duration::from_secs(1);

/// What came from the robot.
pub enum News {
    /// A reading.
    Read(Box<Reading>),
    /// The robot is there again, and says this of itself.
    Found(RobotInfo),
    /// It does not answer, and why.
    Lost(String),
}

/// A robot that is read again and again, until this is dropped.
pub struct Watch {
    news: Receiver<News>,
    /// Index of the slot whose tasks are of interest. Its end ends the thread.
    wanted: Sender<usize>,
}

impl Watch {
    /// Reads this robot once in each `interval`, and finds it again by `port`.
    ///
    /// # Errors
    /// What the system says, where it gives no thread.
    pub fn start(port: RobotArgs, robot: Robot, interval: Duration) -> std::io::Result<Self> {
        let (teller, news) = mpsc::channel();
        let (wanted, wishes) = mpsc::channel();
        // Nobody waits for its end: it may be in the middle of a request.
        std::thread::Builder::new()
            .name("watch".into())
            .spawn(move || watch(&port, robot, interval, &wishes, &teller))?;
        Ok(Watch { news, wanted })
    }

    /// The tasks of this slot are of interest.
    pub fn look_at(&self, slot: usize) {
        // Should the thread have ended, `news` says so.
        let _ = self.wanted.send(slot);
    }

    /// What came since the last call, one thing after another.
    ///
    /// # Errors
    /// Nothing will come any more.
    pub fn news(&self) -> anyhow::Result<Option<News>> {
        match self.news.try_recv() {
            Ok(news) => Ok(Some(news)),
            Err(TryRecvError::Empty) => Ok(None),
            Err(TryRecvError::Disconnected) => Err(anyhow!(
                "what reads the robot has failed; its message is above"
            )),
        }
    }
}

/// Reads until nobody listens.
fn watch(
    port: &RobotArgs,
    robot: Robot,
    interval: Duration,
    wishes: &Receiver<usize>,
    teller: &Sender<News>,
) {
    let mut robot = Some(robot);
    let mut reader = Reader::default();
    let mut slot = 0;
    loop {
        let began = Instant::now();
        let news = match &mut robot {
            Some(found) => match reader.read(found, Tasks::OfSlot(slot)) {
                Ok(reading) => News::Read(Box::new(reading)),
                Err(error) => {
                    // Its line is closed before it is opened again.
                    robot = None;
                    News::Lost(error.to_string())
                }
            },
            None => match port.connect() {
                Ok((found, info)) => {
                    robot = Some(found);
                    News::Found(info)
                }
                Err(error) => News::Lost(error.to_string()),
            },
        };
        let wait = match &news {
            News::Read(_) => interval.saturating_sub(began.elapsed()),
            News::Found(_) => Duration::ZERO,
            News::Lost(_) => RETRY_WAIT,
        };
        if teller.send(news).is_err() {
            return;
        }
        match wishes.recv_timeout(wait) {
            // Of several wishes the last one counts.
            Ok(wish) => slot = wishes.try_iter().last().unwrap_or(wish),
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => return,
        }
    }
}
