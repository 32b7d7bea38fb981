//! The default robot: a round body on two driven wheels, a ring of eight sonars, three sensors that
//! look at the floor, a battery of two lithium cells.
//!
//! [`Rover`] is the registry of its tasks, generic over the HAL objects that a board gives it: see
//! [`RoverParts`]. On boards whose pins are a [`PinImage`](crate::body::PinImage) it is
//! a [`PinRover`]:
//!
//! ```
//! use rt_firmware::{assemble, body::PinImage, nets, rover::{Measures, PinRover, RoverParts}};
//!
//! let pins = PinImage::new();
//! let mut rover = PinRover::new(RoverParts::from(pins.parts()), &Measures::ROVER);
//! let mut banks = rover.banks();
//! let mut nets = nets::<16>();
//! let (_executor, registry) = assemble(&mut banks, &mut nets).expect("the rover's names are unique");
//! assert!(registry.declarations().any(|task| task.name == "Cruise"));
//! ```
//!
//! A robot with further tasks has a registry of its own, made of the same tasks and its own ones:
//! [`split_pins`] leaves it the spare pins, [`RoverParts::into_tasks`] makes the tasks that own the
//! rover's.

mod extras;

use core::array;
use core::f32::consts::TAU;
use core::marker::PhantomData;

use embedded_hal::digital::OutputPin;
use embedded_hal::pwm::SetDutyCycle;

#[cfg(feature = "all-behaviours")]
use crate::behaviours::{
    AlongWall, Approach, Dock, FollowCorridor, FollowObject, PassDoor, Wander,
};
#[cfg(feature = "behaviours")]
use crate::behaviours::{Behaviours, GoTo, Move, TurnTo};
#[cfg(feature = "situations")]
use crate::behaviours::{
    CornerLeft, CornerRight, DoorLeft, DoorRight, LowBattery, Near, OutsideRange, SensorLost, Stuck,
};
#[cfg(feature = "imu")]
use crate::body::ImuBus;
use crate::body::{
    ARRAY_BANKS, AUX_OUTPUTS, AnalogChannel, AuxOutput, DirectionPin, EchoCapture, EncoderCount,
    InPin, LINE_SENSORS, MotorPwm, Parts, SONARS, TriggerPin,
};
use crate::drivers::{
    AnalogIn, BatteryGauge, DcMotor, EchoTimer, EncoderCounter, LineArray, WheelEncoder,
};
use crate::ports::{AnyTaskPool, TaskPool};
use crate::registry;
use crate::registry::put_bank;
#[cfg(feature = "bumpers")]
use crate::tasks::Bumpers;
#[cfg(feature = "behaviours")]
use crate::tasks::GlobalPosition;
#[cfg(feature = "imu")]
use crate::tasks::Gyro;
use crate::tasks::{
    Back, BatteryGuard, BatteryMonitor, Bearing, Chassis, Cruise, FollowWall, LineSensor,
    LinkMonitor, Logger, Odometry, ProximityMonitor, RoundCorner, SonarRing, Stop, Turn,
    WheelSpeed,
};
#[cfg(feature = "position-tasks")]
use crate::tasks::{CorrectPosition, SetPosition};
#[cfg(feature = "all-tasks")]
use crate::tasks::{Count, DriveDistance, FollowLine, LineMonitor, SlotMonitor};
#[cfg(feature = "sonar-array")]
use crate::tasks::{SectorMonitor, SonarArray, Steer};

pub use extras::{ExtraParts, Extras, NoBus, NoExtras, NoPin};

/// What a robot with the rover's parts measures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Measures<const N: usize = SONARS> {
    /// Wheels and motors.
    pub chassis: Chassis,
    /// Battery volts that read as the ADC's full scale.
    pub battery_full_scale_v: f32,
    /// ADC counts over bare floor.
    pub floor_counts: u16,
    /// ADC counts over a dark line.
    pub line_counts: u16,
    /// Where each sonar looks.
    pub sonars: [Bearing; N],
}

impl Measures {
    /// Radius of the rover's wheels, in metres, as they roll: a caliper says 0.033, but a way of
    /// ten metres by the tape is 2 % less than the encoders say with that, for a wheel slips a
    /// little on any floor. The book's chapter on a robot of one's own says how this and the
    /// distance between the wheels are measured.
    pub const WHEEL_RADIUS_M: f32 = 0.0323;

    /// Encoder counts in one turn of the rover's wheels.
    pub const COUNTS_PER_REVOLUTION: f32 = 1_440.0;

    /// Those of the rover that the simulated halls have. The distance between the wheels is what
    /// makes ten turns on the spot ten turns by the encoders. The battery is behind a divider by
    /// three, before a reference of 3.3 V.
    pub const ROVER: Self = Self {
        chassis: Chassis {
            wheel_base_m: 0.2015,
            metres_per_count: TAU * Self::WHEEL_RADIUS_M / Self::COUNTS_PER_REVOLUTION,
            full_speed_m_per_s: 0.68,
            friction_power: 0.05,
        },
        battery_full_scale_v: 9.9,
        floor_counts: 500,
        line_counts: 3_300,
        sonars: Bearing::ALL,
    };
}

/// The HAL objects that the rover's drivers are built on: motors (PWM, direction; high is
/// backwards), encoders, sonars (trigger, echo timer; in the order of [`Measures::sonars`]),
/// battery input, line sensors (left, middle, right).
#[derive(Debug)]
pub struct RoverParts<
    LP,
    LD,
    RP,
    RD,
    LE,
    RE,
    T,
    E,
    A,
    const N: usize = SONARS,
    X: Extras = NoExtras,
> {
    /// PWM of the left motor.
    pub left_pwm: LP,
    /// Direction of the left motor.
    pub left_direction: LD,
    /// PWM of the right motor.
    pub right_pwm: RP,
    /// Direction of the right motor.
    pub right_direction: RD,
    /// Encoder of the left wheel.
    pub left_encoder: LE,
    /// Encoder of the right wheel.
    pub right_encoder: RE,
    /// Triggers of the sonars.
    pub sonar_triggers: [T; N],
    /// Echo timers of the sonars.
    pub echo_timers: [E; N],
    /// The array of sonars, if the robot has one. A firmware without the feature `sonar-array` has
    /// no task for it.
    pub array: Option<ArrayParts<T, E>>,
    /// The battery's analogue input.
    pub battery: A,
    /// The analogue inputs that measure how the floor reflects, from the left to the right.
    pub line_sensors: [A; LINE_SENSORS],
    /// What not every robot has.
    pub extras: ExtraParts<X>,
}

/// The HAL objects of an array of sonars.
#[derive(Debug)]
pub struct ArrayParts<T, E> {
    /// Triggers of its banks.
    pub triggers: [T; ARRAY_BANKS],
    /// Echo timers, each of one sonar of each bank.
    pub echo_timers: [E; SONARS],
}

/// [`RoverParts`] on a [`PinImage`](crate::body::PinImage).
pub type PinRoverParts<'a> = RoverParts<
    MotorPwm<'a>,
    DirectionPin<'a>,
    MotorPwm<'a>,
    DirectionPin<'a>,
    EncoderCount<'a>,
    EncoderCount<'a>,
    TriggerPin<'a>,
    EchoCapture<'a>,
    AnalogChannel<'a>,
    SONARS,
    PinExtras<'a>,
>;

/// The types of a [`PinImage`](crate::body::PinImage)'s pins for parts that not every robot has.
#[derive(Clone, Copy, Debug)]
pub struct PinExtras<'a>(PhantomData<&'a ()>);

impl<'a> Extras for PinExtras<'a> {
    type Bumper = InPin<'a>;
    #[cfg(feature = "imu")]
    type ImuBus = ImuBus<'a>;
    #[cfg(not(feature = "imu"))]
    type ImuBus = NoBus;
}

/// The [`Rover`] on a [`PinImage`](crate::body::PinImage).
pub type PinRover<'a> = Rover<
    MotorPwm<'a>,
    DirectionPin<'a>,
    MotorPwm<'a>,
    DirectionPin<'a>,
    EncoderCount<'a>,
    EncoderCount<'a>,
    TriggerPin<'a>,
    EchoCapture<'a>,
    AnalogChannel<'a>,
    SONARS,
    PinExtras<'a>,
>;

/// The [`RoverPlaces`] on a [`PinImage`](crate::body::PinImage).
pub type PinRoverPlaces<'a> = RoverPlaces<
    MotorPwm<'a>,
    DirectionPin<'a>,
    MotorPwm<'a>,
    DirectionPin<'a>,
    EncoderCount<'a>,
    EncoderCount<'a>,
    TriggerPin<'a>,
    EchoCapture<'a>,
    AnalogChannel<'a>,
    SONARS,
    PinExtras<'a>,
>;

/// The pins of a [`PinImage`](crate::body::PinImage) that the rover leaves to the user's own
/// drivers.
#[derive(Debug)]
pub struct SparePins<'a> {
    /// Analogue inputs 1 to 3; input 0 is the battery, 4 to 6 look at the floor.
    pub analog: [AnalogChannel<'a>; 3],
    /// Digital outputs.
    pub aux_outputs: [AuxOutput<'a>; AUX_OUTPUTS],
}

/// Divides the pins into those that the rover needs and those that it leaves.
pub fn split_pins(parts: Parts<'_>) -> (PinRoverParts<'_>, SparePins<'_>) {
    let [battery, analog_1, analog_2, analog_3, left, middle, right] = parts.analog;
    let rover = RoverParts {
        left_pwm: parts.left_pwm,
        left_direction: parts.left_direction,
        right_pwm: parts.right_pwm,
        right_direction: parts.right_direction,
        left_encoder: parts.left_encoder,
        right_encoder: parts.right_encoder,
        sonar_triggers: parts.sonar_triggers,
        echo_timers: parts.echo_timers,
        #[cfg(feature = "sonar-array")]
        array: Some(ArrayParts {
            triggers: parts.array_triggers,
            echo_timers: parts.array_echo_timers,
        }),
        #[cfg(not(feature = "sonar-array"))]
        array: None,
        battery,
        line_sensors: [left, middle, right],
        extras: ExtraParts {
            #[cfg(feature = "bumpers")]
            bumpers: Some(parts.bumpers),
            #[cfg(not(feature = "bumpers"))]
            bumpers: None,
            #[cfg(feature = "imu")]
            imu: Some(parts.imu),
            #[cfg(not(feature = "imu"))]
            imu: None,
        },
    };
    let spare = SparePins {
        analog: [analog_1, analog_2, analog_3],
        aux_outputs: parts.aux_outputs,
    };
    (rover, spare)
}

impl<'a> From<Parts<'a>> for PinRoverParts<'a> {
    /// Takes what the rover needs and drops the rest; [`split_pins`] keeps it.
    fn from(parts: Parts<'a>) -> Self {
        split_pins(parts).0
    }
}

/// The rover's tasks that own hardware, for registries that have them beside others.
#[derive(Debug)]
pub struct HardwareTasks<
    LP,
    LD,
    RP,
    RD,
    LE,
    RE,
    T,
    E,
    A,
    const N: usize = SONARS,
    X: Extras = NoExtras,
> {
    /// The sonars.
    pub sonar_ring: SonarRing<T, E, N>,
    /// The sonars of the array.
    #[cfg(feature = "sonar-array")]
    pub sonar_array: SonarArray<T, E>,
    /// The encoders.
    pub odometry: Odometry<LE, RE>,
    /// The motors.
    pub wheel_speed: WheelSpeed<LP, LD, RP, RD>,
    /// The battery.
    pub battery_monitor: BatteryMonitor<A>,
    /// The sensors that look at the floor.
    pub line_sensor: LineSensor<A>,
    /// The bumpers.
    #[cfg(feature = "bumpers")]
    pub bumpers: Bumpers<X::Bumper>,
    /// The gyroscope.
    #[cfg(feature = "imu")]
    pub gyro: Gyro<X::ImuBus>,
    /// What it has beside the others.
    pub extras: PhantomData<fn() -> X>,
}

impl<LP, LD, RP, RD, LE, RE, T, E, A, const N: usize, X: Extras>
    RoverParts<LP, LD, RP, RD, LE, RE, T, E, A, N, X>
where
    LP: SetDutyCycle,
    LD: OutputPin,
    RP: SetDutyCycle,
    RD: OutputPin,
    LE: EncoderCounter,
    RE: EncoderCounter,
    T: OutputPin,
    E: EchoTimer,
    A: AnalogIn,
{
    /// Drivers on the parts, and the tasks on the drivers, of a robot with these measures.
    pub fn into_tasks(
        self,
        measures: &Measures<N>,
    ) -> HardwareTasks<LP, LD, RP, RD, LE, RE, T, E, A, N, X> {
        let chassis = measures.chassis;
        HardwareTasks {
            sonar_ring: SonarRing::new(self.sonar_triggers, self.echo_timers, measures.sonars),
            #[cfg(feature = "sonar-array")]
            sonar_array: SonarArray::new(
                self.array.map(|array| (array.triggers, array.echo_timers)),
            ),
            odometry: Odometry::new(
                WheelEncoder::new(self.left_encoder),
                WheelEncoder::new(self.right_encoder),
                chassis,
            ),
            wheel_speed: WheelSpeed::new(
                DcMotor::new(self.left_pwm, self.left_direction),
                DcMotor::new(self.right_pwm, self.right_direction),
                chassis,
            ),
            battery_monitor: BatteryMonitor::new(BatteryGauge::new(
                self.battery,
                measures.battery_full_scale_v,
            )),
            line_sensor: LineSensor::new(LineArray::new(
                self.line_sensors,
                measures.floor_counts,
                measures.line_counts,
            )),
            #[cfg(feature = "bumpers")]
            bumpers: Bumpers::new(self.extras.bumpers),
            #[cfg(feature = "imu")]
            gyro: Gyro::new(self.extras.imu),
            extras: PhantomData,
        }
    }
}

/// All banks, from the tasks that own hardware: as the value of a robot, or each in its place.
macro_rules! banks_of {
    (value, $hardware:ident) => {
        banks_of!(@all [value] $hardware)
    };
    ($places:ident, $hardware:ident) => {
        banks_of!(@all [places $places] $hardware)
    };
    (@all $how:tt $hardware:ident) => {
        banks_of! {
            @as $how
            sonar_ring: TaskPool::new([$hardware.sonar_ring]),
            odometry: TaskPool::new([$hardware.odometry]),
            wheel_speed: TaskPool::new([$hardware.wheel_speed]),
            battery_monitor: TaskPool::new([$hardware.battery_monitor]),
            proximity_monitor: TaskPool::new([ProximityMonitor]),
            cruise: TaskPool::new(array::from_fn(|_| Cruise)),
            back: TaskPool::from_fn(Back::default),
            turn: TaskPool::from_fn(Turn::default),
            #[cfg(feature = "all-tasks")]
            drive_distance: TaskPool::from_fn(DriveDistance::default),
            #[cfg(feature = "all-tasks")]
            count: TaskPool::from_fn(Count::default),
            follow_wall: TaskPool::new([FollowWall]),
            round_corner: TaskPool::new([RoundCorner]),
            stop: TaskPool::new(array::from_fn(|_| Stop)),
            logger: TaskPool::new([Logger]),
            #[cfg(feature = "all-tasks")]
            line_sensor: TaskPool::new([$hardware.line_sensor]),
            #[cfg(feature = "all-tasks")]
            line_monitor: TaskPool::new(array::from_fn(|_| LineMonitor)),
            #[cfg(feature = "all-tasks")]
            follow_line: TaskPool::new(array::from_fn(|_| FollowLine)),
            #[cfg(feature = "all-tasks")]
            slot_monitor: TaskPool::from_fn(SlotMonitor::default),
            link_monitor: TaskPool::from_fn(LinkMonitor::default),
            battery_guard: TaskPool::from_fn(BatteryGuard::default),
            #[cfg(feature = "sonar-array")]
            sonar_array: TaskPool::new([$hardware.sonar_array]),
            #[cfg(feature = "sonar-array")]
            sector_monitor: TaskPool::new([SectorMonitor]),
            #[cfg(feature = "sonar-array")]
            steer: TaskPool::new(array::from_fn(|_| Steer)),
            #[cfg(feature = "bumpers")]
            bumpers: TaskPool::new([$hardware.bumpers]),
            #[cfg(feature = "imu")]
            gyro: TaskPool::new([$hardware.gyro]),
            #[cfg(feature = "behaviours")]
            global_position: TaskPool::from_fn(GlobalPosition::default),
            #[cfg(feature = "position-tasks")]
            set_position: TaskPool::from_fn(SetPosition::default),
            #[cfg(feature = "position-tasks")]
            correct_position: TaskPool::from_fn(CorrectPosition::default),
            #[cfg(feature = "behaviours")]
            behaviours: TaskPool::from_fn(Behaviours::default),
            #[cfg(feature = "behaviours")]
            move_on: TaskPool::from_fn(Move::default),
            #[cfg(feature = "behaviours")]
            turn_to: TaskPool::from_fn(TurnTo::default),
            #[cfg(feature = "behaviours")]
            go_to: TaskPool::from_fn(GoTo::default),
            #[cfg(feature = "all-behaviours")]
            follow_corridor: TaskPool::from_fn(FollowCorridor::default),
            #[cfg(feature = "all-behaviours")]
            pass_door: TaskPool::from_fn(PassDoor::default),
            #[cfg(feature = "all-behaviours")]
            along_wall: TaskPool::from_fn(AlongWall::default),
            #[cfg(feature = "all-behaviours")]
            wander: TaskPool::from_fn(Wander::default),
            #[cfg(feature = "all-behaviours")]
            approach: TaskPool::from_fn(Approach::default),
            #[cfg(feature = "all-behaviours")]
            follow_object: TaskPool::from_fn(FollowObject::default),
            #[cfg(feature = "all-behaviours")]
            dock: TaskPool::from_fn(Dock::default),
            #[cfg(feature = "situations")]
            outside_range: TaskPool::from_fn(OutsideRange::default),
            #[cfg(feature = "situations")]
            stuck: TaskPool::from_fn(Stuck::default),
            #[cfg(feature = "situations")]
            sensor_lost: TaskPool::from_fn(SensorLost::default),
            #[cfg(feature = "situations")]
            low_battery: TaskPool::from_fn(LowBattery::default),
            #[cfg(feature = "situations")]
            near: TaskPool::from_fn(Near::default),
            #[cfg(feature = "situations")]
            door_left: TaskPool::from_fn(DoorLeft::default),
            #[cfg(feature = "situations")]
            door_right: TaskPool::from_fn(DoorRight::default),
            #[cfg(feature = "situations")]
            corner_left: TaskPool::from_fn(CornerLeft::default),
            #[cfg(feature = "situations")]
            corner_right: TaskPool::from_fn(CornerRight::default),
        }
    };
    (@as [value] $($(#[$meta:meta])? $bank:ident: $make:expr,)+) => {
        Self {
            marks: PhantomData,
            $($(#[$meta])? $bank: $make,)+
        }
    };
    (@as [places $places:ident] $($(#[$meta:meta])? $bank:ident: $make:expr,)+) => {
        [$($(#[$meta])? put_bank(&mut $places.$bank, || $make),)+]
    };
}

registry! {
    /// The default robot's tasks, and how many task states of each a mission may have.
    pub struct Rover in RoverPlaces[
        LP: SetDutyCycle + Send, LD: OutputPin + Send, RP: SetDutyCycle + Send, RD: OutputPin + Send,
        LE: EncoderCounter + Send, RE: EncoderCounter + Send, T: OutputPin + Send, E: EchoTimer + Send, A: AnalogIn + Send,
        const N: usize, X: Extras
    ]<LP, LD, RP, RD, LE, RE, T, E, A, N, X> marks X {
        sonar_ring: SonarRing<T, E, N>[1],
        odometry: Odometry<LE, RE>[1],
        wheel_speed: WheelSpeed<LP, LD, RP, RD>[1],
        battery_monitor: BatteryMonitor<A>[1],
        proximity_monitor: ProximityMonitor[1],
        cruise: Cruise[2],
        back: Back[3],
        turn: Turn[4],
        drive_distance: DriveDistance[4] if "all-tasks",
        count: Count[4] if "all-tasks",
        follow_wall: FollowWall[1],
        round_corner: RoundCorner[1],
        stop: Stop[3],
        logger: Logger[1],
        line_sensor: LineSensor<A>[1] if "all-tasks",
        line_monitor: LineMonitor[4] if "all-tasks",
        follow_line: FollowLine[2] if "all-tasks",
        slot_monitor: SlotMonitor[1] if "all-tasks",
        link_monitor: LinkMonitor[1],
        battery_guard: BatteryGuard[1],
        sonar_array: SonarArray<T, E>[1] if "sonar-array",
        sector_monitor: SectorMonitor[1] if "sonar-array",
        steer: Steer[4] if "sonar-array",
        bumpers: Bumpers<X::Bumper>[1] if "bumpers",
        gyro: Gyro<X::ImuBus>[1] if "imu",
        behaviours: Behaviours[1] if "behaviours",
        global_position: GlobalPosition[1] if "behaviours",
        set_position: SetPosition[2] if "position-tasks",
        correct_position: CorrectPosition[2] if "position-tasks",
        move_on: Move[4] if "behaviours",
        turn_to: TurnTo[4] if "behaviours",
        go_to: GoTo[4] if "behaviours",
        follow_corridor: FollowCorridor[2] if "all-behaviours",
        pass_door: PassDoor[2] if "all-behaviours",
        along_wall: AlongWall[2] if "all-behaviours",
        wander: Wander[2] if "all-behaviours",
        approach: Approach[2] if "all-behaviours",
        follow_object: FollowObject[2] if "all-behaviours",
        dock: Dock[1] if "all-behaviours",
        outside_range: OutsideRange[1] if "situations",
        stuck: Stuck[2] if "situations",
        sensor_lost: SensorLost[1] if "situations",
        low_battery: LowBattery[1] if "situations",
        near: Near[2] if "situations",
        door_left: DoorLeft[2] if "situations",
        door_right: DoorRight[2] if "situations",
        corner_left: CornerLeft[1] if "situations",
        corner_right: CornerRight[1] if "situations",
    }
}

impl<LP, LD, RP, RD, LE, RE, T, E, A, const N: usize, X: Extras>
    Rover<LP, LD, RP, RD, LE, RE, T, E, A, N, X>
where
    LP: SetDutyCycle + Send,
    LD: OutputPin + Send,
    RP: SetDutyCycle + Send,
    RD: OutputPin + Send,
    LE: EncoderCounter + Send,
    RE: EncoderCounter + Send,
    T: OutputPin + Send,
    E: EchoTimer + Send,
    A: AnalogIn + Send,
{
    /// The robot on these parts, with these measures.
    pub fn new(
        parts: RoverParts<LP, LD, RP, RD, LE, RE, T, E, A, N, X>,
        measures: &Measures<N>,
    ) -> Self {
        Self::from_tasks(parts.into_tasks(measures))
    }

    /// The robot with these tasks, and those that own no hardware.
    pub fn from_tasks(hardware: HardwareTasks<LP, LD, RP, RD, LE, RE, T, E, A, N, X>) -> Self {
        banks_of!(value, hardware)
    }
}

/// The rover's banks.
pub type Banks<'a> = [&'a mut (dyn AnyTaskPool + 'a); PinRover::POOLS];

impl<LP, LD, RP, RD, LE, RE, T, E, A, const N: usize, X: Extras>
    RoverPlaces<LP, LD, RP, RD, LE, RE, T, E, A, N, X>
where
    LP: SetDutyCycle + Send,
    LD: OutputPin + Send,
    RP: SetDutyCycle + Send,
    RD: OutputPin + Send,
    LE: EncoderCounter + Send,
    RE: EncoderCounter + Send,
    T: OutputPin + Send,
    E: EchoTimer + Send,
    A: AnalogIn + Send,
{
    /// Makes the robot on these parts, with these measures, in its place.
    pub fn fill(
        &mut self,
        parts: RoverParts<LP, LD, RP, RD, LE, RE, T, E, A, N, X>,
        measures: &Measures<N>,
    ) -> Banks<'_> {
        let places = self;
        let hardware = parts.into_tasks(measures);
        banks_of!(places, hardware)
    }
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::string::String;
    use std::vec::Vec;

    use super::*;
    use crate::body::PinImage;
    use crate::{assemble, nets};

    fn declarations() -> Vec<String> {
        let pins = PinImage::new();
        let mut rover = PinRover::new(RoverParts::from(pins.parts()), &Measures::ROVER);
        let mut banks = rover.banks();
        let mut nets = nets::<4>();
        let (_, registry) = assemble(&mut banks, &mut nets).unwrap();
        let source = |index| {
            let mut told = Vec::new();
            let count = registry.capacity(index) as u32;
            let declaration = registry.declaration(index).unwrap();
            declaration.tell_source(count, &mut |piece| told.extend_from_slice(piece));
            String::from_utf8(told).unwrap()
        };
        (0..registry.len()).map(source).collect()
    }

    /// The missions build on this file; it is right as long as it says what the firmware says.
    #[test]
    fn the_shipped_declarations_are_those_of_the_registry() {
        let file = fs::read_to_string("../missions/rover.esm").unwrap();
        let comment = file.lines().take_while(|line| line.starts_with("//"));
        let comment_bytes: usize = comment.map(|line| line.len() + 1).sum();
        let declared = declarations().join("\n");
        let written: String = file.chars().skip(comment_bytes).collect();
        assert_eq!(
            written.trim_start(),
            declared,
            "update missions/rover.esm from `esm tasks`"
        );
    }
}
