//! The missions with which a robot measures itself, of the tasks that it has.

use std::fmt::Write as _;

use crate::model::{Task, Value};

/// What they are called in messages.
pub const CLOCK_NAME: &str = "selftest_slots.esm";
pub const BODY_NAME: &str = "selftest_body.esm";

/// What the robot's own tasks are called where the missions take them in.
pub const TASKS_NAME: &str = "robot.esm";

/// How long the robot stands at first, in milliseconds: each sonar has had its turn often, and the
/// gyroscope's bias is known.
pub const STANDS_MS: u32 = 3_000;
/// How often both wheels are driven ahead, for how long, and how long they rest behind it, in
/// milliseconds. It is short: a wheel whose encoder counts backwards makes the task that drives
/// ahead steer against what it does not do.
const PULSES: u32 = 3;
const PULSE_MS: u32 = 400;
const REST_MS: u32 = 500;
/// How long the robot turns on the spot to each side, in milliseconds.
const TURN_MS: u32 = 1_200;

/// When all of it is over, in milliseconds.
pub const OVER_MS: u32 = STANDS_MS + PULSES * (PULSE_MS + REST_MS) + 2 * (TURN_MS + REST_MS);

/// A task of the robot, with the text that declares it.
#[derive(Clone, Debug)]
pub struct Declared {
    /// What is declared.
    pub task: Task,
    /// The text.
    pub text: String,
}

/// The tasks of each mission. Others are not taken in: a slot of it would be too short for them.
const SLOTS_TASKS: &[&str] = &["LinkMonitor"];
const BODY_TASKS: &[&str] = &[
    "LinkMonitor",
    "SonarRing",
    "ProximityMonitor",
    "BatteryMonitor",
    "Logger",
    "Odometry",
    "Gyro",
    "WheelSpeed",
    "DriveDistance",
    "Turn",
];

/// What is measured, by the tasks that it takes: those that measure it, and those that read what
/// these say, for what nobody reads is on no net.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Measured {
    /// The sonars.
    Sonars,
    /// The battery.
    Battery,
    /// The gyroscope.
    Gyroscope,
    /// Motors and encoders.
    Wheels,
}

impl Measured {
    fn needs(self) -> &'static [&'static str] {
        match self {
            Measured::Sonars => &["SonarRing", "Odometry", "ProximityMonitor"],
            Measured::Battery => &["BatteryMonitor", "Odometry", "Logger"],
            Measured::Gyroscope => &["Gyro", "Odometry"],
            Measured::Wheels => &[
                "WheelSpeed",
                "Odometry",
                "DriveDistance",
                "Turn",
                "BatteryMonitor",
                "Logger",
            ],
        }
    }
}

/// A mission and the tasks that it takes in, as texts.
pub struct Texts {
    /// The mission.
    pub mission: String,
    /// Its tasks.
    pub tasks: String,
}

/// What a robot's firmware has of what is measured.
#[derive(Clone, Copy, Debug)]
pub struct Parts<'t> {
    tasks: &'t [Declared],
    /// Whether the wheels may be driven.
    drives: bool,
}

impl<'t> Parts<'t> {
    /// Of a firmware with these tasks. Nothing is driven unless `drives` says so.
    pub fn of(tasks: &'t [Declared], drives: bool) -> Self {
        Parts { tasks, drives }
    }

    /// Whether it has this task.
    pub fn has(&self, name: &str) -> bool {
        self.task(name).is_some()
    }

    fn task(&self, name: &str) -> Option<&'t Task> {
        let mut tasks = self.tasks.iter().map(|declared| &declared.task);
        tasks.find(|task| task.name == name)
    }

    /// The declarations of these tasks.
    fn declarations(&self, names: &[&str]) -> String {
        let is_named = |declared: &&Declared| names.contains(&declared.task.name.as_str());
        let texts = self.tasks.iter().filter(is_named);
        texts
            .map(|declared| format!("{}\n", declared.text.trim_end()))
            .collect()
    }

    /// The first task that it lacks to measure this.
    pub fn lacks(&self, measured: Measured) -> Option<&'static str> {
        let mut needed = measured.needs().iter().copied();
        needed.find(|name| !self.has(name))
    }

    fn measures(&self, measured: Measured) -> bool {
        self.lacks(measured).is_none()
    }

    /// Whether the mission drives the wheels.
    pub fn drives(&self) -> bool {
        self.drives && self.measures(Measured::Wheels)
    }

    /// What a task takes for a parameter where nothing else is said.
    pub fn default_of(&self, task: &str, param: &str) -> Option<f64> {
        let params = &self.task(task)?.params;
        match params.iter().find(|it| it.name == param)?.default? {
            Value::F32(value) => Some(f64::from(value)),
            Value::I32(value) => Some(f64::from(value)),
            Value::U32(value) => Some(f64::from(value)),
            Value::Bool(_) => None,
        }
    }

    /// The mission that lets slots start as often as they can, and does next to nothing in them.
    pub fn slots_mission(&self) -> Texts {
        let mut text = head(&["slot 1 period 2 ms duration 700 us;"]);
        let watches = self.has("LinkMonitor");
        if watches {
            text += "slot 3 period 40 ms duration 700 us;\n";
        }
        text += "machine Slots {\n    region wait { state Wait; initial -> Wait; }\n";
        if watches {
            text += &region("Watch", "LinkMonitor", "");
        }
        Texts {
            mission: text + "}\n",
            tasks: self.declarations(SLOTS_TASKS),
        }
    }

    /// The mission that lets the robot look at its body.
    pub fn body_mission(&self) -> Texts {
        let mut text = head(&[
            "slot 1 period 10 ms duration 2 ms;",
            "slot 2 period 10 ms duration 4 ms;",
            "slot 3 period 40 ms duration 1500 us;",
        ]);
        text += "machine Body {\n    region wait { state Wait; initial -> Wait; }\n";
        let mut paths = Vec::new();
        // Whoever goes away leaves no robot behind that drives.
        if self.has("LinkMonitor") {
            text += &region("Watch", "LinkMonitor", "");
        }
        let mut readers_of_pose = Vec::new();
        let mut readers_of_speeds = Vec::new();
        let (has_sonars, has_battery) = (
            self.measures(Measured::Sonars),
            self.measures(Measured::Battery),
        );
        let has_gyroscope = self.measures(Measured::Gyroscope);
        if has_sonars {
            text += &region("Ring", "SonarRing", "");
            text += &region("Look", "ProximityMonitor", "");
            readers_of_pose.push("Ring.pose".to_owned());
            paths.push("Ring.ranges -> Look.ranges".to_owned());
        }
        if has_battery {
            text += &region("Measure", "BatteryMonitor", "");
            text += DIARY;
            readers_of_pose.push("Write.pose".to_owned());
            paths.push("Measure.battery -> Write.battery".to_owned());
        }
        if has_gyroscope {
            text += &region("Rate", "Gyro", "");
            readers_of_speeds.push("Rate.speeds");
            paths.push("Rate.yaw_rate -> Track.yaw_rate".to_owned());
        }
        if self.drives() {
            // Without a controller: what the motors get follows from what they are asked for.
            text += &region(
                "Drive",
                "WheelSpeed",
                " with { acceleration_m_per_s2 = 5.0, jerk_m_per_s3 = 1000.0, proportional_s_per_m = 0.0, integral_per_m = 0.0 }",
            );
            text += &motion();
            readers_of_speeds.push("Drive.speeds");
            paths.push("Drive.control -> Write.control".to_owned());
            let moved = (1..=PULSES).map(|pulse| format!("Ahead{pulse}"));
            let moved: Vec<String> = moved
                .chain(["Left".to_owned(), "Right".to_owned()])
                .collect();
            readers_of_pose.extend(moved.iter().map(|it| format!("{it}.pose")));
            let twists: Vec<String> = moved.iter().map(|it| format!("{it}.twist")).collect();
            paths.push(format!("{} -> Drive.twist", twists.join(", ")));
        }
        if has_sonars || has_battery || has_gyroscope || self.drives() {
            text += &region("Track", "Odometry", "");
        }
        if !readers_of_pose.is_empty() {
            paths.push(format!("Track.pose -> {}", readers_of_pose.join(", ")));
        }
        if !readers_of_speeds.is_empty() {
            paths.push(format!("Track.speeds -> {}", readers_of_speeds.join(", ")));
        }
        for path in paths {
            // Writing to a string cannot fail.
            let _ = writeln!(text, "    path {path};");
        }
        Texts {
            mission: text + "}\n",
            tasks: self.declarations(BODY_TASKS),
        }
    }
}

/// The region that keeps a diary, for the one reader of some values.
const DIARY: &str = "    region diary {
        task Write: Logger;
        state Pause timeout 2 s;
        initial -> Write;
        Write -> Pause on *;
        Pause -> Write [timeout];
    }
";

/// The region of a task that is executed all the time.
fn region(state: &str, task: &str, with: &str) -> String {
    format!("    region of_{state} {{ task {state}: {task}{with}; initial -> {state}; }}\n")
}

/// How a mission begins.
fn head(slots: &[&str]) -> String {
    let mut text = format!("use \"{TASKS_NAME}\";\ninterpreter slot 1;\n");
    for slot in slots {
        text += slot;
        text += "\n";
    }
    text
}

/// The region that drives the wheels.
fn motion() -> String {
    let mut text = format!("    region motion {{\n        state Stands timeout {STANDS_MS} ms;\n");
    let mut way = String::from("        initial -> Stands;\n");
    let mut before = "Stands".to_owned();
    let mut condition = "timeout";
    for pulse in 1..=PULSES {
        let _ = writeln!(
            text,
            "        task Ahead{pulse}: DriveDistance timeout {PULSE_MS} ms with {{ distance_m = 5.0, speed_m_per_s = 0.25 }};"
        );
        let _ = writeln!(text, "        state Rest{pulse} timeout {REST_MS} ms;");
        let _ = writeln!(way, "        {before} -> Ahead{pulse} [{condition}];");
        let _ = writeln!(
            way,
            "        Ahead{pulse} -> Rest{pulse} [exit or timeout];"
        );
        before = format!("Rest{pulse}");
        condition = "timeout";
    }
    for (side, set) in [("Left", " / set .left"), ("Right", "")] {
        let _ = writeln!(
            text,
            "        task {side}: Turn timeout {TURN_MS} ms with {{ angle_rad = 6.2, rate_rad_per_s = 2.0 }};"
        );
        let _ = writeln!(text, "        state Behind{side} timeout {REST_MS} ms;");
        let _ = writeln!(way, "        {before} -> {side} [{condition}]{set};");
        let _ = writeln!(way, "        {side} -> Behind{side} [exit or timeout];");
        before = format!("Behind{side}");
    }
    let _ = writeln!(way, "        {before} -> final [timeout];");
    text + &way + "    }\n"
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::own_drive::{ROVER, compiled_with};
    use crate::lang;

    fn rover() -> Vec<Declared> {
        let tasks = lang::load_text("rover.esm", ROVER)
            .model
            .expect("a model")
            .tasks;
        let declared = |task: Task| {
            let from = ROVER
                .find(&format!("task {} ", task.name))
                .expect("it is there");
            let length = ROVER[from..].find("\n}").expect("it ends") + 2;
            let text = ROVER[from..from + length].to_owned();
            Declared { task, text }
        };
        tasks.into_iter().map(declared).collect()
    }

    #[test]
    fn the_missions_compile_whatever_the_robot_has() {
        for without in [
            &[][..],
            &["Gyro"],
            &["LinkMonitor", "SonarRing"],
            &["Turn"],
            &["Odometry"],
            &["Logger"],
            &["ProximityMonitor"],
        ] {
            let mut tasks = rover();
            tasks.retain(|it| !without.contains(&it.task.name.as_str()));
            let has_wheels = !without
                .iter()
                .any(|it| ["Turn", "Odometry", "Logger"].contains(it));
            for drives in [false, true] {
                let parts = Parts::of(&tasks, drives);
                assert_eq!(parts.drives(), drives && has_wheels);
                for (name, texts) in [
                    (CLOCK_NAME, parts.slots_mission()),
                    (BODY_NAME, parts.body_mission()),
                ] {
                    let Texts { mission, tasks } = texts;
                    let compiled = compiled_with(name, &mission, (TASKS_NAME, &tasks));
                    let compiled = compiled.unwrap_or_else(|error| panic!("{error}: {mission}"));
                    let has = |task: &str| compiled.task_names.iter().any(|name| name == task);
                    assert!(!without.iter().any(|task| has(task)), "{mission}");
                    assert_eq!(has("WheelSpeed"), name == BODY_NAME && parts.drives());
                }
            }
        }
    }

    #[test]
    fn a_low_battery_is_what_the_robot_takes_for_low() {
        let tasks = rover();
        let low_v = Parts::of(&tasks, false).default_of("BatteryMonitor", "low_v");
        assert!(low_v.is_some_and(|low_v| (low_v - 6.6).abs() < 1e-6));
    }
}
