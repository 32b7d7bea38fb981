//! Memory at the addresses of the chip's registers, of which each access is seen.
//!
//! The pages are there and may not be touched. An access is a fault, whose handler opens the page,
//! asks the part what it answers, and lets the processor do this one instruction; behind it the
//! part hears what was written, and the page is closed again.

use std::ptr;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering::SeqCst};
use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};

use libc::{
    MAP_ANONYMOUS, MAP_FIXED_NOREPLACE, MAP_PRIVATE, PROT_NONE, PROT_READ, PROT_WRITE, REG_EFL,
    REG_ERR, SA_SIGINFO, SIGSEGV, SIGTRAP, c_int, c_void, siginfo_t, ucontext_t,
};

/// Parts on the buses APB1, APB2 and AHB1 (RM0090, table 1), and those of the core itself.
const WATCHED: [(usize, usize); 2] = [(0x4000_0000, 0x3_0000), (0xE000_E000, 0x1000)];
/// The sectors of the store, which are plain memory: 6 to 11 (RM0090, table 5).
pub const STORE: (usize, usize) = (0x0804_0000, 768 << 10);

const PAGE: usize = 4096;
/// Bit of the processor's flags: a trap behind each instruction.
const TRAP: i64 = 0x100;
/// Bit of the fault's code: it was a write.
const WRITE: i64 = 2;

/// An access to a register: its address, and the word that was there behind it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Access {
    pub is_write: bool,
    pub at: usize,
    pub word: u32,
}

/// What a part does.
pub trait Part: Send {
    /// What a register shows, of which `held` was held.
    fn read(&mut self, at: usize, held: u32) -> u32 {
        let _ = at;
        held
    }

    /// What a register holds that held `before`, and to which `written` was written.
    fn write(&mut self, at: usize, before: u32, written: u32) -> u32 {
        let _ = (at, before);
        written
    }
}

/// Registers that hold what is written to them.
pub struct Plain;

impl Part for Plain {}

const LOGGED: usize = 65_536;

struct Watch {
    part: Box<dyn Part>,
    log: Vec<Access>,
    /// The access that is under way, and what was held before it.
    pending: (Access, u32),
}

/// Of the thread that has the chip, in its handlers and outside of them in turn.
static mut WATCH: Option<Watch> = None;
static IS_ON: AtomicBool = AtomicBool::new(false);
static THREAD: AtomicUsize = AtomicUsize::new(0);

/// The chip, which one test has at a time.
pub struct Chip {
    _alone: MutexGuard<'static, ()>,
}

impl Chip {
    /// A chip after a reset whose registers all hold 0, but for what the part says.
    pub fn new(part: impl Part + 'static) -> Self {
        static ALONE: Mutex<()> = Mutex::new(());
        static MAPPED: OnceLock<()> = OnceLock::new();
        let alone = ALONE.lock().unwrap_or_else(PoisonError::into_inner);
        MAPPED.get_or_init(map);
        IS_ON.store(false, SeqCst);
        // SAFETY: one test has the chip; no handler runs, since nothing is watched.
        unsafe {
            for (at, bytes) in WATCHED {
                protect(at, bytes, PROT_READ | PROT_WRITE);
                ptr::write_bytes(at as *mut u8, 0, bytes);
                protect(at, bytes, PROT_NONE);
            }
            ptr::write_bytes(STORE.0 as *mut u8, 0xFF, STORE.1);
            WATCH = Some(Watch {
                part: Box::new(part),
                log: Vec::with_capacity(LOGGED),
                pending: (
                    Access {
                        is_write: false,
                        at: 0,
                        word: 0,
                    },
                    0,
                ),
            });
            THREAD.store(libc::pthread_self() as usize, SeqCst);
        }
        IS_ON.store(true, SeqCst);
        Chip { _alone: alone }
    }

    /// All accesses since the last call, in their order; of reads that find the same, the first.
    pub fn accesses(&mut self) -> Vec<Access> {
        // SAFETY: this thread has the chip, and touches none of its registers here.
        let watch = unsafe { &mut *ptr::addr_of_mut!(WATCH) };
        let watch = watch.as_mut().unwrap();
        let taken = watch.log.clone();
        watch.log.clear();
        taken
    }

    /// The writes among them.
    pub fn writes(&mut self) -> Vec<(usize, u32)> {
        let all = self.accesses().into_iter();
        all.filter(|it| it.is_write)
            .map(|it| (it.at, it.word))
            .collect()
    }

    /// What a register holds.
    pub fn word(&self, at: usize) -> u32 {
        let (page, open) = (at & !(PAGE - 1), PROT_READ | PROT_WRITE);
        // SAFETY: the page is one of those that are watched, and nobody touches it meanwhile.
        unsafe {
            protect(page, PAGE, open);
            let word = ptr::read_volatile(at as *const u32);
            protect(page, PAGE, PROT_NONE);
            word
        }
    }

    /// Lets a register hold this.
    pub fn set(&self, at: usize, word: u32) {
        let (page, open) = (at & !(PAGE - 1), PROT_READ | PROT_WRITE);
        // SAFETY: the same.
        unsafe {
            protect(page, PAGE, open);
            ptr::write_volatile(at as *mut u32, word);
            protect(page, PAGE, PROT_NONE);
        }
    }
}

/// # Safety
/// The pages are those that [`map`] has mapped.
unsafe fn protect(at: usize, bytes: usize, how: c_int) {
    // SAFETY: as the caller promises.
    let done = unsafe { libc::mprotect(at as *mut c_void, bytes, how) };
    assert_eq!(done, 0, "mprotect of {at:#x}");
}

/// Maps the memory, and sets the handlers.
fn map() {
    let flags = MAP_PRIVATE | MAP_ANONYMOUS | MAP_FIXED_NOREPLACE;
    for ((at, bytes), how) in WATCHED
        .map(|it| (it, PROT_NONE))
        .into_iter()
        .chain([(STORE, PROT_READ | PROT_WRITE)])
    {
        // SAFETY: nothing is there: the flag says that nothing is replaced.
        let mapped = unsafe { libc::mmap(at as *mut c_void, bytes, how, flags, -1, 0) };
        assert_eq!(mapped as usize, at, "the host has something at {at:#x}");
    }
    for (signal, handler) in [(SIGSEGV, fault as *const ()), (SIGTRAP, trap as *const ())] {
        // SAFETY: handlers of the signature that the flag says, for the process's whole life.
        let done = unsafe {
            let mut action: libc::sigaction = std::mem::zeroed();
            action.sa_sigaction = handler as usize;
            action.sa_flags = SA_SIGINFO | libc::SA_ONSTACK | libc::SA_NODEFER;
            libc::sigaction(signal, &action, ptr::null_mut())
        };
        assert_eq!(done, 0);
    }
}

extern "C" fn fault(signal: c_int, info: *mut siginfo_t, context: *mut c_void) {
    // SAFETY: what the system hands to a handler; the thread that has the chip was interrupted in
    // an access to a page that is watched, so that nobody is at `WATCH`.
    unsafe {
        let address = (*info).si_addr() as usize;
        let is_watched = (WATCHED.iter()).any(|(at, bytes)| (*at..at + bytes).contains(&address));
        let is_ours = libc::pthread_self() as usize == THREAD.load(SeqCst);
        if !is_watched || !is_ours || !IS_ON.load(SeqCst) {
            // Whatever it is: it comes again, and ends the process.
            libc::signal(signal, libc::SIG_DFL);
            return;
        }
        let registers = &mut (*context.cast::<ucontext_t>()).uc_mcontext.gregs;
        let at = address & !3;
        protect(at & !(PAGE - 1), PAGE, PROT_READ | PROT_WRITE);
        let held = ptr::read_volatile(at as *const u32);
        let is_write = registers[REG_ERR as usize] & WRITE != 0;
        if let Some(watch) = (*ptr::addr_of_mut!(WATCH)).as_mut() {
            let word = match is_write {
                true => held,
                false => watch.part.read(at, held),
            };
            ptr::write_volatile(at as *mut u32, word);
            watch.pending = (Access { is_write, at, word }, held);
        }
        registers[REG_EFL as usize] |= TRAP;
    }
}

extern "C" fn trap(_signal: c_int, _info: *mut siginfo_t, context: *mut c_void) {
    // SAFETY: as in `fault`, behind the instruction that it has let pass.
    unsafe {
        let registers = &mut (*context.cast::<ucontext_t>()).uc_mcontext.gregs;
        registers[REG_EFL as usize] &= !TRAP;
        let Some(watch) = (*ptr::addr_of_mut!(WATCH)).as_mut() else {
            return;
        };
        let (mut access, held) = watch.pending;
        if access.is_write {
            access.word = ptr::read_volatile(access.at as *const u32);
            let holds = watch.part.write(access.at, held, access.word);
            ptr::write_volatile(access.at as *mut u32, holds);
        }
        // Who waits looks again and again. No memory is taken in a handler.
        let is_again = !access.is_write && watch.log.last() == Some(&access);
        if !is_again && watch.log.len() < LOGGED {
            watch.log.push(access);
        }
        protect(access.at & !(PAGE - 1), PAGE, PROT_NONE);
    }
}
