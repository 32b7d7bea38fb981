//! Which pin is what: the rover's parts on an STM32F405 in a housing of 64 pins, and what each of
//! its timers does.

use super::pins::{Pin, Port};

const fn pin(port: Port, number: u8) -> Pin {
    Pin { port, number }
}

/// The link, USART 1: TX, RX. 115,200 baud.
pub const LINK: [Pin; 2] = [pin(Port::A, 9), pin(Port::A, 10)];

/// The link of missions, CAN 1: RX, TX of its transceiver.
pub const CAN: [Pin; 2] = [pin(Port::B, 8), pin(Port::B, 9)];

/// Inputs of the motors' bridges, channels 1 to 4 of TIM8: left forwards and backwards, right
/// forwards and backwards.
pub const MOTORS: [Pin; 4] = [
    pin(Port::C, 6),
    pin(Port::C, 7),
    pin(Port::C, 8),
    pin(Port::C, 9),
];

/// Outputs A and B of the left encoder, channels 1 and 2 of TIM3. A is ahead of B where the wheel
/// turns forwards.
pub const LEFT_ENCODER: [Pin; 2] = [pin(Port::A, 6), pin(Port::A, 7)];

/// Outputs A and B of the right encoder, channels 1 and 2 of TIM4.
pub const RIGHT_ENCODER: [Pin; 2] = [pin(Port::B, 6), pin(Port::B, 7)];

/// Triggers of the sonars, counter-clockwise from the one that looks straight ahead.
pub const TRIGGERS: [Pin; 8] = [
    pin(Port::B, 0),
    pin(Port::B, 1),
    pin(Port::B, 5),
    pin(Port::B, 14),
    pin(Port::B, 15),
    pin(Port::B, 10),
    pin(Port::B, 12),
    pin(Port::B, 13),
];

/// Echoes of two neighbours each, behind diodes: channels 1 and 3 of TIM5, 1 and 4 of TIM1.
pub const ECHOES: [Pin; 4] = [
    pin(Port::A, 0),
    pin(Port::A, 2),
    pin(Port::A, 8),
    pin(Port::A, 11),
];

/// The battery, behind a divider by three, and the sensors that look at the floor, left, middle and
/// right: channels 10 to 13 of ADC1.
pub const ANALOG: [Pin; 4] = [
    pin(Port::C, 0),
    pin(Port::C, 1),
    pin(Port::C, 2),
    pin(Port::C, 3),
];

/// The button of the emergency stop, to ground.
pub const STOP_BUTTON: Pin = pin(Port::C, 5);
