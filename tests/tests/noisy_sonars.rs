//! What the median of three and the temperature of the air make of what the plant's sonars say:
//! `SonarRing` beside a robot that stands.

#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

use host_tools::plant::{BodyParameters, Plant, SonarFault};
use host_tools::world::World;
use rt_firmware::TaskBench;
use rt_firmware::body::{EchoCapture, PinImage, PlantExchange, TriggerPin};
use rt_firmware::tasks::{Bearing, Ranges, SonarRing};

type Ring<'a> = SonarRing<TriggerPin<'a>, EchoCapture<'a>>;

const PERIOD_US: u64 = 40_000;

/// How the ring is set, and what its sonars are like.
#[derive(Clone, Copy)]
struct Setting {
    median: bool,
    fault: Option<SonarFault>,
    /// Of the air, and what the ring believes it is, in °C.
    air_c: f32,
    believed_c: f32,
}

const QUIET: Setting = Setting {
    median: false,
    fault: None,
    air_c: 20.0,
    believed_c: 20.0,
};

/// What the ring says in each of its activations, from the first picture on: time in microseconds,
/// ranges. The robot stands with a wall 1 m ahead.
fn heard(setting: Setting, people: &str, seed: u64, until_us: u64) -> Vec<(u64, Ranges)> {
    let text = format!(
        "world hall\nstart 1,1.5 0\nwall 2.11,0 2.11,3\nwall 0,0 2.11,0\nwall 0,3 2.11,3\n{people}"
    );
    let mut body = BodyParameters::default();
    body.sonar.air_c = setting.air_c.into();
    let mut plant = Plant::new(World::parse(&text).unwrap(), body, seed).unwrap();
    if let Some(fault) = setting.fault {
        plant.break_sonar(0, fault);
    }
    let pins = PinImage::new();
    let parts = pins.parts();
    let mut bench = TaskBench::new(Ring::new(
        parts.sonar_triggers,
        parts.echo_timers,
        Bearing::ALL,
    ));
    bench
        .period_us(PERIOD_US as u32)
        .param(Ring::MEDIAN, setting.median)
        .param(Ring::AIR_C, setting.believed_c);
    let mut exchange = PlantExchange::new();
    let mut said = Vec::new();
    for start_us in (0..until_us).step_by(PERIOD_US as usize) {
        let effect_us = start_us.saturating_sub(PERIOD_US - 1_000);
        let request = exchange.request(&pins, start_us, effect_us);
        exchange.accept(&pins, Some(&plant.exchange(&request).encode()));
        bench.step();
        said.extend(bench.output(Ring::RANGES).map(|ranges| (start_us, ranges)));
    }
    said
}

/// How often the range ahead is longer than it is, and shorter, by more than 0.1 m, in parts of all
/// that the ring says.
fn wrong_parts(setting: Setting) -> (f64, f64) {
    let said = heard(setting, "", 1, 4_000 * 2 * PERIOD_US);
    let part = |is_wrong: fn(f32) -> bool| {
        let wrong = said.iter().filter(|(_, ranges)| is_wrong(ranges.ahead_m()));
        wrong.count() as f64 / said.len() as f64
    };
    (part(|range_m| range_m > 1.1), part(|range_m| range_m < 0.9))
}

#[test]
fn the_median_takes_false_echoes_from_afar_out_and_leaves_those_from_near() {
    // What the sonar does, median; the most of the time in which it is too long and too short.
    for (fault, median, longer, shorter) in [
        (None, false, 0.001, 0.0),
        (None, true, 0.001, 0.0),
        (Some(SonarFault::Noisy), false, 0.09, 0.035),
        (Some(SonarFault::Noisy), true, 0.02, 0.035),
    ] {
        let setting = Setting {
            median,
            fault,
            ..QUIET
        };
        let parts = wrong_parts(setting);
        println!("{fault:?}, median {median}: too long, too short {parts:?}");
        assert!(parts.0 <= longer && parts.1 <= shorter, "{parts:?}");
        if fault.is_some() && !median {
            assert!(
                parts.0 > 0.05,
                "without it there is something to take out: {parts:?}"
            );
        }
    }
}

#[test]
fn a_person_who_steps_in_is_seen_as_early_with_the_median_and_gone_a_ping_later() {
    // For each way of listening: the mean times until somebody is seen, and seen to be gone, in ms.
    let delays_ms = [false, true].map(|median| {
        let setting = Setting { median, ..QUIET };
        let (mut seen_us, mut gone_us) = (0, 0);
        const TRIES: u64 = 80;
        for later_ms in 0..TRIES {
            let (from_ms, to_ms) = (2_000 + later_ms, 4_000 + later_ms);
            let person = format!("person 1.9,1.5 0.25 from {from_ms} ms to {to_ms} ms");
            let said = heard(setting, &person, later_ms, 5_000_000);
            let first = |from_ms: u64, near: bool| {
                let later = said.iter().find(|(t_us, ranges)| {
                    *t_us > from_ms * 1_000 && (ranges.ahead_m() < 0.8) == near
                });
                later.unwrap().0 - from_ms * 1_000
            };
            seen_us += first(from_ms, true);
            gone_us += first(to_ms, false);
        }
        [seen_us, gone_us].map(|sum_us| sum_us as f64 / TRIES as f64 / 1e3)
    });
    println!(
        "seen, gone: off {:?} ms, on {:?} ms",
        delays_ms[0], delays_ms[1]
    );
    let [[seen_ms, gone_ms], [seen_median_ms, gone_median_ms]] = delays_ms;
    assert_eq!(seen_ms, seen_median_ms);
    assert!((gone_median_ms - gone_ms - 80.0).abs() < 15.0);
}

#[test]
fn ranges_are_right_in_cold_air_where_the_ring_is_told() {
    for (air_c, believed_c, expected_m) in [
        (20.0, 20.0, 1.0),
        (0.0, 0.0, 1.0),
        (0.0, 20.0, 1.036),
        (40.0, 20.0, 0.967),
    ] {
        let setting = Setting {
            air_c,
            believed_c,
            ..QUIET
        };
        let said = heard(setting, "", 1, 20_000_000);
        let sum_m: f32 = said.iter().map(|(_, ranges)| ranges.ahead_m()).sum();
        let mean_m = sum_m / said.len() as f32;
        println!("{air_c} °C, believed {believed_c} °C: {mean_m} m");
        assert!((mean_m - expected_m).abs() < 0.003, "{mean_m}");
    }
}
