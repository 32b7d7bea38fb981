//! The drivers of the board without a runtime, for tests at its pins: what comes over UART 0 is a
//! letter and its bytes, little endian, and each is answered.
//!
//! | letter | bytes | does | answers |
//! |---|---|---|---|
//! | `d` | left and right duty, -6250 to 6250, 2 + 2 | drives the motors | `d` |
//! | `c` | | | counts of the encoders, 2 + 2 |
//! | `p` | sonar, 1 | triggers the sonar | `p`; `n` where it cannot |
//! | `w` | sonar, 1 | | 0 no echo, 1 high, 2 over; and how long in µs: 1 + 2 |
//! | `a` | | | counts of battery and the line sensors, 4 × 2 |
//! | `g` | | wakes the gyroscope (feature `imu`) | 0 done, 1 the bus failed, 2 another chip; and how long it took in µs: 1 + 2 |
//! | `y` | | (the same) | 0 or 1 as above, its counts, and how long it took in µs: 1 + 2 + 2 |
//! | `o` | | takes the motors' power, as a firmware that ends | `o` |
#![no_std]
#![no_main]

use cortex_m_board::line::Wire;
use cortex_m_rt::entry;
use embedded_hal::digital::OutputPin;
use embedded_hal::pwm::SetDutyCycle;
use pico::uart::Uart;
use pico::{motors, rt_firmware};
use rt_firmware::drivers::{AnalogIn, EchoPulse, EchoTimer, EncoderCounter};
#[cfg(feature = "imu")]
use rt_firmware::drivers::{GyroError, YawGyro};

/// What is at which pin: the shipped rover's.
#[allow(dead_code, reason = "the drivers alone are tested")]
mod robot {
    include!(concat!(env!("OUT_DIR"), "/robot.rs"));
}

/// The next byte.
fn byte(uart: &mut Uart) -> u8 {
    loop {
        if let Some(byte) = uart.receive() {
            return byte;
        }
    }
}

fn number(uart: &mut Uart) -> i16 {
    i16::from_le_bytes([byte(uart), byte(uart)])
}

fn answer(uart: &mut Uart, bytes: &[u8]) {
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

/// What comes of it, and how long it took, in microseconds.
#[cfg(feature = "imu")]
fn timed<T>(act: impl FnOnce() -> T) -> (T, u16) {
    let began = pico::clock::count();
    let done = act();
    (done, pico::clock::count().wrapping_sub(began) as u16)
}

#[cfg(feature = "imu")]
fn told(error: Option<GyroError>) -> u8 {
    match error {
        None => 0,
        Some(GyroError::Bus) => 1,
        Some(GyroError::OtherChip { .. }) => 2,
    }
}

#[entry]
fn main() -> ! {
    let mut robot = pico::start(&robot::WIRING).parts.rover;
    let mut uart = Uart;
    #[cfg(feature = "imu")]
    let mut gyro = robot.extras.imu.map(YawGyro::new);
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
                let trigger = robot.sonar_triggers.get_mut(sonar);
                let sent = trigger.is_some_and(|it| it.set_high().and(it.set_low()).is_ok());
                answer(&mut uart, if sent { b"p" } else { b"n" });
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
            #[cfg(feature = "imu")]
            b'g' => {
                let (woken, us) = timed(|| gyro.as_mut().map(YawGyro::wake));
                answer(&mut uart, &[told(woken.and_then(Result::err))]);
                answer(&mut uart, &us.to_le_bytes());
            }
            #[cfg(feature = "imu")]
            b'y' => {
                let (counts, us) = timed(|| gyro.as_mut().map(YawGyro::counts));
                answer(&mut uart, &[told(counts.and_then(Result::err))]);
                let counts = counts.and_then(Result::ok).unwrap_or_default();
                answer(&mut uart, &counts.to_le_bytes());
                answer(&mut uart, &us.to_le_bytes());
            }
            b'o' => {
                motors::all_off();
                answer(&mut uart, b"o");
            }
            _ => {}
        }
    }
}
