//! Drives of the simulated robot that a command makes for itself: with a mission that it has
//! compiled in, recorded in memory.

use std::io;
use std::path::Path;
use std::time::Duration;

use anyhow::anyhow;

use super::exit::CommandError;
use super::mission;
use crate::compile::NameTable;
use crate::host_board::RobotMaker;
use crate::lang;
use crate::plant::{BodyParameters, Plant};
use crate::recording::player::Recording;
use crate::run::board::{Board, LinkWay};
use crate::run::drive::{Plan, Planned, drive};
use crate::run::in_memory::InMemory;
use crate::run::interrupt::Interrupt;
use crate::run::mission::Mission;
use crate::world::World;

/// The tasks that such missions take in, as `rover.esm`.
pub const ROVER: &str = include_str!("../../shipped/missions/rover.esm");

/// A mission of this text, which is called `name` in messages.
///
/// # Errors
/// If it does not compile.
pub fn compiled(name: &str, text: &str) -> Result<Mission, CommandError> {
    compiled_with(name, text, ("rover.esm", ROVER))
}

/// The same of a text that takes in tasks as a file of that name and text.
///
/// # Errors
/// If it does not compile.
pub fn compiled_with(name: &str, text: &str, tasks: (&str, &str)) -> Result<Mission, CommandError> {
    let mut checked = lang::load_texts(&[(name, text), tasks]);
    let blob = mission::lay_out_and_compile(&mut checked, None, NameTable::Kept)?;
    let defect = || CommandError::Input(anyhow!("{}", checked.render(false)));
    let blob = blob.ok_or_else(defect)?;
    Mission::new(Path::new(name), blob).map_err(|error| CommandError::Input(error.into()))
}

/// A drive on the board `host`.
pub struct OwnDrive<'a> {
    /// What is driven, in messages: "a square".
    pub what: &'a str,
    /// The mission.
    pub mission: &'a Mission,
    /// Where it is driven.
    pub world: &'a World,
    /// The robot's body.
    pub body: BodyParameters,
    /// Seed of the noise in sensors and wheels.
    pub seed: u64,
    /// How often values are kept.
    pub sample_period: Duration,
    /// Robot time by which the mission must have finished.
    pub until_us: u64,
}

impl OwnDrive<'_> {
    /// Drives. Returns the robot's body as it is at the end, and what was recorded.
    ///
    /// # Errors
    /// If the mission does not come to its end.
    pub fn carry_out(
        &self,
        robot: RobotMaker,
        interrupt: Interrupt,
    ) -> Result<(Plant, Recording), CommandError> {
        let what = self.what;
        let recorded = InMemory::default();
        let plan = Plan {
            link: LinkWay::Exchange,
            seed: self.seed,
            body: self.body,
            until_us: Some(self.until_us),
            record: Some(Box::new(recorded.clone())),
            sample_period: Some(self.sample_period),
            ..Plan::new(
                Board::Host { robot },
                self.world.clone(),
                vec![Planned::first(self.mission.clone())],
            )
        };
        let run = drive(plan, io::sink(), interrupt, &mut |_| ())?;
        if run.summary.interrupted {
            return Err(CommandError::World(anyhow!(
                "ended by Ctrl-C before {what} was driven to its end"
            )));
        }
        if let Some(fault) = run.summary.fault {
            return Err(CommandError::Input(anyhow!("{what} ended early: {fault}")));
        }
        if run.summary.finished_s.is_none() {
            return Err(CommandError::Input(anyhow!(
                "{what} was not driven within {} s: does the robot take its wheels for other ones?",
                self.until_us / 1_000_000
            )));
        }
        let recording = recorded.read().map_err(|error| {
            CommandError::Input(anyhow!("what the robot told of {what}: {error}"))
        })?;
        Ok((run.plant, recording))
    }
}
