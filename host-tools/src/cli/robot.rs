//! A robot at the other end of a line, as several commands reach it.

use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};
use std::time::Duration;

use clap::Args;
use esm_link::access::Access;
use esm_link::features::Feature;
use esm_link::message::{Mode, Status};
use thiserror::Error;

use super::argument::Port;
use super::console::{self, Console};
use super::exit::CommandError;
use crate::keys::{self, SigningKey};
use crate::link_client::{ClientError, KeyLoader, LinkClient, NOISY_DEADLINE, RobotInfo};
use crate::ports::{self, FindError};
use crate::reading::ReadError;
use crate::run::interrupt::{self, Interrupt};
use crate::run::mission::hash_text;
use crate::run::story;
use crate::serial::noise::{Noise, Noisy};
use crate::serial::takeover::NotServed;
use crate::serial::{self, ByteLink, OpenError, Opened};

/// Where a robot is.
#[derive(Clone, Debug, Args)]
pub struct RobotArgs {
    /// Where the robot is: a serial line, unix:PATH or tcp:HOST:PORT [default: the only robot that
    /// is plugged in]
    #[arg(long, value_name = "PORT")]
    pub port: Option<Port>,

    /// Where it was found, if no port was named. A command that connects again goes there.
    #[arg(skip)]
    found: Arc<OnceLock<Port>>,

    /// The key that the robot has, if it has one [default: esm/key in the folder for configuration,
    /// ~/.config]
    #[arg(long, value_name = "FILE", env = KEY_VARIABLE)]
    pub key: Option<PathBuf>,

    #[command(flatten)]
    #[allow(missing_docs, reason = "carries the documentation of its arguments")]
    pub line: LineArgs,
}

/// Names the key of those who name none on the command line.
pub(super) const KEY_VARIABLE: &str = "ESM_KEY";

/// Whether a key was named on the command line. What the environment names is for all robots, those
/// without a key among them.
pub(super) fn is_named(key: Option<&Path>) -> bool {
    let of_environment = std::env::var_os(KEY_VARIABLE);
    key.is_some_and(|key| of_environment.is_none_or(|of_all| key.as_os_str() != of_all))
}

/// How fast a robot's line is.
#[derive(Clone, Copy, Debug, Args)]
pub struct LineArgs {
    /// Bits per second on the robot's line; an emulated one is paced to it
    #[arg(long, value_name = "RATE", default_value_t = serial::DEFAULT_BAUD, value_parser = clap::value_parser!(u32).range(300..))]
    pub baud: u32,

    /// Spoils so much of all bytes on the line, 0 to 1, in both directions: corrupts, drops and
    /// doubles some, the same ones each time. To see what becomes of it
    #[arg(long, value_name = "PART", hide_short_help = true, value_parser = noise)]
    pub line_noise: Option<Noise>,
}

/// Seed of the noise on a line.
const NOISE_SEED: u64 = 1;

/// Reads which part of all bytes suffers.
pub(super) fn noise(text: &str) -> Result<Noise, String> {
    const KINDS: f64 = 3.0;
    match text.parse::<f64>() {
        Ok(part) if (0.0..=1.0).contains(&part) => Ok(Noise::of_each(
            (part / KINDS * f64::from(Noise::WHOLE)) as u32,
        )),
        _ => Err("a part is a number from 0 to 1, such as 0.01".to_owned()),
    }
}

/// A session with a robot on some line.
pub type Robot = LinkClient<Box<dyn ByteLink>>;

impl RobotArgs {
    /// Opens the line and begins a session.
    ///
    /// # Errors
    /// What is wrong with the port, or with the robot behind it.
    pub fn connect(&self, console: &mut Console) -> Result<(Robot, RobotInfo), CommandError> {
        self.find(&mut |told| console.note(told))?;
        let (mut robot, info, not_served) = self.begin()?;
        tell(not_served.as_ref(), console);
        warn(info.access, console);
        if is_named(self.key.as_deref()) {
            robot.insist_on_key();
        }
        Ok((robot, info))
    }

    /// As [`RobotArgs::connect`], for the command that gives a robot what it is to do: it says,
    /// too, if anyone may.
    ///
    /// # Errors
    /// What is wrong with the port, or with the robot behind it.
    pub fn connect_to_upload(
        &self,
        console: &mut Console,
    ) -> Result<(Robot, RobotInfo), CommandError> {
        let (robot, info) = self.connect(console)?;
        if let Some(warning) = no_owner(info.access) {
            console.note(warning);
        }
        Ok((robot, info))
    }

    /// Opens the line, which is taken over from whoever has it, and lets a stop be the first that
    /// the robot hears, whatever else is the matter with it.
    ///
    /// # Errors
    /// What is wrong with the port, or with the robot behind it.
    pub fn connect_to_stop(
        &self,
        is_emergency: bool,
        console: &mut Console,
    ) -> Result<Robot, CommandError> {
        Interrupt::take_over()?;
        let port = self.find(&mut |told| console.note(told))?;
        let opened = serial::open_to_stop(port, self.line.baud);
        let (link, not_served) = line_of(opened, self.line)?;
        let (mut robot, info) = LinkClient::connect_to_stop(
            link,
            is_emergency,
            Some(LONGEST_WAITS),
            until_interrupt(),
        )?;
        robot.end_when(Some(Box::new(interrupt::is_overdue)));
        tell(not_served.as_ref(), console);
        warn(info.access, console);
        robot.use_key(key_at(self.key.as_deref()));
        if is_named(self.key.as_deref()) {
            robot.insist_on_key();
        }
        Ok(robot)
    }

    /// The same, without a word on who may command this robot.
    ///
    /// # Errors
    /// What is wrong with the port, or with the robot behind it.
    pub fn connect_quietly(&self) -> Result<(Robot, RobotInfo), CommandError> {
        let (robot, info, _) = self.begin()?;
        Ok((robot, info))
    }

    /// The port that was named, or else that of the only robot that is plugged in, which `tell` is
    /// told when it is found.
    ///
    /// # Errors
    /// There is no such robot, or there are several.
    fn find(&self, tell: &mut dyn FnMut(&str)) -> Result<&Port, CommandError> {
        if let Some(port) = self.port.as_ref().or(self.found.get()) {
            return Ok(port);
        }
        Interrupt::take_over()?;
        let found = ports::find_robot(self.line.baud)?;
        tell(&format!(
            "took {}, the only port that may be meant: {}",
            found.listed.port(),
            found.behind
        ));
        Ok(self.found.get_or_init(|| found.listed.port()))
    }

    fn begin(&self) -> Result<(Robot, RobotInfo, Option<NotServed>), CommandError> {
        let port = self.find(&mut console::warn)?;
        let (mut robot, info, not_served) = open(port, self.line)?;
        // Whoever names a key counts on it.
        if is_named(self.key.as_deref()) && info.access == Access::Unsupported {
            return Err(ClientError::NotBuiltIn {
                feature: Feature::Keys,
            }
            .into());
        }
        robot.use_key(key_at(self.key.as_deref()));
        Ok((robot, info, not_served))
    }
}

/// Reads the key in that file, or in the one of those who name none, as soon as a robot asks for
/// it.
pub fn key_at(named: Option<&Path>) -> KeyLoader {
    let named = named.map(Path::to_owned);
    Box::new(move || SigningKey::read(&keys::path(named.as_deref())?))
}

/// Opens the line at `port` and begins a session.
///
/// # Errors
/// What is wrong with the port, or with the robot behind it.
pub fn connect(
    port: &Port,
    line: LineArgs,
    console: &mut Console,
) -> Result<(Robot, RobotInfo), CommandError> {
    let (robot, info, not_served) = open(port, line)?;
    tell(not_served.as_ref(), console);
    warn(info.access, console);
    Ok((robot, info))
}

fn open(
    port: &Port,
    line: LineArgs,
) -> Result<(Robot, RobotInfo, Option<NotServed>), CommandError> {
    // From here on, so that Ctrl-C ends each wait, also where whoever started this program has it
    // ignored.
    Interrupt::take_over()?;
    let (line, not_served) = line_of(serial::open_served(port, line.baud), line)?;
    let limit = Some(LONGEST_WAITS);
    let (mut robot, info) = LinkClient::connect_within(line, limit, until_interrupt())?;
    robot.end_when(Some(Box::new(interrupt::is_overdue)));
    Ok((robot, info, not_served))
}

/// A line that was opened, and why a stop cannot take it over, if it cannot.
fn line_of(
    opened: Result<Opened, OpenError>,
    line: LineArgs,
) -> Result<(Box<dyn ByteLink>, Option<NotServed>), CommandError> {
    let opened = opened.map_err(|error| CommandError::World(error.into()))?;
    let link: Box<dyn ByteLink> = match line.line_noise {
        Some(noise) => Box::new(Noisy::new(opened.line, noise, NOISE_SEED)),
        None => opened.line,
    };
    Ok((link, opened.not_served))
}

/// Tells that a stop cannot take the port over from this command.
fn tell(not_served: Option<&NotServed>, console: &mut Console) {
    if let Some(why) = not_served {
        console.note(&format!(
            "`esm stop` cannot take the port over from this command: {why}"
        ));
    }
}

/// Until Ctrl-C.
fn until_interrupt() -> Option<Box<dyn Fn() -> bool + Send>> {
    Some(Box::new(interrupt::is_requested))
}

/// How long all requests of a command together may wait for a robot, where it does not do more than
/// ask: beyond that the robot does not mean to answer.
pub const LONGEST_WAITS: Duration = NOISY_DEADLINE;

/// How long a robot may take to hear that a command ends, when the person wants that at once: with
/// [`LONGEST_HOLD`] before it, less than a second.
const LONGEST_FAREWELL: Duration = Duration::from_millis(500);

/// How long a command goes on behind Ctrl-C with something that should not be left in doubt.
const LONGEST_HOLD: Duration = Duration::from_millis(300);

/// Lets a robot hear, still, that a command ends: not for long after Ctrl-C.
pub fn end_soon(robot: &mut Robot) {
    robot.stop_when(None);
    if interrupt::is_requested() {
        robot.limit_waits(Some(LONGEST_FAREWELL));
    }
}

/// Lets a robot have its time for something of which nobody should be in doubt whether it was done:
/// also after Ctrl-C, but then not for long.
pub fn hold_out(robot: &mut Robot) {
    let clock = robot.clock().clone();
    let seen = OnceLock::new();
    robot.stop_when(Some(Box::new(move || {
        interrupt::is_requested() && clock.since(*seen.get_or_init(|| clock.now())) >= LONGEST_HOLD
    })));
}

/// Tells who may command a robot, where that is not as it should be.
fn warn(access: Access, console: &mut Console) {
    if let Some(warning) = warning(access) {
        console.note(warning);
    }
}

/// What is to be said of a robot that does as anyone says: where it gets a mission, and not with
/// each command.
fn no_owner(access: Access) -> Option<&'static str> {
    match access {
        Access::Unsupported => {
            Some("this robot takes commands from anyone: its firmware has no room for a key")
        }
        Access::Open => Some("this robot takes commands from anyone: `esm key install`"),
        Access::Locked | Access::Recovering | Access::Damaged | Access::Unreadable => None,
    }
}

/// What is to be said of a robot that takes no commands any more.
fn warning(access: Access) -> Option<&'static str> {
    match access {
        Access::Unsupported | Access::Open | Access::Locked => None,
        Access::Recovering => Some(
            "this robot takes no commands but `esm stop`: its memory is damaged; `esm key install` by its owner begins it anew",
        ),
        Access::Damaged => Some(
            "this robot takes no commands but `esm stop`: its memory is damaged; `esm key install` begins it anew",
        ),
        Access::Unreadable => Some(
            "this robot takes no commands but `esm stop`: its key cannot be read, its memory is damaged",
        ),
    }
}

/// What went wrong on the line to a robot, in the words of a command that knows what that means for
/// the robot.
#[derive(Debug, Error)]
#[error("{said}")]
pub struct OnTheLine {
    /// What went wrong.
    pub cause: ClientError,
    /// The words, the cause among them.
    pub said: String,
}

/// Whether it was the line that failed, so that the robot need not be asked anything more.
pub fn has_lost_robot(error: &CommandError) -> bool {
    let CommandError::World(error) = error else {
        return false;
    };
    let told = error.downcast_ref::<OnTheLine>().map(|told| &told.cause);
    matches!(
        told.or_else(|| error.downcast_ref()),
        Some(ClientError::Line(_) | ClientError::NoReply { .. })
    )
}

/// Whether `esm stop` has taken the line over.
pub fn is_taken_over(error: &CommandError) -> bool {
    let CommandError::World(error) = error else {
        return false;
    };
    let line = error.downcast_ref::<ClientError>();
    matches!(line, Some(ClientError::Line(line)) if serial::wire::is_taken_over(line))
}

/// What a robot does, for a person whose command has ended early.
pub fn what_runs(status: &Status) -> String {
    match (status.mode, status.mission) {
        (Mode::Running, Some(mission)) => format!("the robot goes on with {}", hash_text(mission)),
        (Mode::Stopped, Some(mission)) => {
            format!(
                "the robot is stopped, its mission is {}",
                hash_text(mission)
            )
        }
        (Mode::EmergencyStopped, _) => {
            "an emergency stop is latched on the robot: `esm start --release`".to_owned()
        }
        (Mode::Safe(reason), _) => {
            format!(
                "the robot is in its safe state: {}",
                story::safe_reason(reason)
            )
        }
        _ => "the robot has no mission".to_owned(),
    }
}

/// What a robot does that went back to the mission before the one on trial.
pub fn is_back(status: &Status) -> String {
    let Some(mission) = status.mission.map(hash_text) else {
        return "there was no mission before, its motors are off".to_owned();
    };
    match status.mode {
        Mode::Running | Mode::Empty => format!("{mission} runs again, from its beginning"),
        Mode::Stopped => format!("{mission} is its mission again, and it is stopped: `esm start`"),
        Mode::EmergencyStopped | Mode::Safe(_) => {
            format!("{mission} is its mission again; {}", what_runs(status))
        }
    }
}

/// A robot that refuses has been given something that it cannot take; all else is the outside
/// world.
impl From<ClientError> for CommandError {
    fn from(error: ClientError) -> Self {
        match error {
            ClientError::Refused { .. }
            | ClientError::MayBeDone { .. }
            | ClientError::OtherKey { .. }
            | ClientError::NotBuiltIn { .. } => CommandError::Input(error.into()),
            _ => CommandError::World(error.into()),
        }
    }
}

/// A robot that is not there, or not alone, is the outside world's.
impl From<FindError> for CommandError {
    fn from(error: FindError) -> Self {
        CommandError::World(error.into())
    }
}

impl From<ReadError> for CommandError {
    fn from(error: ReadError) -> Self {
        match error {
            ReadError::Client(error) => error.into(),
            ReadError::Blob(_) => CommandError::Input(error.into()),
        }
    }
}
