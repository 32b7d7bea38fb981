//! Behaviours: what a robot does until it is done, scheduled one behind the other.
//!
//! A behaviour is a task whose state of a mission goes onto a [list](BehaviourList) when it is
//! entered. The head of the list says how the robot moves; the others wait. Its
//! [control law](Behaviour) sees the robot's pose in a local frame, whose centre is where the robot
//! was when the behaviour came onto the list. When the law is done, the task has finished. When the
//! state is left early, the behaviour leaves the list.
//!
//! Beside each behaviour that executes [situations](situation) are watched: while the way ahead is
//! not free, IDLE executes in its place, and it resumes by itself. What else is watched is a
//! [`Situation`], which [`situation!`](crate::situation!) makes a task of.
//!
//! ```
//! use rt_firmware::behaviour;
//! use rt_firmware::behaviours::{Behaviour, BehaviourList, Control, Params, Scene};
//! use rt_firmware::tasks::{Pose, Ranges, Twist};
//!
//! /// Drives ahead until something is nearer than a metre.
//! #[derive(Debug, Default)]
//! pub struct ComeNearLaw;
//!
//! behaviour! {
//!     /// Drives ahead until something is near.
//!     impl ComeNear runs ComeNearLaw {
//!         wcet 300 us;
//!         params {
//!             /// How fast, in metres per second.
//!             speed_m_per_s: f32 = 0.2, 0.0..=0.5;
//!         }
//!     }
//! }
//!
//! impl Behaviour for ComeNearLaw {
//!     fn control(&mut self, scene: &Scene<'_>, params: &Params) -> Control {
//!         if scene.ranges.is_none_or(|ranges| ranges.ahead_m() < 1.0) {
//!             return Control::Done;
//!         }
//!         Control::Move(Twist {
//!             forward_m_per_s: params.get(ComeNear::SPEED_M_PER_S),
//!             turn_rad_per_s: 0.0,
//!         })
//!     }
//! }
//! ```
//!
//! Source: Schoute, "Behaviour-based control framework for an autonomous mobile robot", sections 3
//! and 4.

mod along_wall;
mod approach;
mod beams;
mod corridor;
mod dock;
mod executive;
mod follow_corridor;
mod follow_object;
mod go_to;
mod inserted;
mod landmarks;
mod law;
mod life_cycle;
mod list;
mod lookout;
mod move_on;
mod openings;
mod pass_door;
mod pings;
mod place;
mod remote_control;
mod repertoire;
mod runner;
mod script;
mod shipped;
mod shipped_situations;
pub mod situation;
mod situation_runner;
mod told;
mod turn_rate;
mod turn_to;
mod wander;
mod watches;
mod way_round;
#[cfg(all(test, feature = "all-behaviours"))]
mod way_round_tests;

pub use crate::declaration::Params;
pub use along_wall::{AlongWall, AlongWallLaw};
pub use approach::{Approach, ApproachLaw};
pub use dock::{Dock, DockLaw};
pub use executive::{Behaviours, MAX_INSERTED};
pub use follow_corridor::{FollowCorridor, FollowCorridorLaw};
pub use follow_object::{FollowObject, FollowObjectLaw};
pub use go_to::{GoTo, GoToLaw};
pub use law::{Behaviour, Control, Scene};
pub use life_cycle::{Cause, LifeState};
pub use list::{BehaviourList, Key, ListFull, MAX_BEHAVIOURS, UNSEEN_LOOKS};
pub use move_on::{Move, MoveLaw};
pub use pass_door::{PassDoor, PassDoorLaw};
pub use repertoire::{BehaviourTask, Repertoire};
#[doc(hidden)]
pub use runner::{Ports, Runner};
pub use shipped::ShippedLaws;
pub use shipped_situations::{
    CornerLeft, CornerRight, DoorLeft, DoorRight, LowBattery, Near, OutsideRange, SensorLost, Stuck,
};
pub use situation::{Circumstances, Situation};
#[doc(hidden)]
pub use situation_runner::{SituationPorts, SituationRunner};
pub use turn_to::{TurnTo, TurnToLaw};
pub use wander::{Wander, WanderLaw};

/// Declares a task that runs a [`Behaviour`]; see [the module](mod@crate::behaviours) for an
/// example.
///
/// Its ports and flags are those of all behaviours; the types of the ports (`BehaviourList`,
/// `Pose`, `Ranges`) must be in scope. Parameters are written as in
/// [`task!`](crate::task!); `outside_m` and `at_head` are added to them.
#[macro_export]
macro_rules! behaviour {
    (
        $(#[doc = $doc:literal])*
        impl $name:ident runs $law:ident {
            wcet $wcet:literal $wcet_unit:ident;
            params { $($params:tt)* }
        }
    ) => {
        #[doc = concat!("The task that runs [`", stringify!($law), "`].")]
        #[derive(Debug, Default)]
        pub struct $name($crate::behaviours::Runner<$law>);

        $crate::task! {
            $(#[doc = $doc])*
            impl $name {
                slot 2;
                wcet $wcet $wcet_unit;
                data {
                    /// The list of behaviours.
                    inout list: BehaviourList optional;
                    /// Where the robot is.
                    in pose: Pose optional within 100 ms;
                    /// What is around it.
                    in ranges: Ranges optional within 200 ms;
                }
                flags {
                    /// It waits for others, or until the way is free.
                    out suspended;
                    /// It has ended without being done.
                    out failed;
                }
                params {
                    $($params)*
                    /// Farther than this from its start it ends, in metres; 0 is no limit.
                    outside_m: f32 = 0.0, 0.0..=1000.0;
                    /// It comes before the head of the list, which it interrupts.
                    at_head: bool = false, false..=true;
                }
            }
        }

        impl $crate::behaviours::BehaviourTask for $name {
            type Law = $law;
            const OUTSIDE: $crate::Param<f32> = $name::OUTSIDE_M;
            const AT_HEAD: $crate::Param<bool> = $name::AT_HEAD;
        }

        impl $crate::Task for $name {
            fn reset(&mut self) {
                self.0.reset();
            }

            fn enter(&mut self) {
                self.0.enter();
            }

            fn step(&mut self, io: &mut $crate::Io<'_>) -> $crate::Step {
                const PORTS: $crate::behaviours::Ports = $crate::behaviours::Ports {
                    list: $name::LIST,
                    pose: $name::POSE,
                    ranges: $name::RANGES,
                    suspended: $name::SUSPENDED,
                    failed: $name::FAILED,
                    outside_m: $name::OUTSIDE_M,
                    at_head: $name::AT_HEAD,
                    task: $crate::declaration_of::<$name>().signature_hash as u16,
                };
                self.0.step(io, &PORTS)
            }
        }
    };
}

/// Declares a task that looks for a [`Situation`] while its state is active, beside the behaviours
/// of a mission.
///
/// Its ports and flags are those of all situations; the types of the ports (`BehaviourList`,
/// `Pose`, `Ranges`, `Battery`) must be in scope. Parameters are written as in
/// [`task!`](crate::task!); `reaction` is added to them.
///
/// ```
/// use rt_firmware::behaviours::{BehaviourList, Circumstances, Params, Situation};
/// use rt_firmware::situation;
/// use rt_firmware::tasks::{Battery, Pose, Ranges};
///
/// /// Something is behind the robot.
/// #[derive(Debug, Default)]
/// pub struct FollowedSituation;
///
/// situation! {
///     /// Situation: somebody follows.
///     impl Followed watches FollowedSituation {
///         wcet 50 us;
///         params {
///             /// Nearer than this, in metres.
///             range_m: f32 = 0.5, 0.0..=4.0;
///         }
///     }
/// }
///
/// impl Situation for FollowedSituation {
///     fn look(&mut self, seen: &Circumstances<'_>, params: &Params) -> bool {
///         let range_m = params.get(Followed::RANGE_M);
///         seen.ranges.is_some_and(|ranges| ranges.behind_m() < range_m)
///     }
/// }
/// ```
#[macro_export]
macro_rules! situation {
    (
        $(#[doc = $doc:literal])*
        impl $name:ident watches $situation:ty {
            wcet $wcet:literal $wcet_unit:ident;
            params { $($params:tt)* }
        }
    ) => {
        $(#[doc = $doc])*
        #[derive(Debug, Default)]
        pub struct $name($crate::behaviours::SituationRunner<$situation>);

        $crate::task! {
            $(#[doc = $doc])*
            impl $name {
                slot 2;
                wcet $wcet $wcet_unit;
                endless;
                data {
                    /// The list of behaviours.
                    inout list: BehaviourList optional;
                    /// Where the robot is.
                    in pose: Pose optional within 100 ms;
                    /// What is around it.
                    in ranges: Ranges optional within 200 ms;
                    /// The battery.
                    in battery: Battery optional;
                }
                flags {
                    /// It is so.
                    out up;
                }
                params {
                    $($params)*
                    /// What becomes of the behaviour that executes: 0 nothing, 1 it is suspended
                    /// while it is so, 2 it is cancelled.
                    reaction: u32 = 0, 0..=2;
                }
            }
        }

        impl $crate::Task for $name {
            fn reset(&mut self) {
                self.0.enter();
            }

            fn enter(&mut self) {
                self.0.enter();
            }

            fn step(&mut self, io: &mut $crate::Io<'_>) -> $crate::Step {
                const PORTS: $crate::behaviours::SituationPorts =
                    $crate::behaviours::SituationPorts {
                        list: $name::LIST,
                        pose: $name::POSE,
                        ranges: $name::RANGES,
                        battery: $name::BATTERY,
                        up: $name::UP,
                        reaction: $name::REACTION,
                        name: stringify!($name),
                    };
                self.0.step(io, &PORTS)
            }
        }
    };
}
