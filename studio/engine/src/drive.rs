//! The run of an instance.

use std::cell::RefCell;

use esm_toolkit::host_run::{Ended, HostRun, Planned, RunMission, Settings, start_rover};
use esm_toolkit::plant::BodyParameters;
use esm_toolkit::plant::behind_pins::{SonarBreak, StuckWheel};
use esm_toolkit::recording::player::Recording;
use esm_toolkit::world::World;
use serde::Deserialize;
use serde_json::{Value, json};

use crate::{desk, looked};

/// A sonar that breaks.
#[derive(Deserialize)]
struct Break {
    sonar: usize,
    fault: String,
    at_us: u64,
}

/// A wheel that something holds.
#[derive(Deserialize)]
struct Stuck {
    wheel: String,
    at_us: u64,
}

/// A mission that takes over.
#[derive(Deserialize)]
struct Then {
    at_us: u64,
    path: String,
    #[serde(default)]
    warm: bool,
}

/// A run, as the page plans it.
#[derive(Deserialize)]
pub struct Plan {
    path: String,
    world: String,
    seed: u64,
    until_us: u64,
    #[serde(default)]
    then: Vec<Then>,
    #[serde(default)]
    breaks: Vec<Break>,
    #[serde(default)]
    stuck: Vec<Stuck>,
    #[serde(default)]
    stop_at_us: Option<u64>,
    #[serde(default)]
    cut_link_us: Option<u64>,
}

/// How far the run of this instance is.
enum Stage {
    Nothing,
    Running(Box<HostRun<'static, 'static, 'static>>),
    Over,
}

thread_local! {
    static STAGE: RefCell<Stage> = const { RefCell::new(Stage::Nothing) };
}

/// The name of a mission, as `esm run` names it.
fn name_of(path: &str) -> String {
    let name = path.rsplit('/').next().unwrap_or(path);
    name.strip_suffix(".esm").unwrap_or(name).to_owned()
}

fn planned(at_us: u64, path: &str, warm: bool) -> Result<Planned, String> {
    let verified = desk::mission(path)?;
    let mission = RunMission::new(&name_of(path), verified).map_err(|error| error.to_string())?;
    Ok(Planned {
        at_us,
        mission,
        warm,
    })
}

/// Starts a run.
///
/// # Errors
/// This instance has had one; or there is something wrong with the mission or the world.
pub fn start(plan: Plan) -> Result<Value, String> {
    if STAGE.with_borrow(|stage| !matches!(stage, Stage::Nothing)) {
        return Err("this instance has had its run: start another one".to_owned());
    }
    let mut missions = vec![planned(0, &plan.path, false)?];
    for then in &plan.then {
        missions.push(planned(then.at_us, &then.path, then.warm)?);
    }
    let mut breaks = Vec::new();
    for it in &plan.breaks {
        let fault = (it.fault.parse()).map_err(|()| format!("no sonar is `{}`", it.fault))?;
        breaks.push(SonarBreak {
            sonar: it.sonar,
            fault,
            robot_us: it.at_us,
        });
    }
    let mut stuck_wheels = Vec::new();
    for it in &plan.stuck {
        let side = (it.wheel.parse()).map_err(|()| format!("there is no wheel `{}`", it.wheel))?;
        let robot_us = it.at_us;
        stuck_wheels.push(StuckWheel { side, robot_us });
    }
    let settings = Settings {
        world: World::parse(&plan.world).map_err(|error| error.to_string())?,
        body: BodyParameters::default(),
        seed: plan.seed,
        until_us: plan.until_us,
        breaks,
        stuck_wheels,
        stop_at_us: plan.stop_at_us,
        cut_link_us: plan.cut_link_us,
    };
    let world = world_of(&settings.world);
    let run = start_rover(settings, missions).map_err(|error| error.to_string())?;
    STAGE.set(Stage::Running(Box::new(run)));
    Ok(world)
}

/// A world as the page draws it.
///
/// # Errors
/// The text is no world.
pub fn world(text: &str) -> Result<Value, String> {
    let world = World::parse(text).map_err(|error| error.to_string())?;
    Ok(world_of(&world))
}

fn world_of(world: &World) -> Value {
    let lines = |segments: &[esm_toolkit::world::Segment]| -> Vec<[f64; 4]> {
        let ends =
            |it: &esm_toolkit::world::Segment| [it.from.x_m, it.from.y_m, it.to.x_m, it.to.y_m];
        segments.iter().map(ends).collect()
    };
    let rooms: Vec<Value> = (world.rooms.iter())
        .map(|room| {
            let outline: Vec<[f64; 2]> = room.outline.iter().map(|it| [it.x_m, it.y_m]).collect();
            json!({ "name": room.name, "outline": outline })
        })
        .collect();
    let floor: Vec<[f64; 5]> = (world.lines.iter())
        .map(|piece| {
            let it = &piece.middle;
            [
                it.from.x_m,
                it.from.y_m,
                it.to.x_m,
                it.to.y_m,
                piece.width_m,
            ]
        })
        .collect();
    let bounds = world.bounds();
    let start = world.start;
    json!({
        "name": world.name,
        "walls": lines(&world.walls),
        "low": lines(&world.low),
        "rooms": rooms,
        "lines": floor,
        "start": [start.position.x_m, start.position.y_m, start.heading_deg.to_radians()],
        "bounds": [bounds.min.x_m, bounds.min.y_m, bounds.max.x_m, bounds.max.y_m],
        "radius_m": BodyParameters::default().radius_m,
        "sonar_rim_m": BodyParameters::default().sonar.rim_m,
    })
}

/// Lets the run go on up to a robot time. At its end the answer holds the whole trace.
///
/// # Errors
/// There is none, or it cannot go on.
pub fn go_on(to_us: u64) -> Result<Value, String> {
    let Stage::Running(mut run) = STAGE.replace(Stage::Nothing) else {
        return Err("no run goes on here".to_owned());
    };
    let goes_on = run.go_on(to_us).map_err(|error| error.to_string())?;
    let given = run.take();
    let shown: Vec<Value> = (given.shown.iter())
        .map(|it| {
            json!([
                it.t_us,
                it.at_m[0],
                it.at_m[1],
                it.heading_rad,
                it.battery_v,
                it.touches,
                it.echo_us
            ])
        })
        .collect();
    let mut answer = json!({
        "robot_us": run.robot_us(),
        "shown": shown,
        "active": given.active,
        "words": given.words,
        "log": given.log,
        "people": given.people,
        "walls": given.walls,
        "carried": run.carried(),
        "goes_on": goes_on,
    });
    if goes_on {
        STAGE.set(Stage::Running(run));
        return Ok(answer);
    }
    let Ended {
        told,
        recording,
        plant,
        ..
    } = run.finish().map_err(|error| error.to_string())?;
    let missions: Vec<Value> = (told.missions.iter())
        .map(|it| json!({ "name": it.name, "start_us": it.start_us, "end_us": it.end_us }))
        .collect();
    answer["end"] = json!({
        "trace": String::from_utf8_lossy(&told.out),
        "fault": told.fault,
        "finished_us": told.finished_us,
        "missions": missions,
        "distance_m": plant.distance_m(),
        "collisions": plant.collisions(),
        "rooms": plant.statistics().rooms_entered(),
        "transitions": told.counts.transitions,
        "macro_steps": told.counts.macro_steps,
    });
    let recording = Recording::read(&recording).map_err(|error| error.to_string())?;
    if let Some(ended) = looked::at(recording) {
        return Err(ended);
    }
    let mut told = looked::all()?;
    for what in ["transitions", "period_us"] {
        answer["end"][what] = told[what].take();
    }
    STAGE.set(Stage::Over);
    Ok(answer)
}
