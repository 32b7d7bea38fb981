//! The RTIC app, as a macro: RTIC generates a program for the types that it is given, so it cannot
//! be generic over the robot.

/// Makes the firmware of a robot: `main`, the interrupt handlers, and the memory of all of it. A
/// board's own `app!` calls it, and says which crate the board is and which interrupts it has:
///
/// ```ignore
/// #[macro_export]
/// macro_rules! app {
///     ($($firmware:tt)*) => {
///         $crate::cortex_m_board::app! {
///             board($crate);
///             interrupts(slots: TIM2, wire: USART1, plant_line: TIM5, link: CAN2_SCE);
///             $($firmware)*
///         }
///     };
/// }
/// ```
///
/// `plant_line` and `watchdog` may be left out, and so may `frames: Line(TIMER_2A, UART1)`, a type
/// of the board's module `frames` with the interrupts that start a link's frames and move their
/// bytes, and `usb: Usb(USBCTRL_IRQ, SW1_IRQ)`, a type of the module `usb`, the second wire of the
/// line, with its interrupt and the one that software pends in its place. `link` is an interrupt
/// that no part uses: it is pended by software. `slots: TIMER_IRQ_0 = 4` gives the slots another
/// priority than 7, on cores that have no more. The board's crate has these names:
///
/// | name | what it is |
/// |---|---|
/// | `NAME`, `settings`, `Memory` | its name, and what `board.toml` says, as constants |
/// | `start`, `Parts` | the first code, which gives a [`Start`](crate::sides::Start), and the robot's pins |
/// | `slots::SlotBoard` | the [`Board`](rt_firmware::Board) for the slot timer's handler |
/// | `slot_timer` | `start`, `begin` (first of all in the handler), `set` (last) |
/// | `flash` | `StoreMemory`, `open` |
/// | `line`, `uart::Uart` | the line's ends with `split`, and the wire of its interrupt |
/// | `watchdog` | `start` |
/// | `post_mortem` | `end`, where there is a `watchdog` interrupt |
/// | `pac`, `rtic`, `cortex_m`, `cortex_m_board`, `heapless`, `rt_firmware` | crates |
///
/// What a firmware says behind that:
///
/// `robot` is the registry's type, with the function that builds it from the pins (a
/// `fn(Parts) -> Robot`); `firmware` is the name and version that the robot tells of itself, in at
/// most 40 bytes. A robot that is too large to stand on the stack first is made in its place:
/// `robot_in_place` is the type of the places that [`registry!`](rt_firmware::registry!) makes,
/// with the function that fills them from the pins and returns the banks.
///
/// `emergency_stop` is the button of one, if the robot has it: the type of an input that is low
/// while it is pressed (embedded-hal's `InputPin`), with what gives it. It stops the robot whatever
/// the mission does and whether or not a host is there, until it is released. Without it nothing of
/// a button is in the firmware.
///
/// `default_mission` are the bytes of a mission that `esm build` has made: what the robot does if
/// its flash has no mission that may run. Without it, it does nothing then.
///
/// A firmware of another kind, such as a benchmark, names besides what its slots run on (a
/// [`Board`](rt_firmware::Board), with the function that builds it from the board's), the memory of
/// its runtime, and how many slots that has; and where `start` and the robot's pins are not those
/// names, `start: $start => $parts`, a call and the type of the pins.
#[macro_export]
macro_rules! app {
    // On the board's own slots, without a button.
    (
        board($b:tt);
        interrupts $interrupts:tt;
        $(start: $start:expr => $parts:ty,)?
        firmware: $firmware:expr,
        $how:ident: $robot:ty = $make:expr
        $(, default_mission: $default_mission:expr)? $(,)?
    ) => {
        $crate::app! {
            board($b);
            interrupts $interrupts;
            $(start: $start => $parts,)?
            firmware: $firmware,
            $how: $robot = $make,
            board: $b::slots::SlotBoard = |board| board,
            memory: $b::Memory<'static>,
            slots: $b::settings::SLOTS,
            $(default_mission: $default_mission,)?
        }
    };
    // On the same, with one.
    (
        board($b:tt);
        interrupts $interrupts:tt;
        $(start: $start:expr => $parts:ty,)?
        firmware: $firmware:expr,
        $how:ident: $robot:ty = $make:expr,
        emergency_stop: $pin:ty = $make_pin:expr
        $(, default_mission: $default_mission:expr)? $(,)?
    ) => {
        $crate::app! {
            board($b);
            interrupts $interrupts;
            $(start: $start => $parts,)?
            firmware: $firmware,
            $how: $robot = $make,
            board: $b::rt_firmware::WithStopButton<$b::slots::SlotBoard, $pin> = |board| {
                $b::rt_firmware::WithStopButton::new(board, $make_pin)
            },
            memory: $b::Memory<'static>,
            slots: $b::settings::SLOTS,
            $(default_mission: $default_mission,)?
        }
    };
    // With the start that most boards have, and the slots' priority.
    (board($b:tt); interrupts $interrupts:tt; firmware: $($rest:tt)*) => {
        $crate::app! {
            board($b);
            interrupts $interrupts;
            start: $b::start() => $b::Parts,
            firmware: $($rest)*
        }
    };
    (
        board($b:tt);
        interrupts(slots: $slot_timer:ident, $($interrupts:tt)*);
        start: $($rest:tt)*
    ) => {
        $crate::app! {
            board($b);
            interrupts(slots: $slot_timer = 7, $($interrupts)*);
            start: $($rest)*
        }
    };
    // A robot that is made as a value, and one that is made in its place.
    (
        board($b:tt);
        interrupts $interrupts:tt;
        start: $start:expr => $parts:ty,
        firmware: $firmware:expr,
        robot: $robot:ty = $make:expr,
        $($rest:tt)*
    ) => {
        $crate::app! {
            @all
            board($b);
            interrupts $interrupts;
            start: $start,
            firmware: $firmware,
            place: ::core::mem::MaybeUninit<$robot> = ::core::mem::MaybeUninit::uninit(),
            pools: <$robot>::POOLS,
            fill: (place, parts) {
                // Inside, so that it is made in one call: two would have it on the stack twice.
                let robot = $b::cortex_m_board::put(place, || {
                    let make: fn($parts) -> $robot = $make;
                    make(parts)
                });
                robot.banks()
            },
            $($rest)*
        }
    };
    (
        board($b:tt);
        interrupts $interrupts:tt;
        start: $start:expr => $parts:ty,
        firmware: $firmware:expr,
        robot_in_place: $places:ty = $fill:expr,
        $($rest:tt)*
    ) => {
        $crate::app! {
            @all
            board($b);
            interrupts $interrupts;
            start: $start,
            firmware: $firmware,
            place: $places = <$places>::EMPTY,
            pools: <$places>::POOLS,
            fill: (place, parts) {
                let fill: fn(
                    &'static mut $places,
                    $parts,
                ) -> [&'static mut dyn $b::rt_firmware::AnyTaskPool; <$places>::POOLS] = $fill;
                fill(place, parts)
            },
            $($rest)*
        }
    };
    (
        @all
        board($b:tt);
        interrupts(
            slots: $slot_timer:ident = $slot_priority:tt,
            wire: $wire:ident,
            $(usb: $usb_line:ident($usb:ident, $usb_called:ident),)?
            $(plant_line: $plant_line:ident,)?
            $(watchdog: $watchdog:ident,)?
            $(frames: $frame_line:ident($frame_start:ident, $frame_wire:ident),)?
            link: $link:ident $(,)?
        );
        start: $start:expr,
        firmware: $firmware:expr,
        place: $place:ty = $empty:expr,
        pools: $pools:expr,
        fill: ($robot_place:ident, $pins:ident) $fill:expr,
        board: $board:ty = $make_board:expr,
        memory: $memory:ty,
        slots: $slots:expr
        $(, default_mission: $default_mission:expr)? $(,)?
    ) => {
        #[$b::rtic::app(device = $b::pac, peripherals = false)]
        // RTIC calls unsafe functions in unsafe functions without a block around the call.
        #[allow(unsafe_op_in_unsafe_fn, missing_docs)]
        mod app {
            use core::mem::MaybeUninit;

            use super::*;
            use $b::cortex_m_board::crash;
            use $b::cortex_m_board::sides::{self, Sides};
            use $b::flash::{self, StoreMemory};
            use $b::heapless::spsc::Queue;
            use $b::line::{self, LinkEnd, RECEIVE_BYTES, TRANSMIT_BYTES};
            use $b::pac::Interrupt;
            use $b::rt_firmware::{
                About, AnyTaskPool, Background, Limits, LinkSide, Mailbox, RealTime, split,
            };
            use $b::uart::Uart;
            use $b::{cortex_m, rtic, slot_timer, watchdog};

            type MissionMemory = $memory;
            type RobotPlace = $place;

            #[shared]
            struct Shared {
                // Both handlers have one priority.
                #[lock_free]
                line: line::Line,
                $(
                    // As the line.
                    #[lock_free]
                    usb_line: $b::usb::$usb_line,
                )?
                $(
                    // Both handlers have one priority.
                    #[lock_free]
                    frame_line: $b::frames::$frame_line,
                )?
            }

            // The large ones by reference: RTIC moves these on the stack.
            #[local]
            struct Local {
                real_time: &'static mut RealTime<'static, 'static>,
                board: $board,
                background: Background<'static, 'static>,
                link: &'static mut LinkSide<'static, 'static>,
                link_end: LinkEnd,
            }

            #[init(local = [
                robot: RobotPlace = $empty,
                banks: MaybeUninit<[&'static mut (dyn AnyTaskPool + 'static); $pools]> = MaybeUninit::uninit(),
                memory: MissionMemory = MissionMemory::new(),
                mailbox: Mailbox<'static> = Mailbox::new(),
                real_time_place: MaybeUninit<RealTime<'static, 'static>> = MaybeUninit::uninit(),
                link_place: MaybeUninit<LinkSide<'static, 'static>> = MaybeUninit::uninit(),
                received: Queue<u8, RECEIVE_BYTES> = Queue::new(),
                to_transmit: Queue<u8, TRANSMIT_BYTES> = Queue::new(),
                keep: StoreMemory = StoreMemory::new(),
            ])]
            fn init(cx: init::Context) -> (Shared, Local) {
                #[allow(unused_mut)]
                let mut start = $start;
                let make_board: fn($b::slots::SlotBoard) -> $board = $make_board;
                let $pins = start.parts;
                let $robot_place = cx.local.robot;
                let banks = cx.local.banks.write($fill);
                let about = About {
                    reset: start.reset,
                    kept: Some(crash::kept()),
                    ..About::new($firmware, $b::NAME)
                };
                let Sides { real_time, background, link } = sides::make(
                    cx.local.real_time_place,
                    cx.local.link_place,
                    || split(cx.local.memory, banks, cx.local.mailbox, about, Limits::default()),
                );
                let default_mission: Option<&'static [u8]> = [$(&$default_mission[..])?].first().copied();
                let keep = flash::open(cx.local.keep, default_mission);
                let (line, mut link_end) = line::split(
                    cx.local.received,
                    cx.local.to_transmit,
                    link.stop_listener(),
                    keep,
                );
                link.start(&mut link_end);
                slot_timer::start();
                watchdog::start();
                (
                    Shared {
                        line,
                        $(usb_line: {
                            let usb: $b::usb::$usb_line = $b::usb::start(&mut start.board);
                            usb
                        },)?
                        $(frame_line: $b::frames::$frame_line::start(&mut start.board),)?
                    },
                    Local { real_time, board: make_board(start.board), background, link, link_end },
                )
            }

            #[idle(local = [background])]
            fn idle(cx: idle::Context) -> ! {
                loop {
                    if !cx.local.background.poll() {
                        // An interrupt that gives it work ends the sleep, or has come already and
                        // made it pending.
                        cortex_m::asm::wfi();
                    }
                }
            }

            #[task(binds = $slot_timer, priority = $slot_priority, local = [real_time, board])]
            fn slots(cx: slots::Context) {
                slot_timer::begin();
                let next_ticks = cx.local.real_time.on_timer(cx.local.board);
                slot_timer::set(next_ticks);
                rtic::export::pend(Interrupt::$link);
            }

            #[task(binds = $wire, priority = 3, shared = [line])]
            fn wire(cx: wire::Context) {
                if cx.shared.line.serve(&mut Uart) {
                    rtic::export::pend(Interrupt::$link);
                }
            }

            $(
                #[task(binds = $usb, priority = 3, shared = [line, usb_line])]
                fn usb(cx: usb::Context) {
                    if cx.shared.line.serve(cx.shared.usb_line) {
                        rtic::export::pend(Interrupt::$link);
                    }
                }

                #[task(binds = $usb_called, priority = 3, shared = [line, usb_line])]
                fn usb_called(cx: usb_called::Context) {
                    if cx.shared.line.serve(cx.shared.usb_line) {
                        rtic::export::pend(Interrupt::$link);
                    }
                }
            )?

            $(
                #[task(binds = $plant_line, priority = 3, shared = [line])]
                fn plant_line(cx: plant_line::Context) {
                    if cx.shared.line.swap() {
                        rtic::export::pend(Interrupt::$link);
                    }
                }
            )?

            #[task(binds = $link, priority = 2, local = [link, link_end])]
            fn link(cx: link::Context) {
                cx.local.link_end.serve(cx.local.link);
            }

            $(
                #[task(binds = $frame_start, priority = 8, shared = [frame_line])]
                fn frame_start(cx: frame_start::Context) {
                    cx.shared.frame_line.start_due();
                }

                #[task(binds = $frame_wire, priority = 8, shared = [frame_line])]
                fn frame_wire(cx: frame_wire::Context) {
                    cx.shared.frame_line.serve();
                }
            )?

            $(
                #[task(binds = $watchdog, priority = 8)]
                fn slots_have_stopped(_: slots_have_stopped::Context) {
                    use $b::rt_firmware::retained_ram::CrashCause;
                    $b::post_mortem::end(&CrashCause::Watchdog);
                }
            )?
        }
    };
}
