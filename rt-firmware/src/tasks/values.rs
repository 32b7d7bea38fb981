//! What travels over the nets between the shipped tasks, and the robot's measures that several of
//! them need.

use core::ops::RangeInclusive;

use crate::body::LINE_SENSORS;
use crate::show::{Field, Show, put_first, take_first};
use crate::task::PortType;

pub use crate::odometry::Pose;

impl PortType for Pose {
    const NAME: &'static str = "Pose";
    const INIT: Self = Self::START;

    fields! { x_m: f32, y_m: f32, heading_rad: f32 }
}

/// How the robot shall move.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Twist {
    /// Speed of the robot's centre in metres per second; positive is forwards.
    pub forward_m_per_s: f32,
    /// Turning speed in radians per second; positive is to the left.
    pub turn_rad_per_s: f32,
}

impl Twist {
    /// No movement.
    pub const STILL: Self = Self {
        forward_m_per_s: 0.0,
        turn_rad_per_s: 0.0,
    };
}

impl PortType for Twist {
    const NAME: &'static str = "Twist";
    const INIT: Self = Self::STILL;

    fields! { forward_m_per_s: f32, turn_rad_per_s: f32 }
}

/// How fast the wheels roll, as the encoders tell.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct WheelSpeeds {
    /// Left wheel, in metres per second.
    pub left_m_per_s: f32,
    /// Right wheel, in metres per second.
    pub right_m_per_s: f32,
}

impl PortType for WheelSpeeds {
    const NAME: &'static str = "WheelSpeeds";
    const INIT: Self = Self {
        left_m_per_s: 0.0,
        right_m_per_s: 0.0,
    };

    fields! { left_m_per_s: f32, right_m_per_s: f32 }
}

/// What the wheels are to do, and what their motors get for it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct WheelControl {
    /// How fast the left wheel is to roll now, in metres per second.
    pub left_set_m_per_s: f32,
    /// How fast the right wheel is to roll now, in metres per second.
    pub right_set_m_per_s: f32,
    /// Power of the left motor, in parts of full power, -1 to 1.
    pub left_power: f32,
    /// Power of the right motor.
    pub right_power: f32,
}

impl PortType for WheelControl {
    const NAME: &'static str = "WheelControl";
    const INIT: Self = Self {
        left_set_m_per_s: 0.0,
        right_set_m_per_s: 0.0,
        left_power: 0.0,
        right_power: 0.0,
    };

    fields! { left_set_m_per_s: f32, right_set_m_per_s: f32, left_power: f32, right_power: f32 }
}

/// Where a sonar looks, in steps of an eighth of a turn, counter-clockwise from straight ahead.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Bearing {
    /// Straight ahead.
    Ahead,
    /// 45° to the left.
    AheadLeft,
    /// To the left.
    Left,
    /// 135° to the left.
    BehindLeft,
    /// Straight behind.
    Behind,
    /// 135° to the right.
    BehindRight,
    /// To the right.
    Right,
    /// 45° to the right.
    AheadRight,
}

impl Bearing {
    /// Eighths in a turn.
    pub const COUNT: usize = 8;

    /// All of them, counter-clockwise from straight ahead.
    pub const ALL: [Self; Self::COUNT] = [
        Self::Ahead,
        Self::AheadLeft,
        Self::Left,
        Self::BehindLeft,
        Self::Behind,
        Self::BehindRight,
        Self::Right,
        Self::AheadRight,
    ];

    /// The bearing on the other side.
    #[must_use]
    pub const fn reversed(self) -> Self {
        use Bearing::{Ahead, AheadLeft, AheadRight, Behind, BehindLeft, BehindRight, Left, Right};
        match self {
            Ahead => Behind,
            AheadLeft => BehindRight,
            Left => Right,
            BehindLeft => AheadRight,
            Behind => Ahead,
            BehindRight => AheadLeft,
            Right => Left,
            AheadRight => BehindLeft,
        }
    }

    /// How many eighths of a turn lie between the two, on the shorter side.
    pub const fn eighths_to(self, other: Self) -> u8 {
        let way = (self as u8).abs_diff(other as u8);
        let round = Self::COUNT as u8 - way;
        if way < round { way } else { round }
    }
}

/// A quarter of what is around the robot, and the diagonals at its ends, which it shares with its
/// neighbours.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sector {
    /// Ahead.
    Front,
    /// Behind.
    Back,
    /// To the left.
    Left,
    /// To the right.
    Right,
}

impl Sector {
    /// The bearings in it.
    const fn bearings(self) -> Bearings {
        use Bearing::{Ahead, AheadLeft, AheadRight, Behind, BehindLeft, BehindRight, Left, Right};
        match self {
            Self::Front => Bearings::of(&[AheadRight, Ahead, AheadLeft]),
            Self::Left => Bearings::of(&[AheadLeft, Left, BehindLeft]),
            Self::Back => Bearings::of(&[BehindLeft, Behind, BehindRight]),
            Self::Right => Bearings::of(&[BehindRight, Right, AheadRight]),
        }
    }
}

/// Some bearings: a bit for each.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Bearings(u8);

impl Bearings {
    /// None.
    pub const NONE: Self = Self(0);

    /// Those to which a robot looks that drives ahead: the front, with the diagonals.
    pub const FRONT: Self = Sector::Front.bearings();

    /// Those that are listed.
    pub const fn of(bearings: &[Bearing]) -> Self {
        let mut bits = 0;
        let mut rest = bearings;
        while let [bearing, tail @ ..] = rest {
            bits |= 1 << *bearing as u8;
            rest = tail;
        }
        Self(bits)
    }

    /// Those to which a robot looks that moves at this speed: none where it only turns.
    pub fn on_the_way(forward_m_per_s: f32) -> Self {
        if forward_m_per_s > 0.0 {
            Self::FRONT
        } else if forward_m_per_s < 0.0 {
            Self::FRONT.reversed()
        } else {
            Self::NONE
        }
    }

    /// Whether a bearing is among them.
    pub const fn has(self, bearing: Bearing) -> bool {
        self.0 >> bearing as u8 & 1 != 0
    }

    /// Those of both.
    #[must_use]
    pub const fn with(self, others: Self) -> Self {
        Self(self.0 | others.0)
    }

    /// Those that are not among others.
    #[must_use]
    pub const fn without(self, others: Self) -> Self {
        Self(self.0 & !others.0)
    }

    /// The same bearings, seen by who looks back.
    #[must_use]
    pub const fn reversed(self) -> Self {
        Self(self.0.rotate_left(Bearing::COUNT as u32 / 2))
    }

    /// How many there are.
    pub const fn count(self) -> u32 {
        self.0.count_ones()
    }
}

/// What one sonar says.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reading {
    /// Where it looks.
    pub bearing: Bearing,
    /// Free way in metres; none if it is not known.
    pub range_m: Option<f32>,
    /// Time since the ping that this range is from, in milliseconds; [`Ranges::NEVER_MS`] if there
    /// was none.
    pub age_ms: u16,
    /// It answers no ping.
    pub dead: bool,
    /// It answers, but hears nothing where other sonars do, or something at its nose where they
    /// hear none.
    pub deaf: bool,
}

/// Whether a range is known, which is a number above 0. Such numbers have the order of their bits.
const fn is_known(range_m: f32) -> bool {
    matches!(range_m.to_bits(), 1..=INFINITY_BITS)
}
const INFINITY_BITS: u32 = f32::INFINITY.to_bits();

/// Free way around the robot, from its rim, as each of its sonars sees it.
///
/// A range that is not known is 0 here: who reads a number and forgets to ask whether it is known
/// takes what is unknown for a wall. [`Ranges::FAR_M`] is only where a sonar said that nothing is
/// in its range.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ranges {
    /// How many sonars the robot has. What stands behind that many in the rows means nothing.
    pub sonars: u8,
    /// Range of each sonar in metres; 0 where it is not known.
    pub range_m: [f32; MAX_SONARS],
    /// Age of each range in milliseconds, from its ping on; [`Ranges::NEVER_MS`] where there is
    /// none.
    pub age_ms: [u16; MAX_SONARS],
    /// Bit *i* is set while sonar *i* answers no ping.
    pub dead: u8,
    /// Bit *i* is set while sonar *i* answers, but hears nothing where other sonars do, or
    /// something at its nose where they hear none.
    pub deaf: u8,
    /// Where each sonar looks. It never changes while a robot runs, so it is not shown among the
    /// values.
    pub bearings: [Bearing; MAX_SONARS],
}

/// The most sonars that a robot may have: as many as bits in [`Ranges::dead`].
pub const MAX_SONARS: usize = 8;

impl Ranges {
    /// The farthest that a sonar hears, in metres. It is the range where one said that nothing is
    /// in it.
    pub const FAR_M: f32 = 4.0;

    /// Age of a range that was never measured.
    pub const NEVER_MS: u16 = u16::MAX;

    /// The range where the robot touches something: none, but one that is known.
    pub const TOUCHED_M: f32 = 0.001;

    /// Nothing is known, for there is no sonar.
    pub const NONE: Self = Self {
        sonars: 0,
        range_m: [0.0; MAX_SONARS],
        age_ms: [Self::NEVER_MS; MAX_SONARS],
        dead: 0,
        deaf: 0,
        bearings: Bearing::ALL,
    };

    /// What eight sonars see, one to each side, where nothing is in range of any.
    pub const FREE: Self = Self {
        sonars: MAX_SONARS as u8,
        range_m: [Self::FAR_M; MAX_SONARS],
        age_ms: [0; MAX_SONARS],
        ..Self::NONE
    };

    /// Age of a range that was never measured, in [`ages_cs`](Self::ages_cs).
    pub const NEVER_CS: u8 = u8::MAX;

    /// Age of each range in hundredths of a second, one below [`NEVER_CS`](Self::NEVER_CS) at most
    /// where there is one.
    pub fn ages_cs(&self) -> [u8; MAX_SONARS] {
        const MS_PER_CS: u16 = 10;
        self.age_ms.map(|age_ms| match age_ms {
            Self::NEVER_MS => Self::NEVER_CS,
            age_ms => (age_ms / MS_PER_CS).min(u16::from(Self::NEVER_CS) - 1) as u8,
        })
    }

    /// What each sonar says.
    pub fn readings(&self) -> impl Iterator<Item = Reading> {
        let rows = (self.bearings.iter()).zip(&self.range_m).zip(&self.age_ms);
        (rows.enumerate().take(self.sonars.into())).map(|(sonar, ((bearing, range_m), age_ms))| {
            Reading {
                bearing: *bearing,
                range_m: is_known(*range_m).then_some(*range_m),
                age_ms: *age_ms,
                dead: self.dead >> sonar & 1 != 0,
                deaf: self.deaf >> sonar & 1 != 0,
            }
        })
    }

    /// Where the robot can look: in bearings of sonars that answer, and hear, unless another one
    /// that looks there does not.
    pub fn live(&self) -> Bearings {
        let (mut live, mut lost) = (Bearings::NONE, Bearings::NONE);
        let sonars = usize::from(self.sonars);
        for (sonar, bearing) in self.bearings.iter().enumerate().take(sonars) {
            let of = if (self.dead | self.deaf) >> sonar & 1 != 0 {
                &mut lost
            } else {
                &mut live
            };
            *of = of.with(Bearings::of(&[*bearing]));
        }
        live.without(lost)
    }

    /// The same ranges, seen by who looks back.
    #[must_use]
    pub fn reversed(&self) -> Self {
        Self {
            bearings: self.bearings.map(Bearing::reversed),
            ..*self
        }
    }

    /// The shortest of the ranges of the sonars that look there, 0 where one of them is not known;
    /// none where no sonar looks there.
    fn towards_m(&self, bearings: Bearings) -> Option<f32> {
        let sonars = usize::from(self.sonars);
        // Ranges are not negative, and so have the order of their bits: a comparison of those takes
        // a core without a floating-point unit one instruction, not twenty.
        let mut least = None;
        for (looks, range_m) in self.bearings.iter().zip(&self.range_m).take(sonars) {
            if bearings.has(*looks) {
                let bits = range_m.to_bits();
                least = Some(least.map_or(bits, |least: u32| least.min(bits)));
            }
        }
        least.map(f32::from_bits)
    }

    /// Whether all sonars that look straight on see more than so many metres, of which there must
    /// be one, and those that look to its sides more than theirs. Neither is negative.
    pub(crate) fn is_free(&self, straight: (Bearings, f32), sides: (Bearings, f32)) -> bool {
        let [straight_bits, side_bits] = [straight.1, sides.1].map(f32::to_bits);
        let mut is_seen = false;
        let sonars = usize::from(self.sonars);
        for (looks, range_m) in self.bearings.iter().zip(&self.range_m).take(sonars) {
            // By their bits, as above.
            let bits = range_m.to_bits();
            if straight.0.has(*looks) {
                if bits <= straight_bits {
                    return false;
                }
                is_seen = true;
            } else if sides.0.has(*looks) && bits <= side_bits {
                return false;
            }
        }
        is_seen
    }

    /// Free way there, as far as it is known: 0 where a sonar that looks there does not know, and
    /// where none looks there.
    pub fn free_m(&self, bearing: Bearing) -> f32 {
        self.seen_m(bearing).unwrap_or(0.0)
    }

    /// The range in a direction, 0 if it is not known; none where no sonar looks there.
    pub(crate) fn seen_m(&self, bearing: Bearing) -> Option<f32> {
        self.towards_m(Bearings::of(&[bearing]))
    }

    /// As [`free_m`](Self::free_m), but far where no sonar looks there: for directions in which a
    /// robot can do without one. A sonar that is there and does not know is still no free way.
    pub fn free_unless_seen_m(&self, bearing: Bearing) -> f32 {
        self.seen_m(bearing).unwrap_or(Self::FAR_M)
    }

    /// Free way in a sector: the least range of the sonars that look there. 0 where one of them
    /// does not know, and where none looks there: what is unknown is never far.
    pub fn free_range(&self, sector: Sector) -> f32 {
        self.towards_m(sector.bearings()).unwrap_or(0.0)
    }

    /// The robot touches something there: for the sonars that look there it is at their noses.
    pub fn touch(&mut self, bearing: Bearing) {
        let rows = self.bearings.iter().zip(&mut self.range_m);
        for ((looks, range_m), age_ms) in rows.zip(&mut self.age_ms) {
            if *looks == bearing {
                (*range_m, *age_ms) = (Self::TOUCHED_M, 0);
            }
        }
    }

    /// Straight ahead, in metres; 0 if it is not known.
    pub fn ahead_m(&self) -> f32 {
        self.free_m(Bearing::Ahead)
    }

    /// 45° to the left, in metres; 0 if it is not known.
    pub fn ahead_left_m(&self) -> f32 {
        self.free_m(Bearing::AheadLeft)
    }

    /// To the left, in metres; 0 if it is not known.
    pub fn left_m(&self) -> f32 {
        self.free_m(Bearing::Left)
    }

    /// Straight behind, in metres; 0 if it is not known.
    pub fn behind_m(&self) -> f32 {
        self.free_m(Bearing::Behind)
    }

    /// To the right, in metres; 0 if it is not known.
    pub fn right_m(&self) -> f32 {
        self.free_m(Bearing::Right)
    }

    /// 45° to the right, in metres; 0 if it is not known.
    pub fn ahead_right_m(&self) -> f32 {
        self.free_m(Bearing::AheadRight)
    }

    /// The nearest of all, in metres; 0 if one of them is not known, and for a robot without
    /// sonars.
    pub fn nearest_m(&self) -> f32 {
        let ranges_m = self.range_m.into_iter().take(self.sonars.into());
        ranges_m.reduce(f32::min).unwrap_or(0.0)
    }
}

impl PortType for Ranges {
    const NAME: &'static str = "Ranges";
    const INIT: Self = Self::NONE;

    const FIELDS: &'static str = "range_m:[f32;8]\nage_cs:[u8;8]\ndead:u8\ndeaf:u8\n";

    // Ages in hundredths of a second: four in a word, with which all values of a mission fit into
    // one sample.
    fn show(&self, show: &mut Show<'_>) {
        self.range_m.show(show);
        self.ages_cs().show(show);
        self.dead.show(show);
        self.deaf.show(show);
    }

    // What is shown, too. Whoever reads it takes its sonars to be those of which something is
    // known, in the order of the bearings.
    const PAYLOAD_BYTES: usize = <[f32; MAX_SONARS]>::BYTES + <[u8; MAX_SONARS]>::BYTES + 2;

    fn put(&self, payload: &mut [u8]) {
        let behind = put_first(&self.range_m, payload);
        // Where there is no sonar, nobody is to see one.
        let mut ages_cs = self.ages_cs();
        for age_cs in ages_cs.iter_mut().skip(self.sonars.into()) {
            *age_cs = Self::NEVER_CS;
        }
        let behind = put_first(&ages_cs, behind);
        put_first(&self.deaf, put_first(&self.dead, behind));
    }

    fn take(&mut self, payload: &[u8]) {
        const MS_PER_CS: u16 = 10;
        let mut ages_cs = [Self::NEVER_CS; MAX_SONARS];
        let behind = take_first(&mut self.range_m, payload);
        let behind = take_first(&mut ages_cs, behind);
        take_first(&mut self.deaf, take_first(&mut self.dead, behind));
        self.age_ms = ages_cs.map(|age_cs| match age_cs {
            Self::NEVER_CS => Self::NEVER_MS,
            age_cs => u16::from(age_cs) * MS_PER_CS,
        });
        let is_there = |sonar: &usize| {
            let answers = (self.dead | self.deaf) >> sonar & 1 != 0;
            answers
                || ages_cs
                    .get(*sonar)
                    .is_some_and(|age_cs| *age_cs != Self::NEVER_CS)
        };
        let last = (0..MAX_SONARS).rev().find(is_there);
        self.sonars = last.map_or(0, |last| last as u8 + 1);
    }
}

/// How many sonars an array has.
pub const ARRAY_SONARS: usize = 24;

/// Free way around a robot with an array of sonars.
///
/// In whole millimetres, far below what a sonar is wrong by, so that a limit written in decimals is
/// the same number for who compares with it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ArrayRanges {
    /// Range of each sonar in millimetres; 0 where it is not known.
    pub range_mm: [u16; ARRAY_SONARS],
}

impl ArrayRanges {
    /// Nothing is known.
    pub const NONE: Self = Self {
        range_mm: [0; ARRAY_SONARS],
    };

    /// [`Ranges::FAR_M`] in millimetres: the range where nothing is in reach.
    pub const FAR_MM: u16 = (Ranges::FAR_M * 1e3) as u16;

    /// A range as it stands here: at least a millimetre, so that what is at a sonar's nose is
    /// known.
    pub fn millimetres(range_m: f32) -> u16 {
        ((range_m * 1e3 + 0.5) as u16).max(1)
    }

    /// The least range of a sector of sonars, counted from 1, in millimetres; 0 where one of them
    /// is not known, and where there is no such sector.
    pub fn least_mm(&self, sector: RangeInclusive<u32>) -> u32 {
        let (first, last) = (*sector.start() as usize, *sector.end() as usize);
        let rows = first
            .checked_sub(1)
            .and_then(|start| self.range_mm.get(start..last));
        let least_mm = rows.and_then(|rows| rows.iter().min());
        least_mm.copied().unwrap_or(0).into()
    }
}

impl PortType for ArrayRanges {
    const NAME: &'static str = "ArrayRanges";
    const INIT: Self = Self::NONE;

    fields! { range_mm: [u16; 24] }
}

/// How fast the robot turns, as a gyroscope measures it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct YawRate {
    /// Counter-clockwise, in radians per second.
    pub yaw_rate_rad_per_s: f32,
    /// Counts the measurements; wraps. Where it stays, nobody measures any more.
    pub count: u8,
}

impl PortType for YawRate {
    const NAME: &'static str = "YawRate";
    const INIT: Self = Self {
        yaw_rate_rad_per_s: 0.0,
        count: 0,
    };

    fields! { yaw_rate_rad_per_s: f32, count: u8 }
}

/// What the robot touches with its bumpers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Contact {
    /// Something on the left of its front.
    pub left: bool,
    /// Something on the right of its front.
    pub right: bool,
}

impl PortType for Contact {
    const NAME: &'static str = "Contact";
    const INIT: Self = Self {
        left: false,
        right: false,
    };

    fields! { left: bool, right: bool }
}

/// State of the battery.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Battery {
    /// Voltage under the present load, smoothed, in volts.
    pub voltage_v: f32,
}

impl PortType for Battery {
    const NAME: &'static str = "Battery";
    const INIT: Self = Self { voltage_v: 0.0 };

    fields! { voltage_v: f32 }
}

/// A dark line on the floor, as the sensors ahead of the wheels see it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Line {
    /// How far to the left of the middle sensor the line is, in micrometres. As long as no sensor
    /// sees it: the distance of the outermost sensor on the side where it went out of sight.
    pub left_um: i16,
    /// How many sensors see it.
    pub dark_sensors: u8,
}

impl Line {
    /// Whether a sensor sees it.
    pub const fn is_seen(&self) -> bool {
        self.dark_sensors > 0
    }

    /// Whether it goes across: all sensors see it, which are wider apart than a line is.
    pub const fn is_crossing(&self) -> bool {
        self.dark_sensors as usize == LINE_SENSORS
    }
}

impl PortType for Line {
    const NAME: &'static str = "Line";
    const INIT: Self = Self {
        left_um: 0,
        dark_sensors: 0,
    };

    fields! { left_um: i16, dark_sensors: u8 }
}

/// The measures of a robot with two driven wheels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Chassis {
    /// Distance between the wheels, in metres.
    pub wheel_base_m: f32,
    /// Way of a wheel's rim for one encoder count, in metres.
    pub metres_per_count: f32,
    /// Speed of a wheel at full power and a fresh battery, in metres per second.
    pub full_speed_m_per_s: f32,
    /// Share of full power that friction takes before a wheel turns at all.
    pub friction_power: f32,
}

#[cfg(test)]
mod tests {
    use std::vec::Vec;

    use super::*;

    /// The law that all who read ranges stand on.
    #[test]
    fn what_is_not_known_is_never_far() {
        for (sonar, bearing) in Bearing::ALL.into_iter().enumerate() {
            let mut ranges = Ranges::FREE;
            ranges.range_m[sonar] = 0.0;
            assert_eq!(ranges.free_m(bearing), 0.0, "{bearing:?}");
            assert_eq!(ranges.free_unless_seen_m(bearing), 0.0, "{bearing:?}");
            assert_eq!(ranges.nearest_m(), 0.0, "{bearing:?}");
            let unknown: Vec<Bearing> = (ranges.readings())
                .filter(|reading| reading.range_m.is_none())
                .map(|reading| reading.bearing)
                .collect();
            assert_eq!(unknown, [bearing]);
            // A second sonar that looks there too and sees nothing changes nothing.
            ranges.bearings[(sonar + 1) % MAX_SONARS] = bearing;
            assert_eq!(ranges.free_m(bearing), 0.0, "{bearing:?}");
        }
        assert_eq!(Ranges::NONE.nearest_m(), 0.0);
        assert_eq!(Ranges::NONE.ahead_m(), 0.0);
    }

    #[test]
    fn ages_are_shown_in_hundredths_of_a_second() {
        let mut ranges = Ranges::FREE;
        ranges.age_ms = [0, 9, 10, 80, 2_549, 60_000, Ranges::NEVER_MS, 255];
        assert_eq!(
            ranges.ages_cs(),
            [0, 0, 1, 8, 254, 254, Ranges::NEVER_CS, 25]
        );
    }

    #[test]
    fn a_robot_has_as_many_readings_as_sonars() {
        let mut ranges = Ranges {
            sonars: 2,
            ..Ranges::FREE
        };
        ranges.bearings[1] = Bearing::Behind;
        ranges.range_m[1] = 0.5;
        let seen: Vec<(Bearing, Option<f32>)> = (ranges.readings())
            .map(|reading| (reading.bearing, reading.range_m))
            .collect();
        let expected = [(Bearing::Ahead, Some(4.0)), (Bearing::Behind, Some(0.5))];
        assert_eq!(seen, expected);
        assert_eq!((ranges.nearest_m(), ranges.behind_m()), (0.5, 0.5));
        // Nobody looks to the left: who needs it gets none, who can do without it is not kept from
        // driving.
        assert_eq!(ranges.left_m(), 0.0);
        assert_eq!(ranges.free_unless_seen_m(Bearing::Left), Ranges::FAR_M);
    }

    #[test]
    fn bearings_are_as_far_apart_as_on_the_shorter_side() {
        for (from, to, eighths) in [
            (Bearing::Ahead, Bearing::Ahead, 0),
            (Bearing::Ahead, Bearing::AheadRight, 1),
            (Bearing::AheadRight, Bearing::AheadLeft, 2),
            (Bearing::Left, Bearing::Right, 4),
            (Bearing::BehindRight, Bearing::Left, 3),
        ] {
            assert_eq!(from.eighths_to(to), eighths, "{from:?} {to:?}");
            assert_eq!(to.eighths_to(from), eighths, "{from:?} {to:?}");
        }
    }
}
