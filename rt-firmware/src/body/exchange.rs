//! The messages between a board and the plant, and the board's side of their exchange.
//!
//! One exchange opens each slot activation. The board sends what its pins drive and the plant
//! answers with what they measure at the activation's nominal start, so the slot's tasks see the
//! plant as it was then, whatever the board's own jitter.
//!
//! Both messages have a fixed size; numbers are little endian, in the order of the fields:
//!
//! | request | bytes | | reply | bytes |
//! |---|---|---|---|---|
//! | sequence | 4 | | sequence of the request | 4 |
//! | nominal start of this activation, plant time in µs | 8 | | left, right encoder count | 2 + 2 |
//! | nominal end of the activation before, in µs | 8 | | how long each echo pin was high, in µs | 8 × 2 |
//! | left, right duty (signed) | 2 + 2 | | echo pins that are high still | 1 |
//! | sonar trigger bits | 1 | | ADC counts | 7 × 2 |
//! | auxiliary outputs (bits 0 to 3), triggers of the array's banks (4 to 6) | 1 | | | |
//! | | | | counts of the gyroscope (signed) | 2 |
//! | | | | inputs that are low: bit 0 the emergency stop's, 1 and 2 the left and the right bumper's | 1 |
//!
//! The time of an echo pin counts from the last trigger on: 0 until it goes high, growing while it
//! is, and then what it was. So 0 says that a sonar does not answer, and never that nothing is
//! there: see [`Sonar`](crate::drivers::Sonar).

use core::array;

use super::pins::{ARRAY_BANKS, AUX_OUTPUTS, Actuators, BUMPERS, DEADMAN_US, PinImage, Sensors};

/// Size of an encoded [`Request`] in bytes.
pub const REQUEST_BYTES: usize = 26;

/// Size of an encoded [`Reply`] in bytes.
pub const REPLY_BYTES: usize = 42;

/// The auxiliary outputs, in the byte that they share with the array's triggers.
const AUX_MASK: u8 = (1 << AUX_OUTPUTS) - 1;

/// The triggers of the array's banks, in that byte, behind the auxiliary outputs.
const ARRAY_MASK: u8 = (1 << ARRAY_BANKS) - 1;

/// The input of the emergency stop's button, among those that a reply tells of.
const STOP_IS_LOW: u8 = 1 << 0;

/// Those of the bumpers, left and right.
const BUMPER_IS_LOW: [u8; BUMPERS] = [1 << 1, 1 << 2];

/// Stale frames in a row that a board bears; one more and it must go to its safe state.
pub const STALE_FRAME_LIMIT: u8 = 5;

/// What the board tells the plant at the start of a slot activation.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Request {
    /// Counts the exchanges from 0; wraps.
    pub sequence: u32,
    /// Nominal start of this activation, in microseconds of plant time. Sensors are read at this
    /// instant.
    pub start_us: u64,
    /// Nominal end of the activation before, in microseconds of plant time. The actuators take
    /// effect at this instant.
    pub effect_us: u64,
    /// What the tasks of the activation before left on the pins.
    pub actuators: Actuators,
}

impl Request {
    /// The message as bytes.
    pub fn encode(&self) -> [u8; REQUEST_BYTES] {
        let Actuators {
            left_duty,
            right_duty,
            sonar_triggers,
            aux_outputs,
            array_triggers,
        } = self.actuators;
        let outputs = aux_outputs | array_triggers << AUX_OUTPUTS;
        filled(
            (self.sequence.to_le_bytes().into_iter())
                .chain(self.start_us.to_le_bytes())
                .chain(self.effect_us.to_le_bytes())
                .chain(left_duty.to_le_bytes())
                .chain(right_duty.to_le_bytes())
                .chain([sonar_triggers, outputs]),
        )
    }

    /// The message in `bytes`. Any bytes are a message; the plant limits duties that no pin can
    /// have.
    pub fn decode(bytes: &[u8; REQUEST_BYTES]) -> Self {
        let mut fields = Fields(bytes.iter());
        let mut request = Self {
            sequence: u32::from_le_bytes(fields.take()),
            start_us: u64::from_le_bytes(fields.take()),
            effect_us: u64::from_le_bytes(fields.take()),
            actuators: Actuators {
                left_duty: i16::from_le_bytes(fields.take()),
                right_duty: i16::from_le_bytes(fields.take()),
                sonar_triggers: u8::from_le_bytes(fields.take()),
                ..Actuators::default()
            },
        };
        let outputs = u8::from_le_bytes(fields.take());
        request.actuators.aux_outputs = outputs & AUX_MASK;
        request.actuators.array_triggers = outputs >> AUX_OUTPUTS & ARRAY_MASK;
        request
    }
}

/// What the plant answers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Reply {
    /// The sequence of the request that this answers.
    pub sequence: u32,
    /// The sensors at the request's `start_us`.
    pub sensors: Sensors,
}

impl Reply {
    /// The message as bytes.
    pub fn encode(&self) -> [u8; REPLY_BYTES] {
        let Sensors {
            left_count,
            right_count,
            echo_us,
            echo_high,
            adc_counts,
            stop_is_low,
            bumper_is_low,
            yaw_counts,
        } = self.sensors;
        let bits = [STOP_IS_LOW, BUMPER_IS_LOW[0], BUMPER_IS_LOW[1]].into_iter();
        let inputs = [stop_is_low, bumper_is_low[0], bumper_is_low[1]];
        let low_inputs =
            (bits.zip(inputs)).fold(0, |low, (bit, is_low)| if is_low { low | bit } else { low });
        filled(
            (self.sequence.to_le_bytes().into_iter())
                .chain(left_count.to_le_bytes())
                .chain(right_count.to_le_bytes())
                .chain(echo_us.into_iter().flat_map(u16::to_le_bytes))
                .chain([echo_high])
                .chain(adc_counts.into_iter().flat_map(u16::to_le_bytes))
                .chain(yaw_counts.to_le_bytes())
                .chain([low_inputs]),
        )
    }

    /// The message in `bytes`. Any bytes are a message; [`PlantExchange::accept`] looks at its
    /// sequence.
    pub fn decode(bytes: &[u8; REPLY_BYTES]) -> Self {
        let mut fields = Fields(bytes.iter());
        let mut reply = Self {
            sequence: u32::from_le_bytes(fields.take()),
            sensors: Sensors {
                left_count: u16::from_le_bytes(fields.take()),
                right_count: u16::from_le_bytes(fields.take()),
                echo_us: array::from_fn(|_| u16::from_le_bytes(fields.take())),
                echo_high: u8::from_le_bytes(fields.take()),
                adc_counts: array::from_fn(|_| u16::from_le_bytes(fields.take())),
                yaw_counts: i16::from_le_bytes(fields.take()),
                ..Sensors::default()
            },
        };
        let low_inputs = u8::from_le_bytes(fields.take());
        reply.sensors.stop_is_low = low_inputs & STOP_IS_LOW != 0;
        reply.sensors.bumper_is_low = BUMPER_IS_LOW.map(|bit| low_inputs & bit != 0);
        reply
    }
}

/// An array filled from its start with `bytes`, which are as many as it has.
fn filled<const N: usize>(bytes: impl Iterator<Item = u8>) -> [u8; N] {
    let mut message = [0; N];
    for (place, byte) in message.iter_mut().zip(bytes) {
        *place = byte;
    }
    message
}

/// The bytes of a message that are still to be read.
struct Fields<'a>(core::slice::Iter<'a, u8>);

impl Fields<'_> {
    /// The next `N` bytes. The sizes of the fields add up to the message's, so there always are as
    /// many.
    fn take<const N: usize>(&mut self) -> [u8; N] {
        array::from_fn(|_| self.0.next().copied().unwrap_or(0))
    }
}

/// What a reply was worth.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Freshness {
    /// It answers the last request; the pin image has its sensors.
    Fresh,
    /// It does not, or none came; the pin image keeps the sensors that it had.
    Stale,
    /// More than [`STALE_FRAME_LIMIT`] in a row were stale. The motors are off, and the board must
    /// go to its safe state.
    Lost,
}

/// The board's side of the exchanges: numbers the requests, judges the replies, watches the deadman
/// time.
///
/// ```
/// use rt_firmware::body::{Freshness, PinImage, PlantExchange, Reply, Sensors};
///
/// let pins = PinImage::new();
/// let mut exchange = PlantExchange::new();
/// let request = exchange.request(&pins, 20_000, 11_000);
/// // … the bytes of `request.encode()` go out, those of the reply come in …
/// let reply = Reply { sequence: request.sequence, sensors: Sensors::default() };
/// assert_eq!(exchange.accept(&pins, Some(&reply.encode())), Freshness::Fresh);
/// ```
#[derive(Debug, Default)]
pub struct PlantExchange {
    next_sequence: u32,
    /// Of the left motor and of the right one.
    last_motor_writes_us: [u64; 2],
    stale_in_a_row: u8,
    stale_frames: u32,
}

impl PlantExchange {
    /// The state before the first exchange.
    pub const fn new() -> Self {
        Self {
            next_sequence: 0,
            last_motor_writes_us: [0; 2],
            stale_in_a_row: 0,
            stale_frames: 0,
        }
    }

    /// The request that opens the activation whose nominal start is `start_us`; `effect_us` is the
    /// nominal end of the activation before (of any slot), both in microseconds of plant time.
    /// Takes the sonar triggers from `pins`, and switches off each motor that no task has written
    /// for [`DEADMAN_US`].
    pub fn request(&mut self, pins: &PinImage, start_us: u64, effect_us: u64) -> Request {
        for (motor, last_write_us) in
            (pins.motors().into_iter()).zip(&mut self.last_motor_writes_us)
        {
            if motor.take_written() {
                *last_write_us = start_us;
            } else if start_us.saturating_sub(*last_write_us) > DEADMAN_US {
                motor.off();
            }
        }
        let request = Request {
            sequence: self.next_sequence,
            start_us,
            effect_us,
            actuators: pins.take_actuators(),
        };
        self.next_sequence = self.next_sequence.wrapping_add(1);
        request
    }

    /// Takes the reply to the last request, `None` if there was none, and puts its sensors on
    /// `pins` if it is fresh.
    pub fn accept(&mut self, pins: &PinImage, reply: Option<&[u8; REPLY_BYTES]>) -> Freshness {
        let expected = self.next_sequence.wrapping_sub(1);
        match reply.map(Reply::decode) {
            Some(reply) if reply.sequence == expected => {
                pins.set_sensors(&reply.sensors);
                self.stale_in_a_row = 0;
                Freshness::Fresh
            }
            _ => {
                self.stale_frames = self.stale_frames.saturating_add(1);
                self.stale_in_a_row = self.stale_in_a_row.saturating_add(1);
                if self.stale_in_a_row > STALE_FRAME_LIMIT {
                    pins.safe();
                    Freshness::Lost
                } else {
                    Freshness::Stale
                }
            }
        }
    }

    /// Number of stale frames since the start.
    pub fn stale_frames(&self) -> u32 {
        self.stale_frames
    }
}

#[cfg(test)]
mod tests {
    use embedded_hal::pwm::SetDutyCycle;

    use super::super::pins::distinct_sensors;
    use super::*;

    const REQUEST: Request = Request {
        sequence: 0x0403_0201,
        start_us: 0x0C0B_0A09_0807_0605,
        effect_us: 0x1413_1211_100F_0E0D,
        actuators: Actuators {
            left_duty: 0x1615,
            right_duty: -2,
            sonar_triggers: 0x19,
            aux_outputs: 0xA,
            array_triggers: 1,
        },
    };

    #[test]
    fn a_request_is_its_fields_in_little_endian_order() {
        let mut expected: [u8; REQUEST_BYTES] = array::from_fn(|i| i as u8 + 1);
        expected[22..24].copy_from_slice(&[0xFE, 0xFF]);
        assert_eq!(REQUEST.encode(), expected);
    }

    #[test]
    fn messages_survive_the_wire() {
        assert_eq!(Request::decode(&REQUEST.encode()), REQUEST);
        let reply = Reply {
            sequence: 7,
            sensors: distinct_sensors(),
        };
        assert_eq!(Reply::decode(&reply.encode()), reply);
        // Every byte belongs to a field: none is lost and none is padding. Of the last one three
        // bits mean something.
        let mut bytes: [u8; REPLY_BYTES] = array::from_fn(|i| 0xA0 ^ i as u8);
        bytes[REPLY_BYTES - 1] = STOP_IS_LOW | BUMPER_IS_LOW[1];
        assert_eq!(Reply::decode(&bytes).encode(), bytes);
    }

    #[test]
    fn stale_frames_are_counted_and_too_many_in_a_row_stop_the_robot() {
        let pins = PinImage::new();
        let mut exchange = PlantExchange::new();
        let mut run = |replies: &[Option<i64>]| -> Vec<Freshness> {
            let mut seen = Vec::new();
            for offset in replies {
                pins.parts().left_pwm.set_duty_cycle(100).unwrap();
                let request = exchange.request(&pins, 0, 0);
                let reply = offset.map(|offset| {
                    Reply {
                        sequence: (i64::from(request.sequence) + offset) as u32,
                        sensors: distinct_sensors(),
                    }
                    .encode()
                });
                seen.push(exchange.accept(&pins, reply.as_ref()));
            }
            seen
        };
        use Freshness::{Fresh, Lost, Stale};
        assert_eq!(run(&[Some(0), Some(-1), None]), [Fresh, Stale, Stale]);
        // A fresh one starts the count anew.
        assert_eq!(run(&[Some(0)]), [Fresh]);
        assert_eq!(
            run(&[Some(1); 6]),
            [Stale, Stale, Stale, Stale, Stale, Lost]
        );
        assert_eq!(exchange.stale_frames(), 8);
        assert_eq!(pins.take_actuators().left_duty, 0);
    }

    #[test]
    fn a_stale_reply_leaves_the_sensors_as_they_were() {
        let pins = PinImage::new();
        let mut exchange = PlantExchange::new();
        let request = exchange.request(&pins, 0, 0);
        let stale = Reply {
            sequence: request.sequence.wrapping_sub(1),
            sensors: distinct_sensors(),
        };
        assert_eq!(
            exchange.accept(&pins, Some(&stale.encode())),
            Freshness::Stale
        );
        assert_eq!(pins.sensors(), Sensors::default());
    }

    #[test]
    fn motors_that_nobody_writes_stop_after_the_deadman_time() {
        let pins = PinImage::new();
        let mut exchange = PlantExchange::new();
        pins.parts().right_pwm.set_duty_cycle(300).unwrap();
        for (start_us, expected) in [
            (1_000_000, 300),
            (1_000_000 + DEADMAN_US, 300),
            (1_000_001 + DEADMAN_US, 0),
        ] {
            let request = exchange.request(&pins, start_us, 0);
            assert_eq!(request.actuators.right_duty, expected, "at {start_us}");
        }
    }

    #[test]
    fn a_motor_stops_that_nobody_writes_though_the_other_one_is_written() {
        for left_is_written in [true, false] {
            let pins = PinImage::new();
            let mut exchange = PlantExchange::new();
            let mut parts = pins.parts();
            parts.left_pwm.set_duty_cycle(300).unwrap();
            parts.right_pwm.set_duty_cycle(300).unwrap();
            let mut duties = (0, 0);
            for start_us in (0..2 * DEADMAN_US).step_by(20_000) {
                let written = if left_is_written {
                    &mut parts.left_pwm
                } else {
                    &mut parts.right_pwm
                };
                written.set_duty_cycle(300).unwrap();
                let actuators = exchange.request(&pins, start_us, 0).actuators;
                duties = (actuators.left_duty, actuators.right_duty);
            }
            let expected = if left_is_written { (300, 0) } else { (0, 300) };
            assert_eq!(duties, expected);
        }
    }
}
