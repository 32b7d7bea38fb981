//! Missions driven in worlds over many seeds, and what came of each run.

use std::collections::BTreeMap;
use std::io;
use std::num::NonZeroUsize;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering::Relaxed};
use std::sync::mpsc;
use std::thread;

use esm_toolkit::goal::{Goal, Reached};
use esm_toolkit::script::Script;
use esm_toolkit::world::World;

use crate::host_board::RobotMaker;
use crate::interrupt::Interrupt;
use crate::lockstep::plant_side::SonarBreak;
use crate::run::board::{Board, LinkWay};
use crate::run::by_hand::ByHand;
use crate::run::drive::{Plan, Planned, RunError, drive};
use crate::run::mission::Mission;
use crate::run::summary::Summary;

/// A mission in a world, with what it is to reach there.
#[derive(Clone, Debug)]
pub struct Course {
    /// The mission.
    pub mission: Mission,
    /// The world as it is asked for: a name, or a file.
    pub world_name: String,
    /// The world.
    pub world: World,
    /// Robot time at which a run ends, in microseconds.
    pub until_us: u64,
    /// What is to be reached by then; none where only touches are judged.
    pub goal: Option<Goal>,
    /// What the mission's list of behaviours is sent, if it is.
    pub script: Option<Sent>,
}

/// A script that a mission is sent.
#[derive(Clone, Debug)]
pub struct Sent {
    /// Its file, as it was named.
    pub file: PathBuf,
    /// The script.
    pub script: Script,
    /// Robot time at which it is sent, in microseconds.
    pub at_us: u64,
}

/// What came of one run.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// The plant's seed.
    pub seed: u64,
    /// Its figures.
    pub summary: Summary,
    /// How it ended by its goal; none without one.
    pub reached: Option<Reached>,
    /// Sonars that broke.
    pub sonar_breaks: Vec<SonarBreak>,
}

impl Outcome {
    /// Whether the run came to its end, and to its goal if there is one.
    pub fn is_at_goal(&self) -> bool {
        self.summary.fault.is_none() && self.reached.is_none_or(|reached| reached.is_reached)
    }

    /// When the mission had reached its final states, or else when the run ended, in seconds of
    /// robot time.
    pub fn time_s(&self) -> f64 {
        self.summary.finished_s.unwrap_or(self.summary.robot_time_s)
    }
}

impl Course {
    /// The plan of a run on the host board. It repeats to the byte, whatever else the machine does.
    fn plan(&self, robot: RobotMaker, seed: u64, varies: bool) -> Plan {
        let missions = vec![Planned::first(self.mission.clone())];
        let plan = Plan {
            link: LinkWay::Exchange,
            seed,
            until_us: Some(self.until_us),
            by_hand: ByHand {
                script: (self.script.as_ref()).map(|sent| (sent.at_us, sent.script.clone())),
                ..ByHand::default()
            },
            ..Plan::new(Board::Host { robot }, self.world.clone(), missions)
        };
        if varies { plan.varied() } else { plan }
    }

    /// Looks for what would be refused in a run with this seed.
    ///
    /// # Errors
    /// [`RunError`]
    pub fn check(&self, robot: RobotMaker, seed: u64, varies: bool) -> Result<(), RunError> {
        self.plan(robot, seed, varies).check()
    }

    /// Drives the mission once on the host board. With `varies` what is around the robot
    /// [varies](Plan::varied) with the seed.
    ///
    /// # Errors
    /// [`RunError`]
    pub fn drive(
        &self,
        robot: RobotMaker,
        seed: u64,
        varies: bool,
        interrupt: Interrupt,
    ) -> Result<Outcome, RunError> {
        let plan = self.plan(robot, seed, varies);
        let sonar_breaks = plan.sonar_breaks.clone();
        let run = drive(plan, io::sink(), interrupt, &mut |_| ())?;
        Ok(Outcome {
            seed,
            reached: self.goal.map(|goal| goal.judge(&run.plant)),
            summary: run.summary,
            sonar_breaks,
        })
    }
}

/// How many runs go at the same time where nobody says: one a processor; one, where nobody knows
/// how many there are.
pub fn processors() -> usize {
    thread::available_parallelism().map_or(1, NonZeroUsize::get)
}

/// Does all the work on so many threads, and hands what comes of it on in the order of the work,
/// each as soon as it and all before it are there.
///
/// # Errors
/// The first one of `take`. From then on no more is begun, and what is begun already ends unheard.
pub fn in_order<W: Sync, R: Send, E>(
    jobs: usize,
    work: &[W],
    run: impl Fn(&W) -> R + Sync,
    mut take: impl FnMut(R) -> Result<(), E>,
) -> Result<(), E> {
    let next = AtomicUsize::new(0);
    let is_over = AtomicBool::new(false);
    thread::scope(|scope| {
        let (sender, results) = mpsc::channel();
        for _ in 0..jobs.clamp(1, work.len().max(1)) {
            let sender = sender.clone();
            let (run, next, is_over) = (&run, &next, &is_over);
            scope.spawn(move || {
                while !is_over.load(Relaxed) {
                    let index = next.fetch_add(1, Relaxed);
                    let Some(work) = work.get(index) else {
                        break;
                    };
                    if sender.send((index, run(work))).is_err() {
                        break;
                    }
                }
            });
        }
        drop(sender);
        let mut early = BTreeMap::new();
        let mut wanted = 0;
        for (index, result) in results {
            early.insert(index, result);
            while let Some(result) = early.remove(&wanted) {
                wanted += 1;
                take(result).inspect_err(|_| is_over.store(true, Relaxed))?;
            }
        }
        Ok(())
    })
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    /// The later ones are done sooner.
    fn doubled(number: &u64) -> u64 {
        thread::sleep(Duration::from_millis(20 - number));
        2 * number
    }

    #[test]
    fn results_come_in_the_order_of_the_work_however_many_do_it() {
        let work: Vec<u64> = (0..20).collect();
        for jobs in [0, 1, 3, 50] {
            let mut taken = Vec::new();
            let ended = in_order(jobs, &work, doubled, |result| {
                taken.push(result);
                Ok::<(), ()>(())
            });
            assert_eq!(ended, Ok(()));
            let expected: Vec<u64> = (0..20).map(|number| 2 * number).collect();
            assert_eq!(taken, expected, "{jobs} jobs");
        }
        let ended: Result<(), ()> = in_order(2, &[], doubled, |_| panic!("there is no work"));
        assert_eq!(ended, Ok(()));
    }

    #[test]
    fn nothing_is_begun_after_the_end() {
        let work: Vec<u64> = (0..20).collect();
        let begun = AtomicUsize::new(0);
        let mut taken = 0;
        let run = |number: &u64| {
            begun.fetch_add(1, Relaxed);
            doubled(number)
        };
        let ended = in_order(2, &work, run, |_| {
            taken += 1;
            Err("enough")
        });
        assert_eq!(ended, Err("enough"));
        assert_eq!(taken, 1);
        assert!(begun.load(Relaxed) < work.len());
    }
}
