//! Speeds that change smoothly: with bounds on acceleration and on jerk.

/// How fast a speed may change, for one length of step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RampLimits {
    /// The most that the speed changes in a step: the acceleration, times the step.
    most_change: f32,
    /// The most by which that changes from step to step: the jerk, times the step's square.
    most_bend: f32,
}

impl RampLimits {
    /// For these bounds, in m/s² and m/s³, and a step in seconds.
    pub fn new(acceleration_per_s2: f32, jerk_per_s3: f32, step_s: f32) -> Self {
        let most_change = acceleration_per_s2 * step_s;
        Self {
            most_change,
            // With more than that the acceleration is there at once, and nothing bends.
            most_bend: (jerk_per_s3 * step_s * step_s).min(most_change),
        }
    }
}

/// A speed on its way to a goal: it neither speeds up nor bends faster than [`RampLimits`] allow,
/// and comes to its goal without going beyond it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Ramp {
    speed: f32,
    /// By how much it changed in the last step.
    change: f32,
}

impl Ramp {
    /// The speed now.
    pub fn speed(&self) -> f32 {
        self.speed
    }

    /// It stands from now on, whatever it was.
    pub fn stop(&mut self) {
        *self = Self::default();
    }

    /// One step towards `goal`; towards 0 if that is no number. Returns the speed.
    pub fn step(&mut self, goal: f32, limits: &RampLimits) -> f32 {
        let RampLimits {
            most_change,
            most_bend,
        } = *limits;
        // Who asks for what is no number gets nothing.
        let goal = if goal.is_finite() { goal } else { 0.0 };
        let left = goal - self.speed;
        let towards = 1.0_f32.copysign(left);
        let (left, change) = (left.abs(), self.change * towards);
        if left <= most_bend && change.abs() <= most_bend {
            *self = Self {
                speed: goal,
                change: 0.0,
            };
            return goal;
        }
        // A change of c, then of c - b, c - 2b and so on to 0 are c (c + b) / 2b together.
        let fits =
            |change: f32| change <= 0.0 || change * (change + most_bend) <= 2.0 * most_bend * left;
        let faster = (change + most_bend).min(most_change);
        let next = if fits(faster) {
            faster
        } else if fits(change) {
            change
        } else {
            change - most_bend
        };
        self.change = next * towards;
        self.speed += self.change;
        self.speed
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STEP_S: f32 = 0.01;

    /// Speeds, step by step, towards each goal for as many steps as are said.
    fn speeds(limits: &RampLimits, goals: &[(f32, usize)]) -> std::vec::Vec<f32> {
        let mut ramp = Ramp::default();
        let steps = goals
            .iter()
            .flat_map(|(goal, steps)| core::iter::repeat_n(*goal, *steps));
        steps.map(|goal| ramp.step(goal, limits)).collect()
    }

    #[test]
    fn neither_acceleration_nor_jerk_is_more_than_allowed() {
        for (acceleration, jerk) in [(1.2, 12.0), (1.2, 1.0), (0.5, 200.0), (5.0, 30.0)] {
            let limits = RampLimits::new(acceleration, jerk, STEP_S);
            let goals = [
                (0.3, 400),
                (-0.2, 7),
                (0.6, 31),
                (0.61, 3),
                (0.0, 20),
                (0.001, 50),
                (-0.5, 400),
                (0.0, 400),
            ];
            let speeds = speeds(&limits, &goals);
            let mut before = (0.0, 0.0);
            for speed in speeds {
                let change = speed - before.0;
                let bend = change - before.1;
                assert!(change.abs() <= acceleration * STEP_S * 1.001, "{change}");
                // The last step to a goal is what is left.
                let most = (jerk * STEP_S * STEP_S).min(acceleration * STEP_S);
                assert!(bend.abs() <= most * 2.001, "{bend} {most}");
                before = (speed, change);
            }
            assert_eq!(before.0, 0.0);
        }
    }

    #[test]
    fn what_is_no_number_is_none() {
        let limits = RampLimits::new(1.2, 12.0, STEP_S);
        for goal in [f32::NAN, f32::INFINITY, -f32::INFINITY] {
            let speeds = speeds(&limits, &[(0.3, 100), (goal, 100)]);
            assert_eq!(speeds.last(), Some(&0.0));
        }
    }

    #[test]
    fn a_goal_is_reached_in_the_time_that_the_bounds_allow_and_not_passed() {
        // v/a + a/j, where there is time to reach the acceleration; else 2 √(v/j).
        for (goal, acceleration, jerk, least_s) in [
            (0.3_f32, 1.2, 12.0, 0.25 + 0.1),
            (-0.6, 1.2, 12.0, 0.5 + 0.1),
            (0.02, 1.2, 12.0, 0.0816),
            (0.3, 1.2, 1e6, 0.25),
        ] {
            let limits = RampLimits::new(acceleration, jerk, STEP_S);
            let speeds = speeds(&limits, &[(goal, 500)]);
            let most = speeds
                .iter()
                .fold(0.0_f32, |most, speed| most.max(speed.abs()));
            assert!(most <= goal.abs() + limits.most_bend / 4.0, "{most}");
            let at_goal = speeds.iter().position(|speed| *speed == goal);
            let time_s = (at_goal.expect("there") + 1) as f32 * STEP_S;
            assert!(
                (least_s - STEP_S..least_s + 5.0 * STEP_S).contains(&time_s),
                "{goal}: {time_s} s"
            );
        }
    }
}
