//! Defects that tests plant into the store, one at a time, to see that they are found. Shipped code has none of this.

use core::cell::Cell;

/// Makes an enum of defects, and the list of them with what each one is.
macro_rules! bugs {
    ($($bug:ident: $what:literal,)+) => {
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub(super) enum Bug { $(#[doc = $what] $bug,)+ }
        pub(super) const ALL: &[(Bug, &str)] = &[$((Bug::$bug, $what),)+];
    };
}

bugs! {
    HeaderFirst: "header and seal are written before the payload",
    SealBeforeHeader: "the seal is written before the header",
    HeadedForgotten: "a torn seal does not tell that there is a header whose erase is to be noted",
    SealForgotten: "a header without a seal counts",
    SealAlone: "a torn seal is not made up for by the words that follow it",
    PayloadNotReadBack: "the payload is not read back before it is acknowledged",
    HeadNotReadBack: "header and seal are not read back before they are acknowledged",
    AcknowledgedEarly: "an upload is acknowledged before its header is written",
    TailForgotten: "the last bytes, which do not fill a block, are not written",
    OffsetUnchecked: "bytes are taken at whatever offset they are sent for",
    LengthUnchecked: "an upload may be longer than a slot",
    LengthAtBootUnchecked: "a header may tell a length beyond its slot",
    HeaderChecksumTooShort: "the checksum of a header covers its first words only",
    PayloadUncheckedAtBoot: "a payload runs whatever its checksum",
    OlderWins: "sequence numbers are compared the wrong way round",
    WrapForgotten: "sequence numbers are compared as if they never started anew",
    TornTriedAsUnset: "a torn trial word counts as not set",
    TrialRepeated: "a mission whose trial failed is tried again",
    TrialOffTheRecord: "a mission runs on trial although the word for it was not taken",
    LiveTrialOffTheRecord: "a mission is put on trial while the robot runs, and no word says so",
    FallbackForgotten: "a trial that was left is still the mission that can be confirmed",
    TornConfirmedAsSet: "a torn confirmation counts as set",
    ConfirmedInMemoryOnly: "a confirmation is acknowledged and not written",
    ConfirmedByReading: "a confirmation that was read is taken for certain when it is asked for again",
    ConfirmationTaken: "an upload begins on a confirmation that was read and not written since the start",
    PromotionForgotten: "a note whose writing was cut can outrank a mission that was confirmed since",
    CutPromotionForgotten: "a new mission has a number that a note over a promotion, both of which were cut, may outrank",
    PromotedUntried: "a torn promotion does not say that there was a trial",
    NotesShareABlock: "confirmation and trial word are in one block",
    RunningErased: "an upload erases the slot that runs",
    FallbackErased: "an upload begins while a mission is on trial",
    ConfirmedErased: "where nothing runs, an upload erases the confirmed mission and keeps a newer one that failed",
    Unerased: "an upload does not erase its slot",
    ErasedUnnoted: "a slot is erased before the other one notes it",
    AdvanceForgotten: "the note before an erase does not take the mission that runs ahead of the other",
    CutNoteForgotten: "a new mission has a number that a note whose writing was cut may outrank",
    RecordUnconfirmed: "a record is acknowledged before its table is confirmed",
    RecordsUnformatted: "the first record is written without a table before it",
    CutRecordUnsettled: "a table whose writing was cut is left as it is",
    RecordUnsettled: "a table that a start finds is not confirmed by it",
    RecordKeptInMemoryOnly: "a record that the flash did not take is there all the same, until the next start",
    RecordOnce: "a record is acknowledged when one area has it",
    DamageGivesWay: "a table that is damaged gives way to the one before",
    EmptyTakenForNew: "a damaged table beside an area that is empty is taken for none",
    RecordTwice: "a record is kept behind the one that it replaces",
    JournalUnread: "what the journal says of records that cannot be read is not looked at",
    JournalForgotten: "a record is acknowledged without an entry in the journal",
    JournalBegunLate: "the first table is written before the journal says so",
    JournalEager: "the journal says that there are records before there is one",
    JournalMissing: "a table is trusted without a journal",
    JournalChecksumForgotten: "an entry of the journal counts whatever its checksum",
    DamagedEntryTakenForCut: "an entry of the journal that is damaged is taken for one whose writing was cut",
    EntryOnce: "an entry of the journal is there once",
    NewestHalfErased: "the half of the journal that has the newest entry is erased",
    KeyBeforeDamageTaken: "the key of an entry counts although the one behind it is damaged",
    RolledBack: "a table that is older than the journal says is taken for the last",
    AnythingTakenForNew: "areas with anything in them are taken for blank",
    FlawsUntold: "damage that loses nothing is not told",
    RenewedWithoutStop: "records that are written anew have no emergency stop",
    BudgetForgotten: "whoever asks wears the flash out",
    BudgetRefilled: "a reset fills the allowances for erases up",
    ReleasesUnpaid: "a release of an emergency stop is not paid for",
    StopsPaid: "an emergency stop is not kept where the budget is used up",
    StopNotPutOff: "a release that the budget had no room for is never kept",
    GivenUpRuns: "a mission that was given up is tried",
}

thread_local! {
    static PLANTED: Cell<Option<Bug>> = const { Cell::new(None) };
}

/// Whether this defect is planted in this thread.
pub(super) fn is_planted(bug: Bug) -> bool {
    PLANTED.get() == Some(bug)
}

/// Does this with a defect planted.
pub(super) fn with<T>(bug: Bug, run: impl FnOnce() -> T) -> T {
    PLANTED.set(Some(bug));
    let result = run();
    PLANTED.set(None);
    result
}
