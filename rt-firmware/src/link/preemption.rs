//! Lets interrupts come in tests, at each place where one side looks at what it shares with others.

use core::cell::RefCell;
use std::boxed::Box;

type Interrupt = Box<dyn FnMut()>;

std::thread_local! {
    static INTERRUPT: RefCell<Option<Interrupt>> = const { RefCell::new(None) };
}

/// A place where one may come. Nothing comes during an interrupt, but what that calls itself.
pub(crate) fn point() {
    let Some(mut interrupt) = INTERRUPT.take() else {
        return;
    };
    interrupt();
    INTERRUPT.set(Some(interrupt));
}
