//! `esm bench missions`: how often missions reach their goal, and what they touch, over many seeds.

use std::io::Write;
use std::num::NonZeroUsize;
use std::path::PathBuf;

use anyhow::anyhow;
use clap::Args;

use super::courses::{Asked, courses};
use super::report::{Row, Total, table, troubles};
use crate::bench::{Course, Outcome, in_order, processors};
use crate::cli::argument::Time;
use crate::cli::console::Console;
use crate::cli::exit::CommandError;
use crate::cli::seeds::Seeds;
use crate::goal::Goal;
use crate::host_board::RobotMaker;
use crate::run::drive::RunError;
use crate::run::interrupt::Interrupt;

/// Drives missions over many seeds, and says how often they reach their goal and what they touch
///
/// Each mission drives in its world on the board `host`, once a seed. A goal file says in which
/// world, for how long, and where the robot is to be then: guard.goal or guard.hall.goal beside
/// guard.esm, or any in the folder guard. With the seed vary the noise of the sonars, the echoes
/// that they miss and the slip of the wheels; people step in and away up to 2 s earlier or later,
/// and in one seed of ten a sonar dies. Of each touch of a wall or a person it is said whether a
/// robot that obeys its stop distance could have avoided it.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  esm bench missions
  esm bench missions missions/guard.esm missions/square.esm --seeds 1..=20
  esm bench missions missions/guard/visitors.goal --seeds 1..=100 --jobs 2 --strict
  esm bench missions missions/patrol.esm --world corridor --until '60 s' --goal '2 rooms'
  esm bench missions missions/by_hand.esm --script missions/square.script --world empty --until '45 s'

A goal file has three lines, as in `world office`, `until 60 s` and `goal start within 0.25 m`; a goal may also be `X,Y within 0.25 m` or `3 rooms`. \
A fourth, as in `script errand.script`, names a script beside the mission, which the run sends it.

With --json one object a run, by mission, then by seed: mission, script (null without one), world, seed, at_goal (null without a goal), off_goal_m (null where the goal is no place), \
time_s, finished, distance_m, rooms_entered, collisions, avoidable, touches (a list of at_s, x_m, y_m, touched, line, speed_m_per_s, there_from_s, free_m, \
needed_m, avoidable), dead_sonars (a list of sonar, at_s), fault. The last line has runs, at_goal, missed, collisions and avoidable.")]
pub struct MissionsArgs {
    /// Missions, goal files, or folders in which goal files are looked for [default: missions]
    #[arg(value_name = "FILE")]
    pub paths: Vec<PathBuf>,

    /// The seeds, from the first to the last, or one
    #[arg(long, value_name = "FIRST..=LAST", default_value = "1..=100")]
    pub seeds: Seeds,

    /// How many runs go at the same time; what is said does not depend on it [default: as many as
    /// there are processors]
    #[arg(long, value_name = "N")]
    pub jobs: Option<NonZeroUsize>,

    /// Robot time at which each run ends, such as '60 s', instead of the goal file's
    #[arg(long, value_name = "TIME")]
    pub until: Option<Time>,

    /// The world to drive in, as `esm run` takes it; goal files are left aside then [default:
    /// office where there is no goal file]
    #[arg(long, value_name = "WORLD")]
    pub world: Option<PathBuf>,

    /// What is to be reached, as in a goal file; goal files are left aside then
    #[arg(long, value_name = "GOAL")]
    pub goal: Option<Goal>,

    /// A script of behaviours that a task `Behaviours` of the mission does; goal files are left
    /// aside then
    #[arg(long, value_name = "FILE")]
    pub script: Option<PathBuf>,

    /// Lets people step in and away at the times of the world's file, and no sonar die
    #[arg(long)]
    pub no_vary: bool,

    /// Ends with status 1 where a run has missed its goal, or a touch could have been avoided
    #[arg(long)]
    pub strict: bool,

    /// One JSON object a run, for programs
    #[arg(long)]
    pub json: bool,
}

/// Runs the command. `robot` is what the board `host` has.
///
/// # Errors
/// If something cannot be read or driven, or is not as `--strict` wants it.
pub fn execute(
    args: &MissionsArgs,
    robot: RobotMaker,
    console: &mut Console,
) -> Result<(), CommandError> {
    let interrupt = Interrupt::take_over()?;
    let asked = Asked {
        paths: &args.paths,
        world: args.world.as_deref(),
        until: args.until,
        goal: args.goal,
        script: args.script.as_deref(),
    };
    let courses = courses(&asked, console)?;
    let varies = !args.no_vary;
    for course in &courses {
        course.check(robot, *args.seeds.0.start(), varies)?;
    }
    let seeds = || args.seeds.0.clone();
    let work: Vec<(usize, u64)> = (0..courses.len())
        .flat_map(|course| seeds().map(move |seed| (course, seed)))
        .collect();
    let mut benched: Vec<(&Course, Vec<Outcome>)> =
        courses.iter().map(|course| (course, Vec::new())).collect();
    let bar = console.progress("driving", work.len() as u64);
    let mut done = 0;
    let driven = in_order(
        args.jobs.map_or_else(processors, NonZeroUsize::get),
        &work,
        |(course, seed)| {
            let driven = courses[*course].drive(robot, *seed, varies, interrupt);
            (*course, *seed, driven)
        },
        |(course, seed, driven)| {
            let outcome = driven.map_err(|error| of_run(error, &courses[course], seed))?;
            // What was cut short says nothing.
            if outcome.summary.interrupted {
                return Err(interrupted(done, work.len()));
            }
            done += 1;
            bar.set_position(done as u64);
            if args.json {
                console.json_line(&Row::new(&courses[course], &outcome))?;
                console.flush()?;
            }
            benched[course].1.push(outcome);
            Ok(())
        },
    );
    bar.finish_and_clear();
    driven?;
    let total = Total::of(benched.iter().flat_map(|(_, runs)| runs));
    if args.json {
        console.json_line(&total)?;
    } else {
        let out = console.out();
        write!(out, "{}", table(&benched))?;
        for (course, runs) in &benched {
            let troubles = troubles(course, runs, varies);
            if !troubles.is_empty() {
                write!(out, "\n{troubles}")?;
            }
        }
    }
    if args.strict && !total.is_good() {
        return Err(CommandError::Told);
    }
    Ok(())
}

fn interrupted(done: usize, runs: usize) -> CommandError {
    CommandError::World(anyhow!(
        "ended by Ctrl-C when {done} of {runs} runs were driven"
    ))
}

/// Why a run did not come to its end, and which.
fn of_run(error: RunError, course: &Course, seed: u64) -> CommandError {
    let which = format!(
        "{} in {}, seed {seed}",
        course
            .script
            .as_ref()
            .map_or(&course.mission.file, |sent| &sent.file)
            .display(),
        course.world_name
    );
    match CommandError::from(error) {
        CommandError::Input(error) => CommandError::Input(error.context(which)),
        CommandError::World(error) => CommandError::World(error.context(which)),
        other => other,
    }
}
