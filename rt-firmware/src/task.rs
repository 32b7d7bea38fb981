//! What a task is: typed ports, flags and parameters around one step function.
//!
//! A task is a plain struct. [`task!`](crate::task!) declares what it is connected to, and [`Task`]
//! says what it does:
//!
//! ```
//! use rt_firmware::{Io, PortType, Step, Task, task};
//!
//! /// Distances around the robot.
//! #[derive(Clone, Copy)]
//! pub struct Ranges {
//!     /// Distance to the nearest thing ahead, in metres.
//!     pub ahead_m: f32,
//! }
//! impl PortType for Ranges {
//!     const NAME: &'static str = "Ranges";
//!     const INIT: Self = Ranges { ahead_m: f32::INFINITY };
//! }
//!
//! /// How the robot is to move.
//! #[derive(Clone, Copy)]
//! pub struct Twist {
//!     /// Forward speed in metres per second.
//!     pub forward_m_s: f32,
//! }
//! impl PortType for Twist {
//!     const NAME: &'static str = "Twist";
//!     const INIT: Self = Twist { forward_m_s: 0.0 };
//! }
//!
//! /// Drives straight ahead and tells when something is near.
//! pub struct Cruise;
//!
//! task! {
//!     impl Cruise {
//!         slot 2;
//!         wcet 200 us;
//!         exclusive motion;
//!         data {
//!             in ranges: Ranges;
//!             out command: Twist;
//!         }
//!         flags {
//!             in hurry;
//!             out near;
//!         }
//!         params {
//!             speed: f32 = 0.25, 0.0..=0.5;
//!         }
//!     }
//! }
//!
//! impl Task for Cruise {
//!     fn step(&mut self, io: &mut Io<'_>) -> Step {
//!         let ranges = io.read(Self::RANGES);
//!         let speed = io.param(Self::SPEED);
//!         let speed = if io.flag(Self::HURRY) { 2.0 * speed } else { speed };
//!         *io.write(Self::COMMAND) = Twist { forward_m_s: speed };
//!         io.set(Self::NEAR, ranges.ahead_m < 0.5);
//!         Step::Run
//!     }
//! }
//!
//! assert_eq!(
//!     <Cruise as rt_firmware::Declared>::SIGNATURE,
//!     "task Cruise{in data ranges:Ranges;out data command:Twist;in flag hurry;out flag near;param speed:f32;}"
//! );
//! ```
//!
//! Generic tasks (drivers over embedded-hal traits, most often) write their generics in brackets:
//! `task! { impl[M: SetDutyCycle] Wheel<M> { … } }`.

pub use crate::declaration::{
    Declaration, Direction, Docs, FlagDeclaration, In, InFlag, InOut, MAX_DATA_PORTS, MAX_FLAGS,
    MAX_PARAMS, OptIn, OptInOut, Out, OutFlag, Param, ParamDeclaration, ParamKind, ParamType,
    PortDeclaration, PortType, Step, is_esm_literal, is_within_bounds_f32, is_within_bounds_i32,
    is_within_bounds_u32, microseconds, place_of, same_text, signature_hash,
};
pub use crate::ports::{Declared, Io, Task, declaration_of};

/// Declares the ports, flags and parameters of a task type; see [the module](mod@crate::task) for
/// an example.
///
/// ```text
/// task! {
///     /// What it is for.                     // optional, for each port, flag and parameter, too
///     impl NAME {                             // or: impl[M: SetDutyCycle] NAME<M> {
///         slot 2;                             // optional: what `esm tasks` suggests
///         wcet 500 us;                        // optional
///         exclusive GROUP;                    // optional
///         endless;                            // optional: it never finishes
///         monitor;                            // optional: it says something in each execution
///         data   { in a: A; in b: B optional within 100 ms; out c: C; inout d: D; }
///         flags  { in go; out near; }
///         params { speed: f32 = 0.25, 0.0..=0.5; limit: u32; }
///     }
/// }
/// ```
///
/// What is there stands in this order. A default that is out of its bounds does not compile:
///
/// ```compile_fail
/// struct Cruise;
/// rt_firmware::task! {
///     impl Cruise {
///         params { speed: f32 = 0.75, 0.0..=0.5; }
///     }
/// }
/// let declared = <Cruise as rt_firmware::Declared>::DECLARATION;
/// ```
///
/// and with `0.25` in its place it does:
///
/// ```
/// # struct Cruise;
/// # rt_firmware::task! {
/// #     impl Cruise {
/// #         params { speed: f32 = 0.25, 0.0..=0.5; }
/// #     }
/// # }
/// let declared = <Cruise as rt_firmware::Declared>::DECLARATION;
/// assert_eq!(declared.params.len(), 1);
/// ```
///
/// A port that is `within` a time, in `us`, `ms` or `s`, has no value where the last one is older.
///
/// A flag has no age. So a task on whose flags the robot's safety rests says `monitor;`: in each
/// execution it sets or clears a flag, writes an output, or calls [`Io::beat`]. Where it does
/// nothing of that [`SILENT_EXECUTIONS`](crate::ports::SILENT_EXECUTIONS) times in a row, it is
/// taken for broken, and the robot goes to its safe state. A mission does not see this in the
/// task's declaration.
///
/// What the comments with three slashes say is for those who write missions: `esm tasks` prints it.
/// A firmware that is built without the feature `docs` has no room for it.
///
/// Sections that have nothing in them are left out. Each name becomes an associated constant in
/// upper case (`NAME::SPEED`) of the handle type that [`Io`] asks for. The name of a port's type is
/// its [`PortType::NAME`].
#[macro_export]
macro_rules! task {
    (
        $(#[doc = $doc:literal])*
        impl $([$($generics:tt)*])? $name:ident $(<$($argument:tt),+ $(,)?>)? {
            $(slot $slot:literal;)?
            $(wcet $wcet:literal $wcet_unit:ident;)?
            $(exclusive $group:ident;)?
            $(endless $endless:tt)?
            $(monitor $monitor:tt)?
            $(data { $($(#[doc = $port_doc:literal])* $direction:ident $port:ident : $port_type:ident $($attribute:ident $($time:literal $unit:ident)?)* ;)* })?
            $(flags { $($(#[doc = $flag_doc:literal])* $flag_direction:ident $flag:ident ;)* })?
            $(params { $($(#[doc = $param_doc:literal])* $param:ident : $param_type:ident $(= $default:literal)? $(, $min:literal ..= $max:literal)? ;)* })?
        }
    ) => {
        $crate::pastey::paste! {
            impl $(<$($generics)*>)? $name $(<$($argument),+>)? {
                $($(
                    #[doc = concat!("Data port `", stringify!($port), "`.")]
                    $(#[doc = $port_doc])*
                    pub const [<$port:upper>]: $crate::__task_port!($direction $port_type $($attribute)*) =
                        <$crate::__task_port!($direction $port_type $($attribute)*)>::at(
                            $crate::task::place_of(Self::__PORT_NAMES, stringify!($port)),
                        );
                )*)?
                $($(
                    #[doc = concat!("Control flag `", stringify!($flag), "`.")]
                    $(#[doc = $flag_doc])*
                    pub const [<$flag:upper>]: $crate::__task_flag!($flag_direction) =
                        <$crate::__task_flag!($flag_direction)>::at(
                            $crate::task::place_of(Self::__FLAG_NAMES, stringify!($flag)),
                        );
                )*)?
                $($(
                    #[doc = concat!("Parameter `", stringify!($param), "`.")]
                    $(#[doc = $param_doc])*
                    pub const [<$param:upper>]: $crate::task::Param<$param_type> = $crate::task::Param::at(
                        $crate::task::place_of(Self::__PARAM_NAMES, stringify!($param)),
                    );
                )*)?
                #[allow(dead_code)]
                const __PORT_NAMES: &'static [&'static str] = &[$($(stringify!($port),)*)?];
                #[allow(dead_code)]
                const __FLAG_NAMES: &'static [&'static str] = &[$($(stringify!($flag),)*)?];
                #[allow(dead_code)]
                const __PARAM_NAMES: &'static [&'static str] = &[$($(stringify!($param),)*)?];
            }
        }

        impl $(<$($generics)*>)? $crate::task::Declared for $name $(<$($argument),+>)? {
            const SIGNATURE: &'static str = concat!(
                "task ", stringify!($name), "{",
                $($(stringify!($direction), " data ", stringify!($port), ":", stringify!($port_type), $(" ", stringify!($attribute), $(" ", $crate::__task_us!($time $unit),)?)* ";",)*)?
                $($(stringify!($flag_direction), " flag ", stringify!($flag), ";",)*)?
                $($("param ", stringify!($param), ":", stringify!($param_type), ";",)*)?
                "}"
            );
            const DECLARATION: $crate::task::Declaration = {
                $($(
                    assert!(
                        $crate::task::same_text(<$port_type as $crate::task::PortType>::NAME, stringify!($port_type)),
                        "a port's type is written as its PortType::NAME"
                    );
                    $crate::__task_attributes!($direction $($attribute $($time $unit)?)*);
                )*)?
                $($(
                    $(assert!($crate::task::is_esm_literal(stringify!($default)), "a default is written as in a mission: 2000, not 2_000u32");)?
                    $(
                        assert!($crate::task::is_esm_literal(stringify!($min)), "bounds are written as in a mission");
                        assert!($crate::task::is_esm_literal(stringify!($max)), "bounds are written as in a mission");
                    )?
                    $crate::__task_default!($param_type $($default)?; $($min $max)?);
                )*)?
                assert!(Self::__PORT_NAMES.len() <= $crate::task::MAX_DATA_PORTS, "too many data ports");
                assert!(Self::__FLAG_NAMES.len() <= $crate::task::MAX_FLAGS, "too many flags");
                assert!(Self::__PARAM_NAMES.len() <= $crate::task::MAX_PARAMS, "too many parameters");
                $crate::task::Declaration {
                    name: stringify!($name),
                    ports: &[$($(
                        $crate::task::PortDeclaration {
                            name: stringify!($port),
                            kind: $crate::ports::ValueKind::of::<$port_type>(),
                            direction: $crate::__task_direction!($direction),
                            optional: false $(|| $crate::task::same_text(stringify!($attribute), "optional"))*,
                            within_us: $crate::__task_within!($($($time $unit)?)*),
                            docs: $crate::__task_docs!($($port_doc)*),
                        },
                    )*)?],
                    flags: &[$($(
                        $crate::task::FlagDeclaration {
                            name: stringify!($flag),
                            direction: $crate::__task_direction!($flag_direction),
                            docs: $crate::__task_docs!($($flag_doc)*),
                        },
                    )*)?],
                    params: &[$($(
                        $crate::task::ParamDeclaration {
                            name: stringify!($param),
                            kind: <$param_type as $crate::task::ParamType>::KIND,
                            bounds: $crate::__task_bounds!($param_type $($min $max)?),
                            attributes: concat!(
                                $(" = ", stringify!($default),)? $(" min ", stringify!($min), " max ", stringify!($max),)?
                            ),
                            docs: $crate::__task_docs!($($param_doc)*),
                        },
                    )*)?],
                    signature_hash: $crate::task::signature_hash(<Self as $crate::task::Declared>::SIGNATURE),
                    endless: false $(|| $crate::__task_endless!($endless))?,
                    attributes: concat!(
                        $(" slot ", stringify!($slot),)?
                        $(" wcet ", stringify!($wcet), " ", stringify!($wcet_unit),)?
                        $(" exclusive ", stringify!($group),)?
                        $($crate::__task_endless!($endless " endless"),)?
                    ),
                    docs: $crate::__task_docs!($($doc)*),
                }
            };
            type Outputs = $crate::__task_outputs!(
                ($crate::__task_last!($($monitor)?)); [$($($direction $port_type,)*)?] $($($direction $port_type,)*)?
            );
        }
    };
}

#[doc(hidden)]
#[macro_export]
macro_rules! __task_port {
    (out $type:ident) => { $crate::task::Out<$type> };
    (in $type:ident optional $(within)?) => { $crate::task::OptIn<$type> };
    (in $type:ident $(within)?) => { $crate::task::In<$type> };
    (inout $type:ident optional $(within)?) => { $crate::task::OptInOut<$type> };
    (inout $type:ident $(within)?) => { $crate::task::InOut<$type> };
}

#[doc(hidden)]
#[macro_export]
macro_rules! __task_flag {
    (in) => {
        $crate::task::InFlag
    };
    (out) => {
        $crate::task::OutFlag
    };
}

#[doc(hidden)]
#[macro_export]
macro_rules! __task_direction {
    (in) => {
        $crate::task::Direction::In
    };
    (out) => {
        $crate::task::Direction::Out
    };
    (inout) => {
        $crate::task::Direction::InOut
    };
}

#[doc(hidden)]
#[macro_export]
macro_rules! __task_bounds {
    ($type:ident) => {
        None
    };
    (f32 $min:literal $max:literal) => {
        // Casts, since `0..=5` is a range of f32 too where it is written in a mission.
        Some([f32::to_bits($min as f32), f32::to_bits($max as f32)])
    };
    (i32 $min:literal $max:literal) => {
        Some([i32::cast_unsigned($min), i32::cast_unsigned($max)])
    };
    (u32 $min:literal $max:literal) => {
        Some([$min, $max])
    };
    (bool $min:literal $max:literal) => {
        Some([$min as u32, $max as u32])
    };
}

/// A parameter's bounds are in order, and its default is within them.
#[doc(hidden)]
#[macro_export]
macro_rules! __task_default {
    ($type:ident $($default:literal)?;) => {};
    ($type:ident; $min:literal $max:literal) => {
        assert!(
            $crate::__task_is_within!($type $min $min $max),
            "the greatest value of a parameter is below its least"
        );
    };
    ($type:ident $default:literal; $min:literal $max:literal) => {
        assert!(
            $crate::__task_is_within!($type $min $default $max),
            "the default of a parameter is out of its bounds"
        );
    };
}

#[doc(hidden)]
#[macro_export]
macro_rules! __task_is_within {
    (f32 $min:literal $value:literal $max:literal) => {
        $crate::task::is_within_bounds_f32($min as f32, $value as f32, $max as f32)
    };
    (i32 $min:literal $value:literal $max:literal) => {
        $crate::task::is_within_bounds_i32($min, $value, $max)
    };
    (u32 $min:literal $value:literal $max:literal) => {
        $crate::task::is_within_bounds_u32($min, $value, $max)
    };
    (bool $min:literal $value:literal $max:literal) => {
        $crate::task::is_within_bounds_u32($min as u32, $value as u32, $max as u32)
    };
}

/// What stands for `endless;`.
#[doc(hidden)]
#[macro_export]
macro_rules! __task_endless {
    (;) => {
        true
    };
    (; $text:literal) => {
        $text
    };
}

/// The lines that say what something is for.
#[cfg(feature = "docs")]
#[doc(hidden)]
#[macro_export]
macro_rules! __task_docs {
    ($($doc:literal)*) => {
        $crate::task::Docs(concat!($($doc, "\n",)*))
    };
}

/// No lines that say what something is for.
#[cfg(not(feature = "docs"))]
#[doc(hidden)]
#[macro_export]
macro_rules! __task_docs {
    ($($doc:literal)*) => {
        $crate::task::Docs
    };
}

/// What may stand behind a data port, in this order.
#[doc(hidden)]
#[macro_export]
macro_rules! __task_attributes {
    ($direction:tt) => {};
    (in optional) => {};
    (inout optional) => {};
    (in $(optional)? within $time:literal $unit:ident) => {
        assert!($time > 0, "a time is above 0");
        assert!(
            $crate::task::is_esm_literal(stringify!($time)),
            "a time is written as in a mission: 2000 ms, not 2_000 ms"
        );
    };
    (inout $(optional)? within $time:literal $unit:ident) => {
        assert!($time > 0, "a time is above 0");
        assert!(
            $crate::task::is_esm_literal(stringify!($time)),
            "a time is written as in a mission: 2000 ms, not 2_000 ms"
        );
    };
}

/// A time in microseconds, as a text.
#[doc(hidden)]
#[macro_export]
macro_rules! __task_us {
    ($time:literal us) => {
        $time
    };
    ($time:literal ms) => {
        concat!($time, "000")
    };
    ($time:literal s) => {
        concat!($time, "000000")
    };
}

/// The time of a port's `within`, if it has one.
#[doc(hidden)]
#[macro_export]
macro_rules! __task_within {
    () => {
        None
    };
    ($time:literal $unit:ident) => {
        Some($crate::task::microseconds($time, stringify!($unit)))
    };
}

#[doc(hidden)]
#[macro_export]
macro_rules! __task_outputs {
    (($last:ty); [$($all:tt)*]) => { $last };
    (($last:ty); [$($all:tt)*] in $type:ident, $($rest:tt)*) => {
        ($crate::ports::Unbuffered, $crate::__task_outputs!(($last); [$($all)*] $($rest)*))
    };
    (($last:ty); [$($all_direction:tt $all_type:ident,)*] $direction:tt $type:ident, $($rest:tt)*) => {
        (
            $crate::ports::Buffered<$type, {
                $crate::ports::buffers_for(stringify!($direction), stringify!($type), &[$((stringify!($all_direction), stringify!($all_type))),*])
            }>,
            $crate::__task_outputs!(($last); [$($all_direction $all_type,)*] $($rest)*)
        )
    };
}

/// What stands behind the last port's buffers.
#[doc(hidden)]
#[macro_export]
macro_rules! __task_last {
    () => {
        ()
    };
    (;) => {
        $crate::ports::Silence
    };
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Clone, Copy)]
    struct Scan;
    impl PortType for Scan {
        const NAME: &'static str = "Scan";
        const INIT: Self = Scan;
    }

    #[derive(Clone, Copy)]
    struct Twist;
    impl PortType for Twist {
        const NAME: &'static str = "Twist";
        const INIT: Self = Twist;
    }

    struct Everything<A, B> {
        _owned: (A, B),
    }

    task! {
        /// Has all that a task can have.
        ///
        /// And "more".
        impl[A: Send, B: Send + Copy] Everything<A, B> {
            slot 3;
            wcet 1 ms;
            exclusive motion;
            endless;
            data {
                /// What it sees.
                in scan: Scan optional within 80 ms;
                inout pose: Twist within 4000 s;
                in odd: Scan within 1234567 us;
                out cmd: Twist;
            }
            flags {
                /// Go!
                in go;
                out near;
            }
            params {
                /// In metres per second.
                speed: f32 = 0.25, -1.0..=0.5;
                limit: u32;
            }
        }
    }

    struct Nothing;
    task! { impl Nothing {} }

    #[test]
    fn signature_and_source_say_what_was_declared() {
        let cases = [
            (
                *declaration_of::<Everything<u8, u8>>(),
                Everything::<u8, u8>::SIGNATURE,
                "task Everything{in data scan:Scan optional within 80000;inout data pose:Twist within 4000000000;\
                 in data odd:Scan within 1234567;out data cmd:Twist;in flag go;out flag near;\
                 param speed:f32;param limit:u32;}",
                "/// Has all that a task can have.\n///\n/// And \"more\".\n\
                 task Everything slot 3 wcet 1 ms exclusive motion endless count 7 {\n    /// What it sees.\n    \
                 in data scan: Scan optional within 80 ms;\n    inout data pose: Twist within 4000 s;\n    \
                 in data odd: Scan within 1234567 us;\n    out data cmd: Twist;\n    /// Go!\n    in flag go;\n    \
                 out flag near;\n    /// In metres per second.\n    param speed: f32 = 0.25 min -1.0 max 0.5;\n    \
                 param limit: u32;\n}\n",
            ),
            (
                *declaration_of::<Nothing>(),
                Nothing::SIGNATURE,
                "task Nothing{}",
                "task Nothing count 7 {\n}\n",
            ),
        ];
        for (declaration, text, signature, source) in cases {
            assert_eq!(text, signature);
            assert!(declaration.has_signature(text.as_bytes()));
            // Any byte that is another, missing or too many makes it another signature.
            for end in 0..text.len() {
                assert!(!declaration.has_signature(&text.as_bytes()[..end]), "{end}");
                let mut other = text.as_bytes().to_vec();
                other[end] ^= 1;
                assert!(!declaration.has_signature(&other), "{end}");
            }
            assert!(!declaration.has_signature(std::format!("{text};").as_bytes()));
            assert_eq!(declaration.signature_hash, signature_hash(signature));
            let mut told = Vec::new();
            declaration.tell_source(7, &mut |piece| told.extend_from_slice(piece));
            let source = match cfg!(feature = "docs") {
                true => source.to_owned(),
                false => (source.split_inclusive('\n'))
                    .filter(|line| !line.trim_start().starts_with("///"))
                    .collect(),
            };
            assert_eq!(String::from_utf8(told).unwrap(), source);
        }
    }

    #[test]
    fn literals_are_those_of_missions() {
        for (text, is_one) in [
            ("0", true),
            ("-12", true),
            ("0.25", true),
            ("-1.5", true),
            ("true", true),
            ("false", true),
            ("20_000", false),
            ("1u32", false),
            ("2.0f32", false),
            ("1e3", false),
            ("0x10", false),
        ] {
            assert_eq!(is_esm_literal(text), is_one, "{text}");
        }
    }

    #[test]
    fn a_parameter_admits_what_is_within_its_bounds() {
        struct Bounded;
        task! {
            impl Bounded {
                params {
                    speed: f32 = 0, -1..=0.5;
                    steps: i32 = 0, -3..=4;
                    count: u32 = 1, 1..=9;
                    free: f32;
                    switch: bool;
                }
            }
        }
        let param = |index: u8| &declaration_of::<Bounded>().params[usize::from(index)];
        let f32 = f32::to_bits;
        let i32 = i32::cast_unsigned;
        for (param, within, outside) in [
            (
                param(Bounded::SPEED.index),
                [f32(-1.0), f32(-0.0), f32(0.5)],
                [f32(-1.01), f32(0.51), f32(f32::NAN)],
            ),
            (
                param(Bounded::STEPS.index),
                [i32(-3), i32(0), i32(4)],
                [i32(-4), i32(5), i32(i32::MIN)],
            ),
            (param(Bounded::COUNT.index), [1, 5, 9], [0, 10, u32::MAX]),
        ] {
            for bits in within {
                assert!(param.admits(bits), "{}: {bits:#x}", param.name);
            }
            for bits in outside {
                assert!(!param.admits(bits), "{}: {bits:#x}", param.name);
            }
        }
        assert!(param(Bounded::FREE.index).admits(f32(f32::INFINITY)));
        let switch = param(Bounded::SWITCH.index);
        assert!(switch.admits(0) && switch.admits(1) && !switch.admits(2));
    }

    #[test]
    fn handles_know_their_places() {
        type E = Everything<u8, u8>;
        assert_eq!(
            (E::SCAN.index, E::POSE.index, E::ODD.index, E::CMD.index),
            (0, 1, 2, 3)
        );
        assert_eq!((E::GO.index, E::NEAR.index), (0, 1));
        assert_eq!((E::SPEED.index, E::LIMIT.index), (0, 1));
    }
}
