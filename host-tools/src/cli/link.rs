//! `esm link`: this computer as a node on a line between processors.

use std::io::{self, BufRead, Read};
use std::path::PathBuf;
use std::sync::mpsc::{Receiver, TryRecvError, sync_channel};
use std::thread;
use std::time::Duration;

use anyhow::anyhow;
use clap::Args;
use rt_firmware::body::PinImage;
use rt_firmware::frames::fields_of;
use serde::Serialize;

use super::argument::Time;
use super::console::Console;
use super::exit::CommandError;
use super::mission::{self, Audience};
use crate::compile::NameTable;
use crate::host_board::RobotMaker;
use crate::host_run::{RunMission, WiredLink};
use crate::link_node::{Counts, LinkNode};
use crate::run::interrupt::Interrupt;
use crate::serial;
use crate::serial::port::Port;

/// How long a wait for bytes may last before Ctrl-C and the operator are looked for.
const LISTEN_TIME: Duration = Duration::from_millis(10);
/// Bytes of a line of the operator at most.
const MAX_LINE_BYTES: u64 = 4_096;
/// Lines that wait until they are looked at.
const WAITING_LINES: usize = 64;

/// Makes this computer a node on a line between processors: an operator's radio
///
/// MISSION is what a processor in its place would run. The `out` frames of its link are sent at
/// their times, what comes is printed as JSON Lines. Standard input says what is sent, a line each:
/// the name of a frame and its values one behind the other, as `twist 0.2 0`, or that of a flag, as
/// `halted on`. A value is sent from when it was said first until `NAME none`, flags always.
/// Nothing is acknowledged. A frame that has not come for longer than its `late` is told.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  esm link --port /dev/ttyUSB0 operator.esm
  echo 'twist 0.2 0' | esm link --port unix:/tmp/radio operator.esm --for '10 s' | jq -c 'select(.what == \"frame\")'

Each line of standard output is an object. `what` is `frame` (with t_ms, frame, number, lost, age_ms, value), `wrong` (t_ms, why), `late` (t_ms, frame, \
since_ms) or, at the end, `counts` (sent, received, corrupt, other_configuration, unknown).")]
pub struct LinkArgs {
    /// The mission whose link this is
    #[arg(value_name = "MISSION")]
    pub mission: PathBuf,

    /// Where the line is: a serial line, unix:PATH or tcp:HOST:PORT
    #[arg(long, value_name = "PORT")]
    pub port: Port,

    /// Which of the mission's links, where it has several
    #[arg(long, value_name = "NAME")]
    pub link: Option<String>,

    /// Ends after that time; without it, Ctrl-C does
    #[arg(long = "for", value_name = "TIME")]
    pub time: Option<Time>,
}

/// The last line.
#[derive(Serialize)]
struct AtEnd {
    what: &'static str,
    #[serde(flatten)]
    counts: Counts,
}

/// Runs the command. `robot` has the types of values.
///
/// # Errors
/// What kept it from ending well.
pub fn execute(
    args: &LinkArgs,
    robot: RobotMaker,
    console: &mut Console,
) -> Result<(), CommandError> {
    let blob = mission::compiled(
        &args.mission,
        None,
        NameTable::Kept,
        Audience::Person,
        console,
    )?;
    let mission =
        RunMission::new("node", blob).map_err(|error| CommandError::Input(error.into()))?;
    let link = chosen(&mission.links, args)?;
    let mut node = node(link, robot)?;
    let interrupt = Interrupt::take_over()?;
    let opened = serial::open(&args.port, link.rate_bps);
    let mut line = opened.map_err(|error| CommandError::World(error.into()))?;
    let clock = line.clock();
    let begun = clock.now();
    let mut operator = Some(operator());
    let mut buffer = [0; 1_024];
    let ended = loop {
        let now_us = clock.since(begun).as_micros() as u64;
        if interrupt.is_requested() || args.time.is_some_and(|time| now_us >= time.us) {
            break Ok(());
        }
        hear_operator(&mut operator, &mut node, console);
        let bytes = node.send(now_us);
        if !bytes.is_empty()
            && let Err(error) = line.send(&bytes)
        {
            break Err(error);
        }
        let next_us = node.next_us().unwrap_or(u64::MAX);
        let wait = Duration::from_micros(next_us.saturating_sub(now_us)).min(LISTEN_TIME);
        let count = match line.receive(&mut buffer, wait) {
            Ok(count) => count,
            Err(error) => break Err(error),
        };
        let now_us = clock.since(begun).as_micros() as u64;
        let mut news = node.take(buffer.get(..count).unwrap_or_default(), now_us);
        news.extend(node.look(now_us));
        for it in &news {
            console.json_line(it)?;
        }
        if !news.is_empty() {
            console.flush()?;
        }
    };
    console.json_line(&AtEnd {
        what: "counts",
        counts: node.counts(),
    })?;
    ended.map_err(|error| {
        CommandError::World(anyhow!(
            "the line at {} is gone: {error}; is the other end still there?",
            args.port
        ))
    })
}

/// The link that is meant.
fn chosen<'l>(links: &'l [WiredLink], args: &LinkArgs) -> Result<&'l WiredLink, CommandError> {
    let names: Vec<&str> = links.iter().map(|it| it.name.as_str()).collect();
    let file = args.mission.display();
    match (&args.link, links) {
        (Some(name), _) => (links.iter().find(|it| it.name == *name)).ok_or_else(|| {
            let known = names.join(", ");
            CommandError::Usage(anyhow!("{file} uses no link `{name}`: it uses {known}"))
        }),
        (None, [only]) => Ok(only),
        (None, []) => Err(CommandError::Input(anyhow!(
            "{file} uses no link: declare one, and let a state transmit and another receive"
        ))),
        (None, _) => Err(CommandError::Usage(anyhow!(
            "{file} uses several links: say which one with `--link`: {}",
            names.join(", ")
        ))),
    }
}

/// The node of a link, for values of the robot's types.
fn node(link: &WiredLink, robot: RobotMaker) -> Result<LinkNode, CommandError> {
    let pins = PinImage::new();
    let mut made = None;
    robot(pins.parts(), &mut |banks| {
        let of_type = |type_name: &str| fields_of(banks, type_name).map(str::to_owned);
        made = Some(LinkNode::new(link, &of_type));
    });
    match made {
        Some(made) => made.map_err(|error| CommandError::Input(error.into())),
        None => Err(CommandError::Input(anyhow!(
            "the robot's program made no tasks: it must call the function that it is given"
        ))),
    }
}

/// Lines of standard input, as they come.
fn operator() -> Receiver<String> {
    let (says, said) = sync_channel(WAITING_LINES);
    // It ends with the process, or with the input: a read cannot be broken off.
    thread::spawn(move || {
        let mut input = io::BufReader::new(io::stdin());
        loop {
            let mut line = Vec::new();
            let read = (&mut input)
                .take(MAX_LINE_BYTES)
                .read_until(b'\n', &mut line);
            if !matches!(read, Ok(1..)) {
                return;
            }
            let line = String::from_utf8_lossy(&line).into_owned();
            if says.send(line).is_err() {
                return;
            }
        }
    });
    said
}

/// Takes what the operator has said.
fn hear_operator(
    operator: &mut Option<Receiver<String>>,
    node: &mut LinkNode,
    console: &mut Console,
) {
    while let Some(lines) = operator {
        match lines.try_recv() {
            Ok(line) => {
                if let Err(error) = node.say(&line) {
                    console.note(&error.to_string());
                }
            }
            Err(TryRecvError::Empty) => return,
            Err(TryRecvError::Disconnected) => *operator = None,
        }
    }
}
