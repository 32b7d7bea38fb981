//! A line to a simulated robot whose crystal is not what it should be.
//!
//! In a simulation host and robot share one time. A robot whose clock is slow is one for which the
//! host's time passes faster, and so it is made here: bytes stay as they are, and the line's clock
//! goes by another rate.

use std::io;
use std::sync::Arc;
use std::time::{Duration, Instant};

use super::ByteLink;
use super::clock::{Clock, SimulatedTime};

/// A line by whose clock the robot's is too fast or too slow.
pub struct Detuned<L> {
    line: L,
    time: Arc<HostTime>,
}

/// The host's time beside the robot's.
struct HostTime {
    robot: Clock,
    begun: Instant,
    /// Host time that passes in a second of robot time.
    rate: f64,
}

impl HostTime {
    fn of_robot(&self, host: Duration) -> Duration {
        host.div_f64(self.rate)
    }
}

impl SimulatedTime for HostTime {
    fn elapsed(&self) -> Duration {
        self.robot.since(self.begun).mul_f64(self.rate)
    }

    fn pause(&self, time: Duration) {
        self.robot.pause(self.of_robot(time));
    }
}

impl<L: ByteLink> Detuned<L> {
    /// The line to a robot whose clock is so many millionths fast, or slow where they are negative.
    /// More than half a second in each second is none that runs.
    pub fn new(line: L, fast_ppm: f64) -> Self {
        let robot = line.clock();
        let time = HostTime {
            begun: robot.now(),
            robot,
            rate: 1.0 / (1.0 + (fast_ppm / 1e6).clamp(-0.5, 0.5)),
        };
        Detuned {
            line,
            time: Arc::new(time),
        }
    }
}

impl<L: ByteLink> ByteLink for Detuned<L> {
    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> io::Result<usize> {
        self.line.receive(buffer, self.time.of_robot(timeout))
    }

    fn send(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.line.send(bytes)
    }

    fn try_send(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.line.try_send(bytes)
    }

    fn clock(&self) -> Clock {
        Clock::simulated(Arc::clone(&self.time) as _)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Mutex;

    use super::*;

    /// A line whose time passes when somebody waits.
    #[derive(Clone, Default)]
    struct Idle(Arc<Mutex<Duration>>);

    impl SimulatedTime for Idle {
        fn elapsed(&self) -> Duration {
            *self.0.lock().unwrap()
        }

        fn pause(&self, time: Duration) {
            *self.0.lock().unwrap() += time;
        }
    }

    impl ByteLink for Idle {
        fn receive(&mut self, _: &mut [u8], timeout: Duration) -> io::Result<usize> {
            self.pause(timeout);
            Ok(0)
        }

        fn send(&mut self, _: &[u8]) -> io::Result<()> {
            Ok(())
        }

        fn clock(&self) -> Clock {
            Clock::simulated(Arc::new(self.clone()))
        }
    }

    #[test]
    fn a_slow_robot_has_less_time_than_its_host() {
        for (fast_ppm, robot_us) in [
            (0.0, 10_000_000),
            (-3_000.0, 9_970_000),
            (500.0, 10_005_000),
        ] {
            let robot = Idle::default();
            let mut line = Detuned::new(robot.clone(), fast_ppm);
            let clock = line.clock();
            let begun = clock.now();
            clock.pause(Duration::from_secs(4));
            line.receive(&mut [], Duration::from_secs(6)).unwrap();
            let near = |a: Duration, us: u64| a.abs_diff(Duration::from_micros(us)).as_micros() < 5;
            assert!(near(robot.elapsed(), robot_us), "{:?}", robot.elapsed());
            assert!(near(clock.since(begun), 10_000_000));
        }
    }
}
