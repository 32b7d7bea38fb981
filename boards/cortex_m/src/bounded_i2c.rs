//! An I2C bus whose transactions end within their time, whatever its wires do: who asks a sensor in
//! a slot waits for it, and no sensor holds a slot for ever.

use core::sync::atomic::{AtomicU32, Ordering::Relaxed};

use embedded_hal::i2c::{self, ErrorKind, I2c, NoAcknowledgeSource, Operation};

/// How long a bus rests that hung, in microseconds: of the sensors that one slot asks the first one
/// alone waits for it.
const RESTS_US: u32 = 3_000;

/// A chip's controller of a bus, as transactions use it.
pub trait Controller {
    /// What a byte may take at most, with its acknowledgement, in microseconds: a sensor may hold
    /// the clock low for a while.
    const BYTE_US: u32;
    /// What a transaction may take besides, in microseconds: its start, its stop, and who is above
    /// its task.
    const MARGIN_US: u32;

    /// When the bus hung the last time, on the clock; 0 if it did not.
    fn hung_us(&self) -> &'static AtomicU32;

    /// The clock's microseconds, which wrap.
    fn now_us(&self) -> u32;

    /// Begins anew, whatever was: of a sensor in the middle of a byte, too.
    fn begin(&self);

    /// Talks to this address from now on.
    fn address(&self, address: u8);

    /// Whether it can be told another byte.
    fn has_room(&self) -> bool;

    /// Sends a byte, or reads one in its place. The first one behind one of the other kind `turns`:
    /// it begins with another start. A stop follows the last one.
    fn put(&self, byte: u8, is_read: bool, turns: bool, is_last: bool);

    /// The byte that was read, if it is there.
    fn take(&self) -> Option<u8>;

    /// Whether something was not acknowledged.
    fn is_refused(&self) -> bool;

    /// Whether the stop was sent.
    fn has_stopped(&self) -> bool;

    /// Whether it does nothing.
    fn is_idle(&self) -> bool;
}

/// Why a transaction failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BusError {
    /// Nobody has this address, or who has it took no more.
    NoAnswer,
    /// It was not done within its time: somebody holds a wire low, or the wires have no resistors.
    TooLong,
}

impl i2c::Error for BusError {
    fn kind(&self) -> ErrorKind {
        match self {
            BusError::NoAnswer => ErrorKind::NoAcknowledge(NoAcknowledgeSource::Unknown),
            BusError::TooLong => ErrorKind::Bus,
        }
    }
}

/// A bus of this controller. Operations without bytes are left out: no address is asked for alone.
#[derive(Clone, Copy, Debug)]
pub struct Bounded<C>(pub C);

impl<C: Controller> Bounded<C> {
    fn exchange(
        &self,
        address: u8,
        operations: &mut [Operation<'_>],
        is_late: impl Fn() -> bool,
    ) -> Result<(), BusError> {
        let Bounded(bus) = self;
        bus.address(address);
        let mut left: usize = operations.iter().map(bytes_of).sum();
        let mut was_read = None;
        for operation in operations {
            let is_read = matches!(operation, Operation::Read(_));
            for place in 0..bytes_of(operation) {
                left -= 1;
                let turns = was_read.replace(is_read).is_some_and(|it| it != is_read);
                let byte = match operation {
                    Operation::Write(bytes) => bytes[place],
                    Operation::Read(_) => 0,
                };
                wait(&is_late, || bus.has_room().then_some(()))?;
                bus.put(byte, is_read, turns, left == 0);
                if let Operation::Read(bytes) = operation {
                    let read = || match bus.is_refused() {
                        true => Some(None),
                        false => bus.take().map(Some),
                    };
                    if let Some(byte) = wait(&is_late, read)? {
                        bytes[place] = byte;
                    }
                }
                if bus.is_refused() {
                    break;
                }
            }
        }
        wait(&is_late, || {
            (bus.is_refused() || bus.has_stopped()).then_some(())
        })?;
        let is_refused = bus.is_refused();
        // What nobody acknowledges the controller ends by itself.
        wait(&is_late, || bus.is_idle().then_some(()))?;
        match is_refused {
            true => Err(BusError::NoAnswer),
            false => Ok(()),
        }
    }
}

/// Waits for something.
fn wait<T>(
    is_late: &impl Fn() -> bool,
    mut what: impl FnMut() -> Option<T>,
) -> Result<T, BusError> {
    loop {
        if let Some(what) = what() {
            return Ok(what);
        }
        if is_late() {
            return Err(BusError::TooLong);
        }
    }
}

fn bytes_of(operation: &Operation<'_>) -> usize {
    match operation {
        Operation::Write(bytes) => bytes.len(),
        Operation::Read(bytes) => bytes.len(),
    }
}

impl<C: Controller> i2c::ErrorType for Bounded<C> {
    type Error = BusError;
}

impl<C: Controller> I2c for Bounded<C> {
    fn transaction(
        &mut self,
        address: u8,
        operations: &mut [Operation<'_>],
    ) -> Result<(), BusError> {
        let Bounded(bus) = &*self;
        let began_us = bus.now_us();
        let passed_us = |since_us: u32| bus.now_us().wrapping_sub(since_us);
        let hung_us = bus.hung_us().load(Relaxed);
        if hung_us != 0 && passed_us(hung_us) < RESTS_US {
            return Err(BusError::TooLong);
        }
        // Each with its address.
        let bytes: usize = operations.iter().map(|it| 1 + bytes_of(it)).sum();
        let bytes = u32::try_from(bytes).unwrap_or(u32::MAX);
        let longest_us = C::BYTE_US
            .saturating_mul(bytes)
            .saturating_add(C::MARGIN_US);
        let done = self.exchange(address, operations, || passed_us(began_us) > longest_us);
        let has_hung = done == Err(BusError::TooLong);
        if has_hung {
            bus.begin();
        }
        let hung_us = if has_hung { bus.now_us().max(1) } else { 0 };
        bus.hung_us().store(hung_us, Relaxed);
        done
    }
}
