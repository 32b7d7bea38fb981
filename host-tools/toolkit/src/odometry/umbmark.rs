//! The UMBmark: a robot's wheel base and the ratio of its wheels, from squares that it drives in
//! both directions.
//!
//! After J. Borenstein and L. Feng, "Measurement and Correction of Systematic Odometry Errors in
//! Mobile Robots", IEEE Transactions on Robotics and Automation 12(6), 1996.
//!
//! The robot drives a square by its odometry, several times clockwise and several times
//! counter-clockwise, and comes back to where it began, as far as it knows. Where it really is can
//! be measured with a tape. Two wrong measures of the robot show there:
//!
//! - **Type A**, a wrong wheel base: each corner is turned by α too little. Seen from above, the
//!   two directions are mirror images of each other.
//! - **Type B**, unequal wheels: each side bends to the left by β. Clockwise and counter-clockwise
//!   it is the same bend, so that the two directions are no mirror images.
//!
//! To first order in α and β, with the side L and the first side along x, a run ends at
//!
//! | direction | x | y |
//! |---|---|---|
//! | clockwise | -2L(α + β) | -2L(α + β) |
//! | counter-clockwise | -2L(α - β) | 2L(α - β) |
//!
//! Sums and differences of the two give α and β, twice: from x and from y. The mean of both is
//! taken. What both wheels have in common, their mean diameter, does not show in a square.

use crate::table::{self, Columns, RowError};

/// The columns of a table of runs.
const COLUMNS: [&str; 3] = ["direction", "x_mm", "y_mm"];

/// Which way round a square was driven, seen from above.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    /// To the right at each corner.
    Clockwise,
    /// To the left at each corner.
    CounterClockwise,
}

/// A place, as far as it is from where it should be: along the first side of the square, and to the
/// left of it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Offset {
    /// Along the first side, in millimetres.
    pub x_mm: f64,
    /// To the left of it, in millimetres.
    pub y_mm: f64,
}

impl Offset {
    /// Its length, in millimetres.
    pub fn length_mm(self) -> f64 {
        libm::hypot(self.x_mm, self.y_mm)
    }
}

/// What was measured in one direction.
#[derive(Clone, Copy, Debug, Default)]
struct Runs {
    count: u64,
    sum: Offset,
}

impl Runs {
    fn centre(self) -> Option<Offset> {
        let count = self.count as f64;
        (self.count > 0).then(|| Offset {
            x_mm: self.sum.x_mm / count,
            y_mm: self.sum.y_mm / count,
        })
    }
}

/// Runs around a square, as they are measured.
#[derive(Clone, Debug, Default)]
pub struct Squares {
    columns: Option<Columns<3>>,
    clockwise: Runs,
    counter_clockwise: Runs,
}

/// What the squares say of a robot.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Evaluation {
    /// Runs in each direction, clockwise ones first.
    pub runs: [u64; 2],
    /// Centres of gravity of where they ended, clockwise ones first.
    pub centres: [Offset; 2],
    /// The greatest systematic error: the distance of the farther centre.
    pub e_max_syst_mm: f64,
    /// α from x and from y.
    pub alphas_rad: [f64; 2],
    /// β from x and from y.
    pub betas_rad: [f64; 2],
    /// α: by how much too little each corner was turned.
    pub alpha_rad: f64,
    /// β: how far each side bent to the left.
    pub beta_rad: f64,
    /// Radius of the arc that a side was, positive to the left; none where it was straight.
    pub radius_mm: Option<f64>,
    /// E_b: the true wheel base by the nominal one.
    pub e_b: f64,
    /// E_d: the right wheel's diameter by the left one's.
    pub e_d: f64,
    /// The true wheel base.
    pub base_mm: f64,
    /// What the diameters of the left and the right wheel are to be multiplied by. Their mean
    /// stays.
    pub diameter_factors: [f64; 2],
}

/// What is wrong with a line of a table of runs.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum LineError {
    /// It is no row of the table.
    #[error(transparent)]
    Row(#[from] RowError),
    /// A direction is none.
    #[error("the direction is `{found}`: expected `cw` (clockwise) or `ccw`")]
    Direction {
        /// What stands there.
        found: String,
    },
    /// A field is no length.
    #[error("{column} is `{found}`: expected a number of millimetres")]
    NoLength {
        /// The column.
        column: &'static str,
        /// What stands there.
        found: String,
    },
}

/// Why squares say nothing.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum EvaluationError {
    /// All runs went the same way round, or there are none.
    #[error(
        "runs clockwise: {clockwise}, counter-clockwise: {counter_clockwise}; drive at least one of each, better five"
    )]
    OneSided {
        /// Runs clockwise.
        clockwise: u64,
        /// Runs counter-clockwise.
        counter_clockwise: u64,
    },
    /// The robot was not near its start.
    #[error(
        "the runs end {found_mm:.0} mm from their start on average, more than half a side of {side_mm:.0} mm: were they measured in millimetres, from the start?"
    )]
    TooFar {
        /// The distance.
        found_mm: f64,
        /// The side.
        side_mm: f64,
    },
    /// A side is shorter than the robot is wide.
    #[error(
        "a side of {side_mm} mm is shorter than the wheel base of {base_mm} mm: give both in millimetres"
    )]
    SmallSquare {
        /// The side.
        side_mm: f64,
        /// The wheel base.
        base_mm: f64,
    },
}

impl Squares {
    /// Takes the next line of a table of runs.
    ///
    /// # Errors
    /// [`LineError`]
    pub fn line(&mut self, line: &[u8]) -> Result<(), LineError> {
        let line = table::text(line)?;
        if line.is_empty() {
            return Ok(());
        }
        let columns = match self.columns {
            Some(columns) => columns,
            None => {
                let columns = *(self.columns).insert(Columns::of_first_line(line, COLUMNS)?);
                if columns.are_named() {
                    return Ok(());
                }
                columns
            }
        };
        let [direction, x, y] = columns.fields(line)?;
        let direction = match direction.to_ascii_lowercase().as_str() {
            "cw" => Direction::Clockwise,
            "ccw" => Direction::CounterClockwise,
            _ => {
                let found = direction.to_owned();
                return Err(LineError::Direction { found });
            }
        };
        let end = Offset {
            x_mm: length(COLUMNS[1], x)?,
            y_mm: length(COLUMNS[2], y)?,
        };
        self.add(direction, end);
        Ok(())
    }

    /// Adds a run that ended there.
    pub fn add(&mut self, direction: Direction, end: Offset) {
        let runs = match direction {
            Direction::Clockwise => &mut self.clockwise,
            Direction::CounterClockwise => &mut self.counter_clockwise,
        };
        runs.count += 1;
        runs.sum.x_mm += end.x_mm;
        runs.sum.y_mm += end.y_mm;
    }

    /// What the runs say of a robot that took its wheel base for `base_mm`, and drove squares with
    /// sides of `side_mm`.
    ///
    /// # Errors
    /// [`EvaluationError`]
    pub fn evaluate(&self, side_mm: f64, base_mm: f64) -> Result<Evaluation, EvaluationError> {
        if side_mm < base_mm {
            return Err(EvaluationError::SmallSquare { side_mm, base_mm });
        }
        let (Some(cw), Some(ccw)) = (self.clockwise.centre(), self.counter_clockwise.centre())
        else {
            return Err(EvaluationError::OneSided {
                clockwise: self.clockwise.count,
                counter_clockwise: self.counter_clockwise.count,
            });
        };
        let e_max_syst_mm = cw.length_mm().max(ccw.length_mm());
        if e_max_syst_mm > side_mm / 2.0 {
            return Err(EvaluationError::TooFar {
                found_mm: e_max_syst_mm,
                side_mm,
            });
        }
        let by_sides = |sum_mm: f64| sum_mm / (-4.0 * side_mm);
        let alphas_rad = [cw.x_mm + ccw.x_mm, cw.y_mm - ccw.y_mm].map(by_sides);
        let betas_rad = [cw.x_mm - ccw.x_mm, cw.y_mm + ccw.y_mm].map(by_sides);
        let mean = |[x, y]: [f64; 2]| (x + y) / 2.0;
        let (alpha_rad, beta_rad) = (mean(alphas_rad), mean(betas_rad));
        let e_b = std::f64::consts::FRAC_PI_2 / (std::f64::consts::FRAC_PI_2 - alpha_rad);
        let true_base_mm = base_mm * e_b;
        // A side is the chord of an arc that turns by β.
        let sine = libm::sin(beta_rad / 2.0);
        // Half of the true base, in parts of the radius.
        let half_base = true_base_mm * sine / side_mm;
        let e_d = (1.0 + half_base) / (1.0 - half_base);
        Ok(Evaluation {
            runs: [self.clockwise.count, self.counter_clockwise.count],
            centres: [cw, ccw],
            e_max_syst_mm,
            alphas_rad,
            betas_rad,
            alpha_rad,
            beta_rad,
            radius_mm: (sine != 0.0).then(|| side_mm / 2.0 / sine),
            e_b,
            e_d,
            base_mm: true_base_mm,
            diameter_factors: [2.0 / (e_d + 1.0), 2.0 * e_d / (e_d + 1.0)],
        })
    }
}

/// The greatest length that is taken: a kilometre.
const MOST_MM: f64 = 1e6;

fn length(column: &'static str, text: &str) -> Result<f64, LineError> {
    (text.parse().ok())
        .filter(|length: &f64| length.abs() <= MOST_MM)
        .ok_or_else(|| LineError::NoLength {
            column,
            found: text.to_owned(),
        })
}

/// A place from the command line, `x,y` in millimetres.
impl std::str::FromStr for Offset {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let form = || "expected two numbers of millimetres, such as 12.5,-3".to_owned();
        let (x, y) = text.split_once(',').ok_or_else(form)?;
        let number = |text: &str| length("", text.trim()).map_err(|_| form());
        Ok(Self {
            x_mm: number(x)?,
            y_mm: number(y)?,
        })
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::{FRAC_PI_2, FRAC_PI_4};

    use super::super::arc::ArcPose;
    use super::*;

    const SIDE_MM: f64 = 4_000.0;
    const BASE_MM: f64 = 340.0;

    /// A robot, and what its odometry takes it for.
    #[derive(Clone, Copy)]
    struct Robot {
        true_base_mm: f64,
        /// True ways of left and right wheel, for a way of 1 by their nominal diameters.
        true_ways: [f64; 2],
        base_mm: f64,
        diameter_factors: [f64; 2],
    }

    impl Robot {
        /// As it was built: with the true wheel base by the nominal one, and the right wheel's
        /// diameter by the left one's.
        fn built(e_b: f64, e_d: f64) -> Self {
            Self {
                true_base_mm: BASE_MM * e_b,
                true_ways: [2.0 / (e_d + 1.0), 2.0 * e_d / (e_d + 1.0)],
                base_mm: BASE_MM,
                diameter_factors: [1.0; 2],
            }
        }

        /// With its odometry mended.
        fn corrected(self, found: &Evaluation) -> Self {
            Self {
                base_mm: found.base_mm,
                diameter_factors: found.diameter_factors,
                ..self
            }
        }

        /// Where it ends when its odometry sees its wheels roll so far.
        fn rolled(self, pose: ArcPose, seen_mm: [f64; 2]) -> ArcPose {
            let [left_mm, right_mm] =
                [0, 1].map(|it| seen_mm[it] / self.diameter_factors[it] * self.true_ways[it]);
            pose.rolled(left_mm, right_mm, self.true_base_mm)
        }

        /// Where a square ends that is right for its odometry.
        fn square(self, direction: Direction) -> Offset {
            let turn_mm = self.base_mm * FRAC_PI_4;
            let corner = match direction {
                Direction::Clockwise => [turn_mm, -turn_mm],
                Direction::CounterClockwise => [-turn_mm, turn_mm],
            };
            let end = (0..4).fold(ArcPose::default(), |pose, _| {
                self.rolled(self.rolled(pose, [SIDE_MM; 2]), corner)
            });
            Offset {
                x_mm: end.x_mm,
                y_mm: end.y_mm,
            }
        }

        fn evaluated(self) -> Evaluation {
            let mut squares = Squares::default();
            for direction in [Direction::Clockwise, Direction::CounterClockwise] {
                squares.add(direction, self.square(direction));
            }
            squares.evaluate(SIDE_MM, self.base_mm).unwrap()
        }
    }

    #[test]
    fn wrong_measures_are_found_and_their_correction_leaves_a_tenth_of_the_error_at_most() {
        for (e_b, e_d) in [
            (1.01, 1.0),
            (0.985, 1.0),
            (1.0, 1.002),
            (1.0, 0.998),
            (1.01, 1.002),
            (0.99, 1.003),
            (1.005, 0.997),
        ] {
            let robot = Robot::built(e_b, e_d);
            let found = robot.evaluated();
            // To first order: right to a tenth of what is wrong.
            assert!((found.e_b - e_b).abs() < 1e-3, "{e_b} {e_d}: {found:?}");
            assert!((found.e_d - e_d).abs() < 1e-4, "{e_b} {e_d}: {found:?}");
            let again = robot.corrected(&found).evaluated();
            assert!(
                again.e_max_syst_mm < 0.1 * found.e_max_syst_mm,
                "{e_b} {e_d}: {} mm, then {} mm",
                found.e_max_syst_mm,
                again.e_max_syst_mm
            );
        }
    }

    #[test]
    fn a_robot_that_is_right_has_nothing_to_correct() {
        let found = Robot::built(1.0, 1.0).evaluated();
        assert!(found.e_max_syst_mm < 1e-9, "{found:?}");
        for factor in [found.e_b, found.e_d, found.base_mm / BASE_MM] {
            assert!((factor - 1.0).abs() < 1e-12, "{found:?}");
        }
        let mut still = Squares::default();
        still.add(Direction::Clockwise, Offset::default());
        still.add(Direction::CounterClockwise, Offset::default());
        assert_eq!(still.evaluate(SIDE_MM, BASE_MM).unwrap().radius_mm, None);
    }

    /// Worked out by hand: α of 0.02 and β of 0.01 on a side of 1 m.
    #[test]
    fn centres_of_gravity_and_angles_are_those_of_the_definition() {
        let table = "direction,x_mm,y_mm\ncw,-50,-70\nCW,-70,-50\n\nccw,-20,20\n";
        let mut squares = Squares::default();
        for line in table.lines() {
            squares.line(line.as_bytes()).unwrap();
        }
        let found = squares.evaluate(1_000.0, 200.0).unwrap();
        assert_eq!(found.runs, [2, 1]);
        let offset = |x_mm, y_mm| Offset { x_mm, y_mm };
        assert_eq!(found.centres, [offset(-60.0, -60.0), offset(-20.0, 20.0)]);
        let base_mm = 200.0 * FRAC_PI_2 / (FRAC_PI_2 - 0.02);
        let radius_mm = 500.0 / libm::sin(0.005);
        let e_d = (radius_mm + base_mm / 2.0) / (radius_mm - base_mm / 2.0);
        for (value, expected) in [
            (found.e_max_syst_mm, 60.0 * libm::sqrt(2.0)),
            (found.alphas_rad[0], 0.02),
            (found.alphas_rad[1], 0.02),
            (found.betas_rad[0], 0.01),
            (found.betas_rad[1], 0.01),
            (found.base_mm, base_mm),
            (found.radius_mm.unwrap(), radius_mm),
            (found.e_d, e_d),
            (found.diameter_factors[1] / found.diameter_factors[0], e_d),
            (found.diameter_factors[0] + found.diameter_factors[1], 2.0),
        ] {
            assert!((value / expected - 1.0).abs() < 1e-12, "{value} {expected}");
        }
    }

    #[test]
    fn what_says_nothing_of_a_robot_is_told() {
        for (table, side_mm, said) in [
            ("", SIDE_MM, "clockwise: 0, counter-clockwise: 0"),
            (
                "cw,1,2\ncw,1,2",
                SIDE_MM,
                "clockwise: 2, counter-clockwise: 0",
            ),
            ("left,1,2", SIDE_MM, "the direction is `left`"),
            ("cw,1", SIDE_MM, "2 columns found, and 3 expected"),
            ("cw,1,far", SIDE_MM, "y_mm is `far`"),
            ("cw,nan,1", SIDE_MM, "x_mm is `nan`"),
            ("cw,1e9,1", SIDE_MM, "x_mm is `1e9`"),
            ("direction,x_mm", SIDE_MM, "no column `y_mm`"),
            ("cw,3000,0\nccw,1,1", SIDE_MM, "3000 mm from their start"),
            ("cw,1,1\nccw,1,1", 300.0, "shorter than the wheel base"),
        ] {
            let mut squares = Squares::default();
            let taken = (table.lines()).try_for_each(|line| squares.line(line.as_bytes()));
            let error = match taken {
                Err(error) => error.to_string(),
                Ok(()) => (squares.evaluate(side_mm, BASE_MM).unwrap_err()).to_string(),
            };
            assert!(error.contains(said), "{table}: {error}");
        }
        for text in ["", "1", "1,x", "1,2,3", "nan,1"] {
            assert!(text.parse::<Offset>().is_err(), "{text}");
        }
        let place = Offset {
            x_mm: -1.5,
            y_mm: 2.0,
        };
        assert_eq!("-1.5, 2".parse(), Ok(place));
    }
}
