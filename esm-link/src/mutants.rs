//! Mutants: defects that tests plant into the link, one at a time, to see that they are found.
//! Shipped code has none of this.

use std::cell::Cell;

/// Makes an enum of defects, and the list of them with what each one is.
macro_rules! bugs {
    ($($bug:ident: $what:literal,)+) => {
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        /// A mutant.
        pub enum Bug { $(#[doc = $what] $bug,)+ }
        /// All of them, and what each does.
        pub const ALL: &[(Bug, &str)] = &[$((Bug::$bug, $what),)+];
    };
}

bugs! {
    FrameUnchecked: "a frame's checksum is not looked at",
    OutOfStep: "the reader of frames does not find the beginning of the next one after garbage",
    OverlongTaken: "a frame that is longer than any is cut off and taken",
    CarriedOutTwice: "a request that comes twice is carried out twice",
    ToldByNumber: "a request is told from the one before by its number alone",
    StopSuppressed: "a stop that comes a second time is answered and not done",
    CarriedOutLate: "a request is carried out that comes after its time",
    SignedCarriedOutLate: "a signed request is carried out that comes after its time",
    DeadlineForgotten: "a request that waits for its turn is carried out after its time",
    GapTaken: "a chunk is taken over a gap",
    OverlapRepeated: "bytes that are there already are taken once more",
    LengthForgotten: "a chunk may go beyond the length that was announced",
    CapacityForgotten: "an upload may be longer than the robot has room for",
    OtherLengthResumed: "an upload of another length goes on as if it were the same",
    OtherBlobResumed: "an upload of another checksum goes on as if it were the same",
    AbortForgotten: "an upload that was given up goes on",
    IncompleteTaken: "an upload is ended that is not complete",
    WholeUnchecked: "the checksum of the whole upload is not looked at",
    KeyForgotten: "a request that needs the key is carried out without",
    UnsignedTaken: "an upload is taken that the key has not signed",
    CounterRepeated: "an upload with the counter of the last one is taken",
    NonceKept: "a nonce is good for two requests",
    OthersBytesKept: "an upload stays whose bytes are not those that were signed",
    ValuesUnlimited: "more nets are asked for than a sample can tell of",
    PauseForgotten: "signatures are looked at right after a wrong one",
    StrangerIsOwner: "what is for the owner's session is taken from anyone",
    OwnerWaitsInVain: "a stranger's request that the real-time side has keeps the owner's from being done",
    StrangerHeard: "a mission that looks after its owner takes anyone for him",
    SessionUnproven: "a session is opened for who does not know the secret",
    SessionReplayed: "a session is opened a second time after another one",
    OldSessionOpened: "a session is opened with a nonce that is too old",
    ProofUnchecked: "the proof of a request is not looked at",
    NumberRepeated: "a request of the owner's is carried out a second time",
    NonceForEver: "a signature is taken however old its nonce is",
    CounterUnlimited: "the counter of an upload may be as great as it likes",
    DeadlineUnlimited: "a deadline may be as far ahead as it likes",
    NoiseStops: "the checksum of a stop that is heard is not looked at",
    StopDoneBefore: "a stop is answered before the robot stands still",
    StopAheadForgotten: "what was read before a stop that was heard is carried out behind it",
    OvertakenForgotten: "a start that is under way is carried out behind a stop",
    WaitingComesAnew: "what waited for its turn counts as read when it is carried out",
    OverloadForgotten: "what cannot be answered fills the queue until stops and uploads are lost",
    BudgetForgotten: "the link takes all the time that there is",
}

thread_local! {
    static PLANTED: Cell<Option<Bug>> = const { Cell::new(None) };
}

/// Whether this defect is planted in this thread.
pub fn is_mutant(bug: Bug) -> bool {
    PLANTED.get() == Some(bug)
}

/// Activates a mutant in this thread, or none.
pub fn plant(bug: Option<Bug>) {
    PLANTED.set(bug);
}
