//! A processor of a system that is a board in an emulator.
//!
//! A thread of its own drives it, as it drives a board alone: upload, streams, story. Each of its
//! slots begins with an exchange of its pins, for whose answer its virtual time stands still. So
//! with the answer it is its turn, up to the next exchange; what it sends meanwhile is sent before
//! any other processor comes to that time.

use std::io::{self, Write};
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{self, JoinHandle};

use esm_toolkit::boards;
use esm_toolkit::host_run::{Behind, Ended, Given, Planned as HostPlanned, RunError as StepError};
use esm_toolkit::medium::clock::Clock;
use esm_toolkit::plant::behind_pins::BehindPins;
use esm_toolkit::system::lock_step::{InStep, Member};
use esm_toolkit::system::shared_plant::ProcessorPins;
use esm_toolkit::system::wiring::Uart;
use esm_toolkit::world::World;
use rt_firmware::body::frames::CarriedFrame;
use rt_firmware::body::{Reply, Request};

use crate::interrupt::Interrupt;
use crate::lockstep::in_system::{self, Asked, SystemSide};
use crate::qemu::EmulatorError;
use crate::run::board::{Board, LinkWay};
use crate::run::drive::{self, Heard, Plan, Planned, Run, RunError};
use crate::run::mission::Mission;

/// An emulated board and what it runs.
#[derive(Clone)]
pub struct Emulated {
    /// The board.
    pub board: &'static boards::Board,
    /// The ELF file, of a firmware with links.
    pub firmware: PathBuf,
    /// The files of its missions, for messages: of the first, and of those that take over.
    pub missions: Vec<PathBuf>,
    /// Whether what enters its interpreter is kept.
    pub records: bool,
}

/// Where a thread writes a recording.
#[derive(Clone, Default)]
struct Recording(Arc<Mutex<Vec<u8>>>);

impl Write for Recording {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let mut written = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        written.extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// What a thread has heard of its board, and nobody has taken yet.
type Words = Arc<Mutex<Given>>;

/// A processor that runs in an emulator.
pub struct EmulatedProcessor {
    side: Option<SystemSide>,
    thread: Option<JoinHandle<Result<Run<Vec<u8>>, RunError>>>,
    words: Words,
    recording: Recording,
    clock: Clock,
    pins: ProcessorPins,
    uart: Option<Uart>,
    /// The exchange that begins its next slot; none where its run is over.
    next: Option<Request>,
    last: Reply,
}

impl EmulatedProcessor {
    /// Starts the board and brings its mission to it, up to the first slot. The run has a seed, and
    /// ends at a plant time in microseconds.
    ///
    /// # Errors
    /// [`RunError`]
    pub fn switch_on(
        emulated: Emulated,
        member: Member,
        world: &World,
        (pins, uart): (ProcessorPins, Option<Uart>),
        (seed, until_us): (u64, u64),
    ) -> Result<Self, RunError> {
        let clock = member.life.clock;
        let until_us = member.until_us(until_us);
        let (board_side, side) = in_system::pair();
        let words = Words::default();
        let recording = Recording::default();
        let record: Option<Box<dyn Write + Send>> = match emulated.records {
            true => Some(Box::new(recording.clone())),
            false => None,
        };
        let missions = planned(&emulated.missions, member)
            .ok_or_else(|| failed("read the missions", io::ErrorKind::InvalidData.into()))?;
        let interrupt =
            Interrupt::take_over().map_err(|cause| failed("take over Ctrl-C", cause))?;
        let thread = thread::Builder::new().name(emulated.board.name.to_owned());
        let thread = thread.spawn({
            let (words, world) = (Arc::clone(&words), world.clone());
            move || {
                let Emulated {
                    board, firmware, ..
                } = emulated;
                let plan = Plan {
                    link: LinkWay::Exchange,
                    seed,
                    until_us: Some(until_us),
                    system: Some(Arc::new(board_side)),
                    record: record.map(|out| out as Box<dyn Write>),
                    ..Plan::new(Board::Emulated { board, firmware }, world, missions)
                };
                let mut watch = |heard: Heard<'_>| take_word(&words, &heard);
                drive::drive(plan, Vec::new(), interrupt, &mut watch)
            }
        });
        let thread = thread.map_err(|cause| failed("start the thread of a board", cause))?;
        let mut processor = EmulatedProcessor {
            side: Some(side),
            thread: Some(thread),
            words,
            recording,
            clock,
            pins,
            uart,
            next: None,
            last: Reply::default(),
        };
        processor.go_on();
        match processor.next {
            Some(_) => Ok(processor),
            None => Err(match processor.join() {
                Err(error) => error,
                // The person ended it.
                Ok(_) => failed("start the board", io::ErrorKind::Interrupted.into()),
            }),
        }
    }

    /// Answers what it asks up to its next slot.
    fn go_on(&mut self) {
        self.next = None;
        let Some(side) = &self.side else {
            return;
        };
        while let Some(asked) = side.next() {
            match asked {
                Asked::Pins(request) => {
                    self.next = Some(request);
                    return;
                }
                Asked::Starts(frame) => {
                    if let Some(uart) = &mut self.uart {
                        uart.start(frame);
                    }
                    side.take_frame();
                }
                Asked::Arrived(until_us) => {
                    let uart = self.uart.as_mut();
                    side.give_frame(uart.map_or(CarriedFrame::NONE, |it| it.arrived(until_us)));
                }
            }
        }
    }

    /// Lets it tell the rest of its story, with a body that stands still.
    ///
    /// # Errors
    /// [`RunError`]
    pub fn finish(mut self) -> Result<Option<Ended>, RunError> {
        self.uart = None;
        let plant = self.pins.at_end();
        while let Some(Request { sequence, .. }) = self.next {
            if let Some(side) = &self.side {
                side.give_pins(Reply {
                    sequence,
                    ..self.last
                });
            }
            self.go_on();
        }
        let Run { told, summary, .. } = self.join()?;
        let mut written = self.recording.0.lock();
        let recording = written
            .as_deref_mut()
            .map(std::mem::take)
            .unwrap_or_default();
        Ok((!told.missions.is_empty()).then_some(Ended {
            told,
            recording,
            plant,
            slots_missed: summary.slots_missed,
        }))
    }

    fn join(&mut self) -> Result<Run<Vec<u8>>, RunError> {
        let ended = self.thread.take().map(JoinHandle::join);
        match ended {
            Some(Ok(run)) => run,
            _ => Err(failed(
                "end the thread of a board",
                io::ErrorKind::Other.into(),
            )),
        }
    }
}

/// The missions of a member as they are brought to a board. None where one is damaged.
fn planned(files: &[PathBuf], member: Member) -> Option<Vec<Planned>> {
    let first = HostPlanned {
        at_us: 0,
        mission: member.mission,
        warm: false,
    };
    let missions = [first].into_iter().chain(member.then).zip(files);
    let planned = missions.map(|(planned, file)| {
        let verified = esm_core::verify(planned.mission.blob).ok()?;
        Some(Planned {
            at_us: planned.at_us,
            warm: planned.warm,
            ..Planned::first(Mission::new(file, verified).ok()?)
        })
    });
    planned.collect()
}

fn failed(what: &'static str, cause: io::Error) -> RunError {
    RunError::Board(EmulatorError::System { what, cause }.into())
}

impl Drop for EmulatedProcessor {
    fn drop(&mut self) {
        // A board whose exchanges are not answered ends its run.
        self.side = None;
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

impl InStep for EmulatedProcessor {
    fn next_ps(&self) -> Option<u64> {
        Some(self.clock.plant_ps(self.next?.start_us))
    }

    fn step(&mut self) -> Result<(), StepError> {
        let Some(request) = self.next else {
            return Ok(());
        };
        self.last = self.pins.exchange(&request);
        if let Some(side) = &self.side {
            side.give_pins(self.last);
        }
        self.go_on();
        if let Some(next) = &self.next {
            self.pins.announce(next.effect_us, &next.actuators);
        }
        Ok(())
    }

    fn take(&mut self) -> Given {
        std::mem::take(&mut *self.words.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

/// Keeps what is for the person.
fn take_word(words: &Words, heard: &Heard<'_>) {
    let mut words = words.lock().unwrap_or_else(PoisonError::into_inner);
    match heard {
        Heard::Happened(said) => words.words.push((0, (*said).to_owned())),
        Heard::Warning(said) => words.words.push((0, format!("warning: {said}"))),
        Heard::Log(line) => words.log.push((0, line.words().to_string())),
        Heard::UploadBegins(_)
        | Heard::Uploaded(_)
        | Heard::UploadEnds(_)
        | Heard::FinishedWithoutEnd => {}
    }
}
