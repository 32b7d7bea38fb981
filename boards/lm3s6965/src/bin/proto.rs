#![no_std]
#![no_main]
use lm3s6965 as _;

macro_rules! app { () => {
#[$crate::board::rtic::app(device = $crate::board::pac, peripherals = false)]
#[allow(unsafe_op_in_unsafe_fn)]
mod app {
    use $crate::board as board;
    use $crate::board::rtic;
    use $crate::board::*;
    use heapless::spsc::{Queue, Producer, Consumer};
    use rt_firmware::body::*;
    #[shared] struct Shared { }
    #[local] struct Local { line: uart::Line, rx: Consumer<'static,u8>, tx: Producer<'static,u8>, start: u64, seq: u32 }

    #[init(local=[rxq: Queue<u8,128> = Queue::new(), txq: Queue<u8,256>=Queue::new()])]
    fn init(cx: init::Context) -> (Shared, Local) {
        stack::paint();
        clock::start();
        uart::start();
        plant::open();
        let (rp, rc) = cx.local.rxq.split();
        let (tp, tc) = cx.local.txq.split();
        slot_timer::start();
        watchdog::start();
        let (cause, _)= post_mortem::take();
        defmt::info!("started {}", match cause { post_mortem::Cause::PowerOn => 0u32, post_mortem::Cause::Panic{line} => line, post_mortem::Cause::HardFault{address} => address, post_mortem::Cause::Watchdog{address}=>address, _ => 99});
        (Shared {}, Local { line: uart::Line::new(rp, tc), rx: rc, tx: tp, start: 1000, seq: 0 })
    }
    #[idle] fn idle(_: idle::Context) -> ! { loop { cortex_m::asm::wfi() } }

    #[task(binds = TIMER_0A, priority = 7, local=[start, seq])]
    fn slot(cx: slot::Context) {
        slot_timer::acknowledge();
        let at = clock::advance();
        let start = cx.local.start;
        if at.us >= *start {
            let r = Request { sequence: *cx.local.seq, start_us: *start, effect_us: at.us - *start, actuators: Actuators{left_duty: at.rest_ticks as i16, ..Default::default()} };
            post_mortem::note_exchange(&r);
            let reply = plant::exchange(&r);
            if *cx.local.seq % 1000 == 0 { defmt::info!("slot {} late {} ticks {} reply {}", *cx.local.seq, at.us - *start, at.rest_ticks, reply.is_some()); rtic::export::pend(pac::Interrupt::SSI0); }
            *cx.local.seq += 1;
            *start += 10_000;
            if *cx.local.seq == 3500 { loop {} }
        }
        slot_timer::set(*start);
        watchdog::feed();
    }
    #[task(binds = UART0, priority = 3, local=[line])]
    fn uart0(cx: uart0::Context) { if cx.local.line.serve() { rtic::export::pend(pac::Interrupt::SSI0); } }
    #[task(binds = WATCHDOG_TIMER_0, priority = 8)]
    fn wd(_: wd::Context) { post_mortem::end(post_mortem::Cause::Watchdog { address: 0xabcd }) }
    #[task(binds = SSI0, priority = 2, local=[rx, tx])]
    fn link(cx: link::Context) {
        let mut any = false;
        while let Some(b) = cx.local.rx.dequeue() { any = true; let _ = cx.local.tx.enqueue(b.to_ascii_uppercase()); defmt::info!("got {} stack {}", b, stack::deepest_bytes()); }
        let mut buf=[0u8; 32];
        loop { let n = log::read(&mut buf); if n == 0 {break} any = true; for b in &buf[..n] { let _ = cx.local.tx.enqueue(*b); } }
        if any { rtic::export::pend(pac::Interrupt::UART0); }
    }
}
}}
use lm3s6965 as board;
app!();
