//! The rover's parts at the chip's pins ([`wiring`]).

use rt_firmware::body::SONARS;
use rt_firmware::rover::{ExtraParts, NoExtras, Rover, RoverParts};

use super::analog::{self, Input};
use super::encoders::{self, Counter};
use super::motors::{self, Direction, Power};
use super::pins::{self, Function, Pin};
use super::sonars::{self, Echo, Trigger};
use super::wiring;

/// The rover's parts on this board.
pub type BoardRoverParts =
    RoverParts<Power, Direction, Power, Direction, Counter, Counter, Trigger, Echo, Input>;

/// The rover on this board.
pub type BoardRover = Rover<
    Power,
    Direction,
    Power,
    Direction,
    Counter,
    Counter,
    Trigger,
    Echo,
    Input,
    SONARS,
    NoExtras,
>;

/// Connects the link's pins.
pub(crate) fn connect_usart() {
    // High is silence, also where nothing is plugged in.
    const USART_1: Function = Function::PulledUpPart(7);
    pins::start_ports();
    (wiring::LINK.into_iter()).for_each(|pin| pin.set_function(USART_1));
}

/// Starts all that is at the pins, but for the link; gives the emergency stop's button, which is
/// low while it is pressed, and the rover's parts. To be called once, with interrupts off.
pub(crate) fn start() -> (Pin, BoardRoverParts) {
    pins::start_ports();
    let [(left_pwm, left_direction), (right_pwm, right_direction)] = motors::start();
    let [left_encoder, right_encoder] = encoders::start();
    let (sonar_triggers, echo_timers) = sonars::start();
    let [battery, line_sensors @ ..] = analog::start();
    wiring::STOP_BUTTON.set_function(Function::PulledUp);
    let rover = RoverParts {
        left_pwm,
        left_direction,
        right_pwm,
        right_direction,
        left_encoder,
        right_encoder,
        sonar_triggers,
        echo_timers,
        array: None,
        battery,
        line_sensors,
        extras: ExtraParts::NONE,
    };
    (wiring::STOP_BUTTON, rover)
}
