//! `esm log`: what a robot says.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Duration;

use clap::Args;
use rt_firmware::link::message::Mode;
use rt_firmware::link::news::{Cause, News};

use super::argument::Time;
use super::console::Console;
use super::exit::CommandError;
use super::robot::RobotArgs;
use super::stage;
use crate::host_board;
use crate::link_client::log_lines::LogReader;
use crate::link_client::{StreamEvent, Streams};
use crate::run::interrupt::Interrupt;
use crate::run::mission::hash_text;
use crate::run::story;

/// How long a wait for the next line may last before Ctrl-C is looked for.
const LISTEN_TIME: Duration = Duration::from_millis(100);

/// Shows what the firmware logs, decoded, as it comes
///
/// Runs until Ctrl-C. Lines that the robot could not keep are counted and said. Where a line begins with a time, it is in seconds of
/// the board's clock, since it was switched on.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  esm log --port /dev/ttyUSB0
  esm log --port /dev/ttyUSB0 --news '1 s'
  esm log --port unix:/tmp/robot --firmware target/firmware/lm3s6965/rover.elf")]
pub struct LogArgs {
    #[command(flatten)]
    #[allow(missing_docs, reason = "carries the documentation of its arguments")]
    pub robot: RobotArgs,

    /// The firmware that the robot runs, whose file holds the texts of the log
    #[arg(long, value_name = "ELF", env = "ESM_FIRMWARE")]
    pub firmware: Option<PathBuf>,

    /// Shows, too, when the robot's mission, the trial of that or its mode changes, and how it is each TIME of the mission's, if one is given
    #[arg(long, value_name = "TIME", num_args = 0..=1, default_missing_value = "0 s")]
    pub news: Option<Time>,
}

/// Runs the command.
///
/// # Errors
/// What kept it from ending well.
pub fn execute(args: &LogArgs, console: &mut Console) -> Result<(), CommandError> {
    let interrupt = Interrupt::take_over()?;
    let (mut robot, info) = args.robot.connect()?;
    let mut log = reader(&info.board, args.firmware.as_deref(), console)?;
    robot.subscribe(Streams {
        log: true,
        ..Streams::NONE
    })?;
    if let Some(period) = args.news {
        robot.watch(Some(Duration::from_micros(period.us)))?;
    }
    while !interrupt.is_requested() {
        robot.listen(LISTEN_TIME)?;
        for event in robot.take_events() {
            match event {
                StreamEvent::Log(bytes) => {
                    for line in log.lines(&bytes) {
                        writeln!(console.out(), "{line}")?;
                    }
                    console.flush()?;
                }
                StreamEvent::Gap { missing, .. } => {
                    console.note(&format!("({missing} lines or pieces did not come)"));
                }
                StreamEvent::News(news) => {
                    writeln!(console.out(), "{}", told(&news))?;
                    console.flush()?;
                }
                StreamEvent::Trace(_) | StreamEvent::Record(_) => {}
            }
        }
    }
    // Should the robot have gone meanwhile, there is nothing left to end.
    let _ = robot.subscribe(Streams::NONE);
    let _ = robot.watch(None);
    Ok(())
}

/// News as a line.
fn told(news: &News) -> String {
    let mission = news.mission.map(hash_text);
    let mission = mission.as_deref().unwrap_or("no mission");
    let trial = if news.on_trial { ", on trial" } else { "" };
    let mode = match news.mode {
        Mode::Empty => "no mission".to_owned(),
        Mode::Running => format!("{mission} runs{trial}"),
        Mode::Stopped => format!("stopped, its mission is {mission}{trial}"),
        Mode::EmergencyStopped => {
            format!("emergency stop, latched, its mission is {mission}{trial}")
        }
        Mode::Safe(reason) => format!("safe state: {}", story::safe_reason(reason)),
    };
    let gave_up = match (news.cause, news.fell_back) {
        (Cause::Mission, Some(fell_back)) if news.mission != Some(fell_back.mission) => format!(
            "; gave {} up: {}",
            hash_text(fell_back.mission),
            story::fall_back_reason(fell_back.reason)
        ),
        _ => String::new(),
    };
    let cause = match news.cause {
        Cause::Begun => "now",
        Cause::Period => "news",
        Cause::Mission => "mission",
        Cause::Trial => "trial",
        Cause::Mode => "mode",
    };
    format!(
        "{cause}: {mode}{gave_up}; at {:.3} s: {} steps, {} slots executed, {} missed, {} overruns, {:.1} µs at most late; {} frames from here spoiled",
        news.t_us as f64 / 1e6,
        news.steps,
        news.executed,
        news.missed,
        news.overruns,
        f64::from(news.max_delay_ns) / 1e3,
        news.spoiled_frames
    )
}

/// What decodes the log of that board: the host board's is plain text, another's needs its firmware's file.
fn reader(
    board: &str,
    named: Option<&Path>,
    console: &mut Console,
) -> Result<LogReader, CommandError> {
    if board == host_board::BOARD {
        return Ok(LogReader::text());
    }
    let path = stage::find_firmware(named, console)?;
    LogReader::firmware(&path).map_err(|error| CommandError::World(error.into()))
}
