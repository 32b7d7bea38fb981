//! Sonars, battery and gyroscope of a robot that stands.

use rt_firmware::tasks::Ranges;

use super::finding::Finding;

/// What is nearer than this to a sonar, each time, is its own burst, in metres: the task that pings
/// them takes it so, too.
const NOSE_M: f64 = 0.05;

/// How old a range of a sonar that answers may be, in seconds: three of its turns.
const OLDEST_S: f64 = 0.3;

/// A gyroscope that stands reads no more than this, in radians per second: its bias is taken off by
/// then.
const STANDING_RAD_PER_S: f64 = 0.05;

/// What is below this is no battery, in volts: the board itself would not run.
const NO_BATTERY_V: f64 = 1.0;

/// What a robot's sonars say at a time.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SonarSample {
    /// Ranges in metres, 0 where one is not known.
    pub range_m: Vec<f64>,
    /// How old they are, in seconds.
    pub age_s: Vec<f64>,
    /// A bit for each sonar that does not answer.
    pub dead: u32,
}

/// What is found of the sonars, one by one.
pub fn sonars(samples: &[SonarSample]) -> Vec<Finding> {
    let count = samples.iter().map(|it| it.range_m.len()).max().unwrap_or(0);
    let mut findings = Vec::new();
    for sonar in 0..count {
        let is_dead = (samples.last()).is_some_and(|it| it.dead >> sonar & 1 != 0);
        let of_it = || {
            samples
                .iter()
                .filter_map(|it| it.range_m.get(sonar).copied())
        };
        let mut ranges: Vec<f64> = of_it().filter(|range_m| *range_m > 0.0).collect();
        ranges.sort_by(f64::total_cmp);
        let (nearest, farthest) = (ranges.first(), ranges.last());
        let median = ranges.get(ranges.len() / 2).copied();
        let name = format!("sonars.{sonar}");
        let limit = format!("an echo from {NOSE_M} m to {} m", Ranges::FAR_M);
        findings.push(match (nearest, farthest, median) {
            _ if is_dead => Finding::failed(
                name,
                limit,
                format!(
                    "sonar {sonar} does not answer: look at its plug, its supply, trigger and echo"
                ),
            ),
            (Some(_), Some(farthest), Some(median)) if *farthest < NOSE_M => Finding::judged(
                name,
                (median, "m"),
                limit,
                false,
                format!(
                    "sonar {sonar} is stuck: it hears something at its nose, always; take away what is there, or else replace the sonar"
                ),
            ),
            (Some(nearest), _, Some(_)) if *nearest >= f64::from(Ranges::FAR_M) => {
                Finding::not_measured(
                    name,
                    format!(
                        "sonar {sonar} answers and hears nothing: put something before it, within a metre"
                    ),
                )
            }
            (_, _, Some(median)) => Finding::judged(name, (median, "m"), limit, true, ""),
            // A place without a sonar.
            _ => continue,
        });
    }
    if findings.is_empty() {
        return vec![Finding::not_measured(
            "sonars",
            "no range came from the robot: try again",
        )];
    }
    let oldest_s = samples.last().map_or(0.0, |last| {
        let ages = last.age_s.iter().zip(&last.range_m).enumerate();
        ages.filter(|(sonar, (_, range_m))| last.dead >> sonar & 1 == 0 && **range_m > 0.0)
            .map(|(_, (age_s, _))| *age_s)
            .fold(0.0, f64::max)
    });
    findings.push(Finding::judged(
        "sonars.age",
        (oldest_s, "s"),
        format!("at most {OLDEST_S} s"),
        oldest_s <= OLDEST_S,
        "a sonar answers now and then: look at its plug and its supply",
    ));
    findings
}

/// What is found of the battery, by its voltages; `low_v` is what the robot takes for low.
pub fn battery(voltages: &[f64], low_v: f64) -> Finding {
    const NAME: &str = "battery";
    let Some(voltage_v) = voltages.last().copied() else {
        return Finding::not_measured(NAME, "no voltage came from the robot: try again");
    };
    let limit = format!("at least {low_v} V");
    let advice = if voltage_v < NO_BATTERY_V {
        "the battery's input reads nothing: look at the divider and its wire"
    } else {
        "charge the battery; if it is full, compare the divider with the robot's file"
    };
    Finding::judged(NAME, (voltage_v, "V"), limit, voltage_v >= low_v, advice)
}

/// What is found of the gyroscope of a robot that stands, by its rates in radians per second.
pub fn gyroscope(rates: &[f64]) -> Finding {
    const NAME: &str = "gyroscope";
    let limit = format!("at most {STANDING_RAD_PER_S} rad/s while the robot stands");
    // One that works is never quite still.
    let changes = rates.iter().any(|rate| Some(rate) != rates.first());
    if !changes {
        return Finding::failed(
            NAME,
            limit,
            "the gyroscope does not answer, or its reading never changes: look at SDA, SCL and its supply, and let the robot stand",
        );
    }
    let mean = rates.iter().sum::<f64>() / rates.len() as f64;
    Finding::judged(
        NAME,
        (mean, "rad/s"),
        limit,
        mean.abs() <= STANDING_RAD_PER_S,
        "let the robot stand, and run it again; if it stood, replace the gyroscope",
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample(range_m: &[f64], dead: u32) -> SonarSample {
        SonarSample {
            range_m: range_m.to_vec(),
            age_s: vec![0.08; range_m.len()],
            dead,
        }
    }

    fn passes(findings: &[Finding]) -> Vec<(&str, Option<bool>)> {
        let pairs = findings.iter().map(|it| (it.name.as_str(), it.pass));
        pairs.collect()
    }

    #[test]
    fn sonars_are_dead_stuck_without_anything_before_them_or_good() {
        let far_m = f64::from(Ranges::FAR_M);
        let samples = [
            sample(&[0.0, 0.03, far_m, 0.5, 0.03, 0.0], 0),
            sample(&[0.0, 0.031, far_m, 0.51, 0.7, 0.0], 0b1),
        ];
        let findings = sonars(&samples);
        assert_eq!(
            passes(&findings),
            [
                ("sonars.0", Some(false)),
                ("sonars.1", Some(false)),
                ("sonars.2", None),
                ("sonars.3", Some(true)),
                ("sonars.4", Some(true)),
                ("sonars.age", Some(true)),
            ]
        );
        let advice = |index: usize| findings[index].advice.clone().unwrap();
        assert!(advice(0).contains("does not answer"));
        assert!(advice(1).contains("is stuck"));
        assert_eq!(passes(&sonars(&[])), [("sonars", None)]);
    }

    #[test]
    fn a_range_that_is_old_is_told_unless_its_sonar_is_dead() {
        let mut old = sample(&[0.5, 0.5], 0);
        old.age_s[1] = 0.9;
        assert_eq!(sonars(&[old.clone()])[2].pass, Some(false));
        old.dead = 0b10;
        assert_eq!(sonars(&[old])[2].pass, Some(true));
    }

    #[test]
    fn a_battery_is_good_low_or_not_there() {
        for (voltages, pass, said) in [
            (&[7.9, 8.0][..], Some(true), ""),
            (&[8.0, 6.3], Some(false), "charge"),
            (&[0.01], Some(false), "divider"),
            (&[], None, "no voltage"),
        ] {
            let finding = battery(voltages, 6.6);
            assert_eq!(finding.pass, pass, "{voltages:?}");
            assert!(
                finding.advice.unwrap_or_default().contains(said),
                "{voltages:?}"
            );
        }
    }

    #[test]
    fn a_gyroscope_stands_drifts_or_is_silent() {
        assert_eq!(gyroscope(&[0.01, -0.01]).pass, Some(true));
        assert_eq!(gyroscope(&[0.2, 0.21]).pass, Some(false));
        assert_eq!(gyroscope(&[0.0, 0.0]).pass, Some(false));
        assert_eq!(gyroscope(&[]).pass, Some(false));
    }
}
