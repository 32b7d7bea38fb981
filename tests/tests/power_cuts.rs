//! Power is lost in the operations of the robot's flash while the real firmware runs in the
//! emulator: it starts again with a whole mission, and with nothing lost that was acknowledged.

#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};
use std::time::{Duration, Instant};

use esm_link::behaviours::ScriptState;
use esm_link::message::{BankState, Mode, Source, Status, Swap};
use esm_tests::command::{chip_firmware, firmware, firmware_with, root};
use esm_tests::{environment, subject};
use host_tools::boards;
use host_tools::link_client::LinkClient;
use host_tools::lockstep::line;
use host_tools::lockstep::pace::Pace;
use host_tools::lockstep::plant_side::PlantSide;
use host_tools::plant::flash::{Flash, PowerCut, Tear};
use host_tools::plant::{BodyParameters, Plant};
use host_tools::qemu::{ChipSerial, Emulator, Idle};
use host_tools::script::{self, Script};
use host_tools::serial::ByteLink;
use host_tools::serial::pacing::Paced;
use host_tools::world::World;
use rt_firmware::body::{ADC_FULL_SCALE, Reply, Request, Sensors};
use rt_firmware::store::flash_store::flash_bytes_with_script;

/// Nobody waits for a line here.
const BAUD: u32 = 4_000_000;

const TEARS: [Tear; 5] = [
    Tear::Nothing,
    Tear::SomeBits(77),
    Tear::FirstHalf,
    Tear::Whole,
    Tear::LastHalf,
];

type Robot = LinkClient<Box<dyn ByteLink>>;

/// What is done to a robot, from one power-on to the next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Session {
    /// Upload the mission of this number, without a trial.
    Replace(usize),
    /// Upload it, and confirm it after its trial has begun.
    Confirm(usize),
    /// Upload it, and go back to the one before.
    GoBack(usize),
    /// Upload it, and leave it on trial.
    Try(usize),
}

const HISTORY: [Session; 6] = [
    Session::Replace(0),
    Session::Confirm(1),
    Session::GoBack(0),
    Session::Try(0),
    Session::Confirm(0),
    Session::Replace(1),
];

struct Mission {
    blob: Vec<u8>,
    hash: u32,
}

/// What must run after the next start: one of these.
#[derive(Clone, Debug)]
struct Due(Vec<u32>);

fn mission(file: &str) -> Mission {
    let blob = subject::build_file(&root().join(file)).unwrap().blob;
    let hash = u32::from_le_bytes(*blob.last_chunk().unwrap());
    Mission { blob, hash }
}

/// The firmware's own mission.
fn own() -> u32 {
    mission("missions/stand_by.esm").hash
}

/// A board whose robots lose power.
#[derive(Clone, Copy, Debug)]
enum Board {
    /// The default one, whose flash is the plant's.
    Default,
    /// The same with behaviours, which keeps a script.
    WithBehaviours,
    /// A chip with a flash of its own.
    Pico,
}

impl Board {
    fn about(self) -> &'static boards::Board {
        let name = match self {
            Board::Default | Board::WithBehaviours => boards::DEFAULT,
            Board::Pico => "pico",
        };
        boards::find(name).unwrap()
    }

    /// A flash that nothing was kept in.
    fn blank_flash(self) -> Flash {
        let board = self.about();
        let erase_bytes = board.firmware.unwrap().flash.erase_bytes;
        Flash::blank(flash_bytes_with_script(
            board.capacities.blob_bytes,
            erase_bytes,
        ))
    }

    /// Switches a robot on; gives its line.
    fn switch_on(self, flash: &Flash) -> (Emulator, Box<dyn ByteLink>) {
        match self {
            Board::Default | Board::WithBehaviours => {
                let mut sensors = Sensors::default();
                // With an empty battery the mission that takes scripts ends.
                sensors.adc_counts.fill(ADC_FULL_SCALE);
                let still = move |request: &Request| Reply {
                    sequence: request.sequence,
                    sensors,
                };
                let elf = match self {
                    Board::WithBehaviours => firmware_with("lm3s6965", "behaviours"),
                    _ => firmware("rover"),
                };
                let board = self.about();
                let mut emulator =
                    Emulator::start(board, &elf, Idle::Passes, still, flash.clone()).unwrap();
                let line = Paced::new(emulator.take_uart().unwrap(), BAUD);
                (emulator, Box::new(line))
            }
            Board::Pico => {
                let world = World::parse(include_str!("../../missions/worlds/empty.world"));
                let plant = Plant::new(world.unwrap(), BodyParameters::default(), 1).unwrap();
                let plant = PlantSide::new(plant, Pace::new(false), None);
                let (near, line) = line::pair();
                let elf = chip_firmware("pico");
                let emulator = Emulator::start_chip(
                    self.about(),
                    &elf,
                    plant,
                    flash.clone(),
                    (ChipSerial::Uart, near),
                );
                (emulator.unwrap(), Box::new(line))
            }
        }
    }

    /// Switches a robot on, and speaks to it.
    fn start(self, flash: &Flash) -> (Emulator, Robot) {
        let (emulator, line) = self.switch_on(flash);
        let (robot, _) = LinkClient::connect(line).unwrap();
        (emulator, robot)
    }
}

/// Uploads, and what follows. `due` is what was acknowledged up to where it came to.
fn live(session: Session, missions: &[Mission], robot: &mut Robot, due: &Mutex<Due>) -> Option<()> {
    let base = due.lock().unwrap().0[0];
    let trial = Swap {
        trial_ms: 60_000,
        ..Swap::default()
    };
    let (index, swap) = match session {
        Session::Replace(index) => (index, Swap::default()),
        Session::Confirm(index) | Session::GoBack(index) | Session::Try(index) => (index, trial),
    };
    let Mission { blob, hash } = &missions[index];
    *due.lock().unwrap() = Due(vec![base, *hash]);
    robot.stage(blob, &mut |_| ()).ok()?;
    robot.commit(swap).ok()?;
    match session {
        Session::Replace(_) => *due.lock().unwrap() = Due(vec![*hash]),
        Session::Confirm(_) => {
            robot.confirm(*hash).ok()?;
            *due.lock().unwrap() = Due(vec![*hash]);
        }
        Session::GoBack(_) => {
            *due.lock().unwrap() = Due(vec![base]);
            robot.fall_back(*hash).ok()?;
        }
        Session::Try(_) => *due.lock().unwrap() = Due(vec![base]),
    }
    Some(())
}

/// The robot's status as soon as what it started with has had its first macro step.
fn settled(robot: &mut Robot) -> Status {
    const PATIENCE: Duration = Duration::from_secs(60);
    let begun = Instant::now();
    loop {
        let status = robot.status().unwrap();
        if status.mode == Mode::Running && status.steps > 0 || begun.elapsed() > PATIENCE {
            return status;
        }
    }
}

/// A robot that lost power: what it says, and that it takes the next mission.
fn check(board: Board, flash: &Flash, due: &Due, missions: &[Mission]) -> Result<(), String> {
    flash.power_on();
    let (_emulator, mut robot) = board.start(flash);
    let status = settled(&mut robot);
    let kept = status.kept.ok_or("it keeps no missions")?;
    let told = format!("{:?} {:?} {kept:?}", status.mode, status.mission);
    if !status
        .mission
        .is_some_and(|mission| due.0.contains(&mission))
    {
        return Err(format!("{told}: due was {due:?}"));
    }
    let is_right = match (kept.runs, status.mission) {
        (Source::Firmware, Some(mission)) => {
            status.mode == Mode::Running && status.trial.is_none() && mission == own()
        }
        (Source::A | Source::B, Some(_)) => {
            let state = kept.slots[usize::from(kept.runs == Source::B)];
            let expected = if status.trial.is_some() {
                BankState::OnTrial
            } else {
                BankState::Runs
            };
            status.mode == Mode::Running && state == expected
        }
        _ => false,
    };
    if !is_right {
        return Err(format!("{told}: that does not fit together"));
    }
    if let (Some(_), Some(mission)) = (status.trial, status.mission) {
        robot
            .confirm(mission)
            .map_err(|error| format!("{told}: {error}"))?;
    }
    robot
        .upload(&missions[0].blob, &mut |_| ())
        .map_err(|error| format!("{told}: the next upload: {error}"))?;
    Ok(())
}

/// Cuts power in each so-many-th operation of the history, in every way; returns how many times.
fn cut_power(board: Board, one_in: usize, tears: &[Tear]) -> usize {
    let missions = [
        mission("missions/follow_wall.esm"),
        mission("missions/watch_timing.esm"),
    ];
    let flash = board.blank_flash();
    // A robot that never had a mission stands by.
    let mut due = Due(vec![own()]);
    // Each session as it goes when nothing is cut: where it starts, and how many operations it has.
    let mut cases = vec![];
    for session in HISTORY {
        let before = (flash.copy(), due.clone());
        let first = flash.operations();
        let known = Mutex::new(due);
        let (emulator, mut robot) = board.start(&flash);
        live(session, &missions, &mut robot, &known).unwrap();
        drop(emulator);
        due = known.into_inner().unwrap();
        for operation in 0..flash.operations() - first {
            cases.extend(tears.iter().map(|tear| {
                let cut = PowerCut {
                    operation,
                    tear: *tear,
                };
                (session, before.clone(), cut)
            }));
        }
    }
    let cases: Vec<_> = cases.into_iter().step_by(one_in).collect();
    let (next, cuts) = (AtomicUsize::new(0), AtomicUsize::new(0));
    let broken = Mutex::new(vec![]);
    let work = || {
        while let Some((session, (flash, due), cut)) = cases.get(next.fetch_add(1, Relaxed)) {
            let flash = flash.copy();
            flash.cut_power(*cut);
            let due = Mutex::new(due.clone());
            let is_cut = flash_is_cut(board, &flash, *session, &missions, &due);
            if is_cut {
                cuts.fetch_add(1, Relaxed);
            }
            let due = due.into_inner().unwrap();
            if let Err(problem) = check(board, &flash, &due, &missions) {
                (broken.lock().unwrap()).push(format!("{session:?}, {cut:?}: {problem}"));
            }
        }
    };
    std::thread::scope(|scope| {
        let other = scope.spawn(work);
        work();
        other.join().unwrap();
    });
    let broken = broken.into_inner().unwrap();
    assert!(
        broken.is_empty(),
        "{} of {}: {broken:#?}",
        broken.len(),
        cases.len()
    );
    cuts.into_inner()
}

/// Runs a session in which power is to be lost. The emulator is killed when it is.
fn flash_is_cut(
    board: Board,
    flash: &Flash,
    session: Session,
    missions: &[Mission],
    due: &Mutex<Due>,
) -> bool {
    let (emulator, line) = board.switch_on(flash);
    cut_while(flash, emulator, || {
        let (mut robot, _) = LinkClient::connect(line).ok()?;
        live(session, missions, &mut robot, due)
    })
}

/// Does something to a robot until power is lost; returns whether it was.
fn cut_while(flash: &Flash, emulator: Emulator, live: impl FnOnce() -> Option<()> + Send) -> bool {
    std::thread::scope(|scope| {
        let host = scope.spawn(live);
        // The line ends with the emulator, and with it all waiting.
        while !host.is_finished() {
            if flash.wait_for_power_cut(Duration::from_millis(2)) {
                break;
            }
        }
        let is_cut = flash.wait_for_power_cut(Duration::ZERO);
        drop(emulator);
        let _ = host.join();
        is_cut || flash.wait_for_power_cut(Duration::ZERO)
    })
}

/// Cuts power, and says how often, and how long that took.
fn cut_and_tell(board: Board, one_in: u64) -> usize {
    let begun = Instant::now();
    let cuts = cut_power(board, one_in as usize, &TEARS);
    println!(
        "{board:?}: {cuts} losses of power in {:.0} s",
        begun.elapsed().as_secs_f32()
    );
    cuts
}

#[test]
fn a_robot_that_loses_power_while_it_writes_its_flash_starts_again() {
    let one_in = environment::number("ESM_POWER_CUTS_ONE_IN", 41);
    let cuts = cut_and_tell(Board::Default, one_in);
    assert!(cuts >= 10, "{cuts}");
}

#[test]
fn a_pico_that_loses_power_while_it_writes_its_flash_starts_again() {
    let one_in = environment::number("ESM_PICO_POWER_CUTS_ONE_IN", 260);
    let cuts = cut_and_tell(Board::Pico, one_in);
    assert!(cuts >= 10, "{cuts}");
}

/// What is done to the script that a robot keeps, from one power-on to the next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum ScriptSession {
    /// Run the script of this number, and keep it.
    Keep(usize),
    Remove,
}

fn scripts() -> [Script; 2] {
    let text = std::fs::read_to_string(root().join("missions/rover.esm")).unwrap();
    let rover = host_tools::lang::load_text("rover.esm", &text);
    let tasks = rover.model.unwrap().tasks;
    [
        "go_to x_m = 1\nturn_to angle_rad = 1.5\n",
        "go_to x_m = 2\n",
    ]
    .map(|text| script::read("a.script", text, &tasks).script.unwrap())
}

/// Waits until the mission has made its list of behaviours; nothing where the line ends before.
fn until_it_takes_scripts(robot: &mut Robot) -> Option<()> {
    loop {
        match robot.behaviour_list() {
            Ok(_) => return Some(()),
            Err(error) => error.refusal().map(|_| ())?,
        }
    }
}

/// Does so. `due` is what may be kept where it came to, by its name; 0 is none.
fn keep(
    session: ScriptSession,
    scripts: &[Script],
    robot: &mut Robot,
    due: &Mutex<Vec<u32>>,
) -> Option<()> {
    let id = match session {
        ScriptSession::Keep(index) => scripts[index].id(),
        ScriptSession::Remove => 0,
    };
    until_it_takes_scripts(robot)?;
    due.lock().unwrap().push(id);
    match session {
        ScriptSession::Keep(index) => {
            robot.run_script(&scripts[index]).ok()?;
            robot.keep_script(&scripts[index]).ok()?;
        }
        ScriptSession::Remove => robot.remove_script().ok()?,
    }
    *due.lock().unwrap() = vec![id];
    Some(())
}

/// A robot that lost power: what it keeps it runs, and it keeps the next one.
fn check_script(flash: &Flash, due: &[u32], scripts: &[Script]) -> Result<(), String> {
    flash.power_on();
    let (_emulator, mut robot) = Board::WithBehaviours.start(flash);
    let status = settled(&mut robot);
    until_it_takes_scripts(&mut robot).ok_or("it takes no scripts")?;
    let kept = robot.kept_script().map_err(|error| error.to_string())?;
    let told = format!("{:?} {:?} {kept:?}", status.mode, status.mission);
    if !due.contains(&kept.script) {
        return Err(format!("{told}: due was {due:?}"));
    }
    if (kept.script != 0) != (kept.state == ScriptState::Runs) {
        return Err(format!("{told}: it is for the mission that runs"));
    }
    let begun = Instant::now();
    while begun.elapsed() < Duration::from_secs(30) {
        let runs = robot.behaviour_list().map_err(|error| error.to_string())?;
        if runs.script.script == kept.script {
            let next = &scripts[usize::from(kept.script == scripts[0].id())];
            return (robot.run_script(next))
                .and_then(|()| robot.keep_script(next))
                .map_err(|error| format!("{told}: the next script: {error}"));
        }
    }
    Err(format!("{told}: it does not run"))
}

/// One in how many operations of writing a script is cut.
const SCRIPT_CUTS_ONE_IN: u64 = 11;

#[test]
fn a_script_whose_writing_loses_power_is_kept_whole_or_the_one_before_is() {
    let one_in = environment::number("ESM_SCRIPT_CUTS_ONE_IN", SCRIPT_CUTS_ONE_IN);
    let (board, scripts) = (Board::WithBehaviours, scripts());
    let flash = board.blank_flash();
    let (emulator, mut robot) = board.start(&flash);
    let by_hand = mission("missions/by_hand.esm");
    robot.upload(&by_hand.blob, &mut |_| ()).unwrap();
    settled(&mut robot);
    drop(emulator);
    let mut due = vec![0];
    let mut cases = vec![];
    for session in [
        ScriptSession::Keep(0),
        ScriptSession::Keep(1),
        ScriptSession::Remove,
    ] {
        let before = (flash.copy(), due.clone());
        flash.power_on();
        let first = flash.operations();
        let (emulator, mut robot) = board.start(&flash);
        let known = Mutex::new(due);
        keep(session, &scripts, &mut robot, &known).unwrap();
        drop(emulator);
        due = known.into_inner().unwrap();
        for operation in 0..flash.operations() - first {
            cases.extend(TEARS.map(|tear| (session, before.clone(), PowerCut { operation, tear })));
        }
    }
    let mut cuts = 0;
    let begun = Instant::now();
    let all = cases.len();
    for (session, (flash, due), cut) in cases.into_iter().step_by(one_in as usize) {
        let flash = flash.copy();
        flash.cut_power(cut);
        let due = Mutex::new(due);
        let (emulator, line) = board.switch_on(&flash);
        let is_cut = cut_while(&flash, emulator, || {
            let (mut robot, _) = LinkClient::connect(line).ok()?;
            keep(session, &scripts, &mut robot, &due)
        });
        cuts += usize::from(is_cut);
        let due = due.into_inner().unwrap();
        if let Err(problem) = check_script(&flash, &due, &scripts) {
            panic!("{session:?}, {cut:?}: {problem}");
        }
    }
    println!(
        "{cuts} losses of power, of {all} that there may be, in {:.0} s",
        begun.elapsed().as_secs_f32()
    );
    assert!(cuts >= 10.min(all / one_in as usize), "{cuts}");
}
