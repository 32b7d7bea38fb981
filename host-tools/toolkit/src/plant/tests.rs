use proptest::prelude::*;
use rt_firmware::body::{BATTERY_CHANNEL, LINE_CHANNEL, SONARS};

use super::*;
use crate::world::Point;

fn shipped(name: &str) -> World {
    let text = std::fs::read_to_string(format!("../../missions/worlds/{name}")).unwrap();
    World::parse(&text).unwrap()
}

/// A square cell of 4 m with the robot in the middle, looking along x.
fn cell() -> World {
    World::parse("world cell\nstart 2,2 0\nwall 0,0 4,0 4,4 0,4 0,0\nroom cell 0,0 4,0 4,4 0,4")
        .unwrap()
}

fn plant(world: World) -> Plant {
    Plant::new(world, BodyParameters::default(), 1).unwrap()
}

fn duties(left_duty: i16, right_duty: i16) -> Actuators {
    Actuators {
        left_duty,
        right_duty,
        ..Actuators::default()
    }
}

/// Until each sonar has answered, also where nothing is there.
const ANSWERED_US: u64 = 40_000;

const ALL_SONARS: Actuators = Actuators {
    left_duty: 0,
    right_duty: 0,
    sonar_triggers: 0xFF,
    aux_outputs: 0,
    array_triggers: 0,
};

/// A drive of `(duration_us, actuators)` legs, each call of `advance_to` at most `most_us` long.
fn drive(plant: &mut Plant, legs: &[(u64, Actuators)], most_us: u64) -> Vec<Sensors> {
    let mut end_us = plant.now_us();
    legs.iter()
        .map(|(duration_us, actuators)| {
            plant.apply(actuators);
            end_us += duration_us;
            while plant.now_us() < end_us {
                plant.advance_to(end_us.min(plant.now_us() + most_us));
            }
            plant.sensors()
        })
        .collect()
}

fn legs() -> impl Strategy<Value = Vec<(u64, Actuators)>> {
    let leg = (
        1_000_u64..700_000,
        -1_000_i16..=1_000,
        -1_000_i16..=1_000,
        any::<u8>(),
    )
        .prop_map(|(duration_us, left_duty, right_duty, sonar_triggers)| {
            let actuators = Actuators {
                left_duty,
                right_duty,
                sonar_triggers,
                aux_outputs: 0,
                array_triggers: 0,
            };
            (duration_us, actuators)
        });
    prop::collection::vec(leg, 1..40)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]

    #[test]
    fn the_robot_stays_out_of_all_walls(legs in legs(), seed: u64, in_office: bool) {
        let world = shipped(if in_office { "office.world" } else { "corridor.world" });
        let bounds = world.bounds();
        let mut plant = Plant::new(world, BodyParameters::default(), seed).unwrap();
        for leg in legs {
            drive(&mut plant, &[leg], 50_000);
            prop_assert!(plant.distance_to_walls_m() >= plant.body().radius_m);
        }
        // Nor has it slipped through one unseen.
        for sample in plant.statistics().path() {
            let Point { x_m, y_m } = sample.pose.position;
            prop_assert!(x_m > bounds.min.x_m && x_m < bounds.max.x_m, "{x_m}");
            prop_assert!(y_m > bounds.min.y_m && y_m < bounds.max.y_m, "{y_m}");
        }
    }

    #[test]
    fn how_time_is_cut_into_calls_changes_nothing(legs in legs(), most_us in 1_u64..30_000) {
        let (mut whole, mut cut) = (plant(shipped("office.world")), plant(shipped("office.world")));
        prop_assert_eq!(drive(&mut whole, &legs, u64::MAX / 2), drive(&mut cut, &legs, most_us.max(300)));
        prop_assert_eq!(whole.pose(), cut.pose());
        prop_assert_eq!(whole.statistics().path(), cut.statistics().path());
    }

    #[test]
    fn the_robot_stays_out_of_all_people(legs in legs(), seed: u64, most_us in 1_u64..30_000) {
        const PEOPLE: &str = "person 2.5,2 0.1\nperson 2,2 0.25 from 2 s\nperson 1.5,2.2 0.3 from 1 s to 4 s\n\
             person 2,2.5 0.2 from 3 s to 6 s\nperson 2.1,1.4 0.25 from 500 ms";
        let mut whole = Plant::new(visited(PEOPLE), BodyParameters::default(), seed).unwrap();
        let mut cut = whole.clone();
        for leg in legs {
            let sensors = drive(&mut whole, &[leg], u64::MAX / 2);
            let pose = whole.pose().position;
            for person in whole.people() {
                prop_assert!(person.circle.distance_m(pose) >= whole.body().radius_m, "{person:?}");
            }
            prop_assert_eq!(sensors, drive(&mut cut, &[leg], most_us.max(300)));
        }
        prop_assert_eq!(whole.pose(), cut.pose());
        prop_assert_eq!(whole.collisions(), cut.collisions());
    }

    #[test]
    fn no_wheel_is_faster_than_its_motor_at_full_battery(legs in legs()) {
        let mut plant = plant(shipped("office.world"));
        let body = *plant.body();
        let rim_m_per_s = body.motor.speed_rad_per_s_v * body.battery.full_v * body.wheel_radius_m;
        drive(&mut plant, &legs, u64::MAX / 2);
        let duration_s = plant.now_us() as f64 / 1e6;
        prop_assert!(plant.distance_m() <= rim_m_per_s * duration_s);
        prop_assert!(plant.battery_v() <= body.battery.full_v);
    }
}

#[test]
fn the_seed_decides_the_noise_and_nothing_else_does() {
    let legs = [
        (300_000, duties(400, 380)),
        (30_000, ALL_SONARS),
        (1_000_000, duties(0, 0)),
    ];
    let run = |seed| {
        let mut plant = Plant::new(cell(), BodyParameters::default(), seed).unwrap();
        (drive(&mut plant, &legs, 10_000), plant.pose())
    };
    assert_eq!(run(1), run(1));
    assert_ne!(run(1), run(2));
}

#[test]
fn equal_duties_drive_nearly_straight_and_opposite_ones_turn_left() {
    let mut straight = plant(cell());
    drive(&mut straight, &[(2_000_000, duties(300, 300))], 20_000);
    let pose = straight.pose();
    assert!((2.3..2.6).contains(&pose.position.x_m), "{pose:?}");
    assert!(
        (-0.4..0.0).contains(&pose.heading_rad),
        "the right motor is weaker: {pose:?}"
    );

    let mut turning = plant(cell());
    drive(&mut turning, &[(1_000_000, duties(-300, 300))], 20_000);
    let pose = turning.pose();
    assert!(pose.heading_rad > 1.0, "{pose:?}");
    assert!((pose.position.x_m - 2.0).abs() < 0.02, "{pose:?}");
}

#[test]
fn a_duty_too_small_for_friction_moves_nothing() {
    let mut plant = plant(cell());
    drive(&mut plant, &[(1_000_000, duties(50, -50))], 20_000);
    assert_eq!(plant.sensors().left_count, 0);
    assert_eq!(plant.distance_m(), 0.0);
}

#[test]
fn encoders_count_down_and_wrap_when_driving_backwards() {
    let mut plant = plant(cell());
    drive(&mut plant, &[(500_000, duties(-400, -400))], 20_000);
    let sensors = plant.sensors();
    assert!(sensors.left_count > u16::MAX - 2_000, "{sensors:?}");
    assert!(
        sensors.right_count > sensors.left_count,
        "the right motor is weaker"
    );
}

#[test]
fn a_wall_stops_the_robot_and_counts_once() {
    let mut plant = plant(cell());
    drive(&mut plant, &[(10_000_000, duties(600, 600))], 20_000);
    assert_eq!(plant.collisions(), 1);
    let speed_m_per_s = plant.hardest_collision_m_per_s();
    assert!((0.2..0.7).contains(&speed_m_per_s), "{speed_m_per_s}");
    assert!((plant.distance_to_walls_m() - 0.12).abs() < 0.001);
    assert_eq!(plant.sensors().adc_counts[1], ADC_FULL_SCALE, "the bumper");
    let wheels_spin = plant.sensors().left_count;
    drive(&mut plant, &[(500_000, duties(600, 600))], 20_000);
    assert_ne!(plant.sensors().left_count, wheels_spin);
    // Away and back again: a second touch.
    drive(
        &mut plant,
        &[
            (1_000_000, duties(-500, -500)),
            (3_000_000, duties(500, 500)),
        ],
        20_000,
    );
    assert_eq!(plant.collisions(), 2);
}

#[test]
fn an_echo_takes_as_long_as_sound_does() {
    let mut plant = plant(cell());
    plant.apply(&ALL_SONARS);
    // The wall ahead is 1.89 m from the rim: 11.0 ms there and back.
    plant.advance_to(300);
    assert_eq!(plant.sensors().echo_us, [0; SONARS], "the burst goes out");
    assert_eq!(plant.sensors().echo_high, 0);
    plant.advance_to(10_400);
    let sensors = plant.sensors();
    assert_eq!(sensors.echo_us, [10_000; SONARS], "still under way");
    assert_eq!(sensors.echo_high, 0xFF);
    plant.advance_to(24_000);
    let sensors = plant.sensors();
    for sonar in [0, 2, 4, 6] {
        let echo_us = sensors.echo_us[sonar];
        assert!((10_700..=11_300).contains(&echo_us), "{sonar}: {echo_us}");
    }
    assert_eq!(sensors.echo_high, 0);
}

#[test]
fn a_sonar_ignores_a_trigger_while_it_listens() {
    let (mut once, mut twice) = (plant(cell()), plant(cell()));
    drive(
        &mut once,
        &[(5_000, ALL_SONARS), (20_000, duties(0, 0))],
        5_000,
    );
    drive(
        &mut twice,
        &[(5_000, ALL_SONARS), (20_000, ALL_SONARS)],
        5_000,
    );
    assert_eq!(once.sensors(), twice.sensors());
}

#[test]
fn about_as_many_echoes_are_missed_as_the_parameter_says() {
    let mut plant = plant(cell());
    const PINGS: usize = 2_000;
    let seen = drive(&mut plant, &[(ANSWERED_US, ALL_SONARS); PINGS], 25_000);
    let patience_us = PATIENCE_US as u16;
    let missed = seen
        .iter()
        .filter(|sensors| sensors.echo_us[0] == patience_us)
        .count();
    assert!(
        (20..=60).contains(&missed),
        "{missed} of {PINGS}, expected about 40"
    );
}

#[test]
fn ranges_scatter_about_the_truth() {
    let mut plant = plant(cell());
    let seen = drive(&mut plant, &[(ANSWERED_US, ALL_SONARS); 500], 25_000);
    let echoes: Vec<f64> = (seen.iter().map(|sensors| f64::from(sensors.echo_us[0])))
        .filter(|echo_us| *echo_us < PATIENCE_US as f64)
        .collect();
    let mean_us = echoes.iter().sum::<f64>() / echoes.len() as f64;
    let range_m = mean_us * 343.2 / 2e6;
    assert!((range_m - 1.89).abs() < 0.003, "{range_m}");
    assert!(
        echoes
            .iter()
            .any(|echo_us| (echo_us - mean_us).abs() > 20.0)
    );
}

#[test]
fn a_sonar_that_sees_nothing_says_so_and_a_broken_one_says_what_it_can() {
    let open = "world open\nstart 2,2 0\nwall 3,0 3,4";
    let patience_us = PATIENCE_US as u16;
    // A wall 0.89 m ahead, nothing behind.
    for (fault, ahead_us, behind_us) in [
        (None, 5_000..=5_400, patience_us..=patience_us),
        (Some(SonarFault::Dead), 0..=0, 0..=0),
        (
            Some(SonarFault::Deaf),
            patience_us..=patience_us,
            patience_us..=patience_us,
        ),
        (Some(SonarFault::Blind), 100..=300, 100..=300),
    ] {
        let mut plant = plant(World::parse(open).unwrap());
        drive(&mut plant, &[(ANSWERED_US, ALL_SONARS)], 5_000);
        for sonar in [0, 4] {
            fault
                .into_iter()
                .for_each(|fault| plant.break_sonar(sonar, fault));
        }
        // What it showed before is gone with the trigger.
        let sensors = &drive(&mut plant, &[(ANSWERED_US, ALL_SONARS)], 5_000)[0];
        assert!(
            ahead_us.contains(&sensors.echo_us[0]),
            "{fault:?} {sensors:?}"
        );
        assert!(
            behind_us.contains(&sensors.echo_us[4]),
            "{fault:?} {sensors:?}"
        );
        assert_eq!(sensors.echo_high, 0);
    }
    plant(cell()).break_sonar(SONARS, SonarFault::Dead);
}

#[test]
fn a_noisy_sonar_hears_something_else_in_one_ping_of_ten() {
    let open = "world open\nstart 2,2 0\nwall 3,0 3,4";
    let mut plant = plant(World::parse(open).unwrap());
    plant.break_sonar(0, SonarFault::Noisy);
    let pings = [(ANSWERED_US, ALL_SONARS); 2_000];
    let (mut nearer, mut farther) = (0, 0);
    for sensors in drive(&mut plant, &pings, ANSWERED_US) {
        // The wall is 0.89 m away; an echo is missed now and then.
        match sensors.echo_us[0] {
            0..5_000 => nearer += 1,
            5_400..30_000 => farther += 1,
            _ => {}
        }
    }
    // 0.87 m of the 3.98 m of its reach are nearer, 3.07 m are farther.
    assert!((25..65).contains(&nearer), "{nearer}");
    assert!((115..190).contains(&farther), "{farther}");
}

#[test]
fn an_echo_takes_longer_in_cold_air() {
    let echo_us = |air_c| {
        let mut body = BodyParameters::default();
        body.sonar.air_c = air_c;
        let world = World::parse("world open\nstart 2,2 0\nwall 3,0 3,4").unwrap();
        let mut plant = Plant::new(world, body, 1).unwrap();
        let sensors = &drive(&mut plant, &[(ANSWERED_US, ALL_SONARS)], ANSWERED_US)[0];
        f64::from(sensors.echo_us[0])
    };
    // The root of 293.15 by 273.15.
    let longer = echo_us(0.0) / echo_us(20.0);
    assert!((longer - 1.036).abs() < 1e-3, "{longer}");
}

#[test]
fn bumpers_are_pushed_on_the_side_where_something_is() {
    // A wall, or something low, 0.1 m before the body, at an angle to where it looks.
    for (heading_deg, expected) in [
        (0, [true, true]),
        (10, [true, true]),
        (-45, [true, false]),
        (45, [false, true]),
        (-85, [true, false]),
        (95, [false, false]),
        (180, [false, false]),
    ] {
        for kind in ["wall", "low"] {
            let world = format!(
                "world cell\nstart 1,1 {heading_deg}\nwall 0,0 0,2\n{kind} 1.122,0 1.122,2"
            );
            let plant = plant(World::parse(&world).unwrap());
            assert_eq!(
                plant.sensors().bumper_is_low,
                expected,
                "{kind} at {heading_deg}"
            );
        }
        let world =
            format!("world cell\nstart 1,1 {heading_deg}\nwall 0,0 0,2\nwall 1.124,0 1.124,2");
        let plant = plant(World::parse(&world).unwrap());
        assert_eq!(plant.sensors().bumper_is_low, [false; 2], "{heading_deg}");
    }
}

#[test]
fn what_is_low_stops_the_body_and_is_not_heard() {
    let world = World::parse("world step\nstart 1,1 0\nwall 3,0 3,2\nlow 1.5,0 1.5,2").unwrap();
    let mut plant = plant(world);
    let echo_us = drive(&mut plant, &[(ANSWERED_US, ALL_SONARS)], 5_000)[0].echo_us[0];
    // The wall is 1.89 m before the sonar.
    assert!((10_800..11_200).contains(&echo_us), "{echo_us}");
    drive(&mut plant, &[(3_000_000, duties(400, 400))], 5_000);
    assert_eq!(plant.collisions(), 1);
    let touch = plant.statistics().touches()[0];
    assert_eq!((touch.touched, touch.avoidable), (Touched::Low, false));
    let x_m = plant.pose().position.x_m;
    assert!((1.375..1.381).contains(&x_m), "{x_m}");
    assert_eq!(plant.sensors().bumper_is_low, [true; 2]);
}

#[test]
fn the_gyroscope_has_bias_noise_and_a_scale_error() {
    let mut mean_bias = Vec::new();
    for seed in 1..=20 {
        let mut plant = Plant::new(cell(), BodyParameters::default(), seed).unwrap();
        let mean = |sensors: &[Sensors]| {
            let sum: f64 = sensors.iter().map(|it| f64::from(it.yaw_counts)).sum();
            sum / sensors.len() as f64 / 131.2
        };
        let still = [(10_000, duties(0, 0)); 200];
        let standing = drive(&mut plant, &still, 10_000);
        let bias = mean(&standing);
        assert!(bias.abs() < 3.1, "seed {seed}: {bias}");
        let squares = standing
            .iter()
            .map(|it| f64::from(it.yaw_counts) / 131.2 - bias);
        let variance = squares.map(|off| off * off).sum::<f64>() / standing.len() as f64;
        assert!((0.05..0.09).contains(&libm::sqrt(variance)), "seed {seed}");
        mean_bias.push(bias);
        drive(&mut plant, &[(1_000_000, duties(-300, 300))], 10_000);
        let before_rad = plant.pose().heading_rad;
        let turning = drive(&mut plant, &[(10_000, duties(-300, 300)); 100], 10_000);
        let turned_deg = (plant.pose().heading_rad - before_rad) * 180.0 / core::f64::consts::PI;
        let scale = (mean(&turning) - bias) / turned_deg;
        assert!((scale - 1.01).abs() < 0.002, "seed {seed}: {scale}");
    }
    assert!(mean_bias.iter().any(|bias| *bias > 1.0) && mean_bias.iter().any(|bias| *bias < -1.0));
}

#[test]
fn the_battery_sags_under_load_and_empties() {
    let mut plant = plant(cell());
    let rest = plant.sensors().adc_counts[BATTERY_CHANNEL];
    assert!((3_400..3_450).contains(&rest), "8.3 V of 9.9 V: {rest}");
    plant.apply(&duties(1_000, -1_000));
    plant.advance_to(20_000);
    let load = plant.sensors().adc_counts[BATTERY_CHANNEL];
    assert!(load + 100 < rest, "{load} {rest}");
    let full_v = plant.battery_v();
    plant.advance_to(60_000_000);
    plant.apply(&duties(0, 0));
    plant.advance_to(60_100_000);
    let body = plant.body().battery;
    assert!(plant.battery_v() > full_v && plant.battery_v() < body.full_v - 0.005);
}

#[test]
fn auxiliary_output_0_is_looped_back_to_the_last_adc_input() {
    let mut plant = plant(cell());
    for (aux_outputs, expected) in [(0b0001, ADC_FULL_SCALE), (0b1110, 0)] {
        plant.apply(&Actuators {
            aux_outputs,
            ..Actuators::default()
        });
        assert_eq!(plant.aux_outputs(), aux_outputs);
        assert_eq!(plant.sensors().adc_counts[3], expected);
    }
}

#[test]
fn rooms_count_when_the_robot_comes_into_them() {
    let world = World::parse(
        "world two\nstart 1,1 0\nwall 0,0 6,0 6,2 0,2 0,0\nroom west 0,0 2,0 2,2 0,2\nroom east 2,0 6,0 6,2 2,2",
    );
    let mut plant = plant(world.unwrap());
    assert_eq!(plant.statistics().room_now(), Some("west"));
    drive(&mut plant, &[(4_000_000, duties(500, 515))], 20_000);
    assert_eq!(plant.statistics().rooms_entered(), ["east"]);
    drive(&mut plant, &[(5_000_000, duties(-500, -515))], 20_000);
    assert_eq!(plant.statistics().rooms_entered(), ["east", "west"]);
}

#[test]
fn a_start_in_a_wall_is_refused() {
    let world = World::parse("world tight\nstart 0.1,1 0\nwall 0,0 0,2").unwrap();
    let error = Plant::new(world, BodyParameters::default(), 1).unwrap_err();
    assert_eq!(
        error.to_string(),
        "the robot does not fit at the start of world `tight`: the nearest wall is 0.100 m from its centre, \
         its radius is 0.120 m; move `start` away from the walls"
    );
}

/// The cell, with people: a line of the file each.
fn visited(people: &str) -> World {
    World::parse(&format!(
        "world cell\nstart 2,2 0\nwall 0,0 4,0 4,4 0,4 0,0\n{people}"
    ))
    .unwrap()
}

#[test]
fn a_wall_comes_at_its_time_unless_the_body_is_there() {
    let walls = "wall 3,1 3,3 from 100 ms\nwall 2,1 2,3 from 100 ms";
    let mut plant = plant(visited(walls));
    let (near_us, far_us) = (5_000..=5_300, 10_700..=11_300);
    for (time_us, expected_us, added) in [(0, &far_us, 0), (100_000, &near_us, 1)] {
        plant.advance_to(time_us);
        plant.apply(&ALL_SONARS);
        plant.advance_to(time_us + ANSWERED_US);
        let echo_us = plant.sensors().echo_us[0];
        assert!(expected_us.contains(&echo_us), "{echo_us} at {time_us}");
        assert_eq!(
            plant.added_walls().len(),
            added,
            "the body stands where the other is to be"
        );
    }
}

#[test]
fn a_wheel_that_something_holds_stands_still_and_takes_current() {
    let world = "world hall\nstart 2,2 0\nwall -9,-9 9,-9";
    let mut plant = plant(World::parse(world).unwrap());
    let forwards = Actuators {
        left_duty: 300,
        right_duty: 300,
        ..Actuators::default()
    };
    plant.apply(&forwards);
    plant.advance_to(1_000_000);
    let before = plant.sensors();
    assert!(before.left_count > 100 && before.right_count > 100);
    plant.stick_wheel(WheelSide::Left);
    plant.advance_to(2_000_000);
    let behind = plant.sensors();
    assert_eq!(behind.left_count, before.left_count);
    assert!(behind.right_count > before.right_count + 100);
    assert!(
        behind.adc_counts[2] > before.adc_counts[2],
        "a motor that is held takes more"
    );
    let turned_rad = plant.pose().heading_rad;
    assert!(turned_rad > 0.5, "it turns to the left: {turned_rad}");
}

#[test]
fn people_step_in_and_away_at_their_times() {
    let people = "person 1,1 0.2\nperson 1,3 0.2 from 1 s\nperson 3,3 0.2 from 1500 ms to 2 s\nperson 3,1 0.2 to 1 s";
    let mut plant = plant(visited(people));
    for (time_us, standing) in [
        (0, &[4, 7][..]),
        (999_999, &[4, 7]),
        (1_000_000, &[4, 5]),
        (1_499_000, &[4, 5]),
        (1_500_000, &[4, 5, 6]),
        (1_999_999, &[4, 5, 6]),
        (2_000_000, &[4, 5]),
        (90_000_000, &[4, 5]),
    ] {
        while plant.now_us() < time_us {
            plant.advance_to(time_us);
        }
        let lines: Vec<usize> = plant.people().map(|person| person.line).collect();
        assert_eq!(lines, standing, "at {time_us}");
    }
}

#[test]
fn sonars_see_a_person_while_one_stands_there() {
    // Ahead 1.89 m to the wall; 0.64 m to the person, whose nearest point is straight ahead.
    let mut plant = plant(visited("person 3,2 0.25 from 100 ms to 200 ms"));
    let (near_us, far_us) = (3_600..=3_860, 10_700..=11_300);
    for (time_us, expected_us) in [(0, &far_us), (100_000, &near_us), (200_000, &far_us)] {
        plant.advance_to(time_us);
        plant.apply(&ALL_SONARS);
        plant.advance_to(time_us + ANSWERED_US);
        let echo_us = plant.sensors().echo_us;
        assert!(expected_us.contains(&echo_us[0]), "{time_us}: {echo_us:?}");
        assert!(far_us.contains(&echo_us[4]), "behind: {echo_us:?}");
    }
}

#[test]
fn a_person_stops_the_robot_and_counts_once_until_gone() {
    let mut plant = plant(visited("person 3,2 0.25 from 100 ms to 10 s"));
    let on = |time_us| (time_us, duties(600, 600));
    drive(&mut plant, &[on(8_000_000)], 20_000);
    assert_eq!(plant.collisions(), 1);
    assert!(plant.hardest_collision_m_per_s() > 0.2);
    let nearest_m = |plant: &Plant| {
        let centre = plant.pose().position;
        let from_m = plant
            .people()
            .map(|person| person.circle.distance_m(centre));
        from_m.fold(f64::INFINITY, f64::min)
    };
    assert!(
        (nearest_m(&plant) - 0.12).abs() < 0.001,
        "{}",
        nearest_m(&plant)
    );
    assert_eq!(plant.sensors().adc_counts[1], ADC_FULL_SCALE, "the bumper");
    // The person goes, and the robot drives on into the wall.
    drive(&mut plant, &[on(2_100_000)], 20_000);
    assert_eq!(plant.sensors().adc_counts[1], 0, "nobody is touched");
    drive(&mut plant, &[on(8_000_000)], 20_000);
    assert_eq!(plant.collisions(), 2);
    assert!((plant.distance_to_walls_m() - 0.12).abs() < 0.001);
}

#[test]
fn nobody_steps_in_where_the_robot_is_before_it_has_left() {
    let people = "person 1.9,2 0.25 from 1 s\nperson 2,2 0.25 from 1 s to 2 s";
    let mut plant = plant(visited(people));
    let stand = (3_000_000, duties(0, 0));
    drive(&mut plant, &[stand], 20_000);
    assert_eq!(plant.people().count(), 0, "there is no room");
    let away = (2_000_000, duties(500, 500));
    drive(&mut plant, &[away], 20_000);
    let lines: Vec<usize> = plant.people().map(|person| person.line).collect();
    assert_eq!(lines, [4], "the other one's time is over");
    assert_eq!(plant.collisions(), 0, "and it drove off freely");
    let back = (4_000_000, duties(-500, -500));
    drive(&mut plant, &[back], 20_000);
    assert_eq!(plant.collisions(), 1, "now that person is in the way");
}

#[test]
fn a_start_where_a_person_stands_is_refused() {
    for (person, expected) in [
        ("person 2.3,2 0.25", Some("0.050 m")),
        ("person 2,2 0.25 to 5 s", Some("0.000 m")),
        ("person 2,2 0.25 from 1 us", None),
        ("person 2.38,2 0.25", None),
    ] {
        let plant = Plant::new(visited(person), BodyParameters::default(), 1);
        let error = plant.err().map(|error| error.to_string());
        let expected = expected.map(|distance| {
            format!(
                "the robot does not fit at the start of world `cell`: the person of line 4 is {distance} from its \
                 centre, its radius is 0.120 m; move the person, or let the person come later, as in `from 5 s`"
            )
        });
        assert_eq!(error, expected, "{person}");
    }
}

#[test]
fn a_request_far_in_the_future_advances_by_the_limit() {
    let mut plant = plant(cell());
    plant.exchange(&Request {
        start_us: u64::MAX,
        ..Request::default()
    });
    assert_eq!(plant.now_us(), ADVANCE_LIMIT_US);
}

/// What a minute of driving in circles through a yard looks like, down to the last bit. It changes
/// only if the model does.
#[test]
fn a_minute_is_equal_to_the_bit_on_every_machine() {
    const GOLDEN: u64 = 0x86D2_026D_0D40_ED3B;
    /// The same without what the gyroscope counts, which changes nothing of the rest.
    const WITHOUT_GYRO: u64 = 0x452E_38DE_305F_D6F7;
    const GYRO_BYTES: core::ops::Range<usize> = 39..41;
    let yard = "world yard\nstart 2,2 10\nwall 0,0 6,0 6.5,5 0,4.5 0,0\nwall 4,2 4.2,2 4.1,2.3 4,2";
    let mut plant = plant(World::parse(yard).unwrap());
    let fnv_1a = |hash: &mut u64, byte: u8| {
        *hash = (*hash ^ u64::from(byte)).wrapping_mul(0x100_0000_01B3);
    };
    let (mut hash, mut without_gyro) = (0xCBF2_9CE4_8422_2325_u64, 0xCBF2_9CE4_8422_2325_u64);
    for slot in 0..3_000_u64 {
        let phase = (slot % 200) as i16;
        let reply = plant.exchange(&Request {
            sequence: slot as u32,
            start_us: slot * 20_000,
            effect_us: (slot * 20_000).saturating_sub(13_000),
            actuators: Actuators {
                left_duty: 500 - phase * 4,
                right_duty: 200 + phase,
                sonar_triggers: if slot % 2 == 0 { 0x55 } else { 0xAA },
                aux_outputs: 0,
                array_triggers: 0,
            },
        });
        let pose = plant.pose();
        let pose_bits = [pose.position.x_m, pose.position.y_m, pose.heading_rad].map(f64::to_bits);
        let bytes =
            (reply.encode().into_iter()).chain(pose_bits.into_iter().flat_map(u64::to_le_bytes));
        for (place, byte) in bytes.enumerate() {
            fnv_1a(&mut hash, byte);
            if !GYRO_BYTES.contains(&place) {
                fnv_1a(&mut without_gyro, byte);
            }
        }
    }
    assert_eq!(plant.collisions(), 0, "a wall would hide differences");
    assert_eq!(hash, GOLDEN, "{hash:#018X}");
    assert_eq!(without_gyro, WITHOUT_GYRO, "{without_gyro:#018X}");
}

#[test]
fn line_sensors_read_how_much_of_their_spot_lies_on_a_line() {
    // The row of sensors is 0.09 m ahead of the centre; the line runs along the heading, `line_y_m`
    // to the left of it, or across it at the row.
    let counts = |line: &str| {
        let world = format!("world cell\nstart 2,2 0\nwall 0,0 4,0 4,4 0,4 0,0\n{line}");
        let readings = plant(World::parse(&world).unwrap()).sensors().adc_counts;
        [LINE_CHANNEL, LINE_CHANNEL + 1, LINE_CHANNEL + 2].map(|channel| readings[channel])
    };
    for (line, expected) in [
        ("", [460, 460, 460]),
        ("line 0.019 1,2 3,2", [460 + 250, 3_400, 460 + 250]),
        ("line 0.019 1,2.0121 3,2.0121", [3_400, 460 + 250, 460]),
        ("line 0.019 1,1.9879 3,1.9879", [460, 460 + 250, 3_400]),
        ("line 0.019 1,2.0095 3,2.0095", [3_400, 1_930, 460]),
        ("line 0.019 2.09,1 2.09,3", [3_400, 3_400, 3_400]),
        ("line 0.019 2.07,1 2.07,3", [460, 460, 460]),
    ] {
        let seen = counts(line);
        for (seen, expected) in seen.into_iter().zip(expected) {
            // The noise of a conversion, and a little for the two spots beside a line that is as
            // good as centred.
            assert!(
                (i32::from(seen) - expected).abs() < 90,
                "{line}: {seen} for {expected}"
            );
        }
    }
}

#[test]
fn line_sensors_are_noisy_and_each_on_its_own() {
    let mut plant = plant(cell());
    let mut seen = std::collections::BTreeSet::new();
    for time_us in (0..20).map(|tick| tick * 20_000) {
        plant.advance_to(time_us);
        let counts = plant.sensors().adc_counts;
        seen.insert([counts[LINE_CHANNEL], counts[LINE_CHANNEL + 1]]);
    }
    assert!(seen.len() > 15, "{seen:?}");
    assert!(seen.iter().any(|[left, middle]| left != middle), "{seen:?}");
}
