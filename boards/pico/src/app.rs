//! The RTIC app, as a macro: RTIC generates a program for the types that it is given, so it cannot
//! be generic over the robot.

/// Makes the firmware of a robot: `main`, the interrupt handlers, and the memory of all of it.
///
/// `wiring` is a constant: which pin is what, as the robot's file says it. `robot` is the
/// registry's type, with the function that builds it from the board's
/// [`RobotParts`](rt_firmware::robot_parts::RobotParts); `firmware` is the name and version that
/// the robot tells of itself, in at most 40 bytes.
///
/// `default_mission` are the bytes of a mission that `esm build` has made: what the robot does if
/// its flash has no mission that may run. Without it, it does nothing then.
#[macro_export]
macro_rules! app {
    (
        firmware: $firmware:expr,
        wiring: $wiring:expr,
        robot: $robot:ty = $make:expr
        $(, default_mission: $default_mission:expr)? $(,)?
    ) => {
        #[$crate::rtic::app(device = $crate::rp2040_hal::pac, peripherals = false)]
        // RTIC calls unsafe functions in unsafe functions without a block around the call.
        #[allow(unsafe_op_in_unsafe_fn, missing_docs)]
        mod app {
            use core::mem::MaybeUninit;

            use super::*;
            use $crate::cortex_m_board::sides::{self, Sides};
            use $crate::flash::{self, StoreMemory};
            use $crate::heapless::spsc::Queue;
            use $crate::line::{self, Line, LinkEnd, RECEIVE_BYTES, TRANSMIT_BYTES};
            use $crate::pins::StopPin;
            use $crate::rp2040_hal::pac::Interrupt;
            use $crate::rp2040_hal::usb::UsbBus;
            use $crate::rp2040_hal::vector_table::VectorTable;
            use $crate::rt_firmware::robot_parts::RobotParts;
            use $crate::rt_firmware::{
                About, AnyTaskPool, Background, Limits, LinkSide, Mailbox, RealTime, WithStopButton,
                split,
            };
            use $crate::slots::SlotBoard;
            use $crate::uart::Uart0;
            use $crate::usb::Usb;
            use $crate::usb_device::bus::UsbBusAllocator;
            use $crate::{clock, cortex_m, crash, rtic};

            type Banks = [&'static mut (dyn AnyTaskPool + 'static); <$robot>::POOLS];

            #[shared]
            struct Shared {
                // The handlers that have these are of one priority.
                #[lock_free]
                line: Line,
                #[lock_free]
                usb: Usb,
            }

            // The large ones by reference: RTIC moves these on the stack.
            #[local]
            struct Local {
                real_time: &'static mut RealTime<'static, 'static>,
                board: WithStopButton<SlotBoard, StopPin>,
                background: Background<'static, 'static>,
                link: &'static mut LinkSide<'static, 'static>,
                link_end: LinkEnd,
                uart: Uart0,
            }

            #[init(local = [
                vectors: VectorTable = VectorTable::new(),
                usb_bus: MaybeUninit<UsbBusAllocator<UsbBus>> = MaybeUninit::uninit(),
                robot: MaybeUninit<$robot> = MaybeUninit::uninit(),
                banks: MaybeUninit<Banks> = MaybeUninit::uninit(),
                memory: $crate::Memory<'static> = <$crate::Memory<'static>>::new(),
                mailbox: Mailbox<'static> = Mailbox::new(),
                real_time_place: MaybeUninit<RealTime<'static, 'static>> = MaybeUninit::uninit(),
                link_place: MaybeUninit<LinkSide<'static, 'static>> = MaybeUninit::uninit(),
                received: Queue<u8, RECEIVE_BYTES> = Queue::new(),
                to_transmit: Queue<u8, TRANSMIT_BYTES> = Queue::new(),
                keep: StoreMemory = StoreMemory::new(),
            ])]
            fn init(cx: init::Context) -> (Shared, Local) {
                let start = $crate::start(cx.local.vectors, cx.local.usb_bus, &$wiring);
                let parts = start.parts;
                let robot = $crate::put(cx.local.robot, || {
                    type Given =
                        RobotParts<$crate::pins::BoardParts, { $wiring.sonars.len() }>;
                    let make: fn(Given) -> $robot = $make;
                    make(parts.robot)
                });
                let banks = cx.local.banks.write(robot.banks());
                let about = About {
                    reset: start.reset,
                    kept: Some(crash::kept()),
                    ..About::new($firmware, $crate::NAME)
                };
                let Sides { real_time, background, link } = sides::make(
                    cx.local.real_time_place,
                    cx.local.link_place,
                    || split(cx.local.memory, banks, cx.local.mailbox, about, Limits::default()),
                );
                let own: Option<&'static [u8]> = [$(&$default_mission[..])?].first().copied();
                let keep = flash::open(cx.local.keep, own);
                let (line, mut link_end) = line::split(
                    cx.local.received,
                    cx.local.to_transmit,
                    link.stop_listener(),
                    keep,
                );
                link.start(&mut link_end);
                let mut board = start.board;
                board.start_watchdog();
                let board = WithStopButton::new(board, parts.stop_button);
                let (uart, usb) = (parts.uart, start.usb);
                (
                    Shared { line, usb },
                    Local { real_time, board, background, link, link_end, uart },
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

            #[task(binds = TIMER_IRQ_0, priority = 4, local = [real_time, board])]
            fn slots(cx: slots::Context) {
                let next_us = cx.local.real_time.on_timer(cx.local.board);
                clock::set(next_us);
                rtic::export::pend(Interrupt::SW0_IRQ);
            }

            #[task(binds = UART0_IRQ, priority = 3, shared = [line], local = [uart])]
            fn wire(cx: wire::Context) {
                if cx.shared.line.serve(cx.local.uart) {
                    rtic::export::pend(Interrupt::SW0_IRQ);
                }
            }

            #[task(binds = USBCTRL_IRQ, priority = 3, shared = [line, usb])]
            fn usb(cx: usb::Context) {
                if cx.shared.line.serve(cx.shared.usb) {
                    rtic::export::pend(Interrupt::SW0_IRQ);
                }
            }

            #[task(binds = SW1_IRQ, priority = 3, shared = [line, usb])]
            fn usb_called(cx: usb_called::Context) {
                if cx.shared.line.serve(cx.shared.usb) {
                    rtic::export::pend(Interrupt::SW0_IRQ);
                }
            }

            #[task(binds = SW0_IRQ, priority = 2, local = [link, link_end])]
            fn link(cx: link::Context) {
                cx.local.link_end.serve(cx.local.link);
            }
        }
    };
}
