//! How well a robot knows which way it looks, with a gyroscope and without.

#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

use std::time::Duration;

use esm_tests::command::root;
use esm_tests::host_drive;
use esm_toolkit::values::Shape;
use host_tools::parameters::Value;
use host_tools::plant::{BodyParameters, Plant};
use host_tools::recording::player::Recording;
use host_tools::run::drive::Plan;
use host_tools::run::in_memory::InMemory;
use host_tools::world::World;

/// The scale of the plant's gyroscope, as ten turns on the spot would tell it.
const CALIBRATED: f64 = 1.0 / 1.01;

/// Which way the robot took itself to look at last, in radians from its start.
fn last_heading_rad(recording: &Recording) -> f64 {
    let samples = recording.samples().map(Result::unwrap);
    let headings = samples.flat_map(|sample| {
        let nets = sample.nets.iter().zip(&sample.values);
        let poses = nets.filter(|(watched, _)| watched.shape() == Shape::Pose);
        let headings = poses.filter_map(|(_, values)| match values.as_deref() {
            Some([_, _, Value::F32(heading_rad), ..]) => Some(f64::from(*heading_rad)),
            _ => None,
        });
        headings.collect::<Vec<_>>()
    });
    headings.last().unwrap()
}

/// A run of a mission, and by how much the robot is wrong about which way it looks at its end, in
/// degrees.
fn driven(
    text: &str,
    world: &World,
    body: BodyParameters,
    seed: u64,
    until_s: u64,
) -> (Plant, f64) {
    let rover = root().join("missions/rover.esm");
    let text = text.replace("\"rover.esm\"", &format!("\"{}\"", rover.display()));
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("drive.esm");
    std::fs::write(&file, text).unwrap();
    let recorded = InMemory::default();
    let run = host_drive::driven(Plan {
        seed,
        body,
        until_us: Some(until_s * 1_000_000),
        record: Some(Box::new(recorded.clone())),
        sample_period: Some(Duration::from_millis(100)),
        ..host_drive::plan(&file, world.clone())
    });
    let started_rad = world.start.heading_deg * core::f64::consts::PI / 180.0;
    let really_rad = run.plant.pose().heading_rad - started_rad;
    let off_rad = really_rad - last_heading_rad(&recorded.read().unwrap());
    let turns = off_rad / core::f64::consts::TAU;
    (run.plant, (turns - libm::round(turns)) * 360.0)
}

fn square(file: &str) -> String {
    std::fs::read_to_string(root().join("host-tools/src/cli/umbmark").join(file)).unwrap()
}

fn with_scale(text: &str, scale: f64) -> String {
    let scaled = text.replace("scale = 1.0", &format!("scale = {scale:.4}"));
    assert_ne!(scaled, text);
    scaled
}

/// The root of the mean square.
fn rms(errors: &[f64]) -> f64 {
    let sum: f64 = errors.iter().map(|error| error * error).sum();
    libm::sqrt(sum / errors.len() as f64)
}

#[test]
fn a_gyroscope_with_the_right_scale_knows_the_heading_where_the_wheels_do_not() {
    let hall = World::parse("world hall\nstart 0,0 0\nwall -3,-3 3,-3 3,3 -3,3 -3,-3").unwrap();
    let (wheels, gyro) = (square("square.esm"), square("square_gyro.esm"));
    let calibrated = with_scale(&gyro, CALIBRATED);
    for (what, text, true_base_m, least_deg, most_deg) in [
        ("wheels", &wheels, 0.2015, 0.6, 1.2),
        ("gyroscope", &gyro, 0.2015, 3.2, 3.9),
        ("calibrated", &calibrated, 0.2015, 0.0, 0.3),
        ("wheels, base 2 % wrong", &wheels, 0.206, 7.0, 8.5),
        ("calibrated, base 2 % wrong", &calibrated, 0.206, 0.0, 0.3),
    ] {
        let body = BodyParameters {
            wheel_base_m: true_base_m,
            ..BodyParameters::default()
        };
        let mut errors_deg = Vec::new();
        for seed in 1..=10 {
            for text in [text.clone(), text.replace(" / set .left", "")] {
                errors_deg.push(driven(&text, &hall, body, seed, 90).1);
            }
        }
        let error_deg = rms(&errors_deg);
        println!("square, {what}: {error_deg:.2} deg off at its end");
        assert!(
            (least_deg..most_deg).contains(&error_deg),
            "{what}: {error_deg}"
        );
    }
}

/// `errand.esm` with a gyroscope, which stands for two seconds first.
fn errand_with_gyro(scale: f64) -> String {
    let mut text = std::fs::read_to_string(root().join("missions/errand.esm")).unwrap();
    for (from, to) in [
        (
            "    region pose {",
            &*format!(
                "    region gyro {{ task Turns: Gyro with {{ scale = {scale:.4} }}; initial -> Turns; }}\n\n    region pose {{"
            ),
        ),
        ("state Ready timeout 1 s;", "state Ready timeout 2 s;"),
        (
            "path Track.speeds -> ",
            "path Turns.yaw_rate -> Track.yaw_rate;\n    path Track.speeds -> Turns.speeds, ",
        ),
    ] {
        assert_eq!(text.matches(from).count(), 1, "{from}");
        text = text.replace(from, to);
    }
    text
}

#[test]
fn an_errand_ends_as_it_began_with_the_gyroscope_too() {
    let floor = host_drive::world("office_floor");
    let wheels = std::fs::read_to_string(root().join("missions/errand.esm")).unwrap();
    for (what, text, most_deg) in [
        ("wheels", wheels, 3.5),
        ("gyroscope", errand_with_gyro(1.0), 4.5),
        ("calibrated", errand_with_gyro(CALIBRATED), 4.0),
    ] {
        let mut errors_deg = Vec::new();
        let mut farthest_m: f64 = 0.0;
        for seed in 1..=10 {
            let (plant, error_deg) = driven(&text, &floor, BodyParameters::default(), seed, 270);
            let start = floor.start.position;
            let off_m = libm::sqrt(plant.pose().position.squared_distance_m2(start));
            farthest_m = farthest_m.max(off_m);
            errors_deg.push(error_deg);
        }
        let error_deg = rms(&errors_deg);
        println!(
            "errand, {what}: {error_deg:.2} deg off, {farthest_m:.3} m from its start at most"
        );
        assert!(farthest_m < 0.25, "{what}: {farthest_m} m");
        assert!(error_deg < most_deg, "{what}: {error_deg}");
    }
}
