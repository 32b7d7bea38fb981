//! How motors and encoders are wired, by what the encoders say of wheels that are driven.
//!
//! Both wheels are driven by a known power, without a controller, in several ways: ahead, and on
//! the spot to both sides. What the left and the right encoder then count is a mixture of what the
//! left and the right motor were to do; least squares find it. Where all is well each encoder
//! follows its own motor. An encoder that follows it backwards, or the other one, or none, is
//! wired wrongly, or its motor is: the two cannot be told apart by encoder and motor alone. So
//! somebody looks which way the wheels really turn ([`Seen`]).

use super::finding::Finding;

/// The time in which a wheel follows what it is asked for, in seconds: gear motors of small robots
/// have between 0.05 and 0.15.
const LAG_S: f64 = 0.1;

/// An encoder that goes at less than this part of what was asked for stands.
const STANDS_PART: f64 = 0.3;

/// How fast a wheel may be against what was asked for, without a controller: a battery that is
/// half empty takes a quarter of it, friction and gears as much again.
const PART_FROM: f64 = 0.5;
const PART_TO: f64 = 1.6;

/// How much of the squares must be there to tell the two motors apart.
const LEAST_INDEPENDENCE: f64 = 0.01;

/// What is at a time: left and right.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WheelSample {
    /// Time in seconds.
    pub t_s: f64,
    /// What the wheels were to do, in metres per second.
    pub asked_m_per_s: [f64; 2],
    /// What the encoders say, in metres per second.
    pub counted_m_per_s: [f64; 2],
}

/// Which way a wheel turned.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Turned {
    /// Forwards.
    Forwards,
    /// Backwards.
    Backwards,
    /// Not at all.
    Not,
}

impl Turned {
    fn sign(self) -> f64 {
        match self {
            Turned::Forwards => 1.0,
            Turned::Backwards => -1.0,
            Turned::Not => 0.0,
        }
    }
}

/// What somebody saw of the wheels, left and right.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Seen {
    /// When both were to turn forwards.
    pub ahead: [Turned; 2],
    /// When the robot was to turn on the spot to the left: the left one backwards, the right one
    /// forwards.
    pub left: [Turned; 2],
}

/// What follows what: the first index is who follows, the second which motor; left and right.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Follows([[f64; 2]; 2]);

impl Follows {
    /// What is followed, from samples in the order of time. None where the wheels were not asked
    /// for enough to tell.
    fn of(samples: &[WheelSample], who: impl Fn(&WheelSample) -> [f64; 2]) -> Option<Self> {
        let mut asked = [0.0; 2];
        let mut last_s = samples.first()?.t_s;
        let (mut squares, mut products) = ([[0.0; 2]; 2], [[0.0; 2]; 2]);
        for sample in samples {
            let part = 1.0 - libm::exp(-(sample.t_s - last_s).max(0.0) / LAG_S);
            last_s = sample.t_s;
            for (asked, goal) in asked.iter_mut().zip(sample.asked_m_per_s) {
                *asked += (goal - *asked) * part;
            }
            let told = who(sample);
            for row in 0..2 {
                for motor in 0..2 {
                    squares[row][motor] += asked[row] * asked[motor];
                    products[row][motor] += told[row] * asked[motor];
                }
            }
        }
        let [[ll, lr], [_, rr]] = squares;
        let determinant = ll * rr - lr * lr;
        if ll <= 0.0 || rr <= 0.0 || determinant < LEAST_INDEPENDENCE * ll * rr {
            return None;
        }
        Some(Follows(products.map(|[l, r]| {
            [
                (l * rr - r * lr) / determinant,
                (r * ll - l * lr) / determinant,
            ]
        })))
    }

    /// By what a person has seen: each wheel's way ahead is the sum of what both motors do to it,
    /// and on the spot to the left the difference.
    fn seen(seen: &Seen) -> Self {
        let mut rows = [[0.0; 2]; 2];
        for (row, (ahead, left)) in rows.iter_mut().zip(seen.ahead.into_iter().zip(seen.left)) {
            let (ahead, left) = (ahead.sign(), left.sign());
            *row = [(ahead - left) / 2.0, (ahead + left) / 2.0];
        }
        Follows(rows)
    }

    /// The same in parts of what follows most: of ways whose unit is another one.
    fn by_its_largest(self) -> Self {
        let largest = self.0.as_flattened().iter().copied();
        let largest = largest.fold(0.0, |most: f64, part| most.max(part.abs()));
        if largest == 0.0 {
            return self;
        }
        Follows(self.0.map(|row| row.map(|part| part / largest)))
    }

    /// The motor that this one follows, left or right, and by how much; none where it stands.
    fn motor(&self, row: usize) -> Option<(usize, f64)> {
        let [left, right] = self.0[row];
        let (motor, part) = if left.abs() >= right.abs() {
            (0, left)
        } else {
            (1, right)
        };
        (part.abs() >= STANDS_PART).then_some((motor, part))
    }
}

const SIDES: [&str; 2] = ["left", "right"];

/// What is found of the wheels, by samples of a drive, and by who has looked at them.
pub fn judge(samples: &[WheelSample], seen: Option<&Seen>) -> Vec<Finding> {
    let Some(counted) = Follows::of(samples, |sample| sample.counted_m_per_s) else {
        let why =
            "the wheels were not driven long enough: run it again, and mind the messages above";
        return NAMES.map(|name| Finding::not_measured(name, why)).to_vec();
    };
    match seen {
        Some(seen) => by_eye(&counted, &Follows::seen(seen)),
        None => unseen(&counted),
    }
}

/// The same where it is known, in place of somebody who looks, how far the wheels had really turned
/// forwards at each sample, in radians.
pub fn judge_known(samples: &[WheelSample], turned_rad: &[[f64; 2]]) -> Vec<Finding> {
    let Some(counted) = Follows::of(samples, |sample| sample.counted_m_per_s) else {
        return judge(samples, None);
    };
    let pairs = samples.windows(2).zip(turned_rad.windows(2));
    let speeds: Vec<WheelSample> = pairs
        .filter_map(|(times, ways)| {
            let ([from, to], [before, behind]) = (times, ways) else {
                return None;
            };
            let passed_s = to.t_s - from.t_s;
            let speed = |side: usize| (behind[side] - before[side]) / passed_s;
            (passed_s > 0.0).then(|| WheelSample {
                counted_m_per_s: [speed(0), speed(1)],
                ..*to
            })
        })
        .collect();
    match Follows::of(&speeds, |sample| sample.counted_m_per_s) {
        Some(turned) => by_eye(&counted, &turned.by_its_largest()),
        None => judge(samples, None),
    }
}

/// Names of what is found of the wheels.
pub const NAMES: [&str; 6] = [
    "motors.sides",
    "motors.left",
    "motors.right",
    "encoders.sides",
    "encoders.left",
    "encoders.right",
];

const ON_ITS_SIDE: &str = "each on its side";
const TURNS: &str = "forwards, when it is to";

fn speed_limit() -> String {
    format!("{PART_FROM} to {PART_TO} of what the wheel was asked for")
}

/// By what the encoders say, and by how the wheels really turned.
fn by_eye(counted: &Follows, turned: &Follows) -> Vec<Finding> {
    let wheels = [0, 1].map(|wheel| turned.motor(wheel));
    // By a wheel that turns; where only one does, the other's plug is where this one's is not.
    let motors_exchanged = (wheels.iter().enumerate())
        .any(|(wheel, motor)| motor.is_some_and(|(motor, _)| motor != wheel));
    // What the encoder of each wheel says, by the wheel's own way, and at which plug.
    let encoders = [0, 1].map(|wheel| {
        let (motor, way) = wheels[wheel]?;
        let told = [0, 1].map(|plug| counted.0[plug][motor] * way.signum());
        let plug = usize::from(told[1].abs() > told[0].abs());
        Some((told[plug].abs() >= STANDS_PART).then_some((plug, told[plug])))
    });
    let encoders_exchanged = (encoders.iter().enumerate())
        .any(|(wheel, told)| matches!(told, Some(Some((plug, _))) if *plug != wheel));
    let mut findings = vec![sides(
        NAMES[0],
        !motors_exchanged,
        "left and right motor are exchanged: swap their plugs",
    )];
    for (wheel, motor) in wheels.iter().enumerate() {
        let (name, side) = (NAMES[1 + wheel], SIDES[wheel]);
        findings.push(match motor {
            None => Finding::failed(
                name,
                TURNS,
                format!(
                    "the {side} wheel does not turn: look at its motor's plug, its driver and the driver's supply"
                ),
            ),
            Some((_, way)) => Finding::judged(
                name,
                (way.signum(), ""),
                TURNS,
                *way > 0.0,
                format!("the {side} motor turns backwards: swap its two wires"),
            ),
        });
    }
    findings.push(sides(
        NAMES[3],
        !encoders_exchanged,
        "left and right encoder are exchanged: swap their plugs",
    ));
    for (wheel, told) in encoders.iter().enumerate() {
        let (name, side) = (NAMES[4 + wheel], SIDES[wheel]);
        findings.push(match told {
            None => Finding::not_measured(
                name,
                format!("the {side} wheel does not turn: get its motor to turn first"),
            ),
            Some(None) => dead_encoder(name, side),
            Some(Some((_, part))) if *part < 0.0 => Finding::judged(
                name,
                (*part, ""),
                speed_limit(),
                false,
                format!("the {side} encoder counts backwards: swap A and B"),
            ),
            Some(Some((_, part))) => speed(name, side, *part),
        });
    }
    findings
}

/// By what the encoders say alone: what is wrong may be the motor or the encoder.
fn unseen(counted: &Follows) -> Vec<Finding> {
    let nobody = "nobody looked which way the wheels turn: run it at a terminal, and answer";
    let plugs = [0, 1].map(|plug| counted.motor(plug));
    let crossed = (plugs.iter().enumerate())
        .any(|(plug, motor)| motor.is_some_and(|(motor, _)| motor != plug));
    let motor_rows = NAMES[..3].iter();
    let mut findings: Vec<Finding> = motor_rows
        .map(|name| Finding::not_measured(*name, nobody))
        .collect();
    findings.push(sides(
        NAMES[3],
        !crossed,
        "left and right are exchanged: swap the motors' plugs if the wrong wheel turns, or else the encoders'",
    ));
    for (plug, motor) in plugs.iter().enumerate() {
        let (name, side) = (NAMES[4 + plug], SIDES[plug]);
        findings.push(match motor {
            None => Finding::failed(
                name,
                speed_limit(),
                format!(
                    "the {side} encoder counts nothing: if the wheel turns, look at the encoder's plug and supply, or else at the motor's"
                ),
            ),
            Some((_, part)) if *part < 0.0 => Finding::judged(
                name,
                (*part, ""),
                speed_limit(),
                false,
                format!(
                    "the {side} encoder counts against its motor: swap A and B if the wheel turns as it is to, or else the motor's two wires"
                ),
            ),
            Some((_, part)) => speed(name, side, *part),
        });
    }
    findings
}

fn sides(name: &'static str, good: bool, advice: &str) -> Finding {
    Finding::judged(
        name,
        (f64::from(u8::from(good)), ""),
        ON_ITS_SIDE,
        good,
        advice,
    )
}

fn dead_encoder(name: &'static str, side: &str) -> Finding {
    Finding::judged(
        name,
        (0.0, ""),
        speed_limit(),
        false,
        format!("the {side} encoder counts nothing: look at its plug, its supply, A and B"),
    )
}

fn speed(name: &'static str, side: &str, part: f64) -> Finding {
    Finding::judged(
        name,
        (part, ""),
        speed_limit(),
        (PART_FROM..=PART_TO).contains(&part),
        format!(
            "the {side} wheel is not as fast as the robot's file says: charge the battery, compare the file's counts and full speed, `esm tune`"
        ),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Samples of a drive ahead and on the spot, of a robot whose encoders follow its motors so.
    fn driven(counted: [[f64; 2]; 2]) -> Vec<WheelSample> {
        let mut samples = Vec::new();
        let mut speeds = [0.0; 2];
        for index in 0..400 {
            let asked_m_per_s = match index / 50 {
                0 | 2 => [0.25, 0.25],
                4 => [-0.2, 0.2],
                6 => [0.2, -0.2],
                _ => [0.0; 2],
            };
            for (speed, asked) in speeds.iter_mut().zip(asked_m_per_s) {
                *speed += (asked - *speed) * 0.15;
            }
            samples.push(WheelSample {
                t_s: f64::from(index) * 0.02,
                asked_m_per_s,
                counted_m_per_s: counted.map(|[l, r]| l * speeds[0] + r * speeds[1]),
            });
        }
        samples
    }

    fn failed(findings: &[Finding]) -> Vec<&str> {
        let bad = findings.iter().filter(|it| it.pass == Some(false));
        bad.map(|it| it.name.as_str()).collect()
    }

    use Turned::{Backwards as B, Forwards as F, Not as N};

    #[test]
    fn whoever_looks_tells_motors_and_encoders_apart() {
        let good = [[1.0, 0.0], [0.0, 0.96]];
        // What the encoders follow, what is seen ahead and to the left, and what is wrong.
        for (counted, ahead, left, wrong) in [
            (good, [F, F], [B, F], &[][..]),
            (
                [[-1.0, 0.0], [0.0, 1.0]],
                [F, F],
                [B, F],
                &["encoders.left"],
            ),
            ([[-1.0, 0.0], [0.0, 1.0]], [B, F], [F, F], &["motors.left"]),
            (
                [[0.0, 1.0], [1.0, 0.0]],
                [F, F],
                [B, F],
                &["encoders.sides"],
            ),
            ([[0.0, 1.0], [1.0, 0.0]], [F, F], [F, B], &["motors.sides"]),
            (good, [F, F], [F, B], &["motors.sides", "encoders.sides"]),
            ([[0.0, 0.0], [0.0, 1.0]], [F, F], [B, F], &["encoders.left"]),
            ([[0.0, 0.0], [0.0, 1.0]], [N, F], [N, F], &["motors.left"]),
            // The left wheel's encoder is dead, and the right one's is at its plug.
            (
                [[0.0, 1.0], [0.0, 0.0]],
                [F, F],
                [B, F],
                &["encoders.sides", "encoders.left"],
            ),
            // Exchanged motors, and that of the left wheel turns backwards.
            (
                [[0.0, -1.0], [1.0, 0.0]],
                [B, F],
                [B, B],
                &["motors.sides", "motors.left"],
            ),
            ([[0.3, 0.0], [0.0, 1.0]], [F, F], [B, F], &["encoders.left"]),
        ] {
            let findings = judge(&driven(counted), Some(&Seen { ahead, left }));
            assert_eq!(failed(&findings), wrong, "{counted:?} {ahead:?} {left:?}");
            let names: Vec<&str> = findings.iter().map(|it| it.name.as_str()).collect();
            assert_eq!(names, NAMES);
        }
    }

    #[test]
    fn where_nobody_looks_the_advice_names_both_causes() {
        let findings = judge(&driven([[-1.0, 0.0], [0.0, 1.0]]), None);
        assert_eq!(failed(&findings), ["encoders.left"]);
        let advice = findings[4].advice.as_deref().unwrap_or_default();
        assert!(
            advice.contains("swap A and B") && advice.contains("two wires"),
            "{advice}"
        );
        assert_eq!(findings[0].pass, None);
        let findings = judge(&driven([[0.0, 1.0], [1.0, 0.0]]), None);
        assert_eq!(failed(&findings), ["encoders.sides"]);
    }

    #[test]
    fn real_speeds_stand_for_eyes() {
        let samples = driven([[-1.0, 0.0], [0.0, 1.0]]);
        let turned_rad = |follows: [f64; 2]| -> Vec<[f64; 2]> {
            let mut way = [0.0; 2];
            let ways = samples.iter().map(|sample| {
                for side in 0..2 {
                    way[side] += sample.counted_m_per_s[side] * follows[side] * 0.02 / 0.03;
                }
                way
            });
            ways.collect()
        };
        // The wheels turn as the encoders say: it is the motor.
        let findings = judge_known(&samples, &turned_rad([1.0, 1.0]));
        assert_eq!(failed(&findings), ["motors.left"]);
        let findings = judge_known(&samples, &turned_rad([-1.0, 1.0]));
        assert_eq!(failed(&findings), ["encoders.left"]);
        let findings = judge_known(&samples, &turned_rad([0.0, 1.0]));
        assert_eq!(failed(&findings), ["motors.left"]);
    }

    #[test]
    fn wheels_that_were_not_driven_are_not_judged() {
        let still: Vec<WheelSample> = (driven([[1.0, 0.0], [0.0, 1.0]]).into_iter())
            .map(|sample| WheelSample {
                asked_m_per_s: [0.0; 2],
                ..sample
            })
            .collect();
        let findings = judge(&still, None);
        assert!(findings.iter().all(|it| it.pass.is_none()));
        assert_eq!(findings.len(), NAMES.len());
        assert!(judge(&[], None).iter().all(|it| it.pass.is_none()));
    }
}
