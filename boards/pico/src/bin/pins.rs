//! The drivers of the board without a runtime, for tests at its pins: what comes over UART 0 is a
//! letter and its bytes, little endian, and each is answered.
//!
//! | letter | bytes | does | answers |
//! |---|---|---|---|
//! | `d` | left and right duty, -6250 to 6250, 2 + 2 | drives the motors | `d` |
//! | `c` | | | counts of the encoders, 2 + 2 |
//! | `p` | sonar, 1 | triggers the sonar | `p` |
//! | `w` | sonar, 1 | | 0 no echo, 1 high, 2 over; and how long in µs: 1 + 2 |
//! | `a` | | | counts of battery and the line sensors, 4 × 2 |
//! | `o` | | takes the motors' power, as a firmware that ends | `o` |
#![no_std]
#![no_main]

use core::mem::MaybeUninit;

use cortex_m_board::line::Wire;
use cortex_m_rt::entry;
use embedded_hal::digital::OutputPin;
use embedded_hal::pwm::SetDutyCycle;
use pico::rp2040_hal::usb::UsbBus;
use pico::rp2040_hal::vector_table::VectorTable;
use pico::uart::Uart0;
use pico::usb_device::bus::UsbBusAllocator;
use pico::{motors, rt_firmware};
use rt_firmware::drivers::{AnalogIn, EchoPulse, EchoTimer, EncoderCounter};

/// What is at which pin: the shipped rover's.
#[allow(dead_code, reason = "the drivers alone are tested")]
mod robot {
    include!(concat!(env!("OUT_DIR"), "/robot.rs"));
}

/// The next byte.
fn byte(uart: &mut Uart0) -> u8 {
    loop {
        if let Some(byte) = uart.receive() {
            return byte;
        }
    }
}

fn number(uart: &mut Uart0) -> i16 {
    i16::from_le_bytes([byte(uart), byte(uart)])
}

fn answer(uart: &mut Uart0, bytes: &[u8]) {
    for &byte in bytes {
        while !uart.can_send() {}
        uart.send(byte);
    }
}

fn drive(
    power: &mut impl SetDutyCycle<Error = core::convert::Infallible>,
    direction: &mut impl OutputPin<Error = core::convert::Infallible>,
    duty: i16,
) {
    let Ok(()) = power.set_duty_cycle_fully_off();
    let Ok(()) = direction.set_state((duty < 0).into());
    let Ok(()) = power.set_duty_cycle(duty.unsigned_abs());
}

#[entry]
fn main() -> ! {
    static mut VECTORS: VectorTable = VectorTable::new();
    static mut USB_BUS: MaybeUninit<UsbBusAllocator<UsbBus>> = MaybeUninit::uninit();
    let parts = pico::start(VECTORS, USB_BUS, &robot::WIRING).parts;
    let (mut robot, mut uart) = (parts.robot.rover, parts.uart);
    loop {
        match byte(&mut uart) {
            b'd' => {
                let (left, right) = (number(&mut uart), number(&mut uart));
                drive(&mut robot.left_pwm, &mut robot.left_direction, left);
                drive(&mut robot.right_pwm, &mut robot.right_direction, right);
                answer(&mut uart, b"d");
            }
            b'c' => {
                let (left, right) = (robot.left_encoder.count(), robot.right_encoder.count());
                answer(&mut uart, &left.to_le_bytes());
                answer(&mut uart, &right.to_le_bytes());
            }
            b'p' => {
                let sonar = usize::from(byte(&mut uart));
                if let Some(trigger) = robot.sonar_triggers.get_mut(sonar) {
                    let Ok(()) = trigger.set_high();
                    let Ok(()) = trigger.set_low();
                }
                answer(&mut uart, b"p");
            }
            b'w' => {
                let sonar = usize::from(byte(&mut uart));
                let echo = robot.echo_timers.get_mut(sonar);
                let (state, us) = match echo.map_or(EchoPulse::None, EchoTimer::pulse) {
                    EchoPulse::None => (0, 0),
                    EchoPulse::High { us } => (1, us),
                    EchoPulse::Over { us } => (2, us),
                };
                answer(&mut uart, &[state]);
                answer(&mut uart, &us.to_le_bytes());
            }
            b'a' => {
                answer(&mut uart, &robot.battery.counts().to_le_bytes());
                for sensor in &mut robot.line_sensors {
                    answer(&mut uart, &sensor.counts().to_le_bytes());
                }
            }
            b'o' => {
                motors::all_off();
                answer(&mut uart, b"o");
            }
            _ => {}
        }
    }
}
