//! All processors of a system in one time: whose slot comes first by plant time goes first.

use rt_firmware::Sides;
use rt_firmware::body::PinImage;

use super::shared_plant::ProcessorPins;
use super::wiring::Devices;
use crate::host_run::{Ended, Given, HostRun, Planned, RunError, RunMission, Switches};
use crate::medium::PS_IN_US;
use crate::medium::clock::{Clock, Life};

/// What a processor of a run is, between two resets.
#[derive(Clone, Debug)]
pub struct Member {
    /// Its mission.
    pub mission: RunMission,
    /// Missions that take over from it, one after the other. Their times are by its clock.
    pub then: Vec<Planned>,
    /// Its clock, which reads 0 when the mission starts, and when it is there.
    pub life: Life,
}

impl Member {
    /// When its run ends by its own clock, in microseconds, in a run of all that ends at a plant
    /// time in microseconds.
    #[must_use]
    pub fn until_us(&self, until_us: u64) -> u64 {
        let Life { clock, to_ps, .. } = self.life;
        let until_ps = until_us.saturating_mul(PS_IN_US);
        match to_ps <= until_ps {
            // What would start when it is reset does not.
            true => clock.local_us(to_ps).saturating_sub(1),
            false => clock.local_us(until_ps),
        }
    }
}

/// A processor that runs.
pub struct RunningProcessor<'p, 'q, 'm> {
    run: HostRun<'p, 'q, 'm, ProcessorPins>,
    clock: Clock,
    has_begun: bool,
}

/// A processor, as whoever decides whose turn it is sees it.
pub trait InStep {
    /// When its next slot begins, in picoseconds of plant time; none where its run is over.
    fn next_ps(&self) -> Option<u64>;

    /// Lets it execute that slot.
    ///
    /// # Errors
    /// [`RunError`]
    fn step(&mut self) -> Result<(), RunError>;

    /// What has happened since this was asked last.
    fn take(&mut self) -> Given;
}

impl<'p, 'q, 'm> RunningProcessor<'p, 'q, 'm> {
    /// Switches a processor on, with `behind` behind its pins and these devices for its links. Its
    /// mission starts with its first step. The run has a seed, and ends at a plant time in
    /// microseconds.
    ///
    /// # Errors
    /// [`RunError`]
    pub fn switch_on(
        sides: Sides<'q, 'm>,
        pins: &'p PinImage,
        behind: ProcessorPins,
        member: Member,
        links: Devices,
        (seed, until_us): (u64, u64),
    ) -> Result<Self, RunError> {
        let until_us = member.until_us(until_us);
        let Member {
            mission,
            then,
            life,
        } = member;
        let clock = life.clock;
        let switches = Switches {
            seed,
            until_us,
            cut_link_us: None,
        };
        let first = Planned {
            at_us: 0,
            mission,
            warm: false,
        };
        let missions = [first].into_iter().chain(then).collect();
        let mut run = HostRun::switch_on(sides, pins, behind, switches, missions)?;
        run.connect(links);
        Ok(RunningProcessor {
            run,
            clock,
            has_begun: false,
        })
    }

    /// Ends its run. Where it has not begun, there is nothing to tell of.
    ///
    /// # Errors
    /// [`RunError`]
    pub fn finish(self) -> Result<Option<Ended>, RunError> {
        self.has_begun.then(|| self.run.finish()).transpose()
    }
}

impl InStep for RunningProcessor<'_, '_, '_> {
    fn next_ps(&self) -> Option<u64> {
        let next_us = match self.has_begun {
            true => self.run.next_slot_us()?,
            false => 0,
        };
        Some(self.clock.plant_ps(next_us))
    }

    fn step(&mut self) -> Result<(), RunError> {
        if !std::mem::replace(&mut self.has_begun, true) {
            self.run.begin()?;
        } else if self.run.bring_what_is_due()? {
            // Its next slot may be at another time, and it has left nothing new at its pins.
            return self.run.hear();
        } else if self.run.next_slot_us().is_some() {
            self.run.pass_slot()?;
        }
        self.run.announce();
        // What it has logged is its own, before another one logs.
        self.run.hear()
    }

    fn take(&mut self) -> Given {
        self.run.take()
    }
}

/// Lets all processors run up to the end of the run, which is a plant time in microseconds.
/// `on_step` is told what happened to which one, and may end the run by answering no.
///
/// # Errors
/// [`RunError`]
pub fn run(
    processors: &mut [&mut (dyn InStep + '_)],
    until_us: u64,
    mut on_step: impl FnMut(usize, u64, Given) -> bool,
) -> Result<(), RunError> {
    let until_ps = until_us.saturating_mul(PS_IN_US);
    loop {
        let next = (processors.iter().enumerate())
            .filter_map(|(index, it)| Some((it.next_ps()?, index)))
            .filter(|(next_ps, _)| *next_ps <= until_ps)
            .min();
        let Some((next_ps, index)) = next else {
            return Ok(());
        };
        let Some(processor) = processors.get_mut(index) else {
            return Ok(());
        };
        processor.step()?;
        if !on_step(index, next_ps / PS_IN_US, processor.take()) {
            return Ok(());
        }
    }
}
