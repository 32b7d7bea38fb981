//! A recording as a picture: the path, speeds, ranges and states over time.

use std::collections::BTreeMap;

use serde::Serialize;

use super::player::Recording;
use super::samples::{BadSamples, Sample};
use super::told::Told;
use crate::parameters::Value;
use crate::pictures::{
    Curve, Curves, DrivePicture, Leg, Mark, Panel, PathPicture, PathSample, Timeline,
};
use crate::values::{Field, Shape, Watched};
use crate::world::World;

/// Curves of a panel at most.
const MAX_CURVES: usize = 24;

/// What of a recording is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Parts {
    /// The path.
    pub path: bool,
    /// Speeds: of the robot, of its wheels, of turning.
    pub speeds: bool,
    /// Ranges of sensors.
    pub ranges: bool,
    /// States over time.
    pub states: bool,
}

/// What a picture shows, for programs.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Shown {
    /// Time that it is of, in seconds.
    pub time_s: f64,
    /// Robot time at its left edge, in seconds.
    pub start_s: f64,
    /// Samples of values in the recording.
    pub samples: u64,
    /// The net whose poses are the path, and how long that is.
    pub path: Option<ShownPath>,
    /// The curves.
    pub curves: Vec<ShownCurve>,
    /// Runs of missions.
    pub missions: Vec<String>,
}

/// A path that is shown.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct ShownPath {
    /// Name of the net.
    pub net: String,
    /// Length of the way from pose to pose, in metres.
    pub length_m: f64,
}

/// A curve that is shown.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct ShownCurve {
    /// Name of the net, and of the number on it.
    pub name: String,
    /// Unit.
    pub unit: &'static str,
    /// How many numbers it has.
    pub count: u64,
    /// The least.
    pub least: Option<f32>,
    /// The greatest.
    pub greatest: Option<f32>,
}

/// A panel that fills.
struct Filling {
    title: &'static str,
    unit: &'static str,
    /// By net, by place in the value.
    curves: BTreeMap<(String, usize), Curve>,
    left_out: bool,
}

/// Draws what a recording tells. With a world, its map lies below the path, which begins where the
/// robot of that world does.
///
/// # Errors
/// [`BadSamples`]
pub fn draw(
    recording: &Recording,
    told: &Told,
    parts: Parts,
    world: Option<&World>,
) -> Result<(DrivePicture, Shown), BadSamples> {
    let (first_us, last_us) = told.span_us.unwrap_or((0, 0));
    let end_us = last_us.saturating_sub(first_us).max(1);
    let panel = |title, unit| Filling {
        title,
        unit,
        curves: BTreeMap::new(),
        left_out: false,
    };
    let mut speeds = panel("speeds", "m/s");
    let mut turning = panel("turning", "rad/s");
    let mut ranges = panel("ranges", "m");
    let mut path = Path::default();
    let mut shown = Shown {
        time_s: end_us as f64 / 1e6,
        start_s: first_us as f64 / 1e6,
        ..Shown::default()
    };
    for sample in recording.samples() {
        let sample = sample?;
        let Some((at_us, run)) = told.place(&sample, recording) else {
            continue;
        };
        shown.samples += 1;
        let t_us = at_us.saturating_sub(first_us);
        if parts.path {
            path.take(&sample, t_us, run, told);
        }
        for (watched, values) in sample.nets.iter().zip(&sample.values) {
            let Some(values) = values else { continue };
            if parts.speeds {
                let number_in = |unit: &'static str| {
                    move |field: &Field, value: &Value| match value {
                        Value::F32(number) if field.label().1 == unit => Some(*number),
                        _ => None,
                    }
                };
                speeds.take(watched, values, t_us, end_us, number_in(speeds.unit));
                turning.take(watched, values, t_us, end_us, number_in(turning.unit));
            }
            if parts.ranges {
                let range =
                    |field: &Field, value: &Value| field.is_range().then(|| field.range_m(value));
                ranges.take(watched, values, t_us, end_us, range);
            }
        }
    }
    let head = &recording.head;
    let names: Vec<String> = (told.missions.iter())
        .map(|mission| mission.name.clone())
        .collect();
    let title = format!("{} on {}", joined(&names), head.board);
    let since = match first_us {
        0 => String::new(),
        _ => format!(", from {:.3} s of robot time on", first_us as f64 / 1e6),
    };
    let panels: Vec<Panel> = [speeds, turning, ranges]
        .into_iter()
        .filter(|panel| !panel.curves.is_empty())
        .map(Filling::panel)
        .collect();
    shown.curves = (panels.iter())
        .flat_map(|panel| {
            panel.curves.iter().map(|curve| {
                let extent = curve.extent();
                ShownCurve {
                    name: curve.name.clone(),
                    unit: unit_of(&panel.unit),
                    count: curve.count(),
                    least: extent.map(|(least, _)| least),
                    greatest: extent.map(|(_, greatest)| greatest),
                }
            })
        })
        .collect();
    shown.path = (!path.net.is_empty()).then(|| ShownPath {
        net: path.net.clone(),
        length_m: path.length_m,
    });
    shown.missions = names;
    let path = (!path.net.is_empty()).then(|| path.picture(&title, world, end_us));
    let states = parts
        .states
        .then(|| timeline(told, first_us, &title, &since));
    let picture = DrivePicture {
        title,
        path,
        curves: Curves { panels, end_us },
        states,
    };
    Ok((picture, shown))
}

/// The unit of a panel, which is one of those above.
fn unit_of(unit: &str) -> &'static str {
    match unit {
        "m/s" => "m/s",
        "rad/s" => "rad/s",
        _ => "m",
    }
}

/// Names in their order, each said once.
fn joined(names: &[String]) -> String {
    let mut said: Vec<&str> = Vec::new();
    for name in names {
        if !said.contains(&name.as_str()) {
            said.push(name);
        }
    }
    said.join(", ")
}

/// The states, from the beginning of the recording on.
fn timeline(told: &Told, first_us: u64, title: &str, since: &str) -> Timeline {
    let mut missions = told.missions.clone();
    for mission in &mut missions {
        mission.start_us = mission.start_us.saturating_sub(first_us);
        mission.end_us = mission.end_us.saturating_sub(first_us);
        for span in mission.regions.iter_mut().flat_map(|it| &mut it.spans) {
            span.start_us = span.start_us.saturating_sub(first_us);
            span.end_us = span.end_us.saturating_sub(first_us);
        }
    }
    let marks = told.faults.iter().map(|fault| Mark {
        t_us: fault.t_us.saturating_sub(first_us),
        label: fault.code.to_owned(),
    });
    Timeline {
        title: format!("states of {title}{since}"),
        missions,
        marks: marks.collect(),
    }
}

impl Filling {
    /// Takes the numbers of a value, as `number` tells them: none of a field that does not belong
    /// here.
    fn take(
        &mut self,
        watched: &Watched,
        values: &[Value],
        t_us: u64,
        end_us: u64,
        number: impl Fn(&Field, &Value) -> Option<f32>,
    ) {
        let net = watched.net.name();
        for (place, (field, value)) in watched.fields.iter().zip(values).enumerate() {
            let Some(value) = number(field, value) else {
                continue;
            };
            let key = (net.to_owned(), place);
            if !self.curves.contains_key(&key) && self.curves.len() == MAX_CURVES {
                self.left_out = true;
                continue;
            }
            let named = || Curve::new(watched.name_of(place), end_us);
            let curve = self.curves.entry(key).or_insert_with(named);
            curve.add(t_us, value);
        }
    }

    fn panel(self) -> Panel {
        let more = if self.left_out {
            format!(", the first {MAX_CURVES}")
        } else {
            String::new()
        };
        Panel {
            title: format!("{}{more}", self.title),
            unit: self.unit.to_owned(),
            curves: self.curves.into_values().collect(),
        }
    }
}

/// A path that grows: the poses on the first net that has any.
#[derive(Default)]
struct Path {
    net: String,
    legs: Vec<Leg>,
    run: Option<usize>,
    last: Option<(f32, f32)>,
    length_m: f64,
}

impl Path {
    fn take(&mut self, sample: &Sample, t_us: u64, run: usize, told: &Told) {
        let mut pairs = sample.nets.iter().zip(&sample.values);
        let found = pairs.find_map(|(watched, values)| {
            (watched.shape() == Shape::Pose).then_some((watched.net.name(), values.as_deref()?))
        });
        let Some((net, [Value::F32(x_m), Value::F32(y_m), ..])) = found else {
            return;
        };
        if self.net.is_empty() {
            self.net = net.to_owned();
        }
        if self.run != Some(run) {
            self.run = Some(run);
            self.legs.push(Leg {
                name: told.mission(run).to_owned(),
                samples: Vec::new(),
            });
        }
        if let Some((before_x_m, before_y_m)) = self.last {
            let way_m = libm::hypotf(x_m - before_x_m, y_m - before_y_m);
            self.length_m += f64::from(if way_m.is_finite() { way_m } else { 0.0 });
        }
        self.last = Some((*x_m, *y_m));
        if let Some(leg) = self.legs.last_mut() {
            leg.samples.push(PathSample {
                t_us,
                x_m: *x_m,
                y_m: *y_m,
            });
        }
    }

    fn picture(mut self, title: &str, world: Option<&World>, end_us: u64) -> PathPicture {
        let map = world.map_or_else(PathPicture::default, PathPicture::over);
        if let Some(world) = world {
            let start = &world.start;
            let heading_rad = start.heading_deg.to_radians();
            let (sin, cos) = (libm::sin(heading_rad), libm::cos(heading_rad));
            for sample in self.legs.iter_mut().flat_map(|leg| &mut leg.samples) {
                let (x_m, y_m) = (f64::from(sample.x_m), f64::from(sample.y_m));
                sample.x_m = (start.position.x_m + cos * x_m - sin * y_m) as f32;
                sample.y_m = (start.position.y_m + sin * x_m + cos * y_m) as f32;
            }
        }
        PathPicture {
            title: title.to_owned(),
            facts: vec![format!(
                "{:.1} m in {:.0} s by {}",
                self.length_m,
                end_us as f64 / 1e6,
                self.net
            )],
            legs: self.legs,
            ..map
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_path_over_a_world_begins_where_its_robot_starts_and_looks_where_that_looks() {
        let text = "world w\nstart 2,1 90\nwall 0,0 9,0\nroom r 0,0 1,0 1,1\n";
        let world = World::parse(text).unwrap();
        let path = || Path {
            net: "a/A.pose".into(),
            legs: vec![Leg {
                name: "m".into(),
                samples: vec![PathSample {
                    t_us: 0,
                    x_m: 3.0,
                    y_m: 0.5,
                }],
            }],
            ..Path::default()
        };
        let place = |world: Option<&World>| {
            let sample = path().picture("", world, 1).legs[0].samples[0];
            (sample.x_m, sample.y_m)
        };
        assert_eq!(place(None), (3.0, 0.5));
        let (x_m, y_m) = place(Some(&world));
        assert!(
            (x_m - 1.5).abs() < 1e-6 && (y_m - 4.0).abs() < 1e-6,
            "{x_m}, {y_m}"
        );
    }
}
