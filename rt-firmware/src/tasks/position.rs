//! What travels over nets about the global position.

use crate::odometry::{Frame, Pose};
use crate::task::PortType;
use esm_link::position::Correction;

/// What becomes of a correction: the field `state` of a [`GlobalPose`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(u8)]
pub enum CorrectionState {
    /// There is none.
    #[default]
    None = 0,
    /// Nobody has looked at it.
    Asked = 1,
    /// The global pose is as it says.
    Applied = 2,
    /// It is no number, or beyond its [bounds](esm_link::position): nothing has changed.
    Refused = 3,
}

/// Where the robot is in the global frame, what that frame's owner was told of it last, and what
/// became of that.
///
/// As the list of behaviours it is one value on a net, which the task `GlobalPosition` makes and
/// keeps, and who asks for a correction changes; the next one waits until the task has looked at
/// it. The pose may jump, so no path leads from it to a `pose`: a task that goes by one would jump,
/// too.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct GlobalPose {
    /// Where it is, in metres.
    pub x_m: f32,
    /// Where it is, in metres.
    pub y_m: f32,
    /// Which way it looks, counter-clockwise from the x-axis, in radians, -π to π.
    pub heading_rad: f32,
    /// Counts corrections; wraps.
    pub number: u16,
    /// What became of the last one: a [`CorrectionState`].
    pub state: u8,
    /// What became of the one before.
    pub before: u8,
    /// It says how far the robot is from where it was believed to be, seen from there; otherwise
    /// where it is.
    pub is_difference: bool,
    /// What it says, in metres.
    pub by_x_m: f32,
    /// What it says, in metres.
    pub by_y_m: f32,
    /// What it says, counter-clockwise, in radians.
    pub by_heading_rad: f32,
}

impl GlobalPose {
    /// At the origin, and never corrected.
    pub const START: Self = Self {
        x_m: 0.0,
        y_m: 0.0,
        heading_rad: 0.0,
        number: 0,
        state: CorrectionState::None as u8,
        before: CorrectionState::None as u8,
        is_difference: false,
        by_x_m: 0.0,
        by_y_m: 0.0,
        by_heading_rad: 0.0,
    };

    /// The robot is there.
    pub const fn is_at(&mut self, pose: Pose) {
        (self.x_m, self.y_m, self.heading_rad) = (pose.x_m, pose.y_m, pose.heading_rad);
    }

    /// The correction that is asked for, as long as nobody has looked at it.
    pub const fn asked(&self) -> Option<(Correction, Frame)> {
        if self.state != CorrectionState::Asked as u8 {
            return None;
        }
        let by = Frame {
            x_m: self.by_x_m,
            y_m: self.by_y_m,
            heading_rad: self.by_heading_rad,
        };
        let correction = if self.is_difference {
            Correction::Difference
        } else {
            Correction::Set
        };
        Some((correction, by))
    }

    /// Asks for a correction, behind the one before. Answers its number; none as long as another
    /// one waits.
    pub const fn ask(&mut self, correction: Correction, by: Frame) -> Option<u16> {
        if self.state == CorrectionState::Asked as u8 {
            return None;
        }
        *self = Self {
            number: self.number.wrapping_add(1),
            state: CorrectionState::Asked as u8,
            before: self.state,
            is_difference: matches!(correction, Correction::Difference),
            by_x_m: by.x_m,
            by_y_m: by.y_m,
            by_heading_rad: by.heading_rad,
            ..*self
        };
        Some(self.number)
    }

    /// What became of the correction of this number; none where it waits still, or where two others
    /// have followed it.
    pub fn state_of(&self, number: u16) -> Option<CorrectionState> {
        let state = match self.number.wrapping_sub(number) {
            0 => self.state,
            1 => self.before,
            _ => return None,
        };
        [CorrectionState::Applied, CorrectionState::Refused]
            .into_iter()
            .find(|known| *known as u8 == state)
    }
}

impl PortType for GlobalPose {
    const NAME: &'static str = "GlobalPose";
    const INIT: Self = Self::START;

    fields! {
        x_m: f32, y_m: f32, heading_rad: f32, number: u16, state: u8, before: u8,
        is_difference: bool, by_x_m: f32, by_y_m: f32, by_heading_rad: f32,
    }
}

/// Who has not looked at a correction for so long looks at none, in microseconds: ten periods of
/// the slot.
const WAIT_US: u32 = 100_000;

/// Why a correction did not come about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NotCorrected {
    /// It is no number, or beyond its bounds.
    Refused,
    /// Nobody has looked at it for 0.1 s.
    NobodyLooks,
}

/// A correction that somebody asks for, until somebody has looked at it.
#[derive(Clone, Copy, Debug)]
pub struct Asking {
    correction: Correction,
    by: Frame,
    /// Its number, once it is on the net.
    number: Option<u16>,
    waits_us: u32,
}

impl Asking {
    /// Asks for this from the next step on.
    pub const fn new(correction: Correction, by: Frame) -> Self {
        Self {
            correction,
            by,
            number: None,
            waits_us: 0,
        }
    }

    /// Asks, or looks what became of it, a period after the last step. None as long as it waits.
    pub fn step(
        &mut self,
        net: Option<&mut GlobalPose>,
        period_us: u32,
    ) -> Option<Result<(), NotCorrected>> {
        if let Some(net) = net {
            match self.number {
                None => self.number = net.ask(self.correction, self.by),
                Some(number) => match net.state_of(number) {
                    Some(CorrectionState::Applied) => return Some(Ok(())),
                    Some(_) => return Some(Err(NotCorrected::Refused)),
                    None => {}
                },
            }
        }
        self.waits_us = self.waits_us.saturating_add(period_us);
        (self.waits_us > WAIT_US).then_some(Err(NotCorrected::NobodyLooks))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BY: Frame = Frame {
        x_m: 0.5,
        y_m: 0.0,
        heading_rad: 0.0,
    };

    #[test]
    fn two_who_ask_at_the_same_time_take_turns_and_both_are_told_what_became_of_it() {
        let mut net = GlobalPose::START;
        let mut one = Asking::new(Correction::Difference, BY);
        let mut other = Asking::new(Correction::Set, BY);
        assert_eq!(one.step(Some(&mut net), 10_000), None);
        assert_eq!(other.step(Some(&mut net), 10_000), None);
        assert_eq!(net.asked(), Some((Correction::Difference, BY)));
        // It is looked at; the other one is before the first in the slot.
        net.state = CorrectionState::Applied as u8;
        assert_eq!(other.step(Some(&mut net), 10_000), None);
        assert_eq!(net.asked(), Some((Correction::Set, BY)));
        assert_eq!(one.step(Some(&mut net), 10_000), Some(Ok(())));
        net.state = CorrectionState::Refused as u8;
        let refused = Some(Err(NotCorrected::Refused));
        assert_eq!(other.step(Some(&mut net), 10_000), refused);
    }

    #[test]
    fn who_is_not_looked_at_gives_up() {
        for mut net in [None, Some(GlobalPose::START)] {
            let mut asking = Asking::new(Correction::Set, BY);
            let steps = (1..100).find_map(|step| {
                let ended = asking.step(net.as_mut(), 10_000)?;
                Some((step, ended))
            });
            assert_eq!(steps, Some((11, Err(NotCorrected::NobodyLooks))));
        }
    }
}
