use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI, TAU};

use proptest::prelude::*;
use rt_firmware::drivers::{EncoderCounter, WheelEncoder};
use rt_firmware::odometry::Pose;

use super::*;

/// A tick is a millimetre.
const UNIT: Measures = Measures {
    ticks_per_rev: 1_000.0,
    wheel_radius_mm: 1_000.0 / TAU,
    base_mm: 200.0,
};

/// The end of a log of that text.
fn read_with(
    text: &str,
    measures: Measures,
    width: Option<CounterWidth>,
) -> Result<Reckoned, String> {
    let mut log = TickLog::new(measures, width);
    for line in text.split_inclusive('\n') {
        let lines = log.lines() + 1;
        log.line(line.as_bytes())
            .map_err(|error| format!("{lines}: {error}"))?;
    }
    log.end().map_err(|error| error.to_string())
}

fn read(text: &str) -> Reckoned {
    read_with(text, UNIT, None).unwrap()
}

/// A log with these counts.
fn log_of(counts: impl IntoIterator<Item = [i64; 2]>) -> String {
    let rows = counts.into_iter().enumerate();
    rows.map(|(row, [left, right])| format!("{},{left},{right}\n", row * 10_000))
        .collect()
}

/// A wheel base of which so many ticks apart are a turn by that angle.
fn turning(ticks: f64, angle_rad: f64) -> Measures {
    Measures {
        base_mm: ticks / angle_rad,
        ..UNIT
    }
}

#[test]
fn a_robot_ends_where_geometry_says() {
    let radius_mm = 2_000.0 / PI;
    // Wheels that roll 900 and 1,100 mm through a quarter turn roll 1 m on its middle.
    let quarter = turning(200.0, FRAC_PI_2);
    for (name, measures, counts, [x_mm, y_mm, theta_deg, distance_mm, rotation_deg]) in [
        ("one row", UNIT, vec![[7, -9]], [0.0; 5]),
        (
            "straight",
            UNIT,
            vec![[0, 0], [1, 1], [1_000, 1_000]],
            [1_000.0, 0.0, 0.0, 1_000.0, 0.0],
        ),
        (
            "back",
            UNIT,
            vec![[5, 9], [-495, -491]],
            [-500.0, 0.0, 0.0, -500.0, 0.0],
        ),
        (
            "there and half of it back",
            UNIT,
            vec![[0, 0], [800, 800], [400, 400]],
            [400.0, 0.0, 0.0, 400.0, 0.0],
        ),
        (
            "two and a half turns on the spot",
            turning(200.0, FRAC_PI_2),
            vec![[0, 0], [-100, 100], [-1_000, 1_000]],
            [0.0, 0.0, 180.0, 0.0, 900.0],
        ),
        (
            "half a turn to the right",
            turning(200.0, FRAC_PI_2),
            vec![[0, 0], [200, -200]],
            [0.0, 0.0, 180.0, 0.0, -180.0],
        ),
        (
            "a quarter to the left in one row",
            quarter,
            vec![[0, 0], [900, 1_100]],
            [radius_mm, radius_mm, 90.0, 1_000.0, 90.0],
        ),
        (
            "a quarter to the right in ten rows",
            quarter,
            (0..=10).map(|row| [110 * row, 90 * row]).collect(),
            [radius_mm, -radius_mm, -90.0, 1_000.0, -90.0],
        ),
        (
            "an eighth to the left and a metre straight on",
            turning(200.0, FRAC_PI_4),
            vec![[0, 0], [-100, 100], [900, 1_100]],
            [
                1_000.0 * libm::cos(FRAC_PI_4),
                1_000.0 * libm::sin(FRAC_PI_4),
                45.0,
                1_000.0,
                45.0,
            ],
        ),
        (
            "a figure eight",
            quarter,
            vec![[0, 0], [3_600, 4_400], [8_000, 8_000]],
            [0.0, 0.0, 0.0, 8_000.0, 0.0],
        ),
        (
            "backwards through a quarter",
            quarter,
            vec![[0, 0], [-1_100, -900]],
            [-radius_mm, -radius_mm, 90.0, -1_000.0, 90.0],
        ),
    ] {
        let end = read_with(&log_of(counts), measures, None).unwrap();
        for (what, value, expected) in [
            ("x", end.x_mm, x_mm),
            ("y", end.y_mm, y_mm),
            ("theta", end.theta_deg, theta_deg),
            ("distance", end.distance_mm, distance_mm),
            ("rotation", end.rotation_deg, rotation_deg),
        ] {
            assert!((value - expected).abs() < 1e-9, "{name}, {what}: {end:?}");
        }
    }
}

#[test]
fn counters_wrap_where_their_values_say() {
    let most = i64::from(u32::MAX);
    let (least_32, most_32) = (i64::from(i32::MIN), i64::from(i32::MAX));
    for (from, to, ticks, bits) in [
        (65_530, 4, 10, 16),
        (4, 65_530, -10, 16),
        (32_760, -32_760, 16, 16),
        (-32_768, 32_767, -1, 16),
        (32_760, 32_770, 10, 16),
        (5, -5, -10, 16),
        (most - 5, 4, 10, 32),
        (4, most - 5, -10, 32),
        (most_32 - 4, least_32 + 5, 10, 32),
        (least_32, most_32, -1, 32),
        (65_530, 65_540, 10, 32),
        (-5, 40_000, 40_005, 32),
        (70_000, 20, -69_980, 32),
        (most - 4, most + 6, 10, 64),
        (-5, most, most + 5, 64),
        (i64::MAX, i64::MIN, 1, 64),
    ] {
        for wheel in [0, 1] {
            let mut counts = [[0; 2]; 2];
            counts[0][wheel] = from;
            counts[1][wheel] = to;
            let end = read(&log_of(counts));
            let turned = if wheel == 0 { -ticks } else { ticks } as f64;
            let rotation_deg = (turned / UNIT.base_mm).to_degrees();
            let error = (end.rotation_deg / rotation_deg - 1.0).abs();
            assert!(error < 1e-12, "{from} {to} {wheel}: {end:?}");
            assert_eq!(end.counter_width.bits(), bits, "{from} {to}");
        }
    }
}

#[test]
fn the_width_can_be_said_where_the_values_do_not_tell_it() {
    let text = log_of([[0, 0], [40_000, 40_000]]);
    for (width, distance_mm) in [
        (None, -25_536.0),
        (Some(CounterWidth::Bits16), -25_536.0),
        (Some(CounterWidth::Bits32), 40_000.0),
        (Some(CounterWidth::Bits64), 40_000.0),
    ] {
        let end = read_with(&text, UNIT, width).unwrap();
        assert!((end.distance_mm - distance_mm).abs() < 1e-9, "{end:?}");
        assert_eq!(end.fastest.ticks as f64, distance_mm.abs());
        assert_eq!(end.fastest.line, 2);
    }
    for (counts, width) in [
        ([[0, 0], [0, 65_536]], CounterWidth::Bits16),
        ([[-1, 0], [32_768, 0]], CounterWidth::Bits16),
        ([[0, -32_769], [0, 0]], CounterWidth::Bits16),
        ([[0, 1 << 32], [0, 0]], CounterWidth::Bits32),
    ] {
        let error = read_with(&log_of(counts), UNIT, Some(width)).unwrap_err();
        let said = format!("no counter of {} bits has both", width.bits());
        assert!(error.contains(&said), "{error}");
    }
}

#[test]
fn logs_come_in_many_forms() {
    let expected = read("0,10,20\n10000,15,30\n20000,30,20\n");
    assert_eq!((expected.rows, expected.fastest.ticks), (3, 15));
    for text in [
        "t_us,left,right\n0,10,20\n10000,15,30\n20000,30,20",
        "\u{feff}t_us,left,right\r\n0,10,20\r\n10000,15,30\r\n20000,30,20\r\n\r\n",
        "\u{feff}0,10,20\n10000,15,30\n\n20000,30,20\n\n",
        "right,mode,T_US,Left\n20,a,0,10\n30,b,10000,15\n20,,20000,30\n",
        " 0 , 10 ,20\n10000, 15,\t30\n20000,+30,20.0\n",
        "\"t_us\",\"left\",\"right\"\n\"0\",\"10\",\"20\"\n1e4,15.,3.0e1\n20000.5,30,20.000\n",
    ] {
        // A line of names moves all others.
        let end = Reckoned {
            fastest: expected.fastest,
            ..read(text)
        };
        assert_eq!(end, expected, "{text:?}");
    }
}

#[test]
fn what_is_no_log_is_told_with_its_line() {
    for (text, said) in [
        ("", "no rows"),
        ("\n \r\n", "no rows"),
        ("t_us,left,right\n", "no rows"),
        ("t_us,left\n0,1\n", "1: there is no column `right`"),
        ("time,left,right\n0,1,2\n", "1: there is no column `t_us`"),
        ("a,b,c\n0,1,2\n", "1: `a` is neither a number nor"),
        ("0,1,2\n1,two,3\n", "2: left is `two`: expected a number"),
        ("0,1,2\n1,,3\n", "2: left is ``: expected a number"),
        (
            "0,1,2\n\nsoon,2,3\n",
            "3: t_us is `soon`: expected a number",
        ),
        ("0,1,nan\n", "1: right is `nan`: expected a number"),
        (
            "0,1,2\n1,2.5,3\n",
            "2: left is `2.5`: expected a whole number",
        ),
        (
            "0,1,1e300\n",
            "1: right is `1e300`: expected a count that fits",
        ),
        ("0,1,inf\n", "1: right is `inf`: expected a count that fits"),
        ("0,1,18446744073709551615\n", "expected a count that fits"),
        ("0,1,2\n1,2\n", "2: 2 columns found, and 3 expected"),
        ("0;1;2\n", "1: 1 column found, and 3 expected"),
    ] {
        let error = read_with(text, UNIT, None).unwrap_err();
        assert!(error.contains(said), "{text:?}: {error}");
    }
    let mut log = TickLog::new(UNIT, None);
    assert_eq!(log.line(b"0,\xff,1"), Err(RowError::NoText.into()));
}

proptest! {
    /// Whatever is written in a file.
    #[test]
    fn no_text_makes_it_panic(text in "[0-9,.eE+nif\"\r\n-]{0,60}") {
        let _ = read_with(&text, UNIT, None);
    }

    /// The same drive, seen by counters of all widths, with and without a sign.
    #[test]
    fn the_way_does_not_depend_on_the_counter(
        start in prop::array::uniform2(-40_000_i64..40_000),
        steps in prop::collection::vec(prop::array::uniform2(-30_000_i64..30_000), 1..40),
    ) {
        let mut counts = vec![start];
        for step in steps {
            let [left, right] = *counts.last().unwrap();
            counts.push([left + step[0], right + step[1]]);
        }
        let plain = read_with(&log_of(counts.clone()), UNIT, Some(CounterWidth::Bits64)).unwrap();
        let narrowed: [fn(i64) -> i64; 4] = [
            |count| i64::from(count as u16),
            |count| i64::from(count as i16),
            |count| i64::from(count as u32),
            |count| i64::from(count as i32),
        ];
        for narrow in narrowed {
            let end = read(&log_of(counts.iter().map(|it| it.map(narrow))));
            prop_assert_eq!((end.x_mm, end.y_mm), (plain.x_mm, plain.y_mm));
            prop_assert_eq!(end.rotation_deg, plain.rotation_deg);
            prop_assert_eq!(end.distance_mm, plain.distance_mm);
        }
    }
}

/// A counter that a test sets.
struct Counter<'a>(&'a std::cell::Cell<u16>);

impl EncoderCounter for Counter<'_> {
    fn count(&mut self) -> u16 {
        self.0.get()
    }
}

/// The firmware adds up in `f32` and without knowing the way as a whole. After 200 m of curves it
/// is within a millimetre and a hundredth of a degree of what is worked out here.
#[test]
fn the_firmware_comes_to_the_same_end() {
    const ROWS: u32 = 20_000;
    const MOST_MM: f64 = 1.0;
    const MOST_DEG: f64 = 0.01;
    let measures = Measures {
        ticks_per_rev: 1_440.0,
        wheel_radius_mm: 32.3,
        base_mm: 160.0,
    };
    let metres_per_count = (measures.mm_per_tick() / 1_000.0) as f32;
    let cells = [65_000_u16, 300].map(std::cell::Cell::new);
    let [mut left, mut right] = cells
        .each_ref()
        .map(|cell| WheelEncoder::new(Counter(cell)));
    let mut pose = Pose::START;
    let mut text = String::from("t_us,left,right\n");
    for row in 0..ROWS {
        let [left_m, right_m] = [left.take_counts(), right.take_counts()]
            .map(|counts| counts as f32 * metres_per_count);
        pose = pose.rolled(left_m, right_m, (measures.base_mm / 1_000.0) as f32);
        text += &format!("{},{},{}\n", row * 20_000, cells[0].get(), cells[1].get());
        let bend = (30.0 * libm::sin(f64::from(row) / 300.0)) as i16;
        cells[0].set(cells[0].get().wrapping_add_signed(70 - bend));
        cells[1].set(cells[1].get().wrapping_add_signed(71 + bend));
    }
    let end = read_with(&text, measures, None).unwrap();
    assert_eq!(end.counter_width, CounterWidth::Bits16);
    assert!(end.distance_mm > 190_000.0, "{end:?}");
    let off_mm = libm::hypot(
        end.x_mm - f64::from(pose.x_m) * 1_000.0,
        end.y_mm - f64::from(pose.y_m) * 1_000.0,
    );
    let off_deg = wrapped_deg(end.theta_deg - f64::from(pose.heading_rad).to_degrees());
    println!(
        "{off_mm} mm, {off_deg} degrees off after {} mm",
        end.distance_mm
    );
    assert!(off_mm < MOST_MM, "{off_mm} mm");
    assert!(off_deg.abs() < MOST_DEG, "{off_deg} degrees");
}
