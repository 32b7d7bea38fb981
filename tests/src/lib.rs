//! What the tests of this package share: an independent reading of the language's meaning, and a
//! source of random machines.
//!
//! [`reference`](mod@reference) says what a machine does by the shortest route from the definition,
//! with no regard for memory or time. It shares no line with the interpreter that the firmware
//! runs, so that where the two agree, they agree about the language. [`random_machine`] writes
//! machines that use all of it, [`random_nets`] such as are all data paths, and [`shrink`] makes a
//! failing one small enough to think about; [`huge`] makes what is large or hostile, and [`liar`]
//! is a robot that lies. [`occasions`] counts how often what is easy to get wrong happened.
//! [`command`] drives the project from outside, as a person at a terminal does, [`terminal`] is
//! that terminal, and [`environment`] reads what a person sets for a longer run. [`endurance`] lets
//! a robot drive for hours, [`host_drive`] for a while, [`behaviour_run`] by one behaviour;
//! [`recorded`] records what enters its interpreter. [`benchmark`] is what measures machines and
//! tells it. [`guesses`] are what people write who know other tools.

pub mod attack;
pub mod behaviour_run;
pub mod benchmark;
pub mod calibration;
pub mod command;
pub mod endurance;
pub mod environment;
pub mod exactness;
pub mod fuzzing;
pub mod guesses;
pub mod host_drive;
pub mod huge;
pub mod imports;
pub mod instructions;
pub mod liar;
pub mod occasions;
pub mod owner;
pub mod random;
pub mod random_machine;
pub mod random_nets;
pub mod recorded;
pub mod reference;
pub mod scenario;
pub mod shrink;
pub mod subject;
pub mod terminal;
