//! The module's exports: memory for a request, the call, the answer.

use std::cell::RefCell;

use crate::calls;

thread_local! {
    static REQUEST: RefCell<Vec<u8>> = const { RefCell::new(Vec::new()) };
    static ANSWER: RefCell<Vec<u8>> = const { RefCell::new(Vec::new()) };
}

/// Puts what a panic says in the answer's place.
fn report_panics() {
    std::panic::set_hook(Box::new(|panic| {
        // A panic while an answer is written leaves that one.
        let _ = ANSWER.try_with(|answer| {
            if let Ok(mut answer) = answer.try_borrow_mut() {
                *answer = panic.to_string().into_bytes();
            }
        });
    }));
}

/// Makes room for a request of so many bytes; answers where.
#[unsafe(no_mangle)]
#[expect(
    unsafe_code,
    reason = "the page finds an export by its name, and no other crate has one of this name"
)]
pub extern "C" fn studio_room(bytes: usize) -> *mut u8 {
    REQUEST.with_borrow_mut(|request| {
        request.clear();
        request.resize(bytes, 0);
        request.as_mut_ptr()
    })
}

/// Carries the request out; answers how many bytes the answer has.
#[unsafe(no_mangle)]
#[expect(
    unsafe_code,
    reason = "the page finds an export by its name, and no other crate has one of this name"
)]
pub extern "C" fn studio_call() -> usize {
    report_panics();
    let request = REQUEST.take();
    let answer = calls::carry_out(&request);
    ANSWER.with_borrow_mut(|kept| {
        *kept = answer;
        kept.len()
    })
}

/// Where the answer is, or what the panic said that has ended the instance.
#[unsafe(no_mangle)]
#[expect(
    unsafe_code,
    reason = "the page finds an export by its name, and no other crate has one of this name"
)]
pub extern "C" fn studio_answer() -> *const u8 {
    ANSWER.with_borrow(|answer| answer.as_ptr())
}

/// How many bytes that has.
#[unsafe(no_mangle)]
#[expect(
    unsafe_code,
    reason = "the page finds an export by its name, and no other crate has one of this name"
)]
pub extern "C" fn studio_answer_bytes() -> usize {
    ANSWER.with_borrow(Vec::len)
}
