//! The `esm` command: one file a subcommand.
//!
//! A subcommand's file holds its arguments as a plain struct with public fields, the help text that
//! a person reads, and a function `execute` that does the work through the library. Nothing here
//! decides what a machine means; that is asked of the rooms behind.
//!
//! | module | what it holds |
//! |---|---|
//! | [`exit`] | what a command can end with: [`exit::ExitStatus`] and [`exit::CommandError`] |
//! | [`console`] | standard output and error as a person or a program sees them: colour, progress, broken pipes |
//! | [`file`](mod@file) | files read and written, whole or not at all |
//! | [`mission`] | from a source file to a verified blob |
//! | [`difference`] | where two texts differ first |
//! | [`argument`] | values that several commands take: times, ports |
//! | [`seeds`] | seeds of many runs |
//! | [`stage`] | board, world and mission, for the commands that set up a robot |
//! | [`robot`] | a robot at the other end of a line, for the commands that talk to one |
//! | [`robot_toml`] | numbers of a robot's file, changed where they stand |
//! | [`terminal`] | the screen of a terminal, for the commands that take it |

pub mod argument;
pub mod behaviours;
pub mod bench;
pub mod blackbox;
pub mod board;
pub mod bound;
pub mod build;
pub mod by_hand;
pub mod check;
pub mod confirm;
pub mod console;
pub mod diff;
pub mod difference;
pub mod draw;
pub mod drive;
pub mod exit;
pub mod expected;
pub mod explain;
pub mod fallback;
pub mod file;
pub mod flash;
pub mod fmt;
pub mod inspect;
pub mod kept_values;
pub mod key;
pub mod link;
pub mod log;
pub mod lsp;
pub mod mission;
pub mod new;
pub mod odometry;
mod own_drive;
pub mod param;
pub mod plot;
pub mod ports;
pub mod position;
pub mod record;
pub mod recorder;
pub mod replay;
pub mod robot;
pub mod robot_toml;
pub mod run;
pub mod schedule;
pub mod script;
pub mod seeds;
pub mod selftest;
mod sensors;
mod shipped_docs;
pub mod sim;
pub mod stage;
pub mod start;
pub mod status;
pub mod step;
pub mod stop;
pub mod studio;
pub mod system;
pub mod tasks;
pub mod terminal;
pub mod test;
pub mod top;
pub mod tune;
pub mod umbmark;
pub mod upload;
pub mod values;
pub mod wiring;

use std::process::ExitCode;

use clap::{Parser, Subcommand};

use console::Console;
use exit::CommandError;

use crate::host_board::{self, RobotMaker};

/// Describe what a robot does as state machines, check it, try it, and upload it while the robot
/// stays on.
#[derive(Debug, Parser)]
#[command(
    name = "esm",
    version,
    arg_required_else_help = true,
    propagate_version = true,
    subcommand_required = true,
    after_help = "\
A first tour:
  esm check missions/patrol.esm                  what is wrong with a mission, if anything
  esm fmt missions/patrol.esm                    one layout for every file
  esm sim patrol.esm patrol.scenario             step through the machine alone, no robot needed
  esm test missions                              run the scenarios of all missions in a folder
  esm run missions/patrol.esm --until '60 s'     drive it: an emulated board, a simulated robot body
  esm upload missions/patrol.esm --port /dev/ttyUSB0

Exit status: 0 done; 1 the input has errors or an expectation failed; 2 wrong usage; 3 the outside world failed \
(no port, no emulator, link lost). Colours are used on a terminal only, and never where NO_COLOR is set."
)]
pub struct Cli {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
}

/// The subcommands, in the order in which a mission meets them.
#[derive(Debug, Subcommand)]
#[allow(
    missing_docs,
    reason = "each variant carries the documentation of its arguments"
)]
pub enum Command {
    Check(check::CheckArgs),
    Explain(explain::ExplainArgs),
    Fmt(fmt::FmtArgs),
    Lsp(lsp::LspArgs),
    Studio(studio::StudioArgs),
    Build(build::BuildArgs),
    Bound(bound::BoundArgs),
    Draw(draw::DrawArgs),
    Inspect(inspect::InspectArgs),
    Diff(diff::DiffArgs),
    Schedule(schedule::ScheduleArgs),
    Sim(sim::SimArgs),
    Test(test::TestArgs),
    Run(Box<run::RunArgs>),
    System(system::SystemArgs),
    Link(link::LinkArgs),
    Bench(bench::BenchArgs),
    Board(board::BoardArgs),
    Ports(ports::PortsArgs),
    Flash(flash::FlashArgs),
    Wiring(wiring::WiringArgs),
    New(new::NewArgs),
    Replay(replay::ReplayArgs),
    Odometry(odometry::OdometryArgs),
    Selftest(Box<selftest::SelftestArgs>),
    Tune(tune::TuneArgs),
    Umbmark(umbmark::UmbmarkArgs),
    Record(record::RecordArgs),
    Plot(plot::PlotArgs),
    Upload(upload::UploadArgs),
    Confirm(confirm::ConfirmArgs),
    Fallback(fallback::FallbackArgs),
    Param(param::ParamArgs),
    Values(values::ValuesArgs),
    Log(log::LogArgs),
    Status(status::StatusArgs),
    Top(top::TopArgs),
    #[command(name = "blackbox")]
    BlackBox(blackbox::BlackBoxArgs),
    Stop(stop::StopArgs),
    Start(start::StartArgs),
    Key(key::KeyArgs),
    Tasks(tasks::TasksArgs),
    Behaviours(behaviours::BehavioursArgs),
    Script(script::ScriptArgs),
    Drive(drive::DriveArgs),
    Position(position::PositionArgs),
}

/// Runs the command with the arguments and the streams of this process. The board `host` has the
/// robot that ships.
pub fn main() -> ExitCode {
    main_with(host_board::rover)
}

/// As [`main`], with a robot of one's own on the board `host`: the main function of a user's host
/// program.
///
/// ```no_run
/// use rt_firmware::rover::{Measures, PinRover};
///
/// fn main() -> std::process::ExitCode {
///     host_tools::cli::main_with(|parts, run| {
///         run(&mut PinRover::new(parts.into(), &Measures::ROVER).banks())
///     })
/// }
/// ```
pub fn main_with(robot: RobotMaker) -> ExitCode {
    console::take_over_panics();
    let mut console = Console::of_this_process();
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        Err(refusal) => {
            console.usage(&refusal);
            return if refusal.use_stderr() {
                exit::ExitStatus::WrongUsage
            } else {
                exit::ExitStatus::Done
            }
            .into();
        }
    };
    let ended = execute(&cli.command, robot, &mut console)
        .and_then(|()| console.flush().map_err(CommandError::from));
    match ended {
        Ok(()) => exit::ExitStatus::Done.into(),
        Err(error) => {
            // What the command said before it failed stands before the reason.
            let _ = console.flush();
            console.report(&error);
            error.status().into()
        }
    }
}

/// Runs one subcommand. `robot` is what the board `host` has.
///
/// # Errors
/// Whatever kept the command from ending well, with the exit status that it stands for.
pub fn execute(
    command: &Command,
    robot: RobotMaker,
    console: &mut Console,
) -> Result<(), CommandError> {
    match command {
        Command::Check(args) => check::execute(args, console),
        Command::Explain(args) => explain::execute(args, console),
        Command::Fmt(args) => fmt::execute(args, console),
        Command::Lsp(args) => lsp::execute(args),
        Command::Studio(args) => studio::execute(args, console),
        Command::Build(args) => build::execute(args, console),
        Command::Bound(args) => bound::execute(args, console),
        Command::Draw(args) => draw::execute(args, console),
        Command::Inspect(args) => inspect::execute(args, console),
        Command::Diff(args) => diff::execute(args, console),
        Command::Schedule(args) => schedule::execute(args, console),
        Command::Sim(args) => sim::execute(args, console),
        Command::Test(args) => test::execute(args, console),
        Command::Run(args) => run::execute(args, robot, console),
        Command::System(args) => system::execute(args, robot, console),
        Command::Link(args) => link::execute(args, robot, console),
        Command::Bench(args) => bench::execute(args, robot, console),
        Command::Board(args) => board::execute(args, robot, console),
        Command::Ports(args) => ports::execute(args, console),
        Command::Flash(args) => flash::execute(args, console),
        Command::Wiring(args) => wiring::execute(args, console),
        Command::New(args) => new::execute(args, console),
        Command::Replay(args) => replay::execute(args, console),
        Command::Odometry(args) => odometry::execute(args, console),
        Command::Selftest(args) => selftest::execute(args, robot, console),
        Command::Tune(args) => tune::execute(args, robot, console),
        Command::Umbmark(args) => umbmark::execute(args, robot, console),
        Command::Record(args) => record::execute(args, robot, console),
        Command::Plot(args) => plot::execute(args, console),
        Command::Upload(args) => upload::execute(args, console),
        Command::Confirm(args) => confirm::execute(args, console),
        Command::Fallback(args) => fallback::execute(args, console),
        Command::Param(args) => param::execute(args, console),
        Command::Values(args) => values::execute(args, console),
        Command::Log(args) => log::execute(args, console),
        Command::Status(args) => status::execute(args, console),
        Command::Top(args) => top::execute(args, console),
        Command::BlackBox(args) => blackbox::execute(args, console),
        Command::Stop(args) => stop::execute(args, console),
        Command::Start(args) => start::execute(args, console),
        Command::Key(args) => key::execute(args, console),
        Command::Tasks(args) => tasks::execute(args, robot, console),
        Command::Behaviours(args) => behaviours::execute(args, robot, console),
        Command::Script(args) => script::execute(args, robot, console),
        Command::Drive(args) => drive::execute(args, console),
        Command::Position(args) => position::execute(args, console),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn the_command_line_is_well_formed() {
        Cli::command().debug_assert();
    }
}
