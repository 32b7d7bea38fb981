//! A bench for one task: give it inputs, step it, look at what came out. For tests on the host.

use std::boxed::Box;

use crate::features::MISSIONS;
use crate::ports::{Buffered, Executor, Inputs, Net, Outcome, TaskPlace, TaskPool, assemble};
use crate::registry::nets;
use crate::task::{
    In, InFlag, InOut, MAX_DATA_PORTS, OptIn, OptInOut, Out, OutFlag, Param, ParamType, PortType,
    Step, Task,
};
use esm_link::message::SafeReason;

/// Steps one task by hand. Every data port has a net of its own. Inputs stay, and stay fresh, until
/// another value is given or they are taken away.
///
/// The task's storage is leaked, which tests can afford.
///
/// ```
/// use rt_firmware::{Io, Step, Task, TaskBench, task};
///
/// struct Double;
/// task! { impl Double { data { in x: f32; out y: f32; } flags { out large; } params { factor: f32 = 2.0; } } }
/// impl Task for Double {
///     fn step(&mut self, io: &mut Io<'_>) -> Step {
///         let y = *io.read(Self::X) * io.param(Self::FACTOR);
///         *io.write(Self::Y) = y;
///         io.set(Self::LARGE, y > 10.0);
///         Step::Run
///     }
/// }
///
/// let mut bench = TaskBench::new(Double);
/// bench.param(Double::FACTOR, 2.0);
/// assert_eq!(bench.step(), None, "a required input has no value");
/// bench.give(Double::X, 6.0);
/// assert_eq!(bench.step(), Some(Step::Run));
/// assert_eq!(bench.output(Double::Y), Some(12.0));
/// assert!(bench.flag(Double::LARGE));
/// ```
pub struct TaskBench<'a> {
    executor: Executor<'a>,
    inputs: Inputs,
    enter: bool,
    out_flags: u16,
    allowed_overruns: Option<u32>,
    failure: Option<SafeReason>,
}

const TASK: TaskPlace = TaskPlace { bank: 0, place: 0 };

/// A handle of a port on which a task finds values.
pub trait InputPort<V> {
    /// The port's place in the declaration.
    fn index(&self) -> usize;
}

/// A handle of a port on which a task publishes values.
pub trait OutputPort<V> {
    /// The port's place in the declaration.
    fn index(&self) -> usize;
}

macro_rules! port_handles {
    ($($side:ident: $($handle:ident),+;)+) => {
        $($(impl<V> $side<V> for $handle<V> {
            fn index(&self) -> usize {
                usize::from(self.index)
            }
        })+)+
    };
}

port_handles! {
    InputPort: In, OptIn, InOut, OptInOut;
    OutputPort: Out, InOut, OptInOut;
}

impl<'a> TaskBench<'a> {
    /// A bench with this task, about to be entered.
    ///
    /// # Panics
    /// If the task's port types contradict each other.
    pub fn new<T: Task + 'a>(task: T) -> Self {
        let bank: &'a mut TaskPool<T, 1> = Box::leak(Box::new(TaskPool::new([task])));
        let banks: &'a mut [&'a mut (dyn crate::AnyTaskPool + 'a)] =
            Box::leak(Box::new([bank as &mut (dyn crate::AnyTaskPool + 'a)]));
        let nets: &'a mut [[Net; MAX_DATA_PORTS]; MISSIONS] =
            Box::leak(Box::new(nets::<MAX_DATA_PORTS>()));
        let executor = match assemble(banks, nets) {
            Ok((executor, _)) => executor,
            Err(fault) => panic!("{fault:?}"),
        };
        TaskBench {
            executor,
            inputs: Inputs {
                period_us: 10_000,
                ..Inputs::default()
            },
            enter: true,
            out_flags: 0,
            allowed_overruns: None,
            failure: None,
        }
    }

    /// Publishes a value on an input's net.
    pub fn give<V: PortType>(&mut self, port: impl InputPort<V>, value: V) -> &mut Self {
        self.executor.inject(
            port.index(),
            value,
            Box::leak(Box::new(Buffered::<V>::EMPTY)),
        );
        self
    }

    /// Takes the value off an input's net: there is none, or none that is fresh enough.
    pub fn take_away<V: PortType>(&mut self, port: impl InputPort<V>) -> &mut Self {
        self.executor.empty(port.index());
        self
    }

    /// Sets a parameter.
    pub fn param<P: ParamType>(&mut self, param: Param<P>, value: P) -> &mut Self {
        if let Some(bits) = self.inputs.params.get_mut(usize::from(param.index)) {
            *bits = value.to_bits();
        }
        self
    }

    /// Sets or clears an `in` flag.
    pub fn set(&mut self, flag: InFlag, value: bool) -> &mut Self {
        let bit = 1 << flag.index;
        self.inputs.flags = if value {
            self.inputs.flags | bit
        } else {
            self.inputs.flags & !bit
        };
        self
    }

    /// Sets the slot's period; 10 ms unless told. It is also how far the time goes on with each
    /// step.
    pub fn period_us(&mut self, period_us: u32) -> &mut Self {
        self.inputs.period_us = period_us;
        self
    }

    /// Sets what the runtime has counted of all slots: overruns and deadline misses.
    pub fn counted(&mut self, overruns: u32, missed: u32) -> &mut Self {
        self.inputs.overruns = overruns;
        self.inputs.missed = missed;
        self
    }

    /// Sets how long no request has come over the link.
    pub fn link_silent_us(&mut self, silent_us: u32) -> &mut Self {
        self.inputs.link_silent_us = silent_us;
        self
    }

    /// What the link asks of the list of behaviours; the next step of its owner does it.
    #[cfg(test)]
    pub(crate) fn list_command(&mut self, command: crate::list_command::ListCommand) {
        let now_us = self.inputs.now_us;
        let put = self.executor.behaviours().put(command, now_us);
        put.expect("the owner has been there");
    }

    /// What came of it.
    #[cfg(test)]
    pub(crate) fn list_answer(&mut self) -> Option<crate::list_command::Answer> {
        self.executor.behaviours().take_answer()
    }

    /// The next step is the first of a new activation; flags are cleared, as entering a task state
    /// does.
    pub fn enter_anew(&mut self) -> &mut Self {
        self.enter = true;
        self.out_flags = 0;
        self
    }

    /// Executes the task once. `None` if a required input has no value, so that the task would be
    /// busy.
    pub fn step(&mut self) -> Option<Step> {
        let Outcome {
            step,
            flags,
            allowed_overruns,
            failure,
        } = self
            .executor
            .execute(TASK, Some, &self.inputs, self.enter)?;
        self.enter = false;
        self.allowed_overruns = allowed_overruns;
        self.failure = failure;
        self.out_flags = (self.out_flags & !flags.written) | flags.values;
        self.inputs.now_us += u64::from(self.inputs.period_us);
        Some(step)
    }

    /// How many overruns in a row the task allowed in its last step, if it did.
    pub fn allowed_overruns(&self) -> Option<u32> {
        self.allowed_overruns
    }

    /// Why the robot was to go to its safe state after the last step, if the task said so.
    pub fn failure(&self) -> Option<SafeReason> {
        self.failure
    }

    /// The value that the task published last on this port.
    pub fn output<V: PortType>(&self, port: impl OutputPort<V>) -> Option<V> {
        self.executor.value_on(port.index())
    }

    /// Whether the task has set this flag since it was entered, and not cleared it again.
    pub fn flag(&self, flag: OutFlag) -> bool {
        self.out_flags & (1 << flag.index) != 0
    }
}
