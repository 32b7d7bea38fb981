//! The RTIC app, as a macro.

/// Makes the firmware of a robot on the board whose crate is `$b`. The chip's `app!` calls it, and
/// says which interrupts there are; what else may stand in it is said at
/// [`cortex_m_board::app!`].
///
/// `wiring` is a constant: which pin is what, as the robot's file says it. `robot` is the
/// registry's type, with the function that builds it from the board's
/// [`RobotParts`](rt_firmware::robot_parts::RobotParts).
#[macro_export]
macro_rules! app_of {
    (
        board($b:tt);
        interrupts $interrupts:tt;
        firmware: $firmware:expr,
        wiring: $wiring:expr,
        $($rest:tt)*
    ) => {
        $b::cortex_m_board::app! {
            board($b);
            interrupts $interrupts;
            start: $b::start(&$wiring) => $b::pins::Parts<{ $wiring.sonars.len() }>,
            firmware: $firmware,
            $($rest)*
        }
    };
}
