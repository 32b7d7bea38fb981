//! `esm values`: what is on the nets of the mission that a robot runs, while it drives.

use std::io::Write;
use std::time::Duration;

use anyhow::anyhow;
use clap::Args;
use esm_link::features::Feature;
use esm_link::message::Mode;
use esm_link::telemetry::MAX_VALUE_WORDS;
use serde::Serialize;
use serde::ser::{SerializeMap, Serializer};

use super::argument::Time;
use super::console::Console;
use super::exit::CommandError;
use super::robot::{self, LONGEST_WAITS, Robot, RobotArgs};
use crate::nearest::nearest;
use crate::reading::ReadError;
use crate::run::interrupt::Interrupt;
use crate::run::mission::hash_text;
use crate::values::{Catalogue, Reading, Subscription, Text, Told, ValuesError, Watched, words_of};

/// How long a wait for the next sample may last before Ctrl-C is looked for.
const LISTEN_TIME: Duration = Duration::from_millis(100);

/// How long the first sample is waited for, where it is the only one.
const SAMPLE_WAIT: Duration = Duration::from_secs(10);

/// Shows the values on the nets of the mission that a robot runs, while it drives
///
/// A net goes by the port of a task state that is on it: the path of the state, a dot, the port.
/// All values of a sample were on their nets at the same time, between two macro steps.
/// Without --every, they are shown once; without names, those of all nets. Samples that the robot
/// has no room for are counted and said; neither its slots nor requests to it wait for them.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  esm values --port /dev/ttyUSB0
  esm values position/Track.pose --port /dev/ttyUSB0 --every '100 ms'
  esm values position/Track.pose wheels/Drive.twist --port /dev/ttyUSB0 --every '0 s' --json")]
pub struct ValuesArgs {
    /// The nets, each by a port that is on it. All of them without
    #[arg(value_name = "NET", value_delimiter = ',')]
    pub nets: Vec<String>,

    #[command(flatten)]
    #[allow(missing_docs, reason = "carries the documentation of its arguments")]
    pub robot: RobotArgs,

    /// Goes on until Ctrl-C, with a sample each TIME of the mission's at most; with '0 s' after
    /// each macro step
    #[arg(long, value_name = "TIME")]
    pub every: Option<Time>,

    /// One JSON object a sample, for programs
    #[arg(long)]
    pub json: bool,
}

/// A sample, in the form of its JSON.
#[derive(Serialize)]
struct Sample<'a> {
    /// Hash of the mission.
    mission: String,
    /// When it was, since the mission started.
    t_us: u64,
    values: Values<'a>,
}

/// Values by the names of their nets; null where a net holds none.
struct Values<'a>(&'a [(String, Watched)], &'a Reading);

impl Serialize for Values<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let Values(nets, reading) = self;
        let mut map = serializer.serialize_map(Some(nets.len()))?;
        for ((name, watched), values) in nets.iter().zip(&reading.values) {
            let text = values.as_ref().map(|values| Text {
                fields: &watched.fields,
                values,
            });
            map.serialize_entry(name, &text)?;
        }
        map.end()
    }
}

/// Runs the command.
///
/// # Errors
/// What kept it from ending well.
pub fn execute(args: &ValuesArgs, console: &mut Console) -> Result<(), CommandError> {
    let interrupt = Interrupt::take_over()?;
    let (mut robot, _) = args.robot.connect(console)?;
    robot.require(Feature::Telemetry)?;
    let ended = show(args, &mut robot, &interrupt, console);
    let ended = match ended {
        Err(CommandError::World(_)) if interrupt.is_requested() => Ok(()),
        ended => ended,
    };
    robot::end_soon(&mut robot);
    // Should the robot have gone meanwhile, there is nothing left to end.
    let _ = robot.end_values();
    ended
}

fn show(
    args: &ValuesArgs,
    robot: &mut Robot,
    interrupt: &Interrupt,
    console: &mut Console,
) -> Result<(), CommandError> {
    let Some(every) = args.every else {
        let catalogue = read(robot)?;
        for group in wanted_groups(&catalogue, &args.nets)? {
            let mission = catalogue.mission;
            show_once(robot, mission, group, args.json, interrupt, console)?;
        }
        return Ok(());
    };
    let period = Duration::from_micros(every.us);
    loop {
        let catalogue = read(robot)?;
        let nets = wanted(&catalogue, &args.nets)?;
        follow(
            robot,
            catalogue.mission,
            nets,
            period,
            args.json,
            interrupt,
            console,
        )?;
        if interrupt.is_requested() {
            return Ok(());
        }
        robot.limit_waits(Some(LONGEST_WAITS));
        console.note("the mission is another one");
    }
}

/// The nets of the mission that runs.
///
/// # Errors
/// The robot does not say.
pub fn read(robot: &mut Robot) -> Result<Catalogue, CommandError> {
    let blob = robot.running_blob()?;
    let blob = esm_core::verify(blob).map_err(|(_, refusal)| ReadError::Blob(refusal))?;
    Ok(Catalogue::read(robot, &blob)?)
}

/// Nets with the names that they are called by here.
pub type Named = Vec<(String, Watched)>;

/// The nets that a person wants to see; without names all.
fn wanted(catalogue: &Catalogue, names: &[String]) -> Result<Named, CommandError> {
    if names.is_empty() {
        let groups = catalogue.groups().into_iter().flatten();
        return Ok(groups.map(by_first_name).collect());
    }
    names.iter().map(|name| find(catalogue, name)).collect()
}

/// The same in groups of which each fits into a sample.
fn wanted_groups(catalogue: &Catalogue, names: &[String]) -> Result<Vec<Named>, CommandError> {
    if names.is_empty() {
        let groups = catalogue.groups().into_iter();
        return Ok(groups
            .map(|group| group.into_iter().map(by_first_name).collect())
            .collect());
    }
    Ok(vec![wanted(catalogue, names)?])
}

fn by_first_name(watched: Watched) -> (String, Watched) {
    (watched.net.name().to_owned(), watched)
}

fn find(catalogue: &Catalogue, name: &str) -> Result<(String, Watched), CommandError> {
    let Some(watched) = catalogue.find(name) else {
        let names = catalogue.nets.iter().flat_map(|watched| &watched.net.names);
        let hint = match nearest(name, names.map(String::as_str)) {
            Some(near) => format!("did you mean `{near}`?"),
            None => {
                let names: Vec<&str> = (catalogue.nets.iter())
                    .map(|watched| watched.net.name())
                    .collect();
                format!("it has {}", names.join(", "))
            }
        };
        return Err(CommandError::Input(anyhow!(
            "the mission that runs has no net with the port `{name}` (a port is on a net where a `path` leads from it or to it); {hint}"
        )));
    };
    if watched.fields.is_empty() {
        return Err(CommandError::Input(anyhow!(
            "the robot does not say what a `{}` is made of: say it with `fields!` where its firmware has the type",
            watched.net.type_name
        )));
    }
    Ok((name.to_owned(), watched.clone()))
}

/// Shows one sample.
fn show_once(
    robot: &mut Robot,
    mission: u32,
    nets: Named,
    json: bool,
    interrupt: &Interrupt,
    console: &mut Console,
) -> Result<(), CommandError> {
    let subscription = begin(robot, mission, &nets, Duration::ZERO)?;
    tell_clock(json, console);
    match first(robot, &subscription, interrupt)? {
        Some(reading) => print(mission, &nets, &reading, json, console),
        None => Ok(()),
    }
}

/// The first sample that comes; none where Ctrl-C was pressed before.
///
/// # Errors
/// None comes, or the mission is another one by then.
pub fn first(
    robot: &mut Robot,
    subscription: &Subscription,
    interrupt: &Interrupt,
) -> Result<Option<Reading>, CommandError> {
    let begun = robot.clock().now();
    while !interrupt.is_requested() {
        robot.attend(LISTEN_TIME)?;
        for event in robot.take_events() {
            match subscription.read(&event) {
                Some(Told::Sample(reading)) => return Ok(Some(reading)),
                Some(Told::Ended) => {
                    return Err(CommandError::World(anyhow!(
                        "the robot changed its mission meanwhile; ask again"
                    )));
                }
                Some(Told::Gap(_)) | None => {}
            }
        }
        if robot.clock().since(begun) > SAMPLE_WAIT {
            return Err(CommandError::World(anyhow!(
                "the robot sends no values; `esm status` says how it is"
            )));
        }
    }
    Ok(None)
}

/// Shows samples until Ctrl-C, or until the mission is another one.
fn follow(
    robot: &mut Robot,
    mission: u32,
    nets: Named,
    period: Duration,
    json: bool,
    interrupt: &Interrupt,
    console: &mut Console,
) -> Result<(), CommandError> {
    let subscription = begin(robot, mission, &nets, period)?;
    tell_clock(json, console);
    // From here on nobody waits for anything in particular.
    robot.limit_waits(None);
    while !interrupt.is_requested() {
        robot.attend(LISTEN_TIME)?;
        for event in robot.take_events() {
            match subscription.read(&event) {
                Some(Told::Sample(reading)) => {
                    print(mission, &nets, &reading, json, console)?;
                    console.flush()?;
                }
                Some(Told::Gap(missing)) => {
                    console.note(&format!("({missing} samples did not come)"));
                }
                Some(Told::Ended) => return Ok(()),
                None => {}
            }
        }
    }
    Ok(())
}

/// Tells a person which clock the samples have.
fn tell_clock(json: bool, console: &mut Console) {
    if !json {
        console.note("times are mission time");
    }
}

/// Asks for samples of these nets, one each `period` at most.
///
/// # Errors
/// The robot stands still, or refuses.
pub fn begin(
    robot: &mut Robot,
    mission: u32,
    nets: &Named,
    period: Duration,
) -> Result<Subscription, CommandError> {
    let status = robot.status()?;
    if status.mode != Mode::Running {
        return Err(CommandError::Input(anyhow!(
            "the robot does not run its mission, so that nothing changes on its nets; `esm status` says why, `esm start` starts it"
        )));
    }
    let words = nets.iter().map(|(_, watched)| words_of(&watched.fields));
    let numbers: usize = words.sum();
    if numbers > MAX_VALUE_WORDS {
        return Err(CommandError::Input(anyhow!(
            "these nets have {numbers} numbers, and a robot tells of {MAX_VALUE_WORDS} at a time: name fewer"
        )));
    }
    let watched = nets.iter().map(|(_, watched)| watched.clone()).collect();
    Ok(Subscription::begin(robot, mission, watched, period)?)
}

fn print(
    mission: u32,
    nets: &Named,
    reading: &Reading,
    json: bool,
    console: &mut Console,
) -> Result<(), CommandError> {
    if json {
        return console.json_line(&Sample {
            mission: hash_text(mission),
            t_us: reading.t_us,
            values: Values(nets, reading),
        });
    }
    let width = nets.iter().map(|(name, _)| name.chars().count()).max();
    let width = width.unwrap_or_default();
    let seconds = reading.t_us as f64 / 1e6;
    for ((name, watched), values) in nets.iter().zip(&reading.values) {
        let text = match values {
            Some(values) => Text {
                fields: &watched.fields,
                values,
            }
            .to_string(),
            None => "nothing yet".to_owned(),
        };
        writeln!(console.out(), "{seconds:10.3} s  {name:<width$}  {text}")?;
    }
    Ok(())
}

impl From<ValuesError> for CommandError {
    fn from(error: ValuesError) -> Self {
        match error {
            ValuesError::Client(error) => error.into(),
            ValuesError::NoNames(_) | ValuesError::BadMission(_) => {
                CommandError::Input(error.into())
            }
            ValuesError::Unknown | ValuesError::TooMany => CommandError::World(error.into()),
        }
    }
}
