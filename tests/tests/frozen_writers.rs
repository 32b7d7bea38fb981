//! A task that is executed and writes nothing any more: how long until its robot stands.
//!
//! Each writer freezes in turn, on a robot that drives: its slot goes on, what it wrote last stays
//! on its nets and pins. Each bound follows from the times behind `within` in the readers'
//! declarations, or from the deadman time.

#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

use std::array;
use std::cell::Cell;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

use esm_link::message::{Mode, SafeReason};
use esm_tests::command::root;
use esm_tests::endurance::{Body, drive_robot};
use esm_tests::subject;
use host_tools::files::load_world;
use host_tools::plant::{BodyParameters, Plant};
use rt_firmware::body::{DEADMAN_US, DirectionPin, MotorPwm, PinImage, Request};
use rt_firmware::drivers::DcMotor;
use rt_firmware::ports::SILENT_EXECUTIONS;
use rt_firmware::rover::{Measures, PinRoverParts};
use rt_firmware::task::{Declaration, Declared};
use rt_firmware::tasks::{
    Back, BatteryGuard, Cruise, DriveDistance, DriveOpenLoop, FollowLine, FollowWall, LineMonitor,
    LinkMonitor, Logger, ProximityMonitor, RoundCorner, SlotMonitor, Stop, Turn, WheelSpeed,
};
use rt_firmware::{AnyTaskPool, Io, Step, Task, TaskPool};

/// Which task freezes, and when.
struct Freeze {
    task: &'static str,
    /// Not before this robot time, in microseconds,
    after_us: u64,
    /// and not before its state has been active for so many executions.
    executions: u32,
    /// When it froze: nominal start of the first execution that wrote nothing.
    frozen_us: AtomicU64,
}

const NOT_FROZEN: u64 = u64::MAX;

impl Freeze {
    fn new(task: &'static str, after_us: u64) -> Self {
        Freeze {
            task,
            after_us,
            executions: 20, // it moves by then
            frozen_us: AtomicU64::new(NOT_FROZEN),
        }
    }

    /// Whether the task is frozen; it freezes with the execution at `now_us` if its time has come.
    fn holds(&self, task: &str, executions: u32, now_us: u64) -> bool {
        if task != self.task {
            return false;
        }
        let begins = now_us >= self.after_us && executions >= self.executions;
        if begins && self.frozen_us.load(Relaxed) == NOT_FROZEN {
            self.frozen_us.store(now_us, Relaxed);
        }
        self.frozen_us.load(Relaxed) != NOT_FROZEN
    }
}

/// A task as it is declared, that does nothing any more once it is frozen.
struct Frozen<'f, T> {
    task: T,
    freeze: &'f Freeze,
    /// Since its state was entered.
    executions: u32,
}

impl<T: Declared> Declared for Frozen<'_, T> {
    const SIGNATURE: &'static str = T::SIGNATURE;
    const DECLARATION: Declaration = T::DECLARATION;
    type Outputs = T::Outputs;
}

impl<T: Task> Task for Frozen<'_, T> {
    fn reset(&mut self) {
        self.task.reset();
    }

    fn enter(&mut self) {
        self.executions = 0;
        self.task.enter();
    }

    fn step(&mut self, io: &mut Io<'_>) -> Step {
        if (self.freeze).holds(T::DECLARATION.name, self.executions, io.now_us()) {
            return Step::Run;
        }
        self.executions += 1;
        self.task.step(io)
    }
}

/// What drives the motors.
#[derive(Clone, Copy, PartialEq)]
enum Wheels {
    /// `WheelSpeed`
    Controlled,
    /// `DriveOpenLoop`
    OpenLoop,
}

/// The board and the body at the nominal start of an activation.
#[derive(Clone, Copy)]
struct Moment {
    robot_us: u64,
    duties: [i16; 2],
    /// Way of the body's centre since the start.
    distance_m: f64,
    heading_rad: f64,
    collisions: u32,
}

/// How a robot drove, one of whose tasks froze.
struct Driven {
    frozen_us: u64,
    moments: Vec<Moment>,
    mode: Mode,
}

/// A mission, a world for it, and who drives the motors.
struct Subject {
    mission: String,
    world: &'static str,
    wheels: Wheels,
}

impl Subject {
    fn new(mission: String, world: &'static str) -> Self {
        Subject {
            mission,
            world,
            wheels: Wheels::Controlled,
        }
    }

    /// Drives for so long.
    fn driven(&self, freeze: &Freeze, duration_us: u64) -> Driven {
        let rover = std::fs::read(root().join("missions/rover.esm")).unwrap();
        let files = [
            ("mission.esm", self.mission.as_bytes()),
            ("rover.esm", &*rover),
        ];
        let blob = subject::build_files(&files).unwrap().blob;
        let world = load_world(&root().join(format!("missions/worlds/{}.world", self.world)));
        let mut plant = Plant::new(world.unwrap(), BodyParameters::default(), 1).unwrap();
        let pins = PinImage::new();
        let mut moments = Vec::new();
        let mut answer = |request: &Request| {
            let reply = plant.exchange(request);
            let actuators = &request.actuators;
            moments.push(Moment {
                robot_us: request.start_us,
                duties: [actuators.left_duty, actuators.right_duty],
                distance_m: plant.distance_m(),
                heading_rad: plant.pose().heading_rad,
                collisions: plant.collisions(),
            });
            reply
        };
        let body = Body::Answering(&mut answer);
        let run = with_robot(&pins, freeze, self.wheels, |banks| {
            drive_robot(&blob, &pins, banks, body, duration_us)
        });
        Driven {
            frozen_us: freeze.frozen_us.load(Relaxed),
            moments,
            mode: run.unwrap().status.mode,
        }
    }
}

/// Makes the rover of tasks that can freeze.
fn with_robot<R>(
    pins: &PinImage,
    freeze: &Freeze,
    wheels: Wheels,
    run: impl FnOnce(&mut [&mut (dyn AnyTaskPool + '_)]) -> R,
) -> R {
    fn bank<'f, T: Task, const N: usize>(
        freeze: &'f Freeze,
        task: impl Fn() -> T,
    ) -> TaskPool<Frozen<'f, T>, N> {
        TaskPool::new(array::from_fn(|_| Frozen {
            task: task(),
            freeze,
            executions: 0,
        }))
    }
    fn one<T: Task>(freeze: &Freeze, task: T) -> TaskPool<Frozen<'_, T>, 1> {
        let task = Cell::new(Some(task));
        bank(freeze, || task.take().unwrap())
    }
    let tasks = PinRoverParts::from(pins.parts()).into_tasks(&Measures::ROVER);
    let parts = pins.parts();
    let open_loop = DriveOpenLoop::new(
        DcMotor::new(parts.left_pwm, parts.left_direction),
        DcMotor::new(parts.right_pwm, parts.right_direction),
        Measures::ROVER.chassis,
    );
    let mut wheel_speed = one(freeze, tasks.wheel_speed);
    let mut open_loop = one(freeze, open_loop);
    run(&mut [
        // Whose outputs are the same pins: one of them has them.
        match wheels {
            Wheels::Controlled => &mut wheel_speed,
            Wheels::OpenLoop => &mut open_loop,
        },
        &mut one(freeze, tasks.sonar_ring),
        &mut one(freeze, tasks.odometry),
        &mut one(freeze, tasks.battery_monitor),
        &mut one(freeze, tasks.line_sensor),
        &mut one(freeze, ProximityMonitor),
        &mut bank::<_, 2>(freeze, || Cruise),
        &mut bank::<_, 3>(freeze, Back::default),
        &mut bank::<_, 4>(freeze, Turn::default),
        &mut bank::<_, 4>(freeze, DriveDistance::default),
        &mut one(freeze, FollowWall),
        &mut one(freeze, RoundCorner),
        &mut bank::<_, 3>(freeze, || Stop),
        &mut one(freeze, Logger),
        &mut bank::<_, 4>(freeze, || LineMonitor),
        &mut bank::<_, 2>(freeze, || FollowLine),
        &mut one(freeze, BatteryGuard::default()),
        &mut one(freeze, SlotMonitor::default()),
        &mut one(freeze, LinkMonitor::default()),
    ])
}

/// How long a robot is watched once its task is frozen, in microseconds: longer than each bound.
const WATCHED_US: u64 = 2_000_000;
/// The slowest tasks of these missions run each 40 ms, the others each 20 ms. The pins are
/// exchanged as often.
const PERIOD_US: u64 = 20_000;
const SLOW_PERIOD_US: u64 = 40_000;
/// Time in which wheels that are asked to stand have done so, on the way down from 0.4 m/s with the
/// 1.2 m/s² of `WheelSpeed` and `DriveOpenLoop`. No wheel turns faster in these missions.
const BRAKING_US: u64 = 333_334;
/// Time in which a wheel without power has come to stand: five times the time that its motor takes
/// to slow down to 1/e.
const ROLLING_US: u64 = 400_000;
/// A wheel slower than this stands.
const STANDING_M_PER_S: f64 = 0.005;

/// Speed of the faster wheel between two moments, from how the body really moved.
fn wheel_m_per_s(from: &Moment, to: &Moment) -> f64 {
    let base_m = BodyParameters::default().wheel_base_m;
    let turned_m = (to.heading_rad - from.heading_rad).abs() * base_m / 2.0;
    let way_m = to.distance_m - from.distance_m + turned_m;
    way_m / ((to.robot_us - from.robot_us) as f64 / 1e6)
}

impl Driven {
    /// Moments of the slot that comes first in each period.
    fn periods(&self) -> Vec<Moment> {
        let whole = |moment: &&Moment| moment.robot_us.is_multiple_of(20_000);
        self.moments.iter().filter(whole).copied().collect()
    }

    /// Speed of the faster wheel just before the task froze.
    fn before_m_per_s(&self) -> f64 {
        let periods = self.periods();
        let before = periods
            .windows(2)
            .take_while(|pair| pair[1].robot_us <= self.frozen_us);
        before
            .map(|pair| wheel_m_per_s(&pair[0], &pair[1]))
            .last()
            .unwrap()
    }

    /// From when on both motors have no power, to the end of what was watched.
    fn power_off_us(&self) -> u64 {
        let last = self.moments.iter().rposition(|at| at.duties != [0, 0]);
        let off = self.moments.get(last.unwrap() + 1);
        off.map_or(u64::MAX, |at| at.robot_us.saturating_sub(self.frozen_us))
    }

    /// From when on the wheels stand, to the end of what was watched.
    fn stands_us(&self) -> u64 {
        let periods = self.periods();
        let rolls = |pair: &[Moment]| wheel_m_per_s(&pair[0], &pair[1]) > STANDING_M_PER_S;
        let last = periods.windows(2).rposition(rolls).unwrap();
        if last + 2 == periods.len() {
            return u64::MAX;
        }
        periods[last + 1].robot_us.saturating_sub(self.frozen_us)
    }

    /// How far the body's centre moved after the task froze.
    fn later_m(&self) -> f64 {
        let frozen = |at: &&Moment| at.robot_us <= self.frozen_us;
        let at_freeze_m = self.moments.iter().rfind(frozen).unwrap().distance_m;
        self.moments.last().unwrap().distance_m - at_freeze_m
    }

    fn collisions(&self) -> u32 {
        self.moments.last().unwrap().collisions
    }
}

/// How old a value may be that a task reads, in microseconds.
fn within_us<T: Declared>(port: &str) -> u64 {
    let ports = T::DECLARATION.ports;
    let port = ports.iter().find(|declared| declared.name == port).unwrap();
    port.within_us.unwrap().into()
}

type PinWheelSpeed =
    WheelSpeed<MotorPwm<'static>, DirectionPin<'static>, MotorPwm<'static>, DirectionPin<'static>>;
type PinOpenLoop = DriveOpenLoop<
    MotorPwm<'static>,
    DirectionPin<'static>,
    MotorPwm<'static>,
    DirectionPin<'static>,
>;

/// The wheels are asked for nothing any more, and brake.
fn twist_bound_us<Driver: Declared>() -> u64 {
    within_us::<Driver>("twist") + PERIOD_US + BRAKING_US
}

/// Who asks for a movement misses something, asks for none, and the wheels brake.
fn input_bound_us<T: Declared>(port: &str) -> u64 {
    within_us::<T>(port) + 2 * PERIOD_US + BRAKING_US
}

/// The motors get no power from an exchange after the deadman time on.
const DEADMAN_BOUND_US: u64 = DEADMAN_US + PERIOD_US;

/// Drives until the task freezes and for so long that it must stand; holds it against the bound.
fn stands(subject: &Subject, task: &'static str, after_us: u64, bound_us: u64) -> Driven {
    // It freezes in each run at the same time.
    let scout = Freeze::new(task, after_us);
    let frozen_us = subject.driven(&scout, 60_000_000).frozen_us;
    assert_ne!(frozen_us, NOT_FROZEN, "{task} never ran so long");
    let freeze = Freeze::new(task, after_us);
    let driven = subject.driven(&freeze, frozen_us + WATCHED_US);
    let what = format!("{task} in the {}", subject.world);
    assert_eq!(driven.collisions(), 0, "{what}");
    assert_eq!(driven.mode, Mode::Running, "{what}");
    driven.stands_within(&what, bound_us);
    let (stands_us, later_m) = (driven.stands_us(), driven.later_m());
    assert!(stands_us <= MOST_STANDS_US, "{what}: {stands_us} us");
    assert!(later_m <= MOST_WAY_M, "{what}: {later_m} m");
    driven
}

/// Whoever freezes that has a part in moving a robot: it stands by then, after this way at most.
/// The book says so.
const MOST_STANDS_US: u64 = 700_000;
const MOST_WAY_M: f64 = 0.12;

impl Driven {
    /// That it moved, and that the motors have no power from the bound on.
    fn stands_within(&self, what: &str, bound_us: u64) {
        let before_m_per_s = self.before_m_per_s();
        let (power_off_us, stands_us) = (self.power_off_us(), self.stands_us());
        println!(
            "{what}, at {} us, {before_m_per_s:.2} m/s: no power {power_off_us} us later, {bound_us} at most, \
             stands {stands_us} us later, after {:.3} m",
            self.frozen_us,
            self.later_m()
        );
        assert!(before_m_per_s > 0.03, "{what}: {before_m_per_s} m/s");
        assert!(power_off_us <= bound_us, "{what}: {power_off_us} us");
        assert!(stands_us <= bound_us + ROLLING_US, "{what}: {stands_us} us");
    }

    /// That the book's table has these numbers in the row of `name`; `ESM_BLESS=1` writes them.
    fn is_in_book(&self, name: &str) {
        static BOOK: Mutex<()> = Mutex::new(());
        let _one_at_a_time = BOOK.lock();
        let path = root().join("docs/src/breakdowns.md");
        let book = std::fs::read_to_string(&path).unwrap();
        let expected = format!(
            "| {:.2} s | {:.2} s | {} cm |",
            self.power_off_us() as f64 / 1e6,
            self.stands_us() as f64 / 1e6,
            (self.later_m() * 100.0) as u32 + 1
        );
        let row = |line: &&str| {
            line.starts_with(&format!("| {name} ")) && line.matches(" | ").count() == 4
        };
        let row = book.lines().find(row).unwrap_or("");
        if std::env::var_os("ESM_BLESS").is_some() && !row.ends_with(&expected) {
            let what: Vec<&str> = row.split(" | ").take(2).collect();
            let written = format!("{} {expected}", what.join(" | "));
            std::fs::write(path, book.replace(row, &written)).unwrap();
            return;
        }
        assert!(
            row.ends_with(&expected),
            "the row of {name} is to end with {expected}, and is: {row} (ESM_BLESS=1 writes it)"
        );
    }
}

fn patrol() -> String {
    std::fs::read_to_string(root().join("missions/patrol.esm")).unwrap()
}

/// A mission with nothing but this motion, and what it needs.
fn mission(motion: &str, paths: &str) -> String {
    format!(
        r#"use "rover.esm";
        interpreter slot 1;
        slot 1 period 20 ms duration 2 ms;
        slot 2 period 20 ms duration 4 ms;
        slot 3 period 40 ms duration 2 ms;
        machine Small {{
            region sonars {{ task Listen: SonarRing; initial -> Listen; }}
            region position {{ task Track: Odometry; initial -> Track; }}
            region motion {{ {motion} }}
            region wheels {{ task Drive: WheelSpeed; initial -> Drive; }}
            path Track.pose -> Listen.pose;
            path Track.speeds -> Drive.speeds;
            {paths}
        }}"#
    )
}

#[test]
fn patrol_stands_whoever_of_its_writers_freezes() {
    let office = Subject::new(patrol(), "office");
    const FAST_US: u64 = 34_000_000; // down a free way, at full speed
    let ranges_us = input_bound_us::<Cruise>("ranges");
    stands(&office, "SonarRing", FAST_US, ranges_us).is_in_book("`SonarRing`");
    let speeds_us = within_us::<PinWheelSpeed>("speeds") + PERIOD_US;
    stands(&office, "Odometry", FAST_US, speeds_us).is_in_book("`Odometry`");
    for task in ["Cruise", "Back", "Turn"] {
        let bound_us = twist_bound_us::<PinWheelSpeed>();
        stands(&office, task, FAST_US, bound_us).is_in_book(&format!("`{task}`"));
    }
    stands(&office, "WheelSpeed", FAST_US, DEADMAN_BOUND_US).is_in_book("`WheelSpeed`");
}

#[test]
fn patrol_stands_too_where_the_sonars_freeze_while_it_turns() {
    // `Turn` needs no ranges. But `ProximityMonitor` says close, which is an event, and on that
    // `Stop` is entered.
    let close_us = within_us::<ProximityMonitor>("ranges") + SLOW_PERIOD_US;
    let bound_us = close_us + 2 * PERIOD_US + BRAKING_US;
    let office = Subject::new(patrol(), "office");
    stands(&office, "SonarRing", 18_600_000, bound_us)
        .is_in_book("`SonarRing`, while the robot turns");
    // The alarm ends after a second, again and again. It stands all the same, to the end.
    let driven = office.driven(&Freeze::new("SonarRing", 34_000_000), 60_000_000);
    assert!(driven.stands_us() <= MOST_STANDS_US);
    assert_eq!(driven.collisions(), 0);
}

#[test]
fn each_task_that_asks_for_movement_can_freeze() {
    let all = "path Listen.ranges -> Go.ranges; path Go.twist -> Drive.twist;";
    let pose = "path Track.pose -> Go.pose; path Go.twist -> Drive.twist;";
    let both = "path Listen.ranges -> Go.ranges; path Track.pose -> Go.pose; path Go.twist -> Drive.twist;";
    for (task, with, paths, world) in [
        ("Cruise", "", all, "office"),
        ("Back", "with { distance_m = 0.5 }", both, "corridor"),
        ("Turn", "with { angle_rad = 6.0 }", pose, "office"),
        ("DriveDistance", "", pose, "corridor"),
        ("FollowWall", "", all, "corridor"),
        ("RoundCorner", "", all, "corridor"),
    ] {
        let motion = format!("task Go: {task} {with}; initial -> Go; Go -> final on *;");
        let subject = Subject::new(mission(&motion, paths), world);
        let driven = stands(&subject, task, 0, twist_bound_us::<PinWheelSpeed>());
        if !["Cruise", "Back", "Turn"].contains(&task) {
            driven.is_in_book(&format!("`{task}`"));
        }
    }
}

#[test]
fn a_robot_on_a_line_stands_without_its_line_or_who_follows_it() {
    let motion = "task Go: FollowLine; initial -> Go;";
    let look = "task Look: LineSensor; initial -> Look;";
    let paths = format!(
        "region floor {{ {look} }} path Look.line -> Go.line; path Go.twist -> Drive.twist;"
    );
    let track = Subject::new(mission(motion, &paths), "track");
    let line_us = input_bound_us::<FollowLine>("line");
    stands(&track, "LineSensor", 2_000_000, line_us).is_in_book("`LineSensor`");
    let twist_us = twist_bound_us::<PinWheelSpeed>();
    stands(&track, "FollowLine", 2_000_000, twist_us).is_in_book("`FollowLine`");
}

#[test]
fn a_robot_stands_in_a_state_in_which_nobody_asks_for_movement() {
    // Nothing freezes here: the state that wrote is left, and what it wrote last stays on the net.
    let motion =
        "task Ahead: Cruise timeout 2 s; state Halt; initial -> Ahead; Ahead -> Halt [timeout];";
    let paths = "path Listen.ranges -> Ahead.ranges; path Ahead.twist -> Drive.twist;";
    let subject = Subject::new(mission(motion, paths), "office");
    let mut driven = subject.driven(&Freeze::new("nobody", 0), 60_000_000);
    driven.frozen_us = 2_000_000; // the macro step in which it is left
    driven.stands_within("Halt", twist_bound_us::<PinWheelSpeed>());
    driven.is_in_book("nobody: a state without a task is entered");
    assert_eq!(driven.collisions(), 0);
}

#[test]
fn a_stop_that_freezes_as_soon_as_it_is_entered_stands_all_the_same() {
    let motion = "task Ahead: Cruise timeout 2 s; task Halt: Stop; \
                  initial -> Ahead; Ahead -> Halt [timeout];";
    let paths = "path Listen.ranges -> Ahead.ranges; path Ahead.twist, Halt.twist -> Drive.twist;";
    let subject = Subject::new(mission(motion, paths), "office");
    let freeze = Freeze {
        executions: 0,
        ..Freeze::new("Stop", 0)
    };
    let driven = subject.driven(&freeze, 60_000_000);
    driven.stands_within("Stop", twist_bound_us::<PinWheelSpeed>());
}

#[test]
fn a_robot_without_encoders_stands_too() {
    let mut declared = Vec::new();
    PinOpenLoop::DECLARATION.tell_source(1, &mut |piece| declared.extend_from_slice(piece));
    let declared = String::from_utf8(declared).unwrap();
    let motion = "task Go: Cruise; initial -> Go;";
    let paths = "path Listen.ranges -> Go.ranges; path Go.twist -> Drive.twist;";
    let mission = mission(motion, paths)
        .replace("path Track.speeds -> Drive.speeds;", "")
        .replace("task Drive: WheelSpeed", "task Drive: DriveOpenLoop")
        .replace("machine Small", &format!("{declared} machine Small"));
    let subject = Subject {
        wheels: Wheels::OpenLoop,
        ..Subject::new(mission, "office")
    };
    let after_us = 2_000_000;
    stands(
        &subject,
        "Cruise",
        after_us,
        twist_bound_us::<PinOpenLoop>(),
    );
    let ranges_us = input_bound_us::<Cruise>("ranges");
    stands(&subject, "SonarRing", after_us, ranges_us);
    stands(&subject, "DriveOpenLoop", after_us, DEADMAN_BOUND_US).is_in_book("`DriveOpenLoop`");
}

#[test]
fn a_battery_that_nobody_measures_counts_as_empty_where_somebody_guards_it() {
    const LEFT_US: u64 = 34_000_000;
    // Nothing freezes here: the state is left that measures.
    let guard = "region guard { task Keep: BatteryGuard; initial -> Keep; }\n    region diary {";
    let guarded = patrol()
        .replace("region diary {", guard)
        .replace(
            "path Measure.battery -> Write.battery;",
            "path Measure.battery -> Keep.battery, Write.battery;",
        )
        .replace(
            "task Measure: BatteryMonitor;",
            "task Measure: BatteryMonitor timeout 34 s;",
        )
        .replace(
            "Measure -> final on pulse [.low]",
            "Measure -> final [timeout]; Measure -> final on pulse [.low]",
        );
    let subject = Subject::new(guarded, "office");
    let mut driven = subject.driven(&Freeze::new("nobody", 0), LEFT_US + 2 * WATCHED_US);
    driven.frozen_us = LEFT_US + PERIOD_US; // the macro step in which it is left
    // The guard's second, the voltage's age before that, and an activation of the guard's slot
    // beyond each.
    let bound_us = within_us::<BatteryGuard>("battery") + 1_000_000 + 2 * SLOW_PERIOD_US;
    driven.stands_within("nobody measures the battery", bound_us);
    driven.is_in_book("nobody: the state that measures is left, with a `BatteryGuard`");
    assert_eq!(driven.mode, Mode::Safe(SafeReason::LowBattery));
}

/// A flag has no age. So a task that watches says something in each execution, and where one does
/// not any more, the firmware stops the robot.
fn stops_without(subject: &Subject, task: &'static str, period_us: u64) {
    const AFTER_US: u64 = 5_000_000;
    let scout = Freeze::new(task, AFTER_US);
    let frozen_us = subject.driven(&scout, 60_000_000).frozen_us;
    assert_ne!(frozen_us, NOT_FROZEN, "{task} never ran so long");
    let driven = subject.driven(&Freeze::new(task, AFTER_US), frozen_us + WATCHED_US);
    assert_eq!(driven.mode, Mode::Safe(SafeReason::MonitorSilent), "{task}");
    assert_eq!(driven.collisions(), 0, "{task}");
    // The one that is frozen first counts; the motors are off in the exchange behind the last one.
    driven.stands_within(task, u64::from(SILENT_EXECUTIONS) * period_us);
    assert!(driven.stands_us() <= MOST_STANDS_US, "{task}");
    assert!(
        driven.later_m() <= MOST_WAY_M,
        "{task}: {} m",
        driven.later_m()
    );
    driven.is_in_book(&format!("`{task}`"));
}

#[test]
fn patrol_stops_whoever_of_its_monitors_freezes() {
    for task in ["BatteryMonitor", "ProximityMonitor"] {
        stops_without(&Subject::new(patrol(), "office"), task, SLOW_PERIOD_US);
    }
}

#[test]
fn each_task_that_watches_something_can_freeze() {
    let motion = "task Go: Cruise; initial -> Go;";
    let drive = "path Listen.ranges -> Go.ranges; path Go.twist -> Drive.twist;";
    let battery = "region battery { task Measure: BatteryMonitor; initial -> Measure; } \
                   path Measure.battery -> Watch.battery;";
    let floor =
        "region floor { task Look: LineSensor; initial -> Look; } path Look.line -> Watch.line;";
    let patient = "with { warn_ms = 60000, slow_ms = 60000, stop_ms = 60000 }";
    for (task, with, more, period_us) in [
        ("SlotMonitor", "", "", SLOW_PERIOD_US),
        ("LinkMonitor", patient, "", SLOW_PERIOD_US),
        ("BatteryGuard", "", battery, SLOW_PERIOD_US),
        ("LineMonitor", "", floor, PERIOD_US),
    ] {
        let watch = format!("region watch {{ task Watch: {task} {with}; initial -> Watch; }}");
        let mission = mission(motion, &format!("{watch} {more} {drive}"));
        stops_without(&Subject::new(mission, "office"), task, period_us);
    }
}
